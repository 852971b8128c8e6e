"""The plant's state and constants as records that the compiled step reads and writes.

One record for the body, one for each axis (a motor with its bridge and its wheel), one of
constants: the step then reads like formulas, and a call costs the same as with bare arrays.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from firmware_sim.config.config import RobotConfig
from firmware_sim.config.drives.chassis import Chassis

DT_S: Final = 1.0e-3
"""Step of the plant [s]."""

BODY = np.dtype(
    [
        (name, np.float64)
        for name in (
            "x",  # base in world, m
            "y",
            "theta",
            "vx",  # velocity of the centre of mass in base, m/s
            "vy",
            "omega",
            "steering",  # rad, left positive
            "steering_cmd",
            "charge",
            "polarisation_v",
            "bus_v",
            "rail_v",  # of the rail's capacitors, if above the battery's
            "battery_a",
            "resistor_a",  # through the brake resistor
            "resistor_ohm",  # of the brake resistor
            "resistor_v",  # from which it conducts
            "collisions",  # episodes of contact
            "contacts",  # walls solved in the last step
            "touch_s",  # time until the present episode is over
            "impact_m_s",  # speed along the normal at the last collision
            "distance",  # of base along its path, m
        )
    ]
)

AXIS = np.dtype(
    [
        (name, np.float64)
        for name in (
            "mode",  # of the bridge, see plant_step
            "duty",  # after PWM and dead-band
            "omega",  # of the wheel, rad/s
            "angle",  # rad, unwrapped
            "current",  # A
            "winding_c",
            "case_c",
            "current_max",  # A
            "voltage_share",  # greatest output of the bridge, as a share of the rail
            "demand",  # of the drive's loop: current, or speed at the end of the ramp
            "ramp",  # greatest change of the speed's reference in one step
            "kp",  # A per rad/s
            "ki",  # A per rad
            "reference",  # rad/s
            "integral",  # A
            "sensor",  # axis whose speed the loop measures
            "sense",  # factor on it: 1 for a sound encoder
            "floor",  # relative change of the rolling radius
            "blocked",  # 1: a fault holds the wheel
            "rolling",  # rolling resistance, N m
            "radius",  # true rolling radius, m
            "voltage",  # at the bridge, mean over the last step
            "draw",  # out of the rail, mean over the last step, A
            "rim",  # workspace: radius on this floor, m
            "resistance",  # workspace: of winding and bridge
            "decay",  # workspace: see motor.current_decay
            "held",
            "start",  # workspace: see loop.loop_current
            "slope",
            "saturated",
            "inertia",  # workspace: effective, for an impulse
            "before",  # workspace: omega before the step
        )
    ]
)

CONSTANTS = np.dtype(
    [
        (name, np.float64)
        for name in (
            "axes",  # number of them
            "grips",  # number of them
            "steers",  # 1 if some of them turn with the steering
            "mass",
            "yaw_inertia",  # about the centre of mass
            "com_x",
            "com_y",
            "span",  # distance of the farthest contact, m
            "friction",
            "slip_ratio",
            "slip_speed",
            "drag",  # N, of castor or undriven wheels
            "drag_x",
            "drag_y",
            "wheel_inertia",  # rotor and wheel, at the wheel
            "k",  # gear ratio times back-EMF
            "viscous",
            "coulomb",
            "stiction_ratio",
            "gear_loss",
            "winding_ohm",
            "bridge_ohm",
            "inductance",
            "winding_heat",
            "case_heat",
            "winding_to_case",
            "case_to_air",
            "air_c",
            "cells_scale",  # cells times voltage scale
            "battery_ohm",
            "charge_max",  # A into the battery
            "rail_farad",
            "polarisation_ohm",
            "polarisation_gain",
            "capacity_ah",
            "electronics_a",
            "floor_noise",
            "floor_length",
            "steering_gain",
            "steering_step",  # greatest change in one step
            "steering_max",
            "steering_offset",
            "wall_friction",
            "reach",  # radius about base that holds the outline
            "grid_x",  # corner of the grid of walls, in world
            "grid_y",
        )
    ]
)


def places(record: np.dtype, *names: str) -> Iterator[int]:
    """Yield the positions of fields in a record."""
    return map(list(record.names or ()).index, names)


def constants(config: RobotConfig, chassis: Chassis) -> np.ndarray:
    """Record of constants, (1,), of the true robot."""
    p = np.zeros(1, CONSTANTS)
    s = config.simulation
    m, w, b = s.motor, s.wheels, s.battery
    outlines = [outline for body in config.outlines for outline in body]
    corners = np.array([corner for outline in outlines for corner in outline])
    gear = m.gear_ratio
    lag = s.steering.time_constant_s
    values = {
        "axes": len(chassis.wheels),
        "grips": len(chassis.grips),
        "steers": any(grip.steered for grip in chassis.grips),
        "mass": s.mass_kg,
        "yaw_inertia": s.yaw_inertia_kg_m2,
        "com_x": s.centre_of_mass_m[0],
        "com_y": s.centre_of_mass_m[1],
        "span": chassis.span_m,
        "friction": w.friction,
        "slip_ratio": w.slip_ratio,
        "slip_speed": w.slip_speed_m_s,
        "drag": chassis.drag.force_n,
        "drag_x": chassis.drag.x_m,
        "drag_y": chassis.drag.y_m,
        "wheel_inertia": m.rotor_inertia_kg_m2 * gear**2
        + w.inertia_kg_m2 * chassis.tyres_per_wheel,
        "k": gear * m.back_emf_v_s_rad,
        "viscous": m.viscous_n_m_s_rad * gear**2,
        "coulomb": m.coulomb_n_m * gear,
        "stiction_ratio": m.stiction_ratio,
        "gear_loss": 1.0 - m.gear_efficiency,
        "winding_ohm": m.resistance_ohm,
        "bridge_ohm": s.bridge.resistance_ohm,
        "inductance": m.inductance_h,
        "winding_heat": m.winding_heat_j_k,
        "case_heat": m.case_heat_j_k,
        "winding_to_case": m.winding_to_case_k_w,
        "case_to_air": m.case_to_air_k_w,
        "air_c": m.air_c,
        "cells_scale": b.cells * b.voltage_scale,
        "battery_ohm": b.internal_resistance_ohm,
        "charge_max": b.charge_current_max_a,
        "rail_farad": b.rail_capacitance_f,
        "polarisation_ohm": b.polarisation_resistance_ohm,
        "polarisation_gain": -math.expm1(-DT_S / b.polarisation_time_s),
        "capacity_ah": b.capacity_ah,
        "electronics_a": b.electronics_current_a,
        "floor_noise": w.floor_noise,
        "floor_length": w.floor_length_m,
        "steering_gain": -math.expm1(-DT_S / lag) if lag > 0 else 1.0,
        "wall_friction": s.wall_friction,
        "reach": float(np.max(np.hypot(corners[:, 0], corners[:, 1]))),
    }
    if steering := chassis.steering:
        values["steering_max"] = steering.max_rad
        values["steering_step"] = steering.rate_max_rad_s * DT_S
        values["steering_offset"] = steering.offset_rad
    for name, value in values.items():
        p[name] = value
    return p


def axis_records(config: RobotConfig, chassis: Chassis) -> np.ndarray:
    """Return the records of the axes at power-on, (n,)."""
    s = config.simulation
    axes = np.zeros(len(chassis.wheels), AXIS)
    for axis, wheel in zip(axes, chassis.wheels, strict=True):
        axis["radius"] = axis["rim"] = wheel.radius_m
        axis["rolling"] = s.wheels.rolling_resistance * wheel.load_n * wheel.radius_m
        axis["winding_c"] = axis["case_c"] = s.motor.air_c
    return axes
