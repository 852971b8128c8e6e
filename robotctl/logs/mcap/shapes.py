"""Shapes of a 3D panel for the robot's messages."""

from __future__ import annotations

import itertools
import math
from array import array
from collections.abc import Iterator
from typing import Final

import msgspec

from robotctl.logs.mcap.foxglove import (
    BASE,
    UPRIGHT,
    WORLD,
    Pose,
    Vector3,
    time_of,
    turned,
)
from robotctl.logs.mcap.scene_update import (
    ArrowPrimitive,
    Color,
    CubePrimitive,
    CylinderPrimitive,
    KeyValuePair,
    LinePrimitive,
    LineType,
    SceneEntity,
    SceneUpdate,
    draw,
    erase,
    label,
    lasting,
    line,
)
from robotctl.messages.control import NavigationState
from robotctl.messages.estimation import (
    CameraView,
    LocalisationState,
    SeenMarker,
    SeenObstacle,
    SlamGraph,
)
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount

MOVING_NS: Final = 600_000_000
"""Lifetime of moving obstacles [ns], three views of the plan."""
SLOW_NS: Final = 500_000_000
"""Period of drawings of values that are also logged as numbers [ns]."""
ELLIPSE: Final = 2.4477
"""Half axes over sigma of the ellipse that holds 95 % of a normal distribution of the plane."""
_ARC_STEPS: Final = 4

# Colours of Okabe and Ito, which colour-blind people can distinguish.
_BLUE: Final = Color(0.0, 0.45, 0.7, 0.9)
SKY: Final = Color(0.34, 0.71, 0.91, 0.8)
FAINT: Final = Color(0.34, 0.71, 0.91, 0.2)
_GREEN: Final = Color(0.0, 0.62, 0.45, 0.9)
_ORANGE: Final = Color(0.9, 0.62, 0.0, 0.5)
VERMILION: Final = Color(0.84, 0.37, 0.0, 0.8)
_HAZE: Final = Color(0.0, 0.45, 0.7, 0.3)


def point(x_m: float, y_m: float, z_m: float = 0.0) -> Vector3:
    """Return a point rounded to the millimetre; more digits would dominate the compressed log."""
    return Vector3(round(x_m, 3), round(y_m, 3), round(z_m, 3))


def _at(x_m: float, y_m: float, theta_rad: float = 0.0, z_m: float = 0.0) -> Pose:
    return Pose(point(x_m, y_m, z_m), turned(round(theta_rad, 3)) if theta_rad else UPRIGHT)


def cone(mount: SonarMount, range_m: float, half_rad: float, color: Color) -> LinePrimitive:
    """Return the outline of a sonar's cone up to a range."""
    points = [Vector3(0.0, 0.0)]
    for step in range(_ARC_STEPS + 1):
        angle_rad = half_rad * (2.0 * step / _ARC_STEPS - 1.0)
        points.append(point(range_m * math.cos(angle_rad), range_m * math.sin(angle_rad)))
    pose = _at(mount.x_m, mount.y_m, mount.heading_rad)
    return line(LineType.LINE_LOOP, tuple(points), color, pose)


def outline(wall_ns: int, body: Footprint) -> SceneUpdate:
    """Return the robot's body, with a nose."""
    half_m = 0.5 * (body.left_m + body.right_m)
    nose = [(body.front_m, half_m), (body.front_m + 0.5 * half_m, 0.0), (body.front_m, -half_m)]
    drawn = [*((LineType.LINE_LOOP, each) for each in body.outlines), (LineType.LINE_STRIP, nose)]
    lines = tuple(
        line(kind, tuple(itertools.starmap(point, corners)), _BLUE) for kind, corners in drawn
    )
    return draw(
        SceneEntity(time_of(wall_ns), BASE, "outline", lasting(0), frame_locked=True, lines=lines)
    )


def ellipse(wall_ns: int, state: LocalisationState, pose: SE2) -> SceneEntity | None:
    """Return the ellipse that holds the robot with 95 %; None without a covariance.

    Its half axes are the eigenvectors of the covariance of x and y, in closed form.
    """
    if len(state.covariance) != 6 or not all(map(math.isfinite, state.covariance)):
        return None
    xx, xy, _, yy, *_ = state.covariance
    mean, spread = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    major_m, minor_m = (
        2.0 * ELLIPSE * math.sqrt(max(each, 0.0)) for each in (mean + spread, mean - spread)
    )
    cylinder = CylinderPrimitive(
        _at(pose.x_m, pose.y_m, 0.5 * math.atan2(2.0 * xy, xx - yy)),
        Vector3(round(major_m, 4), round(minor_m, 4), 0.01),
        1.0,
        1.0,
        _HAZE if state.status is LocalisationStatus.LOCALISED else _ORANGE,
    )
    return SceneEntity(
        time_of(wall_ns), WORLD, "covariance", lasting(0), frame_locked=False, cylinders=(cylinder,)
    )  # fmt: skip


def goal_text(state: NavigationState) -> str:
    """Return the name of the mission item that the robot drives to; empty without a mission."""
    return state.item_name if state.mission and not state.mission_completed else ""


def goals(wall_ns: int, state: NavigationState) -> SceneUpdate:
    """Return the goal as a pole with the name of the mission's item, and home as an arrow."""
    stamp, forever = time_of(wall_ns), lasting(0)
    entities = []
    if state.goal is not None:
        x_m, y_m = state.goal
        pole = CylinderPrimitive(_at(x_m, y_m, z_m=0.25), Vector3(0.1, 0.1, 0.5), 0.2, 1.0, _GREEN)
        texts = (label(_at(x_m, y_m, z_m=0.65), _GREEN, goal_text(state) or "goal"),)
        entities.append(
            SceneEntity(
                stamp, WORLD, "goal", forever, frame_locked=False, cylinders=(pole,), texts=texts
            )
        )
    if state.home is not None:
        x_m, y_m, theta_rad = state.home
        arrows = (_arrow(_at(x_m, y_m, theta_rad), 0.3, _ORANGE),)
        texts = (label(_at(x_m, y_m, z_m=0.2), _ORANGE, "home"),)
        entities.append(
            SceneEntity(
                stamp, WORLD, "home", forever, frame_locked=False, arrows=arrows, texts=texts
            )
        )
    before = erase(wall_ns).deletions
    return SceneUpdate(before, tuple(entities))


def _arrow(pose: Pose, length_m: float, color: Color) -> ArrowPrimitive:
    head_m = 0.3 * length_m
    return ArrowPrimitive(pose, length_m - head_m, 0.03, head_m, 0.08, color)


def moving_thing(
    wall_ns: int, number: int, x_m: float, y_m: float, vx: float, vy: float, radius_m: float
) -> SceneEntity:
    """Return a moving obstacle as a cylinder of a person's height, and its position in a second."""
    speed = math.hypot(vx, vy)
    body = CylinderPrimitive(
        _at(x_m, y_m, z_m=0.85),
        Vector3(round(2.0 * radius_m, 3), round(2.0 * radius_m, 3), 1.7),
        1.0,
        1.0,
        _ORANGE,
    )
    arrow = _arrow(_at(x_m, y_m, math.atan2(vy, vx), 0.1), round(speed, 3), VERMILION)
    return SceneEntity(
        time_of(wall_ns),
        WORLD,
        f"moving {number}",
        lasting(MOVING_NS),
        frame_locked=False,
        metadata=(
            KeyValuePair("vx_m_s", f"{vx:.3f}"),
            KeyValuePair("vy_m_s", f"{vy:.3f}"),
            KeyValuePair("radius_m", f"{radius_m:.3f}"),
        ),
        arrows=(arrow,),
        cylinders=(body,),
    )


def seen_things(wall_ns: int, view: CameraView) -> SceneEntity:
    """Return the end of the floor as lines, objects as cylinders, markers as upright boxes."""
    markers = [_marker(each) for each in view.markers]
    return SceneEntity(
        time_of(wall_ns),
        BASE,
        "seen",
        lasting(2 * SLOW_NS),
        frame_locked=False,
        cubes=tuple(CubePrimitive(pose, Vector3(0.01, 0.15, 0.15), _GREEN) for pose, _ in markers),
        cylinders=tuple(_thing(view, each) for each in view.obstacles),
        lines=tuple(line(LineType.LINE_STRIP, each, SKY) for each in _floor_ends(view)),
        texts=tuple(label(pose, _GREEN, text) for pose, text in markers),
    )


def _floor_ends(view: CameraView) -> Iterator[tuple[Vector3, ...]]:
    """Yield lines of the floor's end seen by neighbouring beams, from gap to gap."""
    points: list[Vector3] = []
    for angle_rad, range_m in (*zip(view.angles_rad, view.ranges_m, strict=True), (0.0, math.nan)):
        if math.isfinite(range_m):
            x_m, y_m = range_m * math.cos(angle_rad), range_m * math.sin(angle_rad)
            points.append(point(view.x_m + x_m, view.y_m + y_m))
        else:
            if len(points) > 1:
                yield tuple(points)
            points = []


def _thing(view: CameraView, seen: SeenObstacle) -> CylinderPrimitive:
    """Return an object as a cylinder through the seen foot point on the robot's side."""
    away_rad = math.atan2(seen.y_m - view.y_m, seen.x_m - view.x_m)
    radius_m = 0.5 * seen.width_m
    x_m, y_m = (
        seen.x_m + radius_m * math.cos(away_rad),
        seen.y_m + radius_m * math.sin(away_rad),
    )
    size = Vector3(round(seen.width_m, 3), round(seen.width_m, 3), 0.3)
    return CylinderPrimitive(_at(x_m, y_m, z_m=0.15), size, 1.0, 1.0, VERMILION)


def _marker(seen: SeenMarker) -> tuple[Pose, str]:
    return _at(seen.x_m, seen.y_m, seen.theta_rad, 0.15), str(seen.number)


def linked_places(wall_ns: int, graph: SlamGraph) -> SceneEntity:
    """Return the keyframes of a graph as the ends of its links."""
    numbers = array("f", graph.poses)
    places = tuple(map(point, numbers[0::3], numbers[1::3]))
    lines = tuple(
        msgspec.structs.replace(
            line(LineType.LINE_LIST, places, color), indices=tuple(array("i", pairs))
        )
        for pairs, color in ((graph.links, SKY), (graph.loops, VERMILION))
    )
    return SceneEntity(
        time_of(wall_ns), WORLD, "slam_graph", lasting(0), frame_locked=False, lines=lines
    )
