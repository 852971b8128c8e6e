"""`STEPS`: the steps of the guided set-up, in their order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from robotctl.deploy.setup.bench import Bench
from robotctl.deploy.setup.dialogue import Script
from robotctl.deploy.setup.steps import (
    body,
    counts,
    directions,
    floor,
    nodes,
    proof,
    sensors,
    speeds,
)


@dataclass(frozen=True, slots=True)
class Step:
    """One step.

    Parameters
    ----------
    name
        Name for command line and progress record.
    title
        Title for people.
    run
        Starts a run of the step.
    repeats
        Whether it runs again after its own changes, until it finds none.
    """

    name: str
    title: str
    run: Callable[[Bench], Script]
    repeats: bool = False


STEPS: Final = (
    Step("nodes", "drives and sensor nodes", nodes.run, repeats=True),
    # Before any motor turns, so that a wrong ratio cannot make a wheel fast.
    Step("counts", "counts and ratios", counts.run),
    Step("directions", "wheels and directions", directions.run, repeats=True),
    Step("prove", "drives stop when this computer is silent", proof.run),
    Step("speeds", "speeds and gains", speeds.run),
    Step("stop", "emergency stop", sensors.emergency_stop),
    Step("sonars", "sonars", sensors.sonars),
    Step("imu", "inertial measurement unit", sensors.imu),
    Step("body", "outline of the body", body.run),
    Step("floor", "on the floor", floor.run),
)
