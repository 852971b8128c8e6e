"""Loops by a camera: what images say counts where scans bear it out."""

import numpy as np
import pytest

from robotctl.estimation.places.visual.features import Features, features_message
from robotctl.estimation.places.visual.orb import features_of
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.estimation.slam.keyframes.motion import ScanPose
from robotctl.estimation.slam.keyframes.saved_map import (
    MOST_IMAGES,
    Change,
    encoded,
    joined_changes,
    restored,
    whole_map,
)
from robotctl.estimation.slam.keyframes.seen_places import SeenPlaces
from robotctl.estimation.slam_tuning import LoopClosureConfig, ShapeConfig, SlamTuning
from robotctl.maps.vocabulary_file import load_vocabulary, shipped_vocabulary
from robotctl.model.geometry.se2 import SE2
from tests.estimation.places.visual.drawn import drawn_wall
from tests.estimation.slam.lidar_world import along, box, scan_of

pytestmark = pytest.mark.timeout(400)  # a cold cache: all of it is compiled


def seen_at(pose, rng, is_alike):
    """Return the features of what a camera sees: each metre looks different, or all alike."""
    place = (round(pose.x_m), round(pose.y_m), round(2.0 * pose.theta_rad / np.pi) % 4)
    seed = 7 if is_alike else 1000 * (place[0] * 20 + place[1]) + place[2]
    view = drawn_wall(seed)[:300, :400] + rng.normal(0.0, 2.0, (300, 400))
    return features_of(np.clip(view, 0.0, 255.0).astype(np.uint8))


def features(rng, count=3):
    return Features(rng.random((count, 2)), rng.integers(0, 2**63, (count, 4), np.uint64), 0.75)


def test_images_are_known_again_by_those_who_go_on_with_the_map():
    walls = np.concatenate([box(0.0, 0.0, 20.0, 12.0), box(2.0, 2.0, 16.0, 8.0)])
    poses = along([(1.0, 1.0), (19.0, 1.0), (19.0, 8.0)])
    rng, vocabulary = np.random.default_rng(2), load_vocabulary(shipped_vocabulary())
    mapper, true = SlamMapper(), []

    def drive(seen):
        for pose in poses:
            stamp_ns = len(true) * 500_000_000
            true.append(pose)
            mapper.add(scan_of(walls, pose, rng, stamp_ns=stamp_ns), poses[0].inverse() @ pose)
            for keyframe, _ in seen.due([stamp_ns]):
                seen.see(keyframe, seen_at(pose, rng, is_alike=False))

    drive(SeenPlaces(vocabulary, mapper))
    record = whole_map(mapper, "lidar", SE2(), (mapper.place.keyframe, mapper.place.pose))
    before, mapper = mapper, SlamMapper()
    mapper.resume(restored([record]), is_there=True)
    assert list(mapper.images) == list(before.images)
    for one, other in zip(mapper.images.values(), before.images.values(), strict=True):
        assert np.array_equal(one.descriptors, other.descriptors)
        np.testing.assert_allclose(one.points, other.points, atol=1e-7)
    mapper.robot.relocate(ScanPose(0, 0, SE2()), SE2())
    seen = SeenPlaces(vocabulary, mapper)
    drive(seen)
    loaded = len(before.images)
    places = [true[mapper.keyframes[each].stamp_ns // 500_000_000] for each in seen.keyframes]
    known = [
        (place, places[each.found.place])
        for place, each in zip(places[loaded:], seen.recognitions, strict=True)
        if each.found is not None
    ]
    assert len(known) > 0.8 * len(seen.recognitions)
    assert max(np.hypot(a.x_m - b.x_m, a.y_m - b.y_m) for a, b in known) < 1.5
    # What is known already is not kept twice.
    assert len(mapper.images) - loaded == len(seen.recognitions) - len(known)


def test_the_last_images_are_kept():
    rng = np.random.default_rng(3)
    records = [
        encoded(Change(images={number: features_message(features(rng))}))
        for number in range(MOST_IMAGES + 7)
    ]
    assert list(joined_changes(records).images) == list(range(7, MOST_IMAGES + 7))


@pytest.mark.parametrize("is_alike", [False, True])
def test_a_place_that_is_known_again_by_its_image_closes_the_loop(is_alike):
    # Bare corridors tell no length to scans without odometry; nothing but images is looked for.
    things = [(1.0, 0.0, 0.5, 0.4), (3.0, 1.7, 0.4, 0.3), (0.0, 3.0, 0.3, 0.6),
              (5.0, 0.0, 0.3, 0.5), (1.7, 4.5, 0.3, 0.8)]  # fmt: skip
    walls = np.concatenate(
        [box(0.0, 0.0, 20.0, 12.0), box(2.0, 2.0, 16.0, 8.0), *(box(*each) for each in things)]
    )
    poses = along([(1.0, 1.0), (19.0, 1.0), (19.0, 11.0), (1.0, 11.0), (1.0, 1.0), (9.0, 1.0)])
    loops = LoopClosureConfig(drift=0.0, near_m=0.01, gate=0.01)
    tuning = SlamTuning(shapes=ShapeConfig(candidates=0), loops=loops)
    rng, mapper = np.random.default_rng(2), SlamMapper(KeyframeConfig(tuning=tuning))
    seen = SeenPlaces(load_vocabulary(shipped_vocabulary()), mapper)
    for number, pose in enumerate(poses):
        mapper.add(scan_of(walls, pose, rng, reach_m=6.0, stamp_ns=number * 500_000_000))
        for keyframe, _ in seen.due([number * 500_000_000]):
            seen.see(keyframe, seen_at(pose, rng, is_alike))
    mapper.finish()
    true = [poses[round(2e-9 * each.stamp_ns)] for each in mapper.keyframes]
    # Once more past the last of the things: the bare wall behind it is shorter on the map.
    old, new = (
        min(lap, key=lambda each: np.hypot(true[each].x_m - 4.0, true[each].y_m - 1.0))
        for lap in (range(30), range(len(true) - 30, len(true)))
    )
    expected, made = true[old].inverse() @ true[new], mapper.back_end.between(old, new)
    off_m = np.hypot(made.x_m - expected.x_m, made.y_m - expected.y_m)
    closed = [each.found_by for each in mapper.loops.log if not each.reason]
    if is_alike:
        assert "image" not in closed
        assert off_m > 2.0
    else:
        assert closed == ["image"]
        assert off_m < 0.05
