"""A simulated bus with twins of drives and nodes on it, scanned in virtual time."""

from __future__ import annotations

from typing import Any

from firmware_sim.bus.core import Bus
from firmware_sim.bus.state import FdSupport
from firmware_sim.drives.config import AxisSection
from firmware_sim.drives.registry import TWINS
from firmware_sim.drives.twin import Motor, Twin
from firmware_sim.nodes.parameter_store import MemoryStore
from firmware_sim.simulation import Simulation
from robotctl.app.simulation.lockstep_stack import attach_port
from robotctl.drivers.can.config import CanConfig
from robotctl.drivers.can.scanner import Scanner, ScanReport
from tests.firmware_sim.plant.plants import CONFIGS, plant, robot

MS = 1_000_000
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")


class ScanBench:
    """Bus, twins, and the wheels that they turn.

    Parameters
    ----------
    native
        Whether our own robot `diff_drive`, with its nodes, is on the bus.
    bitrate, data_bitrate
        Of the bus.
    """

    def __init__(
        self, *, native: bool = False, bitrate: int = 1_000_000, data_bitrate: int = 0
    ) -> None:
        self.config = CanConfig("simcan", "test", bitrate, data_bitrate)
        self.plant = plant(robot("skid_steer"))
        self._plant_ns = 0
        self.twins: list[Any] = []
        self.simulation = None
        if native:
            ours = robot(can__data_bitrate=data_bitrate, can__bitrate=bitrate)
            self.simulation = Simulation(ours, CONFIGS / "worlds" / "empty_room.toml", 1)
            self.bus = self.simulation.bus
        else:
            self.bus = Bus(bitrate, data_bitrate=data_bitrate)

    # The clock of the scanner -------------------------------------------------------------------

    def now_ns(self) -> int:
        return self.bus.now_ns

    def sleep_until(self, deadline_ns: int) -> None:
        if deadline_ns > self.bus.now_ns:
            (self.bus if self.simulation is None else self.simulation).advance(deadline_ns)
            self._run_to(deadline_ns)

    def advance(self, duration_ms: float) -> None:
        """Let time pass."""
        self.sleep_until(self.bus.now_ns + round(duration_ms * MS))

    # Devices ------------------------------------------------------------------------------------

    def add(
        self, kind: str, number: int, *, settings: Any = None, on: bool = True, **keys: Any
    ) -> Any:
        """Put a drive of a kind on the bus, at the next wheel."""
        table = TWINS[kind]
        place = len(self.twins)
        axes = (AxisSection(WHEELS[place % len(WHEELS)]),)
        drive = table(kind, f"{kind}{place}", axes, node_id=number, **keys)
        motors = [Motor(self.plant.axes[place % len(WHEELS)], 1.0)]
        twin = drive.make(
            table.Settings(**(settings or {})), motors, self.plant, self._run_to, MemoryStore()
        )
        self.twins.append(twin)
        if on:
            self.plug(twin)
        return twin

    def plug(self, twin: Twin, fd: FdSupport = FdSupport.ENABLED) -> None:
        """Connect a twin and give it power."""
        port = self.bus.attach(twin.name, twin.on_frame, accept=twin.arbitration_ids, fd=fd)
        twin.connect(
            port, lambda due, each: self.bus.schedule(due, lambda: each.wake(self.bus.now_ns))
        )
        twin.power_cycle(self.bus.now_ns)

    def _run_to(self, now_ns: int) -> int:
        steps = now_ns // MS - self._plant_ns // MS
        if steps > 0:
            self.plant.step(steps)
            self._plant_ns = now_ns
        return now_ns // MS * MS

    # Scanning -----------------------------------------------------------------------------------

    def scanner(self) -> Scanner:
        """Return a scanner of the bus as it is now; there is one on a bench."""
        port = attach_port(self.bus, self.config, None, self)
        return Scanner(port, self.config, self)

    def scan(self, *, boot_ms: float = 700.0, only_listen: bool = False) -> ScanReport:
        """Let all devices boot, then scan."""
        self.advance(boot_ms)
        return self.scanner().run(only_listen=only_listen)
