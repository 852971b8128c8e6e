"""Error of an estimated trajectory against a reference: the report of `robotctl localise`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.kalman.consistency import pose_nees, share_inside
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.pose_estimate import PoseEstimate
from robotctl.model.geometry.se2 import SE2

LOST_M: Final = 1.0
WRONG_RAD: Final = math.radians(30.0)
"""Error against the reference [m], and in heading, beyond which the place is unknown."""

_END_SHARE: Final = 0.1
_ONLINE: Final = ("ape", "heading_rmse_rad", "shares", "nees_inside_95")


@dataclass(slots=True)
class Run:
    """The run of an estimator on a recording.

    Parameters
    ----------
    estimates
        At each processed scan, or at each step of a landmark filter.
    references
        `base` in `world` at the same times; None if it is not known.
    online
        Estimates of the same times as the filter had them then, where `estimates` know all that
        was measured; empty where the two are one.
    has_heading
        Whether the references have a heading.
    starts_known
        Whether the place was known at the start, so that errors count from there.
    notes
        Notes for the user.
    update_ms
        Processor time of each update [ms].
    particles
        Their number at each update.
    echo_shares
        Of each estimate, which share of its scan's echoes has an obstacle of the map where it
        ends; None if there was no scan.
    """

    estimates: list[PoseEstimate] = field(default_factory=list)
    references: list[SE2 | None] = field(default_factory=list)
    online: list[PoseEstimate] = field(default_factory=list)
    has_heading: bool = True
    starts_known: bool = True
    notes: list[str] = field(default_factory=list)
    update_ms: list[float] = field(default_factory=list)
    particles: list[int] = field(default_factory=list)
    echo_shares: list[float | None] = field(default_factory=list)

    def add(
        self, estimate: PoseEstimate, reference: SE2 | None, echo_share: float | None = None
    ) -> None:
        """Add an estimate."""
        self.estimates.append(estimate)
        self.references.append(reference)
        self.echo_shares.append(echo_share)


def position_errors(run: Run) -> NDArray[np.float64]:
    """Return the distance of each estimate from the reference, (n,) [m]; nan if unknown."""
    return np.array(
        [
            math.nan
            if reference is None
            else math.hypot(estimate.pose.x_m - reference.x_m, estimate.pose.y_m - reference.y_m)
            for estimate, reference in zip(run.estimates, run.references, strict=True)
        ]
    )


def report(run: Run, with_nees: bool) -> dict[str, Any]:
    """Return the report; unknown values are None.

    Errors count from the beginning where the start was known, else from the first estimate on that
    is said to be localised (of a run that never is, from the beginning too). They are differences
    to the reference as it is, without any alignment.
    """
    first = _first_localised(run)
    begin = 0 if run.starts_known else first or 0
    errors_m = position_errors(run)[begin:]
    known_m = errors_m[~np.isnan(errors_m)]
    result: dict[str, Any] = {
        "ape": {
            "rmse_m": math.sqrt(np.mean(known_m**2)) if len(known_m) else None,
            "mean_m": float(np.mean(known_m)) if len(known_m) else None,
            "max_m": float(np.max(known_m)) if len(known_m) else None,
        },
        "heading_rmse_rad": _heading_rmse(run, begin),
        "lost": is_lost(run),
        "shares": shares(run),
        "echoes_on_map": _echoes_on_map(run),
        "updates": len(run.update_ms),
        "update_ms": dict(zip(("p50", "p99"), _percentiles(run.update_ms), strict=True)),
        "particles": {"mean": float(np.mean(run.particles)) if run.particles else 0.0},
        "localised_after_s": None
        if first is None
        else 1e-9 * (run.estimates[first].stamp_ns - run.estimates[0].stamp_ns),
    }
    if with_nees:
        result["nees_inside_95"] = _nees_inside(run)
    if run.online:
        then = report(replace(run, estimates=run.online, online=[]), with_nees)
        result["online"] = {key: then[key] for key in _ONLINE if key in then}
    return result


def is_wrong(estimate: PoseEstimate, reference: SE2, *, has_heading: bool) -> bool:
    """Return whether an estimate that claims to be localised is at another place."""
    pose = estimate.pose
    away_m = math.hypot(pose.x_m - reference.x_m, pose.y_m - reference.y_m)
    turned = math.remainder(pose.theta_rad - reference.theta_rad, math.tau)
    return estimate.status is LocalisationStatus.LOCALISED and (
        away_m > LOST_M or (has_heading and abs(turned) > WRONG_RAD)
    )


def shares(run: Run) -> dict[str, float | None]:
    """Return the share of the estimates with each status, and of those confidently wrong.

    The last is of those that have a reference; None if none has.
    """
    count = max(len(run.estimates), 1)
    found: dict[str, float | None] = {
        status.name.lower(): sum(each.status is status for each in run.estimates) / count
        for status in LocalisationStatus
    }
    wrong = [
        is_wrong(estimate, reference, has_heading=run.has_heading)
        for estimate, reference in zip(run.estimates, run.references, strict=True)
        if reference is not None
    ]
    return {**found, "confidently_wrong": sum(wrong) / len(wrong) if wrong else None}


def _echoes_on_map(run: Run) -> float | None:
    """Return the mean share of echoes that the map explains, while the robot claims its place."""
    found = [
        share
        for estimate, share in zip(run.estimates, run.echo_shares, strict=True)
        if share is not None and estimate.status is LocalisationStatus.LOCALISED
    ]
    return float(np.mean(found)) if found else None


def is_lost(run: Run) -> bool:
    """Return whether the run ended without knowing the place.

    That is: its last estimate says so, or none ever said that it is localised, or over the last
    tenth of the estimates the median distance from the reference is more than `LOST_M`.
    """
    if not run.estimates or _first_localised(run) is None:
        return True
    if run.estimates[-1].status is LocalisationStatus.LOST:
        return True
    errors_m = position_errors(run)
    end_m = errors_m[-max(1, math.ceil(_END_SHARE * len(errors_m))) :]
    end_m = end_m[~np.isnan(end_m)]
    return bool(len(end_m) and np.median(end_m) > LOST_M)


def _first_localised(run: Run) -> int | None:
    """Return the index of the first estimate with status LOCALISED."""
    return next(
        (
            index
            for index, estimate in enumerate(run.estimates)
            if estimate.status is LocalisationStatus.LOCALISED
        ),
        None,
    )


def _heading_rmse(run: Run, begin: int) -> float | None:
    """Return the root mean square of the heading's error from an index on [rad]."""
    if not run.has_heading:
        return None
    off = [
        math.remainder(estimate.pose.theta_rad - reference.theta_rad, math.tau)
        for estimate, reference in zip(run.estimates[begin:], run.references[begin:], strict=True)
        if reference is not None
    ]
    return math.sqrt(sum(value * value for value in off) / len(off)) if off else None


def _percentiles(values: Sequence[float]) -> tuple[float | None, float | None]:
    """Return median and 99th percentile."""
    if not values:
        return None, None
    middle, high = np.percentile(np.array(values), (50.0, 99.0)).tolist()
    return middle, high


def _nees_inside(run: Run) -> float | None:
    """Return the share of estimates with a NEES inside the two-sided 95 % bounds."""
    if not run.has_heading:
        return None
    nees = [
        pose_nees(estimate, reference)
        for estimate, reference in zip(run.estimates, run.references, strict=True)
        if reference is not None
    ]
    return share_inside(np.array(nees), dof=3) if nees else None
