"""`NODES`: the nodes that a robot may have, in the order of their ids."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final, NamedTuple

from firmware_sim.config.motors import OWN_KIND
from firmware_sim.nodes import drive_objects, imu, power, sonar, wire

if TYPE_CHECKING:
    from firmware_sim.config.config import RobotConfig


class NodeKind(NamedTuple):
    """One node: name, id, whether a robot has it, process data by identifier."""

    name: str
    node_id: int
    is_there: Callable[[RobotConfig], bool]
    frames: Callable[[RobotConfig], tuple[int, ...]]


def has_own_controller(robot: RobotConfig) -> bool:
    """Whether a motor controller of ours drives the robot."""
    return any(motor.kind == OWN_KIND for motor in robot.motors)


NODES: Final = (
    NodeKind(
        "drive",
        drive_objects.NODE_ID,
        has_own_controller,
        lambda _: (wire.WHEEL_FEEDBACK, wire.MOTOR_STATUS, wire.DRIVE_STATUS),
    ),
    NodeKind(
        "sonar",
        sonar.NODE_ID,
        lambda robot: bool(robot.sonar) or has_own_controller(robot),
        lambda robot: sonar.range_identifiers(len(robot.sonar)),
    ),
    NodeKind(
        "power",
        power.NODE_ID,
        lambda robot: robot.power.source == "node",
        lambda _: (wire.BATTERY,),
    ),
    NodeKind(
        "imu",
        imu.NODE_ID,
        lambda robot: robot.imu.enabled,
        lambda _: (wire.IMU_GYRO, wire.IMU_ACCELEROMETER),
    ),
)
NODE_NAMES: Final = tuple(kind.name for kind in NODES)
