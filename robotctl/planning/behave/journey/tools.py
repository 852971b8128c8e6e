"""All that the journeys of one robot share."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from robotctl.planning.behave.behaviours.kind import Pace
from robotctl.planning.behave.behaviours.outlook import NOWHERE
from robotctl.planning.config import JourneyConfig, RecoveryConfig
from robotctl.planning.map.live_world import LiveWorld
from robotctl.planning.path.global_planning.path_finder import PathFinder
from robotctl.planning.path.local.controller import Controller, ControllerConfig


@dataclass(slots=True)
class JourneyTools:
    """The world, paths through it, and what follows them.

    Parameters
    ----------
    world, paths
        What is known, and plans through that.
    controller, config
        Follows a path; its settings.
    journey
        When journeys are planned again, and when they are in trouble.
    recovery
        How patient journeys are.
    pace
        Told of the parts of its steps, and asked how much it may do in them.
    shown
        Path and arc that the robot drives by in this step, each (n, 3) in `world`, for people.
    """

    world: LiveWorld
    paths: PathFinder
    controller: Controller
    config: ControllerConfig
    journey: JourneyConfig
    recovery: RecoveryConfig
    pace: Pace
    shown: tuple[NDArray[np.float64], NDArray[np.float64]] = field(default=(NOWHERE, NOWHERE))
