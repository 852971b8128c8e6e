"""Step: gains of wheels whose drives take a duty, and the maximum speed of the robot."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from robotctl.config.file_edit import Change
from robotctl.config.robot_file import RobotConfig
from robotctl.core.config import fastest_wheel_rad_s
from robotctl.deploy.setup.bench import Bench
from robotctl.deploy.setup.dialogue import NO_CHANGES, Ask, Kind, Script, Tell, Topic
from robotctl.model.actuators import Takes

_RPM: Final = 60.0 / math.tau


def run(bench: Bench) -> Script:
    """Show the required motor speeds, ask for the maximum speed, and show how to find gains."""
    config = bench.config
    for line in _motors(config):
        yield Tell(line)
    if any(wheel.actuator.takes is Takes.DUTY for wheel in bench.wheels):
        yield Tell(
            "The wheels' loops are this computer's: docs/tuning.md finds their gains. `robotctl "
            "tune` does it for the robot as [simulation] describes it, with the patch to paste."
        )
    now_m_s = config.limits.v_max_m_s
    text = f"Greatest speed of the robot [m/s]? Begin with little (now {now_m_s:g})."
    answer = yield Ask(Topic.SPEED, text, Kind.NUMBER, default=f"{now_m_s:g}")
    if answer == now_m_s:
        return NO_CHANGES
    return (Change(("limits", "v_max_m_s"), float(answer)),)


def _motors(config: RobotConfig) -> Iterator[str]:
    """Yield the required speed of each motor at the robot's limits."""
    fastest = fastest_wheel_rad_s(config.drive, config.limits)
    for motor in config.motors:
        for axis in motor.axes:
            if axis.actuator in config.drive.wheel_names:
                rpm = fastest * axis.ratio * _RPM
                yield (
                    f"At the robot's limits {axis.actuator} turns at {fastest * _RPM:.0f} rpm, the "
                    f"axis of {motor.name} at {rpm:.0f}."
                )
