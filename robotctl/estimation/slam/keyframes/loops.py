"""Loop closure: places that were seen before, found again, and verified before they count."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from robotctl.estimation.places.recogniser import Candidate
from robotctl.estimation.slam.keyframes.back_end import KeyframeLink, certain
from robotctl.estimation.slam.keyframes.candidates import (
    POSITION,
    LoopCandidate,
    PossiblePlaces,
    nearest_of_each_visit,
)
from robotctl.estimation.slam.keyframes.growing_map import GrowingMap
from robotctl.estimation.slam.keyframes.recognisers import SCAN_RECOGNISERS
from robotctl.estimation.slam.keyframes.shapes import AROUND
from robotctl.estimation.slam.keyframes.verification import Closure, Verifier
from robotctl.estimation.slam_tuning import Tolerance
from robotctl.model.geometry.se2 import SE2


@dataclass(frozen=True, slots=True, eq=False)
class _Pending:
    closure: Closure
    links: list[KeyframeLink]


class LoopSearch:
    """Verifies candidates one at a time, and closes a loop where two closures agree.

    Parameters
    ----------
    growing
        The map.

    Attributes
    ----------
    log
        What became of the candidates.
    """

    def __init__(self, growing: GrowingMap) -> None:
        config, self._keyframes, self._back_end = growing
        self._config = config.tuning.loops
        self._gap = config.tuning.verification.around
        self._verifier = Verifier(growing)
        self._recognisers = {name: make(config.tuning) for name, make in SCAN_RECOGNISERS.items()}
        self._near: list[LoopCandidate] = []
        self._alike: list[LoopCandidate] = []
        self._alike_is_next = True
        self._pending: list[_Pending] = []
        self._unmeasured_m: dict[int, float] = {}
        self.log: list[Closure] = []

    def enter(self, number: int, unmeasured_m: float) -> None:
        """Show a new keyframe to the recognisers, and some of a map that was loaded.

        The distance travelled until there without odometry [m] says how wrong the map may be.
        """
        self._unmeasured_m[number] = unmeasured_m
        between = self._back_end.between
        for recogniser in self._recognisers.values():
            for new in range(len(recogniser), number + 1)[: self._config.at_once]:
                around = range(max(new - AROUND, 0), new + 1)
                recogniser.add(
                    [(between(new, each), self._keyframes[each].surface.points) for each in around]
                )

    def consider(self, number: int, others: np.ndarray, doubts: np.ndarray) -> None:
        """Put old keyframes on the list: the nearest of each visit, and those that look alike.

        Parameters
        ----------
        number
            Number of the new keyframe.
        others
            Old ones whose pose relative to it is uncertain, (n,).
        doubts
            Standard deviations of all keyframes: position [m] and heading [rad], (m, 2).
        """
        config, blind_m = self._config, self._blind_m(number, others)
        doubts = doubts.copy()
        doubts[others, 0] = np.hypot(doubts[others, 0], config.drift * blind_m)
        blind_m = blind_m[others < number - 2 * self._gap]
        others = others[others < number - 2 * self._gap]
        poses = self._back_end.poses
        away_m = np.hypot(*(poses[others, :2] - poses[number, :2]).T)
        reach_m = config.gate * doubts[others, 0]
        is_near = away_m < config.near_m + reach_m
        self._consider_near(number, others[is_near], away_m[is_near], doubts)
        limits_m = config.beyond * reach_m
        limits_m = np.maximum(limits_m, config.slip * blind_m)
        turns_rad = poses[number, 2] - poses[others, 2]
        within_rad = config.shape.turn_rad + config.beyond * config.gate * doubts[others, 1]
        limit_of = dict(zip(others.tolist(), limits_m.tolist(), strict=True))
        for name, recogniser in self._recognisers.items():
            is_seen = (others < len(recogniser)) & (number < len(recogniser))
            may_be = np.flatnonzero(is_seen & (away_m < config.near_m + limits_m))
            possible = PossiblePlaces(number, others[may_be], turns_rad[may_be], within_rad[may_be])
            for each in reversed(recogniser.suggest(possible).candidates):
                self._add_alike(number, name, each, config.shape, limit_of[each.place])

    def suggest(self, number: int, found_by: str, candidates: Sequence[Candidate[int]]) -> None:
        """Put keyframes that a camera or sonars recognised on the list, unless they are known.

        An image tells a place from all others; by sound the map may be no more wrong than by shape.
        """
        doubts = self._back_end.doubts(number)
        is_certain = certain(doubts)
        by_image = found_by == "image"
        tolerance = self._config.image if by_image else self._config.sonar
        for each in candidates:
            if each.place >= number - 2 * self._gap or is_certain[each.place]:
                continue
            limit_m = math.inf
            if not by_image:
                limit_m = self._config.beyond * self._config.gate * float(doubts[each.place, 0])
            self._add_alike(number, found_by, each, tolerance, limit_m)

    def _add_alike(
        self, number: int, found_by: str, at: Candidate[int], tolerance: Tolerance, limit_m: float
    ) -> None:
        """Put a place that looks or sounds alike on the list; drop the oldest beyond its length."""
        candidate = LoopCandidate(
            at.place, at.pose, at.score,
            keyframe=number, found_by=found_by,
            shift_m=tolerance.shift_m, turn_rad=tolerance.turn_rad,
            limit_m=tolerance.shift_m + limit_m,
        )  # fmt: skip
        self._alike = [*self._alike, candidate][-self._config.queue :]

    def _consider_near(
        self, number: int, others: np.ndarray, away_m: np.ndarray, doubts: np.ndarray
    ) -> None:
        """Put old keyframes that may be near on the list; the nearest of each visit."""
        gate = self._config.gate
        for other in nearest_of_each_visit(others, away_m, self._gap):
            sigma_m, sigma_rad = doubts[other].tolist()
            self._near.append(
                LoopCandidate(
                    other, SE2(), 0.0, keyframe=number, found_by=POSITION,
                    shift_m=min(gate * sigma_m + 0.3, 8.0),
                    turn_rad=min(gate * sigma_rad + 0.1, math.pi),
                    sigma_m=2.0 * sigma_m + 0.2, sigma_rad=2.0 * sigma_rad + 0.1,
                )
            )  # fmt: skip
        self._near = self._near[-self._config.queue :]

    def step(self) -> list[KeyframeLink]:
        """Verify one candidate; return the links of a loop that is closed."""
        if not self._near and not self._alike:
            return []
        # By turns, so that neither kind waits for the other.
        self._alike_is_next = bool(self._alike) and (self._alike_is_next or not self._near)
        candidate = self._alike.pop() if self._alike_is_next else self._near.pop()
        self._alike_is_next = not self._alike_is_next
        closure, links = self._verifier.verify(candidate)
        if not closure.reason:
            links = self._confirmed(_Pending(closure, links))
            if not links:
                closure = replace(closure, reason="not confirmed by another yet")
        self.log.append(closure)
        return links if not closure.reason else []

    def _confirmed(self, new: _Pending) -> list[KeyframeLink]:
        """Return the links of a closure and of those before that agree with it; else keep it."""
        config, now_m = self._config, self._keyframes[new.closure.keyframe].travelled_m
        self._pending = [
            each
            for each in self._pending
            if now_m - self._keyframes[each.closure.keyframe].travelled_m < config.forget_m
        ]
        links = []
        for each in list(self._pending):
            way_m = abs(now_m - self._keyframes[each.closure.keyframe].travelled_m)
            is_near = any(map(self._is_near, (each.closure, new.closure)))
            apart_m = config.apart_m if is_near else config.apart_alike_m
            if way_m >= apart_m and self._agree(each.closure, new.closure, way_m):
                links += each.links
                self._pending.remove(each)
        if links:
            return links + new.links
        self._pending.append(new)
        return []

    def _is_near(self, closure: Closure) -> bool:
        """Return whether the map itself suggested a closure, and has measured the way to it."""
        blind_m = self._blind_m(closure.keyframe, np.array([closure.other]))[0]
        return closure.found_by == POSITION and self._config.drift * blind_m < self._config.agree_m

    def _blind_m(self, number: int, others: np.ndarray) -> np.ndarray:
        """Return distances travelled without odometry between a keyframe and others, (n,) [m]."""
        unmeasured_m = self._unmeasured_m
        before = np.array([unmeasured_m.get(each, 0.0) for each in others.tolist()])
        return unmeasured_m.get(number, 0.0) - before

    def _agree(self, a: Closure, b: Closure, way_m: float) -> bool:
        """Return whether two closures imply the same shift of the map."""
        back_end, config = self._back_end, self._config
        expected = back_end.pose(a.other) @ a.pose @ back_end.between(a.keyframe, b.keyframe)
        off = expected.inverse() @ back_end.pose(b.other) @ b.pose
        return (
            bool(np.hypot(off.x_m, off.y_m) < config.agree_m + 0.02 * way_m)
            and abs(off.theta_rad) < config.agree_rad
        )
