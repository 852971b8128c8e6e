"""The twin of an ODrive by itself; requests and answers by the DBC files of odrive-can."""

from __future__ import annotations

import heapq
import itertools
import math
import struct
from functools import cache
from typing import NamedTuple

import pytest
from odrive_can import get_dbc
from pydantic import TypeAdapter, ValidationError

from firmware_sim.drives.odrive.config import ODriveMotor
from firmware_sim.drives.odrive.settings import ODriveSettings
from firmware_sim.drives.twin import Motor
from firmware_sim.nodes.parameter_store import MemoryStore
from firmware_sim.plant.axis import BrakeResistor, Limits, Mode

MS = 1_000_000
NODE = 33
REMOTE = 0x4000_0000
OLD, NEW, NEWER = (0, 5, 6), (0, 6, 10), (0, 6, 11)
DBC = {OLD: "odrive-cansimple-0.5.6", NEW: "odrive-cansimple-0.6.10"}
DBC[NEWER] = DBC[NEW]
VERSIONS = pytest.mark.parametrize("firmware", [OLD, NEW], ids=["0.5.6", "0.6.10"])


class Frame(NamedTuple):
    arbitration_id: int
    data: bytes
    stamp_ns: int


class FakeAxis:
    """A motor that has the speed it is told at once."""

    def __init__(self):
        self.mode, self.value = Mode.COAST, 0.0
        self.limits = Limits()
        self.angle_rad = 0.0
        self.voltage_v = self.supply_current_a = 0.0
        self.current_a, self.temperature_c = 2.0, 50.0

    def command(self, mode, value=0.0):
        self.mode, self.value = mode, value

    @property
    def speed_rad_s(self):
        return self.value if self.mode is Mode.SPEED else 0.0

    def encoder(self, counts):
        return FakeEncoder(self, counts)


class FakeEncoder:
    def __init__(self, axis, counts):
        self.axis, self.counts = axis, counts

    @property
    def count(self):
        return math.floor(self.axis.angle_rad / math.tau * self.counts)


class Stage:
    def __init__(self):
        self.bus_voltage_v = 24.0
        self.resistor = None

    def fit_brake_resistor(self, resistor):
        self.resistor = resistor


@cache
def database(firmware):
    return get_dbc(DBC[firmware])


class Bench:
    """A twin on a line without delay."""

    def __init__(self, firmware=NEW, store=None, **settings):
        self.firmware = firmware
        self.now_ns = 0
        self.sent = []
        self.alarms, self.order = [], itertools.count()
        self.axis, self.stage = FakeAxis(), Stage()
        made = ODriveSettings(firmware=firmware, **settings)
        table = TypeAdapter(ODriveMotor).validate_python(
            {"kind": "odrive", "name": "left", "axes": [{"actuator": "left"}], "node_id": NODE}
        )
        motor = Motor(self.axis, 1.0)
        store = store or MemoryStore()
        self.twin = table.make(made, (motor,), self.stage, lambda now_ns: now_ns, store)
        self.twin.connect(self, lambda due, _: heapq.heappush(self.alarms, (due, next(self.order))))
        self.twin.power_cycle(0)

    def send(self, arbitration_id, data):
        self.sent.append(Frame(arbitration_id, data, self.now_ns))

    def run(self, duration_ms):
        until_ns = self.now_ns + round(duration_ms * MS)
        while self.alarms and self.alarms[0][0] <= until_ns:
            self.now_ns = max(self.now_ns, heapq.heappop(self.alarms)[0])
            self.twin.wake(self.now_ns)
        self.now_ns = until_ns

    def boot(self):
        self.run(501)
        return self

    def deliver(self, command, data=b"", remote=False):
        can_id = NODE << 5 | command | (REMOTE if remote else 0)
        self.twin.on_frame(Frame(can_id, data, self.now_ns))

    def tell(self, name, **values):
        message = database(self.firmware).get_message_by_name(f"Axis0_{name}")
        data = message.encode({signal.name: 0 for signal in message.signals} | values)
        self.deliver(message.frame_id, data)

    def ask(self, name):
        """Return the decoded answer to a remote request, or None."""
        self.sent.clear()
        message = database(self.firmware).get_message_by_name(f"Axis0_{name}")
        self.deliver(message.frame_id, bytes(8), remote=True)
        if not self.sent:
            return None
        (frame,) = self.sent
        assert frame.arbitration_id == NODE << 5 | message.frame_id
        return message.decode(frame.data)

    def beat(self):
        """Return the next heartbeat, decoded."""
        self.sent.clear()
        self.run(101)
        beats = [each for each in self.sent if each.arbitration_id == NODE << 5 | 0x01]
        message = database(self.firmware).get_message_by_name("Axis0_Heartbeat")
        return {key: str(value) for key, value in message.decode(beats[-1].data).items()}

    def sdo(self, opcode, endpoint, value=b""):
        """Return the answers to a transfer."""
        self.sent.clear()
        self.deliver(0x04, struct.pack("<BHB", opcode, endpoint, 0) + value)
        return [frame.data for frame in self.sent if frame.arbitration_id == NODE << 5 | 0x05]

    def arm(self, turns_per_s=2.0):
        self.tell("Set_Controller_Mode", Control_Mode=2, Input_Mode=1)
        self.tell("Set_Input_Vel", Input_Vel=turns_per_s)
        self.tell("Set_Axis_State", Axis_Requested_State=8)
        self.run(5)
        return self


@VERSIONS
def test_it_is_silent_until_it_has_started_and_then_sends_by_itself(firmware):
    bench = Bench(firmware)
    bench.deliver(0x09, bytes(8), remote=True)
    bench.run(499)
    assert bench.sent == []
    bench.run(1001)
    ids = [frame.arbitration_id & 0x1F for frame in bench.sent]
    assert (ids.count(0x01), ids.count(0x09)) == (11, 101)


@VERSIONS
def test_it_drives_at_a_speed_only_in_closed_loop_velocity_control(firmware):
    bench = Bench(firmware).boot()
    bench.tell("Set_Input_Vel", Input_Vel=2.0)
    assert bench.axis.mode is Mode.COAST
    bench.tell("Set_Axis_State", Axis_Requested_State=8)
    bench.run(5)
    # Its default is position control.
    assert (bench.axis.mode, bench.axis.value) == (Mode.SPEED, 0.0)
    bench.tell("Set_Controller_Mode", Control_Mode=2, Input_Mode=1)
    assert bench.axis.value == pytest.approx(2.0 * math.tau)
    assert bench.beat()["Axis_State"] == "CLOSED_LOOP_CONTROL"
    bench.tell("Set_Axis_State", Axis_Requested_State=1)
    assert bench.axis.mode is Mode.COAST
    assert bench.beat()["Axis_State"] == "IDLE"


@VERSIONS
def test_speeds_saturate_at_vel_limit(firmware):
    bench = Bench(firmware, vel_limit=3.0).boot().arm(-7.0)
    assert bench.axis.value == pytest.approx(-3.0 * math.tau)


@VERSIONS
def test_a_motor_faster_than_the_tolerance_is_let_go(firmware):
    bench = Bench(firmware, vel_limit=3.0).boot().arm(1.0)
    bench.axis.value = 3.7 * math.tau
    bench.run(20)
    assert bench.axis.mode is Mode.COAST
    if firmware == OLD:
        assert str(bench.ask("Get_Controller_Error")["Controller_Error"]) == "OVERSPEED"
    else:
        assert str(bench.ask("Get_Error")["Disarm_Reason"]) == "VELOCITY_LIMIT_VIOLATION"


def test_only_0_6_answers_get_version():
    found = Bench(NEW, hardware=(5, 2, 0)).boot().ask("Get_Version")
    assert found["Protocol_Version"] == 2
    assert (found["Hw_Version_Major"], found["Hw_Version_Minor"]) == (5, 2)
    assert (found["Fw_Version_Minor"], found["Fw_Version_Revision"]) == (6, 10)
    old = Bench(OLD).boot()
    old.sent.clear()
    old.deliver(0x00, bytes(8), remote=True)
    assert old.sent == []


@VERSIONS
def test_a_request_is_a_remote_frame_or_one_without_data(firmware):
    bench = Bench(firmware).boot()
    bench.axis.angle_rad = 1.25 * math.tau
    assert bench.ask("Get_Encoder_Estimates")["Pos_Estimate"] == pytest.approx(1.25, abs=1e-3)
    bench.sent.clear()
    bench.deliver(0x14)
    assert struct.unpack("<ff", bench.sent[0].data)[1] == 2.0
    assert bench.ask("Get_Bus_Voltage_Current")["Bus_Voltage"] == 24.0


@VERSIONS
@pytest.mark.parametrize("phase_ms", [0.0, 3.7, 49.9])
def test_the_watchdog_takes_the_power_when_its_time_is_over(firmware, phase_ms):
    bench = Bench(firmware, watchdog_ms=90.0).boot()
    bench.tell("Set_Input_Vel", Input_Vel=0.0)
    bench.tell("Clear_Errors")
    bench.arm()
    bench.run(phase_ms)
    bench.tell("Set_Input_Vel", Input_Vel=2.0)
    bench.run(89.9)
    assert bench.axis.mode is Mode.SPEED
    bench.run(0.2)
    assert bench.axis.mode is Mode.COAST
    assert bench.beat()["Axis_Error"] == "WATCHDOG_TIMER_EXPIRED"
    # It is latched: no state can be entered.
    bench.arm()
    assert bench.axis.mode is Mode.COAST
    bench.tell("Set_Input_Vel", Input_Vel=2.0)
    bench.tell("Clear_Errors")
    bench.arm()
    assert bench.axis.mode is Mode.SPEED


@VERSIONS
def test_the_watchdog_is_off_by_default(firmware):
    bench = Bench(firmware).boot().arm()
    bench.run(10_000)
    assert bench.axis.mode is Mode.SPEED


@pytest.mark.parametrize(
    ("firmware", "settings", "feeds"),
    [
        (OLD, {}, True),
        (NEW, {"watchdog_fed_by": "any"}, True),
        (NEW, {"watchdog_fed_by": "set-points"}, False),
    ],
)
def test_a_request_feeds_the_watchdog_where_any_message_does(firmware, settings, feeds):
    bench = Bench(firmware, watchdog_ms=90.0, **settings).boot()
    bench.tell("Set_Input_Vel", Input_Vel=0.0)
    bench.tell("Clear_Errors")
    bench.arm()
    for _ in range(10):
        bench.run(20)
        bench.ask("Get_Iq")
    assert (bench.axis.mode is Mode.SPEED) is feeds


@pytest.mark.parametrize(
    ("firmware", "settings", "expires"),
    [
        (OLD, {}, True),
        (NEW, {}, True),
        (NEW, {"watchdog_while_idle": False}, False),
    ],
)
def test_the_watchdog_of_an_idle_axis(firmware, settings, expires):
    bench = Bench(firmware, watchdog_ms=90.0, **settings).boot()
    bench.run(200)
    assert bench.beat()["Axis_Error"] == ("WATCHDOG_TIMER_EXPIRED" if expires else "NONE")


def test_settings_are_read_and_written_by_sdo_and_kept_when_saved():
    store = MemoryStore()
    bench = Bench(NEW, store).boot()
    seconds = struct.pack("<f", 0.25)
    assert bench.sdo(1, 213, seconds) == []
    assert bench.sdo(1, 214, b"\1") == []
    assert bench.sdo(0, 213) == [struct.pack("<BHB", 0, 213, 0) + seconds]
    assert bench.sdo(0, 214) == [struct.pack("<BHB", 0, 214, 0) + b"\1"]
    assert bench.sdo(0, 999) == []
    bench.tell("Reboot", Action="reboot")
    bench.run(600)
    assert bench.sdo(0, 214)[0][4:] == b"\0"
    bench.tell("Set_Input_Vel", Input_Vel=0.0)
    bench.sdo(1, 213, seconds)
    bench.sdo(1, 214, b"\1")
    bench.tell("Reboot", Action="save_configuration")
    bench.run(600)
    assert bench.sdo(0, 213)[0][4:] == seconds
    bench.twin.power_cycle(bench.now_ns)
    bench.run(600)
    assert bench.sdo(0, 214)[0][4:] == b"\1"
    bench.tell("Reboot", Action="erase_configuration")
    bench.run(600)
    assert bench.sdo(0, 214)[0][4:] == b"\0"


def test_from_0_6_11_on_a_written_setting_is_confirmed():
    bench = Bench(NEWER).boot()
    assert bench.sdo(1, 214, b"\1") == [struct.pack("<BHB", 0, 214, 0) + b"\1"]


def test_0_5_has_no_sdo():
    bench = Bench(OLD).boot()
    assert bench.sdo(0, 213) == []


@VERSIONS
def test_an_emergency_stop_takes_the_power_and_is_told(firmware):
    bench = Bench(firmware).boot().arm()
    bench.deliver(0x02)
    assert bench.axis.mode is Mode.COAST
    assert bench.beat()["Axis_Error"] == "ESTOP_REQUESTED"


@VERSIONS
def test_a_reboot_takes_the_power_and_forgets(firmware):
    bench = Bench(firmware).boot().arm()
    bench.twin.reboot(bench.now_ns)
    assert bench.axis.mode is Mode.COAST
    bench.sent.clear()
    bench.run(499)
    assert bench.sent == []
    assert bench.beat()["Axis_State"] == "IDLE"
    bench.tell("Set_Axis_State", Axis_Requested_State=8)
    bench.run(5)
    assert bench.axis.value == 0.0


def test_a_running_axis_of_0_6_does_not_reboot_when_asked_to():
    bench = Bench(NEW).boot().arm()
    bench.tell("Reboot", Action="reboot")
    assert bench.axis.mode is Mode.SPEED


@pytest.mark.parametrize(
    ("voltage_v", "word"), [(57.0, "DC_BUS_OVER_VOLTAGE"), (7.0, "DC_BUS_UNDER_VOLTAGE")]
)
def test_a_supply_out_of_its_limits_disarms(voltage_v, word):
    bench = Bench(NEW).boot().arm()
    bench.stage.bus_voltage_v = voltage_v
    bench.run(20)
    assert bench.axis.mode is Mode.COAST
    assert str(bench.ask("Get_Error")["Disarm_Reason"]) == word
    old = Bench(OLD).boot().arm()
    old.stage.bus_voltage_v = voltage_v
    old.run(20)
    assert str(old.ask("Get_Motor_Error")["Motor_Error"]) == "SYSTEM_LEVEL"
    assert old.beat()["Motor_Error_Flag"] == "1"


def test_an_axis_that_is_not_calibrated_refuses():
    bench = Bench(NEW, calibrated=False).boot().arm()
    assert bench.axis.mode is Mode.COAST
    assert bench.beat()["Procedure_Result"] == "NOT_CALIBRATED"
    old = Bench(OLD, calibrated=False).boot().arm()
    assert old.beat()["Axis_Error"] == "INVALID_STATE"


def test_an_error_with_a_lasting_cause_comes_back_when_cleared():
    bench = Bench(NEW).boot().arm()
    bench.twin.trip(0x20, lasts=True)
    bench.tell("Clear_Errors")
    found = bench.ask("Get_Error")
    assert (str(found["Active_Errors"]), str(found["Disarm_Reason"])) == ("DRV_FAULT", "DRV_FAULT")
    bench.twin.errors.heal()
    assert str(bench.ask("Get_Error")["Disarm_Reason"]) == "NONE"


def test_a_heartbeat_may_come_at_once_when_something_changes():
    bench = Bench(NEW, heartbeat_on_change=True).boot().arm()
    bench.sent.clear()
    bench.deliver(0x02)
    assert [frame.arbitration_id & 0x1F for frame in bench.sent] == [0x01]


def test_limits_of_current_and_ramp_reach_the_motor():
    bench = Bench(NEW, current_limit_a=7.0, vel_ramp_rate=2.0).boot().arm()
    assert bench.axis.limits == Limits(current_a=7.0)
    bench.tell("Set_Controller_Mode", Control_Mode=2, Input_Mode="VEL_RAMP")
    assert bench.axis.limits.acceleration_rad_s2 == pytest.approx(2.0 * math.tau)
    bench.tell("Set_Limits", Velocity_Limit=1.0, Current_Limit=3.0)
    assert bench.axis.limits.current_a == 3.0
    assert bench.axis.value == pytest.approx(math.tau)


def test_a_brake_resistor_is_put_on_the_supply():
    bench = Bench(NEW, brake_resistor_ohm=2.0, brake_resistor_from_v=28.0)
    assert bench.stage.resistor == BrakeResistor(2.0, 28.0)
    assert Bench(NEW).stage.resistor is None


def test_a_number_that_is_none_is_ignored():
    bench = Bench(NEW).boot().arm()
    bench.deliver(0x0D, struct.pack("<ff", math.nan, 0.0))
    assert bench.axis.value == pytest.approx(2.0 * math.tau)


@pytest.mark.parametrize(
    "wrong", [{"node_id": 63}, {"axes": []}, {"unknown": 1}, {"watchdog_endpoints": [0, 1]}]
)
def test_a_wrong_table_is_refused(wrong):
    good = {"kind": "odrive", "name": "left", "axes": [{"actuator": "left"}], "node_id": NODE}
    adapter = TypeAdapter(ODriveMotor)
    assert adapter.validate_python(good).Settings is ODriveSettings
    with pytest.raises(ValidationError):
        adapter.validate_python({**good, **wrong})
