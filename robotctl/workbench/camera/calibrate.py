"""`robotctl camera calibrate`: the lens from a board, the mount from places on the floor.

Targets on the floor may be a board or markers at measured places, points clicked in a picture, or
several of these: all points go into one fit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robotctl.config.robot_file import RobotConfig, load_robot
from robotctl.errors import CalibrationError, ConfigError
from robotctl.estimation.camera.calibration.intrinsics import LensFit
from robotctl.estimation.camera.calibration.mount import MountFit, fit_mount
from robotctl.estimation.camera.calibration.pattern import larger_board
from robotctl.estimation.camera.calibration.spread import (
    Advice,
    Expected,
    expected_errors,
    recommend,
)
from robotctl.model.sensors.camera import CameraIntrinsics
from robotctl.workbench.camera.correspondences import (
    FloorPoints,
    board_seen,
    clicked_points,
    markers_seen,
    markers_unseen,
)
from robotctl.workbench.camera.lens import Progress, lens_of_pictures
from robotctl.workbench.camera.options import CameraCalibrateOptions
from robotctl.workbench.camera.pictures import check_size, pictures_of, read_picture

_FEW, _MANY = 2, 20


@dataclass(frozen=True, slots=True)
class CameraCalibrateResult:
    """All that a calibration brought.

    Parameters
    ----------
    options, config
        The options, and the robot before.
    picture
        Of the floor; None: there is none.
    lens
        The lens; None: not calibrated.
    points
        Data of the mount; empty if it was not calibrated.
    fit
        The mount; None: not calibrated.
    expected
        Expected errors at several distances.
    advice
        Which markers would help; None: none are needed.
    notes
        Sentences for people.
    """

    options: CameraCalibrateOptions
    config: RobotConfig
    picture: NDArray[np.uint8] | None
    lens: LensFit | None
    points: FloorPoints
    fit: MountFit | None
    expected: tuple[Expected, ...]
    advice: Advice | None
    notes: tuple[str, ...]


def calibrate_camera(options: CameraCalibrateOptions, progress: Progress) -> CameraCalibrateResult:
    """Find lens and mount, as far as there is something to find them from.

    Raises
    ------
    ConfigError
        If a file is wrong.
    CalibrationError
        If the data do not determine the result; says why.
    OSError
        If a file cannot be read.
    """
    config = load_robot(options.robot, options.overrides)
    # Read once: each look at a live camera is another picture.
    picture = None if options.floor is None else read_picture(options.floor)
    lens: LensFit | None = None
    notes: list[str] = []
    if options.lens:
        lens, notes = lens_of_pictures(pictures_of(options.lens), options.chessboard, progress)
    points, fit = FloorPoints.none(), None
    if options.floor is not None or options.points is not None:
        intrinsics, known, remarks = _intrinsics(options, config, lens, picture)
        progress("finding the points on the floor")
        fixed, boards = _floor_points(options, intrinsics, picture)
        progress("fitting the mount")
        points, fit = _fitted(options, config, intrinsics, fixed, boards, known=known)
        notes += remarks + _about(options, fit, points, picture)
    expected = () if fit is None else expected_errors(fit, options.noise.sigma_px)
    advice = None if fit is None else recommend(fit, options.noise)
    return CameraCalibrateResult(
        options, config, picture, lens, points, fit, expected, advice, tuple(notes)
    )


def _intrinsics(
    options: CameraCalibrateOptions,
    config: RobotConfig,
    lens: LensFit | None,
    picture: NDArray[np.uint8] | None,
) -> tuple[CameraIntrinsics, bool, list[str]]:
    """Return the lens to use for the mount, whether it is known, and notes."""
    if lens is not None:
        return lens.intrinsics, True, []
    if config.camera is not None and not options.lens_unknown:
        return config.camera.intrinsics, True, [f"the lens is that of {options.robot.name}"]
    assumed = (
        "without a calibrated lens: pixels are assumed square, the optical axis centred, and the "
        "lens free of distortion; --lens finds the true values"
    )
    if picture is not None:
        height, width = picture.shape[:2]
    elif config.camera is not None:
        lens_then = config.camera.intrinsics
        width, height = lens_then.width_px, lens_then.height_px
    else:
        raise ConfigError(
            f"{options.robot}: no table [camera], so the size of the picture is not known: give "
            "--floor PICTURE or --lens PICTURES"
        )
    return CameraIntrinsics(width, height, 1.0, 1.0, 0.0, 0.0), False, [assumed]


def _floor_points(
    options: CameraCalibrateOptions, lens: CameraIntrinsics, picture: NDArray[np.uint8] | None
) -> tuple[FloorPoints, list[FloorPoints]]:
    """Return points that are certain, and those of the board in each order it could lie."""
    fixed, boards = FloorPoints.none(), []
    if options.points is not None:
        fixed = fixed.joined(clicked_points(options.points))
    if picture is not None and options.floor is not None:
        check_size(picture, options.floor, lens)
        if options.markers is not None:
            fixed = fixed.joined(markers_seen(picture, options.markers, options.family))
        if options.at is not None:
            boards = board_seen(picture, options.floor, options.chessboard, options.at)
    return fixed, boards


def _fitted(
    options: CameraCalibrateOptions,
    config: RobotConfig,
    lens: CameraIntrinsics,
    fixed: FloorPoints,
    boards: Sequence[FloorPoints],
    *,
    known: bool,
) -> tuple[FloorPoints, MountFit]:
    """Fit the mount; of the possible poses of a board, that which agrees with the rest."""
    variants = [fixed.joined(board) for board in boards] or [fixed]
    fits, reasons = [], []
    for points in variants:
        rng = np.random.default_rng(options.seed)
        try:
            fit = fit_mount(
                lens, points.ground, points.pixels, rng, options.noise, lens_known=known
            )
        except ValueError as error:
            reasons.append(str(error))
        else:
            fits.append((points, fit))
    if not fits:
        raise CalibrationError(reasons[0])
    nominal_deg = 0.0 if config.camera is None else config.camera.mount.yaw_deg

    def doubt(variant: tuple[FloorPoints, MountFit]) -> tuple[int, float]:
        """Count points that disagree, then the angle to the expected direction of the camera."""
        fit = variant[1]
        turned = math.remainder(fit.mount.yaw_deg - nominal_deg, 360.0)
        return int(np.sum(~fit.agree)), abs(turned)

    return min(fits, key=doubt)


def _about(
    options: CameraCalibrateOptions,
    fit: MountFit,
    points: FloorPoints,
    picture: NDArray[np.uint8] | None,
) -> list[str]:
    """Return remarks on a fit."""
    notes = []
    if abs(fit.mount.roll_deg) > 90.0:
        notes.append(
            f"by this the camera is upside down (roll {fit.mount.roll_deg:.0f} degrees): if it is "
            "not, the picture was turned; give it as the camera saved it"
        )
    if options.markers is not None:
        unseen = markers_unseen(options.markers, points)
        if unseen:
            notes.append(
                f"not seen: {', '.join(unseen)}; far ones may be too flat in the picture to be "
                "read: click their middles instead (--points)"
            )
    noise = options.noise
    if fit.degrees > 0 and fit.chi2 > 2.0 * fit.degrees:
        factor = math.sqrt(fit.chi2 / fit.degrees)
        notes.append(
            f"the points fit {factor:.1f} times worse than {noise.sigma_px:g} px and "
            f"{1e3 * noise.sigma_m:g} mm allow: are places, board and lens right? The intervals "
            "are wider by that factor"
        )
    if fit.degrees >= _MANY and fit.chi2 < 0.25 * fit.degrees:
        notes.append(
            f"the points fit {math.sqrt(fit.degrees / fit.chi2):.1f} times better than "
            f"{noise.sigma_px:g} px and {1e3 * noise.sigma_m:g} mm allow; smaller --sigma-px and "
            "--sigma-mm would give narrower intervals"
        )
    if fit.degrees <= _FEW:
        notes.append("so few points hardly check each other: measure some more")
    if options.at is not None and picture is not None:
        board = options.chessboard
        larger = larger_board(picture, board)
        if larger is not None:
            notes.append(
                f"the board seems to have {larger.columns} x {larger.rows} inner corners, not "
                f"{board.columns} x {board.rows}: count them, or its middle is wrong"
            )
        notes.append("an error of --at shifts all places on the floor")
    return notes
