"""The motor against closed forms, and against MuJoCo's `dcmotor` actuator."""

from __future__ import annotations

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.config.parameters import MotorParameters
from firmware_sim.plant.motor import Motor, current_decay

IDEAL = MotorParameters(
    resistance_ohm=1.5,
    inductance_h=0.0,
    back_emf_v_s_rad=0.0225,
    gear_ratio=20.0,
    gear_efficiency=1.0,
    rotor_inertia_kg_m2=5.0e-6,
    viscous_n_m_s_rad=0.0,
    coulomb_n_m=0.0,
    current_limit_a=1000.0,
    air_c=20.0,
    winding_heat_j_k=1.0e9,
)
"""No friction, no inductance, and a winding that stays at 20 °C."""
K = 20.0 * 0.0225


def run(motor: Motor, voltage: float, steps: int, load: float = 0.0) -> None:
    for _ in range(steps):
        motor.step(voltage, abs(voltage) + 12.0, load)


def test_no_load_speed_is_voltage_over_back_emf() -> None:
    motor = Motor(IDEAL, 0.008)
    run(motor, 9.0, 2000)
    assert motor.speed_rad_s == pytest.approx(9.0 / K, rel=1e-9)
    assert motor.current_a == pytest.approx(0.0, abs=1e-9)


def test_stall_current_is_voltage_over_resistance_and_stall_torque_follows() -> None:
    # A load equal to the stall torque holds the motor exactly.
    motor = Motor(IDEAL, 0.008)
    run(motor, 9.0, 500, load=K * 9.0 / 1.5)
    assert motor.speed_rad_s == pytest.approx(0.0, abs=1e-6)
    assert motor.current_a == pytest.approx(9.0 / 1.5)


@pytest.mark.parametrize("inductance", [0.0, 2.0e-4])
def test_speed_rises_with_the_mechanical_time_constant(inductance: float) -> None:
    motor = Motor(replace(IDEAL, inductance_h=inductance), 0.008)
    tau = motor.inertia_kg_m2 * 1.5 / K**2
    assert 0.06 < tau < 0.12
    for n in range(1, 400):
        motor.step(9.0, 12.0)
        expected = 9.0 / K * (1.0 - math.exp(-n * 1.0e-3 / tau))
        assert motor.speed_rad_s == pytest.approx(expected, abs=0.005 * 9.0 / K)


def test_current_of_a_held_motor_rises_with_the_electrical_time_constant() -> None:
    motor = Motor(replace(IDEAL, inductance_h=3.0e-3), 1.0e6)
    for n in range(1, 12):
        motor.step(9.0, 12.0)
        expected = 6.0 * (1.0 - math.exp(-n * 1.0e-3 * 1.5 / 3.0e-3))
        assert motor.current_a == pytest.approx(expected, rel=1e-6)


@given(
    st.floats(0.01, 20.0),
    st.just(0.0) | st.floats(1e-8, 0.1),
    st.floats(1e-4, 0.05),
    st.floats(-20.0, 20.0),
)
def test_exact_winding_agrees_with_many_small_steps(
    resistance: float, inductance: float, dt: float, start: float
) -> None:
    decay, held = current_decay(resistance, inductance, dt)
    if inductance == 0.0:
        assert (decay, held) == (0.0, 0.0)
        return
    times = np.concatenate([[0.0], np.geomspace(dt * 1e-9, dt, 20_001)])
    current = 3.0 + (start - 3.0) * np.exp(-times * resistance / inductance)
    assert decay * start + (1 - decay) * 3.0 == pytest.approx(current[-1], abs=1e-6)
    assert held * start + (1 - held) * 3.0 == pytest.approx(
        np.trapezoid(current, times) / dt, abs=1e-4
    )


@pytest.mark.parametrize("inductance", [0.0, 1.0e-3])
def test_supplied_energy_is_copper_loss_plus_motion_plus_field(inductance: float) -> None:
    motor = Motor(replace(IDEAL, inductance_h=inductance), 0.008, 1.0e-4)
    run(motor, 9.0, 1500)
    motion = 0.5 * motor.inertia_kg_m2 * motor.speed_rad_s**2
    field = 0.5 * inductance * motor.current_a**2
    spent = motor.copper_loss_j + motion + field
    assert motor.supplied_j == pytest.approx(spent, rel=2e-3)


def test_viscous_friction_lowers_the_no_load_speed_as_computed() -> None:
    viscous = 2.0e-4
    motor = Motor(replace(IDEAL, viscous_n_m_s_rad=viscous), 0.008)
    run(motor, 9.0, 3000)
    at_wheel = viscous * 20.0**2
    assert motor.speed_rad_s == pytest.approx(9.0 * K / (K * K + at_wheel * 1.5), rel=1e-6)


def test_coulomb_friction_holds_still_until_its_static_level_and_then_takes_its_share() -> None:
    friction = replace(IDEAL, coulomb_n_m=3.0e-3, stiction_ratio=1.5)
    breakaway = 1.5 * 3.0e-3 / 0.0225 * 1.5
    motor = Motor(friction, 0.008)
    run(motor, 0.99 * breakaway, 1000)
    assert motor.speed_rad_s == 0.0
    run(motor, 1.01 * breakaway, 1)
    assert motor.speed_rad_s > 0.0
    run(motor, 9.0, 3000)
    assert motor.current_a == pytest.approx(3.0e-3 / 0.0225, rel=1e-2)
    run(motor, 0.0, 3000)
    assert motor.speed_rad_s == 0.0


def test_a_gear_passes_its_efficiency_when_driving_and_never_delivers_energy() -> None:
    motor = Motor(replace(IDEAL, gear_efficiency=0.8), 0.008)
    load = 0.5
    run(motor, 9.0, 3000, load)
    assert motor.current_a * K * 0.8 == pytest.approx(load, rel=1e-6)
    # Driven from outside against a shorted winding, it takes more than the winding alone.
    run(motor, 0.0, 3000, load=-0.5)
    assert abs(motor.current_a) * K < 0.5


def test_the_current_limit_holds_in_both_directions() -> None:
    motor = Motor(replace(IDEAL, current_limit_a=4.0, inductance_h=1.0e-3), 0.008)
    peak = 0.0
    for voltage in [12.0] * 400 + [-12.0] * 400:
        motor.step(voltage, 12.0)
        peak = max(peak, abs(motor.current_a))
    assert peak == pytest.approx(4.0, rel=0.02)


def test_winding_warms_to_the_closed_form_of_its_thermal_resistances() -> None:
    hot = replace(IDEAL, winding_heat_j_k=0.5, case_heat_j_k=2.0, air_c=20.0)
    motor = Motor(hot, 1.0e9)
    run(motor, 3.0, 400_000)
    power = motor.current_a**2 * 1.5 * (1.0 + 0.00393 * (motor.winding_c - 20.0))
    assert motor.case_c == pytest.approx(20.0 + power * 8.0, rel=1e-3)
    assert motor.winding_c == pytest.approx(20.0 + power * 10.5, rel=1e-3)
    assert motor.current_a < 2.0 * 0.9


@pytest.mark.parametrize(("inductance", "tolerance"), [(0.0, 5e-4), (1.0e-3, 5e-4)])
def test_step_response_agrees_with_mujoco(inductance: float, tolerance: float) -> None:
    load, voltage = 1.0e-5, 6.0
    attribute = f'inductance="{inductance}"' if inductance else ""
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option timestep="2e-5" integrator="implicit" gravity="0 0 0"/>
      <worldbody><body>
        <joint name="shaft" type="hinge" axis="0 0 1" armature="{load + 5.0e-6}"/>
        <geom size="0.001" mass="1e-6" contype="0" conaffinity="0"/>
      </body></worldbody>
      <actuator>
        <dcmotor joint="shaft" motorconst="0.0225 0.0225" resistance="1.5" {attribute}/>
      </actuator>
    </mujoco>""")
    data = mujoco.MjData(model)
    data.ctrl[:] = voltage
    motor = Motor(replace(IDEAL, gear_ratio=1.0, inductance_h=inductance), load)
    worst = 0.0
    for _ in range(400):
        for _ in range(50):
            mujoco.mj_step(model, data)
        motor.step(voltage, 12.0)
        worst = max(worst, abs(motor.speed_rad_s - data.qvel[0]))
    assert worst < tolerance * voltage / 0.0225
