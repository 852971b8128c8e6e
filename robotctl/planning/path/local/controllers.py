"""The registry of local controllers: one line adds a controller."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from robotctl.control.limiter import LimitsConfig
from robotctl.model.drives.drives import Drive
from robotctl.model.footprint import Footprint
from robotctl.planning.path.local.controller import Controller, ControllerConfig
from robotctl.planning.path.local.dwa import DynamicWindow
from robotctl.planning.path.local.follower import Follower
from robotctl.planning.path.local.mppi import PathIntegral

CONTROLLERS: Final[
    dict[str, Callable[[ControllerConfig, Drive, LimitsConfig, Footprint], Controller]]
] = {
    "dwa": lambda config, drive, limits, footprint: Follower(
        config, drive, limits, footprint, DynamicWindow(config)
    ),
    "mppi": lambda config, drive, limits, footprint: Follower(
        config, drive, limits, footprint, PathIntegral(config)
    ),
}
