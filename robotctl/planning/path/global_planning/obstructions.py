"""Why there is no path: a blocked end, a narrow passage, or unknown cells."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]

from robotctl.model.geometry.points import moved
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.global_planning.plan import PlanFailure, Point, Reason
from robotctl.planning.path.global_planning.widest_way import widest_way


def blocked_ends(space: PlanningMap, start: SE2, goal: SE2) -> PlanFailure | None:
    """Return why a robot cannot stand at one of two poses of `world`; None if it can."""
    return _blocked_end(space, "start", start) or _blocked_end(space, "goal", goal)


def blocked_goal(space: PlanningMap, goal: SE2) -> PlanFailure | None:
    """Return why a robot cannot stand at a goal in `world`; None if it can."""
    return _blocked_end(space, "goal", goal)


def _blocked_end(space: PlanningMap, name: str, pose: SE2) -> PlanFailure | None:
    """Return why a robot cannot stand at a pose that is called start or goal."""
    here = space.to_cells(pose)
    place = (pose.x_m, pose.y_m)
    said = f"the {name} at x {pose.x_m:.2f} m, y {pose.y_m:.2f} m"
    if not space.contains(here.x_m, here.y_m):
        rows, columns = space.shape
        side_m = space.grid.resolution_m
        reason = Reason.START_OFF_MAP if name == "start" else Reason.GOAL_OFF_MAP
        text = f"{said} lies off the map of {columns * side_m:.2f} m x {rows * side_m:.2f} m"
        return PlanFailure(reason, text, place)
    if space.has_room_at(pose):
        return None
    reason = Reason.START_BLOCKED if name == "start" else Reason.GOAL_BLOCKED
    cell = math.floor(here.y_m), math.floor(here.x_m)
    if space.blocked[cell]:
        what = f"lies in {_kind(space, cell)}"
        if not space.obstacle[cell]:
            what = "lies where the map knows nothing"
    else:
        what = _contact(space, here)
    return PlanFailure(reason, f"{said} {what}{_free_beside(space, here)}", place)


def _contact(space: PlanningMap, here: SE2) -> str:
    """Say what a body touches, the nearest of it to `base`: a blocked cell, or the map's edge."""
    rows, columns = space.shape
    points = moved(here, space.samples)
    on_map = np.clip(points, 0.0, (columns, rows))
    cells = np.floor(points).astype(np.int64)[:, ::-1]
    is_off = np.any((cells < 0) | (cells >= space.shape), axis=1)
    cells = np.clip(cells, 0, np.array(space.shape) - 1)
    hits: NDArray[np.bool_] = is_off | space.blocked[tuple(cells.T)]
    # From `base` to the nearest point of each cell, or to where the body leaves the map.
    nearest_in = np.clip((here.x_m, here.y_m), cells[:, ::-1], cells[:, ::-1] + 1.0)
    away = np.hypot(*(np.where(is_off[:, None], on_map, nearest_in) - (here.x_m, here.y_m)).T)
    hit = int(np.argmin(np.where(hits, away, math.inf)))
    cell = int(cells[hit, 0]), int(cells[hit, 1])
    x_m, y_m = _centre(space, cells[hit])
    kind = _kind(space, cell)
    if is_off[hit]:
        kind = "the edge of the map"
        ((x_m, y_m, _),) = space.to_world(np.array([[*on_map[hit], 0.0]])).tolist()
    return (
        f"is {away[hit] * space.grid.resolution_m:.2f} m from {kind} at x {x_m:.2f} m, "
        f"y {y_m:.2f} m, and the robot's body reaches {space.footprint.reach_m:.2f} m"
    )


def _kind(space: PlanningMap, cell: tuple[int, int]) -> str:
    """Say what blocks a cell."""
    if not space.obstacle[cell]:
        return "unknown space"
    return space.closed.what_closes(space.grid, cell) or "an obstacle"


def no_path(space: PlanningMap, start: SE2, goal: SE2, expanded: int) -> PlanFailure:
    """Return why no path joins two ends at which the robot can stand."""
    ends = _cell(space, (start.x_m, start.y_m)), _cell(space, (goal.x_m, goal.y_m))
    widest = widest_way(space.clearance, *ends)
    if widest is not None:
        width, place = widest[0], np.array(widest[1])
        x_m, y_m = _centre(space, place)
        side_m = space.grid.resolution_m
        has_m, needs_m = (
            2.0 * _half_width(space, place, width) * side_m,
            2.0 * space.footprint.inscribed_m,
        )
        place_m = f"at x {x_m:.2f} m, y {y_m:.2f} m"
        if has_m < needs_m:
            text = (
                f"no passage is wide enough: the widest way is {has_m:.2f} m wide {place_m}, and "
                f"the robot needs {needs_m:.2f} m: {needs_m - has_m:.2f} m are missing"
            )
            return PlanFailure(Reason.NO_PASSAGE, text, (x_m, y_m), expanded)
        text = (
            "no path was found on which the body has room to turn; the widest way is "
            f"{has_m:.2f} m wide {place_m}"
        )
        return PlanFailure(Reason.NOT_FOUND, text, (x_m, y_m), expanded)
    if not space.through_unknown:
        labels, _ = ndimage.label(~space.obstacle)
        if labels[ends[0]] == labels[ends[1]]:
            unknown = space.blocked & ~space.obstacle
            x_m, y_m = _entry(space, unknown, ends)
            text = (
                "the goal can be reached only through what the map does not know, from about "
                f"x {x_m:.2f} m, y {y_m:.2f} m on"
            )
            return PlanFailure(Reason.ONLY_THROUGH_UNKNOWN, text, (x_m, y_m), expanded)
    return _enclosed(space, {"start": ends[0], "goal": ends[1]}, expanded)


def _enclosed(space: PlanningMap, ends: dict[str, tuple[int, int]], expanded: int) -> PlanFailure:
    """Return the failure for the end in a closed area, the smaller of the two."""
    labels, _ = ndimage.label(~space.blocked)
    sizes = np.bincount(labels.ravel())
    name = min(ends, key=lambda each: int(sizes[labels[ends[each]]]))
    area_m2 = float(sizes[labels[ends[name]]]) * space.grid.resolution_m**2
    text = f"the {name} lies in an area of {area_m2:.1f} m2 that is closed all around"
    text += _closed_by(space, labels == labels[ends[name]])
    place = _centre(space, np.array(ends[name]))
    return PlanFailure(Reason.NO_PASSAGE, text, place, expanded)


def _closed_by(space: PlanningMap, area: NDArray[np.bool_]) -> str:
    """Say which zone, or the fence, closes an area, and where; empty: none does."""
    closed = space.closed.cells(space.grid) & ndimage.binary_dilation(area)
    if not closed.any():
        return ""
    row, column = np.argwhere(closed)[np.count_nonzero(closed) // 2].tolist()
    x_m, y_m = _centre(space, np.array([row, column]))
    what = space.closed.what_closes(space.grid, (row, column))
    return f", at x {x_m:.2f} m, y {y_m:.2f} m by {what}" if what else ""


def nearest(space: PlanningMap, wanted: NDArray[np.bool_], here: SE2) -> Point:
    """Return the centre in `world` [m] of the wanted cell nearest to a point of the map's frame."""
    cells = np.argwhere(wanted)
    away = (cells[:, 1] + 0.5 - here.x_m) ** 2 + (cells[:, 0] + 0.5 - here.y_m) ** 2
    return _centre(space, cells[int(np.argmin(away))])


def _half_width(space: PlanningMap, place: NDArray[np.int64], width: float) -> float:
    """Return half the width of a passage whose middle may be between the centres of cells."""
    radius = math.ceil(width) + 2
    low = np.maximum(place - radius, -1)
    near = np.argwhere(np.pad(space.blocked, 1, constant_values=True)[
        low[0] + 1 : place[0] + radius + 2, low[1] + 1 : place[1] + radius + 2
    ]) + low  # fmt: skip
    widest = width
    for down in (-0.5, 0.0, 0.5):
        for right in (-0.5, 0.0, 0.5):
            away = np.maximum(np.abs(near - place - (down, right)) - 0.5, 0.0)
            widest = max(widest, float(np.hypot(*away.T).min(initial=math.inf)))
    return min(widest, width + 0.5)


def _free_beside(space: PlanningMap, here: SE2) -> str:
    """Say where the robot could stand instead."""
    free = space.clearance >= space.circumscribed
    if not free.any():
        return "; there is no place on this map where the robot can stand and turn"
    x_m, y_m = nearest(space, free, here)
    return f"; the nearest place with room for it is x {x_m:.2f} m, y {y_m:.2f} m"


def _entry(
    space: PlanningMap, unknown: NDArray[np.bool_], ends: tuple[tuple[int, int], tuple[int, int]]
) -> Point:
    """Return the unknown cell nearest to the goal, next to cells reachable from the start."""
    labels, _ = ndimage.label(~space.blocked)
    reached = labels == labels[ends[0]]
    edge = np.argwhere(unknown & ndimage.binary_dilation(reached))
    if not len(edge):
        edge = np.argwhere(unknown)
    away = ((edge - np.array(ends[1])) ** 2).sum(axis=1)
    return _centre(space, edge[int(np.argmin(away))])


def _cell(space: PlanningMap, point: Point) -> tuple[int, int]:
    """Return row and column of a point of `world` [m]."""
    here = space.to_cells(SE2(*point, 0.0))
    return math.floor(here.y_m), math.floor(here.x_m)


def _centre(space: PlanningMap, cell: NDArray[np.int64]) -> Point:
    """Return the centre of a cell in `world` [m]."""
    x_m, y_m = space.grid.centre_of(np.asarray(cell, dtype=np.int64)[np.newaxis])[0].tolist()
    return x_m, y_m
