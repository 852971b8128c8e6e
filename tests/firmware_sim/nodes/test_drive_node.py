"""The motor controller on a line with a host: commands, guards, latches, feedback."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.nodes.drive import ENABLE_FRAMES
from firmware_sim.nodes.drive_state import DriveState
from firmware_sim.plant.axis import Mode

MS = 1_000_000
EMCY = 0x081
DEVICE_STATE = bytes.fromhex("22000008")


def emergencies(rig):
    return [int.from_bytes(f.data[:2], "little") for f in rig.line.frames(EMCY)]


def accepted(rig):
    return rig.read(0x2100, 1)


class TestCommands:
    def test_the_first_command_only_sets_the_reference(self, rig):
        for _ in range(ENABLE_FRAMES):
            rig.host.send(duty1=0.5)
            assert rig.drive.drive_state is DriveState.READY
        rig.host.send(duty1=0.5, duty2=-0.25, steering=0.1)
        assert rig.drive.drive_state is DriveState.ENABLED
        assert rig.stage.commands[-1] == pytest.approx((0.5, -0.25, 0.1, Mode.DUTY))

    @pytest.mark.parametrize("late", range(2 * ENABLE_FRAMES))
    def test_commands_that_were_held_back_enable_nobody_whom_the_host_keeps_off(self, rig, late):
        old = [rig.host.frame(duty1=0.5) for _ in range(60)]
        for _ in range(40):
            rig.host.send(enable=False)
            if late < ENABLE_FRAMES:  # so many of them between two of the host's
                for _ in range(late):
                    rig.line.deliver(0x201, old.pop(0)) if old else None
            else:
                rig.line.deliver(0x201, old[late])
            assert rig.drive.drive_state is DriveState.READY
            assert rig.stage.axes[0].value == 0.0

    def test_enable_0_counts_whatever_its_counter_but_not_with_a_wrong_crc(self, rig):
        rig.enable()
        rig.host.send(duty1=0.5)
        late = rig.host.frame(enable=False, counter=(rig.host.counter + 7) % 15)
        damaged = bytes((late[0] ^ 1,)) + late[1:]
        rig.line.deliver(0x201, damaged)
        assert rig.drive.drive_state is DriveState.ENABLED
        rig.stage.steering_rad = 0.2
        rig.line.deliver(0x201, late)
        assert rig.drive.drive_state is DriveState.READY
        assert rig.stage.commands[-1] == (0.0, 0.0, 0.2, Mode.SHORTED)

    @pytest.mark.parametrize(("brake", "bridge"), [(False, Mode.COAST), (True, Mode.SHORTED)])
    def test_enable_0_opens_or_shorts_the_bridge_whatever_the_duty_says(self, rig, brake, bridge):
        rig.enable()
        rig.host.send(enable=False, brake=brake, duty1=0.9)
        assert rig.drive.drive_state is DriveState.READY
        assert rig.stage.commands[-1] == (0.0, 0.0, 0.0, bridge)

    @pytest.mark.parametrize("brake", [False, True])
    def test_enable_0_leaves_the_steering_where_it_is_whatever_it_was_told(self, rig, brake):
        rig.enable()
        rig.host.send(steering=0.6)
        rig.stage.steering_rad = 0.25  # on its way, or held fast
        rig.host.send(enable=False, brake=brake, steering=-0.3)
        assert rig.stage.steering_cmd_rad == 0.25
        rig.stage.steering_rad = 0.27
        rig.host.send(enable=False, brake=not brake, steering=-0.3)
        assert rig.stage.steering_cmd_rad == 0.25

    def test_commands_before_operational_count_for_nothing(self, rig):
        rig.line.deliver(0x000, b"\x80\x01")
        before = len(rig.stage.commands)
        for _ in range(3):
            rig.host.send(duty1=0.5)
        assert len(rig.stage.commands) == before
        assert accepted(rig) == 0

    def test_a_corrupt_command_is_dropped_and_counted(self, rig):
        rig.enable()
        data = bytearray(rig.host.frame(duty1=0.7))
        data[3] ^= 0x04
        rig.line.deliver(0x201, data)
        assert rig.stage.axes[0].value == 0.0
        assert rig.read(0x2100, 2) == 1

    def test_a_masqueraded_command_is_dropped_and_counted(self, rig):
        rig.enable()
        rig.line.deliver(0x080)
        feedback = rig.line.frames(0x181)[-1].data
        rig.line.deliver(0x201, feedback)
        assert rig.read(0x2100, 2) == 1
        assert rig.drive.drive_state is DriveState.ENABLED

    def test_a_repeated_command_is_dropped_and_counted(self, rig):
        rig.enable()
        data = rig.host.send(duty1=0.3)
        rig.host.send(duty1=0.1)
        for _ in range(2):
            rig.line.deliver(0x201, data)
        assert rig.stage.axes[0].value == pytest.approx(0.1)
        assert rig.read(0x2100, 3) == 2

    def test_up_to_two_lost_commands_are_forgiven_three_are_not(self, rig):
        rig.enable()
        counter = rig.host.counter
        rig.host.send(duty1=0.2, counter=(counter + 2) % 15)
        assert rig.stage.axes[0].value == pytest.approx(0.2)
        rig.host.send(duty1=0.4, counter=(counter + 6) % 15)
        assert rig.stage.axes[0].value == pytest.approx(0.2)
        assert rig.read(0x2100, 3) == 1
        rig.host.send(duty1=0.6)
        assert rig.stage.axes[0].value == pytest.approx(0.6)

    @pytest.mark.parametrize("length", [0, 1, 7])
    def test_a_command_of_wrong_length_is_dropped_and_counted(self, rig, length):
        rig.enable()
        rig.line.deliver(0x201, rig.host.frame(duty1=0.5)[:length])
        assert rig.stage.axes[0].value == 0.0
        assert rig.read(0x2100, 4) == 1

    @pytest.mark.parametrize("raw", [10_001, -10_001, 32767, -32768])
    def test_a_duty_out_of_range_is_dropped_and_counted(self, rig, raw):
        rig.enable()
        data = bytearray(rig.host.frame())
        data[2:4] = raw.to_bytes(2, "little", signed=True)
        rig.line.deliver(0x201, rig.host.sealed(data))
        assert rig.stage.axes[0].value == 0.0
        assert rig.read(0x2100, 4) == 1
        rig.host.send(duty1=1.0)
        assert rig.stage.axes[0].value == 1.0

    def test_the_status_says_what_was_heard_and_rejected(self, rig):
        rig.line.deliver(0x000, b"\x80\x01")
        rig.write(0x1802, 2, 1, 1)
        rig.line.deliver(0x000, b"\x01\x01")
        rig.line.deliver(0x080)
        assert rig.last("DriveStatus")["EchoCounter"] == 15
        assert rig.last("DriveStatus")["CommandAge"] == 255
        rig.enable()
        echo = (rig.host.counter - 1) % 15
        rig.line.deliver(0x201, bytes(8))
        rig.line.run_ms(42.5)
        rig.line.deliver(0x080)
        status = rig.last("DriveStatus")
        assert (status["EchoCounter"], status["CommandAge"]) == (echo, 42)
        assert status["RejectedCommands"] == 1


class TestDeadMan:
    @pytest.mark.parametrize("timeout_ms", [2, 37, 100, 250])
    def test_the_motors_stop_exactly_at_the_time_out(self, rig, timeout_ms):
        rig.write(0x2000, 0, timeout_ms, 2)
        rig.line.run_ms(0.3)
        rig.enable()
        rig.stage.axes[0].current_a = 5.0  # stalled: there is no back-EMF that would want counts
        rig.host.send(duty1=0.5)
        due_ns = rig.line.now_ns + timeout_ms * MS
        rig.line.run_to(due_ns - 1)
        assert rig.drive.drive_state is DriveState.ENABLED
        rig.line.run_to(due_ns)
        assert rig.drive.drive_state is DriveState.STOPPED
        assert rig.stage.commands[-1] == (0.0, 0.0, 0.0, Mode.SHORTED)
        assert emergencies(rig) == [0x8130]
        assert rig.read(0x2100, 5) == 1
        rig.line.deliver(0x080)

    def test_rejected_commands_do_not_keep_the_motors_running(self, rig):
        rig.enable()
        start_ns = rig.line.now_ns
        for _ in range(30):
            rig.line.run_ms(5)
            rig.line.deliver(0x201, b"\xff" * 8)
        assert rig.drive.drive_state is DriveState.STOPPED
        assert rig.line.frames(EMCY)[0].stamp_ns == start_ns + 100 * MS

    def test_commands_in_time_keep_the_motors_running(self, rig):
        rig.enable()
        rig.host.drive(3000, period_ms=95, duty1=0.05)
        assert rig.drive.drive_state is DriveState.ENABLED

    def test_the_time_out_does_not_count_while_disabled(self, rig):
        rig.host.send(enable=False)
        rig.host.send(enable=False)
        rig.line.run_ms(1000)
        assert rig.drive.drive_state is DriveState.READY

    def test_after_a_time_out_the_next_command_is_only_a_reference(self, rig):
        rig.host.send(enable=False)
        rig.host.send(enable=False)
        rig.line.run_ms(100)
        before = accepted(rig)
        rig.host.send(enable=False)
        assert accepted(rig) == before
        rig.host.send(enable=False)
        assert accepted(rig) == before + 1

    def test_motion_never_resumes_by_itself(self, rig):
        rig.enable()
        rig.line.run_ms(100)
        rig.host.drive(500, duty1=0.5)
        assert rig.drive.drive_state is DriveState.STOPPED
        assert rig.stage.axes[0].value == 0.0
        rig.clear_faults()
        assert rig.drive.drive_state is DriveState.READY
        rig.host.drive(500, duty1=0.5)
        assert rig.drive.drive_state is DriveState.READY
        assert rig.stage.axes[0].value == 0.0
        rig.enable()
        rig.host.send(duty1=0.5)
        assert rig.stage.axes[0].value == pytest.approx(0.5)

    @given(delays=st.lists(st.integers(1, 150), min_size=1, max_size=15))
    def test_duty_is_applied_until_the_first_gap_as_long_as_the_time_out(self, make_rig, delays):
        rig = make_rig()
        rig.enable()
        alive = True
        for delay_ms in delays:
            rig.host.send(duty1=0.05)
            assert rig.stage.axes[0].value == (pytest.approx(0.05) if alive else 0.0)
            rig.line.run_ms(delay_ms)
            alive = alive and delay_ms < 100
            assert rig.stage.axes[0].value == (pytest.approx(0.05) if alive else 0.0)


class TestEmergencyStop:
    @pytest.mark.parametrize("data", [b"", b"\x01", b"\x00" * 8, b"\xff" * 5])
    @pytest.mark.parametrize("nmt", ["operational", "pre_operational", "stopped", "booting"])
    def test_any_frame_0x001_stops_and_latches_in_any_nmt_state(self, rig, data, nmt):
        rig.enable()
        rig.host.send(duty1=0.5)
        command = {"pre_operational": b"\x80\x00", "stopped": b"\x02\x00", "booting": b"\x81\x00"}
        if nmt in command:
            rig.line.deliver(0x000, command[nmt])
        rig.line.deliver(0x001, data)
        assert rig.drive.drive_state is DriveState.EMERGENCY_STOP
        assert (rig.stage.axes[0].value, rig.stage.axes[0].mode) == (0.0, Mode.SHORTED)
        rig.line.run_ms(10)
        rig.line.deliver(0x000, b"\x01\x00")
        rig.host.drive(100, duty1=0.5)
        assert rig.drive.drive_state is DriveState.EMERGENCY_STOP
        assert rig.stage.axes[0].value == 0.0

    def test_a_remote_request_of_0x001_counts_too(self, rig):
        rig.line.deliver(0x001 | 0x4000_0000)
        assert rig.drive.drive_state is DriveState.EMERGENCY_STOP

    def test_it_is_told_once_and_counted(self, rig):
        for _ in range(3):
            rig.line.deliver(0x001, b"\x02")
        assert emergencies(rig) == [0xFF01]
        assert rig.line.frames(EMCY)[0].data[3] == 2
        assert rig.read(0x2100, 6) == 1

    def test_it_outranks_a_fault_and_shows_both(self, rig):
        rig.line.deliver(0x001)
        rig.stage.axes[1].temperature_c = 150.0
        rig.host.drive(100, enable=False)
        status = rig.last("MotorStatus")
        assert (status["State"], status["FaultOverTemperature"]) == (5, 1)

    def test_clearing_leads_to_ready_and_is_told(self, rig):
        rig.line.deliver(0x001)
        assert rig.clear_faults()[0] == 0x60
        assert rig.drive.drive_state is DriveState.READY
        assert emergencies(rig) == [0xFF01, 0]
        assert rig.read(0x1001) == 0


class TestFaults:
    def test_over_current_stops_after_half_a_second_not_before(self, rig):
        rig.enable()
        rig.stage.axes[0].current_a = -5.1
        rig.host.drive(450)
        assert rig.drive.drive_state is DriveState.ENABLED
        rig.host.drive(100)
        assert rig.drive.drive_state is DriveState.FAULT
        assert rig.stage.axes[0].value == 0.0
        assert emergencies(rig) == [0x2310]
        assert rig.read(0x1001) == 0x03

    def test_current_below_its_limit_or_short_peaks_are_no_fault(self, rig):
        rig.enable()
        for current in (4.9, 9.5, 4.9, 9.5):
            rig.stage.axes[0].current_a = current
            rig.host.drive(400)
        assert rig.drive.drive_state is DriveState.ENABLED

    def test_the_current_limit_can_be_set(self, rig):
        rig.write(0x2003, 0, 2000, 4)
        rig.stage.axes[1].current_a = 2.1
        rig.host.drive(700, enable=False)
        assert rig.drive.drive_state is DriveState.FAULT

    def test_over_temperature_stops_and_stays_until_cooled(self, rig):
        rig.enable()
        rig.stage.axes[0].temperature_c = 120.5
        rig.host.drive(50, duty1=0.3)
        assert rig.drive.drive_state is DriveState.FAULT
        rig.stage.axes[0].temperature_c = 115.0
        assert rig.clear_faults()[4:] == DEVICE_STATE
        assert rig.drive.drive_state is DriveState.FAULT
        rig.stage.axes[0].temperature_c = 100.0
        assert rig.clear_faults()[0] == 0x60
        assert rig.drive.drive_state is DriveState.READY

    def test_under_voltage_stops_also_in_pre_operational(self, rig):
        rig.line.deliver(0x000, b"\x80\x00")
        rig.stage.bus_voltage_v = 8.9
        rig.line.run_ms(30)
        assert rig.drive.drive_state is not DriveState.FAULT
        rig.line.run_ms(60)
        assert rig.drive.drive_state is DriveState.FAULT
        assert rig.clear_faults()[4:] == DEVICE_STATE
        rig.stage.bus_voltage_v = 12.0
        assert rig.clear_faults()[0] == 0x60
        assert emergencies(rig) == [0x3220, 0]

    def test_every_fault_shows_in_the_status(self, rig):
        rig.stage.axes[0].temperature_c, rig.stage.bus_voltage_v = 130.0, 5.0
        rig.stage.axes[1].current_a = 9.0
        rig.host.drive(800, enable=False)
        status = rig.last("MotorStatus")
        assert status["State"] == 4
        shown = {name for name, value in status.items() if name.startswith("Fault") and value}
        assert shown == {"FaultOverTemperature", "FaultUnderVoltage", "FaultOverCurrent"}
        assert len(rig.line.frames(EMCY)) == 3

    def test_clearing_is_refused_while_enabled_and_harmless_when_ready(self, rig):
        assert rig.clear_faults()[0] == 0x60
        rig.enable()
        assert rig.clear_faults()[4:] == DEVICE_STATE
        assert rig.drive.drive_state is DriveState.ENABLED


def spin(rig, ms, duty, current, counts_per_ms, channel=1):
    """Drive with a wheel that turns at a rate, whatever the duty."""
    for _ in range(ms // 5):
        rig.host.send(**{"duty1": 0.0, "duty2": 0.0, f"duty{channel}": duty})
        rig.line.deliver(0x080)
        rig.line.run_ms(5)
        axis = rig.stage.axes[channel - 1]
        axis.current_a = current
        axis.count += counts_per_ms * 5


@pytest.mark.parametrize("channel", [1, 2])
class TestEncoderFault:
    # At duty 0.5 of 12 V and 0.3 A the back-EMF is 5.64 V: 12.5 rad/s, 4.8 counts a ms.
    def test_a_wheel_that_turns_as_its_back_emf_says_is_fine(self, rig, channel):
        rig.enable()
        spin(rig, 1000, 0.5, 0.3, 5, channel)
        assert rig.drive.drive_state is DriveState.ENABLED

    def test_counts_that_stay_away_are_a_fault_within_a_quarter_second(self, rig, channel):
        rig.enable()
        spin(rig, 200, 0.5, 0.3, 0, channel)
        assert rig.drive.drive_state is DriveState.ENABLED
        spin(rig, 60, 0.5, 0.3, 0, channel)
        assert rig.drive.drive_state is DriveState.FAULT
        assert emergencies(rig) == [0x7305]

    @pytest.mark.parametrize("duty", [0.5, -0.5])
    def test_counts_of_the_wrong_sign_are_a_fault(self, rig, duty, channel):
        rig.enable()
        counts = -5 if duty > 0 else 5
        spin(rig, 90, duty, 0.6 * duty, counts, channel)
        assert rig.drive.drive_state is DriveState.ENABLED
        spin(rig, 60, duty, 0.6 * duty, counts, channel)
        assert rig.drive.drive_state is DriveState.FAULT

    def test_a_stalled_wheel_is_no_encoder_fault(self, rig, channel):
        rig.enable()
        spin(rig, 1000, 0.5, 5.0, 0, channel)  # 6 V over 1.2 ohm: no back-EMF
        assert rig.drive.drive_state is DriveState.ENABLED

    def test_friction_holding_the_wheel_at_low_duty_is_no_encoder_fault(self, rig, channel):
        rig.enable()
        spin(rig, 1000, 0.05, 0.0, 0, channel)
        assert rig.drive.drive_state is DriveState.ENABLED

    def test_a_wheel_coasting_through_a_reversal_is_no_encoder_fault(self, rig, channel):
        rig.enable()
        spin(rig, 300, 0.5, 0.3, 5, channel)
        spin(rig, 60, -0.5, -9.7, 5, channel)  # (-6 V + 11.6 V) / 0.45: still forwards
        spin(rig, 60, -0.5, -0.3, -5, channel)
        assert rig.drive.drive_state is DriveState.ENABLED


class TestFeedback:
    def test_each_sync_gives_counts_and_the_time_of_the_sample(self, rig):
        rig.stage.axes[0].count, rig.stage.axes[1].count = 70_000, -3
        rig.line.run_to(123_456_789)
        rig.line.deliver(0x080)
        feedback = rig.last("WheelFeedback")
        assert feedback["Count1"] == 70_000 - 65_536
        assert feedback["Count2"] == 65_533
        assert feedback["Timestamp"] == 123_000

    def test_the_timer_rolls_over_and_starts_at_power_up(self, rig):
        rig.line.run_to(2_000_000_000)
        rig.drive.power_cycle(rig.line.now_ns)
        rig.line.run_ms(10)
        rig.line.deliver(0x000, b"\x01\x00")
        rig.line.run_ms(90)
        rig.line.deliver(0x080)
        assert rig.last("WheelFeedback")["Timestamp"] == 100_000
        rig.line.run_ms(1000)
        rig.line.deliver(0x080)
        assert rig.last("WheelFeedback")["Timestamp"] == 1_100_000 - 2**20

    @pytest.mark.parametrize(("name", "index"), [("MotorStatus", 0x1801), ("DriveStatus", 0x1802)])
    @pytest.mark.parametrize("every", [1, 3, 4, 240])
    def test_status_comes_on_every_nth_sync(self, rig, name, index, every):
        rig.write(index, 2, every, 1)
        arbitration_id = {"MotorStatus": 0x281, "DriveStatus": 0x381}[name]
        for _ in range(480):
            rig.line.deliver(0x080)
        assert len(rig.line.frames(arbitration_id)) == 480 // every
        assert len(rig.line.frames(0x181)) == 480

    @pytest.mark.parametrize("value", [0, 241, 254, 255])
    def test_other_transmission_types_are_refused(self, rig, value):
        assert rig.write(0x1801, 2, value, 1)[4:] == bytes.fromhex("30000906")

    def test_outside_operational_there_is_no_feedback(self, rig):
        for command in (b"\x80\x01", b"\x02\x01"):
            rig.line.deliver(0x000, command)
            rig.line.deliver(0x080)
        assert rig.line.frames(0x181) == []

    def test_measurements_arrive_in_their_units(self, rig):
        stage = rig.stage
        stage.axes[0].current_a, stage.axes[1].current_a = 1.25, -0.5
        stage.axes[0].temperature_c, stage.axes[1].temperature_c = 41.0, 39.0
        stage.bus_voltage_v, stage.steering_rad = 11.734, -0.4321
        for _ in range(4):
            rig.line.deliver(0x080)
        motor, drive = rig.last("MotorStatus"), rig.last("DriveStatus")
        assert (motor["Current1"], motor["Current2"]) == pytest.approx((1.25, -0.5))
        assert (motor["Temperature1"], motor["Temperature2"]) == (41, 39)
        assert drive["BusVoltage"] == pytest.approx(11.734)
        assert drive["SteeringAngle"] == pytest.approx(-0.4321)

    def test_the_pdo_images_can_be_read_but_not_written_over_sdo(self, rig):
        rig.enable()
        answer = rig.sdo(bytes.fromhex("40102100") + bytes(4))
        assert answer == bytes.fromhex("4110210008000000")
        assert rig.sdo(bytes.fromhex("2110210008000000"))[0] == 0x60
        assert rig.sdo(b"\x00" + bytes(7)) == b"\x20" + bytes(7)
        assert rig.sdo(b"\x1d" + bytes(7))[4:] == DEVICE_STATE


class TestNmt:
    @pytest.mark.parametrize("command", [0x02, 0x80, 0x81, 0x82])
    def test_leaving_operational_stops_the_motors_and_asks_for_a_disable(self, rig, command):
        rig.enable()
        rig.host.send(duty1=0.5)
        rig.line.deliver(0x000, bytes((command, 1)))
        assert (rig.stage.axes[0].value, rig.stage.axes[0].mode) == (0.0, Mode.SHORTED)
        rig.line.run_ms(20)
        rig.line.deliver(0x000, b"\x01\x01")
        rig.host.drive(50, duty1=0.5)
        assert rig.drive.drive_state is DriveState.READY
        rig.enable()
        rig.host.send(duty1=0.5)
        assert rig.stage.axes[0].value == pytest.approx(0.5)

    def test_a_command_to_another_node_changes_nothing(self, rig):
        rig.enable()
        rig.line.deliver(0x000, b"\x02\x02")
        assert rig.drive.drive_state is DriveState.ENABLED

    @pytest.mark.parametrize("command", [0x81, 0x82])
    def test_a_warm_reset_keeps_the_latch_and_the_counts(self, rig, command):
        rig.enable()
        rig.line.run_ms(100)
        rig.stage.axes[0].count = 500
        rig.line.deliver(0x000, bytes((command, 0)))
        rig.line.run_ms(20)
        rig.line.deliver(0x000, b"\x01\x00")
        for _ in range(4):
            rig.line.deliver(0x080)
        assert rig.last("MotorStatus")["State"] == DriveState.STOPPED
        assert rig.last("MotorStatus")["FaultCommandTimeout"] == 1
        assert rig.last("WheelFeedback")["Count1"] == 500

    def test_a_power_cycle_forgets_everything(self, rig):
        rig.enable()
        rig.line.deliver(0x001)
        rig.stage.axes[0].count = 500
        boots = len(rig.line.frames(0x701))
        rig.drive.power_cycle(rig.line.now_ns)
        rig.line.run_ms(6)
        assert rig.line.frames(0x701)[boots].data == b"\0"
        assert rig.stage.axes[0].mode is Mode.COAST
        rig.line.deliver(0x000, b"\x01\x00")
        for _ in range(4):
            rig.line.deliver(0x080)
        assert rig.last("MotorStatus")["State"] == DriveState.READY
        assert rig.last("WheelFeedback")["Count1"] == 0
        assert rig.last("DriveStatus")["EchoCounter"] == 15
        assert [rig.read(0x2100, each) for each in range(1, 7)] == [0] * 6
        assert rig.read(0x1003, 0) == 0
