"""The lens from pictures of a chessboard."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.errors import CalibrationError, ConfigError
from robotctl.estimation.camera.calibration.intrinsics import (
    LensFit,
    TurnedPicturesError,
    calibrate_lens,
)
from robotctl.estimation.camera.calibration.pattern import Board, find_corners
from robotctl.model.sensors.camera import CameraIntrinsics
from robotctl.model.sensors.camera_lens import straightened
from robotctl.workbench.camera.pictures import read_picture, tagged_to_turn, turned_hint

Progress: TypeAlias = Callable[[str], None]


def lens_of_pictures(
    paths: Sequence[Path], board: Board, progress: Progress
) -> tuple[LensFit, list[str]]:
    """Calibrate the lens; return it and sentences for people.

    Raises
    ------
    ConfigError
        If a file is no picture, or one has another size.
    CalibrationError
        If the pictures do not determine the lens.
    OSError
        If a file cannot be read.
    """
    boards, (height, width) = _boards_of(paths, board, progress)
    found = list(boards.values())
    seen, without = list(boards), [path.name for path in paths if path not in boards]
    notes = []
    if without:
        notes.append(
            f"no board of {board.columns} x {board.rows} inner corners in {', '.join(without)}"
        )
    if tagged := tagged_to_turn(paths):
        notes.append(
            f"the EXIF orientation of {', '.join(path.name for path in tagged)} is ignored: "
            "pictures are used as the sensor took them"
        )
    progress("fitting the lens")
    try:
        lens = calibrate_lens(found, board, width, height)
    except TurnedPicturesError as error:
        names = ", ".join(seen[number].name for number in error.numbers)
        raise CalibrationError(
            f"{names}: turned by half a turn against the other pictures; give all of them as the "
            "camera saved them"
        ) from error
    except ValueError as error:
        raise CalibrationError("; ".join([str(error), *notes])) from error
    if not _invertible(lens.intrinsics):
        notes.append(
            "the distortion found folds back within the picture: pixels there have no place on the "
            "floor. Take pictures with the board in the corners too"
        )
    out = [path.name for path, rms in zip(seen, lens.rms_px, strict=True) if math.isnan(rms)]
    if out:
        notes.append(f"left out because they fit much worse than the others: {', '.join(out)}")
    return lens, notes


def _boards_of(
    paths: Sequence[Path], board: Board, progress: Progress
) -> tuple[dict[Path, NDArray[np.float64]], tuple[int, int]]:
    """Return the corners found, by picture, and height and width of all; raises `ConfigError`."""
    found = {}
    sizes: dict[tuple[int, int], Path] = {}
    for path in paths:
        progress(f"looking for the board in {path.name}")
        picture = read_picture(path)
        sizes.setdefault((picture.shape[0], picture.shape[1]), path)
        if len(sizes) > 1:
            (first, other) = (f"{file}: {w} x {h}" for (h, w), file in sizes.items())
            raise ConfigError(
                f"pictures of one lens have one size, not {first} and {other}{turned_hint(*sizes)}"
            )
        corners = find_corners(picture, board)
        if corners is not None:
            found[path] = corners
    (size,) = sizes
    return found, size


def _invertible(lens: CameraIntrinsics) -> bool:
    """Return whether each pixel at the edge of the picture has a direction."""
    u, v = np.arange(0.0, lens.width_px, 8.0), np.arange(0.0, lens.height_px, 8.0)
    edge = np.vstack(
        [np.column_stack([u, np.full(len(u), row)]) for row in (0.0, lens.height_px - 1.0)]
        + [np.column_stack([np.full(len(v), column), v]) for column in (0.0, lens.width_px - 1.0)]
    )
    return bool(np.isfinite(straightened(edge, lens)).all())
