"""`robotctl calibrate odometry` at the command line: what it prints, writes and returns."""

import dataclasses
import tomllib

import pytest

from robotctl.cli import calibration
from robotctl.cli import main as command_line
from robotctl.workbench.odometry.calibrate_checks import Check
from robotctl.workbench.odometry.calibrate_odometry import calibrate_odometry
from tests.cli.command import status_of
from tests.workbench.odometry.lego_drive import NOMINAL, write_lego


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A log of a robot whose wheels are 4 % larger, and the track 3 % wider, than nominal."""
    return write_lego(tmp_path_factory.mktemp("log") / "made_up.txt", 1.04, 1.03)


def run(*arguments):
    return status_of("calibrate", "odometry", *arguments)


def settings():
    return [word for setting in NOMINAL for word in ("--set", setting)]


def test_a_log_gives_tables_a_patch_and_a_plot(capsys, tmp_path, log):
    patch, plot = tmp_path / "patch.toml", tmp_path / "plot.png"
    assert run("--log", log, *settings(), "--out", patch, "--plot", plot) == 0
    printed = capsys.readouterr()
    for word in ("wheel_radius_m", "95 % interval", "first half alone", "second half", "factors"):
        assert word in printed.out
    assert "fitting" in printed.err
    assert 0.0201 < tomllib.loads(patch.read_text())["drive"]["wheel_radius_m"] < 0.0215
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert f"patch: {patch}" in printed.out
    assert "robotctl config check" in printed.out


def test_values_that_make_it_worse_are_not_written(monkeypatch, capsys, tmp_path, log):
    patch = tmp_path / "patch.toml"

    def worse(options, progress):
        result = calibrate_odometry(options, progress)
        return dataclasses.replace(result, checks=(Check("this", 0.1, 0.2),))

    monkeypatch.setattr("robotctl.workbench.odometry.calibrate_odometry.calibrate_odometry", worse)
    assert run("--log", log, *settings(), "--out", patch) == calibration.WORSE
    printed = capsys.readouterr().out
    assert "worse with the new values" in printed
    assert "this: 0.2000 m, before 0.1000 m" in printed
    assert not patch.exists()


def test_data_that_are_too_few_end_with_a_sentence(capsys, tmp_path):
    short = write_lego(tmp_path / "short.txt", 1.0, 1.0, metres=1.0)
    assert run("--log", short, *settings()) == calibration.ABORTED
    assert "at least 3 m are needed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (["--robot", "diff_driv"], 'did you mean "diff_drive"?'),
        (["--log", "nowhere.log"], "nowhere.log: no such file or folder"),
        (["--runs", "nowhere.toml"], "nowhere.toml: cannot be read"),
        (["--log", "a", "--runs", "b"], "--log and --runs: found both, one of them is allowed"),
        (["--out", "nowhere/patch.toml"], "the folder nowhere does not exist"),
        (["--plot", "plot.txt"], "the suffix must be one of .png, .svg, .pdf"),
        (["--set", "drive.track_with_m=1.0"], 'did you mean "track_width_m"?'),
    ],
)
def test_bad_input_is_refused_with_status_2(capsys, arguments, what):
    assert run(*arguments) == command_line.BAD_INPUT
    assert what in capsys.readouterr().err
