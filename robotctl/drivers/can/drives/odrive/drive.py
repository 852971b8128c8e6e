"""One axis of an ODrive: commands out, estimates, state and errors in."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Mapping
from typing import Final

from robotctl.drivers.can.drives.axis import Axis
from robotctl.drivers.can.drives.motor_drive import DriveNeeds, Handler, Send
from robotctl.drivers.can.drives.odrive import faults, wire
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
from robotctl.drivers.can.drives.odrive.state import DRIVE, ENTER, STALE_NS, STOP, AxisMachine
from robotctl.messages.actuators import NEVER_NS, ActuatorCommand, ActuatorFeedback, DriveState
from robotctl.messages.control import EmergencyStopSource, NodeStatus
from robotctl.messages.faults import Fault, FaultCode

IN_SERVICE, OUT_OF_SERVICE = 5, 127
"""`NodeStatus.nmt_state`, as a CANopen node has it."""

UNREAD_MAX: Final = 5
"""Consecutive readings of a setting that may go unanswered."""

_TURN: Final = 2.0 * math.pi
_EIGHT: Final = bytes(8)
_TURNS_06: Final = (wire.ERROR, wire.IQ, wire.TEMPERATURE, wire.ERROR, wire.IQ, wire.BUS_VOLTAGE_CURRENT)
_TURNS_05: Final = (
    *(wire.MOTOR_ERROR, wire.IQ, wire.ENCODER_ERROR),
    *(wire.CONTROLLER_ERROR, wire.IQ, wire.BUS_VOLTAGE_CURRENT),
)
"""What is asked for in turn, one a tick, besides the estimates."""

_ENABLED, _READY, _BOOT = DriveState.ENABLED, DriveState.READY, DriveState.BOOT
_UNPACK_FLOATS = wire.FLOATS.unpack
_PACK_FLOATS = wire.FLOATS.pack


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
        self.handlers: Mapping[int, Handler] = self._make_handlers()
        self.proof: str | None = None
        self._phase = Phase.SILENT
        self._ready = False
        """Whether it is in service and nothing is latched."""
        self._machine = AxisMachine()
        self._commissioning = self._new_commissioning()
        self._is_old: bool | None = None
        """Whether its firmware is 0.5; None: not known."""
        self._kept: tuple[Setting, ...] = ()
        self._doubted = False
        self._unread = 0
        self._read_ns = NEVER_NS
        self._retry_ns = NEVER_NS
        self._problem: Fault | None = Fault(
            FaultCode.NODE_NOT_HEARD, "not heard on the bus (heartbeat_rate_ms must not be 0)"
        )
        self._boots = 0
        self._beat_ns = NEVER_NS
        self._forget_errors()
        self._latched: Fault | None = None
        self._stop_state = DriveState.STOPPED
        """State that goes with what is latched."""
        self._clear_asked = self._clearing = False
        self._clear_ns = NEVER_NS
        """When the errors were cleared; messages of just after may be older."""
        self._set_frames()
        self._turns: tuple[int, ...] = ()
        self._turn = 0
        self._motion_ns = self._state_ns = self._supply_ns = NEVER_NS
        self._turns_count = self._turns_per_s = 0.0
        self._current_a: float | None = None
        self._temperature_c: float | None = None
        self._voltage_v: float | None = None
        self._is_new = True
        """Whether the report is to be made anew."""
        self.reports: tuple[ActuatorFeedback, ...] = (ActuatorFeedback(),)
        self.status: NodeStatus
        self._refresh()

    def _set_frames(self) -> None:
        """Work out the identifiers that it sends in each tick."""
        node_id = self._node_id
        self._velocity_id = wire.can_id(node_id, wire.SET_INPUT_VEL)
        self._state_id = wire.can_id(node_id, wire.SET_AXIS_STATE)
        self._mode_id = wire.can_id(node_id, wire.SET_CONTROLLER_MODE)
        self._estimates_request = wire.request_id(node_id, wire.ENCODER_ESTIMATES)

    def _make_handlers(self) -> dict[int, Handler]:
        """Return what takes the messages of either firmware."""
        handlers: dict[int, Handler] = {
            wire.HEARTBEAT: self._on_heartbeat,
            wire.ENCODER_ESTIMATES: self._on_estimates,
            wire.IQ: self._on_current,
            wire.BUS_VOLTAGE_CURRENT: self._on_voltage,
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
        if len(data) != 8:
            self._unreadable("heartbeat", data, "it has 8 bytes")
            return
        error, axis_state, result, more, last = wire.HEARTBEATS.unpack(data)
        if axis_state > wire.AXIS_STATE_MAX:
            self._unreadable("heartbeat", data, f"axis state {axis_state} is not 0 to 14")
            return
        is_old = self._is_old
        if is_old is not None:
            # 0.5: flags of motor, encoder and controller; 0.6: bytes 5 and 6 as below.
            strange = (result | more | last & 0x7F) > 1 if is_old else more > 1
            if strange:
                version = "0.5" if is_old else "0.6"
                self._unreadable("heartbeat", data, f"bytes 5 to 7 are not those of {version}")
                return
        self._beat_ns = self._state_ns = stamp_ns
        self._is_new = True
        if self._phase is Phase.SILENT:
            self._boots += 1
            self._machine.heard(axis_state)
            self._begin()
            return
        starts_up = is_old is False and bool(error & faults.INITIALIZING)
        left = self._machine.heard(axis_state)
        if stamp_ns - self._clear_ns > STALE_NS:
            self._judge(error, result, more, last, stamp_ns)
        if starts_up and self._phase is Phase.READY:
            self._restart(FaultCode.NODE_RESTARTED, "restarted")
        elif left and self._latched is None:
            text = "left closed-loop control by itself: restarted, or stopped by another device"
            self._restart(FaultCode.DRIVE_STOPPED, text)
        self._refresh()

    def _judge(self, error: int, result: int, more: int, last: int, stamp_ns: int) -> None:
        """Latch the errors in a heartbeat; with none, unlatch after a request to clear."""
        is_old = self._is_old
        if is_old is None:
            return
        if not is_old:
            error &= ~faults.INITIALIZING
        flags = is_old and bool(result | more | last & 1)
        if error:
            self._add_errors(axis=error)
        elif flags and not (self._motor | self._encoder | self._controller):
            text = "the ODrive reports an error of motor, encoder or controller"
            self._latch(Fault(FaultCode.DRIVE_FAULT, text, self._name), DriveState.FAULT)
        elif not is_old and result >= faults.FIRST_REFUSAL and self._machine.is_refusal(stamp_ns):
            self._refused(result)
        if self._clearing:
            self._clearing = False
            if not (error or flags or self._motor or self._encoder or self._controller):
                self._latched = None
                self._refresh()

    def _refused(self, result: int) -> None:
        """Latch that closed-loop control was refused."""
        names = faults.PROCEDURE_RESULTS
        name = names[result] if result < len(names) else f"result {result}, which is not known"
        text = f"the ODrive refused closed-loop control: {name}"
        self._latch(Fault(FaultCode.DRIVE_FAULT, text, self._name), DriveState.FAULT)

    def _on_estimates(self, data: bytes, stamp_ns: int) -> None:
        """Take position and speed of the motor."""
        if len(data) != 8:
            self._unreadable("encoder estimate", data, "it has 8 bytes")
            return
        turns, turns_per_s = _UNPACK_FLOATS(data)
        # Neither sum nor difference of finite numbers of 32 bits leaves those of 64.
        if turns - turns_per_s != turns - turns_per_s or turns in _INFINITE or turns_per_s in _INFINITE:
            self._unreadable("encoder estimate", data, f"{turns} turns at {turns_per_s} turn/s")
            return
        self._turns_count, self._turns_per_s = turns, turns_per_s
        self._motion_ns = stamp_ns
        self._is_new = True

    def _on_current(self, data: bytes, stamp_ns: int) -> None:  # noqa: ARG002 - it has no age
        """Take the current along the torque-giving axis."""
        pair = self._pair("motor current", data)
        if pair is not None:
            self._current_a = self._axis.current_a(pair[1])
            self._is_new = True

    def _on_voltage(self, data: bytes, stamp_ns: int) -> None:
        """Take the supply's voltage."""
        pair = self._pair("bus voltage", data)
        if pair is not None:
            self._voltage_v, self._supply_ns = pair[0], stamp_ns
            self._is_new = True

    def _on_temperature(self, data: bytes, stamp_ns: int) -> None:  # noqa: ARG002 - it has no age
        """Take the temperatures of 0.6: a motor without a sensor has none."""
        if self._is_old is not False:
            return
        if len(data) != 8:
            self._unreadable("temperature", data, "it has 8 bytes")
            return
        told = [each for each in _UNPACK_FLOATS(data) if math.isfinite(each)]
        self._temperature_c = max(told, default=None)
        self._is_new = True

    def _pair(self, name: str, data: bytes) -> tuple[float, float] | None:
        """Return the two numbers of a message; None and a fault if it has not got them."""
        if len(data) != 8:
            self._unreadable(name, data, "it has 8 bytes")
            return None
        first, second = _UNPACK_FLOATS(data)
        if not (math.isfinite(first) and math.isfinite(second)):
            self._unreadable(name, data, f"{first} and {second}")
            return None
        return first, second

    def _on_error(self, data: bytes, stamp_ns: int) -> None:
        """Take the errors of 0.6, or of the motor of 0.5."""
        if self._is_old is None or not self._is_whole("error", data, stamp_ns):
            return
        if self._is_old:
            self._add_errors(motor=wire.LONG_ERRORS.unpack(data)[0])
        else:
            active, reason = wire.ERRORS.unpack(data)
            self._add_errors(axis=(active | reason) & ~faults.INITIALIZING)

    def _on_encoder_error(self, data: bytes, stamp_ns: int) -> None:
        """Take the errors of the encoder of 0.5."""
        if self._is_old and self._is_whole("encoder error", data, stamp_ns):
            self._add_errors(encoder=wire.ERRORS.unpack(data)[0])

    def _on_controller_error(self, data: bytes, stamp_ns: int) -> None:
        """Take the errors of the controller of 0.5."""
        if self._is_old and self._is_whole("controller error", data, stamp_ns):
            self._add_errors(controller=wire.ERRORS.unpack(data)[0])

    def _is_whole(self, name: str, data: bytes, stamp_ns: int) -> bool:
        """Return whether a message about errors is to be judged."""
        if len(data) != 8:
            self._unreadable(name, data, "it has 8 bytes")
            return False
        return stamp_ns - self._clear_ns > STALE_NS

    def _answers(self, command: int) -> Handler:
        """Return what takes a message that only comes as an answer."""

        def handle(data: bytes, stamp_ns: int) -> None:  # noqa: ARG001 - any age will do
            found = self._commissioning.take(command, data)
            if found is not None:
                self._compare(found)

        return handle

    # Faults -------------------------------------------------------------------------------------

    def _forget_errors(self) -> None:
        """Begin to collect errors."""
        self._errors = self._motor = self._encoder = self._controller = 0

    def _add_errors(
        self, *, axis: int = 0, motor: int = 0, encoder: int = 0, controller: int = 0
    ) -> None:
        """Latch errors of the drive: one that goes away by itself stays until it is cleared."""
        known = self._errors, self._motor, self._encoder, self._controller
        self._errors |= axis
        self._motor |= motor
        self._encoder |= encoder
        self._controller |= controller
        errors = self._errors, self._motor, self._encoder, self._controller
        if errors == known:
            return
        if self._is_old:
            fault = faults.old_fault(*errors, self._name)
        else:
            fault = faults.new_fault(errors[0], self._name)
        is_stop = fault.code is FaultCode.DRIVE_EMERGENCY_STOP
        self._latched = None  # what the drive itself says is nearer to the cause
        self._latch(fault, DriveState.EMERGENCY_STOP if is_stop else DriveState.FAULT)

    def _latch(self, fault: Fault, state: DriveState) -> None:
        """Keep the drive without power until `clear_faults`; the first fault stays."""
        if self._latched is None:
            self._latched, self._stop_state = fault, state
        self._refresh()

    def _unreadable(self, name: str, data: bytes, why: str) -> None:
        """Latch that a message says nothing."""
        text = f"the ODrive's {name} is unreadable: {data.hex(' ') or 'no bytes'} ({why})"
        self._latch(Fault(FaultCode.DRIVE_UNREADABLE, text, self._name), DriveState.FAULT)

    def _restart(self, code: FaultCode, text: str) -> None:
        """Commission the drive again, which may have restarted."""
        self._boots += 1
        self._latch(Fault(code, f"the ODrive {text}", self._name), DriveState.STOPPED)
        self._begin()

    # Service ------------------------------------------------------------------------------------

    def _new_commissioning(self) -> Commissioning:
        return Commissioning(commission(self._node_id, self._timeout_ms, self._endpoints))

    def _begin(self) -> None:
        """Start commissioning; a repeated attempt leaves the sentence of the last failure."""
        again = self._phase is Phase.REFUSED
        self._phase = Phase.COMMISSIONING
        self._commissioning = self._new_commissioning()
        self._is_old, self._kept, self._turns = None, (), ()
        self._doubted, self._unread = False, 0
        if not again:
            self._problem = Fault(FaultCode.NODE_STARTING, "is being identified")
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
        self._retry_ns = now_ns + RETRY_NS
        self._problem = fault
        self.proof = None
        self._refresh()

    def _lose(self) -> None:
        """Note that the drive is silent."""
        self._phase = Phase.SILENT
        silence = f"no heartbeat for {self._silent_ns / 1e6:g} ms"
        self._problem = Fault(FaultCode.NODE_SILENT, silence)
        self.proof = None
        text = f"the ODrive was silent: {silence}"
        self._latch(Fault(FaultCode.NODE_SILENT, text, self._name), DriveState.STOPPED)

    def _compare(self, found: bytes) -> None:
        """Take the drive out of service if a setting differs twice: once may be a damaged frame."""
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
            self._out_of_service(Fault(FaultCode.NODE_CHANGED, text))

    def _give_up(self, query: Query) -> None:
        """Take the drive out of service if it answers no reading several times in a row."""
        self._unread += 1
        if self._unread > UNREAD_MAX:
            self._out_of_service(no_answer(query))

    def _out_of_service(self, fault: Fault) -> None:
        """Stop a drive whose settings are not as they were."""
        self._latch(Fault(fault.code, f"the ODrive's {fault}", self._name), DriveState.STOPPED)
        self._refuse(fault, self._beat_ns)

    def _refresh(self) -> None:
        """Update `status`."""
        fault = self._problem
        in_service = self._phase is Phase.READY
        self._ready = in_service and self._latched is None
        self._is_new = True
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
        phase = self._phase
        if phase is not Phase.SILENT:
            if now_ns - self._beat_ns > self._silent_ns:
                self._lose()
            elif self._commissioning.waiting:
                unanswered = self._commissioning.expire(now_ns)
                if unanswered is not None:
                    self._give_up(unanswered)
            if phase is Phase.COMMISSIONING and self._commissioning.end is not None:
                self._finish(self._commissioning.end, now_ns)
        if self._is_new:
            self._report()

    def _report(self) -> None:
        """Make the report anew."""
        self._is_new = False
        axis, latched = self._axis, self._latched
        if latched is not None:
            state = self._stop_state
        elif self._machine.axis_state == wire.AXIS_CLOSED_LOOP:
            state = _ENABLED
        else:
            state = _READY if self._ready else _BOOT
        told = self._motion_ns != NEVER_NS
        self.reports = (
            ActuatorFeedback(
                self._motion_ns,
                -1,
                axis.ticks(self._turns_count),
                axis.to_wheel(self._turns_per_s * _TURN) if told else None,
                None,
                self._state_ns,
                state,
                latched,
                self._current_a,
                self._temperature_c,
                self._supply_ns,
                self._voltage_v,
                None,
            ),
        )

    def command(self, send: Send, command: ActuatorCommand, now_ns: int) -> None:
        """Send the command of this tick, and ask for what the drive tells only when asked."""
        if not self._boots:
            return
        value = 0.0
        enable = command.enable
        if enable and command.values:
            value = self._axis.to_motor(command.values[0]) / _TURN
            # False for nan, too.
            enable = -wire.VELOCITY_MAX <= value <= wire.VELOCITY_MAX
        step = self._machine.next(now_ns, enable=enable, ready=self._ready)
        if step == DRIVE:
            send(self._velocity_id, _PACK_FLOATS(value, 0.0))
        elif step == STOP:
            send(self._state_id, wire.IDLE)
        else:
            if step == ENTER:
                send(self._mode_id, wire.VELOCITY_MODE)
            send(self._velocity_id, wire.STILL)
            if step == ENTER:
                send(self._state_id, wire.CLOSED_LOOP)
        turns = self._turns
        if turns:
            send(self._estimates_request, _EIGHT)
            turn = self._turn
            send(turns[turn], _EIGHT)
            self._turn = turn + 1 if turn + 1 < len(turns) else 0

    def serve(self, send: Send, now_ns: int) -> bool:
        """Send at most one frame of clearing, identification or settings."""
        if self._clear_asked and self._is_old is not None:
            return self._clear(send, now_ns)
        phase = self._phase
        if phase is Phase.SILENT:
            return False
        if phase is Phase.REFUSED:
            if now_ns < self._retry_ns:
                return False
            self._begin()
        commissioning = self._commissioning
        is_due = now_ns - self._read_ns >= READ_BACK_NS
        if phase is Phase.READY and self._kept and is_due and not commissioning.waiting:
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
            return False
        self._clear_asked, self._clearing, self._clear_ns = False, True, now_ns
        self._forget_errors()
        return True

    def emergency_stop(self, send: Send, source: EmergencyStopSource) -> bool:
        """Take the power at once; the drive latches it, too."""
        words = source.name.lower().replace("_", " ")
        text = f"the ODrive is in emergency stop ({words})"
        fault = Fault(FaultCode.DRIVE_EMERGENCY_STOP, text, self._name)
        self._clear_asked = self._clearing = False
        self._latch(fault, DriveState.EMERGENCY_STOP)
        return send(wire.can_id(self._node_id, wire.ESTOP), b"")

    def clear_faults(self) -> None:
        """Leave latched states with the next `serve`, if the causes are gone."""
        self._clear_asked = True


_INFINITE: Final = (math.inf, -math.inf)

