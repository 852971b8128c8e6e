"""A bench: drives of the host and their twins on a simulated bus, on the wheels of a robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from firmware_sim.bus.core import Bus
from firmware_sim.bus.frame import BIT_RATE_SWITCH_FLAG, ERROR_STATE_FLAG, FD_FLAG
from firmware_sim.drives.twin import Motor, Twin
from firmware_sim.nodes.parameter_store import MemoryStore
from robotctl.drivers.can.bus_notes import BusNotes
from robotctl.drivers.can.drives.axis import Axis
from robotctl.drivers.can.drives.motor_drive import DriveNeeds
from robotctl.messages.actuators import ActuatorCommand, DriveState
from robotctl.messages.control import EmergencyStopSource
from robotctl.model.actuators import Takes
from tests.firmware_sim.plant.plants import plant, robot

MS = 1_000_000
PERIOD_NS = 5 * MS
NEEDS = DriveNeeds(
    rate_hz=200,
    command_timeout_ms=90,
    heartbeat_timeout_ms=350,
    max_rad_s=20.0,
    codec=None,
    notes=BusNotes(),
)
COAST, BRAKE = ActuatorCommand(), ActuatorCommand(brake=True)
TICKS = 2400


def on(*values: float) -> ActuatorCommand:
    """Return a command that gives power."""
    return ActuatorCommand(enable=True, values=values)


def axes_of(config: Any) -> tuple[Axis, ...]:
    """Return the axes of a table `[[motor]]`; one called "steering" is a joint."""
    return tuple(
        Axis(each, Takes.ANGLE, 0)
        if each.actuator == "steering"
        else Axis(each, config.abilities.takes, TICKS)
        for each in config.axes
    )


class Stand:
    """Twins on a simulated bus, on the wheels of a robot in an open room, and a port for the host.

    Parameters
    ----------
    name
        Robot of `configs/`.
    data_bitrate
        Of the bus.
    """

    def __init__(self, name: str, data_bitrate: int = 0) -> None:
        self.plant = plant(robot(name))
        self.bus = Bus(data_bitrate=data_bitrate)
        self._plant_ns = 0
        self.twins: list[Any] = []
        self.received: list[tuple[int, bytes, int]] = []
        self._port = self.bus.attach("host", self._receive, queue_limit=500)

    @property
    def now_ns(self) -> int:
        return self.bus.now_ns

    def plug(self, table: Any, settings: Any, wheels: Sequence[Any] = ()) -> Any:
        """Put a twin on the bus and on wheels: those in order, or those that its table names."""
        named = {axis.name: axis for axis in self.plant.axes}
        if wheels:
            named = {axis.actuator: each for axis, each in zip(table.axes, wheels, strict=False)}
        motors = [
            Motor(named[axis.actuator], axis.motor_per_wheel)
            for axis in table.axes
            if axis.actuator in named
        ]
        twin: Twin = table.make(settings, motors, self.plant, self.run_to, MemoryStore())
        port = self.bus.attach(twin.name, twin.on_frame, accept=twin.arbitration_ids)
        twin.connect(
            port, lambda due, each: self.bus.schedule(due, lambda: each.wake(self.bus.now_ns))
        )
        twin.power_cycle(0)
        self.twins.append(twin)
        return twin

    def run_to(self, now_ns: int) -> int:
        """Bring the plant to a time."""
        steps = now_ns // MS - self._plant_ns // MS
        if steps > 0:
            self.plant.step(steps)
            self._plant_ns = now_ns
        return now_ns // MS * MS

    def _receive(self, frame: Any) -> None:
        plain = frame.arbitration_id & ~(BIT_RATE_SWITCH_FLAG | ERROR_STATE_FLAG)
        self.received.append((plain, frame.data, frame.stamp_ns))

    def put(self, arbitration_id: int, data: bytes) -> bool:
        """Put a frame of the host on the bus."""
        flags = BIT_RATE_SWITCH_FLAG if arbitration_id & FD_FLAG else 0
        return self._port.send(arbitration_id | flags, data)

    def advance(self, duration_ns: int) -> None:
        """Let time pass without the host."""
        self.bus.advance(self.bus.now_ns + duration_ns)
        self.run_to(self.bus.now_ns)

    def listen(self, drives: Sequence[Any]) -> None:
        """Give drives what was received, and have them judge it."""
        frames, self.received = self.received, []
        for drive in drives:
            for arbitration_id, data, stamp_ns in frames:
                if handler := drive.handlers.get(arbitration_id):
                    handler(data, stamp_ns)
            drive.check(self.now_ns)

    @property
    def powered(self) -> bool:
        """Whether any wheel is driven."""
        self.run_to(self.bus.now_ns)
        return any(axis.powered for axis in self.plant.axes)


class Bench(Stand):
    """Drives of one kind or several, host and twin, each on wheels of a robot.

    Parameters
    ----------
    drives
        For each the table of the host, that of the simulator, and the settings of the twin.
    name, data_bitrate
        As `Stand` has them.
    """

    def __init__(
        self,
        *drives: tuple[Any, Any, Any],
        name: str = "diff_drive",
        data_bitrate: int = 0,
        needs: DriveNeeds = NEEDS,
        host: bool = True,
    ) -> None:
        super().__init__(name, data_bitrate)
        for _, table, settings in drives:
            self.plug(table, settings)
        self.drives = [each.make(axes_of(each), needs) for each, _, _ in drives] if host else []
        self.sent: list[tuple[int, bytes]] = []
        self.takes_frames = True

    @property
    def drive(self) -> Any:
        return self.drives[0]

    @property
    def twin(self) -> Any:
        return self.twins[0]

    @property
    def report(self) -> Any:
        return self.drive.reports[0]

    @property
    def state(self) -> DriveState:
        return self.report.state

    def send(self, arbitration_id: int, data: bytes) -> bool:
        """Put a frame on the bus, as `CanPort.send` does."""
        if not self.takes_frames:
            return False
        self.sent.append((arbitration_id, bytes(data)))
        return self.put(arbitration_id, data)

    def deliver(self, arbitration_id: int, data: bytes) -> None:
        """Let the host receive a frame that some other device sent."""
        self.received.append((arbitration_id, data, self.bus.now_ns))

    def tick(self, *commands: ActuatorCommand) -> None:
        """Pass a control period, and send a command to each drive (or one for all)."""
        self.advance(PERIOD_NS)
        self.listen(self.drives)
        now_ns = self.now_ns
        for place, drive in enumerate(self.drives):
            drive.command(self.send, commands[place % len(commands)], now_ns)
        any(drive.serve(self.send, now_ns) for drive in self.drives)

    def run(self, seconds: float, *commands: ActuatorCommand) -> None:
        """Run the host for a time."""
        for _ in range(round(seconds * 1e9 / PERIOD_NS)):
            self.tick(*(commands or (COAST,)))

    def commission(self, limit_s: float = 5.0) -> None:
        """Run until all drives are in service."""
        for _ in range(round(limit_s * 1e9 / PERIOD_NS)):
            if all(not drive.status.problem for drive in self.drives):
                return
            self.tick(COAST)
        raise AssertionError([drive.status.problem for drive in self.drives])

    def stop(self, source: EmergencyStopSource = EmergencyStopSource.OPERATOR) -> None:
        """Send an emergency stop to all drives."""
        for drive in self.drives:
            assert drive.emergency_stop(self.send, source)

    def clear(self) -> None:
        """Ask all drives to clear their faults."""
        for drive in self.drives:
            drive.clear_faults()

    def speed(self, wheel: int = 0) -> float:
        """True speed of a wheel [rad/s]."""
        self.run_to(self.bus.now_ns)
        return self.plant.axes[wheel].speed_rad_s

    def turns(self, wheel: int = 0) -> float:
        """True turns of a wheel since the start."""
        self.run_to(self.bus.now_ns)
        return self.plant.axes[wheel].angle_rad / math.tau


def same(values: Sequence[float], wanted: float, within: float) -> bool:
    """Return whether all values are near one."""
    return all(abs(value - wanted) <= within for value in values)
