"""Whole missions under faults, in lockstep."""

import dataclasses
import hashlib
import json
import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from robotctl.app.scoring.score import Report
from robotctl.app.simulation.lockstep import run_lockstep
from robotctl.app.simulation.sim import SimRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.app.simulation.simulator_files import SimulatorError, load_faults
from robotctl.cli.commands import app
from robotctl.config.robot_file import find_file
from robotctl.errors import ConfigError

PATROL = find_file("patrol", "missions")


def drive(faults: Path | None, **options: object) -> Report:
    return run_lockstep(SimOptions(find_file("diff_drive"), PATROL, faults=faults, **options))


def can_log(folder: Path, faults: Path | None) -> str:
    drive(faults, record=folder, max_seconds=8.0)
    return hashlib.sha256((folder / "can-0001.log").read_bytes()).hexdigest()


def test_the_same_seeds_and_file_give_the_same_can_log_to_the_byte(tmp_path: Path) -> None:
    noisy = find_file("bus", "scenarios")
    other = tmp_path / "other.toml"
    other.write_text(noisy.read_text().replace("seed = 1", "seed = 2"))
    first = can_log(tmp_path / "a", noisy)
    assert can_log(tmp_path / "b", noisy) == first
    assert can_log(tmp_path / "c", other) != first
    assert can_log(tmp_path / "d", None) != first


def test_the_robot_drives_on_over_a_noisy_bus() -> None:
    report = drive(find_file("bus", "scenarios"))
    assert report.mission_completed, report.message
    assert {each.split()[2] for each in report.faults} == {
        "frames_destroyed", "frames_lost", "frames_corrupt", "frames_repeated",
    }  # fmt: skip
    assert report.unsafe_motions == 0


def test_the_robot_stops_for_a_plug_that_comes_off_and_the_report_says_what_befell_it() -> None:
    report = drive(find_file("sensors", "scenarios"))
    assert not report.mission_completed
    assert "right encoder stuck" in report.message
    assert 18.0 < report.duration_s < 18.5  # a cause may yet show up
    assert report.faults == (
        "8.000 s: encoder_glitch wheel=left counts=40",
        "12.000 s: sonar_silent duration=0.1",
        "18.000 s: encoder_stuck wheel=right duration=5",
    )
    assert report.unsafe_motions == 0


def test_a_scenario_that_is_wrong_is_refused_before_anything_starts(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text('[[fault]]\nkind = "bus_cot"\nat = 1\n')
    with pytest.raises(SimulatorError, match=r'wrong\.toml:2: .*did you mean "bus_cut"'):
        drive(wrong)
    with pytest.raises(ConfigError, match='did you mean "sensors"'):
        find_file("sensor", "scenarios")


def options_of(faults: Path, robot: str = "diff_drive") -> SimOptions:
    return SimOptions(find_file(robot), PATROL, faults=faults, max_seconds=1.0)


@pytest.mark.parametrize("run", [run_lockstep, SimRun], ids=["lockstep", "real time"])
@pytest.mark.parametrize(
    ("robot", "table", "said"),
    [
        ("diff_drive", 'kind = "sonar_crosstalk"\nother = 15', ":3: fault[0].other: 15, the robot"),
        ("diff_drive", 'kind = "sonar_crosstalk"\nother = 0', ":3: fault[0].other: 0, must be"),
        ("tricycle", 'kind = "encoder_stuck"\nwheel = "right"', ":3: fault[0].wheel: 'right', the"),
    ],
)
def test_a_fault_that_the_robot_cannot_feel_is_refused_before_anything_starts(
    tmp_path: Path, run: Callable[[SimOptions], object], robot: str, table: str, said: str
) -> None:
    scenario = tmp_path / "scenario.toml"
    scenario.write_text(f"[[fault]]\n{table}\nat = 1\n")
    with pytest.raises(SimulatorError) as caught:
        run(options_of(scenario, robot))
    assert str(caught.value).startswith(f"{scenario}{said}")


def test_settings_of_the_robot_count_for_its_faults_too(tmp_path: Path) -> None:
    scenario = tmp_path / "scenario.toml"
    scenario.write_text('[[fault]]\nkind = "brown_out"\nvolts = 12.4\nat = 1\n')
    options = options_of(scenario)
    assert load_faults(options).faults
    low = dataclasses.replace(options, overrides=("simulation.battery.voltage_scale=0.9",))
    with pytest.raises(SimulatorError, match=r":3: .*12\.4, the battery has 11\.34 V"):
        load_faults(low)


def faults_of_a_failed_run(
    folder: Path, scenario: str, capsys: pytest.CaptureFixture[str]
) -> list[str]:
    """Return the faults in the report of a run that did its mission and failed all the same."""
    faults, file = folder / "scenario.toml", folder / "report.json"
    faults.write_text(scenario)
    with pytest.raises(SystemExit) as ended:
        app(
            [
                "sim",
                "--mission",
                "patrol",
                "--lockstep",
                "--headless",
                "--report",
                str(file),
                "--faults",
                str(faults),
            ]
        )
    assert ended.value.code == 3
    report = json.loads(file.read_text())
    assert report["mission_completed"]
    assert "not applied" in capsys.readouterr().out
    return report["faults"]


def test_a_fault_that_could_not_begin_fails_the_run_and_stands_in_its_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = '[[fault]]\nkind = "brown_out"\nvolts = 12.59\nat = 0.5\n'
    (fault,) = faults_of_a_failed_run(tmp_path, scenario, capsys)
    assert re.fullmatch(r".* failed: the supply has 12\.5\d V, not over 12\.59 V", fault)


def test_a_fault_whose_time_never_comes_fails_the_run_and_stands_in_its_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = '[[fault]]\nkind = "sonar_silent"\n'
    scenario = f"{table}at = 200.0\n{table}every = 100000.0\n"
    assert faults_of_a_failed_run(tmp_path, scenario, capsys) == [
        "200.000 s: sonar_silent failed: not begun: the run was over"
    ]


def test_an_empty_file_of_the_system_is_a_scenario_without_faults() -> None:
    assert not load_faults(options_of(find_file("/dev/null", "scenarios"))).faults


def test_a_run_in_real_time_shows_each_fault_and_reports_those_that_were_not_applied_too(
    tmp_path: Path,
) -> None:
    scenario = tmp_path / "scenario.toml"
    scenario.write_text(
        '[[fault]]\nkind = "bus_cut"\nat = 500.0\n'
        '[[fault]]\nkind = "host_cut"\nat = 0.0\n'
        '[[fault]]\nkind = "sonar_silent"\nduration = 0.1\nat = 1.0\n'
    )
    options = SimOptions(
        find_file("diff_drive"),
        PATROL,
        bus=f"simcan:faults-{os.getpid()}",
        faults=scenario,
        max_seconds=20.0,
        overrides=("mavlink.link=[]",),
    )
    lines: list[str] = []
    heard = False
    with SimRun(options, lambda: heard) as run:
        for progress in run.steps():
            lines += progress.lines
            progress.lines.clear()
            if progress.truth and progress.control and progress.navigation:
                heard = len(run.report().faults) >= 2
        report = run.report()
    assert "fault at 1.000 s: sonar_silent duration=0.1" in lines
    assert report.faults == (
        "0.000 s: host_cut failed: no host is on the bus",
        "1.000 s: sonar_silent duration=0.1",
        "500.000 s: bus_cut failed: not begun: the run was over",
    )
    assert report.failed_faults == (report.faults[0], report.faults[2])
