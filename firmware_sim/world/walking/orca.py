"""Optimal reciprocal collision avoidance.

J. van den Berg, S. J. Guy, M. Lin and D. Manocha, "Reciprocal n-body collision avoidance",
Robotics Research (ISRR 2009), Springer 2011, pp. 3-19. Whoever chooses a velocity within all
half-planes, while all others do so too, touches nobody within the horizon.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, TypeAlias

from firmware_sim.world.walking.walker import Mover, Place

Velocity: TypeAlias = tuple[float, float]
"""Velocity in world: x, y [m/s]."""

_SLACK_M_S: Final = 1e-9
_HALVINGS: Final = 16


class HalfPlane(NamedTuple):
    """Velocities v with n · v >= least_m_s; the normal n is a unit vector."""

    nx: float
    ny: float
    least_m_s: float

    def lacks_m_s(self, velocity: Velocity) -> float:
        """Return by how much a velocity misses the half-plane [m/s]; negative: it is inside."""
        return self.least_m_s - self.nx * velocity[0] - self.ny * velocity[1]


def off_wall(place: Place, near: Place, radius_m: float, horizon_s: float) -> HalfPlane:
    """Return the velocities with which a disc stays off a convex wall during the horizon.

    `near` is the wall's point nearest to `place`; the wall lies beyond the line through it.
    """
    x, y = near[0] - place[0], near[1] - place[1]
    distance_m = math.hypot(x, y)
    gap_m = max(distance_m - radius_m, 0.0)
    return HalfPlane(-x / distance_m, -y / distance_m, -gap_m / horizon_s)


def off_mover(
    me: Mover, other: Mover, share: float, horizon_s: float, parting_s: float
) -> HalfPlane:
    """Return the velocities with which `me` stays off another during the horizon.

    Parameters
    ----------
    me, other
        Both discs.
    share
        Part of the change of the relative velocity that `me` does, 0.5 where both evade.
    horizon_s
        Time without a contact [s].
    parting_s
        Time in which two that overlap part [s].
    """
    x, y = other.x_m - me.x_m, other.y_m - me.y_m
    vx, vy = me.vx_m_s - other.vx_m_s, me.vy_m_s - other.vy_m_s
    radius_m = me.radius_m + other.radius_m
    squared = x * x + y * y
    time_s = horizon_s if squared > radius_m * radius_m else parting_s
    wx, wy = vx - x / time_s, vy - y / time_s
    w, inward = math.hypot(wx, wy), wx * x + wy * y
    # Section 4.1: u goes from the relative velocity to the nearest place of the velocity obstacle's
    # rim, which is the arc of its cut-off disc or one of its legs.
    on_arc = squared <= radius_m**2 or (inward < 0.0 and inward**2 > (radius_m * w) ** 2)
    if on_arc:
        nx, ny = (wx / w, wy / w) if w > 0.0 else (-1.0, 0.0)
        ux, uy = (radius_m / time_s - w) * nx, (radius_m / time_s - w) * ny
    else:
        leg_m, side = math.sqrt(squared - radius_m**2), 1.0 if x * wy - y * wx > 0.0 else -1.0
        lx = (x * leg_m - side * y * radius_m) / squared
        ly = (side * x * radius_m + y * leg_m) / squared
        along = vx * lx + vy * ly
        ux, uy = along * lx - vx, along * ly - vy
        nx, ny = -side * ly, side * lx
    px, py = me.vx_m_s + share * ux, me.vy_m_s + share * uy
    return HalfPlane(nx, ny, nx * px + ny * py)


def choose(
    wish: Velocity, fastest_m_s: float, hard: Sequence[HalfPlane], soft: Sequence[HalfPlane]
) -> Velocity:
    """Return the velocity nearest to a wish within all half-planes and the speed [m/s].

    Where there is none, the soft ones yield, all by the same least amount (section 5.3). Standing
    still must be within the hard ones.
    """
    found = _nearest(wish, fastest_m_s, [*hard, *soft])
    if found is not None:
        return found
    low, high = 0.0, max((each.least_m_s for each in soft), default=0.0)
    best: Velocity = (0.0, 0.0)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        eased = [each._replace(least_m_s=each.least_m_s - middle) for each in soft]
        found = _nearest(wish, fastest_m_s, [*hard, *eased])
        if found is None:
            low = middle
        else:
            high, best = middle, found
    return best


def _nearest(wish: Velocity, fastest_m_s: float, planes: Sequence[HalfPlane]) -> Velocity | None:
    """Return the velocity nearest to a wish; None: the half-planes have none in common.

    By adding them one by one (de Berg et al., Computational Geometry, 2008, section 4.3).
    """
    speed_m_s = math.hypot(*wish)
    scale = min(1.0, fastest_m_s / speed_m_s) if speed_m_s > 0.0 else 1.0
    best = (scale * wish[0], scale * wish[1])
    for number, plane in enumerate(planes):
        if plane.lacks_m_s(best) <= _SLACK_M_S:
            continue
        found = _nearest_on_rim(wish, fastest_m_s, plane, planes[:number])
        if found is None:
            return None
        best = found
    return best


def _nearest_on_rim(
    wish: Velocity, fastest_m_s: float, rim: HalfPlane, others: Sequence[HalfPlane]
) -> Velocity | None:
    """Return the velocity on a half-plane's rim, within the others, nearest to a wish."""
    nx, ny, least = rim
    if abs(least) > fastest_m_s:
        return None
    high = math.sqrt(fastest_m_s**2 - least**2)
    low = -high
    dx, dy = -ny, nx
    for other in others:
        slope = other.nx * dx + other.ny * dy
        lack = other.lacks_m_s((least * nx, least * ny))
        if abs(slope) < _SLACK_M_S:
            if lack > _SLACK_M_S:
                return None
        elif slope > 0.0:
            low = max(low, lack / slope)
        else:
            high = min(high, lack / slope)
        if low > high:
            return None
    along = min(max(wish[0] * dx + wish[1] * dy, low), high)
    return least * nx + along * dx, least * ny + along * dy
