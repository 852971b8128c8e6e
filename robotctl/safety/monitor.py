"""What a monitor is: it compares inputs of a powered robot and says where they contradict."""

from __future__ import annotations

from typing import Protocol

import msgspec

from robotctl.messages.control import Feedback, ImuFeedback, WheelCommand
from robotctl.messages.faults import Fault
from robotctl.model.geometry.se2 import SE2


class Motion(Protocol):
    """What encoders and IMU say of the motion; computed when asked for."""

    @property
    def speeds_rad_s(self) -> tuple[float, ...]:
        """Speed of each driven wheel [rad/s]."""

    @property
    def jumps(self) -> int:
        """Impossible jumps of the counts so far."""

    @property
    def pose_odom_base(self) -> SE2:
        """Pose of odometry."""

    @property
    def imu(self) -> ImuFeedback | None:
        """What the IMU says; None on a robot without one."""


class MonitorInputs(msgspec.Struct, frozen=True, gc=False):
    """What monitors see in a tick.

    Parameters
    ----------
    feedback
        What the bus brought since the last tick.
    command
        What the bridges did when it was taken.
    supply_v
        Newest voltage of the drive's supply [V]; None before the first.
    motion
        By encoders and IMU.
    """

    feedback: Feedback
    command: WheelCommand
    supply_v: float | None
    motion: Motion


class Monitor(Protocol):
    """One member of `supervision.MONITORS`."""

    def reset(self) -> None:
        """Begin anew: the robot is armed."""

    def update(self, inputs: MonitorInputs) -> Fault | None:
        """Take the inputs of one tick of a powered robot; return a contradiction."""
