"""Inner loops of the layered map: cells that sensors mark and clear, each in a layer of its own.

Coordinates are in cells of the map: x along the columns, y along the rows, cell (r, c) covers
[c, c + 1) x [r, r + 1). A layer counts evidence in each cell: an echo adds to it, and a beam that
passes takes one away. The cell is marked from a number on, and stays so until nothing is left.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import borrows, compiled
from robotctl.model.grid_map import OCCUPIED
from robotctl.planning.map.clearance import TILE


class Cells(NamedTuple):
    """The map that all layers share, (rows, columns) each."""

    base: NDArray[np.int8]
    """State by the map and its zones; 0 where a beam has passed unknown cells."""
    live: NDArray[np.int8]
    """The same with all that is marked."""
    obstacle: NDArray[np.bool_]
    blocked: NDArray[np.bool_]
    marks: NDArray[np.uint8]
    """A bit for each layer that has marked the cell."""
    from_static: NDArray[np.float32]
    """Distance from the cell's centre to that of the nearest obstacle in the map itself [cells]."""
    stale: NDArray[np.bool_]
    """Tiles whose clearance is out of date."""
    reach: int
    """How far a change of a cell changes that [cells]."""
    occupied: int
    """Cells are obstacles from this probability on [%]."""
    through_unknown: bool


class Layer(NamedTuple):
    """Marks of one kind of sensor."""

    bit: int
    """In `Cells.marks`."""
    evidence: NDArray[np.uint8]
    """(rows, columns)."""
    stamp_ns: NDArray[np.int64]
    """When each was last seen, (rows, columns)."""
    since_ns: NDArray[np.int64]
    """Since when each has had evidence, (rows, columns)."""
    listed: NDArray[np.int32]
    """The cells with evidence, by their number along the rows, and some that had."""
    in_list: NDArray[np.int64]
    """(1,): how many of them there are."""
    gain: int
    """Evidence of an echo."""
    needed: int
    """Evidence that marks a cell."""
    most: int


def make_layer(shape: tuple[int, int], bit: int, *, gain: int, needed: int, most: int) -> Layer:
    """Return a layer without evidence."""
    return Layer(
        bit,
        np.zeros(shape, np.uint8),
        np.zeros(shape, np.int64),
        np.zeros(shape, np.int64),
        np.empty(shape[0] * shape[1], np.int32),
        np.zeros(1, np.int64),
        gain,
        needed,
        most,
    )


@compiled
@borrows
def _is_inside(cells: Cells, row: int, column: int) -> bool:
    rows, columns = cells.live.shape
    return bool(0 <= row < rows and 0 <= column < columns)


@compiled
@borrows
def _note(cells: Cells, row: int, column: int) -> None:
    """Note that the clearance around a cell has to be worked out again."""
    down, right = cells.stale.shape
    first, last = max(row - cells.reach, 0) // TILE, min((row + cells.reach) // TILE, down - 1)
    left, end = max(column - cells.reach, 0) // TILE, min((column + cells.reach) // TILE, right - 1)
    cells.stale[first : last + 1, left : end + 1] = True


@compiled
@borrows
def _mark(cells: Cells, layer: Layer, row: int, column: int, now_ns: int) -> None:
    """Add the evidence of an echo."""
    had = int(layer.evidence[row, column])
    if had == 0:
        layer.listed[layer.in_list[0]] = row * cells.live.shape[1] + column
        layer.in_list[0] += 1
        layer.since_ns[row, column] = now_ns
    has = min(had + layer.gain, layer.most)
    layer.evidence[row, column] = has
    layer.stamp_ns[row, column] = now_ns
    if has >= layer.needed:
        cells.marks[row, column] |= layer.bit
        cells.live[row, column] = OCCUPIED
        was_blocked = cells.blocked[row, column]
        cells.obstacle[row, column] = cells.blocked[row, column] = True
        if not was_blocked:
            _note(cells, row, column)


@compiled
@borrows
def _empty(cells: Cells, layer: Layer, row: int, column: int) -> None:
    """Take all evidence of a layer from a cell."""
    layer.evidence[row, column] = 0
    cells.marks[row, column] &= 255 - layer.bit
    if cells.marks[row, column] == 0:
        base = cells.base[row, column]
        cells.live[row, column] = base
        obstacle = base >= cells.occupied
        blocked = obstacle or (base < 0 and not cells.through_unknown)
        was_blocked = cells.blocked[row, column]
        cells.obstacle[row, column] = obstacle
        cells.blocked[row, column] = blocked
        if blocked != was_blocked:
            _note(cells, row, column)


@compiled
@borrows
def _pass(cells: Cells, layer: Layer, row: int, column: int, now_ns: int) -> None:
    """Take the evidence of a beam that passed a cell."""
    if layer.evidence[row, column] > 0 and layer.stamp_ns[row, column] != now_ns:
        layer.evidence[row, column] -= 1
        if layer.evidence[row, column] == 0:
            _empty(cells, layer, row, column)


@compiled
@borrows
def fade(cells: Cells, layer: Layer, oldest_ns: int) -> None:
    """Empty what was last seen before a time; it comes before all that marks cells."""
    columns, kept = cells.live.shape[1], 0
    for i in range(layer.in_list[0]):
        row, column = layer.listed[i] // columns, layer.listed[i] % columns
        if layer.evidence[row, column] == 0:
            continue
        if layer.stamp_ns[row, column] < oldest_ns:
            _empty(cells, layer, row, column)
        else:
            layer.listed[kept] = layer.listed[i]
            kept += 1
    layer.in_list[0] = kept


@compiled
@borrows
def empty_disc(cells: Cells, layer: Layer, x: float, y: float, radius: float) -> None:
    """Empty the cells of a disc."""
    for row in range(math.floor(y - radius), math.floor(y + radius) + 1):
        for column in range(math.floor(x - radius), math.floor(x + radius) + 1):
            if (
                _is_inside(cells, row, column)
                and (column + 0.5 - x) ** 2 + (row + 0.5 - y) ** 2 <= radius * radius
                and layer.evidence[row, column] > 0
            ):
                _empty(cells, layer, row, column)


@compiled
@borrows
def empty_unseen(
    cells: Cells, layer: Layer, x: float, y: float, radius: float, now_ns: int
) -> None:
    """Empty what lies in a disc and was not seen just now."""
    columns = cells.live.shape[1]
    for i in range(layer.in_list[0]):
        row, column = layer.listed[i] // columns, layer.listed[i] % columns
        near = (column + 0.5 - x) ** 2 + (row + 0.5 - y) ** 2 <= radius * radius
        if near and layer.stamp_ns[row, column] != now_ns:
            _empty(cells, layer, row, column)


@compiled
@borrows
def mark_points(
    cells: Cells,
    layer: Layer,
    points: NDArray[np.float64],
    agree: NDArray[np.float64],
    moving: NDArray[np.float64],
    gap: float,
    now_ns: int,
) -> None:
    """Mark points in the order of their beams, and what lies between two that are near.

    Parameters
    ----------
    points
        (n, 2) x, y [cells]; nan: none.
    agree
        (n,) an obstacle of the map within this explains the point [cells].
    moving
        (k, 3) x, y and radius of discs whose points are not marked [cells].
    gap
        The robot does not pass between two points that are no farther apart than this [cells].
    """
    before = False
    for i in range(len(points)):
        x, y = points[i]
        row, column = 0, 0
        counts = not math.isnan(x)
        if counts:
            row, column = math.floor(y), math.floor(x)
            counts = (
                _is_inside(cells, row, column)
                and cells.from_static[row, column] > agree[i]
                and not _is_in_disc(moving, x, y)
            )
        if counts:
            _mark(cells, layer, row, column, now_ns)
            if before:
                _mark_between(cells, layer, points[i - 1], points[i], gap, now_ns)
        before = counts


@compiled
@borrows
def _is_in_disc(discs: NDArray[np.float64], x: float, y: float) -> bool:
    for k in range(len(discs)):
        if (x - discs[k, 0]) ** 2 + (y - discs[k, 1]) ** 2 <= discs[k, 2] ** 2:
            return True
    return False


@compiled
@borrows
def _mark_between(
    cells: Cells,
    layer: Layer,
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    gap: float,
    now_ns: int,
) -> None:
    """Mark the cells between two points, if the robot is too wide to pass there."""
    length = math.hypot(b[0] - a[0], b[1] - a[1])
    if length > gap:
        return
    steps = math.ceil(length)
    for k in range(1, steps):
        x, y = a[0] + (b[0] - a[0]) * k / steps, a[1] + (b[1] - a[1]) * k / steps
        row, column = math.floor(y), math.floor(x)
        if layer.stamp_ns[row, column] != now_ns or layer.evidence[row, column] == 0:
            _mark(cells, layer, row, column, now_ns)


@compiled
@borrows
def clear_beams(
    cells: Cells,
    layer: Layer,
    x: float,
    y: float,
    away: NDArray[np.float64],
    lengths: NDArray[np.float64],
    now_ns: int,
) -> None:
    """Count for each cell the beams that pass it, except where an echo came from just now.

    Parameters
    ----------
    x, y
        The sensor [cells].
    away
        (n, 2) cos and sin of the directions.
    lengths
        (n,) how far each goes [cells]; not above 0, or nan: it does not count.
    """
    for i in range(len(lengths)):
        if lengths[i] > 0.0:
            _walk(cells, layer, x, y, away[i, 0], away[i, 1], lengths[i], now_ns)


@compiled
@borrows
def _walk(
    cells: Cells,
    layer: Layer,
    x: float,
    y: float,
    cos: float,
    sin: float,
    length: float,
    now_ns: int,
) -> None:
    """Visit a cell of each row of a steep beam, of each column of a flat one.

    A beam that passes what stands there may be wrong: it makes that weaker, as others did or will,
    and until it is gone nothing becomes known behind it.
    """
    rows, columns = cells.live.shape
    if not (0.0 <= x < columns and 0.0 <= y < rows):
        return
    step = 1.0 / max(abs(cos), abs(sin))
    right, up = step * cos, step * sin
    # The beam ends where it would leave the map.
    length = min(length, ((columns - 1e-6 if cos > 0.0 else 0.0) - x) / cos if cos else np.inf)
    length = min(length, ((rows - 1e-6 if sin > 0.0 else 0.0) - y) / sin if sin else np.inf)
    learns = True
    for k in range(int(length / step) + 1):
        row, column = int(y + k * up), int(x + k * right)
        if cells.live[row, column] != 0:
            _pass(cells, layer, row, column, now_ns)
            if cells.marks[row, column] & layer.bit or cells.from_static[row, column] == 0:
                learns = False
            if learns and cells.base[row, column] < 0:
                _learn_free(cells, row, column)


@compiled
@borrows
def learn_free(cells: Cells, places: NDArray[np.float64]) -> None:
    """Note that cells in which places (n, 2) lie are free, unless the map knows better."""
    for i in range(len(places)):
        row, column = math.floor(places[i, 1]), math.floor(places[i, 0])
        if _is_inside(cells, row, column) and cells.base[row, column] < 0:
            _learn_free(cells, row, column)


@compiled
@borrows
def _learn_free(cells: Cells, row: int, column: int) -> None:
    """Note that a cell of which the map knows nothing is free."""
    cells.base[row, column] = 0
    if cells.marks[row, column] == 0:
        cells.live[row, column] = 0
        if cells.blocked[row, column]:
            cells.blocked[row, column] = False
            _note(cells, row, column)


@compiled
@borrows
def _has_stood(cells: Cells, layer: Layer, row: int, column: int, stood_ns: int) -> bool:
    """Return whether a cell has been marked by a layer since a time, or by another one."""
    if cells.marks[row, column] == 0:
        return False
    return bool(cells.marks[row, column] != layer.bit or layer.since_ns[row, column] <= stood_ns)


@compiled
@borrows
def see_cone(
    cells: Cells,
    layer: Layer,
    x: float,
    y: float,
    heading: float,
    half_width: float,
    free: float,
    echo: float,
    band: float,
    agree: float,
    now_ns: int,
    stood_ns: int,
) -> bool:
    """Take a sonar's reading: its cone is free up to a distance, and an arc may hold the obstacle.

    The arc is marked only where neither the map nor another layer has anything on it: an echo from
    a door's post must not close the door. Returns whether the echo is from something that has stood
    there for a while: of the map, or marked, within `agree`.

    Parameters
    ----------
    x, y, heading, half_width
        The sonar and its cone [cells, rad].
    free
        Up to here the cone is free [cells].
    echo, band
        The arc that may be marked, and half its depth [cells]; nan: none.
    agree
        An obstacle of the map within this explains the echo [cells].
    stood_ns
        What was marked before this has stood there [ns].
    """
    far = free if math.isnan(echo) else max(free, echo + agree)
    cone = _cone(cells, x, y, heading, half_width, far)
    stands, explained = _look_into(cells, layer, cone, free, echo, band, agree, now_ns, stood_ns)
    if not explained:
        _mark_arc(cells, layer, cone, echo, band, now_ns)
    return stands or explained


class _Cone(NamedTuple):
    """A sonar's cone, and the cells around it."""

    x: float
    y: float
    c: float
    s: float
    """Cosine and sine of its heading."""
    least: float
    """Cosine of half its width."""
    rows: tuple[int, int]
    columns: tuple[int, int]


@compiled
@borrows
def _cone(cells: Cells, x: float, y: float, heading: float, half_width: float, far: float) -> _Cone:
    """Return the cone up to a distance."""
    c, s = math.cos(heading), math.sin(heading)
    wide = far * math.sin(half_width)
    # The cone lies between its axis and half its width to each side of that.
    left, right = min(0.0, far * c) - wide, max(0.0, far * c) + wide
    low, high = min(0.0, far * s) - wide, max(0.0, far * s) + wide
    rows, columns = cells.live.shape
    return _Cone(
        x,
        y,
        c,
        s,
        math.cos(half_width),
        (max(math.floor(y + low), 0), min(math.floor(y + high) + 1, rows)),
        (max(math.floor(x + left), 0), min(math.floor(x + right) + 1, columns)),
    )


@compiled
def _distance_in(cone: _Cone, row: int, column: int) -> float:
    """Return how far the centre of a cell is from the sonar; -1: it lies outside of the cone."""
    dx, dy = column + 0.5 - cone.x, row + 0.5 - cone.y
    distance = math.hypot(dx, dy)
    return distance if cone.c * dx + cone.s * dy >= cone.least * distance else -1.0


@compiled
@borrows
def _look_into(
    cells: Cells,
    layer: Layer,
    cone: _Cone,
    free: float,
    echo: float,
    band: float,
    agree: float,
    now_ns: int,
    stood_ns: int,
) -> tuple[bool, bool]:
    """Clear what is nearer than the echo; return whether that is from what stands or is known."""
    stands = explained = math.isnan(echo)
    for row in range(cone.rows[0], cone.rows[1]):
        for column in range(cone.columns[0], cone.columns[1]):
            distance = _distance_in(cone, row, column)
            if distance < 0.0:
                continue
            near = abs(distance - echo) <= agree
            stands |= near and _has_stood(cells, layer, row, column, stood_ns)
            if distance < free:
                _pass(cells, layer, row, column, now_ns)
            elif abs(distance - echo) <= band:
                others = cells.marks[row, column] & (255 - layer.bit)
                explained |= others != 0 or cells.from_static[row, column] <= agree
    return stands, explained


@compiled
@borrows
def _mark_arc(
    cells: Cells, layer: Layer, cone: _Cone, echo: float, band: float, now_ns: int
) -> None:
    """Mark the cells from which the echo may be."""
    for row in range(cone.rows[0], cone.rows[1]):
        for column in range(cone.columns[0], cone.columns[1]):
            distance = _distance_in(cone, row, column)
            if distance >= 0.0 and abs(distance - echo) <= band:
                _mark(cells, layer, row, column, now_ns)
