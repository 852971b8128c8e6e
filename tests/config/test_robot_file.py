"""Robot files as a user edits them."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import cantools.database
import pydantic
import pytest

from robotctl.app.simulation.sim_options import SimOptions
from robotctl.app.simulation.simulator_files import SimulatorError, simulated_robot
from robotctl.app.supervision.silence import STATE_PERIOD_NS
from robotctl.config.robot_file import (
    MAX_SUPPLY_V,
    RING_S,
    RobotConfig,
    config_directory,
    find_file,
    load_robot,
)
from robotctl.errors import ConfigError

ROBOTS = sorted(config_directory().glob("*.toml"))


@pytest.mark.parametrize("path", ROBOTS, ids=lambda path: path.stem)
def test_every_robot_that_comes_along_is_right(path: Path) -> None:
    config = load_robot(path)
    assert config.robot.name == path.stem


@pytest.mark.parametrize("path", ROBOTS, ids=lambda path: path.stem)
def test_the_guard_is_given_the_time_from_an_echo_to_the_brakes(path: Path) -> None:
    """Two readings outvote a third: the time counts from the sound of the older of the two."""
    config = load_robot(path)
    dbc = cantools.database.load_file(config_directory() / "robot.dbc")
    ring_s = dbc.get_message_by_name("SonarRangesA").cycle_time / 1e3  # to the newer of the two
    listening_s = 2.0 * config.localisation.sonar.max_range_m / 343.0  # its neighbour hears nothing
    tick_s = 1.0 / config.runtime.rate_hz
    heard_s = listening_s + tick_s + STATE_PERIOD_NS / 1e9
    decided_s = 1.0 / config.navigation.rate_hz + tick_s
    guard = config.navigation.guard
    ramp_s = 0.5 * guard.deceleration_m_s2 / config.limits.jerk_max_m_s3
    assert ring_s + heard_s + decided_s + ramp_s <= guard.reaction_s


def test_a_guard_with_less_time_than_its_readings_take_is_refused() -> None:
    dbc = cantools.database.load_file(config_directory() / "robot.dbc")
    assert dbc.get_message_by_name("SonarRangesA").cycle_time == RING_S * 1e3
    # Two periods of 0.1 s and 0.8 / (2 x 30) s of ramp.
    slow = "navigation.rate_hz=10"
    load_robot(find_file("diff_drive"), [slow, "navigation.guard.reaction_s=0.214"])
    with pytest.raises(ConfigError, match=r"reaction_s: 0\.213 found, .* 0\.213 s and more \("):
        load_robot(find_file("diff_drive"), [slow, "navigation.guard.reaction_s=0.213"])
    with pytest.raises(ConfigError, match=r"reaction_s: 0\.2 found, .* 0\.500 s and more \("):
        load_robot(find_file("diff_drive"), ["limits.jerk_max_m_s3=1"])
    # A ring of 50 ms is not heard faster by a faster navigation.
    fast = "navigation.rate_hz=100"
    with pytest.raises(ConfigError, match=r"reaction_s: 0\.07 found, .* 0\.073 s and more \("):
        load_robot(find_file("diff_drive"), [fast, "navigation.guard.reaction_s=0.07"])


@pytest.mark.parametrize("path", ROBOTS, ids=lambda path: path.stem)
def test_a_robot_that_looks_knows_where_its_nose_is(path: Path) -> None:
    body = tomllib.loads(path.read_text())["simulation"]["body"]
    nose_m = load_robot(path).navigation.guard.nose_m
    assert max(x for x, _ in body) <= nose_m <= max(x for x, _ in body) + 0.02


def test_a_nose_behind_the_foremost_sonar_is_refused_where_a_camera_looks(tmp_path: Path) -> None:
    load_robot(find_file("diff_drive"), ["navigation.guard.nose_m=0.18"])
    match = r"nose_m: 0\.17 found, but sonar front is 0\.18 m ahead of base"
    with pytest.raises(ConfigError, match=match):
        load_robot(find_file("diff_drive"), ["navigation.guard.nose_m=0.17"])
    load_robot(find_file("tricycle"), ["navigation.guard.nose_m=0.2"])  # it has no camera
    text = find_file("diff_drive").read_text()
    camera = text[text.index("[camera]") : text.index("[can]")]
    seeing = tmp_path / "seeing.toml"
    seeing.write_text(find_file("tricycle").read_text() + camera)
    load_robot(seeing)
    with pytest.raises(ConfigError, match=r"nose_m: 0\.2 found, but sonar front is 0\.42 m"):
        load_robot(seeing, ["navigation.guard.nose_m=0.2"])


def test_an_outline_is_the_body_either_way_round() -> None:
    corners = ((0.2, -0.4), (0.2, 0.17), (-0.16, 0.17), (-0.16, -0.17))
    for outline in (corners, corners[::-1]):
        robot = load_robot(find_file("diff_drive"), [f"body.outline={list(map(list, outline))}"])
        assert set(robot.footprint.corners) == set(corners)
        assert (robot.footprint.left_m, robot.footprint.right_m) == (0.17, 0.4)
    without = load_robot(find_file("diff_drive"))
    assert without.footprint == without.navigation.guard.outline(without.sonar)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (["body.outline=[[0.2,-0.2],[0.2,0.2]]"], "three corners at least, found 2"),
        (["body.outline=[[0.3,-0.2],[0.3,0.2],[-0.2,-0.2],[-0.2,0.2]]"], "meet at its corners"),
        (["body.outline=[[0.9,-0.2],[0.9,0.2],[0.5,0.2],[0.5,-0.2]]"], "base must lie inside"),
        (["body.outline=[[0.3,-0.2],[0.3,0.2],[-0.2,0.2],[-0.2,-0.2],[0.3,-0.2]]"], "0.2 twice"),
        (["body.outline=[[20,-2],[20,2],[-2,2],[-2,-2]]"], "farther than 10 m from base"),
        (["body.outline=[[0.2,-0.2],[0.2,nan],[-0.2,0.2]]"], "body.outline"),
        (["body.outline=[[0.2,-0.1],[0.2,0.1],[-0.2,0.1],[-0.2,-0.1]]"], r"sonar .* m outside"),
        (
            ["body.outline=[[0.3,-0.3],[0.3,0.3],[-0.3,0.3],[-0.3,-0.3]]",
             "navigation.guard.half_width_m=0.2"],
            r"half_width_m: 0\.2 found beside \[body\] outline",
        ),
    ],
)  # fmt: skip
def test_what_is_no_outline_or_not_the_only_one_is_refused(settings, said) -> None:
    with pytest.raises(ConfigError, match=said):
        load_robot(find_file("diff_drive"), settings)


def test_an_outline_may_be_hollow_and_have_parts_beside_it(tmp_path: Path) -> None:
    outline = ((0.2, -0.4), (0.2, 0.17), (-0.16, 0.17), (-0.16, -0.17), (0.1, -0.17), (0.1, -0.4))
    lift = ((0.2, 0.05), (0.5, 0.05), (0.5, 0.1), (0.2, 0.1))  # clockwise
    path = tmp_path / "armed.toml"
    text = find_file("diff_drive").read_text()
    table = f"[body]\noutline = {list(map(list, outline))}\n"
    part = f'[[body.part]]\nname = "lift"\noutline = {list(map(list, lift[::-1]))}\n'
    path.write_text(text + table + part)
    body = load_robot(path).footprint
    assert (body.front_m, body.left_m, body.right_m) == (0.5, 0.17, 0.4)
    assert body.depth_m(0.4, 0.07) == pytest.approx(0.02)
    assert body.depth_m(0.0, -0.3) < 0.0
    last = text.count("\n") + 5
    for wrong, said in (
        (part.replace("name", "nam"), rf':{last - 1}: body.part\S*nam: unknown key; did .*"name"'),
        (part.replace("[0.5, 0.1]", "[0.3, 0.0]"), rf":{last}: body.part.*outline: sides"),
        (part.replace("[[0.2, 0.1], ", "[").replace("[0.5, 0.1], ", ""), "three corners"),
        (part + part, "body.part: two have the same name: lift, lift"),
        (part.replace("body.part", "body.parts"), r'body\.parts: unknown key; did you mean "part"'),
    ):
        path.write_text(text + table + wrong)
        with pytest.raises(ConfigError, match=said):
            load_robot(path)
    path.write_text(text + part)
    with pytest.raises(ConfigError, match=r"body\.outline: missing, but needed beside parts"):
        load_robot(path)


@pytest.mark.parametrize(
    ("robot", "wrong_unit", "rad_s", "volts"),
    [
        ("diff_drive", "limits.v_max_m_s=800", "16008", "7203"),
        ("diff_drive", "limits.omega_max_rad_s=143", "445", "200"),
        ("diff_drive", "drive.track_width_m=300", "7516", "3382"),
        ("diff_drive", "drive.wheel_radius_m=0.005", "235", "106"),
        ("ackermann", "limits.v_max_m_s=80", "1455", "800"),
    ],
)
def test_limits_that_no_motor_reaches_are_refused(robot, wrong_unit, rad_s, volts) -> None:
    words = f"v_max_m_s: .* at {rad_s} rad/s and its motor needs {volts} V; at most 65.5 V allowed"
    with pytest.raises(ConfigError, match=words):
        load_robot(find_file(robot), [wrong_unit])


def test_limits_may_need_what_a_drive_can_report() -> None:
    dbc = cantools.database.load_file(config_directory() / "robot.dbc")
    most_v = dbc.get_message_by_name("DriveStatus").get_signal_by_name("BusVoltage").maximum
    assert 0.0 <= most_v - MAX_SUPPLY_V < 0.1
    # (6.9 m/s + 0.15 m x 2.5 rad/s) / 0.05 m x 0.45 V s/rad are 65.475 V.
    load_robot(find_file("diff_drive"), ["limits.v_max_m_s=6.9"])
    with pytest.raises(ConfigError, match=r"limits\.v_max_m_s: 6\.91 found"):
        load_robot(find_file("diff_drive"), ["limits.v_max_m_s=6.91"])


def test_a_bridge_too_slow_for_the_guard_is_refused() -> None:
    # 0.681 /s of the 10.575 V that the limits need, over 0.45 V s/rad, are 16 rad/s^2: 0.8 m/s^2.
    load_robot(find_file("diff_drive"), ["control.pwm.slew_per_s=0.681"])
    load_robot(find_file("diff_drive"), ["control.pwm.slew_per_s=inf"])
    load_robot(find_file("diff_drive"), ["control.pwm.min_bus_voltage_v=0.01"])
    words = r"slew_per_s: 0\.6 found, .* by 0\.71 m/s\^2 at 10\.6 V, but .*_m_s2 is 0\.8"
    with pytest.raises(ConfigError, match=words):
        load_robot(find_file("diff_drive"), ["control.pwm.slew_per_s=0.6"])
    # A floor of 12 V says more of the supply than the limits do.
    load_robot(
        find_file("diff_drive"), ["control.pwm.slew_per_s=0.61", "control.pwm.min_bus_voltage_v=12"]
    )


def test_a_tolerance_within_which_a_slow_motor_runs_away_is_refused() -> None:
    slow = ("plausibility.back_emf_v_s_rad=12", "limits.omega_max_rad_s=0.5")
    wheel = ("limits.v_max_m_s=0.5", "drive.wheel_radius_m=0.3")  # half of 5/3 rad/s, less 25 %
    words = r"speed_tolerance_rad_s: 2 found, at most 0\.625 allowed: .* half the 1\.7 rad/s"
    with pytest.raises(ConfigError, match=words):
        load_robot(find_file("diff_drive"), [*slow, *wheel])
    tolerance = "plausibility.speed_tolerance_rad_s="
    load_robot(find_file("diff_drive"), [*slow, *wheel, f"{tolerance}0.625"])
    with pytest.raises(ConfigError, match=r"0\.626 found, at most 0\.625 allowed"):
        load_robot(find_file("diff_drive"), [*slow, *wheel, f"{tolerance}0.626"])
    share = "plausibility.speed_tolerance_share=0.5"
    with pytest.raises(ConfigError, match=r"0\.5 found, at most 0\.416 allowed"):
        load_robot(find_file("diff_drive"), [*slow, *wheel, share, f"{tolerance}0.5"])
    # A limit far below what the supply gives says nothing of the motor: 6 V / 0.45 V s/rad.
    load_robot(find_file("diff_drive"), ["limits.v_max_m_s=0.05", f"{tolerance}4.99"])


@pytest.mark.parametrize(
    ("override", "most", "gap_ms"),
    [
        # 32767 counts at twice (0.8 m/s + 0.15 m x 2.5 rad/s) / 0.05 m, and 1.5 m/s of pushing.
        ("runtime.rate_hz=200", 133689, 20),
        ("runtime.rate_hz=100", 66844, 40),
        ("safety.feedback_timeout_periods=9", 53475, 50),
    ],
)
def test_an_encoder_whose_counts_read_as_backwards_behind_lost_frames_is_refused(
    override: str, most: int, gap_ms: int
) -> None:
    counts = "drive.counts_per_revolution="
    load_robot(find_file("diff_drive"), [override, f"{counts}{most}"])
    words = rf"revolution: {most + 1} found, at most {most} allowed: .* within {gap_ms} ms, "
    with pytest.raises(ConfigError, match=words):
        load_robot(find_file("diff_drive"), [override, f"{counts}{most + 1}"])


@pytest.mark.parametrize(
    ("overrides", "least"),
    [
        # 2 / 0.75 rad/s at 2.5 m/s^2 / 0.05 m: 2 pi 2 x 50 / 7.11.
        ((), 89),
        (("limits.a_max_m_s2=5",), 177),
        (("plausibility.speed_tolerance_rad_s=4",), 23),
        # At rest: 2 pi / (0.06 s x 2.67 rad/s).
        (("limits.a_max_m_s2=0.8",), 40),
        (("limits.a_max_m_s2=0.8", "plausibility.speed_tolerance_share=0.5"), 27),
    ],
)
def test_an_encoder_too_coarse_for_its_monitor_is_refused(
    overrides: tuple[str, ...], least: int
) -> None:
    counts = "drive.counts_per_revolution="
    load_robot(find_file("diff_drive"), [*overrides, f"{counts}{least}"])
    words = f"revolution: {least - 1} found, at least {least} allowed: "
    with pytest.raises(ConfigError, match=words):
        load_robot(find_file("diff_drive"), [*overrides, f"{counts}{least - 1}"])


@pytest.mark.parametrize(
    "override",
    [
        *("limits.a_max_m_s2=1e308", "limits.v_max_m_s=1e308", "drive.wheel_radius_m=1e308"),
        *("plausibility.speed_tolerance_rad_s=5e-324", "plausibility.back_emf_v_s_rad=1e308"),
        *("limits.v_max_m_s=5e-324", "drive.wheel_radius_m=5e-324"),
    ],
)
def test_what_no_robot_has_is_refused_and_no_bound_overflows(override: str) -> None:
    with pytest.raises(ConfigError):
        load_robot(find_file("diff_drive"), [override, "drive.counts_per_revolution=3"])


def test_an_override_changes_one_value_only() -> None:
    plain = load_robot(find_file("diff_drive"))
    changed = load_robot(find_file("diff_drive"), ["control.left.kp=2"])
    assert changed.control.left is not None
    assert changed.control.left.kp == 2.0
    assert changed.control.right == plain.control.right
    assert changed.limits == plain.limits


def test_errors_name_file_line_key_and_the_nearest_key(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    text = find_file("diff_drive").read_text().replace("kd = 0.0 ", "kdd = 0.0", 1)
    path.write_text(text)
    line = next(i for i, row in enumerate(text.splitlines(), 1) if row.startswith("kdd"))
    with pytest.raises(ConfigError) as caught:
        load_robot(path)
    assert str(caught.value) == f'{path}:{line}: control.left.kdd: unknown key; did you mean "kd"?'


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("safety.command_timeout_ms=0", "10 to 1000"),
        ("runtime.rate_hz=5000", "100 to 1000"),
        ('drive.kind="hover"', "differential"),
        ("drive.track_width_m=-1", "track_width_m"),
        ('can.interface="pcan"', "socketcan"),
        ('mavlink.link.0.url="http://x"', "udpout"),
        ("control.drive.kp=1", "no such wheel"),
        ('sonar.1.name="front"', "given 2 times"),
        ("sonar.1.y_m=100", "y_m: 100.0 found, -10 to 10 allowed"),
        ("sonar.0.x_m=-10.1", "x_m: -10.1 found, -10 to 10 allowed"),
        ("limits.v_max_m_s=nan", "v_max_m_s"),
        ("imu.tilt_max_deg=90", "imu.tilt_max_deg: must be 5 to 60, not 90"),
        ("imu.yaw_deg=nan", "imu.yaw_deg: must be finite, not nan"),
        ("imu.enable=true", 'imu.enable: unknown key; did you mean "enabled"?'),
        ("log.total_mb=inf", "at most 1e+09, not inf"),
        ("log.total_mb=100", "at least ten times file_mb (640)"),
        ("log.pictures_every_s=0.1", "pictures_every_s: must be 0 (none) or 0.2 to 3600, not 0.1"),
        ("log.pictures_every_s=1", "log.pictures_every_s: needs camera.enabled = true"),
        ("mavlink.rates.sonar_hz=1e-300", "0 (off) or 0.001 to 100, not 1e-300"),
        ("navigation.guard.blocked_max_s=1e300", "at most 1000000 allowed"),
        ("limits.a_max_m_s2=0.7", "guard.deceleration_m_s2: 0.8 found, at most limits.a_max_m_s2"),
        ("navigation.pursuit.acceleration_m_s2=2.6", "limits.a_max_m_s2 (2.5) allowed"),
        ("navigation.pursuit.alpha_rad_s2=8.1", "limits.alpha_max_rad_s2 (8.0) allowed"),
    ],
)
def test_wrong_values_are_refused_with_what_is_allowed(override: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_robot(find_file("diff_drive"), [override])
    assert words in str(caught.value)


def test_a_time_out_under_two_periods_is_refused_with_both_figures() -> None:
    with pytest.raises(ConfigError, match=r"12 is under two control periods \(20 ms at 100 Hz\)"):
        load_robot(find_file("diff_drive"), ["runtime.rate_hz=100", "safety.command_timeout_ms=12"])


def test_a_file_that_is_not_there_names_the_nearest_one() -> None:
    with pytest.raises(ConfigError, match='did you mean "diff_drive"'):
        find_file("dif_drive")


@pytest.mark.parametrize(
    ("row", "wrong", "problem"),
    [
        ("track_width_m = 0.300", "track_width_m = nan", "must be positive and finite, found nan"),
        ("wheel_radius_m = 0.050", "wheel_radius_m = -0.05", "and finite, found -0.05"),
        ("counts_per_revolution = 2400", "counts_per_revolution = 0", "and finite, found 0"),
        ("command_timeout_ms = 90", "command_timeout_ms = 9", "must be 10 to 1000, not 9"),
        ('name = "right"', 'name = "left"', "found 'left', which is given 2 times"),
    ],
)
def test_a_wrong_value_has_the_line_of_its_key_and_is_told(
    tmp_path: Path, row: str, wrong: str, problem: str
) -> None:
    text, path = find_file("diff_drive").read_text(encoding="utf-8"), tmp_path / "mine.toml"
    before, found, after = text.partition(f"\n{row}")
    assert found
    path.write_text(f"{before}\n{wrong}{after}", encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load_robot(path)
    message, key = str(caught.value), wrong.partition(" = ")[0]
    assert message.startswith(f"{path}:{before.count(chr(10)) + 2}: ")
    assert f"{key}: " in message
    assert message.endswith(problem)


def test_contradictions_have_a_line_too(tmp_path: Path) -> None:
    text, path = find_file("diff_drive").read_text(encoding="utf-8"), tmp_path / "mine.toml"
    rows = [*text.replace("[control.right]", "[control.drive]").splitlines()]
    rows += [
        f'[[sonar]]\nname = "more{i}"\nx_m = 0.1\ny_m = 0.0\nheading_deg = 0.0' for i in range(9)
    ]
    text = "\n".join(rows)
    path.write_text(text, encoding="utf-8")
    lines = text.splitlines()
    with pytest.raises(ConfigError) as caught:
        load_robot(path)
    drive, seventeenth = lines.index("[control.drive]") + 1, len(lines) - 4
    assert {problem.partition(": ")[0] for problem in str(caught.value).splitlines()} >= {
        f"{path}:{drive}",
        f"{path}:{seventeenth}",
    }


def test_settings_of_the_simulator_are_checked_and_named() -> None:
    with pytest.raises(SimulatorError) as caught:
        simulated_robot(find_file("diff_drive"), ["simulation.mass_kg=nan"])
    assert str(caught.value) == (
        "--set simulation.mass_kg=nan: simulation.mass_kg: must be a finite number, found nan"
    )


@pytest.mark.parametrize("method", ["ekf", "mcl"])
def test_a_localiser_without_a_map_is_refused_where_no_world_stands_in(
    tmp_path: Path, method: str
) -> None:
    text = find_file("diff_drive").read_text()
    path = tmp_path / "mine.toml"
    path.write_text(f'{text}\n[localisation]\nmethod = "{method}"\n')
    line = len(text.splitlines()) + 3
    with pytest.raises(ConfigError) as caught:
        load_robot(path)
    assert str(caught.value) == (
        f'{path}:{line}: localisation.method: "{method}" needs localisation.map, a world (.toml) '
        "or a ROS map (.yaml)"
    )
    world = find_file("flat", "worlds")
    options = SimOptions(path, Path("mission"), localisation=(f'localisation.method="{method}"',))
    assert load_robot(path, options.settings(world)).localisation.map == str(world)
    load_robot(path, ["localisation.mapping=true", "localisation.method=none"])


def described_keys(table: dict[str, Any]) -> set[str]:
    """Return the keys that the docstring of a table tells the meaning of."""
    _, _, parameters = table.get("description", "").partition("\nParameters\n----------\n")
    headings = re.findall(r"^(\w.*?)(?: : .*)?$", parameters, re.MULTILINE)
    return {key for heading in headings for key in heading.split(", ")}


def test_every_key_of_the_schema_has_its_meaning_there() -> None:
    schema = pydantic.TypeAdapter(RobotConfig).json_schema()
    tables = schema["$defs"]
    assert {"OccupancyGridConfig", "LoopConfig", "StreamRates"} < set(tables)
    assert [name for name, table in tables.items() if "description" not in table] == []
    for table in (schema, *tables.values()):
        told = described_keys(table)
        for key, value in table["properties"].items():
            is_table = "#/$defs/" in json.dumps(value)  # it has a description of its own
            assert is_table or key in told or "description" in value, (table["title"], key)


def test_a_steering_may_not_miss_its_command_by_as_much_as_it_reaches() -> None:
    reach = "drive.steering_max_rad=0.4"
    load_robot(find_file("ackermann"), [reach, "plausibility.steering_tolerance_rad=0.39"])
    words = r"tolerance_rad: 0\.4 found, less than drive\.steering_max_rad \(0\.4\) allowed"
    with pytest.raises(ConfigError, match=words):
        load_robot(find_file("ackermann"), [reach, "plausibility.steering_tolerance_rad=0.4"])


def test_a_steering_is_given_the_time_that_it_needs() -> None:
    # ackermann: (2 x 0.60 - 0.35) rad at 4 rad/s are 212.5 ms.
    load_robot(find_file("ackermann"), ["plausibility.steering_ms=213"])
    with pytest.raises(ConfigError, match=r"212 found, but the steering needs 21[23] ms"):
        load_robot(find_file("ackermann"), ["plausibility.steering_ms=212"])


def test_a_mission_may_have_the_name_of_its_world() -> None:
    missions, worlds = (config_directory() / each for each in ("missions", "worlds"))
    assert find_file("clutter", "worlds", beside=missions) == worlds / "clutter.toml"
    with pytest.raises(ConfigError, match="is a mission; a world is needed"):
        find_file("patrol", "worlds", beside=missions)


FORKLIFT = """
[body]
outline = [[0.2, 0.18], [-0.17, 0.18], [-0.17, -0.18], [0.2, -0.18]]
states = ["up", "down"]
state = 0

[[body.part]]
name = "load"
outline = [[0.3, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.3, -0.4]]
states = ["up"]

[[body.part]]
name = "fork"
outline = [[0.6, 0.1], [0.2, 0.1], [0.2, -0.1], [0.6, -0.1]]
states = ["down"]

[[body.part]]
name = "mast"
outline = [[0.25, 0.1], [0.15, 0.1], [0.15, -0.1], [0.25, -0.1]]
"""


def forklift(folder: Path, text: str = FORKLIFT) -> Path:
    path = folder / "forklift.toml"
    path.write_text(find_file("diff_drive").read_text() + text)
    return path


def test_parts_are_there_in_the_states_that_they_name(tmp_path: Path) -> None:
    robot = load_robot(forklift(tmp_path))
    up, down = robot.footprints
    assert robot.footprint == up
    assert (up.front_m, up.left_m, len(up.parts)) == (0.3, 0.4, 2)
    assert (down.front_m, down.left_m, len(down.parts)) == (0.6, 0.18, 2)
    assert load_robot(forklift(tmp_path), ["body.state=1"]).footprint == down
    assert load_robot(find_file("diff_drive")).footprints == (
        load_robot(find_file("diff_drive")).footprint,
    )


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("state = 0", "state = 2", r"body\.state: 2 found; allowed are 0 \(up\), 1 \(down\)"),
        ("state = 0\n", "", r"body\.state: missing, but needed beside states"),
        ('states = ["up", "down"]\n', "", r"body\.states: missing, but needed beside a state"),
        ('"up", "down"', '"up", "up"', r"body\.states: two have the same name: up, up"),
        ('states = ["down"]', 'states = ["dawn"]', r'such state .dawn.; did you mean "down"\?'),
        ("[-0.17, 0.18], [-0.17, -0.18]", "[0.1, 0.18], [0.1, -0.18]", "base must lie inside"),
    ],
)
def test_states_that_there_are_not_are_refused(
    old: str, new: str, said: str, tmp_path: Path
) -> None:
    assert old in FORKLIFT
    with pytest.raises(ConfigError, match=said):
        load_robot(forklift(tmp_path, FORKLIFT.replace(old, new)))


def test_a_sonar_must_be_inside_of_the_body_in_every_state(tmp_path: Path) -> None:
    short = FORKLIFT.replace("[0.2, 0.18]", "[0.1, 0.18]").replace("[0.2, -0.18]", "[0.1, -0.18]")
    short = short.replace('name = "mast"', 'name = "mast"\nstates = ["up"]')
    short = short.replace("[0.2, 0.1], [0.2, -0.1]", "[0.3, 0.1], [0.3, -0.1]")
    with pytest.raises(ConfigError, match=r"sonar front at 0\.18, 0 is 0\.080 m outside"):
        load_robot(forklift(tmp_path, short))
