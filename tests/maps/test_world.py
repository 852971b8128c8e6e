"""The walls of a world, as robotctl and as the simulator read them; what is said of wrong ones."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.errors import SimulationError
from firmware_sim.world.world import load_world
from robotctl.config.robot_file import config_directory
from robotctl.errors import ConfigError
from robotctl.maps.world import load_walls

WORLDS = sorted((config_directory() / "worlds").glob("*.toml"))
HEAD = '[world]\nname = "w"\nstart = { x_m = 0.0, y_m = 0.0 }\n'
WALL = "[[wall]]\npoints = [[0, 0], [1, 0.5]]\n"


@pytest.mark.parametrize("path", WORLDS, ids=lambda path: path.stem)
def test_the_shipped_worlds_have_the_walls_of_the_simulator(path: Path) -> None:
    np.testing.assert_array_equal(load_walls(path).segments, load_world(path).segments)


places = st.tuples(st.floats(-400.0, 400.0), st.floats(-400.0, 400.0))
lengths = st.floats(0.01, 20.0)
headings = st.one_of(st.floats(-720.0, 720.0), st.sampled_from([0.0, 90.0, -90.0, 180.0, 450.0]))
colours = st.sampled_from(["#000000", "#C03020"])


def table(
    name: str, needed: dict[str, st.SearchStrategy[Any]], **rest: st.SearchStrategy[Any]
) -> st.SearchStrategy[str]:
    """Draw a table of a world's file, as TOML; keys of `rest` may be missing."""
    common = {"name": st.sampled_from(["a", "it's"]), "height_m": lengths, "colour": colours}
    optional = {key: each for key, each in (common | rest).items() if key not in needed}
    return st.fixed_dictionaries(needed, optional=optional).map(
        lambda found: "\n".join(
            [f"[[{name}]]", *(f"{key} = {json.dumps(value)}" for key, value in found.items())]
        )
    )


@st.composite
def polylines(draw: st.DrawFn) -> list[tuple[float, float]]:
    """Draw points none of which lies at the one before, nor the last at the first."""
    xs = draw(st.lists(st.integers(-4000, 4000), min_size=2, max_size=6, unique=True))
    return [(x / 10.0, draw(st.floats(-400.0, 400.0))) for x in xs]


flags = st.booleans()
sizes = st.tuples(lengths, lengths)
KINDS = [
    table("wall", {"points": polylines()}, closed=flags, thickness_m=st.just(0.0) | lengths),
    table("box", {"centre": places, "size": sizes}, heading_deg=headings, kind=st.just("box")),
    table(
        "furniture",
        {"kind": st.just("box"), "centre": places, "size": sizes},
        heading_deg=headings,
    ),
    table(
        "furniture",
        {"kind": st.just("pillar"), "centre": places, "radius_m": lengths},
        sides=st.integers(6, 128),
    ),
    table("obstacle", {"centre": places, "height_m": lengths, "radius_m": lengths}),
    table("obstacle", {"centre": places, "height_m": lengths, "size": sizes}, heading_deg=headings),
    st.just("[[lamp]]\nat = [1, 2, 3]\npower = 2"),
    st.just("[[board]]\nat = [1, 2]\ncorners = [7, 5]"),
]
FLOORS = ("", 'floor = { texture = "wood", seed = 3 }\n')


@given(st.lists(st.one_of(KINDS), max_size=8), st.sampled_from(FLOORS))
def test_any_world_has_the_walls_of_the_simulator(
    tmp_path_factory: pytest.TempPathFactory, things: list[str], floor: str
) -> None:
    path = tmp_path_factory.mktemp("any") / "w.toml"
    path.write_text("\n".join([floor, HEAD, WALL, *things]))
    np.testing.assert_allclose(
        load_walls(path).segments, load_world(path).segments, rtol=0.0, atol=1e-9
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[[wall]]\npoints = [[0, 0]]", "7: wall[0].points: must be two at least, found 1"),
        ("[[wall]]\npoints = [[0, 0], [0, 0]]", "6: wall[0]: two points coincide"),
        ("[[wall]]\npoints = [[0, 0], [1, 0], [0, 0]]\nclosed = true", "6: wall[0]: two points"),
        ("[[wall]]\npoints = [[0, 0], [0, 501]]", "6: wall[0]: has a coordinate of 501 m; "),
        ("[[wall]]\npoints = [[0, 0], [nan, 1]]", "6: wall[0]: has a coordinate of nan m; "),
        ("[[wall]]\npoints = [[0, 0], [1, 0]]\nthicknes_m = 1",
         '8: wall[0].thicknes_m: unknown key; did you mean "thickness_m"?'),
        ("[[wall]]\npoints = [[0, 0], [1, 0]]\nthickness_m = -1", "8: wall[0].thickness_m: must"),
        ("[[box]]\ncentre = [0, 0]\nsize = [1, 0]", "8: box[0].size: must be two lengths above 0"),
        ("[[box]]\ncentre = [0, 0]\nsize = [1, 1]\nheading_deg = inf", "9: box[0].heading_deg: "),
        ("[[furniture]]\nkind = \"pillar\"\ncentre = [0, 0]\nradius_m = 0", "9: furniture[0].ra"),
        ("[[furniture]]\nkind = \"pillar\"\ncentre = [0, 0]\nradius_m = 1\nsides = 5",
         "10: furniture[0].sides: must be 6 to 128, found 5"),
        ("[[furniture]]\nkind = \"table\"", "7: furniture[0].kind: must be one of 'box'"),
        ("[[furniture]]\ncentre = [0, 0]", "6: furniture[0].kind: missing key"),
        ("[[pillar]]\ncentre = [0, 0]", "6: pillar: unknown key"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_world_is_said_and_the_simulator_refuses_it_too(
    tmp_path: Path, text: str, said: str
) -> None:
    path = tmp_path / "w.toml"
    path.write_text(f"{HEAD}\n\n{text}\n{WALL}")
    with pytest.raises(ConfigError) as error:
        load_walls(path)
    assert f"{path}:{said}" in str(error.value)
    with pytest.raises(SimulationError):
        load_world(path)


def test_a_world_without_a_wall_is_refused(tmp_path: Path) -> None:
    (tmp_path / "w.toml").write_text(HEAD)
    with pytest.raises(ConfigError, match=r"w\.toml: no walls found; a robot needs at least one"):
        load_walls(tmp_path / "w.toml")
