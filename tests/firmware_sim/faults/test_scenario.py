"""Scenario files: what they may say, and when their faults begin."""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import cantools.database
import numpy as np
import pytest

from firmware_sim.config.config import RobotConfig, load_robot
from firmware_sim.config.outline import BodySection
from firmware_sim.config.parameters import ImuMount
from firmware_sim.errors import SimulationError
from firmware_sim.faults.catalogue import CATALOGUE
from firmware_sim.faults.faults import check
from firmware_sim.faults.fits import FULL_CELL_V
from firmware_sim.faults.scenario import PlannedFault, Scenario, load_scenario, not_begun, play
from firmware_sim.plant.battery import OCV_V
from firmware_sim.simulation import Simulation

CONFIGS = Path(__file__).parents[3] / "configs"
SECOND_NS = 1_000_000_000

DIFF, TRICYCLE, ACKERMANN = (
    load_robot(CONFIGS / f"{name}.toml") for name in ("diff_drive", "tricycle", "ackermann")
)
VESC, MOTEUS, ODRIVE = (
    load_robot(CONFIGS / f"{name}.toml") for name in ("vesc_car", "moteus", "odrive")
)
FIVE_SONARS = dataclasses.replace(DIFF, sonar=DIFF.sonar[:5])
NO_SONARS = dataclasses.replace(DIFF, sonar=())

GOOD = """\
seed = 3

[[fault]]
kind = "encoder_stuck"  # a comment
wheel = "right"
duration = 1
at = 12.5

[[fault]]
kind = "frames_lost"
id = 0x181
every = 20
"""


@pytest.fixture
def load(tmp_path):
    def load(text: str, robot: RobotConfig = DIFF) -> Scenario:
        path = tmp_path / "scenario.toml"
        path.write_text(text, encoding="utf-8")
        return load_scenario(path, robot)

    return load


@pytest.fixture
def problems(load, tmp_path):
    def problems(text: str, robot: RobotConfig = DIFF) -> list[str]:
        with pytest.raises(SimulationError) as caught:
            load(text, robot)
        return [
            line.removeprefix(f"{tmp_path}/scenario.toml") for line in str(caught.value).split("\n")
        ]

    return problems


def begun(scenario: Scenario, seconds: float) -> list[tuple[float, str]]:
    """Play a scenario; return when each fault began, and its line."""
    simulation = Simulation(CONFIGS / "diff_drive.toml", CONFIGS / "worlds" / "empty_room.toml")
    told: list[tuple[float, str]] = []
    play(
        scenario,
        simulation.faults,
        lambda line: told.append((simulation.now_ns / SECOND_NS, line)),
    )
    simulation.advance(round(seconds * SECOND_NS))
    return told


def test_a_file_becomes_its_faults_with_numbers_as_numbers(load):
    assert load(GOOD) == Scenario(
        faults=(
            PlannedFault("encoder_stuck", {"wheel": "right", "duration": 1.0}, 12.5, None),
            PlannedFault("frames_lost", {"id": 385.0}, None, 20.0),
        ),
        seed=3,
    )


def test_a_file_may_be_empty(load):
    assert load("") == Scenario()


def test_a_file_of_an_editor_that_marks_its_encoding_is_read(load):
    assert load("\ufeff" + GOOD) == load(GOOD)


def test_every_line_of_a_fault_is_one_that_the_console_takes(load):
    for fault in load(GOOD).faults:
        name, *words = str(fault).split()
        check(name, dict(word.split("=") for word in words))
    assert str(load(GOOD).faults[1]) == "frames_lost id=0x181"


@pytest.mark.parametrize(
    "path", sorted((CONFIGS / "scenarios").glob("*.toml")), ids=lambda p: p.stem
)
def test_the_files_that_come_with_the_robot_are_right(path):
    assert load_scenario(path, DIFF).faults


@pytest.mark.parametrize(
    ("wrong", "line", "problem"),
    [
        ("sead = 4", 1, 'sead: unknown key; did you mean "seed"?'),
        ("seed = -1", 1, "seed: -1 is no whole number from 0 on"),
        ("seed = true", 1, "seed: True is no whole number from 0 on"),
        (
            '[[fault]]\nkind = "bus_cuts"\nat = 1',
            2,
            "fault[0].kind: 'bus_cuts' is no kind of fault; did you mean \"bus_cut\"?",
        ),
        ("[[fault]]\nat = 1", 1, 'fault[0]: a fault needs its kind, as kind = "bus_cut"'),
        (
            '[[fault]]\nkind = "bus_cut"',
            1,
            "fault[0]: needs either at or every, the time in seconds",
        ),
        (
            '[[fault]]\nkind = "bus_cut"\nat = 1\nevery = 2',
            1,
            "fault[0]: needs either at or every, the time in seconds",
        ),
        (
            '[[fault]]\nkind = "bus_cut"\nat = -0.5',
            3,
            "fault[0].at: -0.5, allowed: 0 to 1e+06 s",
        ),
        ('[[fault]]\nkind = "bus_cut"\nat = nan', 3, "fault[0].at: nan, allowed: 0 to 1e+06 s"),
        (
            '[[fault]]\nkind = "bus_cut"\nevery = 0',
            3,
            "fault[0].every: 0, allowed: 0.001 to 1e+06 s",
        ),
        (
            '[[fault]]\nkind = "bus_cut"\nat = 1\nduration = nan',
            4,
            "fault[0].duration: nan, allowed: 0.001 to 3600",
        ),
        (
            '[[fault]]\nkind = "bus_cut"\nat = 1\nduration = ' + "9" * 400,
            4,
            "fault[0].duration: 999999999999999999...9999999999999999999 is no number",
        ),
        (
            '[[fault]]\nkind = "bus_cut"\nat = 1\nduration = true',
            4,
            "fault[0].duration: True is no number",
        ),
        (
            '[[fault]]\nkind = "node_cut"\nat = 1\nnode = "sonr"',
            4,
            (
                "fault[0].node: 'sonr', the robot has none, allowed: drive, sonar, power; "
                'did you mean "sonar"?'
            ),
        ),
        (
            '[[fault]]\nkind = "bus_cut"\nat = 1\ndurat = 2',
            4,
            'fault[0].durat: unknown, allowed: duration; did you mean "duration"?',
        ),
        (
            '[[fault]]\nkind = "encoder_stuck"\nevery = 5',
            1,
            "fault[0].duration: must be greater than 0 with every",
        ),
        (
            '[[fualt]]\nkind = "bus_cut"\nat = 1',
            1,
            'fualt: unknown key; did you mean "fault"?',
        ),
        (
            'seed = 1\nfault = [{kind = "bus_cut", at = -1}]',
            2,
            "fault[0].at: -1, allowed: 0 to 1e+06 s",
        ),
        (
            '[[fault]]\nkind = "bus_cut"\nat = 1\n"dur\\nation" = 2',
            1,
            'fault[0].dur\\nation: unknown, allowed: duration; did you mean "duration"?',
        ),
    ],
)
def test_a_mistake_is_named_with_its_line_and_what_is_allowed(problems, wrong, line, problem):
    assert problems(wrong) == [f":{line}: {problem}"]


SENT = (
    "0 for any, 0x001, 0x080, 0x081, 0x082, 0x083, 0x181, {}0x183, 0x201, 0x281, {}0x381, "
    "0x581, 0x582, 0x583, 0x601, 0x602, 0x603, 0x701, 0x702, 0x703"
)
"""Identifiers; sonars, if there are any, have some more."""

MISFITS = [
    (
        DIFF,
        "sonar_crosstalk sonar=0 other=15",
        "other",
        "15, the robot has 8 sonars, allowed: 0 to 7",
    ),
    (DIFF, "sonar_crosstalk sonar=8", "sonar", "8, the robot has 8 sonars, allowed: 0 to 7"),
    (
        DIFF,
        "sonar_crosstalk sonar=3 other=3",
        "other",
        "3, must be another that fires together with sonar 3, allowed: 0, 1, 2",
    ),
    (
        DIFF,
        "sonar_crosstalk sonar=3 other=4",
        "other",
        "4, must be another that fires together with sonar 3, allowed: 0, 1, 2",
    ),
    (
        FIVE_SONARS,
        "sonar_crosstalk sonar=4 other=3",
        "other",
        "3, must be another that fires together with sonar 4, allowed: none",
    ),
    (NO_SONARS, "sonar_crosstalk sonar=0 other=1", "kind", "the robot has no sonars"),
    (NO_SONARS, "sonar_silent", "kind", "the robot has no sonars"),
    (NO_SONARS, "sonar_stuck", "kind", "the robot has no sonars"),
    *(
        (
            robot,
            f"{kind} id={given}",
            "id",
            f"{given}, nobody sends it, nearest is {nearest}; allowed: "
            + SENT.format(ranges, more),
        )
        for robot, kind, given, nearest, ranges, more in (
            (DIFF, "frames_lost", "0x221", "0x201", "0x182, ", "0x282, "),
            (DIFF, "frames_late", "0x7ff", "0x703", "0x182, ", "0x282, "),
            (DIFF, "frames_corrupt", "0x382", "0x381", "0x182, ", "0x282, "),
            (NO_SONARS, "frames_stale", "0x182", "0x181", "", ""),
        )
    ),
    (DIFF, "brown_out volts=12.7", "volts", "12.7, the battery has 12.6 V, allowed: less"),
    *(
        (
            robot,
            f"{kind} wheel=right",
            "wheel",
            f"'right', the {robot.drive.kind} drive has no such wheel, allowed: drive, left",
        )
        for robot in (TRICYCLE, ACKERMANN)
        for kind in (
            "encoder_stuck",
            "encoder_reversed",
            "encoder_glitch",
            "encoder_disconnected",
            "wheel_blocked",
            "over_current",
            "over_temperature",
        )
    ),
    (DIFF, "drive_fault drive=drive code=1", "drive", "'drive', the robot has none, allowed: none"),
    (
        VESC,
        "node_cut node=vesk",
        "node",
        "'vesk', the robot has none, allowed: sonar, vesc; did you mean \"vesc\"?",
    ),
    (
        VESC,
        "drive_fault drive=sonar code=1",
        "drive",
        "'sonar', the robot has none, allowed: vesc",
    ),
    (VESC, "drive_fault drive=vesc code=256", "code", "256, allowed: 1 to 255"),
    (VESC, "clock_drift node=vesc", "node", "'vesc', the robot has none, allowed: sonar"),
    (MOTEUS, "over_current", "kind", "moteus_left does not guard itself by current"),
    (ODRIVE, "over_temperature", "kind", "left_drive does not guard itself by temperature"),
    *(
        (
            robot,
            "wheels_swapped",
            "kind",
            f"the {robot.drive.kind} drive has one motor, whose encoder has no other socket",
        )
        for robot in (TRICYCLE, ACKERMANN)
    ),
]


def table(line: str) -> str:
    """Write a fault's line as a table of a scenario."""
    kind, *words = line.split()
    rows = []
    for word in words:
        key, _, value = word.partition("=")
        rows.append(f"{key} = {value if value[0].isdigit() else repr(value)}")
    return "\n".join(["[[fault]]", "at = 1", f'kind = "{kind}"', *rows])


@pytest.mark.parametrize(("robot", "line", "key", "problem"), MISFITS)
def test_a_fault_that_the_robot_cannot_feel_is_refused_with_its_line(
    problems, robot, line, key, problem
):
    text = table(line)
    number = next(i for i, row in enumerate(text.split("\n"), 1) if row.startswith(key))
    assert problems(text, robot) == [f":{number}: fault[0].{key}: {problem}"]


@pytest.mark.parametrize(("robot", "line", "key", "problem"), MISFITS)
def test_such_a_fault_is_refused_at_run_time_with_the_same_words(robot, line, key, problem):
    simulation = Simulation(robot, CONFIGS / "worlds" / "empty_room.toml")
    with pytest.raises(SimulationError) as caught:
        simulation.faults.inject(line)
    assert str(caught.value) == f"fault {line.split()[0]}: {key}: {problem}"


def test_a_default_that_does_not_fit_is_told_at_the_table(problems):
    text = '[[fault]]\nkind = "sonar_crosstalk"\nsonar = 5\nat = 1'
    assert problems(text) == [
        ":1: fault[0].other: 1, must be another that fires together with sonar 5, allowed: 4, 6, 7"
    ]


@pytest.mark.parametrize(
    ("robot", "kind"),
    [
        pytest.param(robot, kind, id=f"{kind}-{robot.robot.name}")
        for robot in (DIFF, TRICYCLE, ACKERMANN)
        for kind in CATALOGUE
        if (robot is DIFF or kind != "wheels_swapped") and kind not in {"drive_fault", "body"}
    ],
)
def test_every_fault_with_its_defaults_is_one_of_every_robot_that_has_what_it_exchanges(
    load, robot, kind
):
    robot = dataclasses.replace(robot, imu=ImuMount(enabled=True))
    assert load(f'[[fault]]\nkind = "{kind}"\nat = 1', robot).faults


def test_a_body_has_to_have_the_state_that_it_is_put_in(load, problems):
    text = '[[fault]]\nkind = "body"\nstate = "loaded"\nat = 1'
    assert problems(text) == [":2: fault[0].kind: the robot's file has no states in [body]"]
    loaded = BodySection(DIFF.outline, states=("empty", "loaded"), state=0)
    robot = dataclasses.replace(DIFF, body=loaded)
    assert str(load(text, robot).faults[0]) == "body state=loaded"
    (problem,) = problems(text.replace("loaded", "lodaed"), robot)
    assert problem == (
        ":3: fault[0].state: 'lodaed', allowed: empty, loaded; did you mean \"loaded\"?"
    )


@pytest.mark.parametrize(
    ("robot", "wrong", "nearest", "right"),
    [
        (VESC, 0x90A, 0x8000_090A, 0x8000_030A),
        (MOTEUS, 0x8001, 0x8000_8001, 0x100),
    ],
)
def test_frames_of_bought_drives_go_by_their_identifiers_marked_where_they_have_29_bits(
    load, problems, robot, wrong, nearest, right
):
    text = '[[fault]]\nkind = "frames_lost"\nid = {}\nat = 1'
    (problem,) = problems(text.format(wrong), robot)
    assert f"{wrong:#05x}, nobody sends it, nearest is {nearest:#05x}; allowed: " in problem
    (planned,) = load(text.format(right), robot).faults
    assert str(planned) == f"frames_lost id={right:#x}"


@pytest.mark.parametrize("kind", ["imu_stuck", "gyro_biased", "tilted"])
def test_a_fault_of_an_imu_is_one_of_robots_that_have_it(problems, kind):
    assert problems(f'[[fault]]\nkind = "{kind}"\nat = 1', DIFF) == [
        ":2: fault[0].kind: the robot has no IMU: imu.enabled is false"
    ]


@pytest.mark.parametrize(
    "kind", [name for name, each in CATALOGUE.items() if "node" in each.parameters]
)
def test_no_fault_is_of_a_node_that_the_robot_has_not(problems, kind):
    assert problems(f'[[fault]]\nkind = "{kind}"\nnode = "imu"\nat = 1', DIFF) == [
        ":3: fault[0].node: 'imu', the robot has none, allowed: drive, sonar, power"
    ]


@pytest.mark.parametrize("imu", [False, True])
@pytest.mark.parametrize("sonars", [0, 4, 5, 16])
def test_faults_of_frames_know_the_identifiers_of_the_dbc(sonars, imu):
    robot = dataclasses.replace(DIFF, sonar=(DIFF.sonar * 2)[:sonars], imu=ImuMount(enabled=imu))
    dbc = cantools.database.load_file(CONFIGS / "robot.dbc")
    silent = {f"SonarRanges{letter}" for letter in "ABCD"[-(-sonars // 4) :]}
    if not imu:
        silent |= {each.name for each in dbc.messages if each.name.startswith("Imu")}
    known = {
        given
        for given in range(1, 0x800)
        if not list(CATALOGUE["frames_lost"].fits(robot, {"id": float(given)}))
    }
    assert known == {each.frame_id for each in dbc.messages if each.name not in silent} - {0}


def test_a_full_cell_has_the_voltage_of_the_battery():
    assert OCV_V.max() == FULL_CELL_V


def test_a_supply_that_is_below_what_a_brown_out_leaves_is_told_as_the_fault_begins():
    scenario = Scenario((PlannedFault("brown_out", {"volts": 12.59}, 0.1, None),))
    [(_, line)] = begun(scenario, 0.2)
    assert line == (
        "0.100 s: brown_out volts=12.59 failed: the supply has 12.57 V, not over 12.59 V"
    )


def test_all_mistakes_of_a_file_are_told_at_once(problems):
    text = GOOD.replace("right", "wright").replace("0x181", "0x1181").replace("seed", "sed")
    assert [problem.split(":")[1] for problem in problems(text)] == ["1", "5", "11"]


@pytest.mark.parametrize("text", ["[fault]\nkind = 'bus_cut'", "fault = 3", "fault = [3]"])
def test_faults_that_are_no_tables_are_refused(problems, text):
    assert problems(text) == [":1: fault: write each fault as a table [[fault]]"]


@pytest.mark.parametrize(
    "text",
    [
        "seed = '{}'",
        "{} = 1",
        "[[fault]]\nkind = '{}'\nat = 1",
        "[[fault]]\nkind = 'bus_cut'\nat = '{}'",
        "[[fault]]\nkind = 'bus_cut'\nat = 1\nduration = '{}'",
        "[[fault]]\nkind = 'bus_cut'\nat = 1\n{} = 1",
        "[[fault]]\nkind = 'node_cut'\nat = 1\nnode = '{}'",
        "[[fault]]\nkind = 'node_cut'\nat = 1\nnode = ['{}']",
    ],
)
def test_what_is_very_long_is_shortened(problems, text):
    [problem] = problems(text.format("x" * 20_000))
    assert "xx...xx" in problem
    assert len(problem) < 1500


def test_a_file_that_is_no_toml_or_not_there_is_named(problems, tmp_path):
    assert "line 1" in problems("kind == 3")[0]
    assert "4300 digits" in problems("seed = " + "9" * 5000)[0]
    assert "recursion" in problems("seed = " + "[" * 5000)[0]
    with pytest.raises(SimulationError, match=r"missing\.toml: cannot be read"):
        load_scenario(tmp_path / "missing.toml", DIFF)


def test_a_fault_begins_at_its_time_and_once():
    scenario = Scenario((PlannedFault("bus_cut", {"duration": 0.01}, 0.25, None),))
    assert begun(scenario, 2.0) == [(0.25, "0.250 s: bus_cut duration=0.01")]


def test_a_fault_that_cannot_begin_is_told_and_the_others_go_on():
    scenario = Scenario(
        (
            PlannedFault("host_cut", {}, 0.1, None),
            PlannedFault("bus_cut", {}, 0.2, None),
        )
    )
    assert [line for _, line in begun(scenario, 0.3)] == [
        "0.100 s: host_cut failed: no host is on the bus",
        "0.200 s: bus_cut",
    ]


def test_a_fault_whose_time_has_not_come_is_told_apart_from_those_that_have_begun():
    scenario = Scenario(
        (
            PlannedFault("host_cut", {}, 0.1, None),
            PlannedFault("bus_cut", {}, 0.1235, None),
            PlannedFault("bus_cut", {}, None, 1000.0),
            PlannedFault("bus_cut", {"duration": 1.0}, 0.5, None),
        )
    )
    told = [line for _, line in begun(scenario, 0.3)]
    assert len(told) == 2
    assert not_begun(scenario, told) == [
        "0.500 s: bus_cut duration=1 failed: not begun: the run was over"
    ]


def test_pauses_between_random_faults_are_exponential_with_the_mean_that_is_given():
    fault = PlannedFault("frames_lost", {"duration": 0.01}, None, 0.05)
    times = np.array([time for time, _ in begun(Scenario((fault,), seed=1), 40.0)])
    pauses = np.diff(times) - 0.01
    assert len(pauses) == pytest.approx(667, rel=0.15)
    assert pauses.min() >= 0.0
    # Mean and standard deviation of an exponential distribution are equal; each has a relative
    # error of about 1 / sqrt(n) and sqrt(2 / n).
    assert pauses.mean() == pytest.approx(0.05, rel=0.2)
    assert pauses.std() == pytest.approx(0.05, rel=0.25)


def test_the_same_seed_gives_the_same_times_and_another_seed_others():
    fault = PlannedFault("frames_lost", {"duration": 0.01}, None, 0.1)
    first = begun(Scenario((fault,), seed=5), 3.0)
    assert begun(Scenario((fault,), seed=5), 3.0) == first
    assert begun(Scenario((fault,), seed=6), 3.0) != first


def test_a_fault_added_at_the_end_changes_nothing_for_those_before():
    fault = PlannedFault("frames_lost", {"duration": 0.01}, None, 0.1)
    other = PlannedFault("node_reset", {}, None, 0.3)
    alone = begun(Scenario((fault,), seed=5), 3.0)
    both = begun(Scenario((fault, other), seed=5), 3.0)
    assert [each for each in both if "frames_lost" in each[1]] == alone
    assert len(both) > len(alone)


def test_the_simulator_in_real_time_tells_each_fault_as_it_begins(tmp_path):
    scenario = tmp_path / "scenario.toml"
    scenario.write_text(
        '[[fault]]\nkind = "node_reset"\nnode = "sonar"\nat = 0.25\n'
        '[[fault]]\nkind = "host_cut"\nat = 0.1\n'
    )
    command = [
        *(sys.executable, "-m", "firmware_sim"),
        *("--robot", CONFIGS / "diff_drive.toml"),
        *("--world", CONFIGS / "worlds" / "empty_room.toml"),
        *("--bus", f"simcan:scenario-{os.getpid()}"),
        *("--duration", "0.4", "--faults", scenario),
    ]
    done = subprocess.run(
        command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=90, check=True
    )
    assert [line for line in done.stdout.splitlines() if line.startswith("fault")] == [
        "fault at 0.100 s: host_cut failed: no host is on the bus",
        "fault at 0.250 s: node_reset node=sonar",
    ]
    scenario.write_text('[[fault]]\nkind = "node_rest"\nat = 0.25\n')
    refused = subprocess.run(command, capture_output=True, text=True, timeout=90, check=False)
    assert refused.returncode == 2
    assert f"{scenario}:2: fault[0].kind" in refused.stderr
    assert "ready" not in refused.stdout


def test_a_simulator_to_which_nobody_listens_any_more_runs_on(tmp_path):
    scenario = tmp_path / "scenario.toml"
    scenario.write_text('[[fault]]\nkind = "host_cut"\nat = 0.5\n' * 2)
    command = [
        *(sys.executable, "-m", "firmware_sim"),
        *("--robot", CONFIGS / "diff_drive.toml"),
        *("--world", CONFIGS / "worlds" / "empty_room.toml"),
        *("--bus", f"simcan:{tmp_path}/can.sock"),
        *("--duration", "0.6", "--faults", scenario),
    ]
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout.readline().startswith(b"ready")
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 0
