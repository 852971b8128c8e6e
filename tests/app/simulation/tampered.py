"""A port between controller and simulated robot that bends what passes, from a time on."""

from collections.abc import Callable

import msgspec

from robotctl.app.simulation.lockstep_stack import LockstepStack, make_simulation
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.messages.actuators import ActuatorCommand
from robotctl.messages.control import (
    Arm,
    EmergencyStopSource,
    Feedback,
    SafetyState,
    VelocityCommand,
)
from robotctl.messages.faults import FaultCode
from robotctl.messages.ports import RobotPort

replace = msgspec.structs.replace
Bend = Callable[[Feedback, Feedback], Feedback]
"""Takes feedback and the last one of each kind from before the fault; returns what is reported."""


class Tampered:
    """A `RobotPort` in front of another."""

    def __init__(self, robot: RobotPort) -> None:
        self.robot = robot
        self.feedback: Bend | None = None
        self.command: Callable[[ActuatorCommand], ActuatorCommand] | None = None
        self._last = Feedback()

    def receive(self, now_ns: int) -> Feedback:
        feedback = self.robot.receive(now_ns)
        if self.feedback is not None:
            return self.feedback(feedback, self._last)
        seen = {
            name: value
            for name, value in msgspec.structs.asdict(feedback).items()
            if value is not None and value != ()
        }
        self._last = replace(self._last, **seen)
        return feedback

    def send(self, command: ActuatorCommand, now_ns: int) -> None:
        self.robot.send(self.command(command) if self.command else command, now_ns)

    def emergency_stop(self, source: EmergencyStopSource) -> None:
        self.robot.emergency_stop(source)

    def clear_faults(self) -> None:
        self.robot.clear_faults()

    def close(self) -> None:
        self.robot.close()


class Trial:
    """A robot in an empty room, 6 m by 4 m, driven by velocity set-points."""

    def __init__(self, robot: str, start=(2.0, 2.0, 0.0), overrides: tuple[str, ...] = ()) -> None:
        path = find_file(robot)
        simulation = make_simulation(path, find_file("empty_room", "worlds"), 1, start, overrides)
        config = load_robot(path, overrides)
        self.stack = LockstepStack(config, StackOptions("trial", str(path), overrides), simulation)
        self.port = Tampered(self.stack.control.robot)
        self.stack.control.robot = self.port
        self.top_m_s = 0.0

    @property
    def state(self) -> SafetyState:
        return self.stack.core.machine.state

    @property
    def reason(self) -> str:
        return self.stack.core.machine.reason

    @property
    def fault(self) -> tuple[FaultCode, str]:
        """The kind of what the robot stands for, and the part that it is of."""
        state = self.stack.snapshot()
        return state.fault, state.fault_part

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds * 200)):
            self.stack.tick()

    def arm(self) -> None:
        self.stack.tick((Arm(self.stack.clock.now_ns(), 1, arm=True),))
        self.wait(1.1)

    def armed(self) -> "Trial":
        self.wait(2.0)
        self.arm()
        assert self.state == SafetyState.ARMED, self.stack.snapshot().acks[-1]
        return self

    def drive(self, v_m_s: float, omega_rad_s: float, seconds: float) -> float:
        """Drive until the time is up or the robot stops itself; return how long that took [s]."""
        for tick in range(round(seconds * 200)):
            now_ns = self.stack.clock.now_ns()
            self.stack.tick((VelocityCommand(now_ns, now_ns + 200_000_000, v_m_s, omega_rad_s),))
            if self.state == SafetyState.FAULT:
                return tick * 0.005
            self.top_m_s = max(self.top_m_s, abs(self.stack.simulation.truth().v_m_s))
        return seconds
