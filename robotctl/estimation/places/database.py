"""The places that a robot knows by their signatures, and which of them it is at.

How much two visits to one place differ, and how much other places differ, is learnt from the book
itself: each visit is compared with the most like one of its own place, and with the most like one
of all others, which is just what a visit to an unknown place would find. Few visits are eked out by
prior ones. The threshold lies as many standard deviations above the first as below the second::

    T = (mean_w sigma_b + mean_b sigma_w) / (sigma_w + sigma_b)

A place is recognised if its D is at most T and clearly below that of any other place (`ratio`;
what is below mean_w counts as that). What else is at most T stays as a candidate: another place
like it, or the same one turned, as a room of four like walls gives four headings.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.places.places import (
    ANY_HEADING,
    Place,
    RecognitionConfig,
    SonarCandidate,
    SonarRecognition,
    Spread,
    Visit,
)
from robotctl.estimation.places.signatures import (
    Comparison,
    Signature,
    SignatureConfig,
    SignatureIndex,
)
from robotctl.estimation.places.uncertainty import position_covariance, rotation
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2

_ONE_PLACE_M: Final = 0.5
"""Maximum distance between visits to one place [m]."""
_APART_RAD: Final = math.radians(25.0)
"""Headings closer than the width of a sonar's cone count as one."""


class PlaceBook:
    """All places that a robot knows.

    Parameters
    ----------
    places
        Of different names.
    signatures, config
        Settings.

    Raises
    ------
    ValueError
        If two places have one name, or a signature has another number of bearings than the
        settings say.
    """

    def __init__(
        self,
        places: Sequence[Place] = (),
        signatures: SignatureConfig | None = None,
        config: RecognitionConfig | None = None,
    ) -> None:
        self.places = tuple(places)
        self.signatures = signatures or SignatureConfig()
        self.config = config or RecognitionConfig()
        names = [place.name for place in self.places]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"place {name}: the name is given {names.count(name)} times")
        self._visits = [(place, visit) for place in self.places for visit in place.visits]
        self._index = SignatureIndex(
            [visit.signature for _, visit in self._visits], self.signatures
        )
        self._owner = np.array([self.places.index(place) for place, _ in self._visits], np.int64)
        self._least = self._index.each_other()
        np.fill_diagonal(self._least, np.inf)
        own, other = (_finite(least) for least in self._own_and_other())
        self.within = _spread(own, self.config.within, self.config.prior_visits)
        self.between = _spread(other, self.config.between, self.config.prior_visits)
        spread = self.within.sigma + self.between.sigma
        self.threshold = (
            self.within.mean * self.between.sigma + self.between.mean * self.within.sigma
        ) / spread

    def _own_and_other(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return each visit's difference from the most similar one of its place, and of others."""
        mine = self._owner[:, np.newaxis] == self._owner
        own = np.where(mine, self._least, np.inf).min(axis=1, initial=np.inf)
        other = np.where(mine, np.inf, self._least).min(axis=1, initial=np.inf)
        return own, other

    def apart(self, name: str) -> tuple[float, float, str]:
        """Return how well a place can be recognised.

        Returns
        -------
        tuple
            The greatest difference of one of its visits from the others; the least from another
            place's; that place's name. inf and "" if there is none.
        """
        mine = self._owner == [place.name for place in self.places].index(name)
        own, _ = self._own_and_other()
        others = np.where(mine, np.inf, self._least[mine].min(axis=0))
        nearest = int(np.argmin(others))
        least = float(others[nearest])
        return float(own[mine].max()), least, "" if mine[nearest] else self._visits[nearest][0].name

    def too_little(self, signature: Signature) -> str:
        """Return why no place can be learnt from a signature, a sentence; "" if one can."""
        if signature.echoes < self.config.least_echoes:
            return (
                f"the sonars received an echo in {signature.echoes:.0%} of their readings, "
                f"{self.config.least_echoes:.0%} are needed to recognise a place"
            )
        return self._too_narrow(signature)

    def _too_narrow(self, signature: Signature) -> str:
        """Return why a signature cannot be compared, a sentence; "" if it can."""
        seen = float(signature.seen.mean())
        if seen >= self.signatures.least_seen:
            return ""
        return (
            f"the sonars looked at {seen:.0%} of the bearings, "
            f"{self.signatures.least_seen:.0%} are needed"
        )

    def suggest(self, sensed: Signature) -> SonarRecognition:
        """Return the places where a signature may have been taken, and why none is recognised.

        Raises
        ------
        ValueError
            If it has another number of bearings than the book.
        """
        refusal = self._too_narrow(sensed)
        if not refusal and not self._visits:
            refusal = "no place is known yet"
        if refusal:
            return SonarRecognition((), refusal, threshold=self.threshold)
        comparison = self.compare(sensed)
        which = self.worth_comparing(comparison)
        differences = comparison.differences(which)
        least = differences.min(axis=1)
        if least.min() == math.inf:
            refusal = "too few bearings are in this and in a known signature"
            return SonarRecognition((), refusal, threshold=self.threshold)
        refusal = self._refusal(which, least)
        candidates = self._candidates(which, differences)
        return SonarRecognition(candidates, refusal, threshold=self.threshold)

    def compare(self, signature: Signature) -> Comparison:
        """Return a signature's comparison with those of all visits, in their order."""
        return self._index.compare(signature)

    def worth_comparing(self, comparison: Comparison) -> NDArray[np.int64]:
        """Return the indices of the visits to compare in full with a signature.

        Left out are those whose depth histograms alone differ by too much to be a candidate, or
        to make the best one doubtful.
        """
        bounds = comparison.bounds()
        first = np.array([np.argmin(bounds)])
        some = float(comparison.differences(first).min())
        limit = max(self.threshold, max(some, self.within.mean) / self.config.ratio)
        return np.flatnonzero(bounds <= limit)

    def _refusal(self, which: NDArray[np.int64], least: NDArray[np.float64]) -> str:
        """Return why the most similar place is not accepted; "" if it is."""
        best = int(np.argmin(least))
        name, difference = self._visits[which[best]][0].name, float(least[best])
        if difference > self.threshold:
            return (
                f"unknown: {name} is most like it and differs by {difference:.3f}, "
                f"{self.threshold:.3f} is allowed"
            )
        others = [
            (float(d), self._visits[k][0].name)
            for k, d in zip(which, least, strict=True)
            if self._visits[k][0].name != name
        ]
        next_difference, next_name = min(others, default=(math.inf, ""))
        typical = self.within.mean  # below that, differences are chance
        if max(difference, typical) > self.config.ratio * max(next_difference, typical):
            return (
                f"ambiguous: {name} differs by {difference:.3f} and {next_name} by "
                f"{next_difference:.3f}"
            )
        return ""

    def _candidates(
        self, which: NDArray[np.int64], differences: NDArray[np.float64]
    ) -> tuple[SonarCandidate, ...]:
        """Return similar enough candidates with distinct headings, best first, weighted."""
        low = (differences <= np.roll(differences, 1, axis=1)) & (
            differences <= np.roll(differences, -1, axis=1)
        )
        rows, shifts = np.nonzero(low & (differences <= self.threshold))
        found: list[SonarCandidate] = []
        for i in np.argsort(differences[rows, shifts], kind="stable"):
            row, shift = int(rows[i]), int(shifts[i])
            candidate = self._candidate(int(which[row]), differences[row], shift)
            if not any(_alike(candidate, each) for each in found):
                found.append(candidate)
        total = sum(each.score for each in found)
        return tuple(dataclasses.replace(each, score=each.score / total) for each in found)

    def _candidate(self, index: int, curve: NDArray[np.float64], shift: int) -> SonarCandidate:
        """Return a candidate at a visit, with a score that is not yet normalised."""
        place, visit = self._visits[index]
        difference = float(curve[shift])
        effective = max(difference, self.within.mean)
        turn, variance = rotation(curve, shift, effective, self.config.independent_bearings)
        heading = wrap_angle(visit.pose.theta_rad + turn)
        covariance = np.zeros((3, 3))
        covariance[:2, :2] = position_covariance(
            visit.signature, visit.pose.theta_rad, effective, self.signatures
        )
        # Both turns, the one that was learnt and this one, have their error.
        covariance[2, 2] = min(variance + 2.0 * self.config.turn_sigma_rad**2, ANY_HEADING)
        off = max(difference - self.within.mean, 0.0) / self.within.sigma
        return SonarCandidate(
            place.name,
            SE2(visit.pose.x_m, visit.pose.y_m, heading),
            math.exp(-0.5 * off * off),
            difference=difference,
            in_world=place.in_world,
            rotation_rad=wrap_angle(heading - place.visits[0].pose.theta_rad),
            covariance=covariance,
        )

    def learned(self, name: str, signature: Signature, pose: SE2 | None = None) -> PlaceBook:
        """Return this book with one more visit.

        Parameters
        ----------
        name
            Of a new place, or of a known one.
        signature
            Of the visit.
        pose
            `base` in `world`; None if unknown. A place is either in `world` with all of its visits,
            or with none.

        Raises
        ------
        ValueError
            If the signature says too little; or if the place is known, and the visit is not alike,
            is elsewhere or turned otherwise, or only one of both is in `world`.
        """
        problem = self.too_little(signature)
        if problem:
            raise ValueError(problem)
        known = next((place for place in self.places if place.name == name), None)
        if known is None:
            added = Place(name, pose is not None, (Visit(pose or SE2(), signature),))
            return PlaceBook((*self.places, added), self.signatures, self.config)
        if known.in_world != (pose is not None):
            raise ValueError(
                f"place {name} is{'' if known.in_world else ' not'} known in world, so a visit "
                f"{'needs' if known.in_world else 'must not have'} a pose in world"
            )
        visit = Visit(self._pose_at(known, signature, pose), signature)
        added = dataclasses.replace(known, visits=(*known.visits, visit))
        places = [added if place is known else place for place in self.places]
        return PlaceBook(places, self.signatures, self.config)

    def _pose_at(self, place: Place, signature: Signature, given: SE2 | None) -> SE2:
        """Return the pose of another visit to a place: the given one, if plausible."""
        found = PlaceBook([place], self.signatures, self.config).suggest(signature)
        if found.found is None:
            raise ValueError(f"this is not {place.name} ({found.refusal})")
        if given is None:
            return found.found.pose
        at = place.visits[0].pose
        away_m = math.hypot(given.x_m - at.x_m, given.y_m - at.y_m)
        if away_m > _ONE_PLACE_M:
            raise ValueError(
                f"{place.name} is {away_m:.2f} m away from there, "
                f"{_ONE_PLACE_M:g} m at most are allowed"
            )
        turns = [wrap_angle(given.theta_rad - each.pose.theta_rad) for each in found.candidates]
        off = min(turns, key=abs)
        if abs(off) > _APART_RAD:
            raise ValueError(
                f"according to its sonars the robot is turned by {math.degrees(-off):.0f} deg "
                "against that "
                "pose"
            )
        return given


def _finite(differences: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values that could be measured."""
    return differences[np.isfinite(differences)]


def _spread(samples: NDArray[np.float64], prior: Spread, strength: float) -> Spread:
    """Return mean and deviation of samples and of `strength` prior ones together."""
    n = len(samples)
    if n == 0:
        return prior
    mean = float(np.mean(samples))
    total = strength + n
    apart = (strength * n / total) * (mean - prior.mean) ** 2
    squares = strength * prior.sigma**2 + n * float(np.var(samples)) + apart
    return Spread((strength * prior.mean + n * mean) / total, math.sqrt(squares / total), n)


def _alike(a: SonarCandidate, b: SonarCandidate) -> bool:
    """Return whether two candidates are the same."""
    return a.place == b.place and abs(wrap_angle(a.rotation_rad - b.rotation_rad)) < _APART_RAD
