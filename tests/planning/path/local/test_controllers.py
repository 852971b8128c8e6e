"""Local controllers in closed loop: a robot with delay, jerk and noise among boxes."""

import math

import numpy as np
import pytest

from robotctl.control.limiter import LimitsConfig, TwistLimiter
from robotctl.model.drives.drives import AckermannDrive, DifferentialDrive, MecanumDrive
from robotctl.model.drives.motion import integrate
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.grid_map import GridMap
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.global_planning.plan import Plan, PlannerConfig
from robotctl.planning.path.global_planning.planners import PLANNERS
from robotctl.planning.path.local.controller import ControllerConfig, LocalSituation
from robotctl.planning.path.local.controllers import CONTROLLERS

SIDE_M = 0.05
BODY = Footprint(((0.2, -0.15), (0.2, 0.15), (-0.2, 0.15), (-0.2, -0.15)))
LIMITS = LimitsConfig(0.8, 2.5, 2.5, 8.0, 30.0, 100.0, vy_max_m_s=0.6)
DRIVE = DifferentialDrive("differential", 0.3, 0.05, 2400)
MECANUM = MecanumDrive("mecanum", 0.25, 0.3, 0.05, 2400)
TURNERS = pytest.mark.parametrize("model", [DRIVE, MECANUM], ids=["differential", "mecanum"])
CAR = AckermannDrive("ackermann", 0.35, 0.26, 0.05, 0.6, 2.0, 2400)
CAR_BODY = Footprint(((0.43, -0.15), (0.43, 0.15), (-0.07, 0.15), (-0.07, -0.15)))


def cluttered(seed):
    """Return a room of 6 m with boxes, free in two corners, and a pose in each of them."""
    rng = np.random.default_rng(seed)
    cells = np.zeros((120, 120), np.int8)
    for _ in range(9):
        (height, width), (row, column) = rng.integers(4, 24, 2), rng.integers(0, 110, 2)
        cells[row : row + height, column : column + width] = 100
    cells[:24, :24] = cells[-24:, -24:] = 0
    ends = [SE2(at_m, at_m, rng.uniform(-math.pi, math.pi)) for at_m in (0.6, 5.4)]
    return PlanningMap(GridMap(cells, SIDE_M), BODY), *ends


def nobody(_):
    return np.empty((0, 5))


def drive(
    name, space, plan, start, seconds, model=DRIVE, seed=0, moving=nobody, effort=1.0, margin_m=0.04
):
    """Yield time, pose, twist and motion of each step of a robot that follows a plan.

    Commands arrive a step late, and 1 cm and 1 degree of noise are on its pose.
    """
    rng = np.random.default_rng(seed)
    config = ControllerConfig(deceleration_m_s2=1.5, samples=300, margin_m=margin_m)
    controller = CONTROLLERS[name](config, model, LIMITS, space.footprint)
    limiter, pose, twist, late = TwistLimiter(LIMITS), start, Twist(0.0, 0.0), Twist(0.0, 0.0)
    reverse = plan.reverse if len(plan.reverse) else np.zeros(len(plan.poses) - 1, np.bool_)
    steering = 0.0
    for i in range(round(seconds / 0.05)):
        x_m, y_m, angle = rng.normal(0.0, (0.01, 0.01, math.radians(1.0)))
        seen = SE2(pose.x_m + x_m, pose.y_m + y_m, pose.theta_rad + angle)
        situation = LocalSituation(
            seen, twist, plan.poses, reverse, space, moving(0.05 * i), LIMITS.v_max_m_s, effort
        )
        motion = controller.step(situation)
        for _ in range(5):
            twist = limiter.step(late, 0.01)
            if model.steered:
                wanted = model.inverse(late, (steering,)).joints_rad[0]
                most = 0.01 * model.steering_rate_max_rad_s
                steering += min(max(wanted - steering, -most), most)
                twist = Twist(twist.v_m_s, twist.v_m_s * math.tan(steering) / model.wheelbase_m)
            pose = integrate(pose, twist, 0.01)
        late = Twist(motion.v_m_s, motion.omega_rad_s, motion.vy_m_s)
        yield 0.05 * i, pose, twist, motion


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize(("seed", "effort"), [(0, 1.0), (1, 1.0), (2, 1.0), (3, 1.0), (0, 0.1)])
@TURNERS
def test_it_arrives_in_clutter_without_touching_anything(name, seed, effort, model):
    space, start, goal = cluttered(seed)
    plan = PLANNERS["astar"](PlannerConfig()).plan(space, start, goal)
    assert isinstance(plan, Plan)
    for time_s, pose, _, motion in drive(name, space, plan, start, 30.0, model, effort=effort):
        at = space.to_cells(pose)
        assert not space.collides(np.array([[at.x_m, at.y_m, at.theta_rad]])).any()
        if motion.arrived:
            assert math.dist((pose.x_m, pose.y_m), (goal.x_m, goal.y_m)) < 0.07
            assert time_s < 2.0 * plan.length_m / 0.8 + 2.0
            return
    pytest.fail(f"not there, but at {pose}")


def empty(body):
    return PlanningMap(GridMap(np.zeros((160, 160), np.int8), SIDE_M), body)


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("seed", range(5))
@TURNERS
def test_it_stands_at_the_goal_and_looks_as_wanted_without_dithering(name, seed, model):
    rng = np.random.default_rng(seed)
    goal = SE2(4.0, 4.0, rng.uniform(-math.pi, math.pi))
    start = SE2(*(4.0 + rng.uniform(-1.0, 1.0, 2)), rng.uniform(-math.pi, math.pi))
    plan = PLANNERS["astar"](PlannerConfig()).plan(empty(BODY), start, goal)
    signs, stood = [], 0
    for _, pose, _, motion in drive(name, empty(BODY), plan, start, 15.0, model, seed):
        away_m = math.dist((pose.x_m, pose.y_m), (goal.x_m, goal.y_m))
        if away_m < 0.35 and motion.omega_rad_s != 0.0:
            signs.append(motion.omega_rad_s > 0.0)
        stood += motion.arrived
    assert stood > 100
    assert motion.arrived
    assert away_m < 0.07
    assert abs(math.remainder(pose.theta_rad - goal.theta_rad, math.tau)) < 0.13
    assert np.count_nonzero(np.diff(signs)) <= 4


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_holonomic_robot_arrives_beside_itself_without_turning(name, side):
    start, goal = SE2(4.0, 4.0, 0.0), SE2(4.05, 4.0 + 0.3 * side, 0.0)
    plan = PLANNERS["astar"](PlannerConfig()).plan(empty(BODY), start, goal)
    steps = []
    for _, pose, _, motion in drive(name, empty(BODY), plan, start, 2.5, MECANUM):
        assert abs(pose.theta_rad) < 0.15
        steps.append(motion)
        if motion.arrived:
            break
    assert steps[-1].arrived
    assert math.dist((pose.x_m, pose.y_m), (goal.x_m, goal.y_m)) < 0.07


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_holonomic_robot_slides_past_a_box(name):
    cells = np.zeros((160, 160), np.int8)
    cells[78:88, 80:88] = 100  # in the way, a little to the left
    space = PlanningMap(GridMap(cells, SIDE_M), BODY)
    plan = Plan(np.array([[2.0, 3.95, 0.0], [6.5, 3.95, 0.0]]), 4.5, 0)
    for _, pose, _, motion in drive(name, space, plan, SE2(2.0, 3.95, 0.0), 20.0, MECANUM):
        at = space.to_cells(pose)
        assert not space.collides(np.array([[at.x_m, at.y_m, at.theta_rad]])).any()
        if motion.arrived:
            break
    assert motion.arrived


@pytest.mark.parametrize("seed", range(3))
def test_a_robot_that_steers_arrives_over_changes_of_gear(seed):
    """Where it misses the goal it says so, and another plan leads there."""
    rng = np.random.default_rng(seed)
    goal = SE2(4.0, 4.0, rng.uniform(-math.pi, math.pi))
    start = SE2(*rng.uniform(2.0, 3.0, 2), rng.uniform(-math.pi, math.pi))
    config = PlannerConfig(turning_radius_m=1.3 * CAR.min_turning_radius_m)
    for _ in range(4):
        plan = PLANNERS["hybrid"](config).plan(empty(CAR_BODY), start, goal)
        for _, pose, _, motion in drive("mppi", empty(CAR_BODY), plan, start, 20.0, CAR, seed):
            start = pose
            if motion.arrived or motion.blocked:
                break
        if motion.arrived:
            break
        assert "missed" in motion.text
    assert motion.arrived
    assert math.dist((start.x_m, start.y_m), (goal.x_m, goal.y_m)) < 0.08
    assert abs(math.remainder(start.theta_rad - goal.theta_rad, math.tau)) < 0.13


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("late_s", [-0.5, 0.0, 0.5])
def test_it_lets_somebody_pass_who_crosses(name, late_s):
    """They would meet half-way: it slows down and drives on behind them."""

    def walker(time_s):
        return np.array([[4.0, 4.0 + 1.0 * (time_s - 3.75 + late_s), 0.0, 1.0, 0.25]])

    start = SE2(1.0, 4.0, 0.0)
    plan = Plan(np.array([[1.0, 4.0, 0.0], [7.0, 4.0, 0.0]]), 6.0, 0)
    slowest = LIMITS.v_max_m_s
    for time_s, pose, twist, motion in drive(name, empty(BODY), plan, start, 15.0, moving=walker):
        ((x_m, y_m, *_),) = walker(time_s + 0.05)
        away_x, away_y = pose.inverse().apply(x_m, y_m)
        gap_m = math.hypot(max(abs(away_x) - 0.2, 0.0), max(abs(away_y) - 0.15, 0.0)) - 0.25
        if abs(twist.v_m_s) > 0.05:
            assert gap_m > 0.05
            assert not (0.0 < 4.0 - y_m < 0.6 and abs(pose.x_m - 4.0) < 0.3), "in front of them"
        if time_s > 1.0 and pose.x_m < 4.0:
            slowest = min(slowest, twist.v_m_s)
        if motion.arrived:
            break
    assert motion.arrived
    assert time_s < 14.0
    assert slowest < 0.7


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize(
    ("begin", "velocity"),
    [
        pytest.param((7.0, 4.05), (-0.7, 0.0), id="ahead"),
        pytest.param((2.6, 5.4), (0.0, -0.7), id="from the side, as the robot is nearly past"),
    ],
)
def test_it_gets_out_of_the_way_of_who_does_not_evade(name, begin, velocity):
    """Whoever stopped there would be met."""

    def walker(time_s):
        x_m, y_m = np.add(begin, np.multiply(velocity, time_s))
        return np.array([[x_m, y_m, *velocity, 0.25]])

    start = SE2(1.0, 4.0, 0.0)
    plan = Plan(np.array([[1.0, 4.0, 0.0], [7.0, 4.0, 0.0]]), 6.0, 0)
    for time_s, pose, _, motion in drive(name, empty(BODY), plan, start, 20.0, moving=walker):
        ((x_m, y_m, *_),) = walker(time_s + 0.05)
        away_x, away_y = pose.inverse().apply(x_m, y_m)
        gap_m = math.hypot(max(abs(away_x) - 0.2, 0.0), max(abs(away_y) - 0.15, 0.0)) - 0.25
        assert gap_m > 0.0
        if motion.arrived:
            break
    assert motion.arrived


@pytest.mark.parametrize("model", [DRIVE, CAR], ids=["differential", "ackermann"])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", CONTROLLERS)
def test_it_keeps_to_its_path_through_a_door_that_hardly_leaves_room(name, seed, model):
    body = CAR_BODY if model is CAR else BODY  # both are 0.3 m wide
    cells = np.zeros((160, 160), np.int8)
    cells[:, 80:83] = 100
    cells[76:84, 80:83] = 0  # 0.4 m, from y = 3.8 m to 4.2 m
    space = PlanningMap(GridMap(cells, SIDE_M), body)
    # The path is in line with the door from half a metre before it.
    poses = [[2.4, 4.2, -0.2], [3.2, 4.0, -0.2], [3.2, 4.0, 0.0], [5.5, 4.0, 0.0]]
    if model is CAR:
        poses = [[2.0, 4.0, 0.0], [5.5, 4.0, 0.0]]
    plan = Plan(np.array(poses), 3.0, 0)
    start = SE2(poses[0][0], poses[0][1] + 0.03, poses[0][2])
    for _, pose, _, motion in drive(name, space, plan, start, 30.0, model, seed, margin_m=0.06):
        at = space.to_cells(pose)
        assert not space.collides(np.array([[at.x_m, at.y_m, at.theta_rad]])).any()
        if 3.6 < pose.x_m < 4.2:
            assert abs(pose.y_m - 4.0) < 0.04, "5 cm are free on each side"
        if motion.arrived:
            return
    pytest.fail(f"not there, but at {pose}")


@pytest.mark.parametrize("beside_m", [0.05, 0.08, 0.11, 0.15])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("back", [False, True], ids=["there", "and back"])
def test_it_parks_along_a_wall_where_it_cannot_turn(seed, beside_m, back):
    cells = np.zeros((120, 120), np.int8)
    cells[100:] = 100  # from y = 5 m on
    space = PlanningMap(GridMap(cells, SIDE_M), BODY)
    ends = [SE2(1.0, 3.0, 0.5), SE2(4.0, 5.0 - 0.15 - beside_m, 0.0)]
    start, goal = ends[::-1] if back else ends
    plan = PLANNERS["astar"](PlannerConfig()).plan(space, start, goal)
    assert isinstance(plan, Plan)
    for _, pose, _, motion in drive("mppi", space, plan, start, 40.0, DRIVE, seed):
        at = space.to_cells(pose)
        assert not space.collides(np.array([[at.x_m, at.y_m, at.theta_rad]])).any()
        if motion.arrived:
            assert math.dist((pose.x_m, pose.y_m), (goal.x_m, goal.y_m)) < 0.07
            assert abs(math.remainder(pose.theta_rad - goal.theta_rad, math.tau)) < 0.12
            return
    pytest.fail(f"not there, but at {pose}")
