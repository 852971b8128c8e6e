"""Commissioning of an ODrive, what is read back, and messages that say nothing."""

from __future__ import annotations

import struct

import pytest

from firmware_sim.plant.axis import Mode
from robotctl.drivers.can.drives.axis import AxisConfig
from robotctl.drivers.can.drives.odrive.config import ODriveMotor
from robotctl.drivers.can.drives.odrive.settings import ODriveSettings, answer_of
from robotctl.errors import InvalidValue
from robotctl.messages.actuators import DriveState
from robotctl.messages.faults import FaultCode
from robotctl.safety.state_machine import SafetyConfig
from tests.drivers.can.drives.odrive.rig import NEW, OLD, TICK_NS, Rig

BOTH = pytest.mark.parametrize("firmware", [OLD, NEW], ids=["0.5.6", "0.6.10"])
NAN = struct.pack("<ff", float("nan"), 0.0)


def powered(rig):
    return [axis.mode is not Mode.COAST for axis in rig.plant.axes]


def test_the_watchdog_of_0_6_is_written_read_back_and_told():
    rig = Rig().start()
    assert rig.drives[0].proof == (
        "firmware 0.6.10 on 5.2.0: axis0.config.watchdog_timeout 0.09 s, "
        "axis0.config.enable_watchdog on, read back"
    )
    status = rig.drives[0].status
    assert (status.nmt_state, status.boots, status.problem) == (5, 1, "")


def test_the_watchdog_of_0_5_cannot_be_read_and_that_is_told():
    rig = Rig(**OLD).start()
    assert rig.drives[0].proof == (
        "firmware 0.5: the watchdog cannot be read (firmware 0.5 does not tell it over CAN); set "
        "with odrivetool, to give no power 90 ms after the last command"
    )


@pytest.mark.parametrize(
    "settings",
    [
        {"firmware": (0, 6, 11)},
        {"hardware": (4, 4, 58)},
        {"unreleased": True},
    ],
)
def test_of_a_firmware_without_known_endpoints_nothing_is_written(settings):
    rig = Rig(**settings).start()
    assert "cannot be read (its endpoints are not known" in rig.drives[0].proof
    assert "to give no power 90 ms" in rig.drives[0].proof
    assert not [can_id for _, can_id, _ in rig.sent if can_id & 0x1F == 0x04]


def test_endpoints_can_be_named_in_the_table():
    rig = Rig(
        {"watchdog_endpoints": (300, 301)},
        firmware=(0, 6, 11),
        hardware=(4, 4, 58),
        sdo_endpoints=(300, 301),
    ).start()
    assert rig.drives[0].proof.startswith("firmware 0.6.11 on 4.4.58: axis0.config.watchdog_time")
    assert rig.drives[0].proof.endswith("read back")


def test_named_endpoints_that_the_drive_has_not_are_no_answer():
    rig = Rig({"watchdog_endpoints": (300, 301)})
    rig.run(1500)
    status = rig.drives[0].status
    assert status.fault is FaultCode.NODE_NO_ANSWER
    assert "read of axis0.config.watchdog_timeout (endpoint 300)" in status.problem


@pytest.mark.parametrize("version", [(0, 7, 1), (1, 0, 0)])
def test_an_unknown_firmware_is_refused_by_name(version):
    rig = Rig(firmware=version)
    rig.run(800)
    status = rig.drives[0].status
    assert status.fault is FaultCode.NODE_OTHER_FIRMWARE
    assert ".".join(map(str, version)) in status.problem
    assert rig.drives[0].proof is None
    rig.drive(3.0)
    rig.run(300)
    assert powered(rig) == [False, False]


@pytest.mark.parametrize("answer", [(2, 5, 2, 0, 0, 4, 12, 0), (3, 5, 2, 0, 0, 6, 10, 0), (0,) * 8])
def test_only_0_6_with_the_protocol_that_is_documented_is_served(answer):
    script = ODriveSettings(33, 90).commission()
    next(script)
    with pytest.raises(StopIteration) as stop:
        script.send(answer_of(0x00, bytes(answer)))
    assert stop.value.value.code is FaultCode.NODE_OTHER_FIRMWARE


def test_a_node_that_answers_neither_query_is_said_not_to():
    rig = Rig()
    rig.twins[0].connect(None, lambda *_: None)
    for _ in range(120):
        rig.tick()
        if rig.now_ns % (20 * TICK_NS) == 0:
            rig.deliver(33, 0x01, bytes((0, 0, 0, 0, 1, 0, 0, 0)))
    rig.drives[0].check(rig.now_ns)
    assert rig.drives[0].status.fault is FaultCode.NODE_NO_ANSWER
    assert "Get_Version" in rig.drives[0].status.problem


def test_a_setting_that_is_not_taken_keeps_the_drive_out_of_service():
    rig = Rig()
    rig.twins[0].watchdog.access = lambda opcode, endpoint, value: struct.pack("<f", 0.2)
    rig.run(1200)
    status = rig.drives[0].status
    assert status.fault is FaultCode.NODE_OTHER_VALUE
    assert "watchdog_timeout reads back 0.2 s, wanted 0.09 s" in status.problem


def test_a_drive_that_says_that_it_starts_up_has_restarted():
    rig = Rig().start()
    rig.deliver(33, 0x01, bytes((1, 0, 0, 0, 0, 0, 0, 0)))
    rig.drives[0].check(rig.now_ns)
    assert rig.drives[0].status.boots == 2
    assert rig.faults[0].code is FaultCode.NODE_RESTARTED
    rig.run(500)
    assert rig.drives[0].status.problem == ""
    assert rig.states[0] is DriveState.STOPPED


def test_a_request_to_clear_does_not_outlive_the_loss_of_the_drive():
    rig = Rig().start().enable(3.0)
    twin, port = rig.twins[0], rig.twins[0]._port
    twin.trip(0x20)
    rig.run(50)
    rig.drives[0].clear_faults()
    rig.tick()
    twin._port = None
    rig.run(500)
    assert rig.drives[0].status.fault is FaultCode.NODE_SILENT
    rig.drives[0].clear_faults()
    rig.run(50)
    twin._port = port
    rig.run(1500)
    assert rig.drives[0].status.problem == ""
    assert rig.faults[0] is not None


@pytest.mark.parametrize(("setting", "words"), [("timeout", "0.5 s"), ("is_on", "off")])
def test_a_setting_changed_while_driving_stops_and_is_named(setting, words):
    rig = Rig().start().enable(3.0)
    value = struct.pack("<f", 0.5) if setting == "timeout" else False
    setattr(rig.twins[0].watchdog, setting, value)
    rig.run_until(lambda: rig.drives[0].status.problem)
    status = rig.drives[0].status
    assert status.fault is FaultCode.NODE_CHANGED
    assert words in status.problem
    assert rig.drives[0].proof is None
    rig.run(50)
    assert powered(rig)[0] is False
    # It is written again, and in service again, but nothing resumes.
    rig.run(1500)
    assert rig.drives[0].status.problem == ""
    assert rig.faults[0].code is FaultCode.NODE_CHANGED
    assert powered(rig)[0] is False


def test_a_damaged_reading_alone_stops_nothing():
    rig = Rig().start().enable(3.0)
    drive = rig.drives[0]
    reading = 33 << 5 | 0x04
    rig.run_until(lambda: (rig.now_ns, reading) in [each[:2] for each in rig.sent[-8:]])
    endpoint = drive._settings.kept[0].endpoint
    rig.deliver(33, 0x05, struct.pack("<BHB4s", 0, endpoint, 0, b"\x13\x00\x00\x00"))
    rig.run(800)
    assert drive.status.problem == ""
    assert rig.faults[0] is None


def test_a_drive_that_answers_no_reading_any_more_stops():
    rig = Rig().start().enable(3.0)
    rig.twins[0]._handlers[33 << 5 | 0x04] = lambda *_: None
    rig.run_until(lambda: rig.drives[0].status.problem, 5000)
    assert rig.drives[0].status.fault is FaultCode.NODE_NO_ANSWER
    rig.run(50)
    assert powered(rig)[0] is False


UNREADABLE = [
    (0x09, NAN, "nan turns"),
    (0x09, struct.pack("<ff", 0.0, float("inf")), "inf turn/s"),
    (0x09, bytes(4), "it has 8 bytes"),
    (0x09, b"", "no bytes"),
    (0x14, NAN, "motor current"),
    (0x17, NAN, "bus voltage"),
    (0x17, bytes(7), "it has 8 bytes"),
    (0x01, bytes(5), "heartbeat"),
    (0x01, bytes((0, 0, 0, 0, 99, 0, 0, 0)), "axis state 99"),
    (0x03, bytes(3), "error"),
]


@BOTH
@pytest.mark.parametrize(("command", "data", "words"), UNREADABLE)
def test_a_message_that_says_nothing_stops_and_says_what_came(firmware, command, data, words):
    rig = Rig(**firmware).start().enable(3.0)
    rig.deliver(33, command, data)
    rig.run(20)
    assert rig.faults[0].code is FaultCode.DRIVE_UNREADABLE
    assert words in str(rig.faults[0])
    assert data.hex(" ") in str(rig.faults[0])
    assert rig.states[0] is DriveState.FAULT
    rig.run(100)
    assert powered(rig)[0] is False


@pytest.mark.parametrize(
    ("firmware", "data"),
    [
        (OLD, bytes((0, 0, 0, 0, 8, 14, 0, 0))),  # a result of 0.6: NOT_CALIBRATED
        (NEW, bytes((0, 0, 0, 0, 8, 0, 0x20, 0x80))),
    ],
)
def test_a_heartbeat_of_another_layout_stops(firmware, data):
    rig = Rig(**firmware).start().enable(3.0)
    rig.deliver(33, 0x01, data)
    rig.run(50)
    assert rig.faults[0].code is FaultCode.DRIVE_UNREADABLE
    assert powered(rig)[0] is False


def test_a_motor_without_a_sensor_has_no_number_for_its_temperature():
    rig = Rig(motor_thermistor=False, inverter_c=41.0).start()
    assert rig.report(0).temperature_c == pytest.approx(41.0)
    assert rig.faults == [None, None]


def table(**more):
    axes = more.pop("axes", (AxisConfig("left"),))
    return ODriveMotor("odrive", "left", axes, more.pop("node_id", 33), **more)


@pytest.mark.parametrize(
    ("more", "key"),
    [
        ({"node_id": 63}, "node_id"),
        ({"node_id": -1}, "node_id"),
        ({"axes": ()}, "axes"),
        ({"axes": (AxisConfig("left", 2),)}, "axes"),
        ({"axes": (AxisConfig("left"), AxisConfig("right", 2))}, "axes"),
        ({"watchdog_endpoints": (213,)}, "watchdog_endpoints"),
        ({"watchdog_endpoints": (213, 213)}, "watchdog_endpoints"),
        ({"watchdog_endpoints": (0, 213)}, "watchdog_endpoints"),
        ({"watchdog_endpoints": (213, 70000)}, "watchdog_endpoints"),
    ],
)
def test_a_wrong_table_is_refused_by_key(more, key):
    with pytest.raises(InvalidValue) as found:
        table(**more)
    assert found.value.key == key


def test_ages_fit_what_comes_when():
    ages = {age.field: age for age in table().ages(SafetyConfig(), TICK_NS)}
    assert ages["motion"].limit_ns == 3 * TICK_NS
    assert ages["report"].limit_ns == 350_000_000
    assert ages["supply"].limit_ns == 200_000_000
    slow = {age.field: age for age in table().ages(SafetyConfig(), 10 * TICK_NS)}
    assert slow["supply"].limit_ns == 1_000_000_000
