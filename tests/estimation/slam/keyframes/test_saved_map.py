"""The map of a robot that lives in one building: it keeps its size, and finds the robot."""

import itertools

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.growing_map import GrowingMap
from robotctl.estimation.slam.keyframes.loops import LoopSearch
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.estimation.slam.keyframes.saved_map import ChangeLog, compacted, encoded, restored
from robotctl.model.geometry.se2 import SE2
from tests.estimation.slam.keyframes.test_mapper import OFFICE, ROUND
from tests.estimation.slam.lidar_world import along, box, drifting, scan_of

FULL_CIRCLE = np.radians(np.arange(-180.0, 180.0, 2.0))

pytestmark = pytest.mark.timeout(400)  # a cold cache: all of it is compiled


STAMPS = itertools.count(0, 200_000_000)


def scan(walls, pose, rng):
    return scan_of(walls, pose, rng, stamp_ns=next(STAMPS), angles=FULL_CIRCLE)


def feed(mapper, walls, poses, rng, odometry=None):
    """Drive on, with odometry of its own."""
    odometry = drifting(poses, rng) if odometry is None else odometry
    mapper.begin_odometry()
    for pose, wheels in zip(poses, odometry, strict=True):
        mapper.add(scan(walls, pose, rng), wheels)
        mapper.relocalise()
        mapper.relocalise()


def off_m(mapper, start, pose):
    """How far the mapper's pose is from the true one, where the map began at a start."""
    off = (start @ mapper.pose).inverse() @ pose
    return np.hypot(off.x_m, off.y_m)


ROUNDS = along(ROUND[:5], 0.2)
HOME = SE2(1.0, 1.0, 0.0)
TURN = [SE2(1.0, 1.0, angle) for angle in np.arange(-1.5, 0.0, 0.1)]


def records_of(mapper, log, frame=(1.0, 2.0, 0.5)):
    pose = mapper.place.pose
    place = (mapper.place.keyframe, (pose.x_m, pose.y_m, pose.theta_rad))
    return encoded(msgspec.structs.replace(log.changes(mapper), frame=frame, place=place))


@pytest.fixture(scope="module")
def driven():
    """A round, and the change records of each step."""
    mapper, log, records = SlamMapper(KeyframeConfig(is_live=True)), ChangeLog(), []
    rng = np.random.default_rng(1)
    poses = ROUNDS + TURN
    for pose, wheels in zip(poses, drifting(poses, rng), strict=True):
        mapper.add(scan(OFFICE, pose, rng), wheels)
        records.append(records_of(mapper, log))
    return mapper, records


def resumed(driven, **settings):
    _, records = driven
    mapper = SlamMapper(KeyframeConfig(is_live=True, **settings))
    mapper.resume(restored(records), is_there=True)
    return mapper


def test_a_loaded_map_has_loops_before_its_shapes_are_known(driven):
    mapper, _ = driven
    loops = LoopSearch(GrowingMap(mapper.config, mapper.keyframes, mapper.back_end))
    last = len(mapper.keyframes) - 1
    doubts = np.full((last + 1, 2), (0.4, 0.1))
    loops.enter(last, 0.0)
    loops.consider(last, np.arange(last - 20), doubts)
    loops.step()
    assert [each.found_by for each in loops.log] == ["position"]


def test_all_changes_make_the_map_again(driven):
    mapper, records = driven
    mapper.back_end.refine()
    for saved in (restored(records), restored(compacted(records))):
        again = SlamMapper(KeyframeConfig(is_live=True))
        again.resume(saved, is_there=True)
        assert len(again.keyframes) == len(mapper.keyframes)
        off = again.back_end.poses - mapper.back_end.poses
        assert np.abs(off[:, :2]).max() < 1e-3
        assert np.abs(np.sin(off[:, 2])).max() < 1e-3
        for old, new in zip(mapper.keyframes, again.keyframes, strict=True):
            np.testing.assert_allclose(new.scan.ranges_m, old.scan.ranges_m, atol=1e-5)
        for old, new in zip(mapper.back_end.links, again.back_end.links, strict=True):
            assert (old.first, old.second, old.pose) == (new.first, new.second, new.pose)
            np.testing.assert_allclose(new.information, old.information)


@settings(max_examples=8, deadline=None)
@given(share=st.floats(0.0, 1.0))
def test_a_drive_cut_anywhere_goes_on(driven, share):
    _, records = driven
    cut = 1 + int(share * (len(records) - 2))
    saved = restored(records[:cut])
    mapper = SlamMapper(KeyframeConfig(is_live=True))
    mapper.resume(saved, is_there=True)
    assert mapper.is_lost
    rest = (ROUNDS + TURN)[cut : cut + 12]
    feed(mapper, OFFICE, rest, np.random.default_rng(5))
    assert not mapper.is_lost
    assert mapper.relocaliser.found == 0
    assert off_m(mapper, HOME, rest[-1]) < 0.05


def test_the_map_keeps_its_size(driven):
    mapper = resumed(driven)
    before, links = len(mapper.keyframes), len(mapper.back_end.links)
    feed(mapper, OFFICE, ROUNDS + TURN, np.random.default_rng(6))
    assert (len(mapper.keyframes), len(mapper.back_end.links)) == (before, links)
    assert mapper.known_places.renewals == 0
    assert off_m(mapper, HOME, TURN[-1]) < 0.05


def test_what_was_moved_is_forgotten(driven):
    mapper = resumed(driven)
    moved = np.concatenate(
        [OFFICE[:12], box(7.0, 1.4, 0.8, 0.6), OFFICE[16:]]
    )  # it was at (9, 1.7)
    feed(mapper, moved, ROUNDS + TURN, np.random.default_rng(7))
    feed(mapper, moved, ROUNDS + TURN, np.random.default_rng(8))
    assert mapper.known_places.renewals > 0
    grid = OccupancyGrid()
    order = np.argsort([each.travelled_m for each in mapper.keyframes])
    world = [HOME @ mapper.back_end.pose(each) for each in order]
    poses = np.array([(each.x_m, each.y_m, each.theta_rad) for each in world])
    grid.update_scans(poses, [mapper.keyframes[each].scan for each in order])
    drawn = grid.to_map()
    (there,), (here,) = (drawn.cell_of(np.array([each])) for each in ((9.4, 1.85), (7.4, 1.41)))
    assert drawn.cells[*there] < 50
    assert drawn.cells[*here] > 50


def test_a_robot_that_was_carried_away_is_found_where_it_is(driven):
    mapper = resumed(driven)
    feed(mapper, OFFICE, ROUNDS[:10], np.random.default_rng(9))
    away = along([(3.5, 9.0), (8.5, 9.0)], 0.1)
    feed(mapper, OFFICE, away, np.random.default_rng(10))
    assert mapper.relocaliser.found == 1
    assert off_m(mapper, HOME, away[-1]) < 0.05


def test_a_robot_in_another_building_is_not_found(driven):
    mapper = resumed(driven)
    other = np.concatenate(
        [box(0.0, 0.0, 9.0, 7.0), box(3.0, 2.0, 1.0, 3.0), box(7.0, 4.0, 2.0, 1.0)]
    )
    feed(mapper, other, along([(1.0, 1.0), (8.0, 1.0), (8.0, 3.0)], 0.1), np.random.default_rng(11))
    assert mapper.is_lost
    assert mapper.relocaliser.found == 0


def test_a_map_that_is_fixed_stays_as_it_is(driven):
    mapper = resumed(driven, is_fixed=True)
    before, poses = list(mapper.keyframes), mapper.back_end.poses.copy()
    inside = [*ROUNDS[:20], *along([(4.9, 1.0), (4.9, 1.6)], 0.1)]
    feed(mapper, OFFICE, inside, np.random.default_rng(12))
    assert not mapper.is_lost
    assert all(old is new for old, new in zip(before, mapper.keyframes, strict=True))
    np.testing.assert_array_equal(mapper.back_end.poses, poses)
