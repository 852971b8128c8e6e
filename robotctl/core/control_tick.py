"""One period of control: for the control process and for lockstep."""

from __future__ import annotations

from robotctl.core.control_core import ControlCore, Inputs, Outputs
from robotctl.core.operator import Operator
from robotctl.messages.actuators import ActuatorCommand
from robotctl.messages.control import Arm, ControlRequest, Feedback
from robotctl.messages.faults import Fault
from robotctl.messages.ports import RobotPort
from robotctl.messages.procedures import MotorTest


def _would_enable(request: ControlRequest) -> bool:
    """Return whether a request is one to enable the motors."""
    return isinstance(request, MotorTest) or (isinstance(request, Arm) and request.arm)


class ControlTick:
    """Frames and requests in, one step of the core, the command out.

    It reads no clock and knows no sockets. `control` is `ControlCore.step` and nothing else, so a
    replay of `inputs` through the core is a replay of the tick.

    Parameters
    ----------
    robot, core
        The wire and what thinks.
    operator
        Source of requests and receiver of notices.

    Attributes
    ----------
    inputs, outputs
        Of the present tick.
    """

    def __init__(
        self, robot: RobotPort, core: ControlCore, operator: Operator[ControlRequest]
    ) -> None:
        self.robot = robot
        self.core = core
        self.inputs = Inputs(Feedback())
        self.outputs = Outputs(ActuatorCommand())
        self._operator = operator

    @property
    def objections(self) -> tuple[Fault, ...]:
        """Objections of the host computer to arming."""
        return self._operator.objections

    def receive(self, now_ns: int) -> None:
        """Take frames and requests."""
        requests = tuple(self._operator.ask())
        objections: tuple[Fault, ...] = ()
        if requests and any(map(_would_enable, requests)):
            objections = self._operator.objections
        self.inputs = Inputs(self.robot.receive(now_ns), requests, objections)

    def control(self, now_ns: int) -> None:
        """Step the core."""
        self.outputs = self.core.step(self.inputs, now_ns)

    def send(self, now_ns: int) -> None:
        """Send the command; an emergency stop goes first."""
        outputs = self.outputs
        if outputs.emergency_stop is not None:
            self.robot.emergency_stop(outputs.emergency_stop)
        if outputs.clear_faults:
            self.robot.clear_faults()
        self.robot.send(outputs.command, now_ns)

    def publish(self) -> None:
        """Publish this tick's notices."""
        for notice in self.outputs.notices:
            self._operator.tell(notice)
