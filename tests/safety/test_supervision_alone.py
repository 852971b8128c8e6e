"""Supervision by itself: what it passes to monitors, which fault comes first, power unasked for."""

from __future__ import annotations

import math

import msgspec
import pytest

from robotctl.messages.actuators import ActuatorCommand, DriveState
from robotctl.messages.control import (
    BusState,
    BusStatus,
    EmergencyMessage,
    Feedback,
    ImuFeedback,
    Stranger,
    StrangerKind,
)
from robotctl.messages.faults import Fault, FaultCode
from robotctl.model.sensors.imu import ImuConfig
from robotctl.model.sensors.sonar import SonarMount
from robotctl.safety import supervision
from robotctl.safety.causes import AFTER_NS, RETURN_NS
from robotctl.safety.monitor import Monitored, MonitorInputs
from robotctl.safety.plausibility_config import PlausibilityConfig
from robotctl.safety.supervision import Supervision
from tests.native_frames import WHEELS, age_limits
from tests.safety.test_health import (
    DRIVE,
    GOOD,
    MOTOR,
    MS,
    NAMES,
    NOW,
    PERIOD_NS,
    SAFETY,
    WANTED,
    frames,
)
from tests.safety.test_health import (
    WHEELS as WHEELS_NOW,
)

replace = msgspec.structs.replace
FIRST = Fault(FaultCode.ENCODER_STUCK, "the first", "left")
LATER = Fault(FaultCode.ENCODER_WRONG, "a later one", "right")
MOUNTS = tuple(SonarMount(name, 0.0, 0.1, 90.0) for name in NAMES)
ROBOT = Monitored(PlausibilityConfig(1.5, 0.45), WHEELS, 0.02, (), 50.0, MOUNTS, ImuConfig())
COMMAND = ActuatorCommand(enable=True)
LIMIT_NS = SAFETY.command_timeout_ms * MS + 50 * MS


class Told:
    """A monitor that finds what it is told and keeps what it was given."""

    def __init__(self, _robot: Monitored) -> None:
        self.found: Fault | None = None
        self.inputs: list[MonitorInputs] = []
        self.resets = 0

    def reset(self) -> None:
        self.resets += 1

    def update(self, inputs: MonitorInputs) -> Fault | None:
        self.inputs.append(inputs)
        return self.found


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> Supervision:
    monkeypatch.setattr(supervision, "MONITORS", (Told, Told))
    return Supervision(SAFETY, age_limits(WANTED, SAFETY, PERIOD_NS), ROBOT)


def enabled(stamp_ns: int) -> Feedback:
    return frames(motor=replace(MOTOR, state=DriveState.ENABLED, stamp_ns=stamp_ns))


@pytest.mark.parametrize(("late_ns", "is_fault"), [(0, False), (1, True)])
def test_power_is_unasked_for_once_the_drives_time_out_and_some_grace_are_over(
    alone: Supervision, late_ns: int, is_fault: bool
) -> None:
    alone.powered(NOW)
    assert alone.unasked() is None, "nothing was heard of the drive"
    alone.health.update(enabled(NOW + LIMIT_NS + late_ns))
    expected = "emergency stop: the motor controller is enabled without a command"
    fault = Fault(FaultCode.DRIVES_UNASKED, expected, "drive")
    assert alone.unasked() == (fault if is_fault else None)


@pytest.mark.parametrize("state", [state for state in DriveState if state != DriveState.ENABLED])
def test_a_drive_without_power_needs_no_command(alone: Supervision, state: DriveState) -> None:
    alone.health.update(frames(motor=replace(MOTOR, state=state, stamp_ns=NOW + 10 * LIMIT_NS)))
    assert alone.unasked() is None


def test_before_any_command_the_grace_counts_from_the_start(alone: Supervision) -> None:
    alone.health.update(enabled(LIMIT_NS))
    assert alone.unasked() is None
    alone.health.update(enabled(LIMIT_NS + 1))
    assert alone.unasked() is not None


def test_monitors_get_all_of_the_tick(alone: Supervision) -> None:
    motion = object()
    alone.compare(GOOD, COMMAND, motion)
    for monitor in alone._monitors:
        assert monitor.inputs == [MonitorInputs(GOOD, COMMAND, motion)]


def test_the_first_contradiction_is_kept_until_the_robot_is_armed_again(
    alone: Supervision,
) -> None:
    alone.health.update(enabled(NOW))
    one, other = alone._monitors
    assert alone.fault(NOW) is None
    one.found, other.found = FIRST, LATER
    alone.compare(GOOD, COMMAND, None)
    one.found, other.found = LATER, None
    alone.compare(GOOD, COMMAND, None)
    assert alone.fault(NOW) == FIRST
    one.found = None
    alone.armed(NOW)
    assert (one.resets, other.resets) == (1, 1)
    alone.compare(GOOD, COMMAND, None)
    assert alone.fault(NOW) is None


def test_wheels_that_did_not_get_the_command_are_not_to_blame(alone: Supervision) -> None:
    motor = replace(MOTOR, state=DriveState.ENABLED)
    alone.health.update(frames(motor=motor, drive=replace(DRIVE, command_age_ms=100)))
    assert alone.fault(NOW) is None, "alone it stops nobody"
    alone._monitors[0].found = FIRST
    alone.compare(GOOD, COMMAND, None)
    assert alone.fault(NOW).code is FaultCode.COMMAND_LOSS
    stale = NOW + 16 * MS
    assert alone.fault(stale).code is FaultCode.WHEELS_STALE, "health comes first"


def test_a_robot_at_rest_is_armed_and_one_that_tells_nothing_is_not(alone: Supervision) -> None:
    codes = [fault.code for fault in alone.refusals(NOW, (0.0, 0.0), None, enabled=False)]
    assert FaultCode.BATTERY_MISSING in codes
    assert FaultCode.MOTOR_STALE in codes
    alone.health.update(GOOD)
    assert alone.refusals(NOW, (0.0, 0.0), None, enabled=False) == ()


@pytest.mark.parametrize("lost", ["motor", "drive", "battery"])
def test_values_are_judged_only_once_all_have_come(alone: Supervision, lost: str) -> None:
    lacking = replace(GOOD, battery=None) if lost == "battery" else frames(**{lost: None})
    alone.health.update(lacking)
    assert len(alone.refusals(NOW, (9.0, 0.0), None, enabled=False)) == 1


def test_values_that_cannot_be_speak_against_arming(alone: Supervision) -> None:
    alone.health.update(frames(motor=replace(MOTOR, temperatures_c=(math.nan, 25.0))))
    assert len(alone.refusals(NOW, (0.0, 0.0), None, enabled=False)) >= 1


@pytest.mark.parametrize(("up", "codes"), [((0.0, 0.0, 1.0), []), ((0.5, 0.0, 0.866), [123])])
def test_a_tilted_robot_is_not_armed(
    alone: Supervision, up: tuple[float, float, float], codes: list[int]
) -> None:
    alone.health.update(GOOD)
    imu = ImuFeedback(NOW, NOW, (0.0, 0.0, 0.0), (0.0, 0.0, 9.81), up)
    found = alone.refusals(NOW, (0.0, 0.0), imu, enabled=False)
    assert [fault.code for fault in found] == codes


SENDER = Stranger(StrangerKind.HOST_FRAME, "Sync", 0x80, "", 1, NOW, NOW)
SECOND = Stranger(StrangerKind.SECOND_SENDER, "WheelFeedback", 0x181, "drive", 9, NOW, NOW)
LATE_NS = 20 * MS
"""Then wheel feedback is too old."""


def heard(alone: Supervision, now_ns: int = NOW, age_ns: int = 0, **changes: object) -> Supervision:
    """Let supervision take good feedback of some age, with changes."""
    wheels = replace(WHEELS_NOW, stamp_ns=now_ns - age_ns)
    fresh = replace(frames(wheels=wheels), **changes)
    alone.take(fresh, now_ns)
    return alone


def test_another_sender_stops_a_robot_of_which_all_else_is_well(alone: Supervision) -> None:
    assert heard(alone).fault(NOW) is None
    heard(alone, strangers=(SENDER,))
    fault = alone.fault(NOW)
    assert fault is not None
    assert fault.code is FaultCode.BUS_STRANGER
    first, *_ = alone.refusals(NOW, (0.0, 0.0), None, enabled=False)
    assert first == fault


def test_a_node_that_a_stranger_put_out_of_service_says_more_than_the_frame(
    alone: Supervision,
) -> None:
    out = replace(GOOD.nodes[0], problem="drive: stopped (NMT)", fault=FaultCode.NODE_PUT_OUT)
    heard(alone, strangers=(SENDER,), nodes=(out, *GOOD.nodes[1:]))
    fault = alone.fault(NOW)
    assert fault is not None
    assert fault.code is FaultCode.NODE_PUT_OUT


def test_what_people_were_told_by_the_stop_is_no_notice(alone: Supervision) -> None:
    heard(alone, strangers=(SENDER,))
    alone.fault(NOW)
    assert alone.strangers.take_notices(NOW + 10_000 * MS) == []


def silenced(alone: Supervision) -> Fault:
    """Stop for wheel feedback that is too old."""
    heard(alone, age_ns=LATE_NS)
    fault = alone.fault(NOW)
    assert fault is not None
    assert fault.code is FaultCode.WHEELS_STALE
    return fault


def test_a_cause_that_shows_up_behind_a_stop_is_returned_once(alone: Supervision) -> None:
    symptom = silenced(alone)
    later_ns = NOW + 100 * MS
    assert alone.later_cause(NOW + MS) is None
    passive = BusStatus(state=BusState.ERROR_PASSIVE, error_frames=20)
    heard(alone, later_ns, LATE_NS, bus=passive)
    cause = alone.later_cause(later_ns)
    assert cause is not None
    assert cause.code is FaultCode.BUS_PASSIVE
    assert cause.text.endswith(f": {symptom}")
    assert alone.later_cause(later_ns + MS) is None
    emergency = EmergencyMessage(later_ns + 2 * MS, 1, 0x3220, 0)
    heard(alone, later_ns + 2 * MS, LATE_NS, bus=passive, emergencies=(emergency,))
    nearer = alone.later_cause(later_ns + 2 * MS)
    assert nearer is not None
    assert nearer.code is FaultCode.DRIVE_UNDER_VOLTAGE


@pytest.mark.parametrize(("after_ns", "counts"), [(AFTER_NS, True), (AFTER_NS + 1, False)])
def test_what_shows_up_later_is_another_matter(
    alone: Supervision, after_ns: int, counts: bool
) -> None:
    silenced(alone)
    later_ns = NOW + after_ns
    heard(alone, later_ns, LATE_NS, bus=BusStatus(state=BusState.BUS_OFF))
    cause = alone.later_cause(later_ns)
    assert (cause is not None) == counts
    assert alone.later_cause(later_ns + MS) is None, "the stop is not judged again"


BACK = Fault(FaultCode.NODE_SILENT, "drive (node 1) was silent and is back", "drive")


@pytest.mark.parametrize(
    ("after_ns", "back", "counts"),
    [
        (MS, BACK, True),
        (RETURN_NS, BACK, True),
        (RETURN_NS + 1, BACK, False),
        (MS, Fault(BACK.code, BACK.text, "power"), False),
    ],
)
def test_a_node_that_is_back_is_the_cause_of_its_silence(
    alone: Supervision, after_ns: int, back: Fault, counts: bool
) -> None:
    symptom = Fault(FaultCode.WHEELS_STALE, "nothing heard", "drive")
    heard(alone)
    alone.explained(symptom, NOW)
    cause = alone.later_cause(NOW + after_ns, (back,))
    assert (cause is not None) == counts
    assert cause is None or cause == Fault(back.code, f"{back.text}: {symptom}", "drive")
    alone.armed(NOW + after_ns)
    assert alone.later_cause(NOW + after_ns + MS, (back,)) is None


def test_frames_that_waited_out_a_silence_are_no_power_without_a_command(
    alone: Supervision,
) -> None:
    back_ns = NOW + 1000 * MS
    alone.powered(NOW)
    alone.health.update(enabled(NOW))
    for late_ns, is_fault in ((0, False), (50 * MS, False), (50 * MS + 1, True)):
        alone.health.update(enabled(back_ns + late_ns))
        assert (alone.unasked() is not None) == is_fault


def test_a_second_sender_that_is_told_behind_the_silence_it_made_is_its_cause(
    alone: Supervision,
) -> None:
    symptom = silenced(alone)
    bus = BusStatus(state=BusState.BUS_OFF)
    heard(alone, NOW + 10 * MS, LATE_NS, strangers=(SECOND,), bus=bus)
    cause = alone.later_cause(NOW + 10 * MS)
    assert cause is not None
    assert (cause.code, cause.part) == (FaultCode.NODE_DOUBLED, "drive")
    assert cause.text.endswith(f": {symptom}")
    assert alone.later_cause(NOW + 11 * MS) is None
    assert alone.strangers.take_notices(NOW + 10_000 * MS) == []


def test_a_fault_that_is_no_silence_has_no_other_cause(alone: Supervision) -> None:
    heard(alone)
    assert alone.explained(FIRST, NOW) == FIRST
    heard(alone, NOW + MS, strangers=(SECOND,), bus=BusStatus(state=BusState.BUS_OFF))
    assert alone.later_cause(NOW + MS) is None


def test_before_any_stop_there_is_no_cause(alone: Supervision) -> None:
    heard(alone, strangers=(SECOND,), bus=BusStatus(state=BusState.BUS_OFF))
    assert alone.later_cause(NOW) is None
