"""Modes of a bridge against closed forms and a continuous loop, and loops that are deceived."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from firmware_sim.config.config import load_robot
from firmware_sim.plant.axis import BrakeResistor, Limits, Mode
from firmware_sim.plant.plant import Plant
from tests.firmware_sim.plant.plants import (
    CONFIGS,
    FRICTIONLESS,
    STIFF,
    plant,
    robot,
    run_wheels,
)

K = 20.0 * 0.0225
"""Motor constant of `diff_drive` at the wheel [N m/A]."""
INERTIA = 3.0 * 0.05**2 + 5.0e-6 * 400 + 2.0e-4
"""One wheel and half of the robot that it moves straight on [kg m²]."""
BRISK = Limits(kp_a_s_rad=5.0, ki_a_rad=50.0)


def ideal(**more: object) -> Plant:
    """Return `diff_drive` without friction, on tyres that hardly give, over its axle."""
    centre = {"simulation.centre_of_mass_m": [-1.0e-9, 0.0]}
    overrides = {**FRICTIONLESS, **STIFF, **centre, **more}
    return plant(load_robot(CONFIGS / "diff_drive.toml", overrides))


def ohm(p: Plant) -> float:
    """Resistance of a winding and its bridge as it is now."""
    return 1.5 * (1 + 0.00393 * (p.axes[0].temperature_c - 20)) + 0.02


def test_the_speed_loop_agrees_with_a_continuous_one() -> None:
    p = ideal(**{"simulation.motor.winding_heat_j_k": 1e6})
    limits = Limits(current_a=3.0, kp_a_s_rad=0.5, ki_a_rad=8.0)
    run_wheels(p, 8.0, 8.0, limits=limits)
    speeds = []
    for _ in range(1500):
        p.step(1)
        speeds.append(p.axes[0].speed_rad_s)

    def slope(_: float, state: np.ndarray) -> list[float]:
        speed, integral = state
        wanted = 0.5 * (8.0 - speed) + integral
        current = min(max(wanted, -3.0), 3.0)
        return [K * current / INERTIA, 0.0 if wanted != current else 8.0 * (8.0 - speed)]

    times = np.arange(1, 1501) * 1e-3
    found = solve_ivp(slope, (0.0, 1.5), [0.0, 0.0], t_eval=times, max_step=5e-3)
    assert max(found.y[0]) > 8.2, "the loop overshoots, so that its integral matters"
    assert np.abs(found.y[0] - speeds).max() < 0.02 * 8.0
    assert speeds[-1] == pytest.approx(8.0, abs=0.01)


def test_the_reference_goes_up_and_down_its_ramp() -> None:
    p = ideal()
    limits = Limits(acceleration_rad_s2=10.0, kp_a_s_rad=50.0, ki_a_rad=500.0)
    run_wheels(p, 8.0, 8.0, limits=limits)
    p.step(400)
    assert p.axes[0].speed_rad_s == pytest.approx(4.0, abs=0.05)
    p.step(1000)
    assert p.axes[0].speed_rad_s == pytest.approx(8.0, abs=0.01)
    run_wheels(p, -8.0, -8.0)
    p.step(800)
    assert p.axes[0].speed_rad_s == pytest.approx(0.0, abs=0.05)
    p.step(2000)
    assert p.axes[0].speed_rad_s == pytest.approx(-8.0, abs=0.01)


def test_speed_begins_at_the_speed_that_the_wheel_has() -> None:
    p = ideal()
    for axis in p.axes:
        axis.command(Mode.DUTY, 0.3)
    p.step(800)
    speed = p.axes[0].speed_rad_s
    run_wheels(p, speed, speed, limits=Limits(acceleration_rad_s2=1.0))
    p.step(1)
    assert abs(p.axes[0].current_a) < 0.2
    p.step(500)
    assert p.axes[0].speed_rad_s == pytest.approx(speed, rel=0.01)


@pytest.mark.parametrize(("limit_a", "volts"), [(4.0, 1.0), (100.0, 1.0), (100.0, 0.5)])
def test_a_stalled_loop_gives_its_limit_or_what_the_supply_allows(
    limit_a: float, volts: float
) -> None:
    p = ideal(
        **{"simulation.motor.current_limit_a": 1e3, "simulation.battery.voltage_scale": volts}
    )
    p.axes[0].block()
    p.axes[0].limits = Limits(current_a=limit_a)
    p.axes[0].command(Mode.SPEED, 10.0)
    p.step(2000)
    assert p.axes[0].speed_rad_s == 0.0
    stalled_a = p.bus_voltage_v / ohm(p)
    assert p.axes[0].current_a == pytest.approx(min(limit_a, stalled_a), rel=2e-3)
    if limit_a > stalled_a:
        assert p.axes[0].voltage_v == pytest.approx(p.bus_voltage_v, rel=2e-3)


def test_a_loop_that_was_stalled_for_long_hardly_overshoots() -> None:
    p = ideal()
    for axis in p.axes:
        axis.block()
    run_wheels(p, 8.0, 8.0, limits=Limits(current_a=4.0, kp_a_s_rad=5.0, ki_a_rad=20.0))
    p.step(5000)
    for axis in p.axes:
        axis.block(False)
    highest = 0.0
    for _ in range(2000):
        p.step(1)
        highest = max(highest, p.axes[0].speed_rad_s)
    assert highest < 1.15 * 8.0
    assert p.axes[0].speed_rad_s == pytest.approx(8.0, abs=0.02)


def reverse(current_a: float) -> float:
    """Speed to which wheels of a heavy robot turn back when a loop stops them [rad/s]."""
    p = plant(robot("jackal"))
    for speed, ms in ((8.0, 4000), (0.0, 0)):
        for axis in p.axes:
            axis.limits = Limits(current_a=current_a, kp_a_s_rad=5.0, ki_a_rad=50.0)
            axis.command(Mode.SPEED, speed)
        p.step(ms)
    lowest = 0.0
    for _ in range(1000):
        p.step(1)
        lowest = min(lowest, p.axes[0].speed_rad_s)
    return -lowest


@pytest.mark.parametrize("current_a", [2.0, 5.0, 20.0])
def test_a_saturated_loop_turns_back_no_more_than_one_without_a_limit(current_a: float) -> None:
    # What a linear loop overshoots is in its gains; a wound-up integral would add to that.
    assert reverse(math.inf) > 0.1
    assert reverse(current_a) <= reverse(math.inf) + 0.01


@pytest.mark.parametrize("volts", [1.0, 0.6])
@pytest.mark.parametrize("share", [1.0, 0.5])
def test_a_speed_beyond_the_supply_ends_where_the_back_emf_takes_all_of_it(
    volts: float, share: float
) -> None:
    p = ideal(**{"simulation.battery.voltage_scale": volts})
    run_wheels(p, 500.0, 500.0, limits=Limits(voltage_share=share))
    p.step(4000)
    assert p.axes[0].speed_rad_s == pytest.approx(share * p.bus_voltage_v / K, rel=1e-3)
    run_wheels(p, 3.0, 3.0)
    p.step(1500)
    assert p.axes[0].speed_rad_s == pytest.approx(3.0, abs=0.01), "the integral has not wound up"


@given(
    rotor=st.floats(-10.0, -4.0).map(lambda x: 10.0**x),
    kp=st.floats(-1.0, 4.0).map(lambda x: 10.0**x),
    per_s=st.floats(0.0, 100.0),
    start=st.floats(-20.0, 20.0),
    friction=st.sampled_from((1e-4, 0.8)),
)
@example(rotor=1e-4, kp=1.0, per_s=0.0, start=1.0, friction=1e-4)
@settings(max_examples=40, deadline=None)
def test_the_loop_is_stable_for_any_gains_and_inertia(
    rotor: float, kp: float, per_s: float, start: float, friction: float
) -> None:
    p = ideal(
        **{
            "simulation.motor.rotor_inertia_kg_m2": max(rotor, 1e-9),
            "simulation.wheels.inertia_kg_m2": 0.0,
            "simulation.wheels.friction": friction,
        }
    )
    # Without an integral: one of before would stay where the loop under test has none.
    run_wheels(p, start, start, limits=Limits(kp_a_s_rad=1.0, ki_a_rad=0.0))
    p.step(300)
    run_wheels(p, 5.0, 5.0, limits=Limits(kp_a_s_rad=kp, ki_a_rad=kp * per_s))
    p.step(30_000 if kp < 1.0 else 6000)
    speeds = []
    for _ in range(20):
        p.step(1)
        speeds.append(p.axes[0].speed_rad_s)
    # Against the drag of a slipping tyre a loop without an integral leaves an error.
    drag_a = 0.05 * 26.0 * friction / K
    assert speeds == pytest.approx([5.0] * 20, abs=0.05 + drag_a / kp)


def test_current_gives_its_torque_whatever_the_speed() -> None:
    p = ideal()
    for axis in p.axes:
        axis.command(Mode.CURRENT, 1.5)
    p.step(200)
    assert p.axes[1].current_a == 1.5
    assert p.axes[1].speed_rad_s == pytest.approx(K * 1.5 / INERTIA * 0.2, rel=1e-3)
    for axis in p.axes:
        axis.command(Mode.CURRENT, -1.5)
    p.step(400)
    assert p.axes[1].speed_rad_s == pytest.approx(-K * 1.5 / INERTIA * 0.2, rel=1e-3)


def test_each_axis_has_a_bridge_of_its_own() -> None:
    p = ideal()
    left, right = p.axes
    left.command(Mode.SPEED, 4.0)
    right.command(Mode.COAST)
    p.step(1000)
    assert left.speed_rad_s == pytest.approx(4.0, abs=0.01)
    assert right.current_a == 0.0
    right.command(Mode.SHORTED)
    p.step(1000)
    assert left.speed_rad_s == pytest.approx(4.0, abs=0.05)
    assert abs(right.speed_rad_s) < 0.4
    assert right.current_a * left.current_a < 0.0
    assert p.powered
    left.command(Mode.COAST)
    assert not p.powered


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_brake_current_slows_at_its_torque_and_ends_at_rest(way: float) -> None:
    p = ideal()
    run_wheels(p, 10.0 * way, 10.0 * way, limits=BRISK)
    p.step(1500)
    for axis in p.axes:
        axis.command(Mode.BRAKE_CURRENT, 2.0)
    assert not p.powered
    p.step(50)
    assert p.axes[0].current_a == pytest.approx(-2.0 * way, rel=1e-3)
    slowed = way * (10.0 * way - p.axes[0].speed_rad_s)
    assert slowed == pytest.approx(K * 2.0 / INERTIA * 0.05, rel=0.01)
    p.step(1000)
    # Within the speed at which it gives less, the rest decays.
    assert abs(p.axes[0].speed_rad_s) < 1e-3
    assert abs(p.axes[0].current_a) < 0.05


def test_no_brake_current_is_a_bridge_that_lets_the_robot_roll() -> None:
    p = ideal()
    run_wheels(p, 5.0, 5.0, limits=BRISK)
    p.step(1500)
    for axis in p.axes:
        axis.command(Mode.BRAKE_CURRENT, 0.0)
    p.step(1000)
    assert p.axes[0].speed_rad_s == pytest.approx(5.0, rel=1e-3)


def test_hold_keeps_its_place_against_a_load_that_a_brake_current_gives_way_to() -> None:
    moved = {}
    for mode in (Mode.HOLD, Mode.BRAKE_CURRENT, Mode.SHORTED):
        # The left wheel pushes; both stand on one axle, so the right one is turned.
        p = plant(robot(simulation__wheels__friction=5.0))
        left, right = p.axes
        left.command(Mode.CURRENT, 3.0)
        right.command(mode, 8.0 if mode is not Mode.SHORTED else 0.0)
        p.step(500)
        before = right.angle_rad
        p.step(3000)
        moved[mode] = abs(right.angle_rad - before)
    assert moved[Mode.HOLD] < 1e-3
    assert 1e-3 < moved[Mode.BRAKE_CURRENT] < 0.15
    assert moved[Mode.SHORTED] > 10 * moved[Mode.BRAKE_CURRENT]


def test_slowing_down_charges_the_battery_by_what_the_windings_leave() -> None:
    p = ideal()
    run_wheels(p, 15.0, 15.0, limits=BRISK)
    p.step(2000)
    limits = Limits(kp_a_s_rad=5.0, ki_a_rad=50.0, acceleration_rad_s2=20.0)
    run_wheels(p, 5.0, 5.0, limits=limits)
    back = copper = 0.0
    for _ in range(600):
        p.step(1)
        back -= sum(axis.supply_current_a for axis in p.axes) * p.bus_voltage_v * 1e-3
        copper += sum(axis.current_a**2 for axis in p.axes) * ohm(p) * 1e-3
    freed = INERTIA * (15.0**2 - p.axes[0].speed_rad_s ** 2)
    assert back > 0.3 * freed
    assert back + copper == pytest.approx(freed, rel=0.01)


REFUSES = {
    "simulation.battery.charge_current_max_a": 0.0,
    "simulation.battery.electronics_current_a": 0.01,
}
GENTLE = Limits(current_a=2.0, kp_a_s_rad=5.0, ki_a_rad=50.0)
"""With more, stopping takes energy out of the battery instead of feeding it."""


def test_a_supply_that_takes_nothing_back_lets_the_rail_rise_by_the_energy() -> None:
    p = ideal(**REFUSES)
    run_wheels(p, 10.0, 10.0, limits=BRISK)
    p.step(2000)
    before_v, speed = p.bus_voltage_v, p.axes[0].speed_rad_s
    run_wheels(p, 9.0, 9.0, limits=Limits(current_a=0.5, kp_a_s_rad=5.0, ki_a_rad=50.0))
    lost = 0.0
    for _ in range(60):
        p.step(1)
        lost += sum(axis.current_a**2 for axis in p.axes) * ohm(p) * 1e-3
        lost += 0.01 * p.bus_voltage_v * 1e-3
    freed = INERTIA * (speed**2 - p.axes[0].speed_rad_s ** 2)
    stored = 0.5 * 2.0e-3 * (p.bus_voltage_v**2 - before_v**2)
    assert p.bus_voltage_v > before_v + 4.0
    assert stored == pytest.approx(freed - lost, rel=0.01)
    assert p.battery_current_a == 0.0


def test_a_brake_resistor_holds_the_rail_as_far_as_it_can() -> None:
    rails, currents = {}, {}
    for ohms in (2.0, 200.0):
        p = ideal(**REFUSES)
        p.fit_brake_resistor(BrakeResistor(ohms, 14.0))
        run_wheels(p, 15.0, 15.0, limits=GENTLE)
        p.step(2500)
        assert p.brake_resistor_a == 0.0
        run_wheels(p, 0.0, 0.0)
        highest = current = 0.0
        for _ in range(300):
            p.step(1)
            highest = max(highest, p.bus_voltage_v)
            current = max(current, p.brake_resistor_a)
        rails[ohms], currents[ohms] = highest, current
    assert rails[2.0] == pytest.approx(14.0, abs=0.05)
    assert 0.5 < currents[2.0] <= 7.0
    assert rails[200.0] > 16.0
    assert currents[200.0] <= rails[200.0] / 200.0


def test_a_battery_takes_back_no_more_than_its_limit() -> None:
    p = ideal(**REFUSES | {"simulation.battery.charge_current_max_a": 0.5})
    run_wheels(p, 15.0, 15.0, limits=GENTLE)
    p.step(2500)
    run_wheels(p, 0.0, 0.0)
    lowest, highest = 0.0, 0.0
    for _ in range(300):
        p.step(1)
        lowest = min(lowest, p.battery_current_a)
        highest = max(highest, p.bus_voltage_v)
    assert lowest == -0.5
    assert highest > 14.0
    p.step(2000)
    assert p.bus_voltage_v < 12.7, "the capacitors have emptied into the battery"


@pytest.mark.parametrize("factor", [0.0, -1.0])
def test_a_loop_that_is_told_a_wrong_speed_runs_away_to_its_limits(factor: float) -> None:
    p = ideal(**{"simulation.motor.current_limit_a": 5.0})
    left, _right = p.axes
    run_wheels(p, 3.0, 3.0, limits=BRISK)
    p.step(1000)
    left.feed_speed_loop(0, factor)
    p.step(3000)
    # Nothing but the supply bounds it: it gives all voltage, forwards.
    assert left.voltage_v == pytest.approx(p.bus_voltage_v, rel=0.02)
    assert left.speed_rad_s > 15.0
    left.feed_speed_loop(0, 1.0)
    p.step(3000)
    assert left.speed_rad_s == pytest.approx(3.0, abs=0.01)


def test_loops_whose_encoders_are_exchanged_follow_each_other() -> None:
    p = ideal()
    for axis, other in zip(p.axes, (1, 0), strict=True):
        axis.feed_speed_loop(other, 1.0)
    p.axes[0].command(Mode.SPEED, 4.0)
    p.axes[1].command(Mode.COAST)
    p.step(300)
    assert p.axes[0].speed_rad_s > 4.5, "the other wheel, which it sees, lags behind"


def test_braking_needs_no_encoder() -> None:
    p = ideal()
    run_wheels(p, 5.0, 5.0, limits=BRISK)
    p.step(1000)
    for axis in p.axes:
        axis.feed_speed_loop(0, -1.0)
        axis.command(Mode.BRAKE_CURRENT, 3.0)
    p.step(1000)
    assert abs(p.v_m_s) < 1e-3


def test_the_order_of_motors_does_not_matter() -> None:
    one, two = ideal(), ideal()
    run_wheels(one, 3.0, -7.0, limits=BRISK)
    run_wheels(two, -7.0, 3.0, limits=BRISK)
    for p in (one, two):
        p.axes[0].feed_speed_loop(1, 1.0)
        p.axes[1].feed_speed_loop(0, 1.0)
        p.step(700)
    assert one.axes[0].speed_rad_s == pytest.approx(two.axes[1].speed_rad_s, rel=1e-9)
    assert one.omega_rad_s == pytest.approx(-two.omega_rad_s, rel=1e-9)


@pytest.mark.parametrize(
    ("mode", "value"),
    [
        (Mode.DUTY, 1.001),
        (Mode.DUTY, math.nan),
        (Mode.SPEED, math.inf),
        (Mode.CURRENT, math.nan),
        (Mode.BRAKE_CURRENT, -1.0),
        (Mode.HOLD, -1.0),
    ],
)
def test_a_command_without_sense_is_refused_and_changes_nothing(mode: Mode, value: float) -> None:
    p = ideal()
    p.axes[0].command(Mode.SPEED, 2.0)
    with pytest.raises(ValueError, match="command: "):
        p.axes[0].command(mode, value)
    assert (p.axes[0].mode, p.axes[0].value) == (Mode.SPEED, 2.0)


def test_three_phases_give_the_share_of_the_supply_that_they_can() -> None:
    p = ideal(**{"simulation.bridge.voltage_share": 0.866})
    for axis in p.axes:
        axis.command(Mode.DUTY, 1.0)
    p.step(4000)
    assert p.axes[0].speed_rad_s == pytest.approx(0.866 * p.bus_voltage_v / K, rel=1e-3)
    run_wheels(p, 500.0, 500.0)
    p.step(3000)
    assert p.axes[0].speed_rad_s == pytest.approx(0.866 * p.bus_voltage_v / K, rel=1e-3)
