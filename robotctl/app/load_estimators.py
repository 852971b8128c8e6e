"""The estimators of a robot that has some; nothing heavy is loaded for one that has none."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from robotctl.app.config import RobotConfig
from robotctl.app.options import StackOptions
from robotctl.model.se2 import SE2

if TYPE_CHECKING:
    from robotctl.app.estimators import Estimators


def load_estimators(config: RobotConfig, options: StackOptions) -> Estimators | None:
    """Return localiser and mapper, compiled and ready; None where neither is wanted.

    Raises
    ------
    ConfigError
        If the map cannot be read or does not fit the method.
    """
    if config.localisation.method == "none" and not config.localisation.mapping:
        return None
    # numba, scipy and filterpy take a second to load and 100 MB of memory.
    from robotctl.app.estimators import make_estimators  # noqa: PLC0415

    start = SE2(options.x_m, options.y_m, options.theta_rad)
    return make_estimators(config, start, Path(options.robot).resolve().parent)
