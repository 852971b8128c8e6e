"""Drawings for 3D panels in addition to maps, scans and clouds."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Final, TypeAlias

import msgspec

from robotctl.estimation.ranging.sonar_config import SonarModelConfig
from robotctl.logs.mcap.foxglove import (
    BASE,
    WORLD,
    Vector3,
    time_of,
)
from robotctl.logs.mcap.scene_update import (
    LineType,
    SceneEntity,
    SceneUpdate,
    draw,
    erase,
    lasting,
    line,
)
from robotctl.logs.mcap.shapes import (
    FAINT,
    SKY,
    SLOW_NS,
    VERMILION,
    cone,
    ellipse,
    goal_text,
    goals,
    linked_places,
    moving_thing,
    outline,
    point,
    seen_things,
)
from robotctl.messages.control import ControlState, NavigationState
from robotctl.messages.estimation import (
    CameraView,
    LocalisationState,
    PlanView,
    SlamGraph,
)
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount

Drawn: TypeAlias = tuple[str, SceneUpdate]
"""Topic, and its drawing."""

MOST_LOOPS: Final = 200
"""Maximum number of closed loops drawn."""
GRAPH_NS: Final = 5_000_000_000
"""Minimum interval of drawings of the graph [ns], each of which is complete."""
_TRACE_NS: Final = 50_000_000
_TRACE: Final = 600
"""Poses of the odometry stored for closed loops, half a minute."""


class Drawings:
    """Pictures of the messages of one run.

    Parameters
    ----------
    sonars
        Sonars, in the order of their ranges.
    sonar
        Beam and range of the sonars.
    bodies, state
        Body of the robot in each of its states, and the present one; none: unknown.
    """

    def __init__(
        self,
        sonars: Sequence[SonarMount],
        sonar: SonarModelConfig,
        bodies: Sequence[Footprint],
        state: int,
    ) -> None:
        self._sonars = tuple(sonars)
        self._sonar = sonar
        self._bodies, self._body = bodies, state
        self._due_ns: dict[str, int] = {}
        self._last: dict[str, object] = {}
        self._moves = False
        self._odom_epoch_ns = 0
        self._trace: deque[tuple[int, SE2]] = deque(maxlen=_TRACE)
        self._loops: deque[Vector3] = deque(maxlen=2 * MOST_LOOPS)
        self._goal: NavigationState | None = None
        self._graph: SlamGraph | None = None

    def standing(self, wall_ns: int) -> Iterator[Drawn]:
        """Yield the static drawings, for the beginning of a file."""
        if self._bodies:
            yield "outline", outline(wall_ns, self._bodies[self._body])
        if self._loops:
            yield "loops", self._drawn_loops(wall_ns)
        if self._goal is not None:
            yield "goal", goals(wall_ns, self._goal)
        if self._graph is not None:
            yield "slam_graph", draw(linked_places(wall_ns, self._graph))

    def of_control(self, wall_ns: int, state: ControlState) -> Iterator[Drawn]:
        """Yield the cones of the sonars."""
        if state.odom_epoch_ns != self._odom_epoch_ns:
            self._trace.clear()
        self._odom_epoch_ns = state.odom_epoch_ns
        if self._is_due("trace", state.stamp_ns, _TRACE_NS):
            self._trace.append((state.stamp_ns, state.T_odom_base))
        if not self._sonars or len(state.sonar_m) != len(self._sonars):
            return
        if self._is_due("sonar_cones", state.stamp_ns, SLOW_NS):
            ranges_m = tuple(round(each, 2) for each in state.sonar_m)
            if self._is_new("sonar_cones", repr(ranges_m)):  # nan differs from itself
                yield "sonar_cones", self._cones(wall_ns, ranges_m)

    def of_localisation(self, wall_ns: int, state: LocalisationState) -> Iterator[Drawn]:
        """Yield the closed loops, and the ellipse of the pose's uncertainty."""
        if state.odom_epoch_ns != self._odom_epoch_ns or not self._trace:
            return
        known = [each for each in state.loops if each.stamp_ns >= self._trace[0][0]]
        for loop in known:
            later = state.T_world_odom @ self._odometry_at(loop.stamp_ns)
            earlier = later @ SE2(loop.x_m, loop.y_m, loop.theta_rad).inverse()
            self._loops.extend((point(earlier.x_m, earlier.y_m), point(later.x_m, later.y_m)))
        if known:
            yield "loops", self._drawn_loops(wall_ns)
        if self._is_due("covariance", state.stamp_ns, SLOW_NS):
            found = ellipse(wall_ns, state, state.T_world_odom @ self._trace[-1][1])
            if found is not None:
                yield "covariance", draw(found)

    def of_navigation(self, wall_ns: int, state: NavigationState) -> Iterator[Drawn]:
        """Yield goal and home of the robot, and its body, when one of them changes."""
        if state.body != self._body and state.body < len(self._bodies):
            self._body = state.body
            yield "outline", outline(wall_ns, self._bodies[state.body])
        if self._is_new("goal", (state.goal, state.home, goal_text(state))):
            was_there, self._goal = self._goal is not None, state
            if state.goal is None and state.home is None:
                self._goal = None
                if was_there:
                    yield "goal", erase(wall_ns)
            else:
                yield "goal", goals(wall_ns, state)

    def of_plan(self, wall_ns: int, view: PlanView) -> Iterator[Drawn]:
        """Yield moving obstacles, and an empty drawing after the last."""
        if view.moving or self._moves:
            self._moves = bool(view.moving)
            entities = (
                moving_thing(wall_ns, number, *each) for number, each in enumerate(view.moving)
            )
            yield "moving", draw(*entities)

    def of_camera(self, wall_ns: int, view: CameraView) -> Iterator[Drawn]:
        """Yield the end of the floor seen by the camera, and objects and markers on it."""
        if not view.trouble and self._is_due("seen", view.stamp_ns, SLOW_NS):
            yield "seen", draw(seen_things(wall_ns, view))

    def of_graph(self, wall_ns: int, graph: SlamGraph) -> Iterator[Drawn]:
        """Yield the links between keyframes, those that closed a loop in another colour."""
        if self._graph is not None:
            is_same = msgspec.structs.replace(graph, stamp_ns=self._graph.stamp_ns) == self._graph
            if is_same or not self._is_due("slam_graph", graph.stamp_ns, GRAPH_NS):
                return
        self._graph = graph
        yield "slam_graph", draw(linked_places(wall_ns, graph))

    def _is_due(self, topic: str, stamp_ns: int, period_ns: int) -> bool:
        """Return whether the next drawing is due, also after a restart of the clock."""
        if 0 <= stamp_ns - self._due_ns.get(topic, -period_ns) < period_ns:
            return False
        self._due_ns[topic] = stamp_ns
        return True

    def _is_new(self, topic: str, value: object) -> bool:
        """Return whether a drawing differs from the last one."""
        is_new, self._last[topic] = value != self._last.get(topic), value
        return is_new

    def _odometry_at(self, stamp_ns: int) -> SE2:
        """Return the nearest known pose of `base` in `odom`."""
        return min(self._trace, key=lambda each: abs(each[0] - stamp_ns))[1]

    def _drawn_loops(self, wall_ns: int) -> SceneUpdate:
        lines = (line(LineType.LINE_LIST, tuple(self._loops), VERMILION),)
        return draw(
            SceneEntity(
                time_of(wall_ns), WORLD, "loops", lasting(0), frame_locked=False, lines=lines
            )
        )

    def _cones(self, wall_ns: int, ranges_m: Sequence[float]) -> SceneUpdate:
        """Return a cone for each working sonar, faint without an echo."""
        half_rad = 0.5 * math.radians(self._sonar.beam_deg)
        lines = tuple(
            cone(mount, range_m, half_rad, SKY)
            if math.isfinite(range_m)
            else cone(mount, self._sonar.max_range_m, half_rad, FAINT)
            for mount, range_m in zip(self._sonars, ranges_m, strict=True)
            if not math.isnan(range_m)
        )
        return draw(
            SceneEntity(
                time_of(wall_ns), BASE, "sonars", lasting(0), frame_locked=True, lines=lines
            )
        )
