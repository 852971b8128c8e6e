"""The host's drive against the twin on a simulated bus, each dialect with a plant behind it."""

import math
import random
import struct

import pytest

from firmware_sim.drives.cia402.settings import Cia402Settings
from firmware_sim.drives.cia402.state import State
from robotctl.drivers.can.drives.cia402.eds import find_eds
from robotctl.messages.actuators import ActuatorCommand, DriveState
from robotctl.messages.faults import FaultCode
from tests.drivers.can.drives.cia402.rig import (
    BRAKE,
    DIALECTS,
    FAKE_EDS,
    GENERIC,
    MS,
    NODE,
    OFF,
    ROBOTEQ,
    TICK_NS,
    TICKS_PER_TURN,
    ZLAC,
    Rig,
)

LEFT = ({"actuator": "left"},)
FAULTS = {
    "generic": (
        (0x2310, FaultCode.DRIVE_OVER_CURRENT, "over-current (0x2310)"),
        (0x3210, FaultCode.DRIVE_OVER_VOLTAGE, "over-voltage (0x3210)"),
        (0x3220, FaultCode.DRIVE_UNDER_VOLTAGE, "under-voltage (0x3220)"),
        (0x4310, FaultCode.DRIVE_OVER_TEMPERATURE, "over-temperature"),
        (0x7305, FaultCode.DRIVE_ENCODER, "incremental sensor 1"),
        (0x6320, FaultCode.DRIVE_PARAMETER, "parameter error"),
        (0x8130, FaultCode.DRIVE_COMMAND_TIMEOUT, "heartbeat of the host lost"),
        (0x7121, FaultCode.DRIVE_FAULT, "motor blocked"),
        (0xFF01, FaultCode.DRIVE_FAULT, "error 0xFF01"),
    ),
    "zlac8015d": (
        (0x0001, FaultCode.DRIVE_OVER_VOLTAGE, "over-voltage"),
        (0x0002, FaultCode.DRIVE_UNDER_VOLTAGE, "under-voltage"),
        (0x0004, FaultCode.DRIVE_OVER_CURRENT, "over-current"),
        (0x0008, FaultCode.DRIVE_OVER_CURRENT, "overload"),
        (0x0020, FaultCode.DRIVE_ENCODER, "encoder"),
        (0x0100, FaultCode.DRIVE_PARAMETER, "EEPROM"),
        (0x0200, FaultCode.DRIVE_ENCODER, "Hall"),
        (0x0400, FaultCode.DRIVE_OVER_TEMPERATURE, "temperature"),
        (0x0006, FaultCode.DRIVE_UNDER_VOLTAGE, "under-voltage, over-current (0x0006)"),
    ),
    "roboteq": (
        (0x01, FaultCode.DRIVE_OVER_TEMPERATURE, "overheat"),
        (0x02, FaultCode.DRIVE_OVER_VOLTAGE, "over-voltage"),
        (0x04, FaultCode.DRIVE_UNDER_VOLTAGE, "under-voltage"),
        (0x08, FaultCode.DRIVE_OVER_CURRENT, "short circuit"),
        (0x10, FaultCode.DRIVE_EMERGENCY_STOP, "emergency stop"),
        (0x40, FaultCode.DRIVE_FAULT, "MOSFET"),
        (0x80, FaultCode.DRIVE_PARAMETER, "default configuration"),
    ),
}


@pytest.fixture(params=DIALECTS)
def dialect(request):
    return request.param


@pytest.fixture
def rig(dialect):
    return Rig(DIALECTS[dialect])


class TestDriving:
    def test_it_drives_both_ways_and_stops(self, rig):
        rig.driving(4.0, 4.0)
        assert rig.speeds == pytest.approx([4.0, 4.0], abs=0.06)
        for report, axis in zip(rig.drive.reports, rig.wheels, strict=True):
            assert report.speed_rad_s == pytest.approx(axis.speed_rad_s, abs=0.1)
            turns = axis.angle_rad / (2.0 * math.pi)
            assert report.position_ticks == pytest.approx(turns * TICKS_PER_TURN, abs=40)
        rig.drives(-3.0, 3.0)
        assert rig.speeds == pytest.approx([-3.0, 3.0], abs=0.06)
        rig.drives(0.0, 0.0)
        assert rig.speeds == pytest.approx([0.0, 0.0], abs=0.02)
        assert rig.powered
        rig.run(50, OFF)
        assert not rig.powered
        assert rig.states == [DriveState.READY] * 2
        assert rig.fault is None

    def test_it_does_not_enable_by_itself(self, rig):
        rig.in_service().run(500)
        assert not rig.powered
        assert rig.states == [DriveState.READY] * 2

    def test_it_is_enabled_within_100_ms(self, rig):
        rig.in_service().drives(0.0, 0.0, ms=100)
        assert rig.states == [DriveState.ENABLED] * 2

    @pytest.mark.parametrize("command", [OFF, BRAKE], ids=["coast", "brake"])
    def test_disabled_it_loses_power_at_once_and_braked_it_is_soon_at_rest(
        self, dialect, rig, command
    ):
        rig.driving(6.0, 6.0).run(20, command)
        coasted = Rig(DIALECTS[dialect]).driving(6.0, 6.0).run(400, OFF)
        rig.run(380, command)
        assert not rig.powered
        if command is BRAKE:
            assert max(map(abs, rig.speeds)) < 0.5 * max(map(abs, coasted.speeds))
        assert rig.fault is None
        rig.drives(2.0, 2.0)
        assert rig.speeds == pytest.approx([2.0, 2.0], abs=0.06)

    @pytest.mark.parametrize("ratio", [1.0, 3.5])
    @pytest.mark.parametrize("is_reversed", [False, True])
    def test_speed_position_and_current_are_those_of_the_wheel(self, dialect, ratio, is_reversed):
        axis = {"actuator": "left", "ratio": ratio, "reversed": is_reversed}
        rig = Rig(DIALECTS[dialect], (axis,), max_rad_s=10.0)
        rig.driving(3.0, ms=400)
        [report] = rig.drive.reports
        assert report.speed_rad_s == pytest.approx(3.0, abs=0.1)
        assert rig.speeds == pytest.approx([3.0], abs=0.1)
        turns = rig.wheels[0].angle_rad / (2.0 * math.pi)
        assert report.position_ticks == pytest.approx(turns * TICKS_PER_TURN, abs=40)
        rig.drives(8.0, ms=60)
        assert rig.wheels[0].current_a > 0.5
        if dialect != "roboteq":  # whose current comes by SDO, seldom
            assert rig.drive.reports[0].current_a == pytest.approx(rig.wheels[0].current_a, rel=0.5)

    def test_a_counter_that_rolls_over_does_not_show(self, rig):
        rig.in_service()
        for axis in rig.twin.axes:
            count = axis.motor.encoder_count
            start = (1 << 31) - 300 - count(4096)
            axis.motor.encoder_count = lambda per_turn, c=count, s=start: c(per_turn) + s
        rig.run(20)
        before = rig.drive.reports[0].position_ticks
        rig.drives(4.0, -4.0, ms=1000)
        moved = rig.drive.reports[0].position_ticks - before
        assert 0 < moved < 2 * TICKS_PER_TURN

    def test_voltage_and_temperature_are_told_where_the_drive_does(self, dialect, rig):
        rig.in_service().run(1000)
        [left, right] = rig.drive.reports
        assert left.voltage_v == pytest.approx(rig.plant.bus_voltage_v, abs=0.2)
        assert right.voltage_v == left.voltage_v
        told = None if dialect == "generic" else pytest.approx(25.0, abs=1.0)
        assert left.temperature_c == told
        assert rig.now_ns - left.supply_ns < 1000 * MS

    def test_a_speed_beyond_the_drive_saturates(self):
        rig = Rig(ZLAC, LEFT).driving(500.0, ms=20)
        [(_, _, data)] = [sent for sent in rig.sent if sent[1] == 0x200 + NODE][-1:]
        assert struct.unpack("<Hhh", data) == (0x0F, 1000, 0)


class TestHostFallsSilent:
    """At most the time-out and one period from the last command to no power, in each dialect."""

    @pytest.mark.parametrize("seed", range(25))
    @pytest.mark.parametrize(
        ("table", "settings"),
        [
            (GENERIC, Cia402Settings()),
            (ZLAC, Cia402Settings(off_line_frames="all")),
            (ZLAC, Cia402Settings(off_line_frames="commands", off_line_reaction="fault")),
            (ZLAC, Cia402Settings(off_line_reaction="coast", ramps_are_full_scale=False)),
        ],
        ids=["generic", "zlac", "zlac-fault", "zlac-coast"],
    )
    def test_no_power_in_time_and_nothing_resumes(self, seed, table, settings):
        rng = random.Random(seed)
        rig = Rig(table, settings=settings)
        rig.driving(*(rng.uniform(-8.0, 8.0) for _ in range(2)), ms=5 * rng.randint(30, 80))
        rig.is_silent = True
        last_ns = rig.now_ns
        rig.until(lambda: not rig.powered, ms=300)
        assert rig.now_ns - last_ns <= 100 * MS + TICK_NS + MS
        rig.run(300)
        assert not rig.powered
        rig.is_silent = False
        rig.run(500)
        assert not rig.powered
        assert rig.fault is not None or rig.drive.status.problem

    def test_without_stop_at_the_current_limit_it_brakes_by_its_ramp(self):
        rig = Rig(GENERIC, settings=Cia402Settings(stop_options=(0, 1, 2)))
        rig.driving(8.0, 8.0)
        assert rig.drive.proof.endswith("605Eh:0 = 2, 685Eh:0 = 2")
        rig.is_silent = True
        rig.run(110)
        assert all(axis.state is State.FAULT_REACTION_ACTIVE for axis in rig.twin.axes)
        rig.run(300)
        assert not rig.powered
        assert max(map(abs, rig.speeds)) < 0.1

    def test_the_drive_says_why_when_the_host_is_back(self):
        rig = Rig(GENERIC).driving(3.0, 3.0)
        rig.is_silent = True
        rig.run(300)
        rig.is_silent = False
        rig.run(50)
        assert rig.fault.code is FaultCode.DRIVE_COMMAND_TIMEOUT
        assert str(rig.fault) == "left: heartbeat of the host lost (0x8130)"
        assert rig.states == [DriveState.FAULT] * 2

    def test_a_drive_without_the_objects_does_as_it_does_and_the_host_said_so(self):
        """Both ways: what no document says is true of the twin."""
        table = {"eds": FAKE_EDS, "counts_per_turn": 4096, "accept_coasting": True}
        lacks = ("6007", "603F", "6078", "6079")
        ends = {}
        for lost in ("none", "coast", "brake"):
            settings = Cia402Settings(vendor=0x555, lacks=lacks, lost_reaction=lost)
            rig = Rig(table, LEFT, settings=settings).driving(5.0)
            assert rig.drive.proof.startswith("1016h:1 = 100 ms of node 127, 1029h:1 = 2")
            rig.is_silent = True
            rig.run(300)
            ends[lost] = rig.powered
        assert ends == {"none": True, "coast": False, "brake": False}

    def test_node_guarding_where_there_is_no_heartbeat_consumer(self, tmp_path):
        text = find_eds("drives/cia402.eds").read_text().replace("[1016", "[9016")
        path = tmp_path / "guarded.eds"
        path.write_text(text)
        table = {"eds": str(path), "counts_per_turn": 4096}
        rig = Rig(table, settings=Cia402Settings(lacks=("1016",))).driving(4.0, 4.0)
        assert "100Ch:0 = 50 ms, 100Dh:0 = 2" in rig.drive.proof
        assert rig.twin.dictionary.number(0x1017) == 0
        rig.is_silent = True
        rig.run(110)
        assert not rig.powered


class TestFaults:
    @pytest.mark.parametrize(
        ("kind", "code", "ours", "words"),
        [(kind, *each) for kind, faults in FAULTS.items() for each in faults],
    )
    def test_each_code_stops_with_its_meaning_until_cleared(self, kind, code, ours, words):
        rig = Rig(DIALECTS[kind]).driving(3.0, 3.0, ms=200)
        rig.twin.trip(code, 0)
        rig.run(50)
        assert (rig.fault.code, rig.fault.part) == (ours, "motors")
        assert words in str(rig.fault)
        assert DriveState.ENABLED not in rig.states
        rig.run(400)
        assert not rig.powered
        # The cause is still there: clearing does not help.
        rig.drive.clear_faults()
        rig.run(300, OFF)
        assert rig.fault is not None
        rig.twin.heal()
        rig.drive.clear_faults()
        rig.run(300, OFF)
        assert rig.fault is None
        rig.drives(2.0, 2.0, ms=300)
        assert rig.states == [DriveState.ENABLED] * 2

    def test_one_wheel_in_fault_stops_both(self, rig):
        rig.driving(3.0, 3.0, ms=300)
        rig.twin.trip(0x0001, 1)
        rig.run(400)
        assert not rig.powered
        assert rig.fault is not None

    def test_a_fault_that_clears_itself_keeps_it_stopped(self, dialect):
        rig = Rig(DIALECTS[dialect], settings=Cia402Settings(heals=True)).driving(3.0, 3.0)
        rig.twin.trip(0x0002)
        rig.run(400)
        rig.twin.heal()
        rig.run(500)
        assert [axis.state for axis in rig.twin.axes] == [State.SWITCH_ON_DISABLED] * 2
        assert not rig.powered
        assert rig.states == [DriveState.FAULT] * 2
        rig.drive.clear_faults()
        rig.run(200)  # the command still wants power
        assert not rig.powered
        rig.run(20, OFF).drives(2.0, 2.0, ms=200)
        assert rig.states == [DriveState.ENABLED] * 2

    def test_a_drive_that_disables_itself_is_stopped(self, rig):
        rig.driving(3.0, 3.0)
        for axis in rig.twin.axes:
            axis.release()
        rig.run(300)
        assert rig.fault.code is FaultCode.DRIVE_STOPPED
        assert "left operation enabled by itself" in str(rig.fault)
        assert rig.states == [DriveState.STOPPED] * 2
        assert not rig.powered

    def test_an_emergency_stop_holds_until_cleared(self, rig):
        rig.driving(5.0, 5.0)
        assert rig.stop()
        rig.run(60)
        assert not rig.powered
        assert rig.states == [DriveState.EMERGENCY_STOP] * 2
        assert rig.fault.code is FaultCode.DRIVE_EMERGENCY_STOP
        rig.run(500)
        assert not rig.powered
        rig.drive.clear_faults()
        rig.run(100)
        assert not rig.powered
        rig.run(20, OFF).drives(2.0, 2.0, ms=200)
        assert rig.states == [DriveState.ENABLED] * 2

    @pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
    def test_a_value_that_is_no_number_is_no_power(self, rig, value):
        rig.driving(3.0, 3.0).drives(value, 3.0, ms=50)
        assert not rig.powered
        assert rig.needs.notes.refused == 10
        rig.drives(3.0, 3.0, ms=300)
        assert not rig.powered, "resumes by itself"
        rig.run(20, OFF).drives(3.0, 3.0, ms=300)
        assert rig.powered


class TestWrongDrives:
    def test_a_reboot_while_driving_is_seen_and_not_resumed(self, rig):
        rig.driving(4.0, 4.0)
        boots = rig.drive.status.boots
        rig.twin.reboot(rig.now_ns)
        rig.run(100)
        assert rig.drive.status.problem
        rig.until(lambda: not rig.drive.status.problem)
        rig.run(300)
        assert rig.drive.status.boots == boots + 1
        assert not rig.powered
        rig.run(20, OFF).drives(4.0, 4.0, ms=300)
        assert rig.states == [DriveState.ENABLED] * 2

    def test_a_drive_that_is_gone_is_silent_and_comes_back_disabled(self, rig):
        rig.driving(4.0, 4.0)
        rig.is_cut = True
        rig.run(400)
        assert rig.drive.status.fault is FaultCode.NODE_SILENT
        assert rig.states == [DriveState.BOOT] * 2
        rig.is_cut = False
        rig.until(lambda: not rig.drive.status.problem)
        rig.run(300)
        assert not rig.powered

    def test_a_setting_changed_while_driving_takes_it_out_of_service(self, dialect, rig):
        if dialect == "roboteq":
            rig.driving(3.0, 3.0)
            rig.twin.dictionary.force(0x1017, 0, 1000)
        else:
            rig.driving(3.0, 3.0)
            index = 0x2000 if dialect == "zlac8015d" else 0x6007
            rig.twin.dictionary.force(index, 0, 3)
        rig.until(lambda: rig.drive.status.problem, ms=5000)
        assert rig.drive.status.fault is FaultCode.NODE_CHANGED
        assert "it was changed" in rig.drive.status.problem
        rig.run(400)
        assert not rig.powered

    def test_another_layout_is_unreadable_and_says_what_came(self, rig):
        rig.driving(3.0, 3.0)
        tpdo = 0x180 + NODE
        rig.drive.handlers[tpdo](b"\x27\x06\x01", rig.now_ns)
        rig.run(300)
        assert rig.fault.code is FaultCode.DRIVE_UNREADABLE
        assert "TPDO1 is 27 06 01, 8 bytes expected" in str(rig.fault)
        assert not rig.powered

    def test_a_status_word_of_no_state_is_unreadable(self):
        rig = Rig(GENERIC, LEFT).driving(3.0)
        rig.twin.dictionary.on_read(0x6041, 0, lambda: 0x0022)
        rig.run(200)
        assert rig.fault.code is FaultCode.DRIVE_UNREADABLE
        assert "status word 0x0022 is none of CiA 402" in str(rig.fault)

    def test_frames_of_an_old_session_are_nobody_s(self, rig):
        rig.drive.handlers[0x180 + NODE](b"\x01", rig.now_ns)
        rig.run(5)
        assert rig.fault is None

    @pytest.mark.parametrize(
        ("settings", "code", "words"),
        [
            ({"profile": 401}, FaultCode.NODE_OTHER_DEVICE, "profile 401 instead of 402"),
            ({"lacks": ("6007",)}, FaultCode.NODE_OTHER_FIRMWARE, "abort connection option"),
            ({"stop_options": (0,)}, FaultCode.NODE_OTHER_VALUE, "quick stop option"),
        ],
    )
    def test_another_device_or_firmware_is_refused(self, settings, code, words):
        rig = Rig(GENERIC, settings=Cia402Settings(**settings))
        rig.until(lambda: rig.drive.status.fault is code)
        assert words in rig.drive.status.problem
        rig.drives(3.0, 3.0, ms=300)
        assert not rig.powered

    def test_a_wrong_node_id_is_not_heard(self):
        rig = Rig(GENERIC, settings=Cia402Settings(node_id=6)).run(1000)
        assert rig.drive.status.fault is FaultCode.NODE_NOT_HEARD

    def test_a_drive_that_loses_hasty_requests_is_commissioned_all_the_same(self):
        Rig(ZLAC, settings=Cia402Settings(sdo_pause_ms=14.0)).in_service()

    def test_an_edge_that_was_lost_is_made_again(self, rig):
        rig.driving(3.0, 3.0, ms=200)
        rig.twin.trip(0x0001)
        rig.run(300)
        rig.twin.heal()
        real, lost = rig.send, []

        def send(arbitration_id, data):
            if arbitration_id == 0x200 + NODE and data[0] & 0x80 and len(lost) < 4:
                lost.append(data)
                return True
            return real(arbitration_id, data)

        rig.send = send
        rig.drive.clear_faults()
        rig.run(200, OFF)
        assert len(lost) == 4
        assert rig.fault is None


def test_only_the_host_may_send_its_commands_and_its_heartbeat():
    assert Rig(GENERIC).drive.host_frames.keys() == {0x000, 0x080, 0x205, 0x305, 0x77F}
    assert Rig(ZLAC).drive.host_frames.keys() == {0x000, 0x080, 0x205}


def test_velocity_mode_drives_too():
    table = {**GENERIC, "mode": "velocity"}
    rig = Rig(table).driving(4.0, -4.0)
    assert rig.speeds == pytest.approx([4.0, -4.0], abs=0.15)
    assert [report.speed_rad_s for report in rig.drive.reports] == pytest.approx(
        [4.0, -4.0], abs=0.15
    )
    assert rig.twin.dictionary.number(0x6061) in (0, 2)


def test_a_roboteq_whose_watchdog_nobody_knows_is_said_so():
    rig = Rig(ROBOTEQ).in_service()
    assert "its maker's tool decides" in rig.drive.proof
    assert rig.config.silence == "nothing that CANopen can set: as its maker's tool says"


def test_commands_are_atomic_and_nothing_but_them_is_sent_in_the_hot_path():
    rig = Rig(ZLAC).driving(3.0, 3.0)
    rig.sent.clear()
    rig.run(5, ActuatorCommand(enable=True, values=(1.0, -1.0)))
    ids = [identifier for _, identifier, _ in rig.sent]
    assert ids.count(0x200 + NODE) == 1
    assert set(ids) <= {0x200 + NODE, 0x600 + NODE}
