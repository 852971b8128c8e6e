"""Mecanum and omni wheels: kinematics where they grip, MuJoCo with real rollers, laws."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.config.config import RobotConfig
from firmware_sim.plant.axis import Limits, Mode
from firmware_sim.plant.plant import Plant
from tests.firmware_sim.plant.plants import FRICTIONLESS, STIFF, mecanum, omni, plant, run_wheels

RADIUS_M = 0.08
TIGHT = Limits(kp_a_s_rad=20.0, ki_a_rad=200.0)
SPEEDS = st.floats(-8.0, 8.0)


def driven(config: RobotConfig, speeds: tuple[float, ...], milliseconds: int = 1500) -> Plant:
    """Return the plant after its wheels have had their speeds for a while."""
    p = plant(config)
    run_wheels(p, *speeds, limits=TIGHT)
    p.step(milliseconds)
    return p


def motion(p: Plant) -> np.ndarray:
    """Forward, lateral and turning speed."""
    return np.array([p.v_m_s, p.vy_m_s, p.omega_rad_s])


def mecanum_wheels(v: float, vy: float, omega: float, arm: float = 0.33) -> tuple[float, ...]:
    """Wheel speeds of a motion; `arm` is half of track and wheelbase together [m]."""
    turn = arm * omega
    return tuple(
        each / RADIUS_M for each in (v - vy - turn, v + vy + turn, v + vy - turn, v - vy + turn)
    )


def omni_wheels(count: int, first: float, v: float, vy: float, omega: float) -> tuple[float, ...]:
    """Wheel speeds of a motion."""
    angles = [first + math.tau * k / count for k in range(count)]
    return tuple((-math.sin(a) * v + math.cos(a) * vy + 0.2 * omega) / RADIUS_M for a in angles)


@given(v=st.floats(-0.5, 0.5), vy=st.floats(-0.5, 0.5), omega=st.floats(-1.5, 1.5))
@settings(max_examples=20, deadline=None)
def test_mecanum_wheels_that_grip_move_the_robot_as_told(v: float, vy: float, omega: float) -> None:
    p = driven(mecanum({**FRICTIONLESS, **STIFF}), mecanum_wheels(v, vy, omega))
    assert motion(p) == pytest.approx([v, vy, omega], abs=1e-3)


@given(
    count=st.sampled_from((3, 4)),
    first=st.floats(-180.0, 180.0),
    v=st.floats(-0.4, 0.4),
    vy=st.floats(-0.4, 0.4),
    omega=st.floats(-1.5, 1.5),
)
@settings(max_examples=20, deadline=None)
def test_omni_wheels_that_grip_move_the_robot_as_told(
    count: int, first: float, v: float, vy: float, omega: float
) -> None:
    config = omni({**FRICTIONLESS, **STIFF}, wheels=count, first_wheel_deg=first)
    p = driven(config, omni_wheels(count, math.radians(first), v, vy, omega))
    assert motion(p) == pytest.approx([v, vy, omega], abs=1e-3)


def test_diagonal_wheels_strafe_exactly_sideways() -> None:
    p = driven(mecanum({**FRICTIONLESS, **STIFF}), (-5.0, 5.0, 5.0, -5.0), 3000)
    assert p.vy_m_s == pytest.approx(RADIUS_M * 5.0, rel=1e-4)
    assert (p.x_m, p.theta_rad) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert p.y_m > 0.9


def test_one_diagonal_alone_drives_slantwise_while_the_other_rolls_on_its_rollers() -> None:
    p = plant(mecanum(FRICTIONLESS))
    for axis, speed in zip(p.axes, (5.0, 0.0, 0.0, 5.0), strict=True):
        axis.limits = TIGHT
        axis.command(Mode.SPEED, speed)
    p.step(2000)
    assert (p.v_m_s, p.vy_m_s) == pytest.approx((0.2, -0.2), rel=1e-3)
    assert abs(p.axes[1].current_a) < 1e-3, "the floor gives wheels that stand no torque"


def test_rollers_that_drag_cost_current_and_speed() -> None:
    currents = []
    for drag in (0.0, 0.02, 0.06):
        p = driven(mecanum({"simulation.wheels.roller_drag": drag}), (-5.0, 5.0, 5.0, -5.0))
        currents.append(p.axes[1].current_a)
        assert p.vy_m_s == pytest.approx(0.4, rel=5e-3)
    rolling, some, more = currents
    assert some > rolling + 0.05
    # In proportion: a roller turns at √2 times the robot's sideways speed, the wheel does not help.
    assert more - rolling == pytest.approx(3 * (some - rolling), rel=0.02)


@pytest.mark.parametrize("drag", [0.0, 0.05])
@pytest.mark.parametrize("angle", [0.0, 0.6, math.pi / 2])
def test_a_push_of_a_robot_on_omni_wheels_is_braked_by_what_drags_alone(
    drag: float, angle: float
) -> None:
    # Free motors: the wheels turn and the rollers turn.
    p = plant(omni({**FRICTIONLESS, **STIFF, "simulation.wheels.roller_drag": drag}, wheels=4))
    p._b["vx"], p._b["vy"] = math.cos(angle), math.sin(angle)
    p.step(50)  # the wheels take up their speed
    before = math.hypot(p.v_m_s, p.vy_m_s)
    p.step(300)
    slowed = before - math.hypot(p.v_m_s, p.vy_m_s)
    # Each wheel's rollers drag along its axle, against that part of the motion.
    expected = 9.80665 * drag * 0.3 * sum(abs(math.cos(angle - k * math.pi / 2)) for k in range(4))
    inertia = 1 + 2 * 2.2e-3 / (16.0 * RADIUS_M**2)
    assert slowed == pytest.approx(expected / 4 / inertia, rel=0.05, abs=1e-6)


def test_wheels_with_rollers_feel_the_force_that_slips_them() -> None:
    # Friction bounds the force along each roller's axis: √2 of it along the motion, a half of each.
    p = plant(mecanum({**FRICTIONLESS, "simulation.wheels.friction": 0.1}))
    for axis in p.axes:
        axis.command(Mode.CURRENT, 10.0)
    p.step(100)
    assert p.v_m_s == pytest.approx(0.1 * 9.80665 * math.sqrt(0.5) * 0.1, rel=0.02)
    assert p.axes[0].speed_rad_s * RADIUS_M > 3 * p.v_m_s


def test_on_ice_a_robot_goes_nowhere_and_keeps_its_momentum() -> None:
    p = plant(mecanum({**FRICTIONLESS, "simulation.wheels.friction": 1e-7}))
    p._b["vx"], p._b["vy"], p._b["omega"] = 0.3, -0.2, 0.5
    run_wheels(p, 9.0, -3.0, 7.0, 4.0, limits=TIGHT)
    p.step(2000)
    assert p.omega_rad_s == pytest.approx(0.5, abs=1e-4)
    assert math.hypot(p.v_m_s, p.vy_m_s) == pytest.approx(math.hypot(0.3, 0.2), abs=1e-4)
    straight = math.hypot(p.x_m, p.y_m)
    assert straight == pytest.approx(2.0 * math.hypot(0.3, 0.2), rel=1e-3)


@pytest.mark.parametrize("config", [mecanum, omni])
def test_energy_from_the_battery_is_motion_and_heat(config) -> None:  # type: ignore[no-untyped-def]
    p = plant(config({**FRICTIONLESS, **STIFF}))
    speeds = (1.0, 5.0, 2.0, 4.0)[: len(p.axes)]  # no wheel against the others
    run_wheels(p, *speeds, limits=Limits(acceleration_rad_s2=20.0, kp_a_s_rad=5.0, ki_a_rad=50.0))
    supplied = copper = 0.0
    for _ in range(100):
        p.step(1)
        supplied += (p.battery_current_a - 0.5) * p.bus_voltage_v * 1e-3
        for axis in p.axes:
            ohm = 0.5 * (1 + 0.00393 * (axis.temperature_c - 20)) + 0.02
            copper += axis.current_a**2 * ohm * 1e-3
    wheels = sum(0.5 * 2.2e-3 * axis.speed_rad_s**2 for axis in p.axes)
    v, vy, omega = motion(p)
    moving = 0.5 * 16.0 * (v**2 + vy**2) + 0.5 * 0.5 * omega**2 + wheels
    assert moving > 0.05
    assert supplied == pytest.approx(copper + moving, rel=0.03)


@given(speeds=st.tuples(SPEEDS, SPEEDS, SPEEDS, SPEEDS))
@settings(max_examples=10, deadline=None)
def test_a_mirrored_command_moves_a_mecanum_robot_in_the_mirror(
    speeds: tuple[float, float, float, float],
) -> None:
    front_left, front_right, rear_left, rear_right = speeds
    one = driven(mecanum(), speeds, 300)
    other = driven(mecanum(), (front_right, front_left, rear_right, rear_left), 300)
    assert motion(other) == pytest.approx(motion(one) * (1, -1, -1), abs=1e-5)


@given(speeds=st.tuples(SPEEDS, SPEEDS, SPEEDS), turn=st.floats(0.0, 360.0))
@settings(max_examples=10, deadline=None)
def test_a_turned_omni_robot_moves_in_a_turned_frame(
    speeds: tuple[float, float, float], turn: float
) -> None:
    even = {"simulation.wheels.slip_ratio": 0.0}  # it goes by |vx| + |vy|, which turning changes
    one = driven(omni(even, first_wheel_deg=0.0), speeds, 300)
    other = driven(omni(even, first_wheel_deg=turn), speeds, 300)
    a = math.radians(turn)
    v, vy, omega = motion(one)
    turned = [v * math.cos(a) - vy * math.sin(a), v * math.sin(a) + vy * math.cos(a), omega]
    assert motion(other) == pytest.approx(turned, abs=1e-5)


def rollers(name: str, x: float, y: float, side: int, count: int = 12) -> str:
    """Return a mecanum wheel in MuJoCo's words: barrels that turn freely on the rim."""
    radius, barrel = RADIUS_M, 0.014
    half_length = radius * math.sin(math.pi / count) * 1.6
    parts = []
    for j in range(count):
        around = math.tau * j / count
        place = -(radius - barrel) * math.sin(around), -(radius - barrel) * math.cos(around)
        # Half along the rim, half along the axle.
        along = math.cos(around), float(side), -math.sin(around)
        parts.append(
            f'<body pos="{place[0]} 0 {place[1]}" zaxis="{along[0]} {along[1]} {along[2]}">'
            '<joint type="hinge" axis="0 0 1" damping="1e-6"/><geom type="ellipsoid" mass="0.01" '
            f'size="{barrel} {barrel} {half_length}" friction="0.8 0 0" condim="3" '
            'contype="1" conaffinity="0"/></body>'
        )
    return (
        f'<body pos="{x} {y} 0"><joint name="{name}" type="hinge" axis="0 1 0"/>'
        '<geom type="sphere" size="0.04" mass="0.3" contype="0" conaffinity="0"/>'
        f"{''.join(parts)}</body>"
    )


@pytest.mark.parametrize(
    "told", [(0.4, 0.0, 0.0), (0.0, 0.4, 0.0), (0.0, 0.0, 1.2), (0.2, -0.2, 0.4)]
)
def test_a_robot_on_rollers_moves_as_one_in_mujoco(told: tuple[float, float, float]) -> None:
    places = ((0.18, 0.15, -1), (0.18, -0.15, 1), (-0.18, 0.15, 1), (-0.18, -0.15, -1))
    wheels = "".join(rollers(f"w{i}", *each) for i, each in enumerate(places))
    drives = "".join(f'<velocity joint="w{i}" kv="20"/>' for i in range(4))
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option timestep="1e-3" cone="elliptic" impratio="10" integrator="implicitfast"/>
      <worldbody>
        <geom type="plane" size="9 9 1" friction="0.8 0 0" contype="0" conaffinity="1"/>
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
    data.ctrl[:] = mecanum_wheels(*told)
    for _ in range(300):
        mujoco.mj_step(model, data)
    start = data.qpos[:4].copy()
    for _ in range(400):
        mujoco.mj_step(model, data)
    moved = data.qpos[:4] - start
    turned = moved[3] / 0.4
    heading = (data.qpos[3] + start[3]) / 2
    v = (math.cos(heading) * moved[0] + math.sin(heading) * moved[1]) / 0.4
    vy = (-math.sin(heading) * moved[0] + math.cos(heading) * moved[1]) / 0.4
    p = driven(mecanum(), mecanum_wheels(*told))
    assert motion(p) == pytest.approx([v, vy, turned], rel=0.05, abs=0.01)
