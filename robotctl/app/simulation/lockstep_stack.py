"""A simulated robot with its controller on one virtual clock, moved tick by tick."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from firmware_sim.bus.frame import BIT_RATE_SWITCH_FLAG, ERROR_STATE_FLAG, FD_FLAG, Frame
from firmware_sim.bus.state import FdSupport
from firmware_sim.errors import SimulationError
from firmware_sim.world.manner import STUBBORN, Manner
from firmware_sim.world.world import World
from robotctl.app.processes.robot import make_codec, make_core, make_parts
from robotctl.app.simulation.simulator_files import SimulatorError, simulated_robot
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig
from robotctl.core.control_core import Inputs, Outputs
from robotctl.core.control_tick import ControlTick
from robotctl.core.operator import Operator
from robotctl.drivers.can.config import CanConfig
from robotctl.drivers.can.memory_port import MemoryPort
from robotctl.drivers.can.robot_can import CanRobot
from robotctl.messages.actuators import ActuatorCommand
from robotctl.messages.control import (
    ControlRequest,
    ControlState,
    LoopStatistics,
    Notice,
)
from robotctl.messages.ports import Clock
from robotctl.runtime.clock import VirtualClock
from robotctl.runtime.histogram import Histogram

if TYPE_CHECKING:
    from firmware_sim.bus.core import Bus
    from firmware_sim.simulation import Simulation

_NO_FIGURES = LoopStatistics()
_SENDERS_FLAGS = BIT_RATE_SWITCH_FLAG | ERROR_STATE_FLAG
"""Flags of the simulator's frames that `Frame` does not have."""


class LockstepStack:
    """Firmware, bus and controller in one process.

    Parameters
    ----------
    config, options
        The robot and its start pose.
    simulation
        The other end of the wire.
    tell
        Given what the control process would publish at once.
    """

    def __init__(
        self,
        config: RobotConfig,
        options: StackOptions,
        simulation: Simulation,
        tell: Callable[[Notice], object] = lambda _: None,
    ) -> None:
        self.clock = VirtualClock(simulation.now_ns)
        self.simulation = simulation
        self.period_ns = config.runtime.period_ns
        self.step_ns = Histogram()
        parts = make_parts(config, make_codec())
        ports = {
            bus.name: attach_port(
                simulation.buses[bus.name], bus, parts.identifiers(bus.name), self.clock
            )
            for bus in config.buses
        }
        self.core = make_core(config, options)
        self.ticks = 0
        self._requests: tuple[ControlRequest, ...] = ()
        self.control = ControlTick(
            CanRobot(ports, parts),
            self.core,
            Operator(lambda: self._requests, tell),
        )
        self.control.receive(self.clock.now_ns())

    def tick(self, requests: tuple[ControlRequest, ...] = ()) -> Outputs:
        """Let one period pass, then do what the control process does in a tick."""
        now_ns = self._advance()
        self._requests = requests
        tick = self.control
        begin_ns = time.perf_counter_ns()
        tick.receive(now_ns)
        tick.control(now_ns)
        tick.send(now_ns)
        self.step_ns.add((time.perf_counter_ns() - begin_ns) // 100)
        tick.publish()
        return tick.outputs

    def open_loop_tick(self, law: Callable[[Inputs], ActuatorCommand]) -> Inputs:
        """Let one period pass and send the command of `law` past the core, for identification."""
        now_ns = self._advance()
        self._requests = ()
        self.control.receive(now_ns)
        self.control.robot.send(law(self.control.inputs), now_ns)
        return self.control.inputs

    def _advance(self) -> int:
        """Move firmware and clock by one period."""
        self.ticks += 1
        now_ns = self.clock.now_ns() + self.period_ns
        self.simulation.advance(now_ns)
        self.clock.sleep_until(now_ns)
        return now_ns

    def snapshot(self) -> ControlState:
        """Return the control core's state now, without the loop's figures (see `statistics`)."""
        return self.core.snapshot(self.clock.now_ns(), _NO_FIGURES)

    def statistics(self) -> LoopStatistics:
        """Return the loop's figures: no lag under a virtual clock, but real times of the step."""
        p50, p99 = self.step_ns.percentiles(0.5, 0.99)
        return LoopStatistics(
            rate_hz=1e9 / self.period_ns,
            ticks=self.ticks,
            step_us_p50=p50 / 10,
            step_us_p99=p99 / 10,
        )


def attach_port(
    bus: Bus,
    config: CanConfig,
    arbitration_ids: Collection[int] | None,
    clock: Clock,
    name: str = "host",
) -> MemoryPort:
    """Return a host's port on a simulated bus, which accepts some identifiers or (None) all.

    No other port there has its name.
    """
    fd = config.data_bitrate > 0
    switch = BIT_RATE_SWITCH_FLAG if config.data_bitrate > config.bitrate else 0

    def deliver_fd(frame: Frame) -> None:
        port.deliver((frame.arbitration_id & ~_SENDERS_FLAGS, frame.data, frame.stamp_ns))

    def send_fd(arbitration_id: int, data: bytes) -> bool:
        return wire.send(
            arbitration_id | switch if arbitration_id & FD_FLAG else arbitration_id, data
        )

    port = MemoryPort(lambda _id, _data: False, arbitration_ids, config, clock)
    wire = bus.attach(
        name,
        deliver_fd if fd else port.deliver,
        accept=arbitration_ids,
        errors=True,
        fd=FdSupport.ENABLED if fd else FdSupport.INTOLERANT,
    )
    port.transmit = send_fd if fd else wire.send
    return port


def make_simulation(
    robot: Path,
    world: Path | World,
    seed: int,
    start: tuple[float, float, float] | None,
    overrides: Sequence[str] = (),
    people: int = 0,
    manners: tuple[Manner, ...] = STUBBORN,
) -> Simulation:
    """Return the simulated robot in its world, compiled and ready.

    Raises
    ------
    SimulatorError
        If a file is wrong or the robot cannot stand at `start` (x [m], y [m], heading [rad]);
        None: where the world has it.
    """
    simulated = simulated_robot(robot, overrides)
    try:
        # Loading numba takes a second, which `robotctl --help` need not wait for.
        from firmware_sim.simulation import Simulation  # noqa: PLC0415

        simulation = Simulation(simulated, world, seed, start, people=people, manners=manners)
    except SimulationError as error:
        raise SimulatorError(str(error)) from error
    simulation.warm()
    return simulation
