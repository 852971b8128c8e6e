"""The parts of a robot on its CAN buses, made from its configuration before any bus is open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

from robotctl.drivers.can.bus_notes import BusNotes
from robotctl.drivers.can.bus_part import BusPart
from robotctl.drivers.can.config import NodeParameters
from robotctl.drivers.can.drives.fitting import Fitted
from robotctl.drivers.can.drives.motor_drive import DriveNeeds, MotorDrive
from robotctl.drivers.can.nodes.can_node import CanNode
from robotctl.drivers.can.nodes.own_node import OwnNode, Sink
from robotctl.drivers.can.nodes.registry import wanted_nodes
from robotctl.drivers.can.nodes.robot_codec import RobotCodec
from robotctl.errors import ConfigError, InvalidValue
from robotctl.messages.control import Feedback

FIELDS: Final = Feedback.__struct_fields__
NOTHING: Final[list[Any]] = [getattr(Feedback(), name) for name in FIELDS]
"""Feedback of a tick in which nothing came, in the order of its fields."""


class FittedDrive(NamedTuple):
    """A drive, its bus, and the places of its axes among the robot's actuators."""

    drive: MotorDrive
    bus: str
    places: tuple[int, ...]


class RobotParts:
    """Drives and sensor nodes of a robot.

    Parameters
    ----------
    codec
        Compiled from the DBC.
    parameters
        Required and configured settings of the nodes.
    drives
        Its drives.
    max_rad_s
        Greatest speed of a wheel that the robot's limits allow [rad/s].
    buses
        Names of its buses, the first of which is that of all parts without one.
    bus_of
        Bus of sensor nodes, by their names.
    proofs
        Settings with which each drive was proven, by the names of the drives; None: no drive needs
        a proof.

    Attributes
    ----------
    notes
        Notes about strangers and damaged frames.
    values
        Feedback of the present tick, in the order of the fields of `Feedback`.
    power
        Who tells the supply.
    drives
        The motor drives.
    on_bus
        All parts on each bus: drives, then sensor nodes.

    Raises
    ------
    ConfigError
        If a drive cannot do what the robot needs, or two parts on a bus listen to the same frame.
    """

    def __init__(
        self,
        codec: RobotCodec,
        parameters: NodeParameters,
        drives: Sequence[Fitted],
        max_rad_s: float,
        buses: Sequence[str] = ("",),
        bus_of: Mapping[str, str] | None = None,
        proofs: Mapping[str, str] | None = None,
    ) -> None:
        self.codec = codec
        self.power = parameters.power
        self.proofs = proofs
        self.notes = notes = BusNotes()
        self.values = list(NOTHING)
        needs = DriveNeeds(
            parameters.rate_hz,
            parameters.command_timeout_ms,
            parameters.heartbeat_timeout_ms,
            max_rad_s,
            codec,
            notes,
        )
        named = bus_of or {}
        self.drives = tuple(
            FittedDrive(_made(each, needs), each.motor.bus or buses[0], each.places)
            for each in drives
        )
        self.on_bus: dict[str, tuple[BusPart, ...]] = {
            bus: (
                *(each.drive for each in self.drives if each.bus == bus),
                *(
                    self._own_node(node, parameters)
                    for node in wanted_nodes(parameters)
                    if named.get(node.name, buses[0]) == bus
                ),
            )
            for bus in buses
        }
        for bus in buses:
            self._check_identifiers(bus)

    def identifiers(self, bus: str) -> tuple[int, ...]:
        """Return the identifiers of all frames that the host listens to on a bus."""
        numbers: set[int] = set()
        for part in self.on_bus[bus]:
            numbers.update(part.handlers, part.host_frames)
        if self.speaks_ours(bus):
            numbers.add(self.codec.emergency_stop_id)
        return tuple(sorted(numbers))

    @property
    def ours(self) -> tuple[BusPart, ...]:
        """All parts that speak our own protocol."""
        parts = (part for bus in self.on_bus.values() for part in bus)
        return tuple(part for part in parts if part.host_frames is self.codec.host_only)

    def speaks_ours(self, bus: str) -> bool:
        """Return whether a part on a bus speaks our own protocol."""
        return not set(self.ours).isdisjoint(self.on_bus[bus])

    def _own_node(self, node: CanNode, parameters: NodeParameters) -> OwnNode:
        """Return a sensor node, whose frames go to `values`."""
        values = self.values
        indexes = {frame: FIELDS.index(frame.field) for frame in node.frames}
        return OwnNode(
            node.node_id,
            node.name,
            node.script(self.codec.dbc, parameters),
            {
                frame: Sink(values, index, isinstance(NOTHING[index], tuple))
                for frame, index in indexes.items()
            },
            self.codec,
            self.notes,
            parameters.heartbeat_timeout_ms * 1_000_000,
            parameters.rate_hz,
        )

    def _check_identifiers(self, bus: str) -> None:
        """Refuse a frame that two parts on a bus take for theirs."""
        owners: dict[int, str] = {}
        for part in self.on_bus[bus]:
            shared = {*part.host_frames, self.codec.emergency_stop_id}
            for number in part.handlers.keys() - shared:
                other = owners.setdefault(number, part.status.name)
                if other != part.status.name:
                    raise ConfigError(
                        f"bus {bus or 'of the robot'}: frame 0x{number & 0x1FFF_FFFF:X} is both "
                        f"{other}'s and {part.status.name}'s; give one of them another number, or "
                        "another bus"
                    )


def _made(fitted: Fitted, needs: DriveNeeds) -> MotorDrive:
    """Return a drive; raises ConfigError, with its name, if it cannot do what is needed."""
    try:
        return fitted.motor.make(fitted.axes, needs)
    except InvalidValue as error:
        raise ConfigError(f"motor {fitted.motor.name}: {error}") from error
