"""Errors of odometry before and after a calibration, and whether calibrating makes sense."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from robotctl.errors import CalibrationError
from robotctl.estimation.odometry.calibration import Calibration
from robotctl.estimation.odometry.model import REACH, Array, OdometryModel
from robotctl.estimation.odometry.runs import (
    OdometryRun,
    dead_reckoning_error_m,
    end_of,
    poses_at,
)
from robotctl.model.geometry.se2 import SE2

PIECE_M: Final = 10.0
"""Dead reckoning along a log is judged in pieces of this length [m]."""


@dataclass(frozen=True, slots=True)
class Check:
    """An error of odometry as configured and as calibrated [m]."""

    what: str
    before_m: float
    after_m: float


def check_way(run: OdometryRun, model: OdometryModel) -> None:
    """Refuse a nominal drive too far off for a fit."""
    estimated = poses_at(run, model.moves(model.nothing, run.rolled), SE2(), run.reference_s)
    said_m, seen_m = (
        float(np.sum(np.hypot(*np.diff(poses[:, :2], axis=0).T)))
        for poses in (estimated, run.reference)
    )
    if not math.exp(-REACH) < seen_m / max(said_m, 1e-9) < math.exp(REACH):
        raise CalibrationError(
            f"{run.name}: the reference moves {seen_m:.1f} m where odometry says {said_m:.1f} m; a "
            f"factor from {math.exp(-REACH):.2f} to {math.exp(REACH):.2f} is allowed: set [drive] "
            "approximately, wheel_radius_m and counts_per_revolution first"
        )


def mean_gap_m(
    model: OdometryModel, change: Array, runs: Sequence[OdometryRun], shape: str
) -> tuple[float, float]:
    """Return the mean gap between odometry and reference at the ends of drives of a shape [m]."""
    gaps = [_gap_m(model, change, run) for run in runs if run.name.startswith(shape)]
    x_m, y_m = np.mean(gaps, axis=0).tolist()
    return x_m, y_m


def _gap_m(model: OdometryModel, change: Array, run: OdometryRun) -> Array:
    """Return end by reference less end by odometry, (2,) [m]."""
    estimated = end_of(run, model.moves(change, run.rolled))
    return np.asarray(run.reference[-1, :2] - [estimated.x_m, estimated.y_m])


def tape_check(found: Calibration, runs: Sequence[OdometryRun]) -> Check:
    """Return the gaps at the ends of all runs before and after."""
    rms_m = [
        math.sqrt(np.mean([np.sum(_gap_m(found.model, change, run) ** 2) for run in runs]))
        for change in (found.model.nothing, found.change)
    ]
    return Check("these drives: final gap, rms", *rms_m)


def held_out_checks(half: Calibration, held_out: OdometryRun) -> tuple[Check, ...]:
    """Return errors on data that the fit of `half` has not seen."""
    zero, nothing = np.zeros(2), half.model.nothing
    plain_m = _piecewise_rms_m(half.model, nothing, held_out, zero, 0.0)
    same_m = _piecewise_rms_m(half.model, nothing, held_out, half.lever_m, half.delay_s)
    after_m = _piecewise_rms_m(half.model, half.change, held_out, half.lever_m, half.delay_s)
    what = f"second half, in pieces of {PIECE_M:g} m, rms"
    return (
        Check(what, plain_m, after_m),
        Check("the same, lever arm and delay known before too", same_m, after_m),
    )


def _piecewise_rms_m(
    model: OdometryModel, change: Array, run: OdometryRun, lever_m: Array, delay_s: float
) -> float:
    """Return the error of dead reckoning in pieces, each laid onto its reference, rms [m]."""
    distance_m = np.cumsum(model.travel_m(run.rolled))
    pieces = max(1, round(float(distance_m[-1]) / PIECE_M))
    cuts = np.searchsorted(distance_m, np.linspace(0.0, distance_m[-1], pieces + 1)[1:-1])
    times_s = [run.stamps_s[0], *run.stamps_s[1:][cuts], run.stamps_s[-1]]
    errors = []
    for begin_s, end_s in itertools.pairwise(times_s):
        part = run.part(float(begin_s), float(end_s))
        if part is not None:
            moves = model.moves(change, part.rolled)
            errors.append(dead_reckoning_error_m(part, moves, lever_m, delay_s))
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
