"""The robot on its CAN buses: `RobotPort` over a `CanPort` for each.

One tick: `receive` drains the buses and hands each frame to the part that listens to it; `send` has
each drive put its command on its bus, then SYNC where a part waits for it, and on each bus at most
one frame of services after them: identification, settings, clearing of faults.
"""

from __future__ import annotations

from collections.abc import Mapping
from operator import itemgetter
from typing import Final

from robotctl.drivers.can.bus_part import BusPart, Handler, Send
from robotctl.drivers.can.drives.motor_drive import MotorDrive
from robotctl.drivers.can.drives.proofs import ProvenDrive
from robotctl.drivers.can.robot_parts import FIELDS, NOTHING, RobotParts
from robotctl.drivers.can.supply import DriveSupply
from robotctl.messages.actuators import ActuatorCommand, ActuatorFeedback
from robotctl.messages.control import (
    BusStatus,
    EmergencyStopSource,
    Feedback,
    NodeStatus,
    StrangerKind,
)
from robotctl.messages.ports import CanPort

DISABLE_FRAMES: Final = 3
"""How often `close` sends "motors off"."""

_ACTUATORS, _BATTERY, _EMERGENCIES, _EMERGENCY_STOP, _NODES, _BUS, _STRANGERS = map(
    FIELDS.index,
    ("actuators", "battery", "emergencies", "emergency_stop", "nodes", "bus", "strangers"),
)
_SOURCES: Final = {source.value: source for source in EmergencyStopSource}


class CanRobot:
    """Drives and sensors of a robot on its CAN buses.

    Parameters
    ----------
    ports
        The buses by name; each accepts at least `parts.identifiers` of it.
    parts
        Drives and sensor nodes.
    """

    def __init__(self, ports: Mapping[str, CanPort], parts: RobotParts) -> None:
        self._parts = parts
        self._notes = parts.notes
        self._values = parts.values
        self._buses = [_BusSide(port, name, parts) for name, port in ports.items()]
        sides = dict(zip(ports, self._buses, strict=True))
        count = sum(len(places) for _, _, places in parts.drives)
        self._drives = [
            _DriveSide(drive, sides[bus].port.send, places, count)
            for drive, bus, places in parts.drives
        ]
        self._supply = DriveSupply(parts.power) if parts.power.source == "drives" else None
        self._actuators = _in_order(self._drives)
        self._all = [part for bus in self._buses for part in bus.parts]
        self._status: list[BusPart | ProvenDrive] = [*self._all]
        if parts.proofs is not None:
            drives = [each.drive for each in parts.drives]
            proven = {id(drive): ProvenDrive(drive, parts.proofs) for drive in drives}
            self._status = [proven.get(id(part), part) for part in self._all]
        self._node_status = tuple([each.status for each in self._status])
        self._closed = False

    # Receiving ----------------------------------------------------------------------------------

    def receive(self, now_ns: int) -> Feedback:
        """Return the data received since the last call, and the present state of nodes and bus."""
        values, notes = self._values, self._notes
        values[:] = NOTHING
        for bus in self._buses:
            handlers = bus.handlers
            for arbitration_id, data, stamp_ns in bus.port.receive():
                handler = handlers.get(arbitration_id)
                if handler is not None:
                    handler(data, stamp_ns)
        for part in self._all:
            part.check(now_ns)
        notes.strangers.refresh()
        if notes.emergencies:
            values[_EMERGENCIES] = tuple(notes.emergencies)
            notes.emergencies.clear()
        values[_ACTUATORS] = reports = self._reports()
        if self._supply is not None:
            values[_BATTERY] = self._supply.update(reports)
        values[_NODES] = self.nodes
        values[_BUS] = self.bus_status()
        values[_STRANGERS] = notes.strangers.seen
        return Feedback(*values)

    def _reports(self) -> tuple[ActuatorFeedback, ...]:
        """Return the newest of each actuator, in the robot's order; the same while none changes."""
        has_changed = False
        for side in self._drives:
            has_changed = side.has_new_reports() or has_changed
        if has_changed:
            self._actuators = _in_order(self._drives)
        return self._actuators

    @property
    def nodes(self) -> tuple[NodeStatus, ...]:
        """Status of each drive and node; the same object while none changes."""
        known = self._node_status
        for place, each in enumerate(self._status):
            if each.status is not known[place]:
                status = tuple([each.status for each in self._status])
                if status != known:
                    self._node_status = status
                break
        return self._node_status

    def bus_status(self) -> BusStatus:
        """Return the ports' counters together with those of end-to-end protection."""
        notes, e2e = self._notes, self._notes.counters
        status = self._buses[0].port.status()
        for bus in self._buses[1:]:
            status = _both(status, bus.port.status())
        if not (notes.refused or e2e.crc_rejects or e2e.counter_rejects or e2e.lost):
            return status
        return BusStatus(
            status.state,
            status.received,
            status.sent,
            status.send_failures + notes.refused,
            status.error_frames,
            e2e.crc_rejects,
            e2e.counter_rejects,
            e2e.lost,
            status.load,
        )

    # Sending ------------------------------------------------------------------------------------

    def send(self, command: ActuatorCommand, now_ns: int) -> None:
        """Send one command to all drives, then SYNC, then at most one frame of services a bus.

        A value that the wire cannot carry (not finite, out of range) becomes "no power" and counts
        as a failure to send.
        """
        for side in self._drives:
            side.send_command(command, now_ns)
        for bus in self._buses:
            bus.finish_tick(now_ns)

    def emergency_stop(self, source: EmergencyStopSource) -> None:
        """Send the emergency stop at once; where a bus does not take it, again each tick."""
        for side in self._drives:
            side.emergency_stop(source)

    def clear_faults(self) -> None:
        """Ask all drives to leave their latched states."""
        for side in self._drives:
            side.drive.clear_faults()

    def close(self) -> None:
        """Say that the motors are off, then release the buses. Closing twice does nothing."""
        if self._closed:
            return
        self._closed = True
        stopped = ActuatorCommand(enable=False, brake=True)
        for _ in range(DISABLE_FRAMES):
            for side in self._drives:
                side.send_command(stopped, 0)
        for bus in self._buses:
            bus.port.close()


class _DriveSide:
    """A drive with its places among the robot's actuators and its way onto the bus."""

    def __init__(
        self, drive: MotorDrive, send: Send, places: tuple[int, ...], actuators: int
    ) -> None:
        self.drive = drive
        self.places = places
        self._send = send
        self.takes_all = places == tuple(range(actuators))
        """Whether its axes are all of the robot's actuators, in their order."""
        self._known: tuple[ActuatorFeedback, ...] | None = None
        self._stop: EmergencyStopSource | None = None
        """An emergency stop that the bus has not taken yet."""

    def has_new_reports(self) -> bool:
        """Return whether it has other reports than at the last call."""
        reports = self.drive.reports
        if reports is self._known:
            return False
        self._known = reports
        return True

    def send_command(self, command: ActuatorCommand, now_ns: int) -> None:
        """Send its part of a command."""
        if self._stop is not None:
            self.emergency_stop(self._stop)
        values = command.values
        if values and not self.takes_all:
            own = tuple([values[place] for place in self.places])
            command = ActuatorCommand(command.enable, command.brake, own)
        self.drive.command(self._send, command, now_ns)

    def emergency_stop(self, source: EmergencyStopSource) -> None:
        """Send the emergency stop; keep it where the bus does not take it."""
        taken = self.drive.emergency_stop(self._send, source)
        self._stop = None if taken else source


class _BusSide:
    """A bus with the parts on it."""

    def __init__(self, port: CanPort, name: str, parts: RobotParts) -> None:
        self.port = port
        self.parts = parts.on_bus[name]
        self._waiting = list(self.parts)
        """In turn, so that none has to wait until others are ready: whose frame is next."""
        self._syncs = any(part.wants_sync for part in self.parts)
        self._sync_id = parts.codec.sync_id
        listening: dict[int, list[Handler]] = {}
        if parts.speaks_ours(name):
            listening[parts.codec.emergency_stop_id] = [_stop_handler(parts)]
        for part in self.parts:
            for number, host_frame in part.host_frames.items():
                listening.setdefault(number, [_host_frame_handler(parts, number, host_frame)])
        for part in self.parts:
            for number, handler in part.handlers.items():
                listening.setdefault(number, []).append(handler)
        self.handlers = {number: _each(handlers) for number, handlers in listening.items()}

    def finish_tick(self, now_ns: int) -> None:
        """Send what follows the commands."""
        send = self.port.send
        if self._syncs:
            # Last: our drive latches its encoders at it and answers in time for the next tick.
            send(self._sync_id, b"")
        for part in self._waiting:
            if part.serve(send, now_ns):
                self._waiting.remove(part)
                self._waiting.append(part)
                return


def _each(handlers: list[Handler]) -> Handler:
    """Return one handler that calls all."""
    if len(handlers) == 1:
        return handlers[0]

    def handle(data: bytes, stamp_ns: int) -> None:
        for handler in handlers:
            handler(data, stamp_ns)

    return handle


def _stop_handler(parts: RobotParts) -> Handler:
    """Return the handler of an emergency stop sent by another device on the bus."""
    values = parts.values

    def handle(data: bytes, _: int) -> None:
        source = _SOURCES.get(data[0]) if data else None
        values[_EMERGENCY_STOP] = EmergencyStopSource.UNKNOWN if source is None else source

    return handle


def _host_frame_handler(parts: RobotParts, number: int, name: str) -> Handler:
    """Return the handler of a frame that only the host sends: the bus returns none of ours."""
    note = parts.notes.strangers.note
    return lambda _, stamp_ns: note(StrangerKind.HOST_FRAME, name, number, "", stamp_ns)


def _in_order(sides: list[_DriveSide]) -> tuple[ActuatorFeedback, ...]:
    """Return the reports of all actuators, in the robot's order."""
    if len(sides) == 1 and sides[0].takes_all:
        return sides[0].drive.reports
    placed = [pair for side in sides for pair in zip(side.places, side.drive.reports, strict=True)]
    return tuple([report for _, report in sorted(placed, key=itemgetter(0))])


def _both(one: BusStatus, other: BusStatus) -> BusStatus:
    """Return the worse state, the greater load and the sums of the counters of two buses."""
    return BusStatus(
        max(one.state, other.state),
        one.received + other.received,
        one.sent + other.sent,
        one.send_failures + other.send_failures,
        one.error_frames + other.error_frames,
        load=max(one.load, other.load),
    )
