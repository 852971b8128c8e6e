"""Robots that turn by slipping: closed forms, a static balance of forces, MuJoCo, robots on sale.

With the wheels of each side at one speed a skid-steer robot turns about the same points beside its
wheels, so it drives like a differential robot whose track is wider (A. Mandow et al., Experimental
kinematics for wheeled skid-steer mobile robots, IROS 2007). On four evenly loaded tyres under
Coulomb friction, turning on the spot, the moments of the forces along and across the wheels cancel
at 1 + (wheelbase / track)² times its track, whatever the friction.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import root

from firmware_sim.config.config import RobotConfig
from firmware_sim.plant.axis import Limits, Mode
from tests.firmware_sim.plant.plants import FRICTIONLESS, STIFF, plant, run_wheels, skid_steer

RADIUS_M = 0.08
TIGHT = Limits(kp_a_s_rad=20.0, ki_a_rad=200.0)


def turned(config: RobotConfig, left: float, right: float, seconds: float = 2.0) -> np.ndarray:
    """Return forward, lateral and turning speed with the wheels of each side at a speed."""
    p = plant(config)
    run_wheels(p, *(left, right) * (len(p.axes) // 2), limits=TIGHT)
    p.step(round(seconds * 1000))
    assert [axis.speed_rad_s for axis in p.axes[:2]] == pytest.approx([left, right], abs=1e-3)
    return np.array([p.v_m_s, p.vy_m_s, p.omega_rad_s])


@given(
    track=st.floats(0.2, 0.8),
    wheelbase=st.floats(0.1, 0.8),
    friction=st.floats(0.1, 1.5),
    speed=st.floats(1.0, 4.0),
)
@settings(max_examples=15, deadline=None)
def test_on_the_spot_the_track_is_effectively_wider_by_the_closed_form(
    track: float, wheelbase: float, friction: float, speed: float
) -> None:
    config = skid_steer({"simulation.wheels.friction": friction}, track, wheelbase)
    v, vy, omega = turned(config, -speed, speed, 4.0)
    factor = 2 * speed * RADIUS_M / track / omega
    assert factor == pytest.approx(1 + (wheelbase / track) ** 2, rel=1e-3)
    assert (v, vy) == pytest.approx((0.0, 0.0), abs=1e-6)


@pytest.mark.parametrize(
    ("track_m", "wheelbase_m", "published"),
    # Track and wheelbase of the robots' URDF, `wheel_separation_multiplier` of their controllers
    # (github.com/husky/husky, github.com/jackal/jackal).
    [(0.5708, 0.5120, 1.875), (0.37559, 0.262, 1.5)],
    ids=["husky", "jackal"],
)
def test_robots_on_sale_turn_as_their_makers_have_found(
    track_m: float, wheelbase_m: float, published: float
) -> None:
    _, _, omega = turned(skid_steer({}, track_m, wheelbase_m), -3.0, 3.0)
    assert 6.0 * RADIUS_M / track_m / omega == pytest.approx(published, rel=0.05)


def balance(
    config: RobotConfig, contacts: np.ndarray, speeds: np.ndarray, guess: tuple[float, float, float]
) -> np.ndarray:
    """Solve for the steady motion in which Coulomb friction gives the centripetal force."""
    simulation = config.simulation
    com = np.array(simulation.centre_of_mass_m)
    weight = simulation.mass_kg * 9.80665
    # Loads of equal springs: those linear in the place that balance the weight and its moments.
    ones = np.column_stack([np.ones(len(contacts)), contacts])
    loads = ones @ np.linalg.solve(ones.T @ ones, weight * np.array([1.0, *com]))

    def excess(motion: np.ndarray) -> np.ndarray:
        vx, vy, omega = motion
        slip = np.column_stack(
            [vx - omega * contacts[:, 1] - RADIUS_M * speeds, vy + omega * contacts[:, 0]]
        )
        size = np.sqrt((slip**2).sum(axis=1) + 1e-8)[:, None]
        forces = -simulation.wheels.friction * loads[:, None] * slip / size
        x, y = (contacts - com).T
        cx, cy = vx - omega * com[1], vy + omega * com[0]
        fx, fy = forces.sum(axis=0) - simulation.mass_kg * omega * np.array([-cy, cx])
        return np.array([fx, fy, np.sum(x * forces[:, 1] - y * forces[:, 0])])

    found = root(excess, guess)
    assert np.abs(excess(found.x)).max() < 1e-3
    return np.asarray(found.x)


@pytest.mark.parametrize("per_side", [2, 3])
@pytest.mark.parametrize("centre", [(0.0, 0.0), (-0.04, 0.0), (0.03, 0.05)])
@pytest.mark.parametrize(
    ("left", "right", "friction"), [(4.0, 6.0, 0.8), (0.0, 2.0, 0.2), (-2.0, 3.0, 0.4)]
)
def test_arcs_are_those_of_a_static_balance_of_coulomb_friction(
    per_side: int, centre: tuple[float, float], left: float, right: float, friction: float
) -> None:
    hard = {"simulation.wheels.slip_speed_m_s": 1e-5, "simulation.wheels.slip_ratio": 0.0}
    settings = {"simulation.wheels.friction": friction, "simulation.centre_of_mass_m": centre}
    config = skid_steer({**hard, **settings}, wheels_per_side=per_side)
    axles = (0.131, -0.131) if per_side == 2 else (0.131, 0.0, -0.131)
    contacts = np.array([(x, side * 0.37559 / 2) for x in axles for side in (1, -1)])
    found = turned(config, left, right, 6.0)
    speeds = np.array([left, right] * per_side)
    expected = balance(
        config, contacts, speeds, (found[0] + 0.002, found[1] - 0.001, found[2] + 0.01)
    )
    assert found == pytest.approx(expected, abs=2e-3)


def test_turning_on_the_spot_agrees_with_mujoco() -> None:
    # MuJoCo's friction cone lifts what slides, in proportion to friction times speed. The track
    # does not depend on friction, so little of it will do.
    friction, wheels, drives = 0.05, "", ""
    for i, (x, y) in enumerate((x, y) for x in (0.131, -0.131) for y in (0.1878, -0.1878)):
        wheels += f"""<body pos="{x} {y} 0"><joint name="w{i}" type="hinge" axis="0 1 0"/>
          <geom type="sphere" size="{RADIUS_M}" mass="0.5" friction="{friction} 0 0" condim="3"/>
          </body>"""
        drives += f'<velocity joint="w{i}" kv="50"/>'
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option timestep="1e-3" cone="elliptic" impratio="10" integrator="implicitfast"/>
      <worldbody>
        <geom type="plane" size="9 9 1" friction="{friction} 0 0"/>
        <body pos="0 0 {RADIUS_M}">
          <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>
          <joint type="slide" axis="0 0 1"/><joint type="hinge" axis="0 0 1"/>
          <geom type="box" size="0.2 0.12 0.03" mass="14" contype="0" conaffinity="0"/>
          {wheels}
        </body>
      </worldbody>
      <actuator>{drives}</actuator>
    </mujoco>""")
    data = mujoco.MjData(model)
    data.ctrl[:] = [-5.0, 5.0, -5.0, 5.0]
    for _ in range(1500):
        mujoco.mj_step(model, data)
    _, _, omega = turned(skid_steer({"simulation.wheels.friction": friction}), -5.0, 5.0, 4.0)
    assert omega == pytest.approx(data.qvel[3], rel=0.03)


@given(speed=st.floats(-8.0, 8.0), per_side=st.sampled_from((2, 3)), x=st.floats(-0.05, 0.05))
@settings(max_examples=15, deadline=None)
def test_equal_wheels_drive_straight(speed: float, per_side: int, x: float) -> None:
    centre = {"simulation.centre_of_mass_m": (x, 0.0)}
    p = plant(skid_steer(centre, wheels_per_side=per_side))
    run_wheels(p, *[speed] * 2 * per_side, limits=TIGHT)
    p.step(1500)
    assert p.v_m_s == pytest.approx(speed * RADIUS_M, rel=1e-3, abs=1e-4)
    assert (p.y_m, p.theta_rad) == pytest.approx((0.0, 0.0), abs=1e-5)


def test_what_motors_give_to_a_robot_that_turns_is_what_its_tyres_rub() -> None:
    p = plant(skid_steer(FRICTIONLESS))
    run_wheels(p, -4.0, 4.0, -4.0, 4.0, limits=TIGHT)
    p.step(3000)
    k = 20.0 * 0.0225
    given = sum(k * axis.current_a * axis.speed_rad_s for axis in p.axes)
    half_track, half_base = 0.37559 / 2, 0.131
    along, across = p.omega_rad_s * half_track - 4.0 * RADIUS_M, p.omega_rad_s * half_base
    rubbed = 0.8 * 16.0 * 9.80665 * math.hypot(along, across)
    assert given == pytest.approx(rubbed, rel=1e-3)


def test_a_robot_that_slides_is_slowed_by_friction_in_whatever_direction() -> None:
    # Locked wheels: the force is against the motion, along and across alike.
    distances = []
    for heading in (0.0, 0.4, math.pi / 2):
        p = plant(skid_steer({**FRICTIONLESS, **STIFF}))
        for axis in p.axes:
            axis.command(Mode.COAST)
            axis.block()
        p._b["vx"], p._b["vy"] = math.cos(heading), math.sin(heading)
        p.step(600)
        assert math.atan2(p.y_m, p.x_m) == pytest.approx(heading, abs=1e-3)
        distances.append(math.hypot(p.x_m, p.y_m))
    assert distances == pytest.approx([1.0 / (2 * 0.8 * 9.80665)] * 3, rel=0.01)


def test_the_friction_circle_bounds_what_a_tyre_gives_while_it_also_slides_sideways() -> None:
    p = plant(skid_steer())
    limit = 0.8 * 4.0 * 9.80665 * 1e-3
    run_wheels(p, -6.0, 6.0, -6.0, 6.0, limits=TIGHT)
    for _ in range(100):
        p.step(7)
        impulses = p._rows[:8, 4].reshape(4, 2)  # IMPULSE
        assert np.hypot(*impulses.T).max() <= limit * (1 + 1e-9)
    assert np.hypot(*impulses.T).min() > 0.99 * limit
