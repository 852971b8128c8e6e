"""What the simulator reads of a robot's file, and says about a wrong one."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from firmware_sim.config.config import load_robot, parse_override
from firmware_sim.config.drives.differential import DifferentialDrive
from firmware_sim.config.drives.steered import AckermannDrive, TricycleDrive
from firmware_sim.config.toml_lines import key_lines
from firmware_sim.errors import SimulationError

CONFIGS = Path(__file__).parents[3] / "configs"
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


def test_a_file_of_an_editor_that_marks_its_encoding_is_read(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(DIFF.read_text(encoding="utf-8"), encoding="utf-8-sig")
    assert load_robot(path) == load_robot(DIFF)


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
    assert config.simulation.lidars[0].beams == 90
    assert load_robot(DIFF).simulation.battery.charge == 1.0
    assert load_robot(CONFIGS / "tricycle.toml").simulation.lidars == ()


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("simulation.motor.resistence_ohm", 1.0, 'did you mean "resistance_ohm"?'),
        ("simulation.motor.resistance_ohm", 0.0, "simulation.motor.resistance_ohm"),
        ("simulation.motor.resistance_ohm", "1", "found '1'"),
        ("simulation.battery.charge", 1.5, "simulation.battery.charge"),
        ("simulation.body", [[0.0, 0.0], [1.0, 0.0]], "at least 3"),
        ("simulation.body", [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]], "crosses itself"),
        ("body.part", [{"name": "arm", "outline": [[0.0, 0.0], [1.0, 0.0]]}], "at least 3"),
        ("body.part", [{"nam": "arm", "outline": [[0, 0], [1, 0], [0, 1]]}], 'mean "name"?'),
        ("simulation.springs", 3, "unknown key"),
        ("drive.wheelbase_m", 0.3, "drive.wheelbase_m: unknown key"),
        ("drive.kind", "hover", "drive"),
        ("drive.counts_per_revolution", 0, "drive.counts_per_revolution"),
        ("simulation.mass_kg.x", 0, "mass_kg is not a table"),
        ("simulation.body", [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [0.0, 1.0]], "straight side"),
        (
            "simulation.body",
            [[0.0, 1.0], [0.588, -0.809], [-0.951, 0.309], [0.951, 0.309], [-0.588, -0.809]],
            "crosses itself",
        ),
        ("simulation.body", [[0, 0], [1e5, 0], [0, 1]], "a corner at 100000 m; allowed are 10 m"),
        ("simulation.mass_kg", 1e300, "simulation.mass_kg: must be less than or equal to 1000000"),
        ("simulation.motor.stiction_ratio", float("inf"), "stiction_ratio"),
        ("simulation.motor.winding_heat_j_k", 1e-6, "warms within 2.5e-06 s"),
        ("simulation.lidar.min_range_m", 20.0, "min_range_m: 20.0 is not less than max_range_m"),
        ("simulation.sonar.min_range_m", 5.0, "min_range_m: 5.0 is not less than max_range_m"),
        ("simulation.lidar.rate_hz", 1e12, "must be less than or equal to 240, found 100"),
        ("camera.rate_hz", 1e-300, "camera.rate_hz: must be greater than or equal to 0.1"),
        ("simulation.camera.z_error_m", -0.4, ": simulation.camera.z_error_m: puts the camera"),
        ("drive", 3, "drive: must be a table, found 3"),
        ("drive.kind", "tricyle", "found 'tricyle'; did you mean \"tricycle\"?"),
        (
            "drive.kind",
            "tricyle",
            "must be one of differential, tricycle, ackermann, skid_steer, mecanum, omni, found",
        ),
        ("sonar", 4, "sonar: must be a list, found 4"),
        ("sonar", {"name": "a"}, "sonar: each must be a table of its own, [[sonar]]"),
        ("camera.intrinsics.distortion", [0.1] * 6, "at most 5 entries, found 6"),
        ("limits.v_max_m_s", float("inf"), "limits.v_max_m_s"),
        ("can.bitrate", -1, "can.bitrate"),
        ("can.bitrate", 83_333, "bitrate: 83333: a bit must last whole nanoseconds"),
    ],
)
def test_a_wrong_value_is_reported_with_its_setting_and_key(
    key: str, value: Any, said: str
) -> None:
    with pytest.raises(SimulationError) as error:
        load_robot(DIFF, {key: value})
    assert all(line.startswith(f"--set {key}=") for line in str(error.value).splitlines())
    assert said in str(error.value)


def test_sections_of_robotctl_alone_are_not_looked_at() -> None:
    config = load_robot(DIFF, {"control.left.nonsense": 1, "mavlink.system_id": "x"})
    assert config.robot.name == "diff_drive"


def test_a_table_that_is_wrong_is_not_copied_into_the_message() -> None:
    with pytest.raises(SimulationError) as error:
        load_robot(DIFF, {"simulation.body": []})
    assert str(error.value) == (
        "--set simulation.body=[]: simulation.body: 0 corners; an outline needs at least 3"
    )


@pytest.mark.parametrize(
    ("row", "wrong", "said"),
    [
        ("v_max_m_s = 0.8", "v_max_m_s = 1e300", "less than or equal to 1000000, found 1e+300"),
        ("mass_kg = 6.0", "mass_kg = nan", "must be a finite number, found nan"),
        ("track_width_m = 0.300", "track_width_m = -1.0", "equal to 0.000000001, found -1.0"),
        ("gear_ratio = 20.0", "gear_ratios = 20.0", 'did you mean "gear_ratio"?'),
        ("bitrate = 1_000_000", "bitrate = 83333", "83333: a bit must last whole nanoseconds"),
        ('name = "rear"', "name = 3", "found 3"),
        ("rate_hz = 10.0", "rate_hz = 1e12", "less than or equal to 240, found 1000000000000.0"),
        ('kind = "differential"', 'kind = "diferential"', "found 'diferential'; did you mean"),
        ("max_range_m = 4.0", "max_range_m = 4.0\nmin_range_m = 13.0", "13.0 is not less than"),
    ],
)
def test_a_wrong_value_of_a_file_is_reported_with_its_line(
    tmp_path: Path, row: str, wrong: str, said: str
) -> None:
    text, path = DIFF.read_text(encoding="utf-8"), tmp_path / "robot.toml"
    before, found, after = text.partition(f"\n{row}")
    assert found
    path.write_text(f"{before}\n{wrong}{after}", encoding="utf-8")
    number = before.count("\n") + 2 + wrong.count("\n")
    with pytest.raises(SimulationError) as error:
        load_robot(path)
    last = str(error.value).splitlines()[-1]
    key = wrong.splitlines()[-1].partition(" = ")[0]
    assert re.match(rf"{re.escape(str(path))}:{number}: [\w.]*\b{key}: ", last), last
    assert said in last


def test_what_is_missing_has_the_line_of_its_table_and_without_a_table_none(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text('[robot]\nname = "a"\n\n[simulation]\nmass_kg = 1.0\n', encoding="utf-8")
    with pytest.raises(SimulationError) as error:
        load_robot(path)
    assert set(str(error.value).splitlines()) == {
        f"{path}: drive: missing",
        f"{path}:4: simulation.yaw_inertia_kg_m2: missing",
    }


def test_without_an_outline_of_its_own_the_true_body_is_the_one_that_robotctl_believes_in(
    tmp_path: Path,
) -> None:
    text = re.sub(r"\nbody = \[.*?\n\]", "", DIFF.read_text(encoding="utf-8"), flags=re.DOTALL)
    path = tmp_path / "robot.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SimulationError, match=r"simulation\.body: missing, and so is body"):
        load_robot(path)
    corners = [[0.2, -0.2], [0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2]]
    assert load_robot(path, {"body.outline": corners}).outline == tuple(map(tuple, corners))
    with pytest.raises(SimulationError, match=r"body\.outline: .*crosses itself"):
        load_robot(path, {"body.outline": [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]})
    assert load_robot(DIFF, {"body.outline": corners}).outline == load_robot(DIFF).simulation.body


VALUES = """\
first = [
    [1, 2],
    [3]
]
text = \"\"\"
[no.header]
no = "key"
\"\"\"
[[list]]
a.b = 1
[list.inner]
c = 2
[[list]]
'd' = {e = 3}
"""


def test_lines_are_found_behind_values_that_look_like_headers() -> None:
    assert key_lines(VALUES) == {
        ("first",): 1,
        ("text",): 5,
        ("list", 0): 9,
        ("list", 0, "a", "b"): 10,
        ("list", 0, "inner"): 11,
        ("list", 0, "inner", "c"): 12,
        ("list", 1): 13,
        ("list", 1, "d"): 14,
    }


@pytest.mark.parametrize(
    "text", ["robot = " + "[" * 5000, "robot = " + "9" * 5000, "[robot\n", "\ufeff[robot]\n"]
)
def test_what_is_no_toml_is_told_by_its_file(text: str, tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SimulationError, match=r"robot\.toml: "):
        load_robot(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("=3", "not of the form key.subkey=value"),
        ("simulation..x=1", "not of the form key.subkey=value"),
        ("simulation.mass_kg", "not of the form key.subkey=value"),
        ("simulation.mass_kg=heavy", "text in quotes"),
        ("simulation.mass_kg=" + "[" * 5000, "not of the form key.subkey=value"),
        ("battery.charge=0.5", 'did you mean "simulation.battery.charge"?'),
        ("simulaton.mass_kg=3", 'did you mean "simulation"?'),
        ("control.left.kp=3", "reads no table control, allowed: robot, drive, simulation"),
    ],
)
def test_a_setting_that_would_do_nothing_is_refused(text: str, said: str) -> None:
    with pytest.raises(SimulationError, match=re.escape(said)):
        parse_override(text)
    assert parse_override("simulation.battery.charge=0.5") == ("simulation.battery.charge", 0.5)


@pytest.mark.parametrize(
    ("state", "named", "said"),
    [
        ("1", '["empty"]', r"body\.state: 1; allowed are 0 to 0"),
        ("0", "[]", r"body\.state: 0; there are no states"),
        ("0", '["empty"]', r"'emtpy'; did you mean \"empty\"\?"),
    ],
)
def test_a_state_of_the_body_that_there_is_not_is_refused(
    state: str, named: str, said: str, tmp_path: Path
) -> None:
    path = tmp_path / "robot.toml"
    corners = "outline = [[0.2, -0.2], [0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2]]"
    part = f'[[body.part]]\nname = "cart"\n{corners}\nstates = ["emtpy"]\n'
    body = f"[body]\n{corners}\nstates = {named}\nstate = {state}\n"
    is_part = said.startswith("'")
    text = DIFF.read_text(encoding="utf-8") + body + (part if is_part else "")
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SimulationError, match=said):
        load_robot(path)
