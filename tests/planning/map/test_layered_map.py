"""The live map: what is marked, cleared and forgotten, and how far cells are from it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.map.config import MapConfig
from robotctl.planning.map.layered_map import LayeredMap
from robotctl.planning.map.planning_map import PlanningMap, clearance_of
from robotctl.planning.map.zone import Zone
from robotctl.planning.map.zones import Closed
from tests.model.polygon_bodies import bodies
from tests.planning.map.rays import box, echo, scan

BODY = Footprint(((0.2, -0.18), (0.2, 0.18), (-0.2, 0.18), (-0.2, -0.18)))
SIDE_M = 0.05
ROOM = box(0.0, 0.0, 4.0, 3.0)
HERE = SE2(1.0, 1.5, 0.3)
TENTH_NS = 100_000_000
SONARS = [SonarMount("front", 0.18, 0.0, 0.0)]


def room_map():
    """Return the map of the room, its walls one cell thick."""
    cells = np.zeros((60, 80), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    return GridMap(cells, SIDE_M)


def open_map():
    return LayeredMap.without_map((-1.0, -1.0), (5.0, 4.0), SIDE_M, BODY)


def is_blocked(live, x, y):
    space = live.space()
    row, column = space.grid.cell_of(np.array([[x, y]]))[0]
    return bool(space.blocked[row, column])


def count_marked(live, low, high):
    points = live.marked_world()
    return int(np.all((points >= low) & (points <= high), axis=1).sum())


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_clearance_is_that_of_the_whole_map_after_any_marks_and_clears(seed, through_unknown):
    rng = np.random.default_rng(seed)
    values = rng.choice([0, 100, -1], (70, 90), p=[0.9, 0.005, 0.095]).astype(np.int8)
    grid = GridMap(values, 0.1, SE2(*rng.uniform(-3, 3, 3).tolist()))
    live = LayeredMap(grid, BODY, MapConfig(1.0), through_unknown=through_unknown)
    here = grid.origin @ SE2(4.5, 3.5, 0.0)
    now_ns = 0
    for _ in range(11):
        pose = here @ SE2(*rng.uniform((-5.0, -4.0, -3.0), (5.0, 4.0, 3.0)).tolist())
        now_ns += int(rng.integers(1, 6)) * TENTH_NS
        angles = np.sort(rng.uniform(-3, 3, 40))
        away = rng.choice([rng.uniform(0.1, 6.0), np.inf, np.nan], 40, p=[0.8, 0.15, 0.05])
        moving = np.column_stack([rng.uniform(-3, 3, (2, 4)), [0.3, 0.5]])
        live.see_scan(pose, RangeScan(0, angles, away, 5.0, 0.1, 0.0), now_ns, moving)
        live.see_echoes(pose, SONARS, [rng.choice([0.3, 0.7, 1.4, np.inf])], now_ns)
        live.see_floor(pose, rng.uniform(-1.5, 1.5, (5, 2)).tolist(), now_ns)
        if rng.random() < 0.1:
            live.forget()
        poses = np.column_stack([rng.uniform(-5, 5, (20, 2)), rng.uniform(-3, 3, 20)])
        poses[:, :2] += here.x_m, here.y_m
        hits = live.collides(poses)
        part = live.space_around(pose, rng.uniform(0.2, 3.0))
        whole = live.space()
        at = [whole.to_cells(SE2(*each)) for each in poses.tolist()]
        at_cells = np.array([(each.x_m, each.y_m, each.theta_rad) for each in at])
        assert np.array_equal(hits, whole.collides(at_cells))
        exact = clearance_of(whole.blocked)
        bound = 13.0  # 1 m beyond the circle round the body, and half a cell
        cut = np.minimum(whole.clearance, bound) - np.minimum(exact, bound)
        assert np.abs(cut).max() < 1e-5
        assert np.all(whole.clearance <= exact + 1e-5)
        row, column = whole.grid.cell_of(part.grid.centre_of(np.zeros((1, 2), np.int64)))[0]
        inside = slice(row, row + part.shape[0]), slice(column, column + part.shape[1])
        for name in ("blocked", "obstacle", "clearance"):
            assert np.array_equal(getattr(part, name), getattr(whole, name)[inside])
        unknown = whole.grid.cells < 0
        occupied = whole.grid.cells >= 50
        assert np.array_equal(whole.obstacle, occupied)
        assert np.array_equal(whole.blocked, occupied | (unknown & (not through_unknown)))


def test_a_box_is_marked_as_long_as_it_stands_there():
    live = LayeredMap(room_map(), BODY)
    thing = box(2.0, 1.4, 2.3, 1.7)
    live.see_scan(HERE, scan(HERE, [*ROOM, *thing]), TENTH_NS)
    assert is_blocked(live, 2.01, 1.55)
    assert count_marked(live, (0, 0), (4, 3)) == count_marked(live, (1.9, 1.3), (2.4, 1.8)) > 4
    for i in range(2, 5):
        live.see_scan(HERE, scan(HERE, ROOM), i * TENTH_NS)
    assert count_marked(live, (0, 0), (4, 3)) == 0
    assert live.space().clearance == pytest.approx(LayeredMap(room_map(), BODY).space().clearance)


def test_a_box_that_cannot_be_seen_any_more_is_forgotten_after_a_while():
    live = LayeredMap(room_map(), BODY, MapConfig(decay_s=5.0))
    live.see_scan(HERE, scan(HERE, [*ROOM, *box(2.5, 1.4, 2.7, 1.7)]), 0)
    hiding = [*ROOM, *box(1.5, 0.5, 1.6, 2.9)]
    for i in range(1, 51):
        live.see_scan(HERE, scan(HERE, hiding), i * TENTH_NS)
        assert is_blocked(live, 2.51, 1.55)
    live.see_scan(HERE, scan(HERE, hiding), 51 * TENTH_NS)
    assert not is_blocked(live, 2.51, 1.55)
    assert is_blocked(live, 1.51, 1.55)


@pytest.mark.parametrize("error", [SE2(0.05, -0.04, 0.0), SE2(0.0, 0.0, 0.02)])
def test_walls_of_the_map_are_not_marked_again_if_the_pose_errs_a_little(error):
    live = LayeredMap(room_map(), BODY)
    live.see_scan(HERE @ error, scan(HERE, ROOM), TENTH_NS)
    assert count_marked(live, (-1, -1), (5, 4)) == 0


def test_what_the_map_holds_stays_though_beams_pass():
    live = LayeredMap(room_map(), BODY)
    before = live.space().clearance
    for i in range(1, 10):
        live.see_scan(HERE, scan(HERE, box(-3, -3, 7, 7)), i * TENTH_NS)
    assert np.array_equal(live.space().clearance, before)


def test_a_person_who_walks_leaves_no_trail():
    marked = {}
    for knows in (True, False):
        live = LayeredMap(room_map(), BODY)
        for i in range(20):
            person = (2.5, 0.5 + 0.1 * i, 0.25)
            moving = np.array([[2.5, 0.5 + 0.1 * i, 0.0, 1.0, 0.25]]) if knows else np.empty((0, 5))
            live.see_scan(HERE, scan(HERE, ROOM, [person]), i * TENTH_NS, moving)
        marked[knows] = live.marked_world()
    assert len(marked[True]) == 0
    away = np.hypot(*(marked[False] - (2.5, 2.4)).T)
    assert len(away) > 0
    assert away.max() < 0.65  # three scans of walking: what was marked behind is cleared


def test_a_track_that_begins_to_move_takes_its_marks_with_it():
    live = LayeredMap(room_map(), BODY)
    person = [(2.5, 1.5, 0.25)]
    live.see_scan(HERE, scan(HERE, ROOM, person), TENTH_NS)
    assert count_marked(live, (2, 1), (3, 2)) > 3
    moving = np.array([[2.5, 1.5, 0.5, 0.0, 0.25]])
    live.see_scan(HERE, scan(HERE, ROOM, person), 2 * TENTH_NS, moving)
    assert count_marked(live, (2, 1), (3, 2)) == 0


def test_between_two_echoes_that_the_robot_does_not_fit_between_there_is_no_way():
    for apart, closed in ((0.3, True), (0.4, False)):
        live = open_map()
        angles = np.array([-0.5, 0.5]) * apart / 2.0
        seen = RangeScan(0, angles, np.array([2.0, 2.0]), 10.0)
        live.see_scan(SE2(1.0, 1.0, 0.0), seen, TENTH_NS)
        assert is_blocked(live, 3.0 - 1e-3, 1.0 + 0.5 * apart - 0.01)
        assert is_blocked(live, 2.99, 1.0) is closed


def test_a_glancing_beam_does_not_open_a_wall():
    """Beams to the far end of a wall pass through its cells, where others have just hit it."""
    live = open_map()
    wall = [(0.0, 0.02, 4.5, 0.02)]
    for i in range(1, 30):
        pose = SE2(0.05 * i, 0.4, 0.0)
        live.see_scan(pose, scan(pose, wall, beams=720), i * TENTH_NS)
        space = live.space()
        row, first = space.grid.cell_of(np.array([[pose.x_m - 0.2, 0.02]]))[0]
        last = space.grid.cell_of(np.array([[pose.x_m + 2.0, 0.02]]))[0][1]
        assert space.blocked[row, max(first, 20) : last].all()


def test_an_echo_from_a_post_does_not_close_the_door():
    """A robot with sonars alone, and without a map, drives up to a door of 0.9 m and through it."""
    walls = [*box(-1, -1, 5, 4), (2.5, -1.0, 2.5, 1.05), (2.5, 1.95, 2.5, 4.0)]
    ring = [
        SonarMount(str(deg), 0.15 * math.cos(math.radians(deg)), 0.15 * math.sin(math.radians(deg)),
                   deg) for deg in range(-90, 91, 45)
    ]  # fmt: skip
    live = LayeredMap.without_map((-1.2, -1.2), (5.2, 4.2), SIDE_M, BODY)
    for i in range(100):
        pose = SE2(0.6 + 0.02 * i, 1.5, 0.0)
        live.see_echoes(pose, ring, [echo(pose, each, walls) for each in ring], i * TENTH_NS)
        space = live.space()
        ahead = [space.to_cells(SE2(x, 1.5, 0.0)) for x in np.arange(pose.x_m, 3.0, 0.05)]
        poses = np.array([(each.x_m, each.y_m, 0.0) for each in ahead])
        assert not space.collides(poses).any()
    assert is_blocked(live, 2.5, 0.98)  # both posts are on it
    assert is_blocked(live, 2.5, 2.02)


def test_two_echoes_that_agree_mark_an_obstacle_and_free_cones_clear_it():
    live = open_map()
    pose = SE2(1.0, 1.5, 0.0)
    live.see_echoes(pose, SONARS, [0.6], TENTH_NS)
    assert not is_blocked(live, 1.78, 1.5)  # one may be an outlier
    live.see_echoes(pose, SONARS, [math.nan], 2 * TENTH_NS)
    live.see_echoes(pose, SONARS, [0.6], 3 * TENTH_NS)
    assert is_blocked(live, 1.78, 1.5)
    for i in range(4, 8):
        live.see_echoes(pose, SONARS, [2.0], i * TENTH_NS)
    assert not is_blocked(live, 1.78, 1.5)
    assert not is_blocked(live, 3.18, 1.5)  # where that arc is wide, it marks nothing


def test_an_echo_of_what_moves_marks_nothing_and_clears_what_is_before_it():
    live = open_map()
    pose = SE2(1.0, 1.5, 0.0)
    for i in range(4):
        live.see_echoes(pose, SONARS, [0.6], i * TENTH_NS, [True])
    assert not is_blocked(live, 1.78, 1.5)
    for i in range(4, 6):
        live.see_echoes(pose, SONARS, [0.6], i * TENTH_NS, [False])
    assert is_blocked(live, 1.78, 1.5)
    for i in range(6, 10):
        live.see_echoes(pose, SONARS, [0.9], i * TENTH_NS, [True])
    assert not is_blocked(live, 1.78, 1.5)
    assert not is_blocked(live, 2.08, 1.5)


def test_an_echo_from_a_wall_of_the_map_marks_nothing():
    live = LayeredMap(room_map(), BODY)
    pose = SE2(3.3, 1.5, 0.0)
    for i in range(3):
        live.see_echoes(pose, SONARS, [0.52], i * TENTH_NS)
    assert count_marked(live, (-1, -1), (5, 4)) == 0


def test_what_the_camera_remembers_stays_though_the_lidar_looks_over_it():
    live = LayeredMap(room_map(), BODY)
    pose = SE2(1.0, 1.5, 0.0)
    for i in range(1, 8):
        live.see_floor(pose, [(0.5, 0.0), (0.5, 0.06)], i * TENTH_NS)
        live.see_scan(pose, scan(pose, ROOM), i * TENTH_NS)
        assert count_marked(live, (-1, -1), (5, 4)) == 2
    live.see_floor(pose, [(0.5, 0.06)], 8 * TENTH_NS)
    assert live.marked_world() == pytest.approx(np.array([[1.525, 1.575]]))


def test_after_a_jump_of_the_pose_only_the_map_is_left():
    live = LayeredMap(room_map(), BODY)
    before = live.space()
    for i in range(3):
        live.see_scan(HERE, scan(HERE, [*ROOM, *box(2, 1, 3, 2)]), i * TENTH_NS)
        live.see_floor(HERE, [(0.4, 0.0)], i * TENTH_NS)
    live.forget()
    assert len(live.marked_world()) == 0
    after = live.space()
    assert np.array_equal(after.clearance, before.clearance)
    assert np.array_equal(after.grid.cells, before.grid.cells)


def test_where_nothing_is_known_the_robot_may_pass_until_it_sees_more():
    live = open_map()
    assert not live.space().blocked.any()
    assert live.space().shape == (100, 120)
    assert live.space().to_cells(SE2(-1.0, -1.0, 0.0)) == SE2(0.0, 0.0, 0.0)


def test_without_a_map_zones_count_as_well():
    live = LayeredMap.without_map((-1.0, -1.0), (5.0, 4.0), SIDE_M, BODY, Closed(ZONES), 0.5)
    assert is_blocked(live, 1.5, 1.5)
    assert live.speed_limits_at(np.array([(2.7, 1.5)])) == pytest.approx([0.2])
    assert live.collides(np.empty((0, 3))).shape == (0,)


def test_a_beam_makes_known_what_the_map_does_not_know():
    cells = room_map().cells
    cells[20:40, 40:60] = -1
    live = LayeredMap(GridMap(cells, SIDE_M), BODY)
    assert is_blocked(live, 2.5, 1.5)
    live.see_scan(HERE, scan(HERE, [*ROOM, *box(2.8, 1.0, 2.9, 2.0)]), TENTH_NS)
    assert not is_blocked(live, 2.5, 1.5)
    assert is_blocked(live, 2.81, 1.5)
    assert is_blocked(live, 2.97, 1.5)  # behind the box


ZONES = [
    Zone("stairs", ((1.0, 1.0), (2.0, 1.0), (1.5, 2.0))),
    Zone("kitchen", ((2.5, 0.5), (3.5, 0.5), (3.5, 2.5), (2.5, 2.5)), 0.2),
    Zone("corner", ((3.0, 1.0), (3.9, 1.0), (3.9, 2.9), (3.0, 2.9)), 0.1),
]


def test_zones_block_and_limit_the_speed():
    live = LayeredMap(room_map(), BODY, closed=Closed(ZONES), full_speed_m_s=0.5)
    assert is_blocked(live, 1.5, 1.5)
    for i in range(1, 5):
        live.see_scan(HERE, scan(HERE, ROOM), i * TENTH_NS)
    live.forget()
    assert is_blocked(live, 1.5, 1.5)
    assert not is_blocked(live, 1.1, 1.5)
    places = np.array([(x, 1.5) for x in (1.5, 2.7, 3.2, 3.7, 30.0)])
    limits = pytest.approx([math.inf, 0.2, 0.1, 0.1, math.inf])
    assert live.speed_limits_at(places) == limits
    part = live.space_around(SE2(2.6, 1.5, 0.0), 0.3)
    assert sorted(set(part.slowness.ravel().tolist())) == pytest.approx([1.0, 2.5])
    assert np.isinf(LayeredMap(room_map(), BODY).speed_limits_at(places)).all()


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("corners", {"corners": ((0.0, 0.0), (1.0, 0.0))}),
        ("corners", {"corners": ((0.0, 0.0), (1.0, math.nan), (1.0, 1.0))}),
        ("speed_m_s", {"speed_m_s": -0.1}),
        ("speed_m_s", {"speed_m_s": math.nan}),
    ],
)
def test_a_zone_that_makes_no_sense_is_refused_by_name(key, change):
    given_ = {"name": "a", "corners": ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)), **change}
    with pytest.raises(ValueError, match=key):
        Zone(**given_)


@pytest.mark.parametrize("change", [{"decay_s": 0.0}, {"sonar_beam_deg": math.nan}])
def test_settings_out_of_range_are_refused_by_name(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        MapConfig(**change)


def test_the_floor_is_known_where_the_robot_stands_and_where_a_sensor_has_looked():
    live = open_map()
    behind, ahead = (np.array([[HERE.x_m + x, HERE.y_m, 0.0]]) for x in (-0.5, 0.5))
    assert not live.is_known(np.array([[HERE.x_m, HERE.y_m, HERE.theta_rad]]))
    live.stand_at(HERE)
    assert live.is_known(np.array([[HERE.x_m, HERE.y_m, HERE.theta_rad]]))
    assert not live.is_known(ahead)
    seen = scan(HERE, ROOM, beams=720)
    front = np.abs(seen.angles_rad) < 2.0
    live.see_scan(
        HERE, RangeScan(0, seen.angles_rad[front], seen.ranges_m[front], seen.max_range_m), 0
    )
    assert live.is_known(ahead)
    assert not live.is_known(behind)
    assert not live.is_known(np.array([[-50.0, 0.0, 0.0]]))


def test_what_is_not_seen_now_can_be_forgotten_and_the_floor_stays_known():
    live, wall = open_map(), [(2.0, 0.5, 2.0, 2.5)]
    for now_ns in range(0, 3 * TENTH_NS, TENTH_NS):
        live.see_scan(HERE, scan(HERE, wall, beams=720), now_ns)
    assert is_blocked(live, 2.02, 1.5)
    live.forget_unseen(2 * TENTH_NS)
    assert is_blocked(live, 2.02, 1.5)
    live.forget_unseen(3 * TENTH_NS)
    assert not is_blocked(live, 2.02, 1.5)
    assert live.is_known(np.array([[1.5, 1.6, 0.0]]))


def test_an_echo_is_of_what_stands_once_it_has_come_from_one_place_for_a_second():
    live, pose = open_map(), SE2(1.0, 1.5, 0.0)
    for i in range(1, 20):
        stands = live.see_echoes(pose, SONARS, [0.5], i * TENTH_NS)
        assert stands == [i > 10]
    assert live.see_echoes(pose, SONARS, [0.3], 20 * TENTH_NS) == [False]
    assert live.see_echoes(SE2(1.1, 1.5, 0.0), SONARS, [0.4], 21 * TENTH_NS) == [True]
    assert live.see_echoes(pose, SONARS, [2.0], 22 * TENTH_NS) == [True]


def test_a_wall_of_the_map_stands_from_the_first_echo_on():
    live = LayeredMap(room_map(), BODY)
    assert live.see_echoes(SE2(3.3, 1.5, 0.0), SONARS, [0.52], TENTH_NS) == [True]
    assert live.see_echoes(SE2(3.3, 1.5, 0.0), SONARS, [0.3], 2 * TENTH_NS) == [False]


def test_echoes_from_the_robots_own_edge_leave_no_marks_below_it():
    """Somebody touches it: the arc of a sonar that sits inside of the outline is inside, too."""
    live, pose = open_map(), SE2(1.0, 1.5, 0.3)
    sonars = [SonarMount("inside", -0.1, 0.0, 0.0), SonarMount("front", 0.2, 0.0, 0.0)]
    for i in range(1, 4):
        live.see_echoes(pose, sonars, [0.2, 0.15], i * TENTH_NS)
    places = [pose.apply(x_m, 0.0) for x_m in (0.08, 0.1, 0.12)]
    assert any(is_blocked(live, *place) for place in places)
    live.stand_at(pose)
    assert not any(is_blocked(live, *place) for place in places)
    assert is_blocked(live, *pose.apply(0.35, 0.0))


def test_a_stray_beam_makes_nothing_known_behind_a_wall_and_beams_where_it_was_do():
    live = open_map()
    for i in range(1, 20):
        seen = scan(HERE, ROOM)
        seen.ranges_m[i] = 5.0
        live.see_scan(HERE, seen, i * TENTH_NS)
    cells = live.space().grid.cells
    known = live.space().grid.centre_of(np.argwhere(cells >= 0))
    assert known.min() > -0.1
    assert np.all(known < (4.1, 3.1))
    for i in range(20, 26):
        live.see_scan(HERE, scan(HERE, box(-0.9, 0.0, 4.0, 3.0)), i * TENTH_NS)
    assert live.is_known(np.array([[-0.5, 1.5, 0.0]]))


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_a_map_that_grew_says_what_one_that_was_large_from_the_start_says(seed):
    rng = np.random.default_rng(seed)
    corners = (-5.3, -4.0), (9.0, 7.25)
    large = LayeredMap.without_map(*corners, SIDE_M, BODY, Closed(ZONES), 0.5)
    grown = LayeredMap.without_map((-1.0, -1.0), (5.0, 4.0), SIDE_M, BODY, Closed(ZONES), 0.5)
    for i in range(8):
        if i == 4:
            grown = grown.grown(np.array(corners))
        pose = HERE @ SE2(*rng.uniform(-0.5, 0.5, 3).tolist())
        # All of it on the small map, until that has grown.
        ranges_m = rng.uniform(0.1, 1.2 if i < 4 else 5.0, 40)
        angles = np.sort(rng.uniform(-3, 3, 40))
        seen = RangeScan(0, angles, ranges_m, 6.0)
        for live in (large, grown):
            live.see_scan(pose, seen, i * TENTH_NS)
            live.see_echoes(pose, SONARS, [ranges_m[0]], i * TENTH_NS)
    a, b = large.space(), grown.space()
    for name in ("blocked", "obstacle"):
        assert np.array_equal(getattr(a, name), getattr(b, name))
    assert np.array_equal(a.grid.cells, b.grid.cells)
    assert a.grid.origin == b.grid.origin
    assert np.allclose(np.minimum(a.clearance, 13.0), np.minimum(b.clearance, 13.0))
    assert np.array_equal(large.marked_world(), grown.marked_world())


@pytest.mark.parametrize("side_m", [SIDE_M, 0.1])
def test_what_a_map_made_by_the_robot_knows_counts_until_the_lidar_sees_otherwise(side_m):
    cells = np.full((round(5.0 / side_m), round(6.0 / side_m)), -1, np.int8)
    drawn = GridMap(cells, side_m, SE2(-1.0, -1.0, 0.0))
    places = drawn.centre_of(np.argwhere(cells < 0)).reshape(*cells.shape, 2)
    outside = np.abs(places - (2.0, 1.5)) - (2.0, 1.5)
    cells[outside.max(axis=2) < 0.0] = 3
    cells[np.abs(outside.max(axis=2)) < 0.6 * side_m] = 97
    live = open_map()
    live.recall(GridMap(cells, side_m, drawn.origin), TENTH_NS)
    assert live.is_known(np.array([[2.0, 1.5, 0.0], [0.5, 2.5, 1.0]]))
    assert not live.is_known(np.array([[-0.7, 1.5, 0.0]]))
    assert all(is_blocked(live, x, 1.5) for x in (0.0, 4.0))
    assert not is_blocked(live, 2.0, 1.5)
    exact = clearance_of(live.space().blocked)
    assert np.allclose(np.minimum(live.space().clearance, 13.0), np.minimum(exact, 13.0))
    for i in range(2, 6):
        live.see_scan(HERE, scan(HERE, box(-0.9, 0.0, 4.0, 3.0)), i * TENTH_NS)
    assert not is_blocked(live, 0.0, 1.5)
    assert is_blocked(live, 4.0, 1.5)


def test_what_stands_in_the_hollow_beside_an_arm_stays_marked():
    arm = Footprint(((0.4, -0.9), (0.4, 0.3), (-0.4, 0.3), (-0.4, -0.3), (0.2, -0.3), (0.2, -0.9)))
    live = LayeredMap(room_map(), arm)
    post = np.vstack([ROOM, box(0.9, 0.9, 1.0, 1.0)])
    for i in range(1, 6):
        live.see_scan(SE2(1.2, 1.6, 0.0), scan(SE2(1.2, 1.6, 0.0), post), i * TENTH_NS)
        live.stand_at(SE2(1.2, 1.6, 0.0))
    assert count_marked(live, (0.85, 0.85), (1.05, 1.05)) > 0
    assert not live.collides(np.array([[1.2, 1.6, 0.0]])).any()


@settings(max_examples=20)
@given(bodies(), st.integers(0, 2**32 - 1), st.booleans())
def test_with_another_body_all_that_was_seen_is_known_and_asked_for_that_body(other, seed, mapped):
    rng = np.random.default_rng(seed)

    def begun(body):
        if mapped:
            return LayeredMap(room_map(), body)
        return LayeredMap.without_map((-1.0, -1.0), (5.0, 4.0), SIDE_M, body)

    old = begun(BODY)
    things = [*ROOM, *box(*rng.uniform((1.6, 0.3, 2.2, 1.0), (2.0, 0.8, 3.5, 2.5)).tolist())]
    for i in range(1, 5):
        pose = HERE @ SE2(*rng.uniform(-0.3, 0.3, 3).tolist())
        old.see_scan(pose, scan(pose, things), i * TENTH_NS)
        old.see_floor(pose, [(0.6, 0.1)], i * TENTH_NS)
    changed = old.with_body(other)
    before, after = old.space(), changed.space()
    assert np.array_equal(changed.marked(), old.marked())
    assert np.array_equal(after.grid.cells, before.grid.cells)
    assert np.array_equal(after.blocked, before.blocked)
    poses = np.column_stack([rng.uniform(0, (4, 3), (200, 2)), rng.uniform(-3, 3, 200)])
    exact = PlanningMap(before.grid, other, through_unknown=not mapped)
    at = exact.poses_to_cells(poses)
    assert np.array_equal(changed.collides(poses), exact.collides(at))
    assert np.array_equal(changed.unseen().blocked, begun(other).space().blocked)
    for i in range(5, 8):  # both forget alike what is gone
        for live in (old, changed):
            live.see_scan(HERE, scan(HERE, ROOM), i * TENTH_NS)
            live.see_floor(HERE, [], i * TENTH_NS)
    inside = [live.marked_world() for live in (old, changed)]
    inside = [each[np.all((each > 0.1) & (each < (3.9, 2.9)), axis=1)] for each in inside]
    assert np.array_equal(*inside)
