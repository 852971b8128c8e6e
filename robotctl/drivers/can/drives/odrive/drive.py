"""One axis of an ODrive: commands out, estimates, state and errors in."""

from __future__ import annotations

import math
from typing import Final

from robotctl.drivers.can.bus_part import Handler, Send
from robotctl.drivers.can.drives.axis import Axis
from robotctl.drivers.can.drives.motor_drive import DriveNeeds
from robotctl.drivers.can.drives.odrive import faults, wire
from robotctl.drivers.can.drives.odrive.errors import Errors
from robotctl.drivers.can.drives.odrive.feedback import Feedback
from robotctl.drivers.can.drives.odrive.settings import READING_NS, ODriveSettings, answer_of
from robotctl.drivers.can.drives.odrive.state import DRIVE, ENTER, STOP, AxisMachine
from robotctl.drivers.can.drives.odrive.wire import Command, NewCommand, OldCommand
from robotctl.drivers.can.drives.session_drive import SessionDrive
from robotctl.messages.actuators import ActuatorCommand, ActuatorFeedback, DriveState
from robotctl.messages.control import EmergencyStopSource
from robotctl.messages.faults import Fault, FaultCode

_TURN: Final = 2.0 * math.pi
_VELOCITY_MAX: Final = wire.VELOCITY_MAX
_EIGHT: Final = bytes(8)

_TURNS_06: Final = (
    *(NewCommand.ERROR, Command.IQ, NewCommand.TEMPERATURE),
    *(NewCommand.ERROR, Command.IQ, Command.BUS_VOLTAGE_CURRENT),
)
_TURNS_05: Final = (
    *(OldCommand.MOTOR_ERROR, Command.IQ, OldCommand.ENCODER_ERROR),
    *(OldCommand.CONTROLLER_ERROR, Command.IQ, Command.BUS_VOLTAGE_CURRENT),
)
"""Messages asked for in turn, one a tick, besides the estimates."""


class ODrive(SessionDrive):
    """A `MotorDrive`: see there.

    Parameters
    ----------
    name
        Its name.
    node_id
        Its number on the bus.
    axis
        The wheel on it.
    needs
        Demands of the robot.
    endpoints
        Those of its watchdog, or none.
    """

    def __init__(
        self,
        name: str,
        node_id: int,
        axis: Axis,
        needs: DriveNeeds,
        endpoints: tuple[int, ...] = (),
    ) -> None:
        self._settings = ODriveSettings(node_id, needs.command_timeout_ms, endpoints)
        super().__init__(name, node_id, None, self._settings, READING_NS, needs)
        self._node_id = node_id
        self._axis = axis
        self._velocity_id = wire.can_id(node_id, Command.SET_INPUT_VEL)
        self._state_id = wire.can_id(node_id, Command.SET_AXIS_STATE)
        self._mode_id = wire.can_id(node_id, Command.SET_CONTROLLER_MODE)
        self._estimates_request = wire.request_id(node_id, Command.ENCODER_ESTIMATES)
        self._turns_05, self._turns_06 = (
            tuple(wire.request_id(node_id, command) for command in turns)
            for turns in (_TURNS_05, _TURNS_06)
        )
        self._turns: tuple[int, ...] = ()
        self._turn = 0
        self._machine = AxisMachine(name)
        self._interlock = self._machine.interlock
        self._errors = Errors(name, self._interlock, self._unreadable, self._explain)
        self._feedback = Feedback(axis, self._unreadable)
        self._in_service = False
        self.host_frames = {
            self._velocity_id: "Set_Input_Vel",
            self._state_id: "Set_Axis_State",
            self._mode_id: "Set_Controller_Mode",
            wire.can_id(node_id, Command.CLEAR_ERRORS): "Clear_Errors",
        }
        self.handlers = self._make_handlers()

    def _make_handlers(self) -> dict[int, Handler]:
        """Return what takes the messages of either firmware."""
        handlers: dict[int, Handler] = {
            Command.HEARTBEAT: self._on_heartbeat,
            Command.ENCODER_ESTIMATES: self._feedback.on_estimates,
            Command.IQ: self._feedback.on_current,
            Command.BUS_VOLTAGE_CURRENT: self._feedback.on_voltage,
            NewCommand.TEMPERATURE: self._on_temperature,
            NewCommand.ERROR: self._errors.on_error,
            OldCommand.ENCODER_ERROR: self._errors.on_encoder_error,
            OldCommand.CONTROLLER_ERROR: self._errors.on_controller_error,
            NewCommand.VERSION: self._answers(NewCommand.VERSION),
            OldCommand.ENCODER_COUNT: self._answers(OldCommand.ENCODER_COUNT),
            NewCommand.TX_SDO: self._answers(NewCommand.TX_SDO),
        }
        return {wire.can_id(self._node_id, command): each for command, each in handlers.items()}

    # Messages of the drive ----------------------------------------------------------------------

    def _on_heartbeat(self, data: bytes, stamp_ns: int) -> None:
        """Take state and errors of the axis."""
        is_old = self._errors.is_old
        if why := wire.strange_heartbeat(data, is_old=is_old):
            self._unreadable("heartbeat", data, why)
            return
        error, axis_state, result, more, last = wire.HEARTBEATS.unpack(data)
        self._feedback.state_ns = stamp_ns
        left = self._machine.heard(axis_state)
        self._session.hear(stamp_ns)
        if is_old:
            self._errors.judge(error, stamp_ns, flagged=bool(result | more | last & 1))
        elif is_old is False:
            if result >= faults.FIRST_REFUSAL and self._machine.is_refusal(stamp_ns):
                text = faults.refusal(result)
                self._interlock.hold(DriveState.FAULT, FaultCode.DRIVE_FAULT, text)
            self._errors.judge(error & ~faults.INITIALIZING, stamp_ns)
            if error & faults.INITIALIZING:
                self._restart(FaultCode.NODE_RESTARTED, "the ODrive restarted")
        if left and self._interlock.state is None:
            text = "the ODrive left closed-loop control without an error: it restarted, or another "
            self._restart(FaultCode.DRIVE_STOPPED, text + "device on the bus stopped it")
        self._refresh()

    def _restart(self, code: FaultCode, text: str) -> None:
        """Commission the drive again, which may have restarted."""
        self._interlock.hold(DriveState.STOPPED, code, text)
        self._session.restart()

    def _on_temperature(self, data: bytes, stamp_ns: int) -> None:
        """Take the temperatures of 0.6; in 0.5 the message is another."""
        if self._errors.is_old is False:
            self._feedback.on_temperature(data, stamp_ns)

    def _answers(self, command: int) -> Handler:
        """Return what takes a message that only comes as an answer."""
        session = self._session

        def handle(data: bytes, stamp_ns: int) -> None:
            session.answer(answer_of(command, data), stamp_ns)

        return handle

    def _unreadable(self, name: str, data: bytes, why: str) -> None:
        """Latch that a message cannot be read."""
        text = f"the ODrive's {name} is unreadable: {data.hex(' ') or 'no bytes'} ({why})"
        self._interlock.hold(DriveState.FAULT, FaultCode.DRIVE_UNREADABLE, text)
        self._refresh()

    def _explain(self, fault: Fault) -> None:
        """Latch what the drive says of itself."""
        self._interlock.explain(fault)
        self._refresh()

    # The port -----------------------------------------------------------------------------------

    @property
    def proof(self) -> str | None:
        """Its settings for a silent host, in words; None while it is not in service."""
        return self._settings.proof if self._errors.is_old is not None else None

    def _refresh(self) -> None:
        """Follow the session and the latch."""
        self._feedback.is_new = True
        in_service = self._session.in_service
        if in_service is self._in_service:
            return
        self._in_service = in_service
        settings, fault = self._settings, self._session.fault
        self._errors.is_old, self._turns = None, ()
        if fault is None:
            self._errors.is_old = settings.is_old
            self._turns, self._turn = self._turns_05 if settings.is_old else self._turns_06, 0
        else:
            text = f"the ODrive is out of service: {fault}"
            self._interlock.hold(DriveState.STOPPED, fault.code, text)
            self._errors.keep()

    def _follow(self, in_service: bool) -> bool:
        if in_service is not self._in_service:
            self._refresh()
        return self._feedback.is_new

    def _report(self) -> tuple[ActuatorFeedback, ...]:
        return (self._feedback.report(self._state(), self._interlock.fault),)

    def _state(self) -> DriveState:
        """Return the state to report."""
        if self._interlock.state is not None:
            return self._interlock.state
        if self._machine.axis_state == wire.AXIS_CLOSED_LOOP:
            return DriveState.ENABLED
        return DriveState.READY if self._in_service else DriveState.BOOT

    def command(self, send: Send, command: ActuatorCommand, now_ns: int) -> None:
        """Send the command of this tick, and ask for what the drive tells only when asked."""
        if not self._session.boots:
            return
        turns_per_s = 0.0
        enable = command.enable
        if enable and command.values:
            turns_per_s = self._axis.to_motor(command.values[0]) / _TURN
            # False for nan, too.
            if not -_VELOCITY_MAX <= turns_per_s <= _VELOCITY_MAX:
                enable = False
                self._notes.refused += 1
        step = self._machine.next(now_ns, enable=enable, ready=self._in_service)
        if step == DRIVE:
            send(self._velocity_id, wire.FLOATS.pack(turns_per_s, 0.0))
        elif step == STOP:
            send(self._state_id, wire.IDLE)
        elif step == ENTER:
            send(self._mode_id, wire.VELOCITY_MODE)
            send(self._velocity_id, wire.STILL)
            send(self._state_id, wire.CLOSED_LOOP)
        else:
            send(self._velocity_id, wire.STILL)
        turns = self._turns
        if turns:
            send(self._estimates_request, _EIGHT)
            turn = self._turn
            send(turns[turn], _EIGHT)
            self._turn = turn + 1 if turn + 1 < len(turns) else 0

    def serve(self, send: Send, now_ns: int) -> bool:
        """Send at most one frame of clearing, identification or settings."""
        if self._clear_wanted and self._in_service:
            data = b"" if self._errors.is_old else b"\0"
            if not send(wire.can_id(self._node_id, Command.CLEAR_ERRORS), data):
                return False
            self._clear_wanted = False
            self._errors.clear(now_ns)
            return True
        # A drive that is not in service has a cause that is not gone.
        self._clear_wanted = False
        return self._session.serve(send, now_ns)

    def emergency_stop(self, send: Send, source: EmergencyStopSource) -> bool:
        """Take the power at once; the drive latches it, too."""
        self._clear_wanted = False
        self._errors.keep()
        self._interlock.stop(source)
        self._refresh()
        return send(wire.can_id(self._node_id, Command.ESTOP), b"")
