"""Contacts of tyres with the floor and of the outline with walls, solved together as impulses.

A contact is a row: a unit direction d at a point p, relative to the centre of mass, in base. Its
impulse λ changes the body's velocity by M⁻¹Jᵀλ, J = (dx, dy, px·dy - py·dx), and the speed of a
driven wheel by -r λ / inertia. The first three rows are the tyres:

=============  ==================  ==================  =====================
row            differential        front-driven        rear-driven
=============  ==================  ==================  =====================
0              left, rolling       front, rolling      rear axle, rolling
1              right, rolling      front, sideways     front, sideways
2              axle, sideways      rear, sideways      rear axle, sideways
=============  ==================  ==================  =====================

A tyre's force is its slip velocity over a compliance, up to friction times load (a regularised
Coulomb law, taken at the end of the step, hence stable for any stiffness). A wall only pushes, just
as much as keeps the gap from closing within the step. Method: time stepping with impulses after
Moreau; projected Gauss-Seidel where a limit is reached.
"""

from __future__ import annotations

import math

import numpy as np

from firmware_sim.compiled import compiled
from firmware_sim.plant.plant_state import DIFFERENTIAL, DT_S, FRONT_DRIVEN

# Columns of a row.
JX, JY, JW, TARGET, IMPULSE, LIMIT, SOFT, WHEEL_OF, SCALE, LAST = range(10)
COLUMNS = 10
TYRES = 3
MAX_WALLS = 8
"""Wall contacts kept; each has a row along the normal and one along the wall."""
ROWS = TYRES + 2 * MAX_WALLS
SLOP_M = 1.0e-4
"""Gap left to a wall."""
SWEEPS = 40
"""At most this many sweeps over the rows, which matters only where walls or limits are met."""
CONVERGED_M_S = 1.0e-6


@compiled
def tyre_rows(body: np.ndarray, p: np.ndarray, rows: np.ndarray) -> None:
    """Fill in the three rows of the tyres."""
    b, c = body[0], p[0]
    kind = int(c.kind)
    steer = b.steering + c.steering_offset
    cos, sin = (1.0, 0.0) if kind == DIFFERENTIAL else (math.cos(steer), math.sin(steer))
    front = c.wheelbase - c.com_x
    if kind == DIFFERENTIAL:
        put_row(rows, 0, 1.0, 0.0, -c.com_x, c.half_track - c.com_y, 0)
        put_row(rows, 1, 1.0, 0.0, -c.com_x, -c.half_track - c.com_y, 1)
    elif kind == FRONT_DRIVEN:
        put_row(rows, 0, cos, sin, front, -c.com_y, 0)
        put_row(rows, 1, -sin, cos, front, -c.com_y, -1)
    else:
        put_row(rows, 0, 1.0, 0.0, -c.com_x, -c.com_y, 0)
        put_row(rows, 1, -sin, cos, front, -c.com_y, -1)
    put_row(rows, 2, 0.0, 1.0, -c.com_x, -c.com_y, -1)
    speed = abs(b.vx) + abs(b.vy) + abs(b.omega) * max(c.half_track, c.wheelbase)
    slip = (c.slip_speed + c.slip_ratio * speed) / (c.friction * DT_S)
    for i in range(TYRES):
        load = c.load0 if i == 0 else (c.load1 if i == 1 else c.load2)
        rows[i, LIMIT] = c.friction * load * DT_S
        rows[i, SOFT] = slip / max(load, 1.0e-3)


@compiled
def put_row(
    rows: np.ndarray, i: int, dx: float, dy: float, px: float, py: float, wheel: int
) -> None:
    """Write direction and lever of a row."""
    rows[i, JX] = dx
    rows[i, JY] = dy
    rows[i, JW] = px * dy - py * dx
    rows[i, TARGET] = 0.0
    rows[i, IMPULSE] = 0.0
    rows[i, WHEEL_OF] = wheel


@compiled
def solve_tyres(body: np.ndarray, wheels: np.ndarray, p: np.ndarray, rows: np.ndarray) -> bool:
    """Impulses of the three tyre rows without limits, by elimination; False if one is exceeded."""
    b, c = body[0], p[0]
    im, ii = 1.0 / c.mass, 1.0 / c.yaw_inertia
    a00 = (rows[0, JX] ** 2 + rows[0, JY] ** 2) * im + rows[0, JW] ** 2 * ii + rows[0, SOFT]
    a11 = (rows[1, JX] ** 2 + rows[1, JY] ** 2) * im + rows[1, JW] ** 2 * ii + rows[1, SOFT]
    a22 = (rows[2, JX] ** 2 + rows[2, JY] ** 2) * im + rows[2, JW] ** 2 * ii + rows[2, SOFT]
    a01 = cross_mass(rows, 0, 1, im, ii)
    a02 = cross_mass(rows, 0, 2, im, ii)
    a12 = cross_mass(rows, 1, 2, im, ii)
    r0 = wheels[0].radius * (1.0 + wheels[0].floor)
    a00 += r0 * r0 / wheels[0].inertia
    s0 = rows[0, JX] * b.vx + rows[0, JY] * b.vy + rows[0, JW] * b.omega - r0 * wheels[0].omega
    s1 = rows[1, JX] * b.vx + rows[1, JY] * b.vy + rows[1, JW] * b.omega
    s2 = rows[2, JX] * b.vx + rows[2, JY] * b.vy + rows[2, JW] * b.omega
    if c.wheels > 1.5:
        r1 = wheels[1].radius * (1.0 + wheels[1].floor)
        a11 += r1 * r1 / wheels[1].inertia
        s1 -= r1 * wheels[1].omega
    l10, l20 = a01 / a00, a02 / a00
    d1 = a11 - l10 * a01
    e12 = a12 - l10 * a02
    l21 = e12 / d1
    d2 = a22 - l20 * a02 - l21 * e12
    y1 = -s1 + l10 * s0
    y2 = -s2 + l20 * s0 - l21 * y1
    lambda2 = y2 / d2
    lambda1 = (y1 - e12 * lambda2) / d1
    lambda0 = (-s0 - a01 * lambda1 - a02 * lambda2) / a00
    rows[0, IMPULSE], rows[1, IMPULSE], rows[2, IMPULSE] = lambda0, lambda1, lambda2
    within: bool = (
        abs(lambda0) <= rows[0, LIMIT]
        and abs(lambda1) <= sideways_limit(rows, 1, int(c.kind))
        and abs(lambda2) <= sideways_limit(rows, 2, int(c.kind))
    )
    return within


@compiled
def cross_mass(rows: np.ndarray, i: int, j: int, im: float, ii: float) -> float:
    """Return the velocity of one row for a unit impulse along another, through the body."""
    return float(
        (rows[i, JX] * rows[j, JX] + rows[i, JY] * rows[j, JY]) * im
        + rows[i, JW] * rows[j, JW] * ii
    )


@compiled
def sideways_limit(rows: np.ndarray, i: int, kind: int) -> float:
    """Limit of a tyre row: the friction circle's rest where the same tyres also roll.

    A tenth is always left: a spinning wheel still resists sideways motion a little.
    """
    limit = rows[i, LIMIT]
    if i == 0 or (kind == DIFFERENTIAL and i == 1):
        return float(limit)
    used = 0.0
    if kind == DIFFERENTIAL:
        used = abs(rows[0, IMPULSE]) + abs(rows[1, IMPULSE])
    elif (kind == FRONT_DRIVEN) == (i == 1):
        used = abs(rows[0, IMPULSE])
    return float(math.sqrt(max(limit * limit - used * used, 0.01 * limit * limit)))


@compiled
def apply_impulse(
    body: np.ndarray, wheels: np.ndarray, p: np.ndarray, rows: np.ndarray, i: int, impulse: float
) -> None:
    """Change the velocities by an impulse along a row."""
    b, c = body[0], p[0]
    b.vx += rows[i, JX] * impulse / c.mass
    b.vy += rows[i, JY] * impulse / c.mass
    b.omega += rows[i, JW] * impulse / c.yaw_inertia
    k = int(rows[i, WHEEL_OF])
    if k >= 0:
        radius = wheels[k].radius * (1.0 + wheels[k].floor)
        wheels[k].omega -= radius * impulse / wheels[k].inertia


@compiled
def solve_limited(
    body: np.ndarray, wheels: np.ndarray, p: np.ndarray, rows: np.ndarray, walls: int
) -> None:
    """Impulses of tyres and walls within their limits (projected Gauss-Seidel), applied.

    Starts from the impulses of the step before (`LAST`). Wall rows come in pairs: normal, along.
    """
    c = p[0]
    kind = int(c.kind)
    count = TYRES + 2 * walls
    for i in range(count):
        rows[i, SCALE] = 1.0 / (
            cross_mass(rows, i, i, 1.0 / c.mass, 1.0 / c.yaw_inertia)
            + rows[i, SOFT]
            + wheel_mass(wheels, rows, i)
        )
    for i in range(count):
        rows[i, IMPULSE] = rows[i, LAST]
        apply_impulse(body, wheels, p, rows, i, rows[i, LAST])
    for _ in range(SWEEPS):
        worst = 0.0
        for i in range(count):
            old = rows[i, IMPULSE]
            error = slip_speed(body, wheels, rows, i) - rows[i, TARGET] + rows[i, SOFT] * old
            new = old - error * rows[i, SCALE]
            if i < TYRES:
                limit = sideways_limit(rows, i, kind)
                new = min(max(new, -limit), limit)
            elif (i - TYRES) % 2 == 0:
                new = max(new, 0.0)
            else:
                limit = c.wall_friction * rows[i - 1, IMPULSE]
                new = min(max(new, -limit), limit)
            if new != old:
                rows[i, IMPULSE] = new
                apply_impulse(body, wheels, p, rows, i, new - old)
                worst = max(worst, abs(new - old) / rows[i, SCALE])
        if worst < CONVERGED_M_S:
            break


@compiled
def wheel_mass(wheels: np.ndarray, rows: np.ndarray, i: int) -> float:
    """Inverse mass that a driven wheel adds to a row [1/kg]; 0 if there is none."""
    k = int(rows[i, WHEEL_OF])
    if k < 0:
        return 0.0
    radius = wheels[k].radius * (1.0 + wheels[k].floor)
    return float(radius * radius / wheels[k].inertia)


@compiled
def slip_speed(body: np.ndarray, wheels: np.ndarray, rows: np.ndarray, i: int) -> float:
    """Speed along a row: of the body, less that of the wheel's rim where one is driven [m/s]."""
    b = body[0]
    speed = rows[i, JX] * b.vx + rows[i, JY] * b.vy + rows[i, JW] * b.omega
    k = int(rows[i, WHEEL_OF])
    if k >= 0:
        speed -= wheels[k].radius * (1.0 + wheels[k].floor) * wheels[k].omega
    return float(speed)
