"""The estimators of a robot that has some; nothing heavy is loaded for one that has none."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig
from robotctl.errors import ConfigError
from robotctl.model.geometry.se2 import SE2

_STILL_M, _STILL_RAD = 1e-3, 1e-3
"""Motion from the start that is rounding [m], [rad]."""

if TYPE_CHECKING:
    from robotctl.app.localisation.estimators import Estimators


def load_estimators(
    config: RobotConfig,
    options: StackOptions,
    last: SE2 | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> Estimators | None:
    """Return localiser and mapper, compiled and ready; None if neither is used.

    `last` is where the robot was last in this run, if it has begun before: a known start is there
    then, and less certain, because nothing observed the robot coming to rest. `say` is given what
    people should know while it compiles.

    Raises
    ------
    ConfigError
        If the map cannot be read or does not fit the method, or the estimators cannot be loaded
        or compiled: a file cannot be read, the disk takes no more.
    """
    if config.localisation.method == "none" and not config.localisation.mapping:
        return None
    start = SE2(options.x_m, options.y_m, options.theta_rad)
    if last is not None and _moved(start, last):
        settings = config.localisation
        settings = replace(
            settings,
            start_sigma_m=max(settings.start_sigma_m, settings.restart_sigma_m),
            start_sigma_deg=max(settings.start_sigma_deg, settings.restart_sigma_deg),
        )
        config, start = replace(config, localisation=settings), last
    try:
        # numba, scipy and filterpy take a second to load and 100 MB of memory.
        from robotctl.app.compile_progress import compile_progress  # noqa: PLC0415
        from robotctl.app.localisation.estimators import make_estimators  # noqa: PLC0415

        with compile_progress(say):
            beside = Path(options.robot).resolve().parent
            state = Path(options.state) if options.state else None
            return make_estimators(config, start, beside, state)
    except OSError as error:
        place = "" if error.filename is None else f"{error.filename}: "
        why = error.strerror or error
        raise ConfigError(f"{options.robot}: localisation: {place}{why}") from error


def _moved(start: SE2, last: SE2) -> bool:
    """Return whether the robot has left its start."""
    motion = start.inverse() @ last
    return math.hypot(motion.x_m, motion.y_m) > _STILL_M or abs(motion.theta_rad) > _STILL_RAD
