"""A camera recognises where it has been, and refuses what it has not seen or cannot tell apart."""

import cv2
import numpy as np
import pytest

from robotctl.estimation.places.visual.orb import features_of
from robotctl.estimation.places.visual.recognition import VisualPlaces, sight_of
from robotctl.maps.vocabulary_file import load_vocabulary, shipped_vocabulary


@pytest.fixture(scope="module")
def vocabulary():
    return load_vocabulary(shipped_vocabulary())


def wall(seed):
    """Draw a wall with many things on it, larger than an image."""
    rng = np.random.default_rng(seed)
    picture = np.full((440, 560), 128, np.uint8)
    for _ in range(150):
        x, y = rng.integers(0, 560), rng.integers(0, 440)
        size = rng.integers(6, 50, 2)
        cv2.rectangle(picture, (x, y), (x + size[0], y + size[1]), int(rng.integers(0, 256)), -1)
    return picture


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
        found.append(places.recognise(sight, is_next=True))
        places.add(sight)
    return places, found


def test_a_second_lap_is_recognised_and_the_first_is_not(vocabulary):
    first = [look(wall(i)) for i in range(20)]
    second = [look(wall(i), 15, -10, 1.15, seed=i) for i in range(20)]
    _, found = driven(vocabulary, first + second, gap=5)
    assert all(each.found is None for each in found[:20])
    assert [each.found.image for each in found[20:]] == list(range(20))
    assert all(each.found.share > 0.2 for each in found[20:])


def test_where_two_places_look_the_same_neither_is_chosen(vocabulary):
    looks = [look(wall(i)) for i in range(10)] + [look(wall(3), 5, 5, seed=1)]
    looks += [look(wall(i)) for i in range(10, 20)]
    places = VisualPlaces(vocabulary, gap=0)
    for each in looks:
        places.add(sight_of(vocabulary, each))
    query = sight_of(vocabulary, look(wall(3), 3, -3, seed=2))
    assert places.recognise(query, is_next=True).refusal == "ambiguous"


def test_places_that_a_closure_joined_are_one(vocabulary):
    looks = [look(wall(i % 10), seed=i) for i in range(20)]
    places, found = driven(vocabulary, looks, gap=5)
    assert found[13].found.image == 3
    query = sight_of(vocabulary, look(wall(3), 3, -3, seed=2))
    assert places.recognise(query, is_next=False).found.image in {3, 13}


def test_a_weak_likeness_needs_the_images_before(vocabulary):
    def partly(i, seed):
        """Show a part of a wall, the rest is new."""
        picture = wall(1000 + i)
        picture[:, 220:] = wall(i)[:, 220:]
        return look(picture, 5, 0, seed=seed)

    first = [look(wall(i)) for i in range(12)]
    new = [look(wall(i)) for i in range(100, 110)]
    _, found = driven(vocabulary, first + new + [partly(i, i) for i in (4, 5, 6)], gap=5)
    assert found[22].refusal == "not confirmed by the images before"
    assert max(found[22].candidates, key=lambda each: each.share).image == 4
    assert found[23].found.image == 5
    assert found[24].found.image == 6


def test_a_blank_wall_is_no_place(vocabulary):
    blank = features_of(np.full((300, 400), 200, np.uint8))
    _, found = driven(vocabulary, [look(wall(0)), blank, blank], gap=0)
    blank = "only 0 features"
    assert [each.refusal for each in found] == ["nothing like it", blank, blank]


def test_a_camera_that_stands_does_not_recognise_itself(vocabulary):
    looks = [look(wall(i)) for i in range(3)] + [look(wall(3), seed=i) for i in range(30)]
    _, found = driven(vocabulary, looks, gap=2)
    assert all(each.found is None for each in found)


def test_images_of_any_size_give_features_of_one_size():
    picture = cv2.GaussianBlur(wall(1), (0, 0), 1.0)
    large = cv2.resize(picture, None, fx=4.0, fy=4.0, interpolation=cv2.INTER_CUBIC)
    small, large = features_of(picture), features_of(large)
    assert large.points.max() < 1.0
    assert large.aspect == pytest.approx(small.aspect, abs=0.01)
    assert len(large) == pytest.approx(len(small), rel=0.1)
