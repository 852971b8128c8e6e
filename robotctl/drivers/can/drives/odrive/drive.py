"""One axis of an ODrive: commands out, estimates, state and errors in."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from robotctl.drivers.can.drives.axis import Axis
from robotctl.drivers.can.drives.motor_drive import DriveNeeds, Handler, Send
from robotctl.drivers.can.drives.odrive import faults, wire
from robotctl.drivers.can.drives.odrive.feedback import Feedback
from robotctl.drivers.can.drives.odrive.latch import Latch
from robotctl.drivers.can.drives.odrive.service import Phase, Service
from robotctl.drivers.can.drives.odrive.state import DRIVE, ENTER, STOP, AxisMachine
from robotctl.messages.actuators import ActuatorCommand, ActuatorFeedback, DriveState
from robotctl.messages.control import EmergencyStopSource, NodeStatus
from robotctl.messages.faults import FaultCode

_TURN: Final = 2.0 * math.pi
_VELOCITY_MAX: Final = wire.VELOCITY_MAX
_EIGHT: Final = bytes(8)
_TURNS_06: Final = (
    *(wire.ERROR, wire.IQ, wire.TEMPERATURE),
    *(wire.ERROR, wire.IQ, wire.BUS_VOLTAGE_CURRENT),
)
_TURNS_05: Final = (
    *(wire.MOTOR_ERROR, wire.IQ, wire.ENCODER_ERROR),
    *(wire.CONTROLLER_ERROR, wire.IQ, wire.BUS_VOLTAGE_CURRENT),
)
"""Messages asked for in turn, one a tick, besides the estimates."""


class ODrive:
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
        self._node_id = node_id
        self._axis = axis
        self._notes = needs.notes
        self._velocity_id = wire.can_id(node_id, wire.SET_INPUT_VEL)
        self._state_id = wire.can_id(node_id, wire.SET_AXIS_STATE)
        self._mode_id = wire.can_id(node_id, wire.SET_CONTROLLER_MODE)
        self._estimates_request = wire.request_id(node_id, wire.ENCODER_ESTIMATES)
        self._turns_05, self._turns_06 = (
            tuple(wire.request_id(node_id, command) for command in turns)
            for turns in (_TURNS_05, _TURNS_06)
        )
        self._turns: tuple[int, ...] = ()
        self._turn = 0
        self._machine = AxisMachine()
        self._latch = Latch(name)
        self._clear_asked = False
        self._feedback = Feedback(axis, self._unreadable)
        self._service = Service(
            name, node_id, needs.command_timeout_ms, needs.heartbeat_timeout_ms, endpoints
        )
        self._ready = False
        """Whether it is in service and nothing is latched."""
        self.proof: str | None = None
        self.wants_sync = False
        self.host_frames: Mapping[int, str] = {
            self._velocity_id: "Set_Input_Vel",
            self._state_id: "Set_Axis_State",
            self._mode_id: "Set_Controller_Mode",
            wire.can_id(node_id, wire.CLEAR_ERRORS): "Clear_Errors",
        }
        self.handlers: Mapping[int, Handler] = self._make_handlers()
        self.reports: tuple[ActuatorFeedback, ...] = (ActuatorFeedback(),)
        self.status: NodeStatus
        self._refresh()

    def _make_handlers(self) -> dict[int, Handler]:
        """Return what takes the messages of either firmware."""
        handlers: dict[int, Handler] = {
            wire.HEARTBEAT: self._on_heartbeat,
            wire.ENCODER_ESTIMATES: self._feedback.on_estimates,
            wire.IQ: self._feedback.on_current,
            wire.BUS_VOLTAGE_CURRENT: self._feedback.on_voltage,
            wire.TEMPERATURE: self._on_temperature,
            wire.ERROR: self._on_error,
            wire.ENCODER_ERROR: self._on_encoder_error,
            wire.CONTROLLER_ERROR: self._on_controller_error,
            wire.VERSION: self._answers(wire.VERSION),
            wire.ENCODER_COUNT: self._answers(wire.ENCODER_COUNT),
            wire.TX_SDO: self._answers(wire.TX_SDO),
        }
        return {wire.can_id(self._node_id, command): each for command, each in handlers.items()}

    # Messages of the drive ----------------------------------------------------------------------

    def _on_heartbeat(self, data: bytes, stamp_ns: int) -> None:
        """Take state and errors of the axis."""
        is_old = self._service.is_old
        if why := wire.strange_heartbeat(data, is_old=is_old):
            self._unreadable("heartbeat", data, why)
            return
        error, axis_state, result, more, last = wire.HEARTBEATS.unpack(data)
        self._feedback.state_ns = stamp_ns
        left = self._machine.heard(axis_state)
        self._service.heard(stamp_ns)
        if is_old:
            self._judge(error, stamp_ns, flagged=bool(result | more | last & 1))
        elif is_old is False:
            if result >= faults.FIRST_REFUSAL and self._machine.is_refusal(stamp_ns):
                self._latch.hold(FaultCode.DRIVE_FAULT, faults.refusal(result), DriveState.FAULT)
            self._judge(error & ~faults.INITIALIZING, stamp_ns)
            if error & faults.INITIALIZING:
                self._restart(FaultCode.NODE_RESTARTED, "the ODrive restarted")
        if left and self._latch.fault is None:
            text = "the ODrive left closed-loop control without an error: it restarted, or another "
            self._restart(FaultCode.DRIVE_STOPPED, text + "device on the bus stopped it")
        self._refresh()

    def _judge(self, error: int, stamp_ns: int, *, flagged: bool = False) -> None:
        """Latch the errors in a heartbeat; with none, unlatch after a clearing.

        Parameters
        ----------
        error
            Errors of the axis.
        stamp_ns
            Reception [ns].
        flagged
            Whether 0.5 has an error of motor, encoder or controller: which one is asked for.
        """
        latch = self._latch
        if latch.is_stale(stamp_ns):
            return
        if error:
            latch.add(is_old=bool(self._service.is_old), axis=error)
        elif flagged and not latch.has_errors:
            text = "the ODrive reports an error of motor, encoder or controller"
            latch.hold(FaultCode.DRIVE_FAULT, text, DriveState.FAULT)
        latch.judge(clean=not error and not flagged)

    def _restart(self, code: FaultCode, text: str) -> None:
        """Commission the drive again, which may have restarted."""
        self._latch.hold(code, text, DriveState.STOPPED)
        self._latch.keep()
        self._service.restart()

    def _on_temperature(self, data: bytes, stamp_ns: int) -> None:
        """Take the temperatures of 0.6; in 0.5 the message is another."""
        if self._service.is_old is False:
            self._feedback.on_temperature(data, stamp_ns)

    def _on_error(self, data: bytes, stamp_ns: int) -> None:
        """Take the errors of 0.6, or of the motor of 0.5."""
        is_old = self._service.is_old
        if is_old is None or not self._is_whole("error", data, stamp_ns):
            return
        if is_old:
            self._add(motor=wire.LONG_ERRORS.unpack(data)[0])
        else:
            active, reason = wire.ERRORS.unpack(data)
            self._add(axis=(active | reason) & ~faults.INITIALIZING)

    def _on_encoder_error(self, data: bytes, stamp_ns: int) -> None:
        """Take the errors of the encoder of 0.5."""
        if self._service.is_old and self._is_whole("encoder error", data, stamp_ns):
            self._add(encoder=wire.ERRORS.unpack(data)[0])

    def _on_controller_error(self, data: bytes, stamp_ns: int) -> None:
        """Take the errors of the controller of 0.5."""
        if self._service.is_old and self._is_whole("controller error", data, stamp_ns):
            self._add(controller=wire.ERRORS.unpack(data)[0])

    def _is_whole(self, name: str, data: bytes, stamp_ns: int) -> bool:
        """Return whether a message about errors is to be judged."""
        if len(data) != 8:
            self._unreadable(name, data, "it has 8 bytes")
            return False
        return not self._latch.is_stale(stamp_ns)

    def _add(self, *, axis: int = 0, motor: int = 0, encoder: int = 0, controller: int = 0) -> None:
        """Latch errors of the drive."""
        if axis or motor or encoder or controller:
            self._latch.add(
                is_old=bool(self._service.is_old),
                axis=axis,
                motor=motor,
                encoder=encoder,
                controller=controller,
            )
            self._refresh()

    def _answers(self, command: int) -> Handler:
        """Return what takes a message that only comes as an answer."""
        service = self._service

        def handle(data: bytes, _: int) -> None:
            service.take(command, data)

        return handle

    def _unreadable(self, name: str, data: bytes, why: str) -> None:
        """Latch that a message says nothing."""
        text = f"the ODrive's {name} is unreadable: {data.hex(' ') or 'no bytes'} ({why})"
        self._latch.hold(FaultCode.DRIVE_UNREADABLE, text, DriveState.FAULT)
        self._refresh()

    # The port -----------------------------------------------------------------------------------

    def _refresh(self) -> None:
        """Follow the service and the latch."""
        service = self._service
        self.status, self.proof = service.status, service.proof
        self._ready = service.phase is Phase.READY and self._latch.fault is None
        self._feedback.is_new = True
        is_old = service.is_old
        turns = () if is_old is None else self._turns_05 if is_old else self._turns_06
        if turns is not self._turns:
            self._turns, self._turn = turns, 0

    def check(self, now_ns: int) -> None:
        """Judge what was received up to now."""
        service = self._service
        phase = service.phase
        if stopped := service.check(now_ns):
            self._latch.hold(
                stopped.code, f"the ODrive is out of service: {stopped}", DriveState.STOPPED
            )
            self._latch.keep()
        if service.phase is not phase or stopped:
            self._refresh()
        if self._feedback.is_new:
            self.reports = (self._feedback.report(self._state(), self._latch.fault),)

    def _state(self) -> DriveState:
        """Return the state to report."""
        if self._latch.fault is not None:
            return self._latch.state
        if self._machine.axis_state == wire.AXIS_CLOSED_LOOP:
            return DriveState.ENABLED
        return DriveState.READY if self._ready else DriveState.BOOT

    def command(self, send: Send, command: ActuatorCommand, now_ns: int) -> None:
        """Send the command of this tick, and ask for what the drive tells only when asked."""
        if not self._service.boots:
            return
        turns_per_s = 0.0
        enable = command.enable
        if enable and command.values:
            turns_per_s = self._axis.to_motor(command.values[0]) / _TURN
            # False for nan, too.
            if not -_VELOCITY_MAX <= turns_per_s <= _VELOCITY_MAX:
                enable = False
                self._notes.refused += 1
        step = self._machine.next(now_ns, enable=enable, ready=self._ready)
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
        if self._clear_asked and self._service.phase is Phase.READY:
            data = b"" if self._service.is_old else b"\0"
            if not send(wire.can_id(self._node_id, wire.CLEAR_ERRORS), data):
                return False
            self._clear_asked = False
            self._latch.clear(now_ns)
            return True
        # A drive that is not in service has a cause that is not gone.
        self._clear_asked = False
        return self._service.serve(send, now_ns)

    def emergency_stop(self, send: Send, source: EmergencyStopSource) -> bool:
        """Take the power at once; the drive latches it, too."""
        self._clear_asked = False
        words = source.name.lower().replace("_", " ")
        self._latch.stop(f"the ODrive is in emergency stop ({words})")
        self._refresh()
        return send(wire.can_id(self._node_id, wire.ESTOP), b"")

    def clear_faults(self) -> None:
        """Leave latched states with the next `serve`, if the causes are gone."""
        self._clear_asked = True
