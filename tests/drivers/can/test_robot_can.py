"""The robot port: frames made by cantools and autosar-e2e in, messages out, and the way back."""

import math

import pytest
from e2e import p01

from robotctl.drivers.can.config import CanConfig
from robotctl.drivers.can.memory_port import MemoryPort
from robotctl.drivers.can.nodes.motor import DriveFault
from robotctl.drivers.can.robot_can import DISABLE_FRAMES
from robotctl.messages.actuators import ActuatorCommand, ActuatorFeedback, DriveState
from robotctl.messages.control import BusState, EmergencyMessage, EmergencyStopSource
from robotctl.messages.faults import FaultCode
from tests.native_frames import DIFFERENTIAL, TRICYCLE, native_parts, native_robot

PERIOD_NS = 5_000_000


class Wire:
    """A robot, and an oracle that sends and reads its frames."""

    def __init__(self, codec, parameters, oracle, clock, drive=DIFFERENTIAL):
        self.oracle = oracle
        self.clock = clock
        self.sent = []
        self.takes = True
        self.closed = False
        self.counters = {}
        parts = native_parts(codec, parameters, drive)
        self.port = MemoryPort(self.transmit, parts.identifiers(""), CanConfig(), clock)
        self.robot = native_robot(self.port, parts)

    def transmit(self, can_id, data):
        if self.takes:
            self.sent.append((can_id, data))
        return self.takes

    def frame(self, name, **values):
        """Encode and protect as AUTOSAR does; the counter of each message runs by itself."""
        message = self.oracle.get_message_by_name(name)
        counter = self.counters.get(name, 0)
        signals = {signal.name: 0 for signal in message.signals}
        data = bytearray(message.encode({**signals, **values, "Counter": counter}))
        data_id = message.dbc.attributes["E2E_DataId"].value
        p01.e2e_p01_protect(data, data_id, length=8, increment_counter=False)
        self.counters[name] = (counter + 1) % 15
        return message.frame_id, bytes(data)

    def put(self, can_id, data):
        self.port.deliver((can_id, data, self.clock.now_ns()))

    def put_checked(self, name, **values):
        """Send the message twice: the first frame only sets the receiver's reference."""
        if name not in self.counters:
            self.put(*self.frame(name, **values))
        self.put(*self.frame(name, **values))

    def receive(self):
        return self.robot.receive(self.clock.now_ns())

    def send(self, *args, **fields):
        self.clock.sleep_until(self.clock.now_ns() + PERIOD_NS)
        self.robot.send(ActuatorCommand(*args, **fields), self.clock.now_ns())

    def commands(self):
        message = self.oracle.get_message_by_name("MotorCommand")
        decoded = []
        for can_id, data in self.sent:
            if can_id == 0x201:
                assert p01.e2e_p01_check(bytearray(data), 0xA201, length=8)
                decoded.append(message.decode(data))
        return decoded


@pytest.fixture
def wire(codec, parameters, oracle, clock):
    return Wire(codec, parameters, oracle, clock)


@pytest.fixture
def steered_wire(codec, parameters, oracle, clock):
    return Wire(codec, parameters, oracle, clock, TRICYCLE)


def test_wheel_feedback_is_decoded_and_stamped(wire):
    wire.put_checked("WheelFeedback", Timestamp=1_048_575, Count1=65_535, Count2=1)
    left, right = wire.receive().actuators
    assert (left.position_ticks, right.position_ticks) == (65_535, 1)
    for wheel in (left, right):
        assert wheel.latch_us == 1_048_575
        assert wheel.motion_ns == wire.clock.now_ns()


def test_motor_status_is_decoded_with_state_and_faults(wire):
    wire.put_checked(
        "MotorStatus",
        State="fault",
        Current1=-12.35,
        Current2=7.5,
        Temperature1=-40,
        Temperature2=121,
        FaultOverCurrent=1,
        FaultEncoder=1,
        FaultParameter=1,
    )
    left, right = wire.receive().actuators
    assert left.current_a == pytest.approx(-12.35)
    assert right.current_a == pytest.approx(7.5)
    assert (left.temperature_c, right.temperature_c) == (-40, 121)
    for wheel in (left, right):
        assert wheel.report_ns == wire.clock.now_ns()
        assert wheel.state is DriveState.FAULT
        assert wheel.fault.code is FaultCode.DRIVE_OVER_CURRENT
        assert str(wheel.fault) == (
            "the motor controller is in fault: over current, encoder, parameter"
        )


def told(wire):
    """Return whether the drive told its supply just now."""
    return wire.receive().actuators[0].supply_ns == wire.clock.now_ns()


@pytest.mark.parametrize(("steered", "period_ms"), [(True, 5), (False, 20)])
def test_a_drive_status_whose_counter_may_have_gone_round_unheard_only_starts_it_anew(
    codec, parameters, oracle, clock, steered, period_ms
):
    wire = Wire(codec, parameters, oracle, clock, TRICYCLE if steered else DIFFERENTIAL)
    for lost in (11, 15):
        wire.put_checked("DriveStatus", BusVoltage=12.0)
        assert told(wire)
        for _ in range(lost):
            wire.frame("DriveStatus", BusVoltage=12.0)
        clock.sleep_until(clock.now_ns() + (lost + 1) * period_ms * 1_000_000)
        rejects = wire.receive().bus.counter_rejects
        wire.put(*wire.frame("DriveStatus", BusVoltage=12.0))
        assert not told(wire)
        # Within the time-out the jump is seen; later the counter says nothing.
        assert wire.receive().bus.counter_rejects - rejects == (lost == 11)
        wire.put(*wire.frame("DriveStatus", BusVoltage=12.0))
        assert told(wire)


@pytest.mark.parametrize("fault", list(DriveFault))
def test_each_fault_has_its_signal(wire, fault):
    name = "Fault" + "".join(word.title() for word in fault.name.split("_"))
    wire.put_checked("MotorStatus", **{name: 1})
    wheel, *_ = wire.receive().actuators
    assert wheel.fault.code is FaultCode[f"DRIVE_{fault.name}"]


@pytest.mark.parametrize("raw", range(16))
def test_a_state_that_the_dbc_does_not_know_is_taken_as_a_fault(wire, raw):
    wire.put_checked("MotorStatus", State=raw)
    expected = DriveState(raw) if raw <= 5 else DriveState.FAULT
    assert wire.receive().actuators[0].state is expected


def test_drive_status_is_decoded(steered_wire):
    wire = steered_wire
    wire.put_checked(
        "DriveStatus",
        EchoCounter=7,
        SteeringAngle=-0.5236,
        BusVoltage=11.987,
        CommandAge=3,
        RejectedCommands=9,
    )
    wheel, steering = wire.receive().actuators
    assert steering.angle_rad == pytest.approx(-0.5236)
    assert steering.motion_ns == wire.clock.now_ns()
    for each in (wheel, steering):
        assert each.voltage_v == pytest.approx(11.987)
        assert (each.command_age_ms, each.supply_ns) == (3, wire.clock.now_ns())


def test_battery_is_decoded_with_its_charge_as_a_share(wire):
    wire.put_checked(
        "Battery",
        BatteryLow=1,
        Voltage=10.5,
        Current=-1.25,
        Charge=45.5,
        Temperature=31,
    )
    battery = wire.receive().battery
    assert battery.voltage_v == pytest.approx(10.5)
    assert battery.current_a == pytest.approx(-1.25)
    assert battery.charge == pytest.approx(0.455)
    assert (battery.temperature_c, battery.low, battery.critical) == (31, True, False)


def test_sonar_groups_are_decoded_with_what_they_do_not_see(wire):
    wire.put_checked("SonarRangesB", Range4=1.234, Range5=8.191, Range6=8.190, Range7=0.02)
    wire.put_checked("SonarRangesA", Range0=0.5, Range1=0.6, Range2=0.7, Range3=0.8)
    b, a = wire.receive().sonars
    assert (b.first, a.first) == (4, 0)
    assert b.ranges_m[0] == pytest.approx(1.234)
    assert b.ranges_m[1] == math.inf
    assert math.isnan(b.ranges_m[2])
    assert a.ranges_m == pytest.approx((0.5, 0.6, 0.7, 0.8))


def test_emergencies_and_emergency_stops_by_others_are_reported_once(wire):
    wire.put(0x081, bytes.fromhex("1023020000000000"))
    wire.put(0x083, bytes(8))
    wire.put(0x081, b"\x10\x23")
    wire.put(0x001, b"\x02")
    feedback = wire.receive()
    now_ns = wire.clock.now_ns()
    assert feedback.emergencies == (
        EmergencyMessage(now_ns, 1, 0x2310, 2),
        EmergencyMessage(now_ns, 3, 0, 0),
    )
    assert feedback.emergency_stop is EmergencyStopSource.GROUND_STATION
    again = wire.receive()
    assert again.emergencies == ()
    assert again.emergency_stop is None


@pytest.mark.parametrize("data", [b"", b"\x00", b"\x63", bytes(8)])
def test_an_emergency_stop_of_any_length_and_sender_counts(wire, data):
    wire.put(0x001, data)
    assert wire.receive().emergency_stop is EmergencyStopSource.UNKNOWN


def test_what_did_not_come_is_none(wire):
    feedback = wire.receive()
    assert feedback.actuators == (ActuatorFeedback(),) * 2
    assert feedback.battery is None
    assert feedback.sonars == ()


def test_of_several_feedbacks_in_one_tick_the_newest_counts(wire):
    wire.put_checked("WheelFeedback", Count1=1)
    wire.put_checked("WheelFeedback", Count1=2)
    assert wire.receive().actuators[0].position_ticks == 2


def test_corrupt_repeated_jumped_and_foreign_frames_are_dropped_and_counted(wire):
    wire.put_checked("WheelFeedback", Count1=1)
    can_id, good = wire.frame("WheelFeedback", Count1=2)
    wire.put(can_id, bytes([good[0] ^ 1]) + good[1:])
    wire.put(can_id, good[:7])
    wire.put(can_id, wire.frame("MotorStatus")[1])
    feedback = wire.receive()
    assert feedback.actuators[0].position_ticks == 1
    assert feedback.bus.crc_rejects == 3
    wire.put(can_id, good)
    wire.put(can_id, good)
    assert wire.receive().actuators[0].position_ticks == 2
    wire.counters["WheelFeedback"] += 2
    wire.put(*wire.frame("WheelFeedback", Count1=3))
    wire.counters["WheelFeedback"] += 7
    wire.put(*wire.frame("WheelFeedback", Count1=4))
    feedback = wire.receive()
    assert feedback.actuators[0].position_ticks == 3
    assert (feedback.bus.counter_rejects, feedback.bus.lost) == (2, 2)


def test_after_a_boot_the_counters_of_a_node_start_anew(wire):
    wire.put_checked("WheelFeedback")
    wire.put_checked("Battery")
    wire.put(0x701, b"\x00")
    wire.counters["WheelFeedback"] = 0
    wire.put(*wire.frame("WheelFeedback", Count1=9))
    assert wire.receive().bus.counter_rejects == 0
    wire.put(*wire.frame("WheelFeedback", Count1=9))
    wire.put(*wire.frame("Battery"))
    feedback = wire.receive()
    assert feedback.actuators[0].position_ticks == 9
    assert feedback.battery is not None
    assert feedback.nodes[0].boots == 1


@pytest.mark.parametrize("can_id", [0x081, 0x581, 0x701, 0x181, 0x182, 0x183, 0x281, 0x381])
@pytest.mark.parametrize("length", range(9))
def test_no_frame_of_any_length_raises(wire, can_id, length):
    wire.put(can_id, bytes(range(200, 200 + length)))
    wire.receive()
    wire.send()
    assert len(wire.commands()) == 1


def test_commands_go_out_with_a_running_counter(wire):
    for n in range(17):
        wire.send(enable=True, values=(n / 20, -n / 20))
    commands = wire.commands()
    assert [c["Counter"] for c in commands] == [*range(15), 0, 1]
    assert [c["Duty1"] for c in commands] == pytest.approx([n / 20 for n in range(17)])
    assert [c["Duty2"] for c in commands] == pytest.approx([-n / 20 for n in range(17)])
    assert {(c["Enable"], c["Brake"]) for c in commands} == {(1, 0)}
    assert [can_id for can_id, _ in wire.sent] == [0x201, 0x080] * 17


def test_a_frame_that_the_bus_did_not_take_uses_up_no_counter(wire):
    wire.send()
    wire.takes = False
    wire.send()
    wire.takes = True
    wire.send()
    assert [c["Counter"] for c in wire.commands()] == [0, 1]
    assert wire.receive().bus.send_failures == 2


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 3.0, -3.0])
@pytest.mark.parametrize(("robot", "place"), [("wire", 0), ("wire", 1), ("steered_wire", 1)])
def test_a_command_that_cannot_be_sent_becomes_motors_off(request, robot, place, bad):
    wire = request.getfixturevalue(robot)
    wire.send(enable=True, values=tuple(bad if at == place else 0.1 for at in range(2)))
    [command] = wire.commands()
    assert (command["Enable"], command["Brake"]) == (0, 1)
    assert (command["Duty1"], command["Duty2"], command["SteeringAngle"]) == (0, 0, 0)
    assert wire.receive().bus.send_failures == 1


def test_motors_that_are_switched_off_leave_the_steering_where_it_is(steered_wire):
    wire = steered_wire
    wire.put_checked("DriveStatus", SteeringAngle=0.25)
    wire.receive()
    wire.send(enable=True, values=(math.nan, 0.4))
    wire.robot.close()
    commands = wire.commands()
    assert len(commands) == 1 + DISABLE_FRAMES
    assert [c["SteeringAngle"] for c in commands] == pytest.approx([0.25] * len(commands))


@pytest.mark.parametrize("angle_rad", [1.6, -1.6, 3.2767, -3.2768])
def test_a_steering_angle_that_no_command_can_carry_does_not_keep_motors_on(
    steered_wire, angle_rad
):
    wire = steered_wire
    wire.put_checked("DriveStatus", SteeringAngle=angle_rad)
    assert wire.receive().actuators[1].angle_rad == pytest.approx(angle_rad)
    wire.send(enable=False, brake=True, values=(0.0, angle_rad))
    wire.robot.close()
    commands = wire.commands()
    assert [(c["Enable"], c["Brake"]) for c in commands] == [(0, 1)] * (1 + DISABLE_FRAMES)
    end_rad = math.copysign(1.5708, angle_rad)
    assert [c["SteeringAngle"] for c in commands] == pytest.approx([end_rad] * len(commands))


def test_an_emergency_stop_goes_out_at_once_with_its_source(wire):
    wire.robot.emergency_stop(EmergencyStopSource.OPERATOR)
    assert wire.sent == [(0x001, b"\x01")]


def test_an_emergency_stop_that_the_bus_did_not_take_is_repeated_until_it_does(wire):
    wire.takes = False
    wire.robot.emergency_stop(EmergencyStopSource.HOST_FAULT)
    wire.send()
    wire.takes = True
    wire.send()
    wire.send()
    assert [can_id for can_id, _ in wire.sent] == [0x001, 0x201, 0x080, 0x201, 0x080]
    assert wire.sent[0] == (0x001, b"\x03")


def test_closing_turns_the_motors_off_before_the_bus_is_released(wire):
    wire.send(enable=True, values=(0.5, 0.5))
    wire.robot.close()
    wire.robot.close()
    commands = wire.commands()
    assert len(commands) == 1 + DISABLE_FRAMES
    assert all(c["Enable"] == 0 and c["Brake"] == 1 for c in commands[1:])
    assert [c["Counter"] for c in commands] == list(range(1 + DISABLE_FRAMES))
    wire.send(enable=True)
    assert len(wire.commands()) == 1 + DISABLE_FRAMES


def test_the_state_of_the_controller_reaches_the_feedback(wire):
    wire.put(0x20000004, bytes((0, 0x10, 0, 0, 0, 0, 0, 130)))
    bus = wire.receive().bus
    assert (bus.state, bus.error_frames) == (BusState.ERROR_PASSIVE, 1)
