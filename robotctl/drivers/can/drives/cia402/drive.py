"""A drive of CiA 402 as the host drives it."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Final

from robotctl.drivers.can.bus_part import Handler, Send
from robotctl.drivers.can.drives.axis import Axis
from robotctl.drivers.can.drives.cia402.axis_side import AxisSide
from robotctl.drivers.can.drives.cia402.device import VELOCITY, Silence
from robotctl.drivers.can.drives.cia402.dialects import I32_MAX
from robotctl.drivers.can.drives.cia402.readings import Readings
from robotctl.drivers.can.drives.cia402.settings import Found, Plan, heartbeat_of, script_of
from robotctl.drivers.can.drives.cia402.state import QUICK_STOP_WORD, RAMP_BITS, PowerSwitch
from robotctl.drivers.can.drives.cia402.wire import (
    FAULT_REACTION,
    OPERATION_ENABLED,
    RPDO_BASES,
    TPDO_BASES,
    Command,
    Received,
)
from robotctl.drivers.can.drives.motor_drive import DriveNeeds
from robotctl.drivers.can.nodes.node import (
    HEARTBEAT_BASE,
    NMT_ID,
    NMT_OPERATIONAL,
    NMT_RESET_NODE,
    Node,
    NodePhase,
)
from robotctl.drivers.can.nodes.sdo import REQUEST_BASE, RESPONSE_BASE
from robotctl.messages.actuators import (
    NEVER_NS,
    ActuatorCommand,
    ActuatorFeedback,
    DriveState,
)
from robotctl.messages.control import EmergencyMessage, EmergencyStopSource, NodeStatus
from robotctl.messages.faults import Fault, FaultCode
from robotctl.messages.ports import REMOTE_FLAG

SYNC_ID: Final = 0x080
EMERGENCY_BASE: Final = 0x080

STOP_MAX_S: Final = 0.5
"""A quick stop that takes longer ends without power [s]."""

BEATS: Final = 4
"""Heartbeats of the host within the drive's time-out: so many less one may be lost."""

_I16_MAX: Final = 0x7FFF
_READY: Final = NodePhase.READY


class Cia402Drive:
    """A drive of CiA 402.

    Parameters
    ----------
    name
        Name of the drive.
    plan
        How it is set, and what it has.
    units_per_rad
        Target velocity for 1 rad/s of the motor.
    rad_per_unit
        Speed of the motor by its actual velocity [rad/s].
    counts_per_turn
        Position units in one turn of the motor.
    axes
        Its axes.
    needs
        Demands of the robot.
    """

    def __init__(
        self,
        name: str,
        plan: Plan,
        units_per_rad: float,
        rad_per_unit: float,
        counts_per_turn: int,
        axes: tuple[Axis, ...],
        needs: DriveNeeds,
    ) -> None:
        node_id, dialect = plan.node_id, plan.device.dialect
        heartbeat = heartbeat_of(plan)
        self._name = name
        self._notes = needs.notes
        self._found = Found()
        self._node = node = Node(
            node_id,
            name,
            script_of(plan, self._found),
            needs.heartbeat_timeout_ms * 1_000_000,
            needs.notes.strangers,
            knock=heartbeat.writing if heartbeat is not None else None,
            rests=True,
            sdo_pause_ns=dialect.sdo_pause_ms * 1_000_000,
        )
        mode = plan.device.mode
        self._switch = PowerSwitch(
            name, RAMP_BITS if mode == VELOCITY else 0, round(STOP_MAX_S * needs.rate_hz)
        )
        # A layout of a maker carries all axes that the drive has, wheels on them or not.
        places = _places(axes, plan)
        self._targets = [0] * (max(places) + 1 if dialect.layout is None else dialect.axes)
        self._places = places
        self._frames = Command(plan.layout.receive, node_id, mode).frames
        self._received = received = Received(plan.layout.transmit)
        self._sides = [
            AxisSide(axis, place, received, dialect, rad_per_unit, counts_per_turn)
            for axis, place in zip(axes, places, strict=True)
        ]
        self._units_per_rad = units_per_rad
        is_short = mode == VELOCITY or dialect.layout is not None
        self._wire_max = _I16_MAX if is_short else I32_MAX
        self._target_max = min(dialect.target_max, self._wire_max)
        self._is_fresh = False
        self._was_in_service = False
        self._emergency_code = 0
        self._readings = Readings(
            node, plan, self._sides, places, needs.rate_hz, self._latch_command_loss
        )
        self._beat = _beat(plan)
        self._beat_ns = NEVER_NS
        self._beat_period_ns = plan.timeout_ms * 1_000_000 // BEATS
        self.wants_sync = any(pdo.every for pdo in plan.layout.transmit)
        self.reports: tuple[ActuatorFeedback, ...] = (ActuatorFeedback(),) * len(axes)
        self.handlers: Mapping[int, Handler] = {
            NMT_ID: self._on_foreign_nmt,
            HEARTBEAT_BASE + node_id: node.on_heartbeat,
            REQUEST_BASE + node_id: node.on_foreign_sdo,
            RESPONSE_BASE + node_id: lambda data, _: node.on_sdo(data),
            EMERGENCY_BASE + node_id: self._on_emergency,
            **{
                TPDO_BASES[pdo.number - 1] + node_id: self._handler(place, pdo.number)
                for place, pdo in enumerate(plan.layout.transmit)
            },
        }
        self.host_frames: Mapping[int, str] = {
            NMT_ID: "NmtControl",
            SYNC_ID: "Sync",
            **{
                RPDO_BASES[pdo.number - 1] + node_id: f"command of {name}"
                for pdo in plan.layout.receive
            },
            **({} if self._beat is None else {self._beat[0]: f"heartbeat of the host for {name}"}),
        }

    @property
    def status(self) -> NodeStatus:
        """Whether it is there and in service, and why not."""
        return self._node.status

    @property
    def proof(self) -> str | None:
        """Its settings for a silent host."""
        return self._found.proof

    # Receiving ----------------------------------------------------------------------------------

    def _handler(self, place: int, number: int) -> Handler:
        """Return the handler of a TPDO."""
        received, found = self._received, self._found
        layout, span = received.spans[place]
        unpack, size = layout.unpack, layout.size
        values, stamps_ns = received.values, received.stamps_ns

        def handle(data: bytes, stamp_ns: int) -> None:
            if not found.is_mapped:
                return  # of an old session: nobody knows what it carries
            if len(data) != size:
                self._latch_unreadable(f"TPDO{number} is {data.hex(' ')}, {size} bytes expected")
                return
            values[span] = unpack(data)
            stamps_ns[place] = stamp_ns
            self._is_fresh = True

        return handle

    def _latch_unreadable(self, text: str) -> None:
        self._switch.latch(Fault(FaultCode.DRIVE_UNREADABLE, text, self._name))
        self._is_fresh = True

    def _latch_command_loss(self, text: str) -> None:
        self._switch.interlock.hold(DriveState.STOPPED, FaultCode.COMMAND_LOSS, text)
        self._is_fresh = True

    def _on_foreign_nmt(self, data: bytes, _: int) -> None:
        if len(data) == 2 and data[1] in (0, self._node.node_id):
            self._node.on_foreign_nmt(data[0])

    def _on_emergency(self, data: bytes, stamp_ns: int) -> None:
        if len(data) == 8:
            self._emergency_code, register = struct.unpack_from("<HB", data)
            message = EmergencyMessage(stamp_ns, self._node.node_id, self._emergency_code, register)
            self._notes.emergencies.append(message)

    def check(self, now_ns: int) -> None:
        """Judge what was received up to now; now and then read something by SDO."""
        self._node.check(now_ns)
        in_service = self._node.phase is _READY
        if self._was_in_service and not in_service:
            for side in self._sides:
                side.forget_state()
            self._switch.refuse()
            self._is_fresh = True
        self._was_in_service = in_service
        if self._is_fresh:
            self._is_fresh = False
            self._judge()
            self._report()
        self._readings.step(now_ns)

    def _judge(self) -> None:
        """Find the axis that is farthest from power, and the fault of the drive."""
        lowest, worst = OPERATION_ENABLED, self._sides[0]
        for side in self._sides:
            state = side.state
            if state < lowest:
                lowest, worst = state, side
        switch = self._switch
        switch.observe(lowest)
        if lowest <= FAULT_REACTION:
            switch.latch(worst.fault(self._name, self._emergency_code))

    def _report(self) -> None:
        """Make the reports of all axes."""
        interlock, amps, readings = self._switch.interlock, self._found.rated_a, self._readings
        voltage_v, supply_ns = readings.voltage_v, readings.supply_ns
        self.reports = tuple(
            [
                side.report(interlock, amps[place] if amps else 0.0, voltage_v, supply_ns)
                for place, side in enumerate(self._sides)
            ]
        )

    # Sending ------------------------------------------------------------------------------------

    def command(self, send: Send, command: ActuatorCommand, now_ns: int) -> None:
        """Send one control word for all axes and their target velocities, and the heartbeat."""
        node, switch, targets = self._node, self._switch, self._targets
        in_service = node.phase is _READY
        wants = switch.wants(command.enable, in_service)
        top, wire_top = self._target_max, self._wire_max
        for place, side, value in zip(
            self._places, self._sides, command.values or _ZEROS, strict=False
        ):
            units = side.axis.to_motor(value) * self._units_per_rad
            if not -wire_top <= units <= wire_top:  # nan, too
                self._notes.refused += 1
                switch.refuse()
                wants = switch.wants(command.enable, in_service)
                break
            targets[place] = round(min(max(units, -top), top))
        self._readings.note(targets if wants else ())
        if not wants:
            targets = [0] * len(targets)
        if in_service or (self._found.is_mapped and node.status.nmt_state == NMT_OPERATIONAL):
            word = switch.word(command.brake, 0.0 if wants else self._fastest())
            for arbitration_id, data in self._frames(word, targets):
                send(arbitration_id, data)
            if switch.must_rest and any(side.is_enabled(now_ns) for side in self._sides):
                self._reset(send)
        if self._beat is not None and now_ns - self._beat_ns >= self._beat_period_ns:
            self._beat_ns = now_ns
            send(*self._beat)

    def _reset(self, send: Send) -> None:
        """Reset a drive that commands do not reach: the host's heartbeat would let it drive on."""
        text = f"{self._name} stays enabled although told to stop: no command reaches it"
        self._switch.interlock.explain(Fault(FaultCode.COMMAND_LOSS, text, self._name))
        self._is_fresh = True
        send(NMT_ID, bytes((NMT_RESET_NODE, self._node.node_id)))

    def _fastest(self) -> float:
        """Return the speed of the fastest wheel [rad/s]; 0 where none is told."""
        return max(abs(report.speed_rad_s or 0.0) for report in self.reports)

    def serve(self, send: Send, now_ns: int) -> bool:
        """Send the next frame of its node services; whether there was one."""
        node = self._node
        if not node.busy:
            return False
        frame = node.poll(now_ns)
        if frame is None:
            return False
        if send(*frame):
            node.sent(now_ns)
        return True

    def emergency_stop(self, send: Send, source: EmergencyStopSource) -> bool:
        """Send a quick stop; the commands of the next ticks take the power."""
        self._switch.emergency_stop(source)
        self._is_fresh = True
        if not self._found.is_mapped:
            return True
        frames = self._frames(QUICK_STOP_WORD, [0] * len(self._targets))
        taken = True
        for arbitration_id, data in frames:
            taken &= send(arbitration_id, data)
        return taken

    def clear_faults(self) -> None:
        """Leave latched states with the next commands, if the drive does."""
        self._switch.clear()
        self._is_fresh = True


_ZEROS: Final = (0.0,) * 8


def _places(axes: tuple[Axis, ...], plan: Plan) -> list[int]:
    """Return the place of each axis in the process data."""
    if plan.device.dialect.layout is None:
        return list(range(len(axes)))
    return [axis.number - 1 for axis in axes]


def _beat(plan: Plan) -> tuple[int, bytes] | None:
    """Return the frame by which the drive knows that the host is there; None if it looks for none.

    A heartbeat of the host, or the request of node guarding.
    """
    silence = plan.device.silence
    if silence is Silence.HEARTBEAT:
        return HEARTBEAT_BASE + plan.host_id, bytes((NMT_OPERATIONAL,))
    if silence is Silence.GUARDING:
        return HEARTBEAT_BASE + plan.node_id | REMOTE_FLAG, b"\0"
    return None
