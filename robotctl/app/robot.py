"""From a configuration to the objects of a robot."""

from __future__ import annotations

import msgspec

import robotctl
from robotctl.app.config import RobotConfig
from robotctl.app.options import StackOptions
from robotctl.model.se2 import SE2
from robotctl.runtime.core import ControlCore
from robotctl.runtime.recorder import RecordHeader


def make_core(config: RobotConfig, options: StackOptions) -> ControlCore:
    """Return the control core of a robot."""
    return ControlCore(
        config.drive,
        config.control,
        config.limits,
        config.safety,
        config.runtime.period_ns,
        len(config.sonar),
        SE2(options.x_m, options.y_m, options.theta_rad),
    )


def record_header(config: RobotConfig, options: StackOptions) -> RecordHeader:
    """Return what a replay needs to make the same core again."""
    return RecordHeader(
        version=robotctl.__version__,
        robot_json=msgspec.json.encode(config).decode(),
        x_m=options.x_m,
        y_m=options.y_m,
        theta_rad=options.theta_rad,
    )
