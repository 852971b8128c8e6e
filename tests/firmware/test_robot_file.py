"""What the simulator reads of a robot's file, and says about a wrong one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from firmware_sim.config import load_robot
from firmware_sim.errors import SimulationError
from firmware_sim.parameters import AckermannDrive, DifferentialDrive, TricycleDrive

CONFIGS = Path(__file__).parents[2] / "configs"
DIFF = CONFIGS / "diff_drive.toml"


def test_the_three_robots_are_of_their_kind_and_have_a_ring_of_eight() -> None:
    kinds = {
        "diff_drive": DifferentialDrive,
        "tricycle": TricycleDrive,
        "ackermann": AckermannDrive,
    }
    for name, kind in kinds.items():
        config = load_robot(CONFIGS / f"{name}.toml")
        assert isinstance(config.drive, kind)
        assert config.robot.name == name
        assert len(config.sonar) == 8


def test_all_sonars_sit_within_the_outline() -> None:
    for name in ("diff_drive", "tricycle", "ackermann"):
        config = load_robot(CONFIGS / f"{name}.toml")
        body = config.simulation.body
        for mount in config.sonar:
            sides = [
                (b[0] - a[0]) * (mount.y_m - a[1]) - (b[1] - a[1]) * (mount.x_m - a[0])
                for a, b in zip(body, body[1:] + body[:1], strict=True)
            ]
            assert all(s >= 0 for s in sides) or all(s <= 0 for s in sides), (name, mount.name)


def test_overrides_replace_values_by_dotted_key() -> None:
    config = load_robot(DIFF, {"simulation.battery.charge": 0.7, "simulation.lidar.beams": 90})
    assert config.simulation.battery.charge == 0.7
    assert config.simulation.lidar is not None
    assert config.simulation.lidar.beams == 90
    assert load_robot(DIFF).simulation.battery.charge == 1.0
    assert load_robot(CONFIGS / "tricycle.toml").simulation.lidar is None


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("simulation.motor.resistence_ohm", 1.0, 'did you mean "resistance_ohm"?'),
        ("simulation.motor.resistance_ohm", 0.0, "simulation.motor.resistance_ohm"),
        ("simulation.motor.resistance_ohm", "1", "found '1'"),
        ("simulation.battery.charge", 1.5, "simulation.battery.charge"),
        ("simulation.body", [[0.0, 0.0], [1.0, 0.0]], "at least 3"),
        ("simulation.body", [[0.0, 0.0], [1.0, 0.0], [0.2, 0.2], [0.0, 1.0]], "not convex"),
        ("simulation.springs", 3, "unknown key"),
        ("drive.wheelbase_m", 0.3, "drive.wheelbase_m: unknown key"),
        ("drive.kind", "hover", "drive"),
        ("drive.counts_per_revolution", 0, "drive.counts_per_revolution"),
        ("simulation.mass_kg.x", 0, "mass_kg is not a table"),
        ("can.bitrate", -1, "can.bitrate"),
    ],
)
def test_a_wrong_value_is_reported_with_file_and_key(key: str, value: Any, said: str) -> None:
    with pytest.raises(SimulationError) as error:
        load_robot(DIFF, {key: value})
    assert str(DIFF) in str(error.value)
    assert said in str(error.value)


def test_sections_of_robotctl_alone_are_not_looked_at() -> None:
    config = load_robot(DIFF, {"control.left.nonsense": 1, "mavlink.system_id": "x"})
    assert config.robot.name == "diff_drive"
