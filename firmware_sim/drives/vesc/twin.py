"""One VESC: commands, status, packets in buffers, time-out, faults.

Sources: documentation/comm_can.md, comm/comm_can.c, comm/commands.c, timeout.c, confgenerator.c and
datatypes.h of vedderb/bldc.
"""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

from firmware_sim.bus.frame import EXTENDED_FLAG
from firmware_sim.drives.twin import NEVER_NS, Motor, Twin, stored
from firmware_sim.drives.vesc.buffers import Buffers, frames
from firmware_sim.drives.vesc.settings import VescSettings
from firmware_sim.nodes.parameter_store import ParameterStore
from firmware_sim.nodes.power_stage import PowerStage
from firmware_sim.plant.axis import Limits, Mode

MS: Final = 1_000_000
ALL: Final = 255
"""Id that addresses every VESC."""

SUPERVISION_NS: Final = 10 * MS
FRAME_NS: Final = 300_000
"""Time for a frame of an answer [ns]: the firmware waits until each is sent."""
LEAST_CURRENT_A: Final = 0.05
"""Motor current below which it counts as none [A] (`cc_min_current`)."""
VOLTAGE_V: Final = (8.0, 57.0)
"""Minimum and maximum supply [V]."""
MOTOR_C: Final = 100.0
"""Maximum temperature of the motor [degC]."""

OVER_VOLTAGE, UNDER_VOLTAGE, ABSOLUTE_CURRENT, MOTOR_HOT = 1, 2, 4, 6
"""Fault codes that the twin detects itself; `trip` takes any other."""

_TIMEOUT, _BRAKE_MA = (1, 0), (2, 0)
"""Keys of its stored values."""

STATUS_COMMANDS: Final = {1: 9, 2: 14, 3: 15, 4: 16, 5: 27, 6: 58}
HOST_COMMANDS: Final = (0, 1, 2, 3, 5, 6, 7, 8, 12, 17)
"""Commands, by number, that the twin knows."""
_INT16, _INT32 = 0x7FFF, 0x7FFF_FFFF
_AIR_C: Final = 25.0

_SIGNATURE: Final = 486_554_156
_TAIL_BYTES: Final = 480
_HEAD: Final = struct.Struct(">IBIf")
"""Signature, number, time-out [ms], brake current [A]."""
_SERVO_OUTPUT: Final = 31 - _HEAD.size
"""Offset of `servo_out_enable` in the rest of the configuration of firmware 6."""


class Fitting(NamedTuple):
    """Id, pole pairs, motor turns per wheel turn, rate of the status frames [Hz]."""

    number: int
    pole_pairs: int
    ratio: float
    status_rate_hz: int


class ServoOutput(NamedTuple):
    """Servo: position at angle 0, turn over its range [deg], servo turns per joint turn."""

    centre: float
    range_deg: float
    ratio: float


class VescTwin(Twin):
    """The drive.

    Parameters
    ----------
    name
        Name in the robot's file.
    fitting
        Its id, and the properties of its motor.
    settings
        True properties.
    motor
        Its motor.
    servo
        Servo at its output, if any.
    stage
        Power stage: supply and steering servo.
    run_to
        As for `Twin`.
    store
        Its flash memory.

    Attributes
    ----------
    timeout_ms, brake_current_a
        Settings in force.
    fault
        Present fault code.
    kill_switch
        Whether the kill switch is active.
    """

    def __init__(
        self,
        name: str,
        fitting: Fitting,
        settings: VescSettings,
        motor: Motor,
        servo: ServoOutput | None,
        stage: PowerStage,
        run_to: Callable[[int], int],
        store: ParameterStore,
    ) -> None:
        super().__init__(name, run_to)
        self._fitting = fitting
        self._settings = settings
        self._motor = motor
        self._servo = servo
        self._stage = stage
        self._store = store
        self._rad_s_per_erpm = math.tau / 60.0 / self._fitting.pole_pairs
        self._set_limits()
        self._commands: dict[int, Callable[[bytes, int], None]] = {
            0: self._on_duty,
            1: self._on_current,
            2: self._on_brake,
            3: self._on_rpm,
            5: self._on_fill,
            6: self._on_fill_long,
            7: self._on_process,
            8: self._on_process_short,
            12: self._on_handbrake,
            17: self._on_ping,
        }
        for number in (self._fitting.number, ALL):
            for command in self._commands:
                self._handlers[EXTENDED_FLAG | command << 8 | number] = self._awake(command)
        self.kill_switch = False
        self.fault = 0
        self._on_power_up(0)

    def _set_limits(self) -> None:
        """Set the limits of the drive's loops, at the wheel."""
        settings, axis = self._settings, self._motor.axis
        axis.limits = Limits(
            current_a=settings.current_a,
            voltage_share=0.95,
            acceleration_rad_s2=settings.ramp_erpm_s * self._rad_s_per_erpm / self._fitting.ratio,
        )

    def _on_power_up(self, now_ns: int) -> None:
        flash = stored(self._store)
        self.timeout_ms = flash.get(_TIMEOUT, self._settings.stored_timeout_ms)
        self.brake_current_a = (
            flash.get(_BRAKE_MA, round(self._settings.stored_brake_current_a * 1000)) / 1000
        )
        self._tail = bytearray(place % 251 for place in range(_TAIL_BYTES))
        self._tail[_SERVO_OUTPUT] = self._settings.servo_output
        self.fault = 0
        self._fault_until_ns = NEVER_NS
        self._buffers = Buffers()
        self._answers: deque[tuple[int, bytes]] = deque()
        self._answer_ns = NEVER_NS
        self._updated_ns = now_ns - NEVER_NS
        self._timed_out = True
        self._awake_ns = now_ns + self._settings.boot_ms * MS
        self._booted = False
        self._status_ns = self._supervision_ns = self._awake_ns
        self._turns_at_boot = self._motor.turns
        self._motor.command(Mode.COAST)

    # Faults from outside ------------------------------------------------------------------------

    def trip(self, code: int) -> None:
        """Trip a fault: no power and no commands for `fault_stop_ms`, then it is cleared."""
        self.fault = code
        self._fault_until_ns = self._now_ns + self._settings.fault_stop_ms * MS
        self._motor.command(Mode.COAST)
        self._reschedule()

    def configure(self, timeout_ms: int, brake_current_a: float) -> None:
        """Set the settings for a silent host, as VESC Tool does: stored."""
        self.timeout_ms, self.brake_current_a = timeout_ms, brake_current_a
        self._store.save({_TIMEOUT: timeout_ms, _BRAKE_MA: round(brake_current_a * 1000)})

    # Time ---------------------------------------------------------------------------------------

    def _due_ns(self) -> int:
        if not self._booted:
            return self._awake_ns
        return min(self._status_ns, self._supervision_ns, self._fault_until_ns, self._answer_ns)

    def _step(self, now_ns: int) -> None:
        self._run_to(now_ns)
        if not self._booted:
            self._booted = True
            if self._settings.notifies_boot:
                self._tell(57, bytes((self._fitting.number,)))
        if now_ns >= self._answer_ns:
            self.send(*self._answers.popleft())
            self._answer_ns = now_ns + FRAME_NS if self._answers else NEVER_NS
        if now_ns >= self._fault_until_ns:
            self.fault = 0
            self._fault_until_ns = NEVER_NS
        if now_ns >= self._supervision_ns:
            self._supervision_ns = now_ns + SUPERVISION_NS
            self._supervise(now_ns)
        if now_ns >= self._status_ns:
            rate_hz = self._fitting.status_rate_hz
            self._status_ns = now_ns + 1_000_000_000 // rate_hz
            self._send_status()

    def _supervise(self, now_ns: int) -> None:
        """Check time-out, supply, current and temperature."""
        self._timed_out = self.timeout_ms != 0 and now_ns - self._updated_ns > self.timeout_ms * MS
        low_v, high_v = VOLTAGE_V
        supply_v = self._stage.bus_voltage_v
        motor = self._motor
        if supply_v > high_v:
            self.trip(OVER_VOLTAGE)
        elif supply_v < low_v:
            self.trip(UNDER_VOLTAGE)
        elif abs(motor.current_a) > self._settings.absolute_current_a:
            self.trip(ABSOLUTE_CURRENT)
        elif motor.axis.temperature_c > MOTOR_C:
            self.trip(MOTOR_HOT)
        elif (self._timed_out or self.kill_switch) and not self.fault:
            self._set(Mode.BRAKE_CURRENT, self.brake_current_a)

    def _send_status(self) -> None:
        motor = self._motor
        erpm = round(motor.speed_rad_s / self._rad_s_per_erpm)
        current = _limited(motor.current_a * 10, _INT16)
        supply_v = self._stage.bus_voltage_v
        duty = _limited(1000 * motor.axis.voltage_v / max(supply_v, 0.1), _INT16)
        turns = motor.turns - self._turns_at_boot
        tachometer = (math.floor(turns * 6 * self._fitting.pole_pairs) + 2**31) % 2**32 - 2**31
        supply_a = _limited(motor.axis.supply_current_a * 10, _INT16)
        temperature = _limited(motor.axis.temperature_c * 10, _INT16)
        contents = {
            1: struct.pack(">ihh", _limited(erpm, _INT32), current, duty),
            2: struct.pack(">ii", 0, 0),
            3: struct.pack(">ii", 0, 0),
            4: struct.pack(">hhhh", round(_AIR_C * 10), temperature, supply_a, 0),
            5: struct.pack(">ihh", tachometer, _limited(supply_v * 10, _INT16), 0),
            6: struct.pack(">hhhh", 0, 0, 0, 0),
        }
        for number in self._settings.status:
            self._tell(STATUS_COMMANDS[number], contents[number])

    def _tell(self, command: int, data: bytes) -> None:
        self.send(EXTENDED_FLAG | command << 8 | self._fitting.number, data)

    # Commands -----------------------------------------------------------------------------------

    def _awake(self, command: int) -> Callable[[bytes, int], None]:
        """Return the handler of a command, which a booting drive ignores."""
        take = self._commands[command]

        def handle(data: bytes, now_ns: int) -> None:
            if self._booted:
                self._run_to(now_ns)
                take(data, now_ns)

        return handle

    def _set(self, mode: Mode, value: float = 0.0) -> None:
        """Command the motor, unless a fault or the kill switch has removed power."""
        if self.fault:
            return
        if mode in (Mode.BRAKE_CURRENT, Mode.HOLD, Mode.CURRENT) and abs(value) < LEAST_CURRENT_A:
            mode, value = Mode.COAST, 0.0
        self._motor.command(mode, value)

    def _value(self, data: bytes, now_ns: int) -> int | None:
        """Return the value of a simple command and restart the time-out; None: not obeyed."""
        if len(data) < 4:
            return None
        self._updated_ns = now_ns
        self._timed_out = False
        value: int = struct.unpack_from(">i", data)[0]
        return None if self.kill_switch else value

    def _on_duty(self, data: bytes, now_ns: int) -> None:
        if (value := self._value(data, now_ns)) is not None:
            self._set(Mode.DUTY, min(max(value / 1e5, -1.0), 1.0))

    def _on_current(self, data: bytes, now_ns: int) -> None:
        if (value := self._value(data, now_ns)) is not None:
            self._set(Mode.CURRENT, value / 1e3)

    def _on_brake(self, data: bytes, now_ns: int) -> None:
        if (value := self._value(data, now_ns)) is not None:
            self._set(Mode.BRAKE_CURRENT, abs(value) / 1e3)

    def _on_handbrake(self, data: bytes, now_ns: int) -> None:
        if (value := self._value(data, now_ns)) is not None:
            self._set(Mode.HOLD, abs(value) / 1e3)

    def _on_rpm(self, data: bytes, now_ns: int) -> None:
        value = self._value(data, now_ns)
        if value is None:
            return
        most = self._settings.max_erpm
        erpm = min(max(float(value), -most), most)
        if abs(erpm) < self._settings.min_erpm:
            self._set(Mode.COAST)
        else:
            self._set(Mode.SPEED, erpm * self._rad_s_per_erpm)

    def _on_ping(self, data: bytes, _: int) -> None:
        if data:
            pong = bytes((self._fitting.number, 0))
            self.send(EXTENDED_FLAG | 18 << 8 | data[0], pong)

    # Packets ------------------------------------------------------------------------------------

    def _on_fill(self, data: bytes, _: int) -> None:
        self._buffers.fill(data[0], data[1:])

    def _on_fill_long(self, data: bytes, _: int) -> None:
        self._buffers.fill(data[0] << 8 | data[1], data[2:])

    def _on_process(self, data: bytes, now_ns: int) -> None:
        sender, how, length, crc = struct.unpack(">BBHH", data)
        packet = self._buffers.take(length, crc)
        if packet is not None:
            self._process(packet, sender if how == 0 else None, now_ns)

    def _on_process_short(self, data: bytes, now_ns: int) -> None:
        if len(data) > 2:
            self._process(data[2:], data[0] if data[1] == 0 else None, now_ns)

    def _process(self, packet: bytes, sender: int | None, now_ns: int) -> None:
        """Carry out a packet, and answer it if its sender wants that."""
        command, content = packet[0], packet[1:]
        answer = None
        if command == 0:
            answer = bytes((0, *self._settings.firmware)) + b"60_MK6\0" + bytes(range(12))
        elif command == 12 and len(content) >= 2:
            self._on_servo(struct.unpack_from(">h", content)[0] / 1000)
        elif command == 17:
            answer = bytes((17,)) + self._configuration()
        elif command == 16 or (command == 149 and self._settings.sets_timeout):
            answer = self._on_configuration(command, content)
        elif command == 29:
            self.power_cycle(now_ns)
        elif command == 50 and len(content) >= 4:
            answer = packet[:5] + self._values(int.from_bytes(content[:4], "big"))
        if answer is not None and sender is not None:
            for number, data in frames(answer, self._fitting.number):
                self._answers.append((EXTENDED_FLAG | number << 8 | sender, data))
            self._answer_ns = min(self._answer_ns, now_ns)

    def _on_servo(self, position: float) -> None:
        """Move the servo; does not restart the time-out."""
        servo = self._servo
        if servo is not None and self._tail[_SERVO_OUTPUT]:
            turn = (min(max(position, 0.0), 1.0) - servo.centre) * servo.range_deg
            self._stage.steer(math.radians(turn / servo.ratio))

    def _configuration(self) -> bytes:
        """App configuration: its known head, and a tail of which one byte is used here."""
        number = self._fitting.number
        head = _HEAD.pack(_SIGNATURE, number, self.timeout_ms, self.brake_current_a)
        return head + self._tail

    def _on_configuration(self, command: int, content: bytes) -> bytes | None:
        """Take an app configuration that has the right signature, and acknowledge it."""
        if len(content) != _HEAD.size + _TAIL_BYTES:
            return None
        signature, _, timeout_ms, brake_current_a = _HEAD.unpack_from(content)
        if signature != _SIGNATURE:
            return None
        if command == 16:
            self.configure(timeout_ms, brake_current_a)
        self.timeout_ms, self.brake_current_a = timeout_ms, brake_current_a
        self._tail[:] = content[_HEAD.size :]
        return bytes((command,))

    def _values(self, mask: int) -> bytes:
        """Values of COMM_GET_VALUES_SELECTIVE that are used here."""
        values = b""
        if mask & 1 << 15:
            values += bytes((self.fault,))
        if mask & 1 << 21 and self._settings.tells_flags:
            values += bytes((self._timed_out | self.kill_switch << 1,))
        return values


def _limited(value: float, most: int) -> int:
    return round(min(max(value, -most), most))
