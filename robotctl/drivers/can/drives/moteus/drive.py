"""One moteus on the bus: a motor by speed."""

from __future__ import annotations

import math
from typing import Final

from robotctl.drivers.can.bus_part import Send
from robotctl.drivers.can.drives.axis import Axis
from robotctl.drivers.can.drives.moteus import wire
from robotctl.drivers.can.drives.moteus.settings import MoteusSettings
from robotctl.drivers.can.drives.moteus.state import MoteusState
from robotctl.drivers.can.drives.motor_drive import DriveNeeds
from robotctl.drivers.can.drives.session_drive import SessionDrive
from robotctl.messages.actuators import NEVER_NS, ActuatorCommand, ActuatorFeedback
from robotctl.messages.control import EmergencyStopSource

READING_NS: Final = 1_000_000_000
"""Period of reading the settings again [ns]."""

CLEARING_NS: Final = 100_000_000
"""Time within which a stop must have cleared a fault [ns]."""

_STOP, _QUERY = wire.pack_mode(wire.STOPPED), wire.pack_query()
_BRAKE: Final = wire.pack_mode(wire.BRAKE)
_SPEED_MAX_TURNS_S: Final = 1e4
"""Maximum commanded speed [turn/s]: no motor turns faster."""


class MoteusDrive(SessionDrive):
    """A `MotorDrive`.

    Parameters
    ----------
    name
        Name of the drive.
    number
        Number of it on the bus.
    axis
        Its motor.
    needs
        Demands of the robot.
    timeout_mode
        Mode in which it goes when the host is silent.
    """

    def __init__(
        self, name: str, number: int, axis: Axis, needs: DriveNeeds, timeout_mode: int
    ) -> None:
        self._command_id = command_id = wire.command_id(number)
        timeout_ms = needs.command_timeout_ms
        settings = MoteusSettings(number, timeout_ms, timeout_mode)
        super().__init__(name, number, (command_id, _QUERY), settings, READING_NS, needs)
        self._axis = axis
        self._state = MoteusState(name, timeout_ms)
        self._watchdog_s = timeout_ms * 1e-3
        self._turns_s_per_rad_s = axis.to_motor(1.0) / math.tau
        self._clearing_ns = NEVER_NS
        """Until when a fault is being cleared [ns]."""
        self._stamp_ns = NEVER_NS
        self._turns = self._turns_s = 0.0
        self._current = self._supply = self._temperature = 0
        self._is_new = False
        self.handlers = dict.fromkeys(wire.answer_ids(number), self._on_answer)
        self.host_frames = {
            command_id: f"command of {name}",
            wire.command_id(number, answered=False): f"text for {name}",
        }

    # Receiving ----------------------------------------------------------------------------------

    def _on_answer(self, data: bytes, stamp_ns: int) -> None:
        """Take a frame of the drive: its status, or an answer to a question of `serve`."""
        self._session.hear(stamp_ns)
        status = wire.unpack_status(data)
        if status is None:
            self._on_other(data, stamp_ns)
            return
        mode, turns, turns_s, current, supply, temperature, fault, counter = status
        state = self._state
        if state.count(counter, stamp_ns):
            self._session.restart()
            return
        state.take(mode, fault)
        # Also false for nan; a drive in a fault may know neither.
        if abs(turns) < math.inf and abs(turns_s) < math.inf:
            self._turns, self._turns_s = turns, turns_s
        elif mode != wire.FAULT:
            state.unreadable(f"its position is {turns} turns, its velocity is {turns_s} turns/s")
        self._current, self._supply, self._temperature = current, supply, temperature
        self._stamp_ns = stamp_ns
        self._is_new = True

    def _on_other(self, data: bytes, stamp_ns: int) -> None:
        """Take a frame that is no status."""
        known = data.startswith(wire.VERSIONS_ANSWER) or wire.unpack_text(data) is not None
        if known:
            self._session.answer(data, stamp_ns)
        else:
            text = f"an answer of {len(data)} bytes ({data.hex(' ')}) is not to be understood"
            self._state.unreadable(text)

    def _restarted(self, _: int) -> None:
        self._state.restart()

    def _follow(self, in_service: bool) -> bool:
        return self._state.update(in_service) or self._is_new

    def _report(self) -> tuple[ActuatorFeedback, ...]:
        self._is_new = False
        stamp_ns, axis, state = self._stamp_ns, self._axis, self._state
        if stamp_ns == NEVER_NS:
            return (ActuatorFeedback(state=state.state, fault=state.interlock.fault),)
        wheel = ActuatorFeedback(
            stamp_ns,
            -1,
            axis.ticks(self._turns),
            self._turns_s / self._turns_s_per_rad_s,
            None,
            stamp_ns,
            state.state,
            state.interlock.fault,
            axis.current_a(wire.AMPERES * self._current),
            wire.DEGREES * self._temperature,
            stamp_ns,
            wire.VOLTS * self._supply,
        )
        return (wheel,)

    # Sending ------------------------------------------------------------------------------------

    def command(self, send: Send, command: ActuatorCommand, now_ns: int) -> None:
        """Send the command of this tick, with the question that its answer is the report of."""
        state = self._state
        if state.admit(command.enable, self._session.in_service, now_ns):
            values = command.values
            turns_s = self._turns_s_per_rad_s * values[0] if values else 0.0
            # Also false for nan.
            if -_SPEED_MAX_TURNS_S <= turns_s <= _SPEED_MAX_TURNS_S:
                send(self._command_id, wire.pack_velocity(turns_s, self._watchdog_s))
                return
            self._notes.refused += 1
            state.refuse()
        if state.mode == wire.FAULT:
            # No power is given; a stop would clear the fault before anybody asked for that.
            send(self._command_id, _QUERY if now_ns > self._clearing_ns else _STOP)
        else:
            send(self._command_id, _BRAKE if command.brake else _STOP)

    def serve(self, send: Send, now_ns: int) -> bool:
        """Send at most one frame of identification or settings."""
        if self._clear_wanted:
            self._clear_wanted = False
            self._clearing_ns = now_ns + CLEARING_NS
        if now_ns <= self._clearing_ns and self._state.clear():
            self._clearing_ns = NEVER_NS
        return self._session.serve(send, now_ns)

    def emergency_stop(self, send: Send, source: EmergencyStopSource) -> bool:
        """Short the motor, and stay so until `clear_faults`: a latch of the host."""
        self._state.interlock.stop(source)
        self._clear_wanted = False
        self._clearing_ns = NEVER_NS
        return send(self._command_id, _BRAKE)
