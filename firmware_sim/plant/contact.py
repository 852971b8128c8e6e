"""Contacts of wheels with the floor and of the outline with walls, solved together as impulses.

A contact is a row: a unit direction d at a point p, relative to the centre of mass, in base. Its
impulse λ changes the body's velocity by M⁻¹Jᵀλ, J = (dx, dy, px·dy - py·dx), and the speed of a
wheel whose rim moves along it by -roll · r λ / inertia. The first rows are the grips of the wheels
on the floor (`firmware_sim.config.drives.chassis`); those of walls follow in pairs: normal, along.

A tyre's force is its slip velocity over a compliance, up to friction times load (a regularised
Coulomb law, taken at the end of the step, hence stable for any stiffness). A roller's drag is such
a force without a limit, whose compliance makes it the drag at the speed of the step before. A wall
only pushes, just enough to keep the gap from closing within the step. Method: time stepping with
impulses after Moreau; projected Gauss-Seidel where a limit is reached.
"""

from __future__ import annotations

import math

import numpy as np

from firmware_sim.config.drives.chassis import MAX_GRIPS, Chassis, Hold
from firmware_sim.plant.plant_state import DT_S
from native_kernels.compiled import borrows, compiled

# Columns of a row.
JX, JY, JW, TARGET, IMPULSE, LIMIT, SOFT, SCALE, LAST = range(9)
# Columns of a grip alone.
WHEEL, ROLL, LOAD, HOLD, SPENT_FROM, SPENT_TO, STEERED, AT_X, AT_Y, ALONG_X, ALONG_Y = range(9, 20)
MATRIX = 20
"""First column of a grip's row of the matrix that `solve_grips` eliminates."""
COLUMNS = MATRIX + MAX_GRIPS

ALONE, FIRST, SECOND, ROLLER = map(int, Hold)
MAX_WALLS = 8
"""Maximum wall contacts of each piece; each has a row along the normal and one along the wall."""
SLOP_M = 1.0e-4
"""Gap left to a wall [m]."""
SWEEPS = 40
"""Maximum sweeps over the rows, for contacts with walls and exceeded limits."""
CONVERGED_M_S = 1.0e-6


def contact_rows(chassis: Chassis, p: np.ndarray, pieces: int) -> np.ndarray:
    """Rows of all grips, and room for the rows of walls of a body of so many pieces."""
    rows = np.zeros((len(chassis.grips) + 2 * MAX_WALLS * pieces, COLUMNS))
    for row, grip in zip(rows, chassis.grips, strict=False):
        dx, dy = grip.along
        px, py = grip.x_m - float(p["com_x"][0]), grip.y_m - float(p["com_y"][0])
        row[JX], row[JY], row[JW] = dx, dy, px * dy - py * dx
        row[ALONG_X], row[ALONG_Y], row[AT_X], row[AT_Y] = dx, dy, px, py
        row[WHEEL] = -1.0 if grip.wheel is None else grip.wheel
        row[ROLL], row[STEERED], row[HOLD] = grip.roll, grip.steered, grip.hold
        row[SPENT_FROM], row[SPENT_TO] = grip.spent_by
        press(row, grip.load_n, p)
    return rows


def press(row: np.ndarray, load_n: float, p: np.ndarray) -> None:
    """Set the bound on the force of a grip: the load on it, or the drag of its roller [N]."""
    row[LOAD] = load_n
    row[LIMIT] = float(p["friction"][0]) * load_n * DT_S


@compiled
@borrows
def set_grips(body: np.ndarray, axes: np.ndarray, p: np.ndarray, rows: np.ndarray) -> None:
    """Turn the grips that steer, and set the compliance of all."""
    b, c = body[0], p[0]
    count = int(c.grips)
    if c.steers > 0.0:
        steer = b.steering + c.steering_offset
        cos, sin = math.cos(steer), math.sin(steer)
        for i in range(count):
            if rows[i, STEERED] > 0.0:
                dx, dy = rows[i, ALONG_X], rows[i, ALONG_Y]
                dx, dy = dx * cos - dy * sin, dx * sin + dy * cos
                put_row(rows, i, dx, dy, rows[i, AT_X], rows[i, AT_Y])
    speed = abs(b.vx) + abs(b.vy) + abs(b.omega) * c.span
    slip = (c.slip_speed + c.slip_ratio * speed) / (c.friction * DT_S)
    for i in range(count):
        give = slip
        if rows[i, HOLD] == ROLLER:
            give = max(abs(slip_speed(body, axes, rows, i)), c.slip_speed) / DT_S
        rows[i, SOFT] = give / max(rows[i, LOAD], 1.0e-3)


@compiled
@borrows
def put_row(rows: np.ndarray, i: int, dx: float, dy: float, px: float, py: float) -> None:
    """Write direction and lever of a row."""
    rows[i, JX] = dx
    rows[i, JY] = dy
    rows[i, JW] = px * dy - py * dx


@compiled
@borrows
def solve_grips(body: np.ndarray, axes: np.ndarray, p: np.ndarray, rows: np.ndarray) -> bool:
    """Impulses of the grips without limits, by elimination; False if one is exceeded."""
    count = int(p[0].grips)
    fill_matrix(body, axes, p, rows)
    for k in range(count - 1):
        for i in range(k + 1, count):
            share = rows[k, MATRIX + i] / rows[k, MATRIX + k]
            for j in range(i, count):
                rows[i, MATRIX + j] -= share * rows[k, MATRIX + j]
            rows[i, IMPULSE] -= share * rows[k, IMPULSE]
    within = True
    for i in range(count - 1, -1, -1):
        rest = rows[i, IMPULSE]
        for j in range(i + 1, count):
            rest -= rows[i, MATRIX + j] * rows[j, IMPULSE]
        rows[i, IMPULSE] = rest / rows[i, MATRIX + i]
    for i in range(count):
        within = within and is_within(rows, i)
    return within


@compiled
@borrows
def fill_matrix(body: np.ndarray, axes: np.ndarray, p: np.ndarray, rows: np.ndarray) -> None:
    """Fill in the upper half of the grips' matrix, and the slip to cancel."""
    c = p[0]
    count = int(c.grips)
    im, ii = 1.0 / c.mass, 1.0 / c.yaw_inertia
    for i in range(count):
        rows[i, IMPULSE] = -slip_speed(body, axes, rows, i)
        rows[i, MATRIX + i] = (
            cross_mass(rows, i, i, im, ii) + rows[i, SOFT] + rim_mass(axes, rows, i, i)
        )
        for j in range(i + 1, count):
            rows[i, MATRIX + j] = cross_mass(rows, i, j, im, ii)
            if rows[j, HOLD] == ROLLER:
                rows[i, MATRIX + j] += rim_mass(axes, rows, i, j)


@compiled
@borrows
def is_within(rows: np.ndarray, i: int) -> bool:
    """Whether a grip can hold its impulse; the second of a circle is judged with the first."""
    hold, impulse = rows[i, HOLD], rows[i, IMPULSE]
    if hold == ALONE:
        return bool(abs(impulse) <= own_limit(rows, i))
    return bool(hold != FIRST or math.hypot(impulse, rows[i + 1, IMPULSE]) <= rows[i, LIMIT])


@compiled
@borrows
def cross_mass(rows: np.ndarray, i: int, j: int, im: float, ii: float) -> float:
    """Return the velocity of one row for a unit impulse along another, through the body."""
    return float(
        (rows[i, JX] * rows[j, JX] + rows[i, JY] * rows[j, JY]) * im
        + rows[i, JW] * rows[j, JW] * ii
    )


@compiled
@borrows
def rim_mass(axes: np.ndarray, rows: np.ndarray, i: int, j: int) -> float:
    """Return the velocity of one grip for a unit impulse along another, through their wheel."""
    if rows[i, ROLL] == 0.0 or rows[j, ROLL] == 0.0 or rows[i, WHEEL] != rows[j, WHEEL]:
        return 0.0
    axis = axes[int(rows[i, WHEEL])]
    return float(axis.rim * rows[i, ROLL] * (axis.rim * rows[j, ROLL]) / axis.inertia)


@compiled
@borrows
def own_limit(rows: np.ndarray, i: int) -> float:
    """Limit of a grip alone: the rest of the friction circle if the same tyres also roll.

    At least a tenth remains: a spinning wheel still resists sideways motion a little.
    """
    limit = rows[i, LIMIT]
    if rows[i, SPENT_TO] == 0.0:
        return float(limit)
    used = 0.0
    for j in range(int(rows[i, SPENT_FROM]), int(rows[i, SPENT_TO])):
        used += abs(rows[j, IMPULSE])
    return float(math.sqrt(max(limit * limit - used * used, 0.01 * limit * limit)))


@compiled
@borrows
def apply_impulse(
    body: np.ndarray, axes: np.ndarray, p: np.ndarray, rows: np.ndarray, i: int, impulse: float
) -> None:
    """Change the velocities by an impulse along a row."""
    b, c = body[0], p[0]
    b.vx += rows[i, JX] * impulse / c.mass
    b.vy += rows[i, JY] * impulse / c.mass
    b.omega += rows[i, JW] * impulse / c.yaw_inertia
    if rows[i, ROLL] != 0.0:
        axis = axes[int(rows[i, WHEEL])]
        axis.omega -= axis.rim * rows[i, ROLL] * impulse / axis.inertia


@compiled
@borrows
def solve_limited(
    body: np.ndarray, axes: np.ndarray, p: np.ndarray, rows: np.ndarray, walls: int
) -> None:
    """Compute and apply impulses of grips and walls within their limits (projected Gauss-Seidel).

    Starts from the impulses of the last step (`LAST`).
    """
    c = p[0]
    grips = int(c.grips)
    count = grips + 2 * walls
    for i in range(count):
        rows[i, SCALE] = 1.0 / (
            cross_mass(rows, i, i, 1.0 / c.mass, 1.0 / c.yaw_inertia)
            + rows[i, SOFT]
            + rim_mass(axes, rows, i, i)
        )
    for i in range(count):
        rows[i, IMPULSE] = rows[i, LAST]
        apply_impulse(body, axes, p, rows, i, rows[i, LAST])
    for _ in range(SWEEPS):
        worst = 0.0
        for i in range(count):
            if i < grips and rows[i, HOLD] == FIRST:
                worst = max(worst, push_pair(body, axes, p, rows, i))
            elif i >= grips or rows[i, HOLD] != SECOND:
                worst = max(worst, push(body, axes, p, rows, i))
        if worst < CONVERGED_M_S:
            break


@compiled
@borrows
def push(body: np.ndarray, axes: np.ndarray, p: np.ndarray, rows: np.ndarray, i: int) -> float:
    """Improve the impulse of a row within its limits; returns the error before that [m/s]."""
    old = rows[i, IMPULSE]
    error = slip_speed(body, axes, rows, i) - rows[i, TARGET] + rows[i, SOFT] * old
    new = bounded(p, rows, i, old - error * rows[i, SCALE])
    if new == old:
        return 0.0
    rows[i, IMPULSE] = new
    apply_impulse(body, axes, p, rows, i, new - old)
    return float(abs(new - old) / rows[i, SCALE])


@compiled
@borrows
def bounded(p: np.ndarray, rows: np.ndarray, i: int, impulse: float) -> float:
    """Return an impulse within the limits of its row."""
    above = i - int(p[0].grips)
    if above < 0:
        if rows[i, HOLD] == ROLLER:
            return impulse
        limit = own_limit(rows, i)
    elif above % 2 == 0:
        return max(impulse, 0.0)
    else:
        limit = p[0].wall_friction * rows[i - 1, IMPULSE]
    return min(max(impulse, -limit), limit)


@compiled
@borrows
def push_pair(body: np.ndarray, axes: np.ndarray, p: np.ndarray, rows: np.ndarray, i: int) -> float:
    """Improve the impulses of grip i and the one after it within their circle.

    Both take steps of the same length, so that the force of a sliding tyre opposes its slip.
    Returns the error before that [m/s].
    """
    step = min(rows[i, SCALE], rows[i + 1, SCALE])
    x, y = rows[i, IMPULSE], rows[i + 1, IMPULSE]
    new_x = x - step * (slip_speed(body, axes, rows, i) + rows[i, SOFT] * x)
    new_y = y - step * (slip_speed(body, axes, rows, i + 1) + rows[i + 1, SOFT] * y)
    size, limit = math.hypot(new_x, new_y), rows[i, LIMIT]
    if size > limit:
        new_x, new_y = new_x * limit / size, new_y * limit / size
    rows[i, IMPULSE], rows[i + 1, IMPULSE] = new_x, new_y
    apply_impulse(body, axes, p, rows, i, new_x - x)
    apply_impulse(body, axes, p, rows, i + 1, new_y - y)
    return float(max(abs(new_x - x), abs(new_y - y)) / step)


@compiled
@borrows
def slip_speed(body: np.ndarray, axes: np.ndarray, rows: np.ndarray, i: int) -> float:
    """Speed of the body along a row, less that of the rim for a driven wheel [m/s]."""
    b = body[0]
    speed = rows[i, JX] * b.vx + rows[i, JY] * b.vy + rows[i, JW] * b.omega
    if rows[i, ROLL] != 0.0:
        axis = axes[int(rows[i, WHEEL])]
        speed -= axis.rim * rows[i, ROLL] * axis.omega
    return float(speed)
