"""Motion, tyres and supply of the plant against closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.config.config import load_robot
from firmware_sim.errors import SimulationError
from firmware_sim.plant.axis import Mode
from firmware_sim.plant.plant import Plant
from tests.firmware_sim.plant.plants import (
    CONFIGS,
    FRICTIONLESS,
    STIFF,
    command,
    plant,
    robot,
)

OVER_THE_AXLE = {**FRICTIONLESS, "simulation.centre_of_mass_m": [-1.0e-9, 0.0]}


def ideal(**more: Any) -> Plant:
    return plant(load_robot(CONFIGS / "diff_drive.toml", {**OVER_THE_AXLE, **more}))


def counts(p: Plant) -> tuple[int, ...]:
    return tuple(axis.encoder(2400).count for axis in p.axes)


def test_top_speed_is_the_rail_over_back_emf() -> None:
    p = ideal()
    command(p, 1.0, 1.0)
    p.step(4000)
    assert p.v_m_s == pytest.approx(p.bus_voltage_v / 0.45 * 0.05, rel=1e-4)
    assert 1.2 < p.v_m_s < 1.5


def test_the_robot_speeds_up_with_its_mechanical_time_constant() -> None:
    p = ideal(**{"simulation.wheels.slip_ratio": 0.0})
    inertia = 3.0 * 0.05**2 + 5.0e-6 * 400 + 2.0e-4
    tau = inertia * (1.5 * (1 + 0.00393 * 5) + 0.02) / 0.45**2 + 1.0e-3 / 1.5
    assert 0.06 < tau < 0.12
    command(p, 0.2, 0.2)
    speeds = []
    for _ in range(1000):
        p.step(1)
        speeds.append(p.v_m_s)
    reached = 1 + int(np.argmax(np.array(speeds) > (1 - math.exp(-1)) * speeds[-1]))
    assert reached * 1.0e-3 == pytest.approx(tau, rel=0.03)


def test_energy_from_the_rail_is_copper_loss_and_motion() -> None:
    p = ideal(**STIFF)
    command(p, 0.3, 0.2)
    supplied = copper = 0.0
    for _ in range(800):
        p.step(1)
        supplied += p.bus_voltage_v * (p.battery_current_a - 0.5) * 1e-3
        for axis in p.axes:
            ohm = 1.5 * (1 + 0.00393 * (axis.temperature_c - 20)) + 0.02
            copper += axis.current_a**2 * ohm * 1e-3
    turning = sum(0.5 * 2.2e-3 * axis.speed_rad_s**2 for axis in p.axes)
    motion = 0.5 * 6.0 * p.v_m_s**2 + 0.5 * 0.12 * p.omega_rad_s**2 + turning
    assert motion > 0.4
    assert supplied == pytest.approx(copper + motion, rel=0.02)


def test_coasting_without_friction_goes_on_and_braking_decays_exponentially() -> None:
    p = ideal()
    command(p, 0.3, 0.3)
    p.step(500)
    command(p, 0.0, 0.0, mode=Mode.COAST)
    p.step(50)
    before = p.v_m_s
    p.step(1000)
    assert p.v_m_s == pytest.approx(before, rel=1e-9)
    assert p.axes[0].current_a == 0.0
    command(p, 0.0, 0.0, mode=Mode.SHORTED)
    speeds = []
    for _ in range(200):
        p.step(1)
        speeds.append(p.v_m_s)
    tau = 9.7e-3 * (1.5 * (1 + 0.00393 * 5) + 0.02) / 0.45**2
    slope = np.polyfit(np.arange(150) * 1e-3, np.log(speeds[:150]), 1)[0]
    assert -1 / slope == pytest.approx(tau, rel=0.03)
    assert p.battery_current_a == pytest.approx(0.5)


def test_counts_are_the_distance_rolled() -> None:
    p = plant(robot(simulation__wheels__slip_ratio=0.0))
    command(p, 0.4, 0.4)
    p.step(5000)
    per_metre = 2400 / (2 * math.pi * 0.05)
    assert counts(p)[0] / per_metre == pytest.approx(p.distance_m, rel=5e-3)
    assert counts(p)[0] == counts(p)[1]
    command(p, -0.4, -0.4)
    p.step(10_000)
    assert counts(p)[0] < 0


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
@settings(max_examples=30, deadline=None)
def test_the_body_follows_the_wheels_where_tyres_hardly_slip(left: float, right: float) -> None:
    p = ideal(**STIFF)
    command(p, left, right)
    p.step(600)
    v = 0.025 * (p.axes[0].speed_rad_s + p.axes[1].speed_rad_s)
    omega = 0.05 * (p.axes[1].speed_rad_s - p.axes[0].speed_rad_s) / 0.3
    assert p.v_m_s == pytest.approx(v, abs=1e-4)
    assert p.omega_rad_s == pytest.approx(omega, abs=1e-3)
    assert p.vy_m_s == pytest.approx(0.0, abs=1e-4)


def test_a_steady_arc_is_a_circle_that_closes() -> None:
    p = ideal(**STIFF)
    command(p, 0.2, 0.3)
    p.step(1500)
    x, y, heading = p.x_m, p.y_m, p.theta_rad
    radius, omega = p.v_m_s / p.omega_rad_s, p.omega_rad_s
    centre = (x - radius * math.sin(heading), y + radius * math.cos(heading))
    for _ in range(8):
        p.step(round(2 * math.pi / omega / 8 * 1000))
        assert math.dist((p.x_m, p.y_m), centre) == pytest.approx(radius, rel=2e-3)
    assert math.dist((p.x_m, p.y_m), (x, y)) < 0.01 * radius


def test_spinning_on_the_spot_turns_left_with_the_right_wheel_forwards() -> None:
    p = plant(robot())
    command(p, -0.3, 0.3)
    p.step(1000)
    assert p.omega_rad_s > 1.5
    assert math.hypot(p.x_m, p.y_m) < 0.02


@pytest.mark.parametrize("name", ["tricycle", "ackermann"])
@pytest.mark.parametrize("steering", [-0.5, 0.2, 0.55])
def test_curvature_of_a_steered_robot_is_tan_of_steering_over_wheelbase(
    name: str, steering: float
) -> None:
    config = robot(name, simulation__wheels__slip_ratio=0.0)
    p = plant(config)
    command(p, 0.25, 0.0, steering)
    p.step(3000)
    curvature = math.tan(steering) / config.drive.wheelbase_m  # type: ignore[union-attr]
    assert p.omega_rad_s / p.v_m_s == pytest.approx(curvature, rel=0.01)
    assert abs(p.vy_m_s) < 2e-3
    # The encoder sees the driven wheel: the front one is faster by 1 / cos.
    rolled = p.axes[0].speed_rad_s * config.drive.wheel_radius_m
    ahead = p.v_m_s / math.cos(steering) if name == "tricycle" else p.v_m_s
    assert rolled == pytest.approx(ahead, rel=0.01)
    assert len(p.axes) == 1


def test_a_rear_driven_tricycle_turns_as_the_front_driven() -> None:
    p = plant(robot("tricycle", drive__driven="rear"))
    command(p, 0.25, 0.0, 0.5)
    p.step(3000)
    assert p.omega_rad_s / p.v_m_s == pytest.approx(math.tan(0.5) / 0.32, rel=0.02)
    assert p.axes[0].speed_rad_s * 0.06 == pytest.approx(p.v_m_s, rel=0.01)


def test_steering_moves_no_faster_than_its_rate_and_no_further_than_its_stop() -> None:
    p = plant(robot("ackermann"))
    command(p, 0.0, 0.0, 2.0)
    p.step(50)
    assert p.steering_rad == pytest.approx(4.0 * 0.05)
    p.step(1000)
    assert p.steering_rad == pytest.approx(0.6, abs=1e-6)


def test_slippery_tyres_limit_acceleration_to_friction_times_load() -> None:
    p = ideal(**{"simulation.wheels.friction": 0.1})
    command(p, 0.6, 0.6)
    p.step(100)
    # No load on the castor: the centre of mass is over the axle.
    assert p.v_m_s == pytest.approx(0.1 * 9.80665 * 0.1, rel=0.03)
    assert p.axes[0].speed_rad_s * 0.05 > 2 * p.v_m_s


def test_locked_wheels_slide_to_a_stop_at_friction_times_gravity() -> None:
    p = ideal()
    command(p, 0.6, 0.6)
    p.step(1000)
    speed, start = p.v_m_s, p.x_m
    command(p, 0.0, 0.0, mode=Mode.COAST)
    p.axes[0].block()
    p.axes[1].block()
    p.step(1000)
    assert p.v_m_s == pytest.approx(0.0, abs=1e-6)
    assert p.x_m - start == pytest.approx(speed**2 / (2 * 0.8 * 9.80665), rel=0.1)


def test_fast_turning_pushes_the_tyres_sideways_but_only_a_little() -> None:
    p = plant(robot())
    command(p, 0.3, 0.55)
    p.step(2000)
    sideways = p.vy_m_s
    assert sideways < 0.0  # A left turn pushes to the right.
    assert abs(sideways) < 0.02 * p.v_m_s


def test_a_blocked_motor_draws_the_stall_current_and_sags_the_rail_of_the_other() -> None:
    config = robot(simulation__motor__current_limit_a=100.0)
    free, blocked = plant(config), plant(config)
    blocked.axes[0].block()
    for p in (free, blocked):
        command(p, 0.5, 0.5)
        p.step(400)
    duty = (round(0.5 * 4096) / 4096 - 0.02) / 0.98
    ohm = 1.5 * (1 + 0.00393 * (blocked.axes[0].temperature_c - 20)) + 0.02
    assert counts(blocked)[0] == 0
    assert blocked.axes[0].current_a == pytest.approx(duty * blocked.bus_voltage_v / ohm, rel=2e-3)
    assert blocked.axes[0].temperature_c > free.axes[0].temperature_c + 0.5
    assert blocked.bus_voltage_v < free.bus_voltage_v - 0.05


def test_reversing_feeds_current_back_into_the_battery() -> None:
    p = plant(robot())
    command(p, 0.9, 0.9)
    p.step(1000)
    command(p, 0.3, 0.3)
    lowest = 0.0
    for _ in range(100):
        p.step(1)
        lowest = min(lowest, p.battery_current_a)
    assert lowest < -0.5


def test_the_rail_is_the_battery_less_what_the_current_takes() -> None:
    p = plant(robot(simulation__battery__voltage_scale=0.7))
    assert p.bus_voltage_v == pytest.approx(0.7 * 12.6 - 0.06 * 0.5, abs=1e-6)
    command(p, 0.5, 0.5)
    p.step(20)
    before = p.battery_current_a
    p.step(1)
    assert p.bus_voltage_v == pytest.approx(0.7 * 12.6 - 0.06 * before, abs=0.005)
    assert p.charge < 1.0


def test_within_the_dead_band_nothing_moves_and_beyond_it_the_pwm_has_steps() -> None:
    p = plant(robot())
    command(p, 0.019, -0.019)
    p.step(200)
    assert (*counts(p), p.axes[0].current_a) == (0, 0, 0.0)
    fine, same = plant(robot()), plant(robot())
    command(fine, 0.5, 0.5)
    command(same, 0.5 + 0.4 / 4096, 0.5)
    fine.step(100)
    same.step(100)
    assert fine.axes[0].current_a == same.axes[0].current_a
    command(same, 0.5 + 0.6 / 4096, 0.5)
    fine.step(1)
    same.step(1)
    assert fine.axes[0].current_a != same.axes[0].current_a


def test_a_duty_too_weak_for_friction_does_not_creep() -> None:
    p = plant(robot())
    command(p, 0.035, 0.035)
    p.step(2000)
    assert p.v_m_s == 0.0
    assert p.axes[0].current_a > 0.05


@pytest.mark.parametrize("bad", [1.001, -1.5, math.nan, math.inf])
def test_an_impossible_command_is_refused(bad: float) -> None:
    p = plant(robot())
    with pytest.raises(ValueError, match="command"):
        command(p, 0.0, bad)


def test_errors_of_geometry_part_truth_from_odometry() -> None:
    p = plant(
        robot(simulation__errors__wheel_radius=[0.02, 0.02], simulation__wheels__slip_ratio=0.0)
    )
    command(p, 0.3, 0.3)
    p.step(3000)
    nominal = counts(p)[0] / 2400 * 2 * math.pi * 0.05
    assert p.distance_m / nominal == pytest.approx(1.02, rel=3e-3)


@pytest.mark.parametrize("name", ["diff_drive", "tricycle", "ackermann"])
def test_the_same_seed_gives_the_same_motion_bit_for_bit(name: str) -> None:
    config = load_robot(CONFIGS / f"{name}.toml")

    def drive(seed: int, chunk: int) -> tuple[float, ...]:
        p = plant(config, seed)
        for i in range(20):
            command(p, 0.1 + 0.02 * i, 0.5 - 0.02 * i, 0.02 * i)
            for _ in range(0, 100, chunk):
                p.step(chunk)
        return (
            p.x_m,
            p.y_m,
            p.theta_rad,
            p.axes[0].current_a,
            p.bus_voltage_v,
            p.axes[0].temperature_c,
        )

    assert drive(7, 100) == drive(7, 1)
    assert drive(7, 100) != drive(8, 100)


def test_the_floor_makes_dead_reckoning_drift_as_much_as_is_said() -> None:
    config = load_robot(CONFIGS / "diff_drive.toml", {"simulation.wheels.floor_noise": 0.01})
    errors, lengths = [], []
    for seed in range(150):
        p = plant(config, seed)
        command(p, 0.6, 0.6)
        p.step(3000)
        rolled = [count / 2400 * 2 * math.pi * 0.05 for count in counts(p)]
        # What the difference of the wheels says of the heading, against the truth.
        errors.append(p.theta_rad - (rolled[1] - rolled[0]) / 0.3)
        lengths.append(p.distance_m)
    expected = math.sqrt(2 * 2 * 0.01**2 * 0.05 * np.mean(lengths)) / 0.3
    # 150 samples: the standard deviation is known to 6 %; three times that.
    assert np.std(errors) == pytest.approx(expected, rel=0.2)
    assert abs(np.mean(errors)) < 4 * expected / math.sqrt(150)


@pytest.mark.parametrize(
    ("name", "centre"), [("diff_drive", [0.05, 0.0]), ("tricycle", [0.5, 0.0])]
)
def test_a_robot_that_would_tip_over_is_refused(name: str, centre: list[float]) -> None:
    with pytest.raises(SimulationError, match="centre_of_mass_m"):
        plant(robot(name, simulation__centre_of_mass_m=centre))
