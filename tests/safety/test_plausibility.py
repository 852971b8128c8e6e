"""The wheels of a robot against their motors and each other, each bound from both sides.

What the monitors do for a whole robot stands in tests/app/simulation/test_plausibility.py.
"""

import math

import pytest

from robotctl.messages.actuators import ActuatorCommand, ActuatorFeedback, DriveState
from robotctl.safety.plausibility import Plausibility
from tests.native_frames import WHEELS
from tests.safety.exact_tolerances import DEADBAND, MS, T0, above, below
from tests.safety.monitored import inputs, monitored

SUPPLY_V = 16.0


class Robot:
    """Wheels whose speed by the motor is what the duty says, without any current."""

    def __init__(self, wheels: int = 2, a_max_rad_s2: float = math.inf) -> None:
        self.wheels = WHEELS[:wheels]
        self.monitors = Plausibility(monitored(self.wheels, a_max_rad_s2=a_max_rad_s2))
        self.now_ns = T0

    def sees(
        self,
        counted: tuple[float, ...],
        electrical: tuple[float, ...] = (8.0, 8.0),
        *,
        jumps: int = 0,
        enable: bool = True,
        lasts_ns: int = 0,
        currents_a: tuple[float, float] = (0.0, 0.0),
        temperatures_c: tuple[float, float] = (25.0, 25.0),
        supply_v: float = SUPPLY_V,
    ) -> str:
        """Show one sample, `lasts_ns` after the last; return the fault so far."""
        self.now_ns += lasts_ns
        reports = tuple(
            ActuatorFeedback(
                report_ns=self.now_ns,
                state=DriveState.ENABLED,
                current_a=current_a,
                temperature_c=temperature_c,
                voltage_v=supply_v,
            )
            for _, current_a, temperature_c in zip(
                self.wheels, currents_a, temperatures_c, strict=False
            )
        )
        duties = tuple(duty(speed * 0.5 / SUPPLY_V) for speed in electrical)[: len(counted)]
        command = ActuatorCommand(enable, False, duties)
        self.monitors.update(inputs(reports, command, counted, jumps=jumps))
        return str(self.monitors.fault or "")


def duty(share: float) -> float:
    """The duty that gives this share of the supply to the motor, beyond the dead band."""
    return math.copysign(DEADBAND + (1.0 - DEADBAND) * abs(share), share) if share else 0.0


def of(channel: int, value: float, other: float = 0.0) -> tuple[float, float]:
    """A value of channel 1 or 2, and another one of the other."""
    return (value, other) if channel == 1 else (other, value)


SPEED_NS = 50 * MS + 1


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_robot_whose_wheels_do_what_the_duty_says_has_no_fault(sign: float) -> None:
    robot = Robot()
    for speed in (0.0, 4.0, 8.0, 16.0, 32.0):
        pair = (sign * speed, -sign * speed)
        for _ in range(4):
            assert robot.sees(pair, pair, lasts_ns=2000 * MS) == ""


def test_each_wheel_is_compared_with_its_own_motor() -> None:
    for stuck, name in ((0, "left"), (1, "right")):
        counted = [8.0, 8.0]
        counted[stuck] = 0.0
        robot = Robot()
        robot.sees(tuple(counted))
        fault = robot.sees(tuple(counted), lasts_ns=SPEED_NS)
        assert fault == (
            f"{name} encoder stuck or disconnected: 0.0 rad/s counted, 8.0 rad/s by duty and "
            "current"
        )


def test_currents_and_temperatures_are_those_of_the_wheel() -> None:
    # 8 V at the motor, of which 4 V drop over a winding: 8 rad/s are left.
    for index, name in ((1, "left"), (2, "right")):
        counted = (8.0, 16.0) if index == 1 else (16.0, 8.0)
        healthy, wrong = Robot(), Robot()
        for _ in range(2):
            said = healthy.sees(counted, (16.0, 16.0), lasts_ns=SPEED_NS, currents_a=of(index, 2.0))
            assert said == ""
            wrong.sees(counted, (16.0, 16.0), lasts_ns=SPEED_NS, currents_a=of(3 - index, 2.0))
        assert "encoder" in str(wrong.monitors.fault)
        hot = Robot()
        for _ in range(2):
            # 125 degC: 0.39 times 4 V more, 3.1 rad/s less.
            hot.sees(
                counted,
                (16.0, 16.0),
                lasts_ns=SPEED_NS,
                currents_a=of(index, 2.0),
                temperatures_c=of(index, 325.0, 25.0),
            )
        assert str(hot.monitors.fault).startswith(f"{name} encoder")


def test_duties_within_the_dead_band_turn_nothing() -> None:
    robot = Robot()
    still = (math.copysign(1e-300, 1.0), -1e-300)  # duties of just the dead band
    for _ in range(100):
        assert robot.sees((0.0, 0.0), still, lasts_ns=5 * MS, supply_v=1000.0) == ""


def test_nothing_is_compared_while_the_bridges_are_off() -> None:
    robot = Robot()
    for number in range(3):
        said = robot.sees((0.0, 0.0), enable=False, lasts_ns=2000 * MS, jumps=9 * number)
        assert said == ""
    # Nor does the time before count.
    assert robot.sees((0.0, 0.0), lasts_ns=1) == ""
    assert robot.sees((0.0, 0.0), lasts_ns=SPEED_NS) != ""


SWAPPED = "left and right encoders are swapped"


def test_encoders_that_each_fit_the_other_motor_are_called_swapped() -> None:
    # Off by 16 rad/s where 4 are tolerated: a quarter of the time.
    robot = Robot()
    robot.sees((-8.0, 8.0), (8.0, -8.0))
    assert robot.sees((-8.0, 8.0), (8.0, -8.0), lasts_ns=SPEED_NS // 4) == ""
    assert robot.sees((-8.0, 8.0), (8.0, -8.0), lasts_ns=1) == SWAPPED


@pytest.mark.parametrize(
    ("counted", "swapped"),
    [
        ((-16.0, 16.0), True),
        ((below(-16.0), 16.0), False),
        ((-16.0, above(16.0)), False),
        ((-10.0, 30.0), False),
        ((-30.0, 10.0), False),
        ((-5.5, 5.5), True),
        ((above(-5.5), 5.5), False),
        ((-5.5, below(5.5)), False),
    ],
)
def test_a_swap_fits_within_the_tolerance_on_both_sides(
    counted: tuple[float, float], swapped: bool
) -> None:
    robot = Robot()
    robot.sees(counted, (10.0, -10.0))
    fault = robot.sees(counted, (10.0, -10.0), lasts_ns=SPEED_NS)
    assert fault == SWAPPED if swapped else fault.startswith("left encoder reversed")


def test_encoders_are_called_swapped_only_where_both_are_off() -> None:
    """One whose count fits both motors is not, so that the other alone is wrong."""
    for counted, electrical, said in (
        ((9.0, 1.0), (5.0, 10.0), "right encoder wrong"),
        ((1.0, 9.0), (10.0, 5.0), "left encoder wrong"),
    ):
        robot = Robot()
        robot.sees(counted, electrical)
        fault = robot.sees(counted, electrical, lasts_ns=SPEED_NS)
        assert fault.startswith(said), fault


def test_one_wheel_alone_is_never_swapped_nor_apart() -> None:
    robot = Robot(wheels=1)
    for _ in range(3):
        assert robot.sees((7.0,), lasts_ns=2000 * MS) == ""
    robot.sees((-8.0,), lasts_ns=1)
    fault = robot.sees((-8.0,), lasts_ns=SPEED_NS)
    assert fault.startswith("left encoder reversed: -8.0 rad/s")


@pytest.mark.parametrize(
    ("counted", "apart"),
    [
        ((8.0, 7.0), False),
        ((8.0, below(7.0)), True),
        ((7.0, 8.0), False),
        ((below(7.0), 8.0), True),
    ],
)
def test_wheels_whose_ratios_differ_for_a_second_contradict_each_other(
    counted: tuple[float, float], apart: bool
) -> None:
    robot = Robot()
    assert robot.sees(counted) == ""
    assert robot.sees(counted, lasts_ns=1000 * MS) == ""
    fault = robot.sees(counted, lasts_ns=1)
    one, other = (f"{speed / 8.0:.2f}" for speed in counted)
    expected = (
        "left and right wheel contradict each other: counted over electrical speed is "
        f"{one} and {other}"
    )
    assert fault == (expected if apart else "")


def test_wheels_are_not_compared_while_one_of_them_is_slow() -> None:
    robot = Robot()
    robot.sees((8.0, 6.0))
    robot.sees((8.0, 3.0), (8.0, 3.9375), lasts_ns=600 * MS)
    assert robot.sees((8.0, 6.0), lasts_ns=600 * MS) == ""
    assert robot.sees((8.0, 6.0), lasts_ns=1000 * MS + 1).startswith("left and right wheel")


@pytest.mark.parametrize("index", [1, 2])
def test_a_wheel_that_pushes_is_named(index: int) -> None:
    current = {"currents_a": of(index, 1.0)}
    counted = (4.0, 8.0) if index == 1 else (8.0, 4.0)
    robot = Robot()
    robot.sees(counted, **current)
    assert robot.sees(counted, lasts_ns=300 * MS, **current) == ""
    name = ("left", "right")[index - 1]
    said = f"{name} wheel pushes against something: 1.0 A, no faster"
    assert robot.sees(counted, lasts_ns=1, **current) == said


@pytest.mark.parametrize(("a_max_rad_s2", "pushes"), [(6.0, False), (math.inf, True)])
def test_a_robot_that_may_gain_little_need_not_gain_more(a_max_rad_s2: float, pushes: bool) -> None:
    robot = Robot(a_max_rad_s2=a_max_rad_s2)
    robot.sees((4.0, 8.0), currents_a=(1.0, 0.0))
    said = robot.sees((5.0, 8.0), lasts_ns=300 * MS + 1, currents_a=(1.0, 0.0))
    assert ("pushes against something" in said) is pushes


def test_three_jumps_within_a_second_are_a_fault_and_two_are_none() -> None:
    for base in (0, 1, 40):
        robot = Robot()
        robot.sees((8.0, 8.0), jumps=base)
        assert robot.sees((8.0, 8.0), jumps=base + 2, lasts_ns=500 * MS) == ""
        fault = robot.sees((8.0, 8.0), jumps=base + 3, lasts_ns=500 * MS)
        assert fault == "encoder counts jump: 3 times within a second"


@pytest.mark.parametrize("first_ms", [0, 990, 1990])
def test_three_jumps_are_found_wherever_their_second_begins(first_ms: int) -> None:
    robot = Robot()
    robot.sees((8.0, 8.0), lasts_ns=first_ms * MS)
    assert robot.sees((8.0, 8.0), jumps=1, lasts_ns=10 * MS) == ""
    assert robot.sees((8.0, 8.0), jumps=2, lasts_ns=500 * MS) == ""
    fault = robot.sees((8.0, 8.0), jumps=3, lasts_ns=500 * MS)
    assert fault == "encoder counts jump: 3 times within a second"


def test_jumps_farther_apart_are_no_fault() -> None:
    robot = Robot()
    robot.sees((8.0, 8.0))
    for number in range(1, 20):
        assert robot.sees((8.0, 8.0), jumps=number, lasts_ns=500 * MS + 1) == ""
    fault = robot.sees((8.0, 8.0), jumps=21, lasts_ns=1000 * MS)
    assert fault == "encoder counts jump: 3 times within a second"


def test_many_jumps_at_once_are_a_fault_and_say_so_once() -> None:
    robot = Robot()
    robot.sees((8.0, 8.0))
    fault = robot.sees((8.0, 8.0), jumps=1000, lasts_ns=10 * MS)
    assert fault == "encoder counts jump: 3 times within a second"


def test_the_first_fault_stays_until_the_robot_is_armed_again() -> None:
    robot = Robot()
    robot.sees((0.0, 8.0))
    first = robot.sees((0.0, 8.0), lasts_ns=SPEED_NS)
    assert first.startswith("left encoder stuck")
    assert robot.sees((8.0, 0.0), lasts_ns=10, jumps=7) == first
    assert robot.sees((8.0, 0.0), lasts_ns=SPEED_NS, jumps=20) == first
    robot.monitors.reset()
    assert robot.monitors.fault is None
    # What stood before does not count, nor do the jumps.
    assert robot.sees((8.0, 0.0), lasts_ns=10, jumps=99) == ""
    assert robot.sees((8.0, 0.0), lasts_ns=SPEED_NS, jumps=99).startswith("right encoder stuck")


def test_after_a_reset_a_pair_has_its_whole_time_again() -> None:
    robot = Robot()
    robot.sees((8.0, 6.0))
    robot.monitors.reset()
    assert robot.sees((8.0, 6.0), lasts_ns=1001 * MS) == ""
    assert robot.sees((8.0, 6.0), lasts_ns=1000 * MS) == ""
    assert robot.sees((8.0, 6.0), lasts_ns=1) != ""
