"""Ways through places, without coordinates."""

import itertools

import numpy as np
import pytest

from robotctl.errors import InvalidValue
from robotctl.planning.map.topological.graph import Passage, TopologicalMap, TopologicalPlace


def made(edges, order=None):
    """Make a map of edges {name: (a, b, length_m)}; `order` gives the passages of some places."""
    names = sorted({end for a, b, _ in edges.values() for end in (a, b)})
    places = [
        TopologicalPlace(
            name,
            "room",
            tuple((order or {}).get(name) or (key for key, e in edges.items() if name in e[:2])),
            10.0,
            3.0,
        )
        for name in names
    ]
    passages = [Passage(key, (a, b), 0.9, length_m) for key, (a, b, length_m) in edges.items()]
    return TopologicalMap(tuple(places), tuple(passages))


def test_ways_are_as_short_as_those_of_a_table_of_all_pairs():
    rng = np.random.default_rng(0)
    names = "abcdefghij"
    edges = {}
    for i in range(14):
        a, b = rng.choice(list(names), 2, replace=False)
        edges[f"p{i}"] = (str(a), str(b), float(rng.uniform(1.0, 9.0)))
    topology = made(edges)
    known = [place.name for place in topology.places]
    lengths = {(a, b): 0.0 if a == b else np.inf for a in known for b in known}
    for a, b, length_m in edges.values():
        lengths[a, b] = lengths[b, a] = min(lengths[a, b], length_m)
    for via, a, b in itertools.product(known, repeat=3):  # Floyd, Warshall
        lengths[a, b] = min(lengths[a, b], lengths[a, via] + lengths[via, b])
    for a, b in itertools.product(known, repeat=2):
        way = topology.way(a, b)
        if way is None:
            assert lengths[a, b] == np.inf
            continue
        assert sum(step.passage.length_m for step in way) == pytest.approx(lengths[a, b])
        ends = [a, *(step.place.name for step in way)]
        assert ends[-1] == b
        for (here, there), step in zip(itertools.pairwise(ends), way, strict=True):
            assert set(step.passage.between) == {here, there}


def test_passages_are_counted_to_the_left_from_where_one_came_in():
    # A hall with doors east, north, west and south, counter-clockwise.
    edges = {name: ("hall", f"room {name}", 5.0) for name in ("east", "north", "west", "south")}
    hall = made(edges, {"hall": ("east", "north", "west", "south")})
    # Who comes in from the south looks north: on the left is the west.
    for goal, left in (("west", 1), ("north", 2), ("east", 3)):
        first, second = hall.way("room south", f"room {goal}")
        assert first.left is None
        assert (second.left, second.of, second.place.name) == (left, 4, f"room {goal}")


def test_who_is_there_has_no_steps_to_go():
    assert made({"door": ("a", "b", 1.0)}).way("a", "a") == []


def test_another_name_holds_everywhere():
    renamed = made({"door": ("a", "b", 1.0)}).renamed("a", "kitchen")
    assert renamed.place("a") is None
    assert renamed.way("kitchen", "b")[0].passage.between == ("kitchen", "b")
    with pytest.raises(InvalidValue, match="must be unique, found 'b'"):
        renamed.renamed("kitchen", "b")


def test_a_place_that_lists_a_passage_elsewhere_is_refused():
    place = TopologicalPlace("a", "room", ("door",), 1.0, 1.0)
    other = TopologicalPlace("b", "room", (), 1.0, 1.0)
    with pytest.raises(InvalidValue, match=r"disagree on passage 'door' of 'b'"):
        TopologicalMap((place, other), (Passage("door", ("a", "b"), 1.0, 1.0),))
    with pytest.raises(InvalidValue, match="must be known, found 'door'"):
        TopologicalMap((place, other), ())
