from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.control.steering_law import SteeringLawConfig, orbit_config, steer_round

WHEELBASE = 0.3
CONFIG = SteeringLawConfig(kp=2.0, radius_m=0.8, steering_max_rad=0.6)
DT = 0.01


def wrap(angle):
    return math.atan2(math.sin(angle), math.cos(angle))


def drive_round(drive, start, side, metres=8.0, speed=0.4, rate_max=2.0, config=CONFIG):
    """Paths x, y of base with the obstacle at the origin; a steering actuator with finite rate."""
    x, y, theta = start
    steering, path = 0.0, []
    for _ in range(round(metres / speed / DT)):
        bearing = wrap(math.atan2(-y, -x) - theta)
        wanted = steer_round(config, bearing, math.hypot(x, y), side).steering_rad
        steering += min(max(wanted - steering, -rate_max * DT), rate_max * DT)
        if drive == "front":  # speed of the steered wheel
            v, omega = speed * math.cos(steering), speed * math.sin(steering) / WHEELBASE
        else:  # speed of the rear axle, tricycle or Ackermann car
            v, omega = speed, speed * math.tan(steering) / WHEELBASE
        theta += omega * DT
        x += v * DT * math.cos(theta - 0.5 * omega * DT)
        y += v * DT * math.sin(theta - 0.5 * omega * DT)
        path.append((x, y))
    return np.array(path)


def starts():
    """From all around, at several distances, towards the obstacle and up to 60 deg beside it."""
    rng = np.random.default_rng(5)
    for k in range(40):
        around = 2.0 * math.pi * k / 40
        distance = rng.uniform(2.0, 4.0)
        heading = around + math.pi + rng.uniform(-1.05, 1.05)
        yield distance * math.cos(around), distance * math.sin(around), heading


@pytest.mark.parametrize("drive", ["front", "rear"])
@pytest.mark.parametrize("side", ["left", "right"])
def test_the_robot_clears_the_obstacle_by_the_radius_from_everywhere(drive, side):
    for start in starts():
        distances = np.hypot(*drive_round(drive, start, side).T)
        assert np.min(distances) > 0.99 * CONFIG.radius_m, start
        # And goes round it close by: the law is no mere avoidance.
        assert distances[-1] < 1.1 * CONFIG.radius_m, start


@pytest.mark.parametrize("drive", ["front", "rear"])
@pytest.mark.parametrize(("side", "turning"), [("left", 1.0), ("right", -1.0)])
def test_the_obstacle_stays_on_the_named_side(drive, side, turning):
    for start in starts():
        path = drive_round(drive, start, side)
        x, y = path[-200:].T
        moment = x[:-1] * np.diff(y) - y[:-1] * np.diff(x)
        assert np.all(turning * moment > 0.0)


def test_the_orbit_has_the_radius_of_the_docstring():
    distances = np.hypot(*drive_round("rear", (-3.0, 0.1, 0.0), "left", metres=25.0).T)
    d = distances[-1]
    steering = math.atan(WHEELBASE / d)
    assert d == pytest.approx(CONFIG.radius_m / math.cos(steering / CONFIG.kp), rel=2e-3)


def test_driving_on_the_tangent_needs_no_steering():
    distance = 2.0
    half_width = math.asin(CONFIG.radius_m / distance)
    assert steer_round(CONFIG, half_width, distance, "left") == (0.0, False)
    assert steer_round(CONFIG, -half_width, distance, "right") == (0.0, False)


@settings(deadline=None)
@given(st.floats(-math.pi, math.pi), st.floats(0.01, 100.0))
def test_left_and_right_are_mirror_images(bearing, distance):
    left = steer_round(CONFIG, bearing, distance, "left")
    right = steer_round(CONFIG, -bearing, distance, "right")
    assert left.steering_rad == pytest.approx(-right.steering_rad)
    assert left.inside == right.inside == (distance < CONFIG.radius_m)
    assert abs(left.steering_rad) <= CONFIG.steering_max_rad


def test_an_obstacle_straight_ahead_is_left_on_the_left_by_turning_right():
    assert steer_round(CONFIG, 0.0, 2.0, "left").steering_rad < 0.0
    assert steer_round(CONFIG, 0.0, 2.0, "right").steering_rad > 0.0


def test_the_law_is_continuous_at_the_radius():
    outside = steer_round(CONFIG, 1.5, CONFIG.radius_m * (1.0 + 1e-12), "left")
    inside = steer_round(CONFIG, 1.5, CONFIG.radius_m * (1.0 - 1e-12), "left")
    assert (outside.inside, inside.inside) == (False, True)
    assert outside.steering_rad == pytest.approx(inside.steering_rad, abs=1e-5)


@pytest.mark.parametrize(("side", "turning"), [("left", 1.0), ("right", -1.0)])
@pytest.mark.parametrize("heading", np.linspace(-math.pi, math.pi, 9))
def test_from_inside_it_goes_round_on_the_named_side_whatever_way_it_faces(side, turning, heading):
    x, y = drive_round("rear", (0.0, 0.3, heading), side, metres=10.0)[-200:].T
    assert np.all(turning * (x[:-1] * np.diff(y) - y[:-1] * np.diff(x)) > 0.0)
    assert np.hypot(x, y) == pytest.approx(CONFIG.radius_m, rel=0.1)


def test_from_inside_the_radius_the_robot_comes_out():
    distances = np.hypot(*drive_round("rear", (-0.3, -0.5, 0.0), "left", metres=10.0).T)
    assert distances[0] < 0.6
    assert distances[-1] >= CONFIG.radius_m


@settings(deadline=None)
@given(st.floats(), st.floats())
def test_any_numbers_give_a_bounded_angle(bearing, distance):
    demand = steer_round(CONFIG, bearing, distance, "left")
    assert abs(demand.steering_rad) <= CONFIG.steering_max_rad
    if not distance > 0.0 or not math.isfinite(bearing):
        assert demand == (0.0, True)


@pytest.mark.parametrize("radius_m", [0.5, 0.8, 3.0])
def test_the_law_for_an_orbit_ends_on_a_circle_of_its_radius(radius_m):
    config = orbit_config(radius_m, WHEELBASE, 2.0, 0.6)
    path = drive_round("rear", (-2.0 - radius_m, 0.1, 0.0), "left", metres=25.0, config=config)
    assert np.hypot(*path[-200:].T) == pytest.approx(radius_m, rel=2e-3)


@pytest.mark.parametrize(
    ("name", "value"),
    [("kp", 0.0), ("radius_m", -1.0), ("steering_max_rad", 0.0), ("steering_max_rad", 1.6)],
)
def test_configuration_refuses_values_out_of_range(name, value):
    good = {"kp": 1.0, "radius_m": 1.0, "steering_max_rad": 0.5}
    with pytest.raises(ValueError, match=f"^{name}: "):
        SteeringLawConfig(**(good | {name: value}))
