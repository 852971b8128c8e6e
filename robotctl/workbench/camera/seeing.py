"""`robotctl camera ranges` and `obstacles`: pictures in, what they say of the floor out."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from robotctl.config.robot_file import camera_of, load_robot
from robotctl.errors import ConfigError
from robotctl.estimation.camera.ground import GroundCamera, GroundView
from robotctl.estimation.camera.obstacles import GroundObstacle
from robotctl.model.sensors.camera_geometry import CameraGeometry
from robotctl.workbench.camera.options import SeeingOptions
from robotctl.workbench.camera.pictures import pictures_of, read_picture_of

RANGE_KEYS: Final = ("picture", "angle_deg", "range_m", "sigma_m", "x_m", "y_m", "seen")
OBSTACLE_KEYS: Final = (
    "picture",
    "foot_x_m",
    "foot_y_m",
    "sigma_along_m",
    "sigma_across_m",
    "centre_x_m",
    "centre_y_m",
    "centre_sigma_m",
    "width_m",
    "height_m",
    "cut",
)
_BOUNDARY: Final = (0, 0, 255)
_BOX: Final = (0, 230, 0)
_PATCH: Final = (255, 200, 0)
_NOT_TRUSTED: Final = (0, 165, 255)


@dataclass(frozen=True, slots=True, eq=False)
class SeenPicture:
    """One picture and its result."""

    name: str
    picture: NDArray[np.uint8]
    view: GroundView


class Seeing:
    """Looks at pictures of one robot's camera.

    Parameters
    ----------
    options
        The pictures.

    Raises
    ------
    ConfigError
        If the robot's file is wrong, has no camera, or one that sees too little of the floor.
    """

    def __init__(self, options: SeeingOptions) -> None:
        config = load_robot(options.robot, options.overrides)
        camera = camera_of(config, options.robot)
        self._options = options
        self.files = pictures_of(options.pictures, "")
        self._intrinsics = camera.intrinsics
        self.geometry = CameraGeometry.of(camera)
        try:
            self._camera = GroundCamera(self.geometry, config.ground_camera)
        except ValueError as error:
            raise ConfigError(f"{options.robot}: camera: {error}") from error

    def look(self) -> Iterator[SeenPicture]:
        """Yield each picture with its result.

        Raises
        ------
        ConfigError
            If a file is no picture, or not of the calibrated size.
        OSError
            If a file cannot be read.
        """
        for number, path in enumerate(self.files):
            picture = read_picture_of(path, self._intrinsics)
            if not self._options.sequence:
                self._camera.reset()
            yield SeenPicture(path.name, picture, self._camera.step(picture, number))

    def annotated(self, seen: SeenPicture) -> NDArray[np.uint8]:
        """Return a picture with the free patch, the floor's boundary and the obstacles drawn."""
        image = seen.picture.copy()
        outline = self._pixels(self._camera.strip.patch_outline_base())
        cv2.polylines(image, [outline], True, _PATCH, 1, cv2.LINE_AA)
        points = self._pixels(seen.view.scan.points_base())
        for u, v in points:
            cv2.circle(image, (int(u), int(v)), 3, _BOUNDARY, -1, cv2.LINE_AA)
        for obstacle in seen.view.obstacles:
            self._draw(image, obstacle)
        if seen.view.why:
            words = f"not trusted: {seen.view.why}"
            _write(image, words, (8, 20), _NOT_TRUSTED)
        return image

    def _draw(self, image: NDArray[np.uint8], obstacle: GroundObstacle) -> None:
        """Draw the foot of an obstacle as a line, its upper edge, and its distance."""
        eye = self.geometry.t_base_camera
        along = obstacle.foot_base - eye[:2]
        across = np.array([-along[1], along[0]]) / np.hypot(*along) * obstacle.width_m / 2
        high = min(obstacle.height_m, 0.95 * eye[2])
        corners = [
            np.append(obstacle.foot_base + side * across, z)
            for side, z in ((1, 0.0), (1, high), (-1, high), (-1, 0.0))
        ]
        pixels = self.geometry.project(np.array(corners))
        if np.isnan(pixels).any():
            return
        whole = np.rint(pixels).astype(np.int32)
        cv2.polylines(image, [whole], True, _BOX, 2, cv2.LINE_AA)
        words = f"{np.hypot(*along):.2f} m, {100 * obstacle.width_m:.0f} cm"
        place = (max(2, int(whole[:, 0].min())), int(whole[:, 1].max()) + 14)
        _write(image, words, place, _BOX)

    def _pixels(self, ground: NDArray[np.float64]) -> NDArray[np.int32]:
        """Return the pixels of points of the floor that the lens shows, (k, 2)."""
        pixels = self.geometry.project_ground(ground)
        return np.rint(pixels[~np.isnan(pixels).any(axis=1)]).astype(np.int32)


def _write(
    image: NDArray[np.uint8], words: str, place: tuple[int, int], colour: tuple[int, int, int]
) -> None:
    """Write text that is readable on any background."""
    (width, height), below = cv2.getTextSize(words, cv2.FONT_HERSHEY_SIMPLEX, 0.45, 1)
    u, v = place
    cv2.rectangle(image, (u - 2, v - height - 2), (u + width + 2, v + below), (0, 0, 0), -1)
    cv2.putText(image, words, place, cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA)


def range_rows(seen: SeenPicture) -> list[dict[str, Any]]:
    """Return the beams of a picture, one row each with the keys `RANGE_KEYS`; None: no number."""
    scan = seen.view.scan
    sigmas = np.full(len(scan.ranges_m), np.nan) if scan.sigmas_m is None else scan.sigmas_m
    rows = []
    for angle, range_m, sigma in zip(scan.angles_rad, scan.ranges_m, sigmas, strict=True):
        place = (scan.x_m + range_m * math.cos(angle), scan.y_m + range_m * math.sin(angle))
        kind = "free" if math.isinf(range_m) else "nothing" if math.isnan(range_m) else "boundary"
        values = (math.degrees(angle), range_m, sigma, *place)
        rows.append(dict(zip(RANGE_KEYS, (seen.name, *map(_number, values), kind), strict=True)))
    return rows


def obstacle_rows(seen: SeenPicture) -> list[dict[str, Any]]:
    """Return the obstacles of a picture, one row each with the keys `OBSTACLE_KEYS`."""
    rows = []
    for obstacle in seen.view.obstacles:
        offset = obstacle.foot_base - [seen.view.scan.x_m, seen.view.scan.y_m]
        along = offset / np.hypot(*offset)
        across = np.array([-along[1], along[0]])
        values = (
            *obstacle.foot_base,
            math.sqrt(along @ obstacle.foot_covariance @ along),
            math.sqrt(across @ obstacle.foot_covariance @ across),
            *obstacle.centre_base,
            math.sqrt(np.trace(obstacle.centre_covariance)),
            obstacle.width_m,
            obstacle.height_m,
        )
        cells = (seen.name, *map(_number, values), obstacle.cut)
        rows.append(dict(zip(OBSTACLE_KEYS, cells, strict=True)))
    return rows


def write_rows(path: Path, keys: Sequence[str], rows: Sequence[dict[str, Any]]) -> None:
    """Write rows as CSV, empty if there is no number."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, keys)
        writer.writeheader()
        writer.writerows(rows)


def write_report(path: Path, name: str, entries: Sequence[dict[str, Any]]) -> None:
    """Write one entry for each picture as JSON; `name` of the list of rows in it."""
    text = json.dumps({"kind": name, "pictures": list(entries)}, indent=1, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def report_entry(seen: SeenPicture, name: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the entry of a picture in the report."""
    bare = [{key: value for key, value in row.items() if key != "picture"} for row in rows]
    return {
        "picture": seen.name,
        "trusted": seen.view.trusted,
        "why": seen.view.why,
        name: bare,
    }


def _number(value: float) -> float | None:
    """Return a number to a tenth of a millimetre; None if it is nan or infinite."""
    return round(float(value), 4) if math.isfinite(value) else None
