"""The obstacle guard: what it counts, how fast it allows, what it does when blind."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.errors import InvalidValue
from robotctl.model.footprint import Footprint
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.config import GuardConfig
from robotctl.planning.guard.obstacle_guard import ObstacleGuard
from tests.model.polygon_bodies import bodies

CONFIG = GuardConfig()
MOUNTS = (
    SonarMount("front", 0.18, 0.0, 0.0),
    SonarMount("front_left", 0.15, 0.10, 45.0),
    SonarMount("left", 0.0, 0.15, 90.0),
    SonarMount("rear", -0.15, 0.0, 180.0),
)
FREE = (math.inf,) * 4
NEW = (True,) * 4


def limit(front=math.inf, front_left=math.inf, left=math.inf, rear=math.inf, direction=1.0):
    guard = ObstacleGuard(CONFIG, MOUNTS)
    for _ in range(3):
        guard.observe((front, front_left, left, rear), NEW)
    return guard.step(direction)


def turning(curvature, front=math.inf, front_left=math.inf, left=math.inf, direction=1.0):
    guard = ObstacleGuard(CONFIG, MOUNTS)
    guard.observe((front, front_left, left, math.inf), NEW)
    return guard.step(direction, curvature)


def test_with_nothing_near_the_speed_is_free():
    assert limit() == (math.inf, "")


@given(st.floats(0.12, 4.0))
def test_braking_from_the_speed_allowed_ends_before_the_margin(reading):
    v = limit(front=reading).v_max_m_s
    way = v * CONFIG.reaction_s + v * v / (2 * CONFIG.deceleration_m_s2)
    assert way == pytest.approx(reading - CONFIG.margin_m, abs=1e-9)


@given(st.floats(0.0, 0.12))
def test_within_the_margin_the_robot_stands(reading):
    step = limit(front=reading)
    assert step.v_max_m_s == pytest.approx(0.0, abs=1e-9)
    assert "front measures" in step.obstacle


def test_a_robot_that_does_not_drive_is_not_limited():
    assert limit(front=0.05, direction=0.0) == (math.inf, "")


def test_only_the_direction_of_travel_counts():
    assert limit(front=0.05, direction=-1.0).v_max_m_s == math.inf
    assert limit(rear=0.05, direction=1.0).v_max_m_s == math.inf
    assert limit(rear=0.05, direction=-1.0).v_max_m_s == 0.0
    assert limit(front=0.05, rear=0.05, direction=0.0).v_max_m_s == math.inf


def way_for(v):
    """Return the way that a robot needs to stop [m]."""
    return v * CONFIG.reaction_s + v * v / (2 * CONFIG.deceleration_m_s2)


def test_a_slanting_sonar_sees_a_wall_square_to_its_axis_that_the_corner_comes_to():
    # The corner (0.18, 0.18) lies (0.03 + 0.08) / sqrt 2 beyond the sonar, towards such a wall.
    gap = 0.50 - 0.11 / math.sqrt(2)
    step = limit(front_left=0.50)
    assert way_for(step.v_max_m_s) == pytest.approx(gap * math.sqrt(2) - CONFIG.margin_m)
    assert step.obstacle == "front_left measures 0.50 m"
    assert limit(front_left=0.16).v_max_m_s == 0.0
    assert limit(front_left=0.17).v_max_m_s > 0.0


def test_a_wall_beside_counts_where_a_bend_brings_a_corner_near_and_not_straight_on():
    assert limit(left=0.05) == (math.inf, "")
    # The front left corner goes (1 - 0.18, 0.18) per way of base; 0.03 m of the gap is body.
    step = turning(1.0, left=0.1)
    way = 0.07 / 0.18 - CONFIG.margin_m / math.hypot(0.82, 0.18)
    assert way_for(step.v_max_m_s) == pytest.approx(way)
    assert step.obstacle == "left measures 0.10 m"
    # To the right the rear corner swings out, which reaches less far.
    assert step.v_max_m_s < turning(-1.0, left=0.1).v_max_m_s < math.inf


def test_in_a_bend_the_outer_corner_reaches_the_wall_ahead_first():
    # Per way of base the front right corner goes (1 + 0.18, 0.18).
    step = turning(1.0, front=0.5)
    assert way_for(step.v_max_m_s) == pytest.approx(0.5 / 1.18 - 0.12 / math.hypot(1.18, 0.18))
    assert turning(-1.0, front=0.5).v_max_m_s == pytest.approx(step.v_max_m_s)


def test_backwards_with_the_wheels_turned_the_front_swings_out():
    assert turning(2.0, left=0.06, direction=-1.0).v_max_m_s == 0.0
    assert turning(0.0, left=0.06, direction=-1.0).v_max_m_s == math.inf
    assert turning(2.0, front_left=0.1, direction=-1.0).v_max_m_s == math.inf  # away from it


@given(st.floats(0.1, 0.8), st.floats(-3.0, 3.0), st.floats(0.05, 2.0))
def test_the_limit_depends_on_the_arc_and_not_on_the_speed_asked_for(v, curvature, reading):
    guard = ObstacleGuard(CONFIG, MOUNTS)
    guard.observe((reading, reading, reading, reading), NEW)
    slow, fast = guard.step(v, curvature * v), guard.step(2 * v, 2 * curvature * v)
    assert slow.v_max_m_s == pytest.approx(fast.v_max_m_s, abs=1e-9)


@given(st.floats(-3.0, 3.0), st.sampled_from([1.0, -1.0]), st.lists(st.floats(0.03, 3.0)))
def test_a_nearer_echo_never_allows_more(curvature, direction, readings):
    limits = []
    for reading in sorted(readings):
        guard = ObstacleGuard(CONFIG, MOUNTS)
        guard.observe((1.0, reading, reading, 1.0), NEW)
        limits.append(guard.step(direction, curvature).v_max_m_s)
    assert limits == sorted(limits)


def test_a_mirrored_robot_gets_the_same_limit():
    right = (SonarMount("front_right", 0.15, -0.10, -45.0),)
    left = (SonarMount("front_left", 0.15, 0.10, 45.0),)
    limits = []
    for mounts, omega in ((left, 0.5), (right, -0.5)):
        guard = ObstacleGuard(CONFIG, mounts)
        guard.observe((0.30,), NEW[:1])
        limits.append(guard.step(1.0, omega).v_max_m_s)
    assert limits[0] == pytest.approx(limits[1])
    assert 0.0 < limits[0] < 1.0


def test_slanting_rear_sonars_see_along_the_way_back():
    guard = ObstacleGuard(CONFIG, (SonarMount("rear_left", -0.12, 0.10, 135.0),))
    guard.observe((0.1,), NEW[:1])
    assert guard.step(-1.0).v_max_m_s == 0.0
    assert guard.step(1.0).v_max_m_s == math.inf
    for _ in range(3):
        guard.observe((0.3,), NEW[:1])
    assert 0.0 < guard.step(-1.0).v_max_m_s < 0.5
    assert guard.step(1.0).v_max_m_s == math.inf


def test_a_single_outlier_and_a_single_lost_echo_change_nothing():
    guard = ObstacleGuard(CONFIG, MOUNTS[:1])
    for reading in (2.0, 2.0, 0.05):
        guard.observe((reading,), NEW[:1])
    assert guard.step(1.0).v_max_m_s > 1.0
    for reading in (0.1, 0.1, math.inf):
        guard.observe((reading,), NEW[:1])
    assert guard.step(1.0).v_max_m_s == 0.0


def test_an_obstacle_that_two_of_three_readings_do_not_see_any_more_is_gone():
    guard = ObstacleGuard(CONFIG, MOUNTS[:1])
    for reading in (0.1, 0.1, 2.0):
        guard.observe((reading,), NEW[:1])
    assert guard.step(1.0).v_max_m_s == 0.0
    guard.observe((2.0,), NEW[:1])
    assert guard.step(1.0).v_max_m_s > 1.0


def test_a_reading_counts_once_however_often_it_is_looked_at():
    guard = ObstacleGuard(CONFIG, MOUNTS[:1])
    for _ in range(3):
        guard.observe((2.0,), (True,))
    for new in (True, False, False, False):
        guard.observe((0.05,), (new,))  # one outlier
        assert guard.step(1.0).v_max_m_s > 1.0
    guard.observe((0.05,), (True,))
    assert guard.step(1.0).v_max_m_s == 0.0


def test_a_sonar_that_falls_silent_stops_the_robot_within_two_steps():
    guard = ObstacleGuard(CONFIG, MOUNTS[:1])
    for _ in range(3):
        guard.observe((2.0,), (True,))
    for _ in range(2):
        guard.observe((math.nan,), (False,))
    assert guard.step(1.0).v_max_m_s == 0.0


def test_half_of_the_readings_is_not_enough():
    guard = ObstacleGuard(CONFIG, MOUNTS[:1])
    guard.observe((2.0,), (True,))
    guard.observe((math.nan,), (False,))
    assert guard.step(1.0) == (0.0, "sonar front gives no reading")


def test_a_sonar_aside_without_reading_hides_no_other():
    assert limit(front_left=math.nan, rear=0.05, direction=-1.0).v_max_m_s == 0.0


def test_a_sonar_ahead_without_reading_stops_the_robot_and_is_named():
    step = limit(front=math.nan)
    assert step.v_max_m_s == 0.0
    assert "front gives no reading" in step.obstacle
    assert limit(front_left=math.nan).v_max_m_s == math.inf


def test_before_the_first_reading_the_robot_stands():
    assert ObstacleGuard(CONFIG, MOUNTS).step(1.0).v_max_m_s == 0.0


def test_without_a_sonar_in_the_direction_of_travel_there_is_nothing_to_guard():
    assert ObstacleGuard(CONFIG, ()).step(1.0).v_max_m_s == math.inf


def test_the_body_reaches_at_least_to_its_outermost_sonar():
    ways = []
    for y_m in (0.10, CONFIG.half_width_m, 0.30):
        guard = ObstacleGuard(CONFIG, (SonarMount("front_left", 0.15, y_m, 45.0),))
        guard.observe((0.30,), NEW[:1])
        ways.append(way_for(guard.step(1.0).v_max_m_s))
    assert ways[0] < ways[1] == pytest.approx(ways[2])


def test_it_says_whether_a_sonar_looks_the_way_asked_for():
    assert ObstacleGuard(CONFIG, MOUNTS).looks(1.0)
    assert ObstacleGuard(CONFIG, MOUNTS).looks(-1.0)
    front = ObstacleGuard(CONFIG, MOUNTS[:3])
    assert (front.looks(1.0), front.looks(-1.0)) == (True, False)
    slanting = ObstacleGuard(CONFIG, MOUNTS[1:3])
    assert not slanting.looks(1.0)
    assert not ObstacleGuard(CONFIG, ()).looks(1.0)


def test_a_sonar_at_the_edge_of_the_cone_looks_ahead():
    for heading_deg, looks in ((30.0, True), (30.1, False), (-30.0, True), (-30.1, False)):
        guard = ObstacleGuard(CONFIG, (SonarMount("aside", 0.1, 0.1, heading_deg),))
        assert guard.looks(1.0) is looks


@pytest.mark.parametrize("value", [0.0, -1.0, math.inf, math.nan])
@pytest.mark.parametrize("key", ["margin_m", "reaction_s", "blocked_max_s"])
def test_a_setting_that_is_not_positive_and_finite_is_refused_by_name(key, value):
    with pytest.raises(InvalidValue) as found:
        GuardConfig(**{key: value})
    assert (found.value.key, found.value.value) == (key, pytest.approx(value, nan_ok=True))
    assert found.value.rule == f"{value} found, a finite number > 0 allowed"


def test_a_robot_may_be_blocked_for_days_and_not_for_ever():
    GuardConfig(blocked_max_s=1e6)
    with pytest.raises(InvalidValue, match="1000001 found, at most 1000000 allowed") as found:
        GuardConfig(blocked_max_s=1_000_001)
    assert (found.value.key, found.value.value) == ("blocked_max_s", 1_000_001)


def on_floor(*points, direction=1.0):
    guard = ObstacleGuard(CONFIG, MOUNTS)
    guard.observe(FREE, NEW, points)
    return guard.step(direction)


@given(st.floats(0.12, 1.5))
def test_braking_for_a_thing_on_the_floor_ends_before_the_margin_from_the_nose(gap):
    v = on_floor((CONFIG.nose_m + gap, 0.0)).v_max_m_s
    way = v * CONFIG.reaction_s + v * v / (2 * CONFIG.deceleration_m_s2)
    assert way == pytest.approx(gap - CONFIG.margin_m, abs=1e-9)


def test_things_on_the_floor_count_in_the_way_and_in_the_direction_of_travel():
    assert on_floor((0.3, 0.17)).v_max_m_s == 0.0
    assert on_floor((0.3, -0.17)).v_max_m_s == 0.0
    assert on_floor((0.3, CONFIG.half_width_m)).v_max_m_s == math.inf
    assert on_floor((0.0, 0.0)).v_max_m_s == math.inf  # below it
    assert on_floor((-0.3, 0.0)).v_max_m_s == math.inf
    assert on_floor((-0.3, 0.0), direction=-1.0).v_max_m_s == 0.0
    assert on_floor().v_max_m_s == math.inf


def test_the_nearer_of_sonar_and_camera_counts_and_is_named():
    guard = ObstacleGuard(CONFIG, MOUNTS)
    for _ in range(3):
        guard.observe((0.5, math.inf, math.inf, math.inf), NEW, [(0.6, 0.0)])
    assert guard.step(1.0).obstacle == "something lies on the floor 0.40 m away"
    guard.observe((0.5, math.inf, math.inf, math.inf), NEW, [(0.8, 0.0)])
    assert guard.step(1.0).obstacle == "front measures 0.50 m"
    guard.observe((0.5, math.inf, math.inf, math.inf), NEW)
    assert guard.step(1.0).obstacle == "front measures 0.50 m"


REACH = math.hypot(0.2, 0.18)  # from base to a front corner


def lidar(*points, v=1.0, omega=0.0, ranges=FREE):
    guard = ObstacleGuard(CONFIG, MOUNTS)
    for _ in range(3):
        guard.observe(ranges, NEW, (), np.array(points).reshape(-1, 2))
    return guard.step(v, omega)


@given(st.floats(0.12, 3.0), st.floats(-0.18, 0.18))
def test_braking_for_a_lidar_point_ends_before_the_margin(gap, y):
    """The body reaches from the nose to the rearmost sonar."""
    for step in (lidar((0.2 + gap, y)), lidar((-0.15 - gap, y), v=-0.3)):
        assert way_for(step.v_max_m_s) == pytest.approx(gap - 0.12, abs=1e-9)


def test_lidar_points_count_in_the_way_only():
    assert lidar((0.5, 0.181)) == (math.inf, "")
    assert lidar((-0.5, 0.0)) == (math.inf, "")
    assert lidar((0.25, 0.0), v=-1.0) == (math.inf, "")
    assert lidar((0.3, 0.1)) == (0.0, "something is at x 0.30 m, y 0.10 m of the robot")
    assert lidar() == (math.inf, "")


def test_in_a_bend_a_lidar_point_beside_counts():
    """On a circle of 1 m the front right corner goes round its centre at hypot(1.18, 0.2)."""
    ahead = math.asin(0.2 / math.hypot(1.18, 0.2))
    point = (
        math.hypot(1.18, 0.2) * math.sin(ahead + 0.5),
        1.0 - math.hypot(1.18, 0.2) * math.cos(ahead + 0.5),
    )
    step = lidar(point, v=0.5, omega=0.5)
    assert way_for(step.v_max_m_s) == pytest.approx(0.5 - 0.12 / math.hypot(1.18, 0.2), abs=1e-6)
    assert lidar(point, v=0.5, omega=-0.5).v_max_m_s == math.inf


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_on_the_spot_the_corner_stops_before_a_point_that_it_would_touch(side):
    """The corner at atan2(0.18, 0.2) comes to a point on its circle 1 rad further."""
    at = math.atan2(0.18, 0.2) + 1.0
    point = (0.999 * REACH * math.cos(at), side * 0.999 * REACH * math.sin(at))
    step = lidar(point, v=0.0, omega=side * 0.3)
    assert way_for(step.v_max_m_s) == pytest.approx(REACH * 1.0 - 0.12, abs=0.01)
    assert step.obstacle == f"something is at x {point[0]:.2f} m, y {point[1]:.2f} m of the robot"
    assert lidar((1.001 * point[0], 1.003 * point[1]), v=0.0, omega=side) == (math.inf, "")
    assert lidar(point, v=0.0, omega=0.0) == (math.inf, "")
    faster = lidar(point, v=0.0, omega=side * 3.0)
    assert faster.v_max_m_s == pytest.approx(step.v_max_m_s)
    assert lidar(point, v=0.0, omega=-side).v_max_m_s != step.v_max_m_s


def test_echoes_and_the_floor_do_not_hinder_a_turn_on_the_spot():
    guard = ObstacleGuard(CONFIG, MOUNTS)
    guard.observe((0.01, 0.01, 0.01, math.nan), NEW, [(0.2, 0.2)])
    assert guard.step(0.0, 1.0) == (math.inf, "")
    guard.observe((0.01, 0.01, 0.01, 0.01), NEW, [(0.2, 0.2)], np.empty((0, 2)))
    assert guard.step(0.0, 1.0) == (math.inf, "")


def test_lidar_points_count_for_one_step():
    guard = ObstacleGuard(CONFIG, MOUNTS)
    near = np.array([[0.25, 0.0]])
    guard.observe(FREE, NEW, (), near)
    assert guard.step(1.0).v_max_m_s == 0.0
    guard.reset()
    guard.observe(FREE, NEW)
    assert guard.step(1.0).v_max_m_s == math.inf
    guard.observe(FREE, NEW, (), near)
    guard.reset()
    assert guard.step(0.0, 1.0).v_max_m_s == math.inf
    assert guard.step(-1.0).v_max_m_s == 0.0  # no sonar behind has said anything


def test_the_nearest_of_all_that_is_seen_counts_and_is_named():
    for floor_m, point_m, named in (
        (0.6, 0.65, "floor"),
        (0.6, 0.55, "x 0.55 m"),
        (9.0, 0.9, "front"),
    ):
        guard = ObstacleGuard(CONFIG, MOUNTS)
        for _ in range(3):
            guard.observe((0.5, *FREE[1:]), NEW, [(floor_m, 0.0)], np.array([[point_m, 0.0]]))
        assert named in guard.step(1.0).obstacle
    assert "front" in lidar((0.62, 0.0), ranges=(0.42, *FREE[1:])).obstacle  # as near


def test_the_body_reaches_from_the_nose_to_the_rearmost_sonar():
    assert ObstacleGuard(CONFIG, MOUNTS).reach_m == pytest.approx(REACH)
    assert ObstacleGuard(CONFIG, ()).reach_m == pytest.approx(REACH)
    wide = (SonarMount("a", 0.3, 0.0, 0.0), SonarMount("b", -0.4, -0.25, 180.0))
    assert ObstacleGuard(CONFIG, wide).reach_m == pytest.approx(math.hypot(0.4, 0.25))
    assert CONFIG.outline(wide) == Footprint.rectangle(-0.4, 0.3, 0.25)
    assert CONFIG.outline(wide[:1]) == Footprint.rectangle(-0.2, 0.3, 0.18)
    assert CONFIG.outline(MOUNTS) == Footprint.rectangle(-0.15, 0.2, 0.18)
    assert CONFIG.outline(()) == Footprint.rectangle(-0.2, 0.2, 0.18)


def test_the_edge_of_a_cone_that_hears_the_wall_beside_does_not_stop_the_robot():
    """A wall along the left side: the slanting sonar hears it 12.5° nearer to it than its axis."""
    gap_m, body_m = 0.02, 0.15
    slant_m = (body_m + gap_m - 0.10) / math.cos(math.radians(45.0 - 12.5))
    assert limit(front_left=slant_m).v_max_m_s == 0.0
    assert limit(front_left=slant_m, left=gap_m).v_max_m_s == math.inf
    assert limit(front_left=slant_m - 0.05, left=gap_m).v_max_m_s == 0.0, "nearer than the wall"
    assert limit(front_left=slant_m, left=0.5).v_max_m_s == 0.0, "the wall is far off"
    assert limit(front_left=slant_m, left=gap_m, front=0.05).v_max_m_s == 0.0


def beside_a_jamb(points_base, front=math.inf):
    """Return the limit straight on where the slanting sonar hears something 0.14 m away."""
    guard = ObstacleGuard(CONFIG, MOUNTS, has_lidar=True)
    for _ in range(3):
        guard.observe((front, 0.14, math.inf, math.inf), NEW, points_base=points_base)
    return guard.step(1.0)


def test_a_jamb_that_a_lidar_sees_beside_the_way_is_no_wall_across():
    # 0.14 m from (0.15, 0.10) at 45 degrees is (0.249, 0.199): beside a body 0.18 m wide each side.
    jamb = np.array([[0.249, 0.199], [0.3, 0.21]])
    assert beside_a_jamb(jamb) == (math.inf, "")
    # The same point in the way of the body stops it all the same, as the lidar tells.
    in_the_way = beside_a_jamb(jamb - (0.0, 0.03))
    assert in_the_way.v_max_m_s == pytest.approx(0.0, abs=0.05)
    assert in_the_way.obstacle


def test_what_only_the_sonar_hears_is_a_wall():
    elsewhere = np.array([[0.249, 0.35], [0.35, 0.30], [1.0, 0.0]])
    assert beside_a_jamb(elsewhere).obstacle == "front_left measures 0.14 m"


def test_the_sonar_that_looks_ahead_stops_before_what_a_lidar_does_not_see():
    jamb = np.array([[0.249, 0.199], [0.3, 0.21], [0.30, -0.02]])
    low = beside_a_jamb(jamb[:2], front=0.12)
    assert low.v_max_m_s == pytest.approx(0.0, abs=1e-9)
    assert low.obstacle == "front measures 0.12 m"
    # Though the lidar has a point there, too.
    assert beside_a_jamb(jamb, front=0.12).v_max_m_s == pytest.approx(0.0, abs=1e-9)


def test_what_lies_in_the_hollow_behind_an_arm_hinders_no_way_but_back():
    outline = ((0.2, -0.5), (0.2, 0.18), (-0.15, 0.18), (-0.15, -0.18), (0.1, -0.18), (0.1, -0.5))
    guard = ObstacleGuard(CONFIG, MOUNTS, has_lidar=True, outline=Footprint(outline))
    guard.observe(FREE, NEW, points_base=np.array([[-0.1, -0.4]]))
    assert guard.step(0.5).v_max_m_s == math.inf
    back = guard.step(-0.5)
    assert back.v_max_m_s < 0.5
    assert "x -0.10 m, y -0.40 m" in back.obstacle
    assert guard.step(0.0, 1.0).v_max_m_s < math.inf, "the arm would swing away, the tail in"
    lift = Footprint(outline, (((0.2, -0.05), (0.6, -0.05), (0.6, 0.05), (0.2, 0.05)),))
    guard = ObstacleGuard(CONFIG, MOUNTS, has_lidar=True, outline=lift)
    guard.observe((0.9, *FREE[1:]), NEW, points_base=np.array([[2.0, 0.0]]))
    assert guard.step(0.5).v_max_m_s == pytest.approx(braking_speed(0.9 + 0.18 - 0.6 - 0.12))


def braking_speed(way_m):
    """Return the speed from which the robot stands after a way."""
    delay = CONFIG.deceleration_m_s2 * CONFIG.reaction_s
    return math.sqrt(delay * delay + 2.0 * CONFIG.deceleration_m_s2 * way_m) - delay


@given(
    bodies(),
    bodies(),
    st.lists(st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5)), min_size=1, max_size=6),
    st.tuples(*[st.floats(-1.0, 1.0)] * 2),
)
def test_another_body_is_guarded_as_by_who_never_had_another_one(before, after, points, motion):
    changed = ObstacleGuard(CONFIG, MOUNTS, has_lidar=True, outline=before)
    fresh = ObstacleGuard(CONFIG, MOUNTS, has_lidar=True, outline=after)
    for guard in (changed, fresh):
        guard.observe(FREE, NEW, points[:1], np.array(points))
    changed.step(*motion)
    changed.use_body(after)
    assert changed.step(*motion) == fresh.step(*motion)
    assert changed.reach_over_m == fresh.reach_over_m
    assert changed.free_ahead() == fresh.free_ahead()
