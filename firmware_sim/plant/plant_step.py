"""One millisecond of the plant, compiled: motors and battery, wheels and walls, motion.

The order within a step: steering servo; rail voltage from the current of the last step; motors
without load; impulses of wheels and walls; currents for the mean speed of the step; heat and
charge; motion along the arc of the new velocity.
"""

from __future__ import annotations

import math

import numpy as np

from firmware_sim.noise import uniform
from firmware_sim.plant.axis import COAST, SHORTED
from firmware_sim.plant.battery import (
    charge_step,
    open_circuit_voltage,
    polarisation_step,
    rail_step,
    resistor_current,
)
from firmware_sim.plant.contact import (
    IMPULSE,
    LAST,
    apply_impulse,
    set_grips,
    solve_grips,
    solve_limited,
)
from firmware_sim.plant.discs import disc_rows
from firmware_sim.plant.loop import loop_current, wind_up
from firmware_sim.plant.motor import (
    chopped_voltage,
    current_decay,
    friction_torque,
    heat_step,
    wheel_step,
    winding_resistance,
)
from firmware_sim.plant.plant_state import DT_S
from firmware_sim.plant.walls import approach_speed, wall_rows
from native_kernels.compiled import borrows, compiled

EPISODE_S = 0.3
"""Interval within which contacts are one collision [s]."""


@compiled
@borrows
def run_plant(
    steps: int,
    body: np.ndarray,
    axes: np.ndarray,
    p: np.ndarray,
    outline: np.ndarray,
    segments: np.ndarray,
    grid: np.ndarray,
    rows: np.ndarray,
    noise: np.ndarray,
    discs: np.ndarray,
) -> None:
    """Advance body and axes by a number of steps of `DT_S`."""
    b, c = body[0], p[0]
    motors, grips = int(c.axes), int(c.grips)
    for_walls = rows[grips:]
    for _ in range(steps):
        turn_steering(body, p)
        source = c.cells_scale * open_circuit_voltage(b.charge)
        b.bus_v = max(source - b.polarisation_v - c.battery_ohm * b.battery_a, b.rail_v)
        for k in range(motors):
            spin_motor(body, axes, p, k)
            roughen(axes, p, k, noise)
        move_freely(body, p)
        walls = wall_rows(body, p, outline, segments, grid, for_walls)
        contacts = disc_rows(body, p, outline, discs, for_walls, walls)
        set_grips(body, axes, p, rows)
        if contacts == 0 and solve_grips(body, axes, p, rows):
            for i in range(grips):
                apply_impulse(body, axes, p, rows, i, rows[i, IMPULSE])
                rows[i, LAST] = rows[i, IMPULSE]
            b.contacts = 0
            b.touch_s = max(b.touch_s - DT_S, 0.0)
        else:
            collide(body, axes, p, rows, walls, contacts)
        load_a = c.electronics_a
        for k in range(motors):
            load_a += feed_motor(body, axes, p, k)
        feed_rail(body, p, source, load_a)
        b.polarisation_v = polarisation_step(
            b.polarisation_v, b.battery_a, c.polarisation_ohm, c.polarisation_gain
        )
        b.charge = charge_step(b.charge, b.battery_a, c.capacity_ah, DT_S)
        advance_pose(body, p)


@compiled
@borrows
def turn_steering(body: np.ndarray, p: np.ndarray) -> None:
    """Move the steering servo: first-order lag with a limited rate."""
    b, c = body[0], p[0]
    step = (b.steering_cmd - b.steering) * c.steering_gain
    b.steering += min(max(step, -c.steering_step), c.steering_step)


@compiled
@borrows
def spin_motor(body: np.ndarray, axes: np.ndarray, p: np.ndarray, k: int) -> None:
    """Compute the speed of wheel k after the step if off the ground, and its motor's inertia."""
    b, c, a = body[0], p[0], axes[k]
    a.before = a.omega
    a.resistance = winding_resistance(c.winding_ohm, a.winding_c) + c.bridge_ohm
    if a.mode == COAST:
        a.current = 0.0
        a.voltage = 0.0
        torque, motor_damping = 0.0, 0.0
    elif a.mode <= SHORTED:
        a.decay, a.held = current_decay(a.resistance, c.inductance, DT_S)
        a.voltage = 0.0
        if a.mode != SHORTED:
            a.voltage = chopped_voltage(
                a.duty * b.bus_v,
                b.bus_v,
                c.k * a.omega,
                a.current,
                a.resistance,
                a.decay,
                a.current_max,
            )
        torque = c.k * (a.held * a.current + (1.0 - a.held) * a.voltage / a.resistance)
        motor_damping = (1.0 - a.held) * c.k * c.k / a.resistance
    else:
        loop_current(axes, k, c.k, c.wheel_inertia, b.bus_v)
        torque = c.k * (a.start + 2.0 * a.slope * a.omega)
        motor_damping = 2.0 * c.k * a.slope
    friction = a.rolling + friction_torque(
        a.omega, torque - motor_damping * a.omega, c.coulomb, c.stiction_ratio, c.gear_loss
    )
    a.omega, a.inertia = wheel_step(
        a.omega, torque, friction, motor_damping + c.viscous, c.wheel_inertia, DT_S
    )
    if a.blocked > 0.0:
        a.omega, a.inertia = 0.0, np.inf


@compiled
@borrows
def roughen(axes: np.ndarray, p: np.ndarray, k: int, noise: np.ndarray) -> None:
    """Let the rolling radius of wheel k wander over the floor (a walk with memory of a length)."""
    c, a = p[0], axes[k]
    share = min(abs(a.before) * a.radius * DT_S / c.floor_length, 1.0)
    if c.floor_noise > 0.0 and share > 0.0:
        draw = (uniform(noise) - 0.5) * math.sqrt(12.0)
        a.floor += -share * a.floor + c.floor_noise * math.sqrt(2.0 * share) * draw
    a.rim = a.radius * (1.0 + a.floor)


@compiled
@borrows
def move_freely(body: np.ndarray, p: np.ndarray) -> None:
    """Compute the velocities after the step without tyres and walls: rotating frame, and drag."""
    b, c = body[0], p[0]
    vx = b.vx + DT_S * b.omega * b.vy
    b.vy -= DT_S * b.omega * b.vx
    b.vx = vx
    lever_x, lever_y = c.drag_x - c.com_x, c.drag_y - c.com_y
    slide_x = b.vx - b.omega * lever_y
    slide_y = b.vy + b.omega * lever_x
    speed = math.hypot(slide_x, slide_y)
    if speed > 0.0:
        # No more than stops the point.
        lever2 = lever_x * lever_x + lever_y * lever_y
        stop = speed / (1.0 / c.mass + lever2 / c.yaw_inertia)
        impulse = min(c.drag * DT_S, stop) / speed
        b.vx -= impulse * slide_x / c.mass
        b.vy -= impulse * slide_y / c.mass
        b.omega -= impulse * (lever_x * slide_y - lever_y * slide_x) / c.yaw_inertia


@compiled
@borrows
def collide(
    body: np.ndarray,
    axes: np.ndarray,
    p: np.ndarray,
    rows: np.ndarray,
    walls: int,
    contacts: int,
) -> None:
    """Solve with contacts or slipping wheels; count a collision when one with a wall begins.

    The rows of walls come first among the contacts.
    """
    b = body[0]
    grips = int(p[0].grips)
    impact = 0.0
    for i in range(walls):
        impact = max(impact, -approach_speed(body, rows, grips + 2 * i))
    if contacts != int(b.contacts):
        rows[grips:, LAST] = 0.0
        b.contacts = contacts
    solve_limited(body, axes, p, rows, contacts)
    for i in range(grips + 2 * contacts):
        rows[i, LAST] = rows[i, IMPULSE]
    touching = False
    for i in range(walls):
        touching = touching or rows[grips + 2 * i, IMPULSE] > 0.0
    if not touching:
        b.touch_s = max(b.touch_s - DT_S, 0.0)
        return
    if b.touch_s <= 0.0:
        b.collisions += 1.0
        b.impact_m_s = impact
    b.touch_s = EPISODE_S


@compiled
@borrows
def feed_motor(body: np.ndarray, axes: np.ndarray, p: np.ndarray, k: int) -> float:
    """Update current, heat and angle of motor k; returns what it draws from the rail [A]."""
    b, c, a = body[0], p[0], axes[k]
    a.angle += a.omega * DT_S
    mean = 0.0
    if a.mode > SHORTED:
        mean = a.start - a.slope * (a.omega - a.before)
        a.current = mean
        a.voltage = a.resistance * mean + 0.5 * c.k * (a.before + a.omega)
        wind_up(axes, k)
    elif a.mode != COAST:
        final = (a.voltage - 0.5 * c.k * (a.before + a.omega)) / a.resistance
        mean = a.held * a.current + (1.0 - a.held) * final
        a.current = a.decay * a.current + (1.0 - a.decay) * final
    heat = mean * mean * (a.resistance - c.bridge_ohm)
    a.winding_c, a.case_c = heat_step(
        heat,
        a.winding_c,
        a.case_c,
        c.winding_heat,
        c.case_heat,
        c.winding_to_case,
        c.case_to_air,
        c.air_c,
        DT_S,
    )
    a.draw = a.voltage * mean / b.bus_v
    return float(a.draw)


@compiled
@borrows
def feed_rail(body: np.ndarray, p: np.ndarray, source: float, load_a: float) -> None:
    """Share the load of all consumers among battery, brake resistor and the rail's capacitors."""
    b, c = body[0], p[0]
    quiet = source - b.polarisation_v
    b.resistor_a = 0.0
    if b.resistor_ohm > 0.0:
        b.resistor_a = resistor_current(
            b.bus_v, quiet, load_a, c.battery_ohm, c.charge_max, c.rail_farad,
            b.resistor_ohm, b.resistor_v, DT_S,
        )  # fmt: skip
    b.battery_a, b.rail_v = rail_step(
        b.bus_v, quiet, load_a + b.resistor_a, c.battery_ohm, c.charge_max, c.rail_farad, DT_S
    )


@compiled
@borrows
def advance_pose(body: np.ndarray, p: np.ndarray) -> None:
    """Move the base along the arc of its velocity (chord at the middle heading)."""
    b, c = body[0], p[0]
    vx = b.vx + b.omega * c.com_y
    vy = b.vy - b.omega * c.com_x
    middle = b.theta + 0.5 * DT_S * b.omega
    cos, sin = math.cos(middle), math.sin(middle)
    b.x += DT_S * (cos * vx - sin * vy)
    b.y += DT_S * (sin * vx + cos * vy)
    b.theta += DT_S * b.omega
    b.distance += DT_S * math.hypot(vx, vy)
