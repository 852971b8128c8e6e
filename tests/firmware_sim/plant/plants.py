"""Plants to test on, and how they are driven."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from firmware_sim.config.config import RobotConfig, load_robot
from firmware_sim.plant.axis import Limits, Mode
from firmware_sim.plant.plant import Plant
from firmware_sim.world.world import World

CONFIGS = Path(__file__).parents[3] / "configs"
OPEN = World.from_segments([])
SMOOTH = {"simulation.wheels.floor_noise": 0.0}
FRICTIONLESS = {
    **SMOOTH,
    "simulation.motor.coulomb_n_m": 0.0,
    "simulation.motor.viscous_n_m_s_rad": 0.0,
    "simulation.motor.gear_efficiency": 1.0,
    "simulation.wheels.rolling_resistance": 0.0,
    "simulation.wheels.roller_drag": 0.0,
    "simulation.castor.drag": 0.0,
    "simulation.bridge.deadband": 0.0,
}
STIFF = {"simulation.wheels.slip_ratio": 0.0, "simulation.wheels.slip_speed_m_s": 1e-6}
"""Tyres that hardly give."""


def robot(name: str = "diff_drive", **more: Any) -> RobotConfig:
    """Return a robot of `configs/` on a smooth floor, with changed settings: `a__b` is `a.b`."""
    overrides = {key.replace("__", "."): value for key, value in more.items()}
    return load_robot(CONFIGS / f"{name}.toml", {**SMOOTH, **overrides})


def plant(config: RobotConfig, seed: int = 1, world: World = OPEN) -> Plant:
    """Return a plant of a robot."""
    return Plant(config, world, np.random.default_rng(seed))


def command(
    p: Plant, duty1: float, duty2: float, steering_rad: float = 0.0, mode: Mode = Mode.DUTY
) -> None:
    """Command one or two motors, and the steering."""
    for axis, duty in zip(p.axes, (duty1, duty2), strict=False):
        axis.command(mode, duty)
    p.steer(steering_rad)


def run_wheels(p: Plant, *speeds_rad_s: float, limits: Limits | None = None) -> None:
    """Let each wheel have its speed."""
    for axis, speed_rad_s in zip(p.axes, speeds_rad_s, strict=True):
        if limits is not None:
            axis.limits = limits
        axis.command(Mode.SPEED, speed_rad_s)


_ROVER: TypeAdapter[RobotConfig] = TypeAdapter(RobotConfig)


def rover(kind: str, settings: Mapping[str, Any] | None = None, **drive: Any) -> RobotConfig:
    """Return a robot of 16 kg on a smooth floor; settings by dotted key, as of a file."""
    data: dict[str, Any] = {
        "robot": {"name": kind},
        "drive": {"kind": kind, "wheel_radius_m": 0.08, "counts_per_revolution": 4096, **drive},
        "simulation": {
            "mass_kg": 16.0,
            "yaw_inertia_kg_m2": 0.5,
            "centre_of_mass_m": (0.0, 0.0),
            "body": ((0.3, 0.25), (-0.3, 0.25), (-0.3, -0.25), (0.3, -0.25)),
        },
    }
    motor = {"simulation.motor.resistance_ohm": 0.5, "simulation.motor.current_limit_a": 20.0}
    for key, value in {**SMOOTH, **motor, **(settings or {})}.items():
        *tables, last = key.split(".")
        table = data
        for name in tables:
            table = table.setdefault(name, {})
        table[last] = value
    return _ROVER.validate_python(data)


def skid_steer(
    settings: Mapping[str, Any] | None = None,
    track_width_m: float = 0.37559,
    wheelbase_m: float = 0.262,
    **drive: Any,
) -> RobotConfig:
    """Return a robot with the wheels of a Clearpath Jackal."""
    return rover(
        "skid_steer", settings, track_width_m=track_width_m, wheelbase_m=wheelbase_m, **drive
    )


def mecanum(settings: Mapping[str, Any] | None = None, **drive: Any) -> RobotConfig:
    """Return a robot on mecanum wheels."""
    return rover("mecanum", settings, **{"track_width_m": 0.3, "wheelbase_m": 0.36, **drive})


def omni(settings: Mapping[str, Any] | None = None, **drive: Any) -> RobotConfig:
    """Return a robot on omni wheels, three unless said otherwise."""
    return rover("omni", settings, **{"wheels": 3, "wheel_distance_m": 0.2, **drive})
