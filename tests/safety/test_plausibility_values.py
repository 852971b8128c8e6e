"""Steering, clocks and single values that no healthy sensor says, each bound from both sides."""

import math
from dataclasses import replace as changed

import msgspec
import pytest

from robotctl.messages.actuators import ActuatorCommand, ActuatorFeedback, DriveState
from robotctl.messages.control import BatteryFeedback
from robotctl.messages.faults import FaultCode
from robotctl.safety.monitor import MonitorInputs
from robotctl.safety.plausibility import Plausibility
from robotctl.safety.plausibility_values import SensorValues
from tests.native_frames import WHEEL_AND_STEERING, WHEELS
from tests.safety.exact_tolerances import CONFIG, MS, T0, above, below
from tests.safety.monitored import inputs, monitored

replace = msgspec.structs.replace
WHEEL = ActuatorFeedback(report_ns=T0, state=DriveState.ENABLED, current_a=0.0, temperature_c=25.0)
BATTERY = BatteryFeedback(T0, 12.0, 1.0, 0.8, 25.0, False, False)


def steer(
    told: float,
    stands: float,
    *,
    lasts_ns: int = 600 * MS + 1,
    enable: bool = True,
) -> str:
    monitors = Plausibility(monitored(WHEEL_AND_STEERING, joint_max_rad=(0.5,)))
    for stamp_ns in (T0, T0 + lasts_ns):
        monitors.update(steering(stamp_ns, stands, told, enable=enable))
    return str(monitors.fault or "")


def steering(stamp_ns: int, stands: float, told: float, *, enable: bool = True) -> MonitorInputs:
    """Inputs with a steering that stands at an angle [rad] and was commanded to another."""
    joint = ActuatorFeedback(motion_ns=stamp_ns, angle_rad=stands)
    return inputs((ActuatorFeedback(), joint), ActuatorCommand(enable, False, (0.0, told)), (0.0,))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_steering_may_differ_by_its_tolerance_for_ever_and_by_more_for_its_time(
    sign: float,
) -> None:
    told = sign * 0.125
    assert steer(told, told + sign * 0.25) == ""
    assert steer(told, told - sign * 0.25) == ""
    far = above(0.375)
    assert steer(told, sign * far, lasts_ns=600 * MS) == ""
    said = f"the steering is at {sign * 0.375:.2f} rad, commanded to {told:.2f} rad"
    assert steer(told, sign * far) == said
    assert steer(told, -sign * 0.126) != ""


def test_steering_is_not_judged_while_the_bridges_are_off_nor_where_there_is_none() -> None:
    assert steer(0.4, -0.4) != ""
    assert steer(0.4, -0.4, enable=False) == ""
    without = Plausibility(monitored())
    for stamp_ns in (T0, T0 + 601 * MS):
        reports = (ActuatorFeedback(motion_ns=stamp_ns, angle_rad=1.0),) * 2
        assert without.update(inputs(reports, ActuatorCommand(True, False, (0.0, 0.0)))) is None


def test_after_a_reset_the_steering_has_its_whole_time_again() -> None:
    monitors = Plausibility(monitored(WHEEL_AND_STEERING, joint_max_rad=(0.5,)))

    def at(time_ns: int) -> str:
        monitors.update(steering(T0 + time_ns, 0.0, 0.4))
        return str(monitors.fault or "")

    at(0)
    monitors.reset()
    assert at(601 * MS) == ""
    assert at(1201 * MS) == ""
    assert at(1201 * MS + 1) != ""


class Clocks:
    """Feedback every 5 ms of the host, latched at every `step_us` of the drive."""

    def __init__(self, first_us: int = 1_048_000, share: float = 0.03, at_ns: int = T0) -> None:
        config = changed(CONFIG, clock_share=share)
        self.monitors = Plausibility(monitored(config=config))
        self.latch_us, self.stamp_ns = first_us, at_ns
        self.take()

    def take(self) -> None:
        wheel = ActuatorFeedback(motion_ns=self.stamp_ns, latch_us=self.latch_us & 0xFFFFF)
        self.monitors.update(inputs((wheel, wheel), ActuatorCommand()))

    def step(self, step_us: int, step_ns: int = 5 * MS, times: int = 1) -> str:
        for _ in range(times):
            self.latch_us += step_us
            self.stamp_ns += step_ns
            self.take()
        return str(self.monitors.fault or "")


def test_a_clock_may_run_off_by_its_share_and_no_more() -> None:
    """400 steps of 5 ms are one window; 3 % of 5 ms are 150 us."""
    for step_us in (5000, 5149, 4851):
        assert Clocks().step(step_us, times=2000) == ""
    for step_us, percent in ((5151, "+3.0%"), (4849, "-3.0%"), (6000, "+20.0%")):
        clocks = Clocks()
        assert clocks.step(step_us, times=399) == ""
        assert clocks.step(step_us) == f"the drive's clock runs {percent} against the host's"


def test_the_share_itself_is_allowed_and_a_microsecond_more_in_a_window_is_not() -> None:
    """One 32nd of two seconds is 62,500 us to the bit; in the first window and in the next."""
    for windows in (1, 2):
        for last_us, judged in ((5157, False), (5158, True)):
            clocks = Clocks(share=1 / 32)
            clocks.step(5000, times=400 * (windows - 1))
            for _ in range(99):
                clocks.step(5156, times=3)
                clocks.step(5157)
            assert clocks.step(5156, times=3) == ""
            assert bool(clocks.step(last_us)) == judged


@pytest.mark.parametrize("first_us", [0, 1, 0xFFFFF])
def test_the_first_latch_only_begins_the_window(first_us: int) -> None:
    for at_ns in (0, T0):
        assert Clocks(first_us, at_ns=at_ns).step(5000, times=1000) == ""
    clocks = Clocks(first_us)
    assert clocks.step(6000, times=399) == ""
    assert clocks.step(6000) != ""


def test_each_window_is_judged_by_itself() -> None:
    clocks = Clocks()
    assert clocks.step(5000, times=400) == ""
    assert clocks.step(5200, times=399) == ""
    assert clocks.step(5200).startswith("the drive's clock runs +4.0%")


def test_a_gap_of_more_than_half_a_second_begins_a_new_window() -> None:
    for gap_ns, judged in ((500 * MS, True), (500 * MS + 1, False)):
        clocks = Clocks()
        clocks.step(5000, times=300)
        fault = clocks.step(600_000, gap_ns)
        assert bool(fault) == judged
    clocks = Clocks()
    clocks.step(6000, times=399)
    clocks.step(5000, 600 * MS)
    assert clocks.step(5000, times=800) == ""


def test_after_a_reset_the_next_latch_begins_a_window() -> None:
    clocks = Clocks()
    clocks.step(6000, times=399)
    clocks.monitors.reset()
    assert clocks.step(6000) == ""
    assert clocks.step(5000, times=800) == ""


WORDS = {
    FaultCode.TEMPERATURE_WRONG: ("temperature",),
    FaultCode.CURRENT_WRONG: ("current",),
    FaultCode.SUPPLY_WRONG: ("supply",),
    FaultCode.STEERING_WRONG: ("steering",),
}


def values(
    left: dict[str, float | None] | None = None,
    right: dict[str, float | None] | None = None,
    *,
    speeds: tuple[float, ...] = (0.0, 0.0),
    enabled: bool = False,
    battery_v: float = 12.0,
    supply_v: float | None = 12.0,
    steering_rad: float | None = 0.0,
) -> tuple[str, ...]:
    """Return the texts of a robot with two wheels and a steering."""
    robot = (*WHEELS, WHEEL_AND_STEERING[-1])
    reports = (
        replace(WHEEL, voltage_v=supply_v, **(left or {})),
        replace(WHEEL, voltage_v=supply_v, **(right or {})),
        ActuatorFeedback(angle_rad=steering_rad, voltage_v=supply_v),
    )
    found = SensorValues(robot, (0.5,), CONFIG.steering_tolerance_rad).faults(
        reports,
        replace(BATTERY, voltage_v=battery_v),
        speeds,
        enabled=enabled,
    )
    for fault in found:
        assert any(word in fault.text for word in WORDS[fault.code]), fault
        assert fault.text.startswith(fault.part)
    return tuple(fault.text for fault in found)


def of(index: int, **wrong: float) -> tuple[dict[str, float], ...]:
    """Values of wheel 1 or 2."""
    return (wrong,) if index == 1 else ({}, wrong)


@pytest.mark.parametrize(("index", "name"), [(1, "left"), (2, "right")])
def test_a_temperature_that_no_motor_has_is_named(index: int, name: str) -> None:
    for allowed in (-30.0, 180.0):
        assert values(*of(index, temperature_c=allowed)) == ()
    for refused, said in (
        (below(-30.0), "-30"),
        (above(180.0), "180"),
        (-40.0, "-40"),
        (math.nan, "nan"),
    ):
        expected = f"{name} motor's temperature sensor says {said} degC"
        assert values(*of(index, temperature_c=refused)) == (expected,)


@pytest.mark.parametrize(("index", "name"), [(1, "left"), (2, "right")])
def test_a_current_at_rest_with_the_bridge_off_is_named(index: int, name: str) -> None:
    others = (0.0, 9.0) if index == 1 else (9.0, 0.0)
    for current_a in (1.0, -1.0):
        assert values(*of(index, current_a=current_a)) == ()
    for current_a, said in ((above(1.0), "1"), (-2.5, "-2.5")):
        expected = (f"{name} motor's current sensor says {said} A, at rest",)
        assert values(*of(index, current_a=current_a)) == expected
        # The other wheel's speed is no excuse; its own is.
        assert values(*of(index, current_a=current_a), speeds=others) == expected
        assert values(*of(index, current_a=current_a), speeds=others[::-1]) == ()
        assert values(*of(index, current_a=current_a), enabled=True) == ()
        assert values(*of(index, current_a=current_a), speeds=(0.5, -0.5)) == ()
        assert values(*of(index, current_a=current_a), speeds=(below(0.5), -below(0.5))) == expected


def test_a_current_that_is_no_number_is_named_at_any_time() -> None:
    for current_a in (math.nan, math.inf, -math.inf):
        found = values({"current_a": current_a}, speeds=(9.0, 9.0), enabled=True)
        assert found == (f"left motor's current sensor says {current_a:g} A, at rest",)


@pytest.mark.parametrize(
    ("supply_v", "battery_v", "contradict"),
    [
        (10.0, 8.0, False),
        (6.0, 8.0, False),
        (above(10.0), 8.0, True),
        (below(6.0), 8.0, True),
        # From 10 V on a fifth of the battery's voltage is more than 2 V.
        (24.0, 20.0, False),
        (16.0, 20.0, False),
        (above(24.0), 20.0, True),
        (below(16.0), 20.0, True),
        (math.nan, 12.0, True),
        (12.0, math.nan, True),
    ],
)
def test_supply_and_battery_may_differ_by_2_v_or_a_fifth(
    supply_v: float, battery_v: float, contradict: bool
) -> None:
    said = f"supply {supply_v:.1f} V and battery {battery_v:.1f} V contradict"
    found = values(supply_v=supply_v, battery_v=battery_v)
    assert found == ((said,) if contradict else ())


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_steering_beyond_its_linkage_is_named_where_there_is_one(sign: float) -> None:
    assert values(steering_rad=sign * 0.75) == ()
    said = f"the steering says {sign * 0.75:.2f} rad, beyond its linkage"
    assert values(steering_rad=sign * above(0.75)) == (said,)
    assert values(steering_rad=math.nan) != ()
    assert (
        SensorValues(WHEELS, (), 0.25).faults(
            (replace(WHEEL, angle_rad=sign * 9.0),) * 2, BATTERY, (0.0, 0.0), enabled=False
        )
        == ()
    )


def test_all_that_is_wrong_is_named_at_once() -> None:
    found = values(
        {"temperature_c": 200.0, "current_a": 3.0},
        {"current_a": math.nan},
        supply_v=5.0,
        steering_rad=1.5,
    )
    assert found == (
        "left motor's temperature sensor says 200 degC",
        "left motor's current sensor says 3 A, at rest",
        "right motor's current sensor says nan A, at rest",
        "supply 5.0 V and battery 12.0 V contradict",
        "the steering says 1.50 rad, beyond its linkage",
    )


def test_what_a_drive_does_not_tell_is_not_wrong() -> None:
    untold = {"current_a": None, "temperature_c": None}
    assert values(untold, untold, supply_v=None, steering_rad=None) == ()
