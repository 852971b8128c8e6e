"""One verdict on a map: good, doubtful, or not a map, with the reasons."""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from robotctl.estimation.slam.verdict.odometry_check import OdometryFigures
from robotctl.estimation.slam_tuning import VerdictConfig

_MIRRORED: Final = -0.3
"""Ratio of turns by odometry and by scans below which one of them is mirrored."""


class Quality(enum.StrEnum):
    """How good a map is, as far as the run itself shows."""

    GOOD = "good"
    DOUBTFUL = "doubtful"
    NOT_A_MAP = "not a map"


@dataclass(frozen=True, slots=True)
class Verdict:
    """How good a map is, and why it is no better."""

    quality: Quality
    reasons: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Return it as a sentence."""
        return f"{self.quality} because {'; '.join(self.reasons)}" if self.reasons else self.quality


@dataclass(frozen=True, slots=True)
class RunFigures:
    """Figures of a run, from which the verdict follows.

    Parameters
    ----------
    scans, unmatched, ambiguous
        Number of scans, of those that matched nothing, and of those without odometry that fit
        elsewhere nearly as well.
    shifts_m
        Distances by which places passed again fit better elsewhere; 0: they fit where they are [m].
    odometry
        Odometry beside the scans; None: the log has none.
    breaks
        Number of places along the way where scans do not agree with those before.
    contradicted, compared
        Number of places passed again that contradict what was seen there before, of so many that
        were compared.
    """

    scans: int
    unmatched: int
    ambiguous: int
    shifts_m: Sequence[float]
    odometry: OdometryFigures | None
    breaks: int = 0
    contradicted: int = 0
    compared: int = 0


def verdict_of(run: RunFigures, limits: VerdictConfig) -> Verdict:
    """Return the verdict on a run."""
    found = [*_of_scans(run, limits), *_of_places(run, limits)]
    if run.odometry is not None:
        found += _of_odometry(run.odometry, limits)
    if not found:
        return Verdict(Quality.GOOD)
    is_hopeless = any(each.is_hopeless for each in found)
    quality = Quality.NOT_A_MAP if is_hopeless else Quality.DOUBTFUL
    return Verdict(quality, tuple(each.reason for each in found))


class _Finding(NamedTuple):
    reason: str
    is_hopeless: bool = False


def _of_scans(run: RunFigures, limits: VerdictConfig) -> Iterator[_Finding]:
    """Yield what unmatched scans say."""
    share = run.unmatched / max(run.scans, 1)
    if share > (limits.unmatched_blind if run.odometry is None else limits.unmatched):
        reason = f"{run.unmatched} of {run.scans} scans match nothing near"
        yield _Finding(reason, share > limits.hopeless_unmatched)
    if run.ambiguous > limits.ambiguous * run.scans:
        yield _Finding(
            f"{run.ambiguous} of {run.scans} scans fit elsewhere nearly as well, and there was no "
            "odometry to tell"
        )
    if run.breaks:
        times = "once" if run.breaks == 1 else f"at {run.breaks} places"
        yield _Finding(f"{times} the way goes on where no scan agrees with those before it")


def _of_places(run: RunFigures, limits: VerdictConfig) -> Iterator[_Finding]:
    """Yield what places say that were passed more than once."""
    elsewhere = [each for each in run.shifts_m if each > 0.0]
    share = len(elsewhere) / max(len(run.shifts_m), 1)
    if len(elsewhere) >= limits.fewest and share > limits.elsewhere:
        reason = (
            f"{len(elsewhere)} of {len(run.shifts_m)} places passed again fit better up to "
            f"{max(elsewhere):.1f} m away: walls are doubled"
        )
        yield _Finding(reason, share > limits.hopeless_elsewhere)
    is_much = run.contradicted > limits.contradicted_places * run.compared
    if run.contradicted >= limits.fewest and is_much:
        yield _Finding(
            f"{run.contradicted} of {run.compared} places passed again contradict what was seen "
            "there before"
        )


def _of_odometry(figures: OdometryFigures, limits: VerdictConfig) -> Iterator[_Finding]:
    """Yield what odometry and scans say of each other; a NaN is no finding."""
    if figures.turn_ratio < _MIRRORED:
        reason = (
            "the scans turn against the odometry: the beams are in reverse order, the lidar is "
            "upside down, or left and right wheel are exchanged"
        )
        yield _Finding(reason, is_hopeless=True)
        return
    if abs(figures.yaw_rad) > limits.yaw_rad:
        side = "left" if figures.yaw_rad > 0.0 else "right"
        yield _Finding(
            f"by the scans the robot drives {abs(math.degrees(figures.yaw_rad)):.0f} deg to the "
            f"{side} of where odometry has it: the lidar is mounted another way"
        )
        return
    for name, ratio in (("distance", figures.distance_ratio), ("turning", figures.turn_ratio)):
        if abs(ratio - 1.0) > limits.ratio:
            yield _Finding(f"{name} by odometry is {ratio:.2f} times that by the scans")
    share = figures.contradicted_m / max(figures.compared_m, 1e-9)
    is_much = share > limits.contradicted and figures.contradicted_m >= limits.contradicted_m
    if figures.longest_m >= limits.contradicted_m or is_much:
        yield _Finding(
            f"odometry contradicts the scans on {figures.contradicted_m:.0f} of "
            f"{figures.compared_m:.0f} m, {figures.longest_m:.0f} m of them without a break"
        )
