"""How well the ground-plane camera measures in the simulated office and in cluttered rooms.

All pictures are of different places; each is seen alone, by a camera that knows nothing of the
floor yet. The scenes and what counts as truth stand in `camera_scenes`. The simulated camera is
where its file says, and its pictures are seen once by that mount, so that errors are those of
noise and texture alone, and once each by a mount as `robotctl camera calibrate` finds it, on a
robot that pitches: the errors that the standard deviations of ranges allow for.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmarks import machine
from benchmarks.camera_homography import spread
from benchmarks.camera_scenes import Shot, cluttered_shots, geometry, office_shots
from firmware_sim.world.shapes import Thing
from robotctl.estimation.camera.calibration.homography import PointNoise
from robotctl.estimation.camera.calibration.mount import fit_mount
from robotctl.estimation.camera.config import GroundCameraConfig
from robotctl.estimation.camera.ground import GroundCamera, GroundView
from robotctl.estimation.camera.obstacles import GroundObstacle
from robotctl.model.sensors.camera_geometry import CameraGeometry

NEAR_M, FAR_M = 0.5, 3.0
REACH_M = 2.0
"""Obstacles are looked for up to here, from the camera's foot point."""
_STANDS_FREE_M = 0.25
_OF_A_THING_M = 0.15


@dataclass(slots=True)
class Beams:
    """Errors of the beams whose truth is between `NEAR_M` and `FAR_M`."""

    errors_m: list[NDArray[np.float64]] = field(default_factory=list)
    truths_m: list[NDArray[np.float64]] = field(default_factory=list)
    sigmas_m: list[NDArray[np.float64]] = field(default_factory=list)
    missed: int = 0
    not_judged: int = 0

    def add(self, shot: Shot, view: GroundView) -> None:
        """Compare one scan."""
        scan = view.scan
        assert scan.sigmas_m is not None
        truth, _ = shot.ranges(scan.x_m, scan.y_m, scan.angles_rad)
        inside = (truth >= NEAR_M) & (truth <= FAR_M)
        found = inside & np.isfinite(scan.ranges_m)
        self.errors_m.append(scan.ranges_m[found] - truth[found])
        self.truths_m.append(truth[found])
        self.sigmas_m.append(scan.sigmas_m[found])
        self.missed += int(np.sum(inside & np.isinf(scan.ranges_m)))
        self.not_judged += int(np.sum(inside & np.isnan(scan.ranges_m)))

    def row(self, name: str) -> tuple[str, ...]:
        """Return the line of the table."""
        errors, truths = np.concatenate(self.errors_m), np.concatenate(self.truths_m)
        within = np.abs(errors) <= 3.0 * np.concatenate(self.sigmas_m)
        # A beam that goes on where something stands is wrong too.
        total = len(errors) + self.missed
        relative = np.abs(errors) / truths
        return (
            name,
            str(total),
            f"{np.median(relative):.2%}",
            f"{np.percentile(relative, 95):.1%}",
            f"{np.median(errors / truths):+.2%}",
            f"{within.sum() / total:.1%}",
            f"{self.missed / total:.1%}",
            f"{self.not_judged / (total + self.not_judged):.1%}",
        )


@dataclass(slots=True)
class Things:
    """Obstacles that should be found, and what was found."""

    wanted: int = 0
    found: int = 0
    pictures: int = 0
    false: int = 0
    foot_errors_m: list[tuple[float, float]] = field(default_factory=list)
    centre_errors_m: list[tuple[float, float]] = field(default_factory=list)
    nees: list[float] = field(default_factory=list)

    def add(self, shot: Shot, view: GroundView) -> None:
        """Compare the obstacles of one picture."""
        self.pictures += 1
        for number in should_be_seen(shot):
            self.wanted += 1
            thing = shot.world.things[number]
            centre = shot.in_base(thing.corners).mean(axis=0)
            near = [o for o in view.obstacles if _gap(shot, o, thing) < _OF_A_THING_M]
            if not near:
                continue
            best = min(near, key=lambda o: _gap(shot, o, thing))
            self.found += 1
            distance = float(np.hypot(*(centre - [view.scan.x_m, view.scan.y_m])))
            self.foot_errors_m.append((distance, _foot_error(shot, view, best, number)))
            offset = best.centre_base - centre
            self.centre_errors_m.append((distance, float(np.hypot(*offset))))
            self.nees.append(float(offset @ np.linalg.solve(best.centre_covariance, offset)))
        self.false += len(false_alarms(shot, view))

    def row(self, name: str) -> tuple[str, ...]:
        """Return the line of the table."""
        foot = _between(self.foot_errors_m)
        centre = _between(self.centre_errors_m)
        return (
            name,
            f"{self.wanted} in {self.pictures}",
            f"{self.found / max(1, self.wanted):.1%}",
            f"{100 * self.false / self.pictures:.1f}",
            f"{100 * np.median(foot):.1f} / {100 * np.percentile(foot, 95):.1f}",
            f"{100 * np.median(centre):.1f} / {100 * np.percentile(centre, 95):.1f}",
            f"{np.mean(np.array(self.nees) < 11.83):.1%}",
        )


def should_be_seen(shot: Shot) -> list[int]:
    """Return the obstacles within reach with all of the foot in sight that stand free."""
    camera = geometry()
    foot = camera.t_base_camera[:2]
    seen = []
    for number, thing in enumerate(shot.world.things):
        if thing.kind != "obstacle":
            continue
        corners = shot.in_base(thing.corners)
        offset = corners - foot
        middle = float(np.hypot(*offset.mean(axis=0)))
        if middle > REACH_M or offset[:, 0].min() < 0.1:
            continue
        pixels = camera.project_ground(corners)
        inside = camera.inside(pixels) & (pixels[:, 1] < camera.intrinsics.height_px - 10.0)
        margin = (pixels[:, 0] > 8.0) & (pixels[:, 0] < camera.intrinsics.width_px - 8.0)
        if not np.all(inside & margin) or not _stands_free(shot, number):
            continue
        angles = np.arctan2(offset[:, 1], offset[:, 0])
        # Its foot, and a little beside it, is not hidden: the floor goes on at both sides.
        fan = np.linspace(angles.min() + 1e-3, angles.max() - 1e-3, 7)
        _, first = shot.ranges(*foot, fan)
        beside = np.array([angles.min() - 0.02, angles.max() + 0.02])
        behind, _ = shot.ranges(*foot, beside)
        if np.all(first == number) and np.all(behind > middle + _STANDS_FREE_M):
            seen.append(number)
    return seen


def false_alarms(shot: Shot, view: GroundView) -> list[GroundObstacle]:
    """Return the obstacles where nothing stands, or only a wall."""
    solid = [thing for thing in shot.world.things if thing.kind != "wall"]
    return [
        obstacle
        for obstacle in view.obstacles
        if not any(_gap(shot, obstacle, thing) < _OF_A_THING_M for thing in solid)
    ]


def run(rounds: int, _seconds: float) -> None:
    """Measure all; more rounds take more rooms."""
    worlds = 8 * rounds
    rows = [
        _office("office", worlds, None),
        _office("office, mount with errors", worlds, np.random.default_rng(4)),
    ]
    clutter, things, trust = Beams(), Things(), 0
    for shot, view in views(cluttered_shots(np.random.default_rng(2), worlds, 10)):
        clutter.add(shot, view)
        things.add(shot, view)
        trust += view.trusted
    rows.append(clutter.row(f"clutter, {10 * worlds}, {trust} trusted"))
    heads = ("pictures", "beams", "median", "95 %", "bias", "within 3 σ", "seen as free")
    machine.table(f"Boundary range scan, truth {NEAR_M} to {FAR_M} m", (*heads, "not judged"), rows)
    empty = Things()
    bare = cluttered_shots(np.random.default_rng(3), worlds, 10, obstacles=False)
    for shot, view in views(bare):
        empty.pictures += 1
        empty.false += len(false_alarms(shot, view))
    heads = ("pictures", "obstacles", "found", "false in 100", "foot cm", "centre cm", "NEES 3 σ")
    machine.table(
        f"Obstacles of 5 to 30 cm within {REACH_M} m; errors at 0.7 to 1.3 m, median / 95 %",
        heads,
        [things.row("clutter")],
    )
    machine.note(
        f"rooms with furniture, without obstacles: {empty.false} false in {empty.pictures} pictures"
    )


def _office(name: str, worlds: int, rng: np.random.Generator | None) -> tuple[str, ...]:
    """Return the line of the office, seen as `views` says."""
    scans, trust = Beams(), 0
    for shot, view in views(office_shots(np.random.default_rng(1), worlds, 10), rng):
        scans.add(shot, view)
        trust += view.trusted
    return scans.row(f"{name}, {10 * worlds}, {trust} trusted")


def views(
    shots: Iterable[Shot], rng: np.random.Generator | None = None
) -> Iterable[tuple[Shot, GroundView]]:
    """Yield each picture with what a camera that sees it first says.

    By the true mount; with `rng`, each by another with errors.
    """
    exact = GroundCamera(geometry(), GroundCameraConfig())
    for number, shot in enumerate(shots):
        camera = exact if rng is None else _calibrated(rng)
        camera.reset()
        yield shot, camera.step(shot.picture, number)


def _calibrated(rng: np.random.Generator) -> GroundCamera:
    """Return the camera as it is calibrated once, with its standard deviations, and pitched.

    Eight markers spread to 2 m, 0.5 px and 1 mm of noise; the lens is known.
    """
    true, noise = geometry(), PointNoise(0.5, 0.001)
    places = spread(2.0)
    seen = true.project_ground(places) + noise.sigma_px * rng.normal(size=places.shape)
    told = places + noise.sigma_m * rng.normal(size=places.shape)
    fit = fit_mount(true.intrinsics, told, seen, rng, noise)
    config = GroundCameraConfig(
        calibration_sigma_deg=fit.sigma["pitch_deg"],
        height_sigma=fit.sigma["z_m"] / fit.mount.z_m,
    )
    pitch_deg = fit.mount.pitch_deg + config.pitch_sigma_deg * rng.normal()
    mount = dataclasses.replace(fit.mount, pitch_deg=pitch_deg)
    return GroundCamera(CameraGeometry(fit.intrinsics, mount), config)


def _between(errors: list[tuple[float, float]]) -> NDArray[np.float64]:
    """Return the errors of what stands about 1 m away."""
    near = [abs(error) for distance, error in errors if 0.7 <= distance <= 1.3]
    return np.array(near or [np.nan])


def _stands_free(shot: Shot, number: int) -> bool:
    """Tell whether nothing else is near a thing."""
    mine = shot.sides[shot.owner == number]
    others = shot.sides[shot.owner != number]
    corners = mine[:, :2]
    return bool(_to_sides(corners, others).min() > _STANDS_FREE_M) and bool(
        _to_sides(others.reshape(-1, 2), mine).min() > _STANDS_FREE_M
    )


def _gap(shot: Shot, obstacle: GroundObstacle, thing: Thing) -> float:
    """Return how far the foot of what was found is from a thing [m]."""
    corners = shot.in_base(thing.corners)
    sides = np.hstack([corners, np.roll(corners, -1, axis=0)])
    return float(_to_sides(obstacle.foot_base[None], sides).min())


def _foot_error(shot: Shot, view: GroundView, obstacle: GroundObstacle, number: int) -> float:
    """Return how far a foot is from the nearest side at the true middle bearing [m]."""
    foot = np.array([view.scan.x_m, view.scan.y_m])
    offset = shot.in_base(shot.world.things[number].corners) - foot
    angles = np.arctan2(offset[:, 1], offset[:, 0])
    bearing = np.array([(angles.min() + angles.max()) / 2])
    truth, _ = shot.ranges(*foot, bearing)
    place = foot + truth[0] * np.array([math.cos(bearing[0]), math.sin(bearing[0])])
    return float(np.hypot(*(obstacle.foot_base - place)))


def _to_sides(points: NDArray[np.float64], sides: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distances of points from sides, (n, m) [m]."""
    a, along = sides[:, :2], sides[:, 2:] - sides[:, :2]
    t = np.sum((points[:, None] - a) * along, axis=2) / np.sum(along**2, axis=1)
    nearest = a + np.clip(t, 0.0, 1.0)[..., None] * along
    distances: NDArray[np.float64] = np.linalg.norm(points[:, None] - nearest, axis=2)
    return distances
