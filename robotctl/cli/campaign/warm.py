"""Modules and values that each run of a campaign loads; the server that forks runs has them.

Each run would import it in any case, most of it only when needed.
"""

from __future__ import annotations

import importlib
from contextlib import suppress
from typing import Final

from robotctl.app.processes.robot import make_codec
from robotctl.config.robot_file import RobotConfig
from robotctl.errors import RobotctlError
from robotctl.toml_source import validator
from robotctl.workbench.compile.compile import Kernels

_MODULES: Final = (
    "robotctl.cli.main",
    "robotctl.cli.commands",
    "robotctl.cli.sim",
    "robotctl.cli.live.score_view",
    "robotctl.cli.live.lockstep_progress",
    "robotctl.app.simulation.lockstep",
    "robotctl.app.localisation.estimators",
    "robotctl.app.localisation.mcl_localiser",
    "robotctl.estimation.sensors.lidar",
    "robotctl.estimation.sensors.sonar",
    "robotctl.planning.behave.journey.pilot",
    "robotctl.planning.path.global_planning.planners",
    "robotctl.planning.path.local.controllers",
    "firmware_sim.simulation",
    "numpy.random",
    "scipy.ndimage",
    "rich.status",
)


def _warm_up() -> None:
    """Load and make once what each run needs, and no run changes."""
    for each in _MODULES:
        importlib.import_module(each)
    validator(RobotConfig)
    with suppress(RobotctlError):  # a run says it better
        make_codec()
    _ = Kernels(simulated=True).missing


_warm_up()
