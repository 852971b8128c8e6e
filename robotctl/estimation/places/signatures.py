"""The sonar signature of a place: depth against bearing, and the difference of two places.

Notes, section 5. A signature has a value for each bearing: the median depth of the echoes, and the
share of readings without an echo, because silence distinguishes places too. A bearing at which no
sonar looked is missing, and is left out of a comparison.

A bearing becomes a histogram H(z) over depth, with silence as a class of its own: an echo weighs
in the classes near its depth, by a Gaussian that stands for its error and for a robot that does not
stand just where it stood. The difference of two places at a shift s of the bearings is the square
difference test, on average of the bearings that both have::

    D(s) = mean_i  sum_z (H_a(i + s, z) - H_b(i, z))^2 / 2

Echoes have norm 1, so D is 0 for the same and 1 for nothing in common, and a wrong bearing counts
the same however wrong it is: a median of crossed echoes or a chair that was moved costs its own
share. D at all shifts comes from a few FFTs. The mean of H over the bearings does not change when
the robot turns, and half the square difference of two means is a lower bound of D at every shift
(Jensen), so that it rules out places for certain before any shift is tried.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.errors import InvalidValue

FARTHEST_M: Final = 1000.0
"""No echo comes from farther away [m]; beyond it, squares of depths in sigmas would overflow."""
_CLASSES_A_SIGMA = 1.5
"""Depth classes in one `depth_sigma_m`: echoes half way between two weigh as much as others."""


@dataclass(frozen=True, slots=True)
class SignatureConfig:
    """How signatures are made and compared.

    Parameters
    ----------
    bearings
        Bins of bearing, >= 8.
    max_range_m
        Echoes from farther away count as silence [m], > 0 and at most `FARTHEST_M`.
    depth_sigma_m
        Standard deviation of the depth of the same thing at two visits [m], > 1e-4.
    least_seen
        Share of the bearings that both signatures must have to be compared, (0, 1].

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    bearings: int = 72
    max_range_m: float = 4.0
    depth_sigma_m: float = 0.15
    least_seen: float = 0.5

    def __post_init__(self) -> None:
        if self.bearings < 8:
            raise InvalidValue("bearings", f"must be >= 8, found {self.bearings}", self.bearings)
        for key, least in (("max_range_m", 0.0), ("depth_sigma_m", 1e-4)):
            value = getattr(self, key)
            if not least < value <= FARTHEST_M:
                bounds = f"must be > {least:g} and at most {FARTHEST_M:g}, found {value}"
                raise InvalidValue(key, bounds, value)
        if not 0.0 < self.least_seen <= 1.0:
            raise InvalidValue(
                "least_seen", f"must be in (0, 1], found {self.least_seen}", self.least_seen
            )


@dataclass(frozen=True, slots=True, eq=False)
class Signature:
    """Depth against bearing, around `base`.

    Bin i of n has the bearings from 2 pi i / n to 2 pi (i + 1) / n, forward to the left.

    Parameters
    ----------
    depth_m
        Median distance of the echoes from `base`, (n,) [m], > 0 and at most `FARTHEST_M`; nan if
        there was none.
    silence
        Share of readings without an echo, (n,), 0 to 1; nan if no sonar looked.

    Raises
    ------
    ValueError
        If the shapes differ, a value is out of its range, or a depth and a silence contradict.
    """

    depth_m: NDArray[np.float64]
    silence: NDArray[np.float64]

    def __post_init__(self) -> None:
        if self.depth_m.ndim != 1 or self.depth_m.shape != self.silence.shape:
            raise ValueError(
                f"depth_m {self.depth_m.shape} and silence {self.silence.shape} must both be (n,)"
            )
        has_echo = ~np.isnan(self.depth_m)
        depth_m = self.depth_m[has_echo]
        if not np.all((depth_m > 0.0) & (depth_m <= FARTHEST_M)):
            raise InvalidValue(
                "depth_m",
                f"must be > 0 and at most {FARTHEST_M:g} m, or nan where there was no echo",
                self.depth_m,
            )
        seen = self.silence[self.seen]
        if not np.all((seen >= 0.0) & (seen <= 1.0)):
            raise InvalidValue(
                "silence",
                "must be in [0, 1], or nan where no sonar looked",
                self.silence,
            )
        contradicting = np.flatnonzero(has_echo != (self.silence < 1.0))
        if len(contradicting):
            i = int(contradicting[0])
            raise ValueError(
                f"bearing {i}: depth_m {self.depth_m[i]} and silence {self.silence[i]} contradict: "
                "a depth is allowed where silence is below 1, and needed there"
            )

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Bearings with a reading, (n,)."""
        return ~np.isnan(self.silence)

    @property
    def echoes(self) -> float:
        """Mean share of echoes over the bearings, 0 to 1."""
        seen = self.silence[self.seen]
        return float(1.0 - seen.mean()) if len(seen) else 0.0


def signature_of(
    bearings_rad: NDArray[np.float64], depths_m: NDArray[np.float64], config: SignatureConfig
) -> Signature:
    """Return the signature of readings around `base`.

    Parameters
    ----------
    bearings_rad
        Direction of each reading from `base`, forward to the left, (k,) [rad].
    depths_m
        Distance of the echo from `base`, (k,) [m]; inf without one, nan for no reading.
    config
        Bins, and what counts as silence.
    """
    known = ~np.isnan(depths_m)
    depths = np.where(depths_m < config.max_range_m, depths_m, np.inf)[known]
    n = config.bearings
    bins = np.floor(bearings_rad[known] * (n / math.tau)).astype(np.int64) % n
    readings = np.bincount(bins, minlength=n)
    echoes = np.bincount(bins[np.isfinite(depths)], minlength=n)
    with np.errstate(invalid="ignore"):
        silence = 1.0 - echoes / readings  # nan without any reading
    order = np.lexsort((depths, bins))  # by bearing, then by depth: silence comes last
    first = np.cumsum(readings) - readings
    middle = first + np.maximum(echoes - 1, 0) // 2
    depth = np.full(n, np.nan)
    has_echo = echoes > 0
    depth[has_echo] = depths[order][middle[has_echo]]
    return Signature(depth, silence)


def histograms(signature: Signature, config: SignatureConfig) -> NDArray[np.float64]:
    """Return H, (bearings, classes): depth classes up to the maximum range, then silence.

    Rows of bearings that were not seen are 0.

    Raises
    ------
    ValueError
        If the signature has another number of bearings.
    """
    if len(signature.silence) != config.bearings:
        raise ValueError(
            f"a signature of {len(signature.silence)} bearings, {config.bearings} allowed"
        )
    classes = math.ceil(_CLASSES_A_SIGMA * config.max_range_m / config.depth_sigma_m)
    centres = (np.arange(classes) + 0.5) * (config.max_range_m / classes)
    depth = np.nan_to_num(signature.depth_m)[:, np.newaxis]
    off = np.square((centres - depth) / config.depth_sigma_m)
    echo = np.exp(-0.5 * (off - off.min(axis=1, keepdims=True)))
    echo /= np.linalg.norm(echo, axis=1, keepdims=True)
    silence = np.where(signature.seen, signature.silence, 1.0)[:, np.newaxis]
    found = np.concatenate([(1.0 - silence) * echo, silence], axis=1)
    return np.where(signature.seen[:, np.newaxis], found, 0.0)


class SignatureIndex:
    """Known signatures, ready to be compared with others.

    Parameters
    ----------
    signatures
        Known signatures, all of the same number of bearings.
    config
        How they are compared.

    Raises
    ------
    ValueError
        If a signature has another number of bearings than the configuration.
    """

    def __init__(self, signatures: Sequence[Signature], config: SignatureConfig) -> None:
        self.config = config
        self._known = _Spectra(signatures, config)

    def __len__(self) -> int:
        return len(self._known.mean)

    def compare(self, signature: Signature) -> Comparison:
        """Return a new signature, ready for comparison with the known ones.

        Raises
        ------
        ValueError
            If it has another number of bearings.
        """
        return Comparison(self._known, _Spectra([signature], self.config), self.config)

    def each_other(self) -> NDArray[np.float64]:
        """Return the least D, over all shifts, of each known one from each other, (k, k)."""
        rows = [
            Comparison(self._known, self._known.only(i), self.config).differences().min(axis=1)
            for i in range(len(self))
        ]
        return np.array(rows).reshape(len(self), len(self))


class Comparison:
    """Comparison of a new signature with known ones; made by `SignatureIndex.compare`."""

    def __init__(self, known: _Spectra, new: _Spectra, config: SignatureConfig) -> None:
        self._known, self._new = known, new
        self._config = config

    def bounds(self) -> NDArray[np.float64]:
        """Return a lower bound of each known signature's difference at any shift, (k,).

        Uses the depth histograms, which are independent of bearing; 0 if either lacks a bearing.
        """
        known, new = self._known, self._new
        bound: NDArray[np.float64] = 0.5 * np.square(known.mean - new.mean).sum(axis=1)
        return np.where(known.whole & new.whole, bound, 0.0)

    def differences(self, which: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
        """Return D of the new signature from known ones at each shift.

        Parameters
        ----------
        which
            Indices of the known ones to compare with, (m,); None: all.

        Returns
        -------
        NDArray
            (m, bearings), 0 to 1: column s is of a robot that stands turned by s bearings to the
            left from where it stood; inf if less than `least_seen` of the bearings is in both.
        """
        old, new = self._known, self._new
        chosen = np.arange(len(old.mean)) if which is None else which
        n = self._config.bearings
        # Circular correlation: sum over i of a(i + s) b(i) has the spectrum A(f) conj(B(f)).
        turned = np.conj(new.rows)
        spectrum = -2.0 * np.einsum("kfz,fz->kf", old.rows[chosen], turned[0])
        spectrum += old.squares[chosen] * np.conj(new.seen) + old.seen[chosen] * np.conj(
            new.squares
        )
        total = 0.5 * np.fft.irfft(spectrum, n, axis=1)
        both = np.fft.irfft(old.seen[chosen] * np.conj(new.seen), n, axis=1).round()
        enough = both >= max(1.0, self._config.least_seen * n)
        found = np.full(total.shape, np.inf)
        np.divide(total, both, out=found, where=enough)
        squared: NDArray[np.float64] = np.maximum(found, 0.0)
        return squared


class _Spectra:
    """Histograms of signatures, their square norms and masks, by their spectra over the bearings.

    Attributes
    ----------
    rows, squares, seen
        Complex (k, f, z), (k, f) and (k, f).
    mean
        Depth histograms that do not change with rotation, (k, z).
    whole
        Whether all bearings were seen, (k,).
    """

    def __init__(self, signatures: Sequence[Signature], config: SignatureConfig) -> None:
        found = [histograms(each, config) for each in signatures]
        shape = (0, config.bearings, 1)
        rows = np.stack(found) if found else np.zeros(shape)
        seen = np.array([each.seen for each in signatures]).reshape(-1, config.bearings)
        self.rows = np.fft.rfft(rows, axis=1)
        self.squares = np.fft.rfft(np.square(rows).sum(axis=2), axis=1)
        self.seen = np.fft.rfft(seen.astype(np.float64), axis=1)
        self.mean = rows.mean(axis=1)
        self.whole = seen.all(axis=1)

    def only(self, index: int) -> _Spectra:
        """Return one of them."""
        found = copy(self)
        for name, value in vars(self).items():
            setattr(found, name, value[index : index + 1])
        return found
