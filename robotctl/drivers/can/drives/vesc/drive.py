"""One VESC on the bus: a motor by speed, and a steering by its servo output."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from robotctl.drivers.can.bus_part import Handler, Send
from robotctl.drivers.can.drives.axis import Axis
from robotctl.drivers.can.drives.motor_drive import DriveNeeds
from robotctl.drivers.can.drives.session_drive import SessionDrive
from robotctl.drivers.can.drives.vesc import wire
from robotctl.drivers.can.drives.vesc.feedback import VescFeedback
from robotctl.drivers.can.drives.vesc.settings import Silence, VescSettings
from robotctl.drivers.can.drives.vesc.state import VescState
from robotctl.drivers.can.drives.vesc.steering import Servo, Steering
from robotctl.messages.actuators import ActuatorCommand, ActuatorFeedback
from robotctl.messages.control import EmergencyStopSource
from robotctl.model.actuators import Takes

QUERY_NS: Final = 20_000_000
"""Period of asking for fault code and flags [ns]."""

READING_NS: Final = 2_000_000_000
"""Period of reading the settings again [ns]: 70 frames of eight bytes."""

STANDS_ERPM: Final = 60
"""Speed below which a braked wheel is held by the handbrake [erpm]."""


class Currents(NamedTuple):
    """Motor currents to brake, and to hold a wheel that stands [A]."""

    brake_a: float
    handbrake_a: float


class VescDrive(SessionDrive):
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
        self._motor = next(i for i, axis in enumerate(axes) if axis.takes is Takes.SPEED)
        self._joint = next((i for i, axis in enumerate(axes) if axis.takes is Takes.ANGLE), -1)
        self._steering: Steering | None = None
        if self._joint >= 0:
            self._steering = Steering(axes[self._joint], servo, number, reply_to)
        call = wire.identifier(wire.PING, number), bytes((reply_to,))
        steers = self._joint >= 0
        settings = VescSettings(number, reply_to, silence, writes, steers, self._missing)
        super().__init__(name, number, call, settings, READING_NS, needs, len(axes))
        axis = axes[self._motor]
        self._state = VescState(name, silence.timeout_ms)
        self._feedback = VescFeedback(
            self._session,
            self._state,
            axis,
            pole_pairs,
            needs.max_rad_s,
            motor_temperature=motor_temperature,
        )
        self._erpm_per_rad_s = axis.to_motor(60.0 * pole_pairs / math.tau)
        self._rpm_id = wire.identifier(wire.SET_RPM, number)
        self._coast = wire.identifier(wire.SET_CURRENT, number), wire.pack_value(0)
        self._brake = self._hold = _of_current(wire.SET_CURRENT_BRAKE, number, currents.brake_a)
        if currents.handbrake_a > 0.0:
            self._hold = _of_current(wire.SET_CURRENT_HANDBRAKE, number, currents.handbrake_a)
        self._query = wire.query(number, reply_to)
        self._query_ns = 0
        self.handlers = self._handle(number, reply_to)
        self.host_frames = {
            wire.identifier(command, number): f"{words} of {name}"
            for command, words in wire.HOST_COMMANDS.items()
        }

    def _handle(self, number: int, reply_to: int) -> dict[int, Handler]:
        """Return the handlers of all frames that concern the drive."""
        feedback, assembly = self._feedback, wire.Reassembly(number, self._on_packet)
        own: dict[int, Handler] = {
            wire.STATUS: feedback.on_status,
            wire.STATUS_4: feedback.on_status_4,
            wire.STATUS_5: feedback.on_status_5,
            wire.NOTIFY_BOOT: feedback.on_boot,
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

    def _on_pong(self, data: bytes, stamp_ns: int) -> None:
        if data[:1] == bytes((self._session.node_id,)):
            self._session.hear(stamp_ns)

    def _on_packet(self, packet: bytes, stamp_ns: int) -> None:
        self._session.hear(stamp_ns)
        report = wire.unpack_report(packet)
        if report is None:
            self._session.answer(packet, stamp_ns)
            return
        self._feedback.report_ns = stamp_ns
        self._state.take(report)
        self._feedback.is_new = True

    def _missing(self) -> str:
        return self._feedback.missing()

    def _restarted(self, now_ns: int) -> None:
        self._feedback.since_ns = now_ns
        self._state.restart()

    def _follow(self, in_service: bool) -> bool:
        if self._session.silent:
            self._feedback.forget()
        return self._state.update(in_service) or self._feedback.is_new

    def _report(self) -> tuple[ActuatorFeedback, ...]:
        wheel = self._feedback.wheel()
        if self._steering is None:
            return (wheel,)
        told = wheel.speed_rad_s is not None
        joint = ActuatorFeedback(
            wheel.motion_ns,
            -1,
            0,
            None,
            self._steering.angle_rad if told else None,
            wheel.report_ns,
            wheel.state,
            wheel.fault,
            None,
            None,
            wheel.supply_ns,
            wheel.voltage_v,
        )
        return (wheel, joint) if self._motor == 0 else (joint, wheel)

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
        steering = self._steering
        speed = values[self._motor] if values else 0.0
        angle = values[self._joint] if values and steering is not None else 0.0
        erpm = speed * self._erpm_per_rad_s
        # Also false for nan.
        if not -wire.ERPM_MAX <= erpm <= wire.ERPM_MAX or not (
            steering is None or steering.steer(send, angle, now_ns)
        ):
            self._notes.refused += 1
            self._state.refuse()
            self._stop(send)
            return
        send(self._rpm_id, wire.pack_value(round(erpm)))

    def _stop(self, send: Send) -> bool:
        """Brake a wheel that turns, hold one that stands."""
        return send(*(self._hold if abs(self._feedback.erpm) < STANDS_ERPM else self._brake))

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


def _of_current(command: int, number: int, current_a: float) -> tuple[int, bytes]:
    """Return the frame of a motor current [A]."""
    return wire.identifier(command, number), wire.pack_value(round(1000.0 * current_a))
