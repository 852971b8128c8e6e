"""A camera recognises where it has been, and refuses what it has not seen or cannot tell apart."""

import cv2
import numpy as np
import pytest

from robotctl.estimation.places.visual.orb import features_of
from robotctl.estimation.places.visual.recognition import VisualPlaces, sight_of
from robotctl.maps.vocabulary_file import load_vocabulary, shipped_vocabulary
from tests.estimation.places.visual.drawn import drawn_wall


@pytest.fixture(scope="module")
def vocabulary():
    return load_vocabulary(shipped_vocabulary())


def look(picture, dx=0, dy=0, zoom=1.0, seed=0):
    """Return a noisy view of 400 x 300 of a wall, moved and nearer."""
    M = np.array([[zoom, 0.0, -20.0 - dx], [0.0, zoom, -20.0 - dy]])
    view = cv2.warpAffine(picture, M, (400, 300)).astype(np.float64)
    view += np.random.default_rng(seed).normal(0.0, 2.0, view.shape)
    return features_of(np.clip(view, 0.0, 255.0).astype(np.uint8))


def driven(vocabulary, looks, **options):
    """Take images one by one; return the places and what each was recognised as."""
    places, found = VisualPlaces(vocabulary, **options), []
    for features in looks:
        sight = sight_of(vocabulary, features)
        found.append(places.suggest(sight, is_next=True))
        places.add(sight)
    return places, found


def test_a_second_lap_is_recognised_and_the_first_is_not(vocabulary):
    first = [look(drawn_wall(i)) for i in range(20)]
    second = [look(drawn_wall(i), 15, -10, 1.15, seed=i) for i in range(20)]
    _, found = driven(vocabulary, first + second, gap=5)
    assert all(each.found is None for each in found[:20])
    assert [each.found.place for each in found[20:]] == list(range(20))
    assert all(each.found.share > 0.2 for each in found[20:])


def test_where_two_places_look_the_same_neither_is_chosen(vocabulary):
    looks = [look(drawn_wall(i)) for i in range(10)] + [look(drawn_wall(3), 5, 5, seed=1)]
    looks += [look(drawn_wall(i)) for i in range(10, 20)]
    places = VisualPlaces(vocabulary, gap=0)
    for each in looks:
        places.add(sight_of(vocabulary, each))
    query = sight_of(vocabulary, look(drawn_wall(3), 3, -3, seed=2))
    assert places.suggest(query, is_next=True).refusal == "ambiguous"


def test_places_that_a_closure_joined_are_one(vocabulary):
    looks = [look(drawn_wall(i % 10), seed=i) for i in range(20)]
    places, found = driven(vocabulary, looks, gap=5)
    assert found[13].found.place == 3
    query = sight_of(vocabulary, look(drawn_wall(3), 3, -3, seed=2))
    assert places.suggest(query, is_next=False).found.place in {3, 13}


def test_a_weak_likeness_needs_the_images_before(vocabulary):
    def partly(i, seed):
        """Show a part of a wall, the rest is new."""
        picture = drawn_wall(1000 + i)
        picture[:, 220:] = drawn_wall(i)[:, 220:]
        return look(picture, 5, 0, seed=seed)

    first = [look(drawn_wall(i)) for i in range(12)]
    new = [look(drawn_wall(i)) for i in range(100, 110)]
    _, found = driven(vocabulary, first + new + [partly(i, i) for i in (4, 5, 6)], gap=5)
    assert found[22].refusal == "not confirmed by the images before"
    assert max(found[22].candidates, key=lambda each: each.share).place == 4
    assert found[23].found.place == 5
    assert found[24].found.place == 6


def test_a_blank_wall_is_no_place(vocabulary):
    blank = features_of(np.full((300, 400), 200, np.uint8))
    _, found = driven(vocabulary, [look(drawn_wall(0)), blank, blank], gap=0)
    blank = "only 0 features"
    assert [each.refusal for each in found] == ["nothing like it", blank, blank]


def test_a_camera_that_stands_does_not_recognise_itself(vocabulary):
    looks = [look(drawn_wall(i)) for i in range(3)] + [
        look(drawn_wall(3), seed=i) for i in range(30)
    ]
    _, found = driven(vocabulary, looks, gap=2)
    assert all(each.found is None for each in found)


def test_images_of_any_size_give_features_of_one_size():
    picture = cv2.GaussianBlur(drawn_wall(1), (0, 0), 1.0)
    large = cv2.resize(picture, None, fx=4.0, fy=4.0, interpolation=cv2.INTER_CUBIC)
    small, large = features_of(picture), features_of(large)
    assert large.points.max() < 1.0
    assert large.aspect == pytest.approx(small.aspect, abs=0.01)
    assert len(large) == pytest.approx(len(small), rel=0.1)
