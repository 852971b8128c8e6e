"""The plant's state and constants as records that the compiled step reads and writes.

One record for the body, one for each motor with its wheel, one of constants: the step then reads
like formulas, and a call costs the same as with bare arrays.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from firmware_sim.config.config import RobotConfig
from firmware_sim.config.parameters import AckermannDrive, DifferentialDrive, Drive, TricycleDrive

GRAVITY_M_S2: Final = 9.80665
DT_S: Final = 1.0e-3
"""Step of the plant."""

DIFFERENTIAL: Final = 0
FRONT_DRIVEN: Final = 1
REAR_DRIVEN: Final = 2

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
            "bridge",  # Bridge
            "charge",
            "polarisation_v",
            "bus_v",
            "battery_a",
            "collisions",  # episodes of contact
            "contacts",  # walls solved in the last step
            "touch_s",  # time until the present episode is over
            "impact_m_s",  # speed along the normal at the last collision
            "distance",  # of base along its path, m
        )
    ]
)

WHEEL = np.dtype(
    [
        (name, np.float64)
        for name in (
            "duty",  # after PWM and dead-band
            "omega",  # rad/s
            "angle",  # rad, unwrapped
            "current",  # A
            "winding_c",
            "case_c",
            "floor",  # relative change of the rolling radius
            "blocked",  # 1: a fault holds the wheel
            "rolling",  # rolling resistance, N m
            "radius",  # true rolling radius, m
            "voltage",  # at the bridge, mean over the last step
            "resistance",  # workspace: of winding and bridge
            "decay",  # workspace: see motor.current_decay
            "held",
            "inertia",  # workspace: what an impulse meets
            "before",  # workspace: omega before the step
        )
    ]
)

CONSTANTS = np.dtype(
    [
        (name, np.float64)
        for name in (
            "kind",
            "wheels",
            "mass",
            "yaw_inertia",  # about the centre of mass
            "com_x",
            "com_y",
            "half_track",
            "wheelbase",
            "load0",  # N on the contact of each row, see contact.py
            "load1",
            "load2",
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
            "current_limit",
            "winding_heat",
            "case_heat",
            "winding_to_case",
            "case_to_air",
            "air_c",
            "cells_scale",  # cells times voltage scale
            "battery_ohm",
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
            "centre_x",  # a point inside the outline
            "centre_y",
        )
    ]
)


def constants(config: RobotConfig) -> np.ndarray:
    """Record of constants, (1,), of the true robot: nominal geometry with its errors applied."""
    p = np.zeros(1, CONSTANTS)
    s, drive = config.simulation, config.drive
    m, w, b = s.motor, s.wheels, s.battery
    outline = np.array(s.body)
    centre = outline.mean(axis=0)
    driven = 2 if isinstance(drive, DifferentialDrive | AckermannDrive) else 1
    wheels_per_motor = driven if isinstance(drive, AckermannDrive) else 1
    gear = m.gear_ratio
    lag = s.steering.time_constant_s
    values = {
        "mass": s.mass_kg,
        "yaw_inertia": s.yaw_inertia_kg_m2,
        "com_x": s.centre_of_mass_m[0],
        "com_y": s.centre_of_mass_m[1],
        "friction": w.friction,
        "slip_ratio": w.slip_ratio,
        "slip_speed": w.slip_speed_m_s,
        "wheel_inertia": m.rotor_inertia_kg_m2 * gear**2 + w.inertia_kg_m2 * wheels_per_motor,
        "k": gear * m.back_emf_v_s_rad,
        "viscous": m.viscous_n_m_s_rad * gear**2,
        "coulomb": m.coulomb_n_m * gear,
        "stiction_ratio": m.stiction_ratio,
        "gear_loss": 1.0 - m.gear_efficiency,
        "winding_ohm": m.resistance_ohm,
        "bridge_ohm": s.bridge.resistance_ohm,
        "inductance": m.inductance_h,
        "current_limit": m.current_limit_a,
        "winding_heat": m.winding_heat_j_k,
        "case_heat": m.case_heat_j_k,
        "winding_to_case": m.winding_to_case_k_w,
        "case_to_air": m.case_to_air_k_w,
        "air_c": m.air_c,
        "cells_scale": b.cells * b.voltage_scale,
        "battery_ohm": b.internal_resistance_ohm,
        "polarisation_ohm": b.polarisation_resistance_ohm,
        "polarisation_gain": -math.expm1(-DT_S / b.polarisation_time_s),
        "capacity_ah": b.capacity_ah,
        "electronics_a": b.electronics_current_a,
        "floor_noise": w.floor_noise,
        "floor_length": w.floor_length_m,
        "steering_gain": -math.expm1(-DT_S / lag) if lag > 0 else 1.0,
        "wall_friction": s.wall_friction,
        "reach": float(np.max(np.hypot(outline[:, 0], outline[:, 1]))),
        "centre_x": float(centre[0]),
        "centre_y": float(centre[1]),
        **_geometry(config),
    }
    for name, value in values.items():
        p[name] = value
    return p


def nominal_radii(drive: Drive) -> tuple[float, float]:
    """Radii of the left and right wheel of a differential drive, or twice that of the one [m]."""
    if not isinstance(drive, DifferentialDrive):
        return drive.wheel_radius_m, drive.wheel_radius_m
    left = 2.0 * drive.wheel_radius_m / (1.0 + drive.wheel_radius_ratio)
    return left, left * drive.wheel_radius_ratio


def _geometry(config: RobotConfig) -> dict[str, float]:
    """Return the drive's kind, lengths, contact loads and drag of the passive wheels."""
    s, drive = config.simulation, config.drive
    if isinstance(drive, DifferentialDrive):
        return _differential(config, drive)
    wheelbase = drive.wheelbase_m * (1 + s.errors.wheelbase)
    weight = s.mass_kg * GRAVITY_M_S2
    front = weight * s.centre_of_mass_m[0] / wheelbase
    rear = weight - front
    if front <= 0 or rear <= 0:
        raise ValueError("centre_of_mass_m: not between the axles")
    front_driven = isinstance(drive, TricycleDrive) and drive.driven == "front"
    free = rear if front_driven else front
    driven_load = front if front_driven else rear
    return {
        "kind": FRONT_DRIVEN if front_driven else REAR_DRIVEN,
        "wheels": 1,
        "wheelbase": wheelbase,
        "half_track": (
            drive.track_width_m * (1 + s.errors.track_width) / 2
            if isinstance(drive, AckermannDrive)
            else 0.0
        ),
        "load0": driven_load,
        "load1": front,
        "load2": rear,
        "drag": free * s.wheels.rolling_resistance,
        "drag_x": 0.0 if front_driven else wheelbase,
        "steering_max": drive.steering_max_rad,
        "steering_step": drive.steering_rate_max_rad_s * DT_S,
        "steering_offset": drive.steering_offset_rad + s.errors.steering_offset_rad,
    }


def _differential(config: RobotConfig, drive: DifferentialDrive) -> dict[str, float]:
    """Share the weight among two wheels and a castor, by balance of moments."""
    s = config.simulation
    weight = s.mass_kg * GRAVITY_M_S2
    half_track = drive.track_width_m * (1 + s.errors.track_width) / 2
    com_x, com_y = s.centre_of_mass_m
    castor_x, castor_y = s.castor.position_m
    castor = weight * com_x / castor_x if castor_x != 0 else 0.0
    axle = weight - castor
    turning = (weight * com_y - castor * castor_y) / half_track
    left, right = (axle + turning) / 2, (axle - turning) / 2
    if min(castor, left, right) < 0:
        raise ValueError("centre_of_mass_m: not between the wheels and the castor")
    return {
        "kind": DIFFERENTIAL,
        "wheels": 2,
        "half_track": half_track,
        "load0": left,
        "load1": right,
        "load2": axle,
        "drag": castor * s.castor.drag,
        "drag_x": castor_x,
        "drag_y": castor_y,
    }
