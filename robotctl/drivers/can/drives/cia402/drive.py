"""A drive of CiA 402 as the host drives it."""

from __future__ import annotations

from typing import Final

from robotctl.drivers.can.bus_part import Handler, Send
from robotctl.drivers.can.drives.axis import Axis
from robotctl.drivers.can.drives.cia402.axis_side import AxisSide
from robotctl.drivers.can.drives.cia402.device import VELOCITY
from robotctl.drivers.can.drives.cia402.host_beat import host_beat
from robotctl.drivers.can.drives.cia402.readings import Readings
from robotctl.drivers.can.drives.cia402.settings import (
    DriveSetup,
    FoundDrive,
    heartbeat_of,
    script_of,
)
from robotctl.drivers.can.drives.cia402.state import QUICK_STOP_WORD, RAMP_BITS, PowerSwitch
from robotctl.drivers.can.drives.cia402.targets import Targets
from robotctl.drivers.can.drives.cia402.wire import (
    FAULT_REACTION,
    OPERATION_ENABLED,
    RPDO_BASES,
    TPDO_BASES,
    Command,
    Received,
)
from robotctl.drivers.can.drives.motor_drive import DriveNeeds
from robotctl.drivers.can.nodes.identifiers import CobId, NmtCommand, NmtState
from robotctl.drivers.can.nodes.node import Node, NodePhase
from robotctl.drivers.can.nodes.node_part import NodePart
from robotctl.messages.actuators import (
    ActuatorCommand,
    ActuatorFeedback,
    DriveState,
)
from robotctl.messages.control import EmergencyStopSource
from robotctl.messages.faults import Fault, FaultCode

STOP_MAX_S: Final = 0.5
"""Maximum time of a quick stop [s], after which the power is taken."""

_READY: Final = NodePhase.READY


class Cia402Drive(NodePart):
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
        plan: DriveSetup,
        units_per_rad: float,
        rad_per_unit: float,
        counts_per_turn: int,
        axes: tuple[Axis, ...],
        needs: DriveNeeds,
    ) -> None:
        dialect, mode = plan.device.dialect, plan.device.mode
        heartbeat = heartbeat_of(plan)
        self._name = name
        self._found = FoundDrive()
        node = Node(
            plan.node_id,
            name,
            script_of(plan, self._found),
            needs.heartbeat_timeout_ms * 1_000_000,
            needs.notes.strangers,
            knock=heartbeat.writing if heartbeat is not None else None,
            rests=True,
            sdo_pause_ns=dialect.sdo_pause_ms * 1_000_000,
        )
        super().__init__(node, needs.notes)
        self._switch = PowerSwitch(
            name, RAMP_BITS if mode == VELOCITY else 0, round(STOP_MAX_S * needs.rate_hz)
        )
        places = _places(axes, plan)
        self._targets = Targets(axes, places, plan.device, units_per_rad)
        self._frames = Command(plan.layout.receive, plan.node_id, mode).frames
        self._received = received = Received(plan.layout.transmit)
        self._sides = [
            AxisSide(axis, place, received, dialect, rad_per_unit, counts_per_turn)
            for axis, place in zip(axes, places, strict=True)
        ]
        self._is_fresh = False
        self._was_in_service = False
        self._readings = Readings(
            node, plan, self._sides, places, needs.rate_hz, self._latch_command_loss
        )
        self._beat = host_beat(plan)
        self.wants_sync = any(pdo.every for pdo in plan.layout.transmit)
        self.reports: tuple[ActuatorFeedback, ...] = (ActuatorFeedback(),) * len(axes)
        self.handlers |= {
            TPDO_BASES[pdo.number - 1] + plan.node_id: self._handler(place, pdo.number)
            for place, pdo in enumerate(plan.layout.transmit)
        }
        self.host_frames = self._host_frames(plan)

    def _host_frames(self, plan: DriveSetup) -> dict[int, str]:
        """Return the names of the frames that only the host may send."""
        commands = [RPDO_BASES[pdo.number - 1] + plan.node_id for pdo in plan.layout.receive]
        frames: dict[int, str] = {CobId.NMT: "NmtControl", CobId.SYNC: "Sync"}
        frames |= dict.fromkeys(commands, f"command of {self._name}")
        if self._beat is not None:
            frames[self._beat.frame[0]] = f"heartbeat of the host for {self._name}"
        return frames

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

    def check(self, now_ns: int) -> None:
        """Judge what was received up to now; now and then read something by SDO."""
        self.node.check(now_ns)
        in_service = self.node.phase is _READY
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
            switch.latch(worst.fault(self._name, self.emergency_code))

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
        node, switch = self.node, self._switch
        in_service = node.phase is _READY
        wants = switch.wants(command.enable, in_service)
        targets = self._targets.of(command.values)
        if targets is None:
            self._notes.refused += 1
            switch.refuse()
        if targets is None or not wants:
            wants, targets = False, self._targets.none
        self._readings.note(targets if wants else ())
        if in_service or (self._found.is_mapped and node.status.nmt_state == NmtState.OPERATIONAL):
            word = switch.word(command.brake, 0.0 if wants else self._fastest())
            for arbitration_id, data in self._frames(word, targets):
                send(arbitration_id, data)
            if switch.must_rest and any(side.is_enabled(now_ns) for side in self._sides):
                self._reset(send)
        if self._beat is not None:
            self._beat.step(send, now_ns)

    def _reset(self, send: Send) -> None:
        """Reset a drive that commands do not reach: the host's heartbeat would let it drive on."""
        text = f"{self._name} stays enabled although told to stop: no command reaches it"
        self._switch.interlock.explain(Fault(FaultCode.COMMAND_LOSS, text, self._name))
        self._is_fresh = True
        send(CobId.NMT, bytes((NmtCommand.RESET_NODE, self.node.node_id)))

    def _fastest(self) -> float:
        """Return the speed of the fastest wheel [rad/s]; 0 where none is told."""
        return max(abs(report.speed_rad_s or 0.0) for report in self.reports)

    def emergency_stop(self, send: Send, source: EmergencyStopSource) -> bool:
        """Send a quick stop; the commands of the next ticks take the power."""
        self._switch.emergency_stop(source)
        self._is_fresh = True
        if not self._found.is_mapped:
            return True
        frames = self._frames(QUICK_STOP_WORD, self._targets.none)
        taken = True
        for arbitration_id, data in frames:
            taken &= send(arbitration_id, data)
        return taken

    def clear_faults(self) -> None:
        """Leave latched states with the next commands, if the drive does."""
        self._switch.clear()
        self._is_fresh = True


def _places(axes: tuple[Axis, ...], plan: DriveSetup) -> list[int]:
    """Return the place of each axis in the process data."""
    if plan.device.dialect.layout is None:
        return list(range(len(axes)))
    return [axis.number - 1 for axis in axes]
