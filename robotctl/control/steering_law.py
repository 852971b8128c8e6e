"""The steering law round an obstacle at a safe radius, for tricycle and car.

Notes, section 2.2: s = kp (alpha - asin(R / D)), with alpha the bearing of the obstacle from the
heading and D its distance, both from the centre of the rear axle (`base`). Seen from a distance D
the circle of radius R round the obstacle fills asin(R / D) to either side of it, so alpha minus
that is the bearing of the tangent which leaves the obstacle on the left; with a plus, on the right.
The wheel is steered towards that tangent.

Let T = sqrt(D^2 - R^2) be the length of the tangent and beta the angle from the heading to it, so
that s = kp beta. From the geometry d(beta)/dt = -turn rate + v sin(beta) / T: beta = 0, driving on
the tangent, is invariant and, with the turn rate v tan(s) / L of a car, attractive where kp > L /
T. An approach that begins at least a few L / kp before the circle ends on it. The robot then goes
round it for as long as the law is used, at D = R / cos(s_0 / kp), a little outside R, with the
steering s_0 = atan(L / D) that a circle needs. The caller stops using the law once the path is
clear.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

Side = Literal["left", "right"]


@dataclass(frozen=True, slots=True)
class SteeringLawConfig:
    """Gain and bounds of the steering law.

    Parameters
    ----------
    kp
        Steering angle per angle to the tangent, > 0 [rad/rad]. On the tangent the approach is
        damped with the length wheelbase / kp.
    radius_m
        Wanted distance R of `base` from the obstacle's centre [m], > 0: robot's outline,
        obstacle's radius and margin together, not below the robot's least turning radius.
    steering_max_rad
        Bound of the steering angle [rad], (0, pi/2].

    Raises
    ------
    ValueError
        If a value is outside its range.
    """

    kp: float
    radius_m: float
    steering_max_rad: float

    def __post_init__(self) -> None:
        for name in ("kp", "radius_m"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise ValueError(f"{name}: {value} found, a finite number > 0 allowed")
        if not 0.0 < self.steering_max_rad <= math.pi / 2:
            raise ValueError(f"steering_max_rad: {self.steering_max_rad} found, (0, pi/2] allowed")


class SteeringDemand(NamedTuple):
    """Steering angle [rad, positive left] and whether the robot is inside the safe radius.

    `inside` is true for D < R, where asin(R / D) does not exist: the law then takes pi/2 for it,
    which steers along the circle and, as a turn needs a steering angle, slowly out of it.
    """

    steering_rad: float
    inside: bool


def orbit_config(
    radius_m: float, wheelbase_m: float, kp: float, steering_max_rad: float
) -> SteeringLawConfig:
    """Return the law whose orbit has a radius D [m], > 0: R = D cos(s_0 / kp), s_0 = atan(L / D).

    Raises
    ------
    ValueError
        If a value is outside its range.
    """
    steering_rad = math.atan2(wheelbase_m, radius_m)
    return SteeringLawConfig(kp, radius_m * math.cos(steering_rad / kp), steering_max_rad)


def steer_round(
    config: SteeringLawConfig, bearing_rad: float, distance_m: float, side: Side
) -> SteeringDemand:
    """Return the steering angle that passes an obstacle at the safe radius.

    Parameters
    ----------
    config
        Gain and bounds.
    bearing_rad
        Bearing of the obstacle's centre in `base` [rad], wrapped to (-pi, pi], positive left.
    distance_m
        Distance of the obstacle's centre from `base` [m], > 0.
    side
        Side of the robot on which the obstacle stays: "left" passes it clockwise of its bearing
        (the robot keeps to the right of it), "right" the other way.

    Where bearing or distance is not a number, or the distance is not positive, the answer is
    straight ahead with `inside` true, so that a caller that stops inside the radius stops.
    """
    if not (math.isfinite(bearing_rad) and distance_m > 0.0):
        return SteeringDemand(0.0, True)
    inside = distance_m < config.radius_m
    # asin does not exist inside the circle; pi/2 continues it from the rim.
    half_width = math.pi / 2 if inside else math.asin(config.radius_m / distance_m)
    tangent = bearing_rad - half_width if side == "left" else bearing_rad + half_width
    # Unwrapped, a robot that faces away would turn the long way, and inside go round wrongly.
    demand = config.kp * math.remainder(tangent, math.tau)
    bound = config.steering_max_rad
    return SteeringDemand(min(max(demand, -bound), bound), inside)
