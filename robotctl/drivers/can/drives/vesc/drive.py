"""One VESC on the bus: a motor by speed, and a steering by its servo output."""

from __future__ import annotations

import math
import struct
from typing import Final, NamedTuple

from robotctl.drivers.can.bus_part import Handler, Send
from robotctl.drivers.can.drives.axis import Axis, Unwrapped
from robotctl.drivers.can.drives.motor_drive import DriveNeeds
from robotctl.drivers.can.drives.session import Session
from robotctl.drivers.can.drives.vesc import wire
from robotctl.drivers.can.drives.vesc.settings import Silence, VescSettings
from robotctl.drivers.can.drives.vesc.state import VescState
from robotctl.messages.actuators import NEVER_NS, ActuatorCommand, ActuatorFeedback
from robotctl.messages.control import EmergencyStopSource, NodeStatus
from robotctl.model.actuators import Takes

QUERY_NS: Final = 20_000_000
"""Period of asking for fault code and flags [ns]."""

READING_NS: Final = 2_000_000_000
"""Period of reading the settings again [ns]: 70 frames of eight bytes."""

PAUSE_NS: Final = 100_000_000
"""Pause of status 1 after which the drive may have restarted [ns]: five of its periods at least."""

_NEVER_COMES_NS: Final = -NEVER_NS

STANDS_ERPM: Final = 60
"""Speed below which a braked wheel is held by the handbrake [erpm]."""

_MOST_OF_TURN: Final = 3
"""Greatest plausible speed of a wheel, in multiples of its maximum; a faster tachometer has been
reset."""

_SLACK_COUNTS: Final = 60
_UNPACK_STATUS, _UNPACK_STATUS_4 = wire.STATUS_DATA.unpack, wire.STATUS_4_DATA.unpack
_UNPACK_STATUS_5, _UNPACK_SHORT_5 = wire.STATUS_5_DATA.unpack, wire.SHORT_STATUS_5_DATA.unpack
_PACK_VALUE: Final = wire.pack_value
_WANTED: Final = ("status 1 (speed)", "status 5 (tachometer)")


class Currents(NamedTuple):
    """Motor currents to brake, and to hold a wheel that stands [A]."""

    brake_a: float
    handbrake_a: float


class Servo(NamedTuple):
    """Servo output: position at angle 0 [0, 1], turn over the range [rad], speed [rad/s]."""

    centre: float
    range_rad: float
    rate_rad_s: float


class VescDrive:
    """A `MotorDrive`.

    Parameters
    ----------
    name
        Name of the drive.
    number, reply_to
        Number of the VESC, and that to which it sends its answers.
    axes
        Its motor, and perhaps the joint at its servo output.
    needs
        Demands of the robot.
    pole_pairs
        Of the motor.
    silence, writes
        Wanted settings for a silent host, and whether the host writes them.
    currents, servo
        As the robot's file has them.
    motor_temperature
        Whether the temperature of the motor is told, else that of the bridge.
    """

    wants_sync = False

    def __init__(
        self,
        name: str,
        number: int,
        reply_to: int,
        axes: tuple[Axis, ...],
        needs: DriveNeeds,
        pole_pairs: int,
        silence: Silence,
        writes: bool,
        currents: Currents,
        servo: Servo,
        *,
        motor_temperature: bool,
    ) -> None:
        self._name = name
        self._notes = needs.notes
        self._motor = next(i for i, axis in enumerate(axes) if axis.takes is Takes.SPEED)
        self._joint = next((i for i, axis in enumerate(axes) if axis.takes is Takes.ANGLE), -1)
        self._axis = axes[self._motor]
        self._steering = axes[self._joint]
        self._state = VescState(name, silence.timeout_ms)
        self._settings = VescSettings(
            number, reply_to, silence, writes, self._joint >= 0, self._missing
        )
        self._session = Session(
            number,
            name,
            (wire.identifier(wire.PING, number), bytes((reply_to,))),
            self._settings.commission,
            self._settings.watch,
            READING_NS,
            needs.heartbeat_timeout_ms * 1_000_000,
        )
        self._erpm_per_rad_s = self._axis.to_motor(60.0 * pole_pairs / math.tau)
        self._rad_s_per_erpm = 1.0 / self._erpm_per_rad_s
        self._amperes = self._axis.current_a(wire.AMPERES)
        self._turns_per_count = 1.0 / (wire.TACHOMETER_PER_TURN * pole_pairs)
        fastest = _MOST_OF_TURN * abs(self._axis.to_motor(needs.max_rad_s))
        self._counts_per_ns = fastest / math.tau / self._turns_per_count * 1e-9
        self._reply_to = reply_to
        self._rpm_id, self._servo_id = (
            wire.identifier(command, number)
            for command in (wire.SET_RPM, wire.PROCESS_SHORT_BUFFER)
        )
        self._coast = wire.identifier(wire.SET_CURRENT, number), wire.pack_value(0)
        self._brake = _of_current(wire.SET_CURRENT_BRAKE, number, currents.brake_a)
        self._hold = self._brake
        if currents.handbrake_a > 0.0:
            self._hold = _of_current(wire.SET_CURRENT_HANDBRAKE, number, currents.handbrake_a)
        self._query = wire.query(number, reply_to)
        self._query_ns = 0
        self._servo_centre = servo.centre
        self._servo_at = -1
        """Position last sent to the servo [0.001], and the data of that."""
        self._servo_data = b""
        self._angle_rad = 0.0
        """Angle that the joint is taken to have, by its commands and the servo's rate [rad]."""
        self._angle_ns = 0
        self._position_per_rad = self._steering.to_motor(1.0) / servo.range_rad
        self._joint_rate_rad_s = abs(self._steering.to_wheel(servo.rate_rad_s))
        self._temperature_at = 1 if motor_temperature else 0
        self._clear_wanted = False
        self._boots = 0
        self._since_ns = 0
        """When the drive came, or restarted [ns]."""
        self._pause_ns = _NEVER_COMES_NS
        """End of the longest pause of status 1 that cannot hide a restart [ns]."""
        self._tachometer: Unwrapped | None = None
        self._turns = 0.0
        self._erpm = 0
        self._current = 0
        self._temperature_c: float | None = None
        self._voltage_v: float | None = None
        self._status_ns = self._status_5_ns = self._report_ns = NEVER_NS
        self._is_new = False
        assembly = wire.Reassembly(number, self._on_packet)
        self.handlers = self._handle(number, reply_to, assembly)
        self.host_frames = {
            wire.identifier(command, number): f"{words} of {name}"
            for command, words in wire.HOST_COMMANDS.items()
        }
        self.reports: tuple[ActuatorFeedback, ...] = (ActuatorFeedback(),) * len(axes)

    @property
    def status(self) -> NodeStatus:
        """Whether it is there and in service, and why not."""
        return self._session.status

    @property
    def proof(self) -> str | None:
        """Its settings for a silent host, as read back."""
        return self._settings.proof

    def _handle(self, number: int, reply_to: int, assembly: wire.Reassembly) -> dict[int, Handler]:
        """Return the handlers of all frames that concern the drive."""
        own: dict[int, Handler] = {
            wire.STATUS: self._on_status,
            wire.STATUS_4: self._on_status_4,
            wire.STATUS_5: self._on_status_5,
            wire.NOTIFY_BOOT: self._on_boot,
        }
        answers: dict[int, Handler] = {
            wire.PONG: self._on_pong,
            wire.FILL_RX_BUFFER: assembly.on_fill,
            wire.FILL_RX_BUFFER_LONG: assembly.on_fill_long,
            wire.PROCESS_RX_BUFFER: assembly.on_process,
            wire.PROCESS_SHORT_BUFFER: assembly.on_short,
        }
        return {
            **{wire.identifier(command, number): each for command, each in own.items()},
            **{wire.identifier(command, reply_to): each for command, each in answers.items()},
        }

    # Receiving ----------------------------------------------------------------------------------

    def _on_status(self, data: bytes, stamp_ns: int) -> None:
        if stamp_ns > self._pause_ns:
            self._on_boot(data, stamp_ns)
        self._pause_ns = stamp_ns + PAUSE_NS
        self._session.hear(stamp_ns)
        try:
            self._erpm, self._current, _ = _UNPACK_STATUS(data)
        except struct.error:
            self._unreadable("status 1", data)
        else:
            self._status_ns = stamp_ns
            self._is_new = True

    def _on_status_4(self, data: bytes, _: int) -> None:
        try:
            self._temperature_c = 0.1 * _UNPACK_STATUS_4(data)[self._temperature_at]
        except struct.error:
            self._unreadable("status 4", data)

    def _on_status_5(self, data: bytes, stamp_ns: int) -> None:
        try:
            count, supply, *_ = (_UNPACK_STATUS_5 if len(data) == 8 else _UNPACK_SHORT_5)(data)
        except struct.error:
            self._unreadable("status 5", data)
            return
        tachometer = self._tachometer
        if tachometer is None:
            tachometer = self._tachometer = Unwrapped(32)
            turned = tachometer.update(count)
        else:
            before = tachometer.value
            turned = tachometer.update(count)
            most = self._counts_per_ns * (stamp_ns - self._status_5_ns) + _SLACK_COUNTS
            if not -most <= turned - before <= most:
                self._on_boot(data, stamp_ns)
        self._turns = turned * self._turns_per_count
        self._voltage_v = 0.1 * supply
        self._status_5_ns = stamp_ns
        self._is_new = True

    def _unreadable(self, name: str, data: bytes) -> None:
        """Stop a drive that sends a frame of another length than is documented."""
        text = f"{name} has {len(data)} bytes ({data.hex(' ')}), which is not VESC's"
        self._state.unreadable(text)
        self._is_new = True

    def _on_boot(self, _: bytes, stamp_ns: int) -> None:
        self._tachometer = None
        self._pause_ns = _NEVER_COMES_NS
        if not self._session.silent:
            self._session.restart()
        self._session.hear(stamp_ns)

    def _on_pong(self, data: bytes, stamp_ns: int) -> None:
        if data[:1] == bytes((self._session.status.node_id,)):
            self._session.hear(stamp_ns)

    def _on_packet(self, packet: bytes, stamp_ns: int) -> None:
        self._session.hear(stamp_ns)
        report = wire.unpack_report(packet)
        if report is None:
            self._session.answer(packet, stamp_ns)
            return
        self._report_ns = stamp_ns
        self._state.take(report)
        self._is_new = True

    def _missing(self) -> str:
        """Name the status messages that have not come since the drive did."""
        came = (self._status_ns > self._since_ns, self._status_5_ns > self._since_ns)
        return " and no ".join(name for name, has in zip(_WANTED, came, strict=True) if not has)

    def check(self, now_ns: int) -> None:
        """Judge what was received up to now: update `reports` and `status`."""
        session = self._session
        session.check(now_ns)
        if session.boots != self._boots:
            self._boots = session.boots
            self._since_ns = now_ns
            self._state.restart()
        if not session.in_service and session.silent:
            self._tachometer = None
            self._pause_ns = _NEVER_COMES_NS
        if self._state.update(session.in_service) or self._is_new:
            self._is_new = False
            self._report()

    def _report(self) -> None:
        """Put the reports together."""
        state, axis = self._state, self._axis
        fault, report_ns = state.interlock.fault, self._report_ns
        supply_ns, voltage_v = self._status_5_ns, self._voltage_v
        motion_ns = min(self._status_ns, supply_ns)
        told = motion_ns != NEVER_NS
        wheel = ActuatorFeedback(
            motion_ns,
            -1,
            axis.ticks(self._turns),
            self._erpm * self._rad_s_per_erpm if told else None,
            None,
            report_ns,
            state.state,
            fault,
            self._current * self._amperes if told else None,
            self._temperature_c,
            supply_ns,
            voltage_v,
        )
        if self._joint < 0:
            self.reports = (wheel,)
            return
        angle_rad = self._angle_rad if told else None
        joint = ActuatorFeedback(
            motion_ns,
            -1,
            0,
            None,
            angle_rad,
            report_ns,
            state.state,
            fault,
            None,
            None,
            supply_ns,
            voltage_v,
        )
        self.reports = (wheel, joint) if self._motor == 0 else (joint, wheel)

    # Sending ------------------------------------------------------------------------------------

    def command(self, send: Send, command: ActuatorCommand, now_ns: int) -> None:
        """Send the command of this tick; a question about faults follows now and then."""
        state = self._state
        if state.admit(command.enable, self._session.in_service, now_ns):
            self._drive(send, command.values, now_ns)
        elif command.brake:
            self._stop(send)
        else:
            send(*self._coast)
        if now_ns >= self._query_ns:
            self._query_ns = now_ns + QUERY_NS
            if send(*self._query):
                state.ask(now_ns)

    def _drive(self, send: Send, values: tuple[float, ...], now_ns: int) -> None:
        """Send speed and steering; none that the wire cannot carry."""
        speed = angle = 0.0
        if values:
            speed = values[self._motor]
            angle = values[self._joint] if self._joint >= 0 else 0.0
        erpm = speed * self._erpm_per_rad_s
        # Also false for nan.
        if not -wire.ERPM_MAX <= erpm <= wire.ERPM_MAX or not self._steer(send, angle, now_ns):
            self._notes.refused += 1
            self._state.refuse()
            self._stop(send)
            return
        send(self._rpm_id, _PACK_VALUE(round(erpm)))

    def _steer(self, send: Send, angle_rad: float, now_ns: int) -> bool:
        """Move the servo, where there is one; False if it cannot reach the angle."""
        if self._joint < 0:
            return True
        position = self._servo_centre + angle_rad * self._position_per_rad
        if not -0.0005 < position < 1.0005:
            return False
        thousandths = round(1000.0 * position)
        if thousandths != self._servo_at:
            self._servo_at = thousandths
            self._servo_data = wire.pack_servo(self._reply_to, thousandths)
        send(self._servo_id, self._servo_data)
        off_rad = angle_rad - self._angle_rad
        if off_rad:
            step_rad = self._joint_rate_rad_s * min(now_ns - self._angle_ns, QUERY_NS) * 1e-9
            self._angle_rad += min(max(off_rad, -step_rad), step_rad)
        self._angle_ns = now_ns
        return True

    def _stop(self, send: Send) -> bool:
        """Brake a wheel that turns, hold one that stands."""
        return send(*(self._hold if abs(self._erpm) < STANDS_ERPM else self._brake))

    def serve(self, send: Send, now_ns: int) -> bool:
        """Send at most one frame of identification or settings."""
        if self._clear_wanted:
            self._clear_wanted = False
            self._state.clear()
        return self._session.serve(send, now_ns)

    def emergency_stop(self, send: Send, source: EmergencyStopSource) -> bool:
        """Brake, and stay so until `clear_faults`: a latch of the host, VESC has none."""
        self._state.interlock.stop(source)
        self._clear_wanted = False
        return self._stop(send)

    def clear_faults(self) -> None:
        """Leave latched states with the next `serve`, if the causes are gone."""
        self._clear_wanted = True


def _of_current(command: int, number: int, current_a: float) -> tuple[int, bytes]:
    """Return the frame of a motor current [A]."""
    return wire.identifier(command, number), wire.pack_value(round(1000.0 * current_a))
