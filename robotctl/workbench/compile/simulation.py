"""The simulated other end of the wire, and the score of a run."""

from __future__ import annotations

from typing import Final

import numpy as np

from robotctl.app.scoring.journey_score import JourneyScore
from robotctl.app.scoring.score import StampedPose
from robotctl.app.simulation.lockstep_stack import make_simulation
from robotctl.config.robot_file import config_directory

_SECOND_NS: Final = 1_000_000_000


def warm_up() -> None:
    """Let robots of each kind drive, touch things, and see by all of their sensors."""
    configs = config_directory()
    world = configs / "worlds" / "flat_lived_in.toml"
    sweeps = ("simulation.lidar.sweep_s=0.1",)
    for robot, settings in (
        ("diff_drive.toml", ()),
        ("diff_drive.toml", sweeps),
        ("ackermann.toml", ()),
    ):
        simulation = make_simulation(configs / robot, world, 0, (1.0, 1.0, 0.0), settings, people=1)
        simulation.advance(_SECOND_NS)
        simulation.scan()
        simulation.camera_frame()
    body = np.array([[0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.2, -0.2]])
    score = JourneyScore([[body]], np.array([[1.0, 0.0, 1.0, 1.0]]))
    score.truth(StampedPose(0, 0.0, 0.0, 0.0), [(1.0, 1.0)])
