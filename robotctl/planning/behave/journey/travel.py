"""The behaviour that drives to a place by recognising places, without coordinates of a world.

All that it believes is in which place it is, and where in the frame of that place. It drives to the
passage that leads on, in that frame; beyond, it is in the frame of the next place. What the lidar
sees is compared with what the place looks like all the time; where that does not fit for a while,
it looks for the place anew, and goes on from the one that it finds. Kuipers, Modayil, Beeson,
MacMahon, Savelli: Local metrical and global topological maps in the hybrid spatial semantic
hierarchy, ICRA 2004.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from typing import Final

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behave.behaviours.behaviour import (
    Anchor,
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    Status,
    done,
    failed,
)
from robotctl.planning.behave.journey.approach import Approach
from robotctl.planning.behave.journey.blindness import BlindWait
from robotctl.planning.behave.journey.place_finder import Belief, KnownPlaces, PlaceFinder
from robotctl.planning.behave.journey.tools import JourneyTools
from robotctl.planning.map.topological.graph import Passage
from robotctl.planning.map.topological.recognition import (
    look_of,
)

_BEYOND: Final = tuple(
    SE2(x_m, y_m)
    for x_m, y_m in (
        *((0.6, 0.0), (0.6, 0.35), (0.6, -0.35), (0.9, 0.0), (0.9, 0.5), (0.9, -0.5)),
        *((1.2, 0.0), (1.2, 0.7), (1.2, -0.7), (0.4, 0.0)),
    )
)
"""One who leaves by a passage drives to one of these, in the frame of the way out."""
_MIDDLE: Final = (
    SE2(),
    *(
        SE2(0.0, 0.0, number * math.pi / 3.0) @ SE2(away_m)
        for away_m in (0.5, 1.0)
        for number in range(6)
    ),
)
"""One who arrives, to one of these in the frame of the place."""
_CROSSED_M, _LEFT_M = 0.25, 2.0


class Travel(Behaviour):
    """Drives to a place.

    Parameters
    ----------
    tools
        World, paths and controller.
    places
        The places that there are.
    approach
        Drives from spot to spot.
    roam
        Makes what drives to where more is to be seen.
    goal
        Name of the place.
    start
        Where it begins; empty: to be recognised.
    """

    def __init__(
        self,
        tools: JourneyTools,
        places: KnownPlaces,
        approach: Approach,
        roam: Callable[[], Behaviour],
        goal: str,
        start: str,
    ) -> None:
        self._tools = tools
        self._config = tools.journey.travel
        self._map = topology = places.map
        self._places = {place.name: place for place in topology.places}
        self._passages = {passage.name: passage for passage in topology.passages}
        self._looks_of = places.looks
        self._goal = goal
        self._approach = approach
        self._blind = BlindWait(tools.journey.blind_max_s)
        self._finder = PlaceFinder(tools, places, roam, start, self._blind)
        self.reset()

    def anchor(self, pose: SE2) -> Anchor:
        """Return where the robot is: it goes on from there."""
        return Anchor(pose.x_m, pose.y_m)

    def reset(self) -> None:
        """Start over."""
        self._belief: Belief | None = None
        self._failures: Counter[str] = Counter()
        self._closed: dict[str, str] = {}
        """Why, of passages that it does not get through."""
        self._epoch: tuple[int, int] | None = None
        self._finder.reset()
        self.pause()

    def pause(self) -> None:
        """Go on from where the robot is after the pause."""
        self._approach.reset()
        self._finder.pause()
        self._seen_ns = 0
        self._blind.end()
        self._last: SE2 | None = None

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the next velocity; done in the middle of the goal."""
        if blindness := self._tools.world.blindness:
            return self._blind.step(blindness, now_ns)
        if situation.epoch != self._epoch:  # poses before and after have nothing in common
            self._epoch, self._belief = situation.epoch, None
            self.pause()
        self._note_way(situation.pose)
        if self._belief is not None:
            self._blind.end()
            self._compare(self._belief, now_ns)
        if self._belief is None:
            found = self._finder.step(situation, now_ns)
            if not isinstance(found, Belief):
                return found
            self._belief = found
            return BehaviourOutput(0.0, 0.0, text=f"recognised {found.place}")
        return self._drive(self._belief, situation, now_ns)

    def _note_way(self, pose: SE2) -> None:
        """Count the way driven."""
        if self._last is not None:
            driven_m = math.hypot(pose.x_m - self._last.x_m, pose.y_m - self._last.y_m)
            self._finder.note_driven(driven_m)
            if self._belief is not None:
                self._belief.unseen_m += driven_m
        self._last = pose

    def _compare(self, belief: Belief, now_ns: int) -> None:
        """Compare what is seen with the present place; forget a place that it is not."""
        if now_ns - self._seen_ns < round(1e9 * self._config.look_s):
            return
        taken, self._seen_ns = self._tools.world.last_scan, now_ns
        if taken is None:
            return
        T_world_base, scan = taken
        look = look_of(scan)
        if look is None:
            return
        expected = belief.T_world_frame.inverse() @ T_world_base
        seen = self._looks_of[belief.place].follow(
            look, expected, self._config.drift * belief.unseen_m
        )
        if seen is not None:
            belief.T_world_frame = T_world_base @ seen.pose.inverse()
            belief.unseen_m, belief.is_borne_out = 0.0, True
        elif belief.unseen_m > self._config.wrong_m:
            self._forget(f"this does not look like {belief.place}")

    def _forget(self, reason: str) -> None:
        """Search for the place again."""
        self._belief, self._finder.reason = None, reason
        self.pause()

    def _drive(self, belief: Belief, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Drive to the passage that leads on, or in the goal to its middle."""
        if belief.place == self._goal:
            return self._arrive(belief, situation, now_ns)
        way = self._map.way(belief.place, self._goal, frozenset(self._closed))
        if way is None:
            why = "".join(f"; {name}: {reason}" for name, reason in self._closed.items())
            return failed(f"no way from {belief.place} to {self._goal}{why}")
        step = way[0]
        crossed = self._crossed(belief, situation.pose)
        if crossed is not None:
            if crossed is not step.passage:
                self._count(step.passage, f"the way there leads through {crossed.name}")
            return self._enter(belief, crossed)
        T_world_exit = belief.T_world_frame @ self._places[belief.place].way_out(step.passage.name)
        spots = [T_world_exit @ spot for spot in _BEYOND]
        output = self._approach.step(step.passage.name, spots, situation, now_ns)
        if output.status is Status.DONE:
            return self._enter(belief, step.passage)
        if output.status is Status.FAILED:
            return self._fail(step.passage, output.text)
        text = f"in {belief.place}, to {step.place.name} by {step.passage.name}: {output.text}"
        return output._replace(text=text)

    def _crossed(self, belief: Belief, pose: SE2) -> Passage | None:
        """Return the passage through which the robot has left its place; None: it is in it."""
        place = self._places[belief.place]
        T_frame_base = belief.T_world_frame.inverse() @ pose
        for name in place.passages:
            off = place.way_out(name).inverse() @ T_frame_base
            passage = self._passages[name]
            beside_m = 0.5 * passage.width_m + self._config.beside_m
            if _CROSSED_M < off.x_m < _LEFT_M and abs(off.y_m) < beside_m:
                return passage
        return None

    def _enter(self, belief: Belief, passage: Passage) -> BehaviourOutput:
        """Believe to be in the place beyond a passage."""
        there = passage.beyond(belief.place)
        T_world_there = belief.T_world_frame @ self._map.across(belief.place, passage)
        self._belief = Belief(there, T_world_there, is_borne_out=False)
        self._seen_ns = 0
        return BehaviourOutput(0.0, 0.0, text=f"through {passage.name}: {there}")

    def _count(self, passage: Passage, reason: str) -> None:
        """Count that a passage was not reached; close it if that has happened before."""
        self._failures[passage.name] += 1
        if self._failures[passage.name] >= self._config.tries:
            self._closed[passage.name] = reason

    def _fail(self, passage: Passage, reason: str) -> BehaviourOutput:
        """Look again after a passage was not reached; take another way if that repeats."""
        self._count(passage, reason)
        self._forget(f"{passage.name} was not reached: {reason}")
        return BehaviourOutput(0.0, 0.0, text=self._finder.reason)

    def _arrive(self, belief: Belief, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Drive to the middle of the goal."""
        spots = [belief.T_world_frame @ spot for spot in _MIDDLE]
        output = self._approach.step(self._goal, spots, situation, now_ns)
        if output.status is Status.RUNNING:
            return output._replace(text=f"in {self._goal}, to its middle: {output.text}")
        if not belief.is_borne_out or belief.unseen_m > 0.5 * self._config.wrong_m:
            self._forget(f"this does not look like {self._goal}")
            return BehaviourOutput(0.0, 0.0, text=self._finder.reason)
        if output.status is Status.FAILED:
            return done(f"in {self._goal}; its middle was not reached: {output.text}")
        return done(f"in {self._goal}")
