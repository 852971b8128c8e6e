"""`robotctl characterise` at the command line: what it prints, writes and returns."""

import dataclasses
import shutil
import tomllib

import pytest

from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.cli import calibration
from robotctl.cli import main as command_line
from robotctl.config.robot_file import find_file
from robotctl.workbench.sensors import characterise as work
from tests.cli.command import status_of


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A recording of the simulated robot on its first 20 s through the flat."""
    folder = tmp_path_factory.mktemp("log")
    options = SimOptions(
        find_file("diff_drive"),
        find_file("patrol", "missions"),
        max_seconds=20.0,
        overrides=("simulation.sonar.crosstalk_probability=0.0",),
        record=folder,
    )
    for _ in LockstepRun(options).steps():
        pass
    return folder


def run(*arguments):
    return status_of("characterise", *arguments)


def test_a_recording_gives_a_table_a_patch_and_a_plot(capsys, tmp_path, log):
    patch, plot = tmp_path / "patch.toml", tmp_path / "plot.png"
    assert run("--log", log, "--map", "flat", "--out", patch, "--plot", plot) == 0
    printed = capsys.readouterr()
    for word in ("sigma_per_m", "95 % interval", "the simulation's truth", "incidence limit"):
        assert word in printed.out
    assert "fitting" in printed.err
    sonar = tomllib.loads(patch.read_text())["localisation"]["sonar"]
    # The noise of the simulation is 0.4 % of the range, its outliers are 0.5 %.
    assert 0.003 < sonar["sigma_per_m"] < 0.005
    assert sonar["random"] < 0.1
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert f"patch: {patch}" in printed.out
    assert "robotctl config check" in printed.out


def test_without_a_file_for_it_the_patch_is_shown(capsys, log):
    assert run("--log", log, "--map", "flat") == 0
    assert "[localisation.sonar]" in capsys.readouterr().out


def test_settings_that_tell_places_less_well_are_not_written(monkeypatch, capsys, tmp_path, log):
    patch = tmp_path / "patch.toml"
    found = work.characterise

    def worse(options, progress):
        result = found(options, progress)
        return dataclasses.replace(result, told_after=result.told_before - 0.1)

    monkeypatch.setattr(work, "characterise", worse)
    words = ("--log", log, "--map", "flat", "--out", patch)
    assert run(*words) == calibration.WORSE
    printed = capsys.readouterr().out
    assert "readings say less about the place" in printed
    assert f"{patch} was not written" in printed
    assert not patch.exists()


def test_a_recording_without_poses_ends_with_a_sentence(capsys, tmp_path, log):
    shutil.copytree(log, tmp_path / "log")
    (tmp_path / "log" / "truth-0001.tum").unlink()
    words = ("--log", tmp_path / "log", "--map", "flat")
    assert run(*words) == calibration.ABORTED
    assert "the poses of the readings are unknown" in capsys.readouterr().err


def test_a_room_that_is_another_ends_with_a_sentence(capsys, log):
    assert run("--log", log, "--map", "corridor_loop") == calibration.ABORTED
    assert "Is it the right map" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (["--robot", "diff_driv"], 'did you mean "diff_drive"?'),
        (["--log", "nowhere"], "nowhere: no such file or folder"),
        (["--sensor", "sonr"], 'must be lidar or sonar; did you mean "sonar"?'),
        (["--map", "flt"], 'did you mean "flat"?'),
        (["--out", "nowhere/patch.toml"], "the folder nowhere does not exist"),
        (["--plot", "plot.txt"], "the suffix must be one of .png, .svg, .pdf"),
        (["--set", "drive.track_with_m=1.0"], 'did you mean "track_width_m"?'),
    ],
)
def test_bad_input_is_refused_with_status_2(capsys, arguments, what):
    assert run(*arguments) == command_line.BAD_INPUT
    assert what in capsys.readouterr().err


def test_a_recording_without_scans_needs_a_map(capsys, log):
    assert run("--log", log) == command_line.BAD_INPUT
    assert "give the room with --map" in capsys.readouterr().err
