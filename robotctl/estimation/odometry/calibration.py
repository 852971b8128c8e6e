"""Calibration of odometry: generalised least squares against references, with honest intervals.

The fit uses the white innovations of `innovations.py`, so that errors that accumulate are weighted
by their correlation. Two steps alternate: least squares over the parameters of the drive (Huber's
loss), and maximum likelihood over the noises e, f, g of odometry and those of the reference, which
set the weights. A change of the drive that the data do not determine is reported and left at 0.

Squares driven in both directions and a straight line follow Borenstein and Feng, "Measurement and
correction of systematic odometry errors in mobile robots", IEEE T-RA 12(6), 1996 (UMBmark); here
all runs are fitted at once instead of by their closed forms.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.odometry.fit import OdometryFit, Reference
from robotctl.estimation.odometry.innovations import OUTLIER
from robotctl.estimation.odometry.model import OdometryModel
from robotctl.estimation.odometry.runs import OdometryRun
from robotctl.model.drives.drives import Drive
from robotctl.model.drives.odometry_noise import MotionNoise

Array: TypeAlias = NDArray[np.float64]

NOT_SEEN = 0.1
"""A change whose interval is wider to one side than this is not identified by the data."""

_ROUNDS = 4

_SMALL = 1e-5
"""Change by which slopes are taken."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A value with its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """Result of a calibration.

    Parameters
    ----------
    model
        The nominal drive.
    change, change_half_width
        Change of the drive, (size,), and half the width of its 95 % interval: nan if the data do
        not show the change, which is then 0.
    covariance
        Of the change, (size, size); 0 if the data do not show it.
    quantile
        Of Student's distribution: half an interval in standard deviations.
    lever_m, lever_half_width_m
        Point of `base` that the reference follows, (2,) [m]; nan if the data do not show it.
    delay_s, delay_half_width_s
        Age of the reference's data [s].
    noise
        e, f and g.
    noise_fold
        The 95 % interval of e, f and g is from value / fold to value * fold, (3,); inf if the
        data do not show it.
    reference
        Noise of the reference.
    outliers, references
        Number of innovations beyond three deviations, and of all references.
    """

    model: OdometryModel
    change: Array
    change_half_width: Array
    covariance: Array
    quantile: float
    lever_m: Array
    lever_half_width_m: Array
    delay_s: float
    delay_half_width_s: float
    noise: MotionNoise
    noise_fold: Array
    reference: Reference
    outliers: int
    references: int

    @property
    def drive(self) -> Drive:
        """The calibrated drive."""
        return self.model.drive(self.change)

    def identified(self, key: str) -> bool:
        """Return whether the data show a key of `[drive]`."""
        return bool(np.isfinite(self.change_half_width[self.model.keys.index(key)]))

    def interval(self, key: str) -> Interval | None:
        """Return the value of a key of `[drive]` with its interval; None: not identified."""
        i = self.model.keys.index(key)
        if not self.identified(key):
            return None
        ends = []
        for side in (0.0, -1.0, 1.0):
            change = self.model.nothing
            change[i] = self.change[i] + side * self.change_half_width[i]
            ends.append(float(getattr(self.model.drive(change), key)))
        return Interval(*ends)

    def wheel_diameters(self) -> tuple[Interval, ...]:
        """Return the diameters of wheels that are calibrated each [m]; empty: they are not."""
        radii_m = np.array(self.drive.wheel_radii_m)
        steps = _SMALL * np.eye(self.model.size)
        slopes = [self._log_radii(step) - self._log_radii(-step) for step in steps]
        by = np.array(slopes).T / (2.0 * _SMALL)
        are_alike = np.allclose(by, by[0], atol=_SMALL)
        if are_alike or not self.identified("wheel_radius_m"):
            return ()
        widths = self.quantile * np.sqrt(np.einsum("ij,jk,ik->i", by, self.covariance, by))
        return tuple(
            Interval(d, d * math.exp(-width), d * math.exp(width))
            for d, width in zip((2.0 * radii_m).tolist(), widths.tolist(), strict=True)
        )

    def _log_radii(self, step: Array) -> Array:
        """Return the logarithms of the wheels' radii for a change a step away."""
        change = np.clip(self.change + step, *self.model.bounds)
        return np.log(self.model.drive(change).wheel_radii_m)


def widened(found: Calibration, parts: Sequence[Calibration]) -> Calibration:
    """Return a calibration whose intervals contain the results of parts of the data.

    If parts differ by more than chance, the model is wrong somewhere: a camera whose scale varies
    with the place, another floor. The intervals of one fit do not include that.
    """
    width = found.change_half_width
    for part in parts:
        apart = np.abs(part.change - found.change)
        shown = np.isfinite(part.change_half_width)
        width = np.where(shown, np.maximum(width, apart), width)
    scale = np.where(np.isfinite(width), width / found.change_half_width, 1.0)
    return dataclasses.replace(
        found,
        change_half_width=width,
        covariance=found.covariance * np.outer(scale, scale),
    )


def calibrate(
    nominal: Drive, runs: Sequence[OdometryRun], reference: Reference, noise: MotionNoise
) -> Calibration:
    """Fit a drive to runs.

    Parameters
    ----------
    nominal
        The drive with which the wheel angles were interpreted so far.
    runs
        At least one; each run of unknown start adds three unknowns.
    reference
        Its prior.
    noise
        Start of the search for the noises.

    Raises
    ------
    ValueError
        If there are too few references for the unknowns, the true drive is outside the search
        range, or the data determine none of its keys.
    """
    fit = OdometryFit(OdometryModel(nominal), runs, reference)
    known = 3 if any(np.isfinite(run.reference[:, 2]).any() for run in runs) else 2
    if known * fit.references <= fit.size:
        raise ValueError(
            f"{fit.references} references are too few to find {fit.size} numbers; drive more"
        )
    while True:
        found, noises = _alternate(fit, noise)
        covariance, quantile = fit.covariance(found, noises)
        size = fit.model.size
        sigma = np.sqrt(np.diag(covariance))[:size]
        hidden = fit.free[:size] & ~(quantile * sigma < NOT_SEEN)
        if not np.any(hidden):
            _check(fit, found)
            return _result(fit, found, noises, noise)
        worst = int(np.argmax(np.where(hidden, sigma, 0.0)))
        fit.free[worst] = False


def _check(fit: OdometryFit, values: Array) -> None:
    """Refuse a result at the limit of the search range, or a search that determined nothing."""
    keys, (low, high) = fit.model.keys, fit.model.bounds
    if not np.any(fit.free[: len(keys)]):
        raise ValueError(
            f"these data determine none of {', '.join(keys)}: the robot drives too little, or "
            "[drive] "
            "is far from the robot that made them"
        )
    changes = values[: len(keys)]
    for key, change, least, most in zip(keys, changes, low, high, strict=True):
        if change < 0.99 * least or change > 0.99 * most:
            present = getattr(fit.model.nominal, key)
            raise ValueError(
                f"{key}: the true value is outside the search range around {present:g}; set it in "
                "[drive] approximately"
            )


def _alternate(fit: OdometryFit, noise: MotionNoise) -> tuple[Array, Array]:
    """Fit the drive and the noises alternately; return all numbers and the noises' logarithms."""
    found, noises = fit.begin(), fit.noise_begin(noise)
    for _ in range(_ROUNDS):
        found = fit.drive_step(found, noises)
        noises = fit.noise_step(found, noises, noise)
    return fit.drive_step(found, noises), noises


def _result(fit: OdometryFit, values: Array, noises: Array, prior: MotionNoise) -> Calibration:
    """Return the result as parameters of the drive."""
    covariance, quantile = fit.covariance(values, noises)
    width = np.where(fit.free, quantile * np.sqrt(np.diag(covariance)), np.nan)
    fold = fit.noise_fold(values, noises)
    before = (prior.e_m_per_sqrt_m, prior.f_rad_per_sqrt_m, prior.g_rad_per_sqrt_rad)
    e, f, g = np.where(np.isfinite(fold), np.exp(noises[:3]), before).tolist()
    reference = fit.reference
    if not reference.fixed:
        sigma_m, sigma_rad, sigma_s = np.exp(noises[3:6]).tolist()
        reference = Reference(sigma_m, sigma_rad, sigma_s, False, reference.follows_base)
    r, size = fit.innovations(values, noises)[0], fit.model.size
    return Calibration(
        fit.model,
        values[:size],
        width[:size],
        covariance[:size, :size],
        quantile,
        values[size : size + 2],
        width[size : size + 2],
        float(values[size + 2]),
        float(width[size + 2]),
        MotionNoise(e, f, g),
        fold,
        reference,
        int(np.count_nonzero(np.abs(r) > OUTLIER)),
        fit.references,
    )
