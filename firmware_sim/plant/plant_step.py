"""One millisecond of the plant, compiled: motors and battery, tyres and walls, motion.

The order within a step: steering servo; rail voltage from the current of the step before; motors
without load; impulses of tyres and walls; currents for the mean speed of the step; heat and
charge; motion along the arc of the new velocity.
"""

from __future__ import annotations

import math

import numpy as np

from firmware_sim.compiled import compiled, uniform
from firmware_sim.plant.battery import charge_step, open_circuit_voltage, polarisation_step
from firmware_sim.plant.contact import (
    IMPULSE,
    LAST,
    ROWS,
    TYRES,
    apply_impulse,
    solve_limited,
    solve_tyres,
    tyre_rows,
)
from firmware_sim.plant.discs import disc_rows
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

COAST = 1
BRAKE = 2
EPISODE_S = 0.3
"""Contacts less than this apart are one collision."""


@compiled
def run_plant(
    steps: int,
    body: np.ndarray,
    wheels: np.ndarray,
    p: np.ndarray,
    outline: np.ndarray,
    segments: np.ndarray,
    origin: np.ndarray,
    grid: np.ndarray,
    rows: np.ndarray,
    noise: np.ndarray,
    discs: np.ndarray,
) -> None:
    """Advance body and wheels by a number of steps of `DT_S`."""
    b, c = body[0], p[0]
    motors = int(c.wheels)
    for _ in range(steps):
        turn_steering(body, p)
        source = c.cells_scale * open_circuit_voltage(b.charge)
        b.bus_v = source - b.polarisation_v - c.battery_ohm * b.battery_a
        for k in range(motors):
            spin_motor(body, wheels, p, k)
            roughen(wheels, p, k, noise)
        move_freely(body, p)
        tyre_rows(body, p, rows)
        free = solve_tyres(body, wheels, p, rows)
        walls = wall_rows(body, p, outline, segments, origin, grid, rows)
        contacts = disc_rows(body, p, outline, discs, origin[2], rows, walls)
        if free and contacts == 0:
            for i in range(TYRES):
                apply_impulse(body, wheels, p, rows, i, rows[i, IMPULSE])
                rows[i, LAST] = rows[i, IMPULSE]
            b.contacts = 0
            b.touch_s = max(b.touch_s - DT_S, 0.0)
        else:
            collide(body, wheels, p, rows, walls, contacts)
        b.battery_a = c.electronics_a
        for k in range(motors):
            b.battery_a += feed_motor(body, wheels, p, k)
        b.polarisation_v = polarisation_step(
            b.polarisation_v, b.battery_a, c.polarisation_ohm, c.polarisation_gain
        )
        b.charge = charge_step(b.charge, b.battery_a, c.capacity_ah, DT_S)
        advance_pose(body, p)


@compiled
def turn_steering(body: np.ndarray, p: np.ndarray) -> None:
    """Move the steering servo: first-order lag with a limited rate."""
    b, c = body[0], p[0]
    step = (b.steering_cmd - b.steering) * c.steering_gain
    b.steering += min(max(step, -c.steering_step), c.steering_step)


@compiled
def spin_motor(body: np.ndarray, wheels: np.ndarray, p: np.ndarray, k: int) -> None:
    """Speed of wheel k after the step if off the ground, and the inertia of its motor."""
    b, c, w = body[0], p[0], wheels[k]
    w.before = w.omega
    w.resistance = winding_resistance(c.winding_ohm, w.winding_c) + c.bridge_ohm
    mode = int(b.bridge)
    if mode == COAST:
        w.current = 0.0
        w.voltage = 0.0
        torque, motor_damping = 0.0, 0.0
    else:
        w.decay, w.held = current_decay(w.resistance, c.inductance, DT_S)
        w.voltage = 0.0
        if mode != BRAKE:
            w.voltage = chopped_voltage(
                w.duty * b.bus_v,
                b.bus_v,
                c.k * w.omega,
                w.current,
                w.resistance,
                w.decay,
                c.current_limit,
            )
        torque = c.k * (w.held * w.current + (1.0 - w.held) * w.voltage / w.resistance)
        motor_damping = (1.0 - w.held) * c.k * c.k / w.resistance
    friction = w.rolling + friction_torque(
        w.omega, torque - motor_damping * w.omega, c.coulomb, c.stiction_ratio, c.gear_loss
    )
    w.omega, w.inertia = wheel_step(
        w.omega, torque, friction, motor_damping + c.viscous, c.wheel_inertia, DT_S
    )
    if w.blocked > 0.0:
        w.omega, w.inertia = 0.0, np.inf


@compiled
def roughen(wheels: np.ndarray, p: np.ndarray, k: int, noise: np.ndarray) -> None:
    """Let the rolling radius of wheel k wander over the floor (a walk with memory of a length)."""
    c, w = p[0], wheels[k]
    share = min(abs(w.before) * w.radius * DT_S / c.floor_length, 1.0)
    if c.floor_noise > 0.0 and share > 0.0:
        draw = (uniform(noise) - 0.5) * math.sqrt(12.0)
        w.floor += -share * w.floor + c.floor_noise * math.sqrt(2.0 * share) * draw


@compiled
def move_freely(body: np.ndarray, p: np.ndarray) -> None:
    """Velocities after the step without tyres and walls: turning of the frame, and drag."""
    b, c = body[0], p[0]
    vx = b.vx + DT_S * b.omega * b.vy
    b.vy -= DT_S * b.omega * b.vx
    b.vx = vx
    lever_x, lever_y = c.drag_x - c.com_x, c.drag_y - c.com_y
    slide_x = b.vx - b.omega * lever_y
    slide_y = b.vy + b.omega * lever_x
    speed = math.hypot(slide_x, slide_y)
    if speed > 0.0:
        # No more than what stops the point.
        lever2 = lever_x * lever_x + lever_y * lever_y
        stop = speed / (1.0 / c.mass + lever2 / c.yaw_inertia)
        impulse = min(c.drag * DT_S, stop) / speed
        b.vx -= impulse * slide_x / c.mass
        b.vy -= impulse * slide_y / c.mass
        b.omega -= impulse * (lever_x * slide_y - lever_y * slide_x) / c.yaw_inertia


@compiled
def collide(
    body: np.ndarray,
    wheels: np.ndarray,
    p: np.ndarray,
    rows: np.ndarray,
    walls: int,
    contacts: int,
) -> None:
    """Solve with contacts or slipping tyres; count a collision when one with a wall begins.

    The rows of walls are the first of the contacts.
    """
    b = body[0]
    impact = 0.0
    for i in range(walls):
        impact = max(impact, -approach_speed(body, rows, TYRES + 2 * i))
    if contacts != int(b.contacts):
        rows[TYRES:ROWS, LAST] = 0.0
        b.contacts = contacts
    solve_limited(body, wheels, p, rows, contacts)
    for i in range(TYRES + 2 * contacts):
        rows[i, LAST] = rows[i, IMPULSE]
    touching = False
    for i in range(walls):
        touching = touching or rows[TYRES + 2 * i, IMPULSE] > 0.0
    if not touching:
        b.touch_s = max(b.touch_s - DT_S, 0.0)
        return
    if b.touch_s <= 0.0:
        b.collisions += 1.0
        b.impact_m_s = impact
    b.touch_s = EPISODE_S


@compiled
def feed_motor(body: np.ndarray, wheels: np.ndarray, p: np.ndarray, k: int) -> float:
    """Update current, heat and angle of motor k; returns what it draws from the rail [A]."""
    b, c, w = body[0], p[0], wheels[k]
    w.angle += w.omega * DT_S
    mean = 0.0
    if int(b.bridge) != COAST:
        final = (w.voltage - 0.5 * c.k * (w.before + w.omega)) / w.resistance
        mean = w.held * w.current + (1.0 - w.held) * final
        w.current = w.decay * w.current + (1.0 - w.decay) * final
    heat = mean * mean * (w.resistance - c.bridge_ohm)
    w.winding_c, w.case_c = heat_step(
        heat,
        w.winding_c,
        w.case_c,
        c.winding_heat,
        c.case_heat,
        c.winding_to_case,
        c.case_to_air,
        c.air_c,
        DT_S,
    )
    return float(w.voltage * mean / b.bus_v)


@compiled
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
