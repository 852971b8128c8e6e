"""The robot as seen by faults, and their common operations."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from firmware_sim.bus.faults import Fault as BusFault
from firmware_sim.errors import SimulationError
from firmware_sim.faults import fits
from firmware_sim.faults.faulty_imu import FaultyImu
from firmware_sim.faults.faulty_parts import FaultyRing, FaultyStage
from firmware_sim.faults.parameters import DURATION, Arguments, Undo
from firmware_sim.nodes import wire

if TYPE_CHECKING:
    from firmware_sim.bus.core import Bus
    from firmware_sim.config.config import RobotConfig
    from firmware_sim.drives.twin import Twin
    from firmware_sim.nodes.node import Node
    from firmware_sim.nodes.parameter_store import FragileStore
    from firmware_sim.plant.plant import Plant
    from firmware_sim.world.world import World

_HOST: Final = re.compile(r"host(#\d+)?|bridge:.*")
"""Port name of a host program, with a number where there are several."""
MILLISECOND_NS: Final = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultyRobot:
    """A simulated robot in its room, any part of which can fail.

    Attributes
    ----------
    config, world, bus, plant
        True parts; of several buses the first, whose time is that of all.
    buses, bus_of
        All buses, and the bus of a node by its name (the drive's for an unknown name).
    nodes, twins
        Its own nodes, and its bought drives.
    stores
        Their non-volatile memories, by name.
    stage
        Power stage as its drives see it.
    ring
        Sonars as their node reads them.
    imu
        Inertial sensors as their node reads them.
    rng
        Generator of the noise of broken sensors.
    run_to
        Brings the plant to a time [ns].
    supervise
        Function that holds the drive in reset, or lets it boot, according to its supply.
    power_cycle
        Function that switches the supply of a node, by name, off and on.
    """

    config: RobotConfig
    world: World
    bus: Bus
    buses: tuple[Bus, ...]
    bus_of: Callable[[str], Bus]
    plant: Plant
    nodes: tuple[Node, ...]
    twins: tuple[Twin, ...]
    stores: Mapping[str, FragileStore]
    stage: FaultyStage
    ring: FaultyRing
    imu: FaultyImu
    rng: np.random.Generator
    run_to: Callable[[int], int]
    supervise: Callable[[], None]
    power_cycle: Callable[[str], None]

    def node(self, name: str) -> Node:
        """Return a node of ours by its name."""
        return next(each for each in self.nodes if each.name == name)

    def twin(self, name: str) -> Twin:
        """Return a bought drive by its name."""
        return next(each for each in self.twins if each.name == name)

    def turns(self, counts: float) -> float:
        """Return the turns of a wheel for a number of counts, by the robot's file."""
        return counts / self.config.drive.counts_per_revolution

    def catch_up(self) -> None:
        """Bring the robot to the present, so that changes take effect only from now on."""
        self.run_to(self.bus.now_ns)

    def repeat(self, action: Callable[[], None], period_ns: int = MILLISECOND_NS) -> Undo:
        """Call `action` now and every period; return what ends that."""
        bus = self.bus
        goes_on = True

        def tick() -> None:
            if goes_on:
                self.catch_up()
                action()
                bus.schedule(bus.now_ns + period_ns, tick)

        def end() -> None:
            nonlocal goes_on
            goes_on = False

        tick()
        return end

    def end_ns(self, arguments: Arguments) -> int:
        """Return the time at which a fault with these arguments ends if it begins now [ns]."""
        return self.bus.now_ns + round(float(arguments[DURATION]) * 1e9)

    def on_bus(self, make: Callable[..., BusFault], arguments: Arguments, **more: object) -> None:
        """Inject a fault for its duration from now: on the node's bus, or on each."""
        fault = make(start_ns=self.bus.now_ns, end_ns=self.end_ns(arguments), **more)
        for bus in (self.bus_of(str(more["node"])),) if "node" in more else self.buses:
            bus.inject(fault)

    def on_frames(
        self, make: Callable[..., BusFault], arguments: Arguments, **more: object
    ) -> None:
        """Inject a fault of frames with the identifier and probability of the arguments."""
        number = int(float(arguments["id"]))
        self.on_bus(
            make,
            arguments,
            arbitration_id=fits.identifiers(self.config)[number] if number else None,
            probability=float(arguments["probability"]),
            **more,
        )

    def host(self) -> str:
        """Name of the host's port: the one with a host's name that commands the motors.

        Without such a port, the one that commands them, or has a host's name.

        Raises
        ------
        SimulationError
            If no host is on the bus, or several could be it.
        """
        nodes = {node.name for node in self.nodes} | {twin.name for twin in self.twins}
        guests = [port for port in self.bus_of("drive").ports if port.name not in nodes]
        commanding = [port for port in guests if port.has_sent(wire.MOTOR_COMMAND)]
        named = [port for port in guests if _HOST.fullmatch(port.name)]
        both = [port for port in named if port in commanding]
        found = [port.name for port in both or commanding or named]
        if not found:
            raise SimulationError("no host is on the bus")
        if len(found) > 1:
            raise SimulationError(
                f"{', '.join(found)} could be the host, allowed: one that sends motor commands"
            )
        return found[0]
