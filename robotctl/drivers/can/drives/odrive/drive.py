"""One axis of an ODrive: commands out, estimates, state and errors in."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from typing import Final

from robotctl.drivers.can.drives.axis import Axis
from robotctl.drivers.can.drives.motor_drive import DriveNeeds, Handler, Send
from robotctl.drivers.can.drives.odrive import faults, wire
from robotctl.drivers.can.drives.odrive.feedback import Feedback
from robotctl.drivers.can.drives.odrive.latch import Latch
from robotctl.drivers.can.drives.odrive.settings import (
    READ_BACK_NS,
    RETRY_NS,
    Commissioned,
    Commissioning,
    Query,
    Setting,
    commission,
    no_answer,
)
from robotctl.drivers.can.drives.odrive.state import DRIVE, ENTER, STOP, AxisMachine
from robotctl.messages.actuators import NEVER_NS, ActuatorCommand, ActuatorFeedback, DriveState
from robotctl.messages.control import EmergencyStopSource, NodeStatus
from robotctl.messages.faults import Fault, FaultCode

IN_SERVICE, OUT_OF_SERVICE = 5, 127
"""`NodeStatus.nmt_state`, as a CANopen node has it."""

UNREAD_MAX: Final = 5
"""Consecutive readings of a setting that may go unanswered."""

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


class Phase(enum.Enum):
    """Phases of the drive's commissioning."""

    SILENT = "no heartbeat"
    COMMISSIONING = "script runs"
    READY = "in service"
    REFUSED = "failed, waits for another attempt"


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
        self._name = name
        self._node_id = node_id
        self._axis = axis
        self._timeout_ms = needs.command_timeout_ms
        self._silent_ns = needs.heartbeat_timeout_ms * 1_000_000
        self._endpoints = (endpoints[0], endpoints[1]) if endpoints else None
        self._velocity_id = wire.can_id(node_id, wire.SET_INPUT_VEL)
        self._state_id = wire.can_id(node_id, wire.SET_AXIS_STATE)
        self._mode_id = wire.can_id(node_id, wire.SET_CONTROLLER_MODE)
        self._estimates_request = wire.request_id(node_id, wire.ENCODER_ESTIMATES)
        self._turns: tuple[int, ...] = ()
        self._turn = 0
        self._machine = AxisMachine()
        self._latch = Latch(name)
        self._clear_asked = False
        self._feedback = Feedback(axis, self._unreadable)
        self._phase = Phase.SILENT
        self._ready = False
        """Whether it is in service and nothing is latched."""
        self._commissioning = self._new_commissioning()
        self._is_old: bool | None = None
        """Whether its firmware is 0.5; None: not known."""
        self._kept: tuple[Setting, ...] = ()
        """Settings to read back; the first is next."""
        self._doubted = False
        """Whether the last reading differed."""
        self._unread = 0
        self._read_ns = self._retry_ns = self._beat_ns = NEVER_NS
        self._boots = 0
        self._problem: Fault | None = Fault(
            FaultCode.NODE_NOT_HEARD, "not heard on the bus (its heartbeat rate must not be 0)"
        )
        self.proof: str | None = None
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
        if why := self._strange_heartbeat(data):
            self._unreadable("heartbeat", data, why)
            return
        error, axis_state, result, more, last = wire.HEARTBEATS.unpack(data)
        self._beat_ns = self._feedback.state_ns = stamp_ns
        left = self._machine.heard(axis_state)
        if self._phase is Phase.SILENT:
            self._boots += 1
            self._begin()
        elif self._is_old:
            self._judge(error, bool(result | more | last & 1), stamp_ns)
        elif self._is_old is False:
            if error & faults.INITIALIZING:
                self._restart(FaultCode.NODE_RESTARTED, "the ODrive restarted")
                return
            if result >= faults.FIRST_REFUSAL and self._machine.is_refusal(stamp_ns):
                self._hold(FaultCode.DRIVE_FAULT, faults.refusal(result), DriveState.FAULT)
            self._judge(error, False, stamp_ns)
        if left and self._latch.fault is None:
            text = "the ODrive left closed-loop control without an error: it restarted, or another "
            self._restart(FaultCode.DRIVE_STOPPED, text + "device on the bus stopped it")
        self._refresh()

    def _strange_heartbeat(self, data: bytes) -> str:
        """Say why a heartbeat is none of this firmware; empty: it is one."""
        if len(data) != 8:
            return "it has 8 bytes"
        if data[4] > wire.AXIS_STATE_MAX:
            return f"axis state {data[4]} is not 0 to {wire.AXIS_STATE_MAX}"
        # Flags of 0.5 in bytes 5 to 7; a flag of 0.6 in byte 6.
        if self._is_old and (data[5] | data[6] | data[7] & 0x7F) > 1:
            return "bytes 5 to 7 are not the flags of firmware 0.5"
        if self._is_old is False and data[6] > 1:
            return "byte 6 is not the flag of firmware 0.6"
        return ""

    def _judge(self, error: int, flagged: bool, stamp_ns: int) -> None:
        """Latch the errors in a heartbeat; with none, unlatch after a clearing."""
        latch = self._latch
        if latch.is_stale(stamp_ns):
            return
        if error:
            latch.add(is_old=bool(self._is_old), axis=error)
        elif flagged and not latch.has_errors:
            text = "the ODrive reports an error of motor, encoder or controller"
            latch.hold(FaultCode.DRIVE_FAULT, text, DriveState.FAULT)
        latch.judge(clean=not error and not flagged)

    def _on_temperature(self, data: bytes, stamp_ns: int) -> None:
        """Take the temperatures of 0.6; in 0.5 the message is another."""
        if self._is_old is False:
            self._feedback.on_temperature(data, stamp_ns)

    def _on_error(self, data: bytes, stamp_ns: int) -> None:
        """Take the errors of 0.6, or of the motor of 0.5."""
        if self._is_old is None or not self._is_whole("error", data, stamp_ns):
            return
        if self._is_old:
            self._add(motor=wire.LONG_ERRORS.unpack(data)[0])
        else:
            active, reason = wire.ERRORS.unpack(data)
            self._add(axis=(active | reason) & ~faults.INITIALIZING)

    def _on_encoder_error(self, data: bytes, stamp_ns: int) -> None:
        """Take the errors of the encoder of 0.5."""
        if self._is_old and self._is_whole("encoder error", data, stamp_ns):
            self._add(encoder=wire.ERRORS.unpack(data)[0])

    def _on_controller_error(self, data: bytes, stamp_ns: int) -> None:
        """Take the errors of the controller of 0.5."""
        if self._is_old and self._is_whole("controller error", data, stamp_ns):
            self._add(controller=wire.ERRORS.unpack(data)[0])

    def _is_whole(self, name: str, data: bytes, stamp_ns: int) -> bool:
        """Return whether a message about errors is to be judged."""
        if len(data) != 8:
            self._unreadable(name, data, "it has 8 bytes")
            return False
        return not self._latch.is_stale(stamp_ns)

    def _answers(self, command: int) -> Handler:
        """Return what takes a message that only comes as an answer."""

        def handle(data: bytes, _: int) -> None:
            found = self._commissioning.take(command, data)
            if found is not None:
                self._compare(found)

        return handle

    # Faults -------------------------------------------------------------------------------------

    def _add(self, *, axis: int = 0, motor: int = 0, encoder: int = 0, controller: int = 0) -> None:
        """Latch errors of the drive."""
        if axis or motor or encoder or controller:
            self._latch.add(
                is_old=bool(self._is_old),
                axis=axis,
                motor=motor,
                encoder=encoder,
                controller=controller,
            )
            self._refresh()

    def _hold(self, code: FaultCode, text: str, state: DriveState) -> None:
        """Latch what the host found."""
        self._latch.hold(code, text, state)
        self._refresh()

    def _unreadable(self, name: str, data: bytes, why: str) -> None:
        """Latch that a message says nothing."""
        text = f"the ODrive's {name} is unreadable: {data.hex(' ') or 'no bytes'} ({why})"
        self._hold(FaultCode.DRIVE_UNREADABLE, text, DriveState.FAULT)

    def _restart(self, code: FaultCode, text: str) -> None:
        """Commission the drive again, which may have restarted."""
        self._boots += 1
        self._hold(code, text, DriveState.STOPPED)
        self._begin()

    # Service ------------------------------------------------------------------------------------

    def _new_commissioning(self) -> Commissioning:
        return Commissioning(commission(self._node_id, self._timeout_ms, self._endpoints))

    def _begin(self) -> None:
        """Start commissioning; a repeated attempt leaves the sentence of the last failure."""
        if self._phase is not Phase.REFUSED:
            self._problem = Fault(FaultCode.NODE_STARTING, "is being identified")
        self._phase = Phase.COMMISSIONING
        self._commissioning = self._new_commissioning()
        self._take_out()

    def _take_out(self) -> None:
        """Know nothing of the drive any more."""
        self._is_old, self._kept, self._turns = None, (), ()
        self._doubted, self._unread = False, 0
        self.proof = None
        self._latch.keep()
        self._refresh()

    def _finish(self, end: Commissioned | Fault, now_ns: int) -> None:
        """Put the drive into service, or say why not."""
        if isinstance(end, Fault):
            self._refuse(end, now_ns)
            return
        self._phase = Phase.READY
        self._is_old, self._kept = end.is_old, end.kept
        turns = _TURNS_05 if end.is_old else _TURNS_06
        self._turns = tuple(wire.request_id(self._node_id, command) for command in turns)
        self._turn = 0
        self._read_ns = now_ns
        self._problem = None
        self.proof = end.proof
        self._refresh()

    def _refuse(self, fault: Fault, now_ns: int) -> None:
        """Keep the drive out of service and say why; try again later."""
        self._phase = Phase.REFUSED
        self._commissioning.cancel()
        self._retry_ns = now_ns + RETRY_NS
        self._problem = fault
        self._take_out()

    def _lose(self) -> None:
        """Note that the drive is silent."""
        self._phase = Phase.SILENT
        self._commissioning.cancel()
        silence = f"no heartbeat for {self._silent_ns / 1e6:g} ms"
        self._problem = Fault(FaultCode.NODE_SILENT, silence)
        self._latch.hold(
            FaultCode.NODE_SILENT, f"the ODrive was silent: {silence}", DriveState.STOPPED
        )
        self._take_out()

    def _compare(self, found: bytes) -> None:
        """Stop the drive if a setting differs twice: once may be a damaged frame."""
        setting = self._kept[0]
        self._unread = 0
        if found == setting.wanted:
            self._doubted = False
            self._kept = (*self._kept[1:], setting)
        elif not self._doubted:
            self._doubted = True
            self._commissioning.read(setting.reading(self._node_id))
        else:
            text = f"{setting.differs(found)}: it was changed, or the drive restarted"
            self._stop_service(Fault(FaultCode.NODE_CHANGED, text))

    def _count_unread(self, query: Query) -> None:
        """Stop the drive if it answers no reading several times in a row."""
        self._unread += 1
        if self._unread > UNREAD_MAX:
            self._stop_service(no_answer(query))

    def _stop_service(self, fault: Fault) -> None:
        """Stop a drive whose settings are not what they must be."""
        text = f"the ODrive is out of service: {fault}"
        self._latch.hold(fault.code, text, DriveState.STOPPED)
        self._refuse(fault, self._beat_ns)

    def _refresh(self) -> None:
        """Update `status`."""
        fault = self._problem
        in_service = self._phase is Phase.READY
        self._ready = in_service and self._latch.fault is None
        self._feedback.is_new = True
        self.status = NodeStatus(
            self._node_id,
            self._name,
            IN_SERVICE if in_service else OUT_OF_SERVICE,
            self._beat_ns,
            self._boots,
            f"{self._name} (node {self._node_id}): {fault}" if fault else "",
            fault.code if fault else FaultCode.NONE,
        )

    # The port -----------------------------------------------------------------------------------

    def check(self, now_ns: int) -> None:
        """Judge what was received up to now."""
        if self._phase is not Phase.SILENT:
            self._check_service(now_ns)
        if self._feedback.is_new:
            self.reports = (self._feedback.report(self._state(), self._latch.fault),)

    def _check_service(self, now_ns: int) -> None:
        """Note silence, unanswered queries and the end of commissioning."""
        if now_ns - self._beat_ns > self._silent_ns:
            self._lose()
            return
        commissioning = self._commissioning
        if commissioning.waiting:
            unanswered = commissioning.expire(now_ns)
            if unanswered is not None:
                self._count_unread(unanswered)
        if self._phase is Phase.COMMISSIONING and commissioning.end is not None:
            self._finish(commissioning.end, now_ns)

    def _state(self) -> DriveState:
        """Return the state to report."""
        if self._latch.fault is not None:
            return self._latch.state
        if self._machine.axis_state == wire.AXIS_CLOSED_LOOP:
            return DriveState.ENABLED
        return DriveState.READY if self._ready else DriveState.BOOT

    def command(self, send: Send, command: ActuatorCommand, now_ns: int) -> None:
        """Send the command of this tick, and ask for what the drive tells only when asked."""
        if not self._boots:
            return
        turns_per_s = 0.0
        enable = command.enable
        if enable and command.values:
            turns_per_s = self._axis.to_motor(command.values[0]) / _TURN
            # False for nan, too.
            enable = -_VELOCITY_MAX <= turns_per_s <= _VELOCITY_MAX
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
        if self._clear_asked:
            self._clear_asked = False
            if self._phase is Phase.READY:
                return self._clear(send, now_ns)
        if self._phase is Phase.SILENT:
            return False
        if self._phase is Phase.REFUSED:
            if now_ns < self._retry_ns:
                return False
            self._begin()
        commissioning = self._commissioning
        if self._kept and now_ns - self._read_ns >= READ_BACK_NS and not commissioning.waiting:
            self._read_ns = now_ns
            commissioning.read(self._kept[0].reading(self._node_id))
        frame = commissioning.poll(now_ns)
        if frame is None or not send(*frame):
            return False
        commissioning.sent(now_ns)
        return True

    def _clear(self, send: Send, now_ns: int) -> bool:
        """Clear the errors; the next heartbeat shows whether that did it."""
        data = b"" if self._is_old else b"\0"
        if not send(wire.can_id(self._node_id, wire.CLEAR_ERRORS), data):
            self._clear_asked = True
            return False
        self._latch.clear(now_ns)
        return True

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
