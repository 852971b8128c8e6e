"""Score of the localiser: its estimates against the truth."""

from __future__ import annotations

import math
import statistics
from collections import defaultdict
from typing import Final, NamedTuple

import numpy as np

from robotctl.app.scoring.score import (
    LocalisationReport,
    PoseScore,
    SlamReport,
    StampedPose,
    TruthMatcher,
)
from robotctl.app.scoring.slam_score import SlamScore
from robotctl.estimation.kalman.chi_squared import chi2_bounds
from robotctl.estimation.kalman.consistency import pose_nees, share_inside
from robotctl.estimation.localisers import localiser_kind
from robotctl.messages.estimation import LocalisationState
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.pose_estimate import PoseEstimate, from_upper_triangle

_RIGHT_M: Final = 0.5
_RIGHT_RAD: Final = 0.5
_LONGEST_NS: Final = 200_000_000
"""A longer gap between two estimates does not count for the localiser [ns]."""


class _Estimate(NamedTuple):
    """Data of an estimated pose."""

    state: LocalisationState
    odometry: StampedPose


class LocalisationScore:
    """Compares the localiser's estimates with the truth of their time."""

    def __init__(self) -> None:
        self._matcher: TruthMatcher[_Estimate] = TruthMatcher()
        self._error = PoseScore()
        self._odometry = PoseScore()
        self._nees: list[float] = []
        self._nis: list[tuple[float, int]] = []
        self._steps_us: list[float] = []
        self._method = ""
        self._first_ns: int | None = None
        self._right_ns: int | None = None
        self._slam: SlamScore | None = SlamScore()
        self._last_ns = 0
        self._said_ns = self._since_ns = self._wrong_ns = 0

    def truth(self, pose: StampedPose) -> None:
        """Add a true pose; they must come in the order of their stamps."""
        if self._slam is not None:
            self._slam.truth(pose)
        for estimate, what, truth in self._matcher.truth(pose):
            self._add(estimate, what, truth)

    def estimate(self, pose: StampedPose, state: LocalisationState, odometry: StampedPose) -> None:
        """Add an estimate: the pose in `world`, what was said of it, and the odometry's pose."""
        if not localiser_kind(state.method).makes_map:
            self._slam = None  # it keeps all true poses
        if self._slam is not None:
            self._slam.hear(state.loops, state.verdict)
        for estimate, what, truth in self._matcher.pose(pose, _Estimate(state, odometry)):
            self._add(estimate, what, truth)

    def _add(self, estimate: StampedPose, what: _Estimate, truth: StampedPose) -> None:
        """Score one estimate."""
        state, now_ns = what.state, estimate.stamp_ns
        self._method = state.method
        if self._first_ns is None:
            self._first_ns = self._last_ns = now_ns
        passed_ns = min(now_ns - self._last_ns, _LONGEST_NS)
        self._last_ns = now_ns
        self._odometry.add(what.odometry, truth)
        self._steps_us.append(state.step_us)
        turned_rad = wrap_angle(estimate.theta_rad - truth.theta_rad)
        right = estimate.distance_m(truth) <= _RIGHT_M and abs(turned_rad) <= _RIGHT_RAD
        said = state.status is LocalisationStatus.LOCALISED
        if said and right and self._right_ns is None:
            self._right_ns, passed_ns = now_ns, 0
        if said and not right:
            self._wrong_ns += passed_ns
        if self._right_ns is None:
            return
        self._since_ns += passed_ns
        if not math.isnan(state.nis):
            self._nis.append((state.nis, state.nis_dof))
        if said:
            self._said_ns += passed_ns
            self._error.add(estimate, truth)
            if self._slam is not None:
                self._slam.estimate(estimate.pose, truth.pose)
            covariance = from_upper_triangle(state.covariance)
            believed = PoseEstimate(now_ns, estimate.pose, covariance, state.status)
            self._nees.append(pose_nees(believed, truth.pose))

    def slam(self) -> SlamReport | None:
        """Return the score of a drive by SLAM; None without."""
        return None if self._slam is None else self._slam.result()

    def result(self) -> LocalisationReport | None:
        """Return the score so far; None if there was no localiser."""
        if self._first_ns is None:
            return None
        found = None if self._right_ns is None else (self._right_ns - self._first_ns) * 1e-9
        return LocalisationReport(
            method=self._method,
            localised_after_s=found,
            localised_share=self._said_ns / self._since_ns if self._since_ns else 0.0,
            wrong_s=self._wrong_ns * 1e-9,
            error=self._error.result(),
            nees_inside_95=_inside([(value, 3) for value in self._nees]),
            nis_inside_95=_inside(self._nis),
            nees_above_95=_above(self._nees),
            odometry_rmse_m=self._odometry.result().rmse_m,
            step_ms=statistics.median(self._steps_us) / 1000.0,
        )


def _above(nees: list[float]) -> float | None:
    """Return the share of NEES of poses above the upper of the two-sided 95 % bounds."""
    if not nees:
        return None
    return float(np.mean(np.array(nees) > chi2_bounds(3, 0.95)[1]))


def _inside(values: list[tuple[float, int]]) -> float | None:
    """Return the share of values inside the two-sided 95 % bounds of χ² with their freedoms."""
    if not values:
        return None
    by_dof: dict[int, list[float]] = defaultdict(list)
    for value, dof in values:
        by_dof[dof].append(value)
    inside = [share_inside(np.array(each), dof) * len(each) for dof, each in by_dof.items()]
    return sum(inside) / len(values)
