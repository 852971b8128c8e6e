"""Steering, clocks and single values that no healthy sensor says, each bound from both sides."""

import math
from dataclasses import replace as changed

import msgspec
import pytest

from robotctl.messages.control import (
    BatteryFeedback,
    DriveState,
    DriveStatus,
    MotorStatus,
    WheelCommand,
    WheelFeedback,
)
from robotctl.messages.faults import FaultCode
from robotctl.safety.plausibility import Plausibility
from robotctl.safety.plausibility_values import SensorValues
from tests.safety.exact_tolerances import CONFIG, DEADBAND, MS, T0, above, below

replace = msgspec.structs.replace
MOTOR = MotorStatus(T0, DriveState.ENABLED, 0.0, 0.0, 25.0, 25.0, 0)
DRIVE = DriveStatus(T0, 0, 0.0, 12.0, 1, 0)
BATTERY = BatteryFeedback(T0, 12.0, 1.0, 0.8, 25.0, False, False)


def steer(
    told: float,
    stands: float,
    *,
    lasts_ns: int = 600 * MS + 1,
    enable: bool = True,
    steering_max_rad: float = 0.5,
) -> str:
    monitors = Plausibility(CONFIG, ("drive",), DEADBAND, steering_max_rad, math.inf)
    for stamp_ns in (T0, T0 + lasts_ns):
        status = DriveStatus(stamp_ns, 0, stands, 12.0, 1, 0)
        monitors.take_drive(status, WheelCommand(enable, False, 0.0, 0.0, told))
    return str(monitors.fault or "")


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
    assert steer(0.4, -0.4, steering_max_rad=0.0) == ""
    assert steer(0.4, -0.4, steering_max_rad=0.5) != ""


def test_after_a_reset_the_steering_has_its_whole_time_again() -> None:
    monitors = Plausibility(CONFIG, ("drive",), DEADBAND, 0.5, math.inf)
    command = WheelCommand(True, False, 0.0, 0.0, 0.4)

    def at(time_ns: int) -> str:
        monitors.take_drive(DriveStatus(T0 + time_ns, 0, 0.0, 12.0, 1, 0), command)
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
        self.monitors = Plausibility(config, ("drive",), DEADBAND, 0.0, math.inf)
        self.latch_us, self.stamp_ns = first_us, at_ns
        self.monitors.take_wheels(WheelFeedback(at_ns, first_us, 0, 0))

    def step(self, step_us: int, step_ns: int = 5 * MS, times: int = 1) -> str:
        for _ in range(times):
            self.latch_us += step_us
            self.stamp_ns += step_ns
            latch_us = self.latch_us & 0xFFFFF
            self.monitors.take_wheels(WheelFeedback(self.stamp_ns, latch_us, 0, 0))
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
    motor: dict[str, float] | None = None,
    drive: dict[str, float] | None = None,
    *,
    speeds: tuple[float, ...] = (0.0, 0.0),
    enabled: bool = False,
    battery_v: float = 12.0,
    steering: float = 0.5,
) -> tuple[str, ...]:
    """Return the texts."""
    names = ("left", "right")[: len(speeds)]
    found = SensorValues(names, steering, CONFIG.steering_tolerance_rad).faults(
        replace(MOTOR, **(motor or {})),
        replace(DRIVE, **(drive or {})),
        replace(BATTERY, voltage_v=battery_v),
        speeds,
        enabled=enabled,
    )
    for fault in found:
        assert any(word in fault.text for word in WORDS[fault.code]), fault
        assert fault.text.startswith(fault.part)
    return tuple(fault.text for fault in found)


@pytest.mark.parametrize(("index", "name"), [(1, "left"), (2, "right")])
def test_a_temperature_that_no_motor_has_is_named(index: int, name: str) -> None:
    for allowed in (-30.0, 180.0):
        assert values({f"temperature{index}_c": allowed}) == ()
    for refused, said in (
        (below(-30.0), "-30"),
        (above(180.0), "180"),
        (-40.0, "-40"),
        (math.nan, "nan"),
    ):
        expected = f"{name} motor's temperature sensor says {said} degC"
        assert values({f"temperature{index}_c": refused}) == (expected,)


@pytest.mark.parametrize(("index", "name"), [(1, "left"), (2, "right")])
def test_a_current_at_rest_with_the_bridge_off_is_named(index: int, name: str) -> None:
    key = f"current{index}_a"
    others = (0.0, 9.0) if index == 1 else (9.0, 0.0)
    for current_a in (1.0, -1.0):
        assert values({key: current_a}) == ()
    for current_a, said in ((above(1.0), "1"), (-2.5, "-2.5")):
        expected = (f"{name} motor's current sensor says {said} A, at rest",)
        assert values({key: current_a}) == expected
        # The other wheel's speed is no excuse; its own is.
        assert values({key: current_a}, speeds=others) == expected
        assert values({key: current_a}, speeds=others[::-1]) == ()
        assert values({key: current_a}, enabled=True) == ()
        assert values({key: current_a}, speeds=(0.5, -0.5)) == ()
        assert values({key: current_a}, speeds=(below(0.5), -below(0.5))) == expected


def test_a_current_that_is_no_number_is_named_at_any_time() -> None:
    for current_a in (math.nan, math.inf, -math.inf):
        found = values({"current1_a": current_a}, speeds=(9.0, 9.0), enabled=True)
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
    found = values(drive={"bus_voltage_v": supply_v}, battery_v=battery_v)
    assert found == ((said,) if contradict else ())


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_steering_beyond_its_linkage_is_named_where_there_is_one(sign: float) -> None:
    far = {"steering_rad": sign * above(0.75)}
    assert values(drive={"steering_rad": sign * 0.75}) == ()
    said = f"the steering says {sign * 0.75:.2f} rad, beyond its linkage"
    assert values(drive=far) == (said,)
    assert values(drive={"steering_rad": math.nan}) != ()
    assert values(drive={"steering_rad": sign * 9.0}, steering=0.0) == ()


def test_all_that_is_wrong_is_named_at_once() -> None:
    found = values(
        {"temperature1_c": 200.0, "current1_a": 3.0, "current2_a": math.nan},
        {"bus_voltage_v": 5.0, "steering_rad": 1.5},
    )
    assert found == (
        "left motor's temperature sensor says 200 degC",
        "left motor's current sensor says 3 A, at rest",
        "right motor's current sensor says nan A, at rest",
        "supply 5.0 V and battery 12.0 V contradict",
        "the steering says 1.50 rad, beyond its linkage",
    )


def test_a_single_wheel_has_the_first_channel_alone() -> None:
    assert values({"current2_a": 9.0, "temperature2_c": -40.0}, speeds=(0.0,)) == ()
