"""What silenced a node or the bus, by what was seen shortly before or behind."""

import msgspec
import pytest

from robotctl.drivers.can.nodes.motor import DriveStatus
from robotctl.messages.control import BusState, BusStatus, EmergencyMessage, Feedback
from robotctl.messages.faults import Fault, FaultCode
from robotctl.safety.causes import AFTER_NS, BEFORE_NS, ERRORS, SILENT_NS, TOGETHER_NS, Causes
from tests.native_frames import WHEELS, native_feedback

MS = 1_000_000
NOW = 10_000 * MS
STALE = Fault(FaultCode.WHEELS_STALE, "wheel feedback is older than 15 ms", "drive")
SONAR = Fault(FaultCode.SONAR_STALE, "sonar front has given no range for 250 ms", "front")
ENCODER = Fault(FaultCode.ENCODER_STUCK, "left encoder stuck or disconnected", "left")
SOUND = BusStatus(received=1000, sent=1000)


class Seen:
    """Evidence as it comes in, up to a stop at `NOW`."""

    def __init__(self):
        self.causes = Causes(WHEELS)
        self.feedback = native_feedback()
        self.bus = SOUND
        self.at(0)

    def at(self, before_ms, *, received=1, emergency=None, supply_v=None, **bus):
        """Take what was seen some time before the stop [ms]; negative: behind it."""
        now_ns = NOW - before_ms * MS
        self.bus = msgspec.structs.replace(self.bus, received=self.bus.received + received, **bus)
        errors = () if emergency is None else (EmergencyMessage(now_ns, 1, emergency, 0),)
        drive = None if supply_v is None else DriveStatus(now_ns, 0.0, supply_v, 0)
        self.feedback.update(None, None, drive)
        reports = self.feedback.reports
        self.causes.take(Feedback(bus=self.bus, emergencies=errors, actuators=reports), now_ns)
        return self

    def of(self, symptom=STALE, later_ms=0):
        return self.causes.explain(symptom, NOW, NOW + later_ms * MS)


def test_without_evidence_a_symptom_is_all_that_is_known():
    assert Seen().of().fault == STALE


@pytest.mark.parametrize(
    ("code", "cause", "words"),
    [
        (0x3220, FaultCode.DRIVE_UNDER_VOLTAGE, "under voltage"),
        (0x2310, FaultCode.DRIVE_OVER_CURRENT, "over current"),
        (0x4310, FaultCode.DRIVE_OVER_TEMPERATURE, "over temperature"),
    ],
)
def test_what_the_drive_reported_before_it_fell_silent_is_the_cause(code, cause, words):
    fault = Seen().at(80, emergency=code).of().fault
    assert fault.code is cause
    assert fault.part == "drive"
    assert fault.text == f"the motor controller reported {words}: {STALE}"


def test_the_drives_report_of_a_command_timeout_is_a_symptom_too():
    assert Seen().at(10, emergency=0x8130).of().fault == STALE


@pytest.mark.parametrize(("supplies", "fell"), [((12.6, 12.4, 8.3), True), ((12.6, 10.9), False)])
def test_a_supply_that_fell_is_the_cause_and_a_motor_that_starts_is_not(supplies, fell):
    seen = Seen()
    for n, supply_v in enumerate(supplies):
        seen.at(100 - 20 * n, supply_v=supply_v)
    fault = seen.of().fault
    assert (fault.code is FaultCode.DRIVE_UNDER_VOLTAGE) == fell
    assert not fell or fault.text.startswith(
        "the motor controller's supply fell from 12.4 to 8.3 V"
    )


def test_a_supply_that_sags_over_seconds_is_no_cause():
    seen = Seen()
    for n in range(400):
        seen.at(20 * (400 - n), supply_v=12.6 - n * 0.015)
    assert seen.of().fault == STALE


def test_what_the_drive_says_explains_its_own_silence_only():
    assert Seen().at(10, emergency=0x3220).of(SONAR).fault == SONAR


@pytest.mark.parametrize(("state", "code"), [(BusState.BUS_OFF, 10), (BusState.DOWN, 11)])
def test_a_bus_that_was_off_for_a_tick_is_the_cause_of_any_silence(state, code):
    seen = Seen().at(30, state=state).at(25, state=BusState.ERROR_ACTIVE)
    for symptom in (STALE, SONAR):
        assert seen.of(symptom).fault.code == code


def test_errors_that_come_together_are_the_cause_and_few_or_old_ones_are_not():
    assert Seen().at(10, error_frames=ERRORS).of().fault.code is FaultCode.BUS_ERRORS
    assert Seen().at(10, error_frames=ERRORS - 1).of().fault == STALE
    assert Seen().at(BEFORE_NS // MS + 1, error_frames=100).at(5).of().fault == STALE
    apart = Seen()
    for n in range(ERRORS):
        apart.at(10 + (TOGETHER_NS // MS + 1) * (ERRORS - n), error_frames=n + 1)
    assert apart.of().fault == STALE


def test_a_bus_that_became_error_passive_is_the_cause_and_one_that_has_been_is_not():
    passive = {"state": BusState.ERROR_PASSIVE}
    fault = Seen().at(10, error_frames=3, **passive).of().fault
    assert fault.code is FaultCode.BUS_PASSIVE
    assert fault.text == f"the CAN bus is error passive (3 error frames): {STALE}"
    assert Seen().at(5000, **passive).at(10, **passive).of().fault == STALE


def test_the_supply_is_nearer_to_the_root_than_errors_of_the_bus():
    seen = Seen().at(100, error_frames=50, state=BusState.ERROR_PASSIVE).at(60, emergency=0x3220)
    assert seen.of().fault.code is FaultCode.DRIVE_UNDER_VOLTAGE


@pytest.mark.parametrize(
    ("refused", "code"), [(0, FaultCode.BUS_SILENT), (3, FaultCode.BUS_BLOCKED)]
)
def test_a_bus_without_any_frame_is_told_from_a_silent_node_by_heartbeats(refused, code):
    seen = Seen().at(5)
    quiet_ms = SILENT_NS // MS - 5
    seen.at(-(quiet_ms - 6), received=0, send_failures=refused)
    assert seen.of(later_ms=quiet_ms - 1).fault == STALE
    late = seen.of(later_ms=quiet_ms)
    assert late.fault.code is code
    assert late.rank < seen.of().rank
    assert quiet_ms * MS < AFTER_NS


def test_one_heartbeat_proves_that_the_bus_works():
    seen = Seen().at(5).at(-100)
    assert seen.of(later_ms=200).fault == STALE


def test_what_is_no_silence_is_its_own_cause():
    seen = Seen().at(10, emergency=0x3220, error_frames=99, state=BusState.BUS_OFF)
    assert seen.of(ENCODER).fault is ENCODER
