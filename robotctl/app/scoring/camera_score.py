"""Score of the camera: its ranges and objects against the simulator's truth."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from firmware_sim.camera.truth import Sighting, sightings, true_ranges
from firmware_sim.config.camera_parameters import CameraMount, Intrinsics
from firmware_sim.config.config import RobotConfig as SimulatedRobot
from firmware_sim.world.world import World
from robotctl.app.scoring.score import CameraReport, StampedPose, TruthMatcher
from robotctl.config.robot_file import RobotConfig
from robotctl.messages.estimation import CameraView

_REACH_M: Final = 2.0
"""Objects on the floor are to be found up to this distance from the camera's foot point [m]."""
_WHOLE: Final = 0.95
"""Share of an object's foot that must be in sight for it to count as one to be found."""
_SAME_M: Final = 0.15
"""Distance between a reported and the true foot that counts as found; extra range of a ray that
proves nothing stands there [m]."""
_NEAR_M, _FAR_M = 0.5, 3.0
"""Ranges are judged between these [m]."""


class CameraScore:
    """Compares each view with the true surroundings at its time.

    Parameters
    ----------
    world
        The room.
    intrinsics, mount
        Of the true camera.
    """

    def __init__(self, world: World, intrinsics: Intrinsics, mount: CameraMount) -> None:
        self._world = world
        self._intrinsics = intrinsics
        self._mount = mount
        self._matcher: TruthMatcher[CameraView] = TruthMatcher()
        self._errors: list[np.ndarray] = []
        self._within: list[np.ndarray] = []
        self._offsets_m: list[float] = []
        self._steps_us: list[float] = []
        self._views = self._untrusted = self._wanted = self._false = 0

    def truth(self, pose: StampedPose) -> None:
        """Add a true pose; they must come in the order of their stamps."""
        for _, view, truth in self._matcher.truth(pose):
            self._add(view, truth)

    def view(self, view: CameraView) -> None:
        """Add a view; they must come in the order of their stamps."""
        where = StampedPose(view.stamp_ns, 0.0, 0.0, 0.0)
        for _, matched, truth in self._matcher.pose(where, view):
            self._add(matched, truth)

    def _add(self, view: CameraView, truth: StampedPose) -> None:
        """Score one view."""
        self._views += 1
        self._steps_us.append(view.step_us)
        if view.trouble:
            self._untrusted += 1
            return
        pose = truth[1:]
        self._add_ranges(view, pose)
        self._add_obstacles(view, pose)

    def _add_ranges(self, view: CameraView, pose: tuple[float, float, float]) -> None:
        """Score the beams that have something to see, those that went on there too."""
        angles = np.array(view.angles_rad)
        true_m = true_ranges(self._world, pose, self._mount, angles)
        ranges, sigmas = np.array(view.ranges_m), np.array(view.sigmas_m)
        judged = (true_m >= _NEAR_M) & (true_m <= _FAR_M) & ~np.isnan(ranges)
        error = np.abs(ranges[judged] - true_m[judged])
        self._errors.append(error / true_m[judged])
        self._within.append(error <= 3.0 * sigmas[judged])

    def _add_obstacles(self, view: CameraView, pose: tuple[float, float, float]) -> None:
        """Score found, missed and false obstacles."""
        for thing in sightings(self._world, pose, self._intrinsics, self._mount):
            if thing.kind != "obstacle" or self._distance_m(thing) > _REACH_M:
                continue
            if thing.seen < _WHOLE:
                continue
            foot = (thing.front_x_m, thing.front_y_m)
            offsets = [math.dist(foot, (seen.x_m, seen.y_m)) for seen in view.obstacles]
            nearest = min(offsets, default=math.inf)
            self._wanted += 1
            self._offsets_m += [nearest] if nearest <= _SAME_M else []
        if view.obstacles:
            at = np.array([(seen.x_m - view.x_m, seen.y_m - view.y_m) for seen in view.obstacles])
            goes_m = true_ranges(self._world, pose, self._mount, np.arctan2(at[:, 1], at[:, 0]))
            self._false += int(np.sum(goes_m > np.hypot(at[:, 0], at[:, 1]) + _SAME_M))

    def _distance_m(self, thing: Sighting) -> float:
        """Return an object's distance from the camera's foot point [m]."""
        return math.hypot(thing.near_x_m - self._mount.x_m, thing.near_y_m - self._mount.y_m)

    def result(self) -> CameraReport | None:
        """Return the score so far; None if nothing was seen."""
        if not self._views:
            return None
        errors = np.concatenate(self._errors) if self._errors else np.empty(0)
        within = np.concatenate(self._within) if self._within else np.empty(0)
        found = len(self._offsets_m)
        return CameraReport(
            pictures=self._views,
            untrusted=self._untrusted,
            range_error=float(np.median(errors)) if len(errors) else None,
            within_3_sigma=float(within.mean()) if len(within) else None,
            obstacles=self._wanted,
            found=found,
            false=self._false,
            obstacle_rmse_m=(
                math.sqrt(sum(offset**2 for offset in self._offsets_m) / found) if found else None
            ),
            step_ms=float(np.median(self._steps_us)) / 1000.0,
        )


def camera_score(
    config: RobotConfig, simulated: SimulatedRobot, world: World
) -> CameraScore | None:
    """Return the score of a simulated robot's camera in a world; None if it does not look."""
    if config.camera is None or not config.camera.enabled:
        return None
    if simulated.camera is None:
        return None
    true = simulated.simulation.camera
    return CameraScore(
        world,
        true.true_intrinsics(simulated.camera.intrinsics),
        true.true_mount(simulated.camera.mount),
    )
