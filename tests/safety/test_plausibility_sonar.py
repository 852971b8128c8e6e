"""Sonar against odometry, each bound from both sides."""

import math

import pytest

from robotctl.messages.actuators import ActuatorCommand
from robotctl.messages.control import Feedback, ImuFeedback, SonarFeedback
from robotctl.messages.faults import Fault, FaultCode
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount
from robotctl.safety.monitor import MonitorInputs
from robotctl.safety.plausibility_sonar import SonarMonitor

MS = 1_000_000
TRAVEL_M = 0.25
FRONT, LEFT, REAR, RIGHT = "front", "left", "rear", "right"
RING = tuple(
    SonarMount(name, 0.0, 0.0, heading_deg)
    for name, heading_deg in ((FRONT, 0.0), (LEFT, 90.0), (REAR, 180.0), (RIGHT, -90.0))
)
# Of a way of two comparisons: eight steps of 1/32 m each, sums of powers of two.
STEP_M = TRAVEL_M / 8


class Drive:
    """Odometry that goes straight ahead, and the ring's ranges at each step."""

    def __init__(
        self,
        ring: tuple[SonarMount, ...] = RING,
        heading_rad: float = 0.0,
        start_ns: int = 0,
    ) -> None:
        self.monitor = SonarMonitor(ring, TRAVEL_M)
        self.heading_rad = heading_rad
        self.way_m = 0.0
        self.now_ns = start_ns

    def see(self, *ranges_m: float, step_m: float = STEP_M, sideways_m: float = 0.0) -> str:
        """Drive a step, then take the ranges; those not given see no obstacle."""
        self.way_m += step_m
        self.now_ns += 50 * MS
        cos, sin = math.cos(self.heading_rad), math.sin(self.heading_rad)
        pose = SE2(
            5.0 + self.way_m * cos - sideways_m * sin,
            -3.0 + self.way_m * sin + sideways_m * cos,
            self.heading_rad,
        )
        return str(self.monitor.take(0, ranges_m, pose, self.now_ns) or "")

    def steps(self, *ranges_m: float, count: int = 8, step_m: float = STEP_M) -> str:
        """Drive steps with the same ranges; all but the last must be in order."""
        for _ in range(count - 1):
            assert self.see(*ranges_m, step_m=step_m) == ""
        return self.see(*ranges_m, step_m=step_m)


def slips(nearer_m: float, sonar: str, range_m: float) -> str:
    return (
        f"odometry moved {nearer_m:.2f} m closer, but sonar {sonar} still measures "
        f"{range_m:.2f} m: "
        "the wheels slip, something holds the robot, or the sonar is stuck"
    )


INF = math.inf


@pytest.mark.parametrize("heading_rad", [0.0, 0.5, -2.0, math.pi])
def test_an_obstacle_that_comes_nearer_as_driven_is_in_order(heading_rad: float) -> None:
    drive = Drive(heading_rad=heading_rad)
    for number in range(64):
        near, far = 3.0 - number * STEP_M, 0.5 + number * STEP_M
        assert drive.see(near, INF, far, INF) == ""


@pytest.mark.parametrize("heading_rad", [0.0, 0.5, -2.0, math.pi])
def test_a_near_obstacle_that_stays_where_it_is_stops_the_robot_after_the_way(
    heading_rad: float,
) -> None:
    ranges = (0.5, INF, INF, INF)
    drive = Drive(heading_rad=heading_rad)
    assert drive.steps(*ranges) == ""
    # The first reading began the comparison, so the way is driven one step later.
    assert drive.see(*ranges, step_m=STEP_M + 1e-9) == slips(TRAVEL_M, FRONT, 0.5)


def test_the_way_is_compared_from_its_whole_length_on() -> None:
    for way_m, judged in ((TRAVEL_M, True), (math.nextafter(TRAVEL_M, 0.0), False)):
        drive = Drive()
        drive.monitor.take(0, (0.5,), SE2(0.0, 0.0, 0.0), 0)
        for number in range(1, 8):
            pose = SE2(number * STEP_M, 0.0, 0.0)
            assert drive.monitor.take(0, (0.5,), pose, number) is None
        pose = SE2(way_m, 0.0, 0.0)
        assert bool(drive.monitor.take(0, (0.5,), pose, 9)) == judged


def test_the_rear_sonar_is_compared_when_the_robot_drives_backwards() -> None:
    drive = Drive()
    drive.see(INF, INF, 0.5, INF)
    assert drive.steps(INF, INF, 0.5, INF, step_m=-STEP_M) == slips(TRAVEL_M, REAR, 0.5)


def test_what_is_behind_and_stays_there_is_no_slip() -> None:
    """It may be a cable, or somebody who walks along; only to the millimetre is it a defect."""
    drive = Drive()
    for number in range(40):
        assert drive.see(INF, INF, 0.5 + 0.01 * (number % 2), INF) == ""


def test_a_sonar_beside_the_way_is_not_compared() -> None:
    drive = Drive()
    for _ in range(40):
        assert drive.see(INF, 0.5, INF, 0.5) == ""


@pytest.mark.parametrize(
    ("heading_deg", "compared"),
    [
        (20.0, True),
        (-20.0, True),
        (20.001, False),
        (-20.001, False),
        (160.0, True),
        (-160.0, True),
        (159.999, False),
        (379.0, True),
        (341.0, True),
    ],
)
def test_a_sonar_looks_along_the_way_within_20_degrees(heading_deg: float, compared: bool) -> None:
    drive = Drive((SonarMount("one", 0.0, 0.0, heading_deg),))
    drive.see(2.5)
    fault = drive.steps(2.5)
    assert fault == ("sonar one is stuck at 2.500 m" if compared else "")


def test_ahead_and_behind_are_told_apart() -> None:
    for heading_deg, sign in ((0.0, 1.0), (20.0, 1.0), (160.0, -1.0), (180.0, -1.0)):
        drive = Drive((SonarMount("one", 0.0, 0.0, heading_deg),))
        drive.see(0.5)
        assert drive.steps(0.5, step_m=sign * STEP_M) == slips(TRAVEL_M, "one", 0.5)
        drive = Drive((SonarMount("one", 0.0, 0.0, heading_deg),))
        drive.see(0.5)
        assert drive.steps(0.5, step_m=-sign * STEP_M) == "sonar one is stuck at 0.500 m"


@pytest.mark.parametrize(
    ("ranges", "said"),
    [
        # Within 5 cm is the same place.
        ((0.5, 0.4375, 0.5), ""),
        ((0.5, 0.4531, 0.5), slips(TRAVEL_M, FRONT, 0.5)),
        ((0.4531, 0.5, 0.4531), slips(TRAVEL_M, FRONT, 0.45)),
        # Only what is nearer than 0.6 m tells that the wheels slip.
        ((math.nextafter(0.6, 0.0), 0.5625, 0.5625), slips(TRAVEL_M, FRONT, 0.56)),
        ((0.6, 0.5625, 0.5625), ""),
        ((0.5625, 0.6, 0.5625), ""),
        ((2.0, 1.96875, 2.0), ""),
        # To the millimetre the same is a defect at any distance.
        ((2.0, 2.0, 2.0), "sonar front is stuck at 2.000 m"),
        ((0.6, 0.6, 0.6), "sonar front is stuck at 0.600 m"),
        ((2.0, 2.0, 1.999), ""),
    ],
)
def test_what_a_way_of_readings_tells(ranges: tuple[float, float, float], said: str) -> None:
    first, between, last = ranges
    drive = Drive()
    drive.see(first)
    for _ in range(7):
        assert drive.see(between) == ""
    assert drive.see(last) == said


def test_the_same_place_is_within_5_cm_and_no_more() -> None:
    """Of readings around 0, so that the difference is exact."""
    for farthest, said in ((0.05, slips(TRAVEL_M, FRONT, 0.05)), (math.nextafter(0.05, 1.0), "")):
        drive = Drive()
        drive.see(0.0)
        assert drive.steps(farthest) == said


def test_a_comparison_needs_five_readings_and_goes_on_until_it_has_them() -> None:
    for between, judged in ((2, False), (3, True), (4, True)):
        drive = Drive()
        drive.see(2.0)
        for _ in range(between):
            drive.see(2.0, step_m=0.01)
        assert bool(drive.see(2.0, step_m=TRAVEL_M)) == judged
        if not judged:
            assert drive.see(2.0, step_m=0.0) == "sonar front is stuck at 2.000 m"
            continue
        # Then the next begins, with one reading again.
        for _ in range(between):
            assert drive.see(2.0, step_m=0.01) == ""
        assert drive.see(2.0, step_m=TRAVEL_M) == "sonar front is stuck at 2.000 m"


@pytest.mark.parametrize("speed_m_s", [0.5, 0.8, 1.5, 3.0])
def test_a_robot_of_any_speed_finds_out_that_its_wheels_slip(speed_m_s: float) -> None:
    """A ring brings ten readings of a sonar in a second; the way grows with the speed."""
    drive = Drive()
    said = [drive.see(0.5, step_m=0.1 * speed_m_s) for _ in range(8)]
    assert next(filter(None, said)).startswith("odometry moved")
    readings = next(number for number, each in enumerate(said, 1) if each)
    assert readings <= max(5, 2 + math.ceil(TRAVEL_M / (0.1 * speed_m_s)))


def test_a_reading_without_an_echo_begins_the_comparison_anew() -> None:
    for missing in (INF, math.nan):
        drive = Drive()
        drive.steps(2.0, count=8)
        assert drive.see(missing) == ""
        assert drive.steps(2.0, count=8) == ""
        assert drive.see(2.0) == "sonar front is stuck at 2.000 m"


def turned_by(turn_rad: float, start_rad: float = 0.0) -> str:
    """Half of the way, a turn, and the other half of it."""
    monitor = SonarMonitor(RING, TRAVEL_M)
    for number in range(9):
        theta_rad = start_rad + (turn_rad if number > 4 else 0.0)
        way_m = number * STEP_M * 1.01
        pose = SE2(way_m * math.cos(start_rad), way_m * math.sin(start_rad), theta_rad)
        said = str(monitor.take(0, (0.5 + 0.01 * (number % 2),), pose, number) or "")
    return said


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_turn_of_more_than_0_1_rad_begins_the_comparison_anew(sign: float) -> None:
    assert turned_by(sign * 0.1) != ""
    assert turned_by(sign * math.nextafter(0.1, 1.0)) == ""
    # Over the cut of the angle as well.
    assert turned_by(sign * (0.09 - 2.0 * math.pi), 3.1) != ""


@pytest.mark.parametrize("radius_m", [0.6, 0.2, -0.2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_sonar_that_is_stuck_is_found_out_in_a_bend_too(radius_m: float, sign: float) -> None:
    for stuck in (True, False):
        monitor, said, way_m = SonarMonitor(RING, TRAVEL_M), "", 0.0
        while not said and way_m < 2.0:
            turn_rad = sign * way_m / radius_m
            pose = SE2(radius_m * math.sin(turn_rad), radius_m * (1 - math.cos(turn_rad)), turn_rad)
            range_m = 2.0 if stuck or way_m < 0.15 else 2.0 + 0.001 * math.cos(way_m)
            said = str(monitor.take(0, (range_m,), pose, 0) or "")
            way_m += STEP_M
        assert said == ("sonar front is stuck at 2.000 m" if stuck else "")
        assert not stuck or way_m <= 2.0 * TRAVEL_M


def test_in_a_bend_too_five_readings_are_needed() -> None:
    monitor = SonarMonitor(RING, TRAVEL_M)
    said = [str(monitor.take(0, (2.0,), SE2(n * 1.0, 0.0, n * 0.2), n) or "") for n in range(5)]
    assert said == [*[""] * 4, "sonar front is stuck at 2.000 m"]


def test_the_way_in_a_bend_counts_from_its_whole_length_on() -> None:
    for way_m, judged in ((TRAVEL_M, True), (math.nextafter(TRAVEL_M, 0.0), False)):
        monitor = SonarMonitor(RING, TRAVEL_M)
        for number in range(8):
            assert monitor.take(0, (2.0,), SE2(0.0, 0.5, number * 0.1), number) is None
        assert bool(monitor.take(0, (2.0,), SE2(way_m, 0.5, 0.9), 9)) == judged


def test_in_a_bend_too_no_echo_is_no_reading_and_a_reset_begins_anew() -> None:
    poses = [SE2(n * STEP_M, 0.0, n * 0.2) for n in range(40)]
    monitor = SonarMonitor(RING, TRAVEL_M)
    assert [str(monitor.take(0, (INF,), pose, 0) or "") for pose in poses] == [""] * 40
    monitor.reset()
    for pose in poses[:6]:
        monitor.take(0, (2.0,), pose, 0)
    monitor.reset()
    assert [str(monitor.take(0, (2.0,), pose, 0) or "") for pose in poses[20:28]] == [""] * 8


def test_on_the_spot_the_same_range_may_stand_for_long() -> None:
    monitor = SonarMonitor(RING, TRAVEL_M)
    for number in range(100):
        assert monitor.take(0, (2.0,), SE2(0.0, 0.0, 0.1 * number), number) is None


def test_driving_sideways_of_the_heading_is_no_way_ahead() -> None:
    for heading_rad in (0.0, 0.5, 2.0):
        drive = Drive(heading_rad=heading_rad)
        for number in range(40):
            said = drive.see(2.0, step_m=0.0, sideways_m=0.1 * number)
            assert said == ""


def test_a_group_of_the_ring_reaches_its_own_sonars() -> None:
    ring = (*(SonarMount(f"side {n}", 0.0, 0.0, 90.0) for n in range(4)), *RING)
    monitor = SonarMonitor(ring, TRAVEL_M)
    for number in range(9):
        pose = SE2(number * STEP_M * 1.01, 0.0, 0.0)
        assert monitor.take(0, (2.0,) * 4, pose, number) is None
    for number in range(9, 18):
        pose = SE2(number * STEP_M * 1.01, 0.0, 0.0)
        said = str(monitor.take(4, (2.0, 7.0, 3.0 + number, 7.0), pose, number) or "")
    assert said == "sonar front is stuck at 2.000 m"


def test_a_group_that_ends_before_a_sonar_says_nothing_of_it() -> None:
    drive = Drive()
    for _ in range(20):
        # The rear one is the third.
        assert drive.see(INF, 2.0) == ""


def test_the_first_of_two_faults_is_told() -> None:
    drive = Drive()
    drive.see(2.0, INF, 3.0)
    assert drive.steps(2.0, INF, 3.0) == "sonar front is stuck at 2.000 m"


def test_after_a_reset_the_next_reading_begins_anew() -> None:
    for before in (4, 8):
        drive = Drive()
        drive.steps(2.0, count=before)
        drive.monitor.reset()
        assert drive.steps(2.0, count=8) == ""
        assert drive.see(2.0) == "sonar front is stuck at 2.000 m"


# -- front and rear against odometry ---------------------------------------------------------------


def backwards(drive: Drive, *, front: bool, rear: bool, error_m: float = 0.0) -> str:
    """Odometry goes ahead by the way; what is in front goes away, and the rear comes nearer."""
    said = ""
    for number in range(9):
        moved_m = number * STEP_M + (error_m if number == 8 else 0.0)
        before = 1.0 + moved_m if front else INF
        behind = 3.0 - moved_m if rear else INF
        said = drive.see(before, INF, behind, INF, step_m=STEP_M if number else 0.0)
        assert said == "" or number == 8
    return said


BACKWARDS = "the robot moves in the opposite direction to odometry, by sonar front and rear"


@pytest.mark.parametrize("start_ns", [0, 10**12])
def test_front_and_rear_that_both_see_the_way_backwards_stop_the_robot(start_ns: int) -> None:
    assert backwards(Drive(start_ns=start_ns), front=True, rear=True) == BACKWARDS


@pytest.mark.parametrize("start_ns", [0, 10**12])
@pytest.mark.parametrize("front", [True, False])
def test_one_of_them_alone_may_see_somebody_walk(start_ns: int, front: bool) -> None:
    drive = Drive(start_ns=start_ns)
    for _ in range(5):
        assert backwards(drive, front=front, rear=not front) == ""


@pytest.mark.parametrize("start_ns", [0, 10**12])
def test_two_on_the_same_side_may_see_the_same_person(start_ns: int) -> None:
    ring = (SonarMount("one", 0.0, 0.1, 10.0), RING[1], SonarMount("other", 0.0, -0.1, -10.0))
    drive = Drive(ring, start_ns=start_ns)
    for number in range(9):
        range_m = 1.0 + number * STEP_M
        assert drive.see(range_m, INF, range_m, step_m=STEP_M if number else 0.0) == ""


@pytest.mark.parametrize(("error_m", "fits"), [(0.0625, True), (-0.0625, True), (0.09, False)])
def test_the_change_of_range_fits_the_way_within_8_cm(error_m: float, fits: bool) -> None:
    said = backwards(Drive(), front=True, rear=True, error_m=error_m)
    assert said == (BACKWARDS if fits else "")
    assert backwards(Drive(), front=True, rear=True, error_m=-0.09) == ""


def test_the_bound_of_the_fit_is_8_cm_itself() -> None:
    """Over a way so short that nothing is rounded."""
    for seen_m, fits in ((0.08, True), (math.nextafter(0.08, 1.0), False)):
        monitor = SonarMonitor(RING, 1e-300)
        for rear in (3.0, 3.01, 3.0, 3.0):
            assert monitor.take(0, (0.0, INF, rear, INF), SE2(0.0, 0.0, 0.0), 0) is None
        said = str(monitor.take(0, (seen_m, INF, 3.0, INF), SE2(1e-300, 0.0, 0.0), 0) or "")
        assert said == (BACKWARDS if fits else "")


@pytest.mark.parametrize("wrong", [1, 5, 8])
def test_one_false_echo_behind_while_somebody_walks_away_ahead_is_no_reversed_motion(
    wrong: int,
) -> None:
    drive = Drive()
    for number in range(9):
        moved_m = number * STEP_M
        behind = 3.0 - TRAVEL_M if number == wrong else 3.0 + moved_m
        step_m = STEP_M if number else 0.0
        assert drive.see(1.0 + moved_m, INF, behind, INF, step_m=step_m) == ""


@pytest.mark.parametrize("wrong", [1, 5, 7])
def test_one_false_echo_does_not_hide_reversed_motion(wrong: int) -> None:
    drive, said = Drive(), ""
    for number in range(9):
        moved_m = number * STEP_M
        behind = 1.5 if number == wrong else 3.0 - moved_m
        step_m = STEP_M if number else 0.0
        said = drive.see(1.0 + moved_m, INF, behind, INF, step_m=step_m)
    assert said == BACKWARDS


@pytest.mark.parametrize("apart_ns", [50 * MS, 500 * MS, 2000 * MS])
def test_one_after_the_other_may_be_two_people_who_walk_its_way(apart_ns: int) -> None:
    drive = Drive(start_ns=10**12)
    assert backwards(drive, front=True, rear=False) == ""
    drive.now_ns += apart_ns
    assert backwards(drive, front=False, rear=True) == ""


@pytest.mark.parametrize("later", [1, 4, 7])
def test_comparisons_that_overlap_contradict_together(later: int) -> None:
    drive, said = Drive(start_ns=10**12), ""
    for number in range(9 + later):
        moved_m = number * STEP_M
        rear = INF if number < later else 3.0 - moved_m
        assert said == ""
        said = drive.see(1.0 + moved_m, INF, rear, INF, step_m=STEP_M if number else 0.0)
    assert said == BACKWARDS


@pytest.mark.parametrize("start_ns", [0, 10**12])
@pytest.mark.parametrize("heard_later", [FRONT, REAR])
def test_a_slow_robot_whose_sonars_began_apart_finds_out_too(
    start_ns: int, heard_later: str
) -> None:
    """5 s for the way of a comparison, and one of the two hears nothing for 2.5 s of them."""
    drive, step_m = Drive(start_ns=start_ns), TRAVEL_M / 100
    for number in range(153):
        moved_m = number * step_m
        front = INF if heard_later == FRONT and number < 50 else 1.0 + moved_m
        rear = INF if heard_later == REAR and number < 50 else 3.0 - moved_m
        if said := drive.see(front, INF, rear, INF, step_m=step_m if number else 0.0):
            break
    assert said == BACKWARDS


def test_a_slow_robot_finds_out_in_a_later_comparison_too() -> None:
    """What front sees is in order for 5 s; rear, 2.5 s later each time, sees the way backwards."""
    drive, step_m, said = Drive(start_ns=10**12), TRAVEL_M / 100, ""
    for number in range(203):
        moved_m = number * step_m
        front = 1.0 + moved_m - 2.0 * min(moved_m, TRAVEL_M)
        rear = INF if number < 50 else 3.0 - moved_m
        said = drive.see(front, INF, rear, INF, step_m=step_m if number else 0.0)
        assert said == "" or number >= 200
        if said:
            break
    assert said == BACKWARDS


def test_a_reset_forgets_what_contradicted() -> None:
    for start_ns in (0, 10**12):
        drive = Drive(start_ns=start_ns)
        backwards(drive, front=True, rear=False)
        drive.monitor.reset()
        assert backwards(drive, front=False, rear=True) == ""


# -- what a tick brings ----------------------------------------------------------------------------


class Motion:
    speeds_rad_s = (0.0, 0.0)
    jumps = 0
    imu: ImuFeedback | None = None

    def __init__(self, x_m: float) -> None:
        self.pose_odom_base = SE2(x_m, 0.0, 0.0)


def ticks(front_m: tuple[float, float], rear_m: tuple[float, float]) -> Fault | None:
    """Drive ahead by the way; the rear sonar is the sixth. Ranges go from the first to the last."""
    monitor = SonarMonitor((RING[0], *(RING[1],) * 4, RING[2]), TRAVEL_M)
    for number in range(9):
        share, stamp_ns = number / 8, number * 50 * MS
        front, rear = (first + share * (last - first) for first, last in (front_m, rear_m))
        groups = (
            SonarFeedback(stamp_ns, 0, (front, INF, INF, INF)),
            SonarFeedback(stamp_ns, 4, (INF, rear, math.nan, math.nan)),
        )
        feedback = Feedback(sonars=groups)
        motion = Motion(number * STEP_M)
        fault = monitor.update(MonitorInputs(feedback, ActuatorCommand(), motion))
        assert fault is None or number == 8
    return fault


def test_all_groups_of_a_tick_are_compared_at_its_pose_and_their_time() -> None:
    assert ticks((1.0, 1.0 - TRAVEL_M), (3.0, 3.0 + TRAVEL_M)) is None
    reversed_ = ticks((1.0, 1.0 + TRAVEL_M), (3.0, 3.0 - TRAVEL_M))
    assert reversed_ is not None
    assert reversed_.code is FaultCode.ODOMETRY_REVERSED


def test_a_fault_of_an_earlier_group_is_not_lost_and_names_its_sonar() -> None:
    slip = ticks((0.5, 0.5), (3.0, 3.0 + TRAVEL_M))
    stuck = ticks((1.0, 1.0 - TRAVEL_M), (3.0, 3.0))
    both = ticks((0.5, 0.5), (3.0, 3.0))
    assert slip == both
    assert slip is not None
    assert (slip.code, slip.part) == (FaultCode.WHEELS_SLIP, FRONT)
    assert stuck is not None
    assert (stuck.code, stuck.part) == (FaultCode.SONAR_STUCK, REAR)
