"""Speeds from which a robot has braked before what comes nearer is there."""

from __future__ import annotations

import math


def speed_before(
    gap_m: float,
    nears_m_s: float,
    deceleration_m_s2: float,
    reaction_s: float,
    *,
    closing: float = 1.0,
    then_m_s: float = 0.0,
) -> float:
    """Return the speed from which a robot is as slow as it should be once a gap is closed [m/s].

    With w the speed of the other, c `closing`, a the deceleration, t the reaction time and u
    `then_m_s`, the other comes w (t + (v - u) / a) nearer until the robot drives at u, and the
    robot goes c (v t + (v^2 - u^2) / 2 a) towards it: at v both close the gap.

    Parameters
    ----------
    gap_m
        Distance from the other [m]; below 0 counts as 0.
    nears_m_s
        Speed of the other towards the robot [m/s], >= 0.
    deceleration_m_s2, reaction_s
        Guaranteed braking [m/s^2], > 0, after a time [s], >= 0.
    closing
        Way of the robot's body towards the other per way of `base`, > 0.
    then_m_s
        Speed that is allowed once the gap is closed [m/s], >= 0.
    """
    a, t, c, w = deceleration_m_s2, reaction_s, closing, nears_m_s
    left_m = max(gap_m - w * t + then_m_s * (w + 0.5 * c * then_m_s) / a, 0.0)
    b = t + w / (a * c)
    return max(a * (math.sqrt(b * b + 2.0 * left_m / (a * c)) - b), then_m_s)
