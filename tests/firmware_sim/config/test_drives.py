"""Wheels of all kinds of drives: loads, names, errors of geometry, and wrong files."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from firmware_sim.config.config import RobotConfig, load_robot
from firmware_sim.errors import SimulationError
from tests.firmware_sim.plant.plants import CONFIGS, mecanum, omni, robot, skid_steer

FOUR = ("front_left", "front_right", "rear_left", "rear_right")
SIX = ("front_left", "front_right", "middle_left", "middle_right", "rear_left", "rear_right")

KINDS = {
    "differential": robot("diff_drive"),
    "tricycle": robot("tricycle"),
    "ackermann": robot("ackermann"),
    "skid_steer": skid_steer(),
    "skid_steer of six": skid_steer(wheels_per_side=3),
    "mecanum": mecanum(),
    "omni of three": omni(),
    "omni of four": omni(wheels=4),
}


@pytest.mark.parametrize("config", KINDS.values(), ids=KINDS)
def test_each_driven_wheel_has_a_name_a_radius_and_a_grip_along_its_rim(
    config: RobotConfig,
) -> None:
    chassis = config.drive.chassis(config.simulation)
    assert len(chassis.wheels) == len(set(config.drive.wheel_names))
    rolling = [grip.wheel for grip in chassis.grips if grip.roll]
    assert sorted(set(rolling)) == list(range(len(chassis.wheels)))
    for grip in chassis.grips:
        assert math.hypot(*grip.along) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("name", "names"),
    [
        ("differential", ("left", "right")),
        ("ackermann", ("drive",)),
        ("skid_steer", FOUR),
        ("skid_steer of six", SIX),
        ("mecanum", FOUR),
        ("omni of three", ("wheel_1", "wheel_2", "wheel_3")),
    ],
)
def test_wheels_stand_in_the_order_of_the_robots_file(name: str, names: tuple[str, ...]) -> None:
    assert KINDS[name].drive.wheel_names == names


def test_wheels_stand_where_their_names_say() -> None:
    for config in (KINDS["skid_steer of six"], KINDS["mecanum"]):
        chassis = config.drive.chassis(config.simulation)
        for number, name in enumerate(config.drive.wheel_names):
            x, y = next((g.x_m, g.y_m) for g in chassis.grips if g.wheel == number)
            assert np.sign(x) == {"front": 1, "middle": 0, "rear": -1}[name.partition("_")[0]]
            assert (y > 0) == name.endswith("left")
    config = omni(wheels=4, first_wheel_deg=30.0)
    grips = [g for g in config.drive.chassis(config.simulation).grips if g.roll]
    for number, grip in enumerate(grips):
        assert math.hypot(grip.x_m, grip.y_m) == pytest.approx(0.2)
        around = math.degrees(math.atan2(grip.y_m, grip.x_m)) - 30.0 - 90.0 * number
        assert math.remainder(around, 360.0) == pytest.approx(0.0, abs=1e-9)


@given(x=st.floats(-0.1, 0.1), y=st.floats(-0.15, 0.15), name=st.sampled_from(list(KINDS)[3:]))
def test_loads_balance_the_weight_and_its_moments(x: float, y: float, name: str) -> None:
    assume(not name.startswith("omni") or math.hypot(x, y) < 0.09)
    config = KINDS[name]
    more: dict[str, Any] = {"simulation.centre_of_mass_m": (x, y)}
    drive = {"wheels_per_side": 3} if name.endswith("six") else {}
    drive = {"wheels": 4} if name.endswith("four") else drive
    make = {"skid_steer": skid_steer, "mecanum": mecanum, "omni": omni}[config.drive.kind]
    try:
        config = make(more, **drive)
    except ValueError:
        # Only where a wheel would be lifted: never so near the middle. Of six on equal springs it
        # is an end one, once the centre of mass is two thirds of the way to it.
        assert abs(x) + abs(y) > (0.08 if name.endswith("six") else 0.1)
        return
    chassis = config.drive.chassis(config.simulation)
    places = {g.wheel: (g.x_m, g.y_m) for g in chassis.grips}
    loads = np.array([wheel.load_n for wheel in chassis.wheels])
    contacts = np.array([places[k] for k in range(len(loads))])
    assert loads.min() >= 0.0
    assert loads.sum() == pytest.approx(16.0 * 9.80665)
    assert loads @ contacts == pytest.approx(16.0 * 9.80665 * np.array([x, y]), abs=1e-9)
    # Springs under a stiff body: the loads of any three wheels give those of the others.
    columns = np.column_stack([np.ones(len(loads)), contacts])
    plane = np.linalg.lstsq(columns, loads, rcond=None)[0]
    assert columns @ plane == pytest.approx(loads, abs=1e-9)


def test_every_wheel_may_have_an_error_of_its_own() -> None:
    errors = (0.01, -0.02, 0.03, 0.0)
    config = mecanum({"simulation.errors.wheel_radius": errors})
    radii = [wheel.radius_m for wheel in config.drive.chassis(config.simulation).wheels]
    assert radii == pytest.approx([0.08 * (1 + error) for error in errors])


@pytest.mark.parametrize(
    ("make", "key", "scaled"),
    [
        (mecanum, "track_width", 1),
        (mecanum, "wheelbase", 0),
        (skid_steer, "track_width", 1),
        (skid_steer, "wheelbase", 0),
        (omni, "wheel_distance", None),
    ],
)
def test_errors_of_geometry_move_the_true_wheels(make: Any, key: str, scaled: int | None) -> None:
    nominal, true = (
        np.array([(g.x_m, g.y_m) for g in config.drive.chassis(config.simulation).grips])
        for config in (make(), make({f"simulation.errors.{key}": 0.1}))
    )
    factors = np.array([1.1, 1.1]) if scaled is None else np.where(np.arange(2) == scaled, 1.1, 1.0)
    assert true == pytest.approx(nominal * factors)


MECANUM = """
[drive]
kind = "mecanum"
track_width_m = 0.3
wheelbase_m = 0.36
wheel_radius_m = 0.08
counts_per_revolution = 4096
"""
OMNI = """
[drive]
kind = "omni"
wheels = 3
wheel_distance_m = 0.2
wheel_radius_m = 0.08
counts_per_revolution = 4096
"""
SKID = MECANUM.replace("mecanum", "skid_steer")
REST = """
[robot]
name = "rover"

[simulation]
mass_kg = 16.0
yaw_inertia_kg_m2 = 0.5
centre_of_mass_m = [0.0, 0.0]
body = [[0.3, 0.25], [-0.3, 0.25], [-0.3, -0.25], [0.3, -0.25]]

[simulation.errors]
wheel_radius = []
"""


@pytest.mark.parametrize(
    ("drive", "row", "wrong", "said"),
    [
        (MECANUM, "wheelbase_m = 0.36", "", "drive.wheelbase_m: missing"),
        (MECANUM, 'kind = "mecanum"', 'kind = "mecanam"', 'did you mean "mecanum"?'),
        (MECANUM, "wheelbase_m = 0.36", "wheelbase_m = -0.1", "drive.wheelbase_m: must be greater"),
        (MECANUM, "wheelbase_m = 0.36", "wheel_base_m = 0.36", 'did you mean "wheelbase_m"?'),
        (MECANUM, "wheelbase_m = 0.36", "wheelbase_m = 0.36\nwheels = 4", "drive.wheels: unknown"),
        (OMNI, "wheels = 3", "wheels = 5", "drive.wheels: must be 3 or 4, found 5"),
        (OMNI, "wheels = 3", "", "drive.wheels: missing"),
        (OMNI, "wheels = 3", 'wheels = 3\nfirst_wheel_deg = "0"', "drive.first_wheel_deg"),
        (SKID, "wheelbase_m = 0.36", "wheelbase_m = 0.36\nwheels_per_side = 4", "must be 2 or 3"),
        (SKID, "wheelbase_m = 0.36", "wheelbase_m = 0.36\nslip_factor = 0.9", "drive.slip_factor"),
        (
            SKID,
            "wheel_radius = []",
            "wheel_radius = [0.01, 0.01]",
            "2 entries; allowed is one for each wheel (front_left, front_right, rear_left, ",
        ),
        (
            OMNI,
            "centre_of_mass_m = [0.0, 0.0]",
            "centre_of_mass_m = [0.15, 0.1]",
            "at 0.15, 0.1 the robot would tip over, allowed is a place between the wheels",
        ),
    ],
)
def test_a_wrong_drive_is_reported_with_its_line(
    tmp_path: Path, drive: str, row: str, wrong: str, said: str
) -> None:
    path, text = tmp_path / "rover.toml", drive + REST
    assert row in text
    path.write_text(text, encoding="utf-8")
    load_robot(path)
    changed = text.replace(row, wrong)
    path.write_text(changed, encoding="utf-8")
    with pytest.raises(SimulationError) as error:
        load_robot(path)
    assert said in str(error.value)
    place = str(error.value).partition(": ")[0]
    assert place.startswith(f"{path}:")
    lines = changed.splitlines()
    named = lines[int(place.rpartition(":")[2]) - 1]
    last = wrong.splitlines()[-1] if wrong else "[drive]"
    assert named in (last, "[drive]")


def test_the_radii_of_a_robot_with_one_motor_have_one_error() -> None:
    for name, errors in itertools.product(("tricycle", "ackermann"), ([0.02], [])):
        load_robot(CONFIGS / f"{name}.toml", {"simulation.errors.wheel_radius": errors})
    with pytest.raises(
        SimulationError, match=r"2 entries; allowed is one for each wheel \(drive\)"
    ):
        load_robot(CONFIGS / "tricycle.toml", {"simulation.errors.wheel_radius": [0.0, 0.0]})
