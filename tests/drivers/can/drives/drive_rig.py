"""A robot's drives against their twins on the simulated bus, without the control core."""

from __future__ import annotations

from collections.abc import Callable

from firmware_sim.simulation import Simulation
from robotctl.app.processes.robot import make_codec, make_parts
from robotctl.app.simulation.lockstep_stack import attach_port, make_simulation
from robotctl.config.robot_file import RobotConfig, find_file, load_robot
from robotctl.drivers.can.drives.fitting import actuators_of, fit
from robotctl.drivers.can.robot_can import CanRobot
from robotctl.messages.actuators import ActuatorCommand, DriveState
from robotctl.messages.control import Feedback
from robotctl.model.actuators import Takes
from robotctl.runtime.clock import VirtualClock

OFF = ActuatorCommand(enable=False, brake=True)
MS = 1_000_000


class DriveRig:
    """Host and simulated robot under one virtual time, tick by tick.

    Parameters
    ----------
    robot
        Name of the robot's file.
    settings
        As `--set` takes them, for host and simulator.
    """

    def __init__(self, robot: str, *settings: str, seed: int = 1) -> None:
        file = find_file(robot)
        self.config: RobotConfig = load_robot(file, settings)
        self.simulation: Simulation = make_simulation(
            file, find_file("empty_room", "worlds"), seed, None, settings
        )
        self.clock = VirtualClock(self.simulation.now_ns)
        self.parts = make_parts(self.config, make_codec())
        self.robot = CanRobot(
            {
                bus.name: attach_port(
                    self.simulation.buses[bus.name],
                    bus,
                    self.parts.identifiers(bus.name),
                    self.clock,
                )
                for bus in self.config.buses
            },
            self.parts,
        )
        self.actuators = actuators_of(fit(self.config.drive, self.config.motors))
        self.period_ns = self.config.runtime.period_ns
        self.feedback = Feedback()

    def tick(
        self, command: ActuatorCommand | Callable[[Feedback], ActuatorCommand] = OFF
    ) -> Feedback:
        """Let one period pass, then receive and send; a function decides by what was received."""
        now_ns = self.clock.now_ns() + self.period_ns
        self.simulation.advance(now_ns)
        self.clock.sleep_until(now_ns)
        self.feedback = self.robot.receive(now_ns)
        if not isinstance(command, ActuatorCommand):
            command = command(self.feedback)
        self.robot.send(command, now_ns)
        return self.feedback

    def run(self, duration_ms: float, command: ActuatorCommand = OFF) -> Feedback:
        """Tick for a time."""
        for _ in range(round(duration_ms * MS / self.period_ns)):
            self.tick(command)
        return self.feedback

    def hold_still(self, duration_ms: float) -> None:
        """Let time pass in which the host does nothing."""
        self.clock.sleep_until(self.clock.now_ns() + round(duration_ms * MS))
        self.simulation.advance(self.clock.now_ns())

    def commission(self) -> DriveRig:
        """Tick until all are in service."""
        for _ in range(100):
            self.run(50)
            if not any(node.problem for node in self.feedback.nodes):
                return self
        raise AssertionError([node.problem for node in self.feedback.nodes])

    def drive(self, share: float, duration_ms: float = 600, *, brake: bool = True) -> Feedback:
        """Command all wheels a share of a moderate speed, or of the duty for it."""
        return self.run(duration_ms, self.command(share, brake=brake))

    def command(self, share: float, *, brake: bool = True) -> ActuatorCommand:
        """Return the command that turns all wheels forward at a share of 6 rad/s."""
        values = {Takes.SPEED: 6.0 * share, Takes.DUTY: 0.3 * share, Takes.ANGLE: 0.0}
        return ActuatorCommand(True, brake, tuple(values[each.takes] for each in self.actuators))

    @property
    def wheels_rad_s(self) -> list[float]:
        """True speeds of the wheels [rad/s]."""
        self.simulation.run_to(self.simulation.now_ns)
        return [axis.speed_rad_s for axis in self.simulation.plant.axes]

    @property
    def powered(self) -> bool:
        """Whether any wheel has power."""
        self.simulation.run_to(self.simulation.now_ns)
        return self.simulation.plant.powered

    @property
    def states(self) -> set[DriveState]:
        """States that the actuators tell."""
        return {each.state for each in self.feedback.actuators}
