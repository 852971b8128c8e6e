"""Parameters over restarts: what is kept, and what the robot's file no longer allows."""

import msgspec
import pytest

from robotctl.config.changes import NAME, ParameterFile, with_changes
from robotctl.config.options import StackOptions, options_of_command_line
from robotctl.config.robot_file import find_file

VALUES = {"control.left.kp": 0.7, "safety.arm_timeout_ms": 2000, "mavlink.hold_on_gcs_loss": False}


@pytest.fixture
def options(tmp_path):
    return StackOptions("robot", str(find_file("diff_drive")), state=str(tmp_path)).validated()


def test_the_processes_begin_with_the_file_and_what_is_kept(options, tmp_path):
    assert ParameterFile(str(tmp_path)).save(VALUES)
    options, notes = with_changes(options)
    (note,) = notes
    assert note.startswith(
        "parameters that replace those of the robot's file: control.left.kp = 0.7"
    )
    started = options_of_command_line(options.command("module")[2:])
    config = started.load()
    assert config.control.left.kp == 0.7
    assert config.safety.arm_timeout_ms == 2000
    assert config.mavlink.hold_on_gcs_loss is False
    assert started.load_file().control.left.kp == 0.65


def test_without_a_folder_nothing_is_kept(options):
    nowhere = msgspec.structs.replace(options, state="")
    assert with_changes(nowhere) == (nowhere, ())
    assert not ParameterFile("").save(VALUES)


def test_what_the_file_no_longer_allows_is_named_and_the_rest_is_taken(options, tmp_path):
    bad = {"control.middle.kp": 1.0, "navigation.guard.deceleration_m_s2": 9.0}
    ParameterFile(str(tmp_path)).save(VALUES | bad)
    options, notes = with_changes(options)
    assert options.changes == VALUES
    assert len(notes) == 3
    assert notes[0].startswith("parameter control.middle.kp = 1.0 is left out: ")
    assert "limits.a_max_m_s2" in notes[1]


def test_a_damaged_file_gives_the_generation_before_and_says_so(options, tmp_path):
    file = ParameterFile(str(tmp_path))
    file.save({"control.left.kp": 0.7})
    file.save({"control.left.kp": 0.8})
    path = tmp_path / NAME
    path.write_bytes(path.read_bytes()[:-5])
    options, notes = with_changes(options)
    assert options.changes == {"control.left.kp": 0.7}
    assert "damaged" in notes[0]


def test_what_was_written_into_the_file_is_no_longer_kept_beside_it(options, tmp_path):
    kept = ParameterFile(str(tmp_path))
    kept.save({"control.left.kp": 0.7, "control.left.ki": 4.3})
    kept.drop_those_of(options.load_file())
    assert kept.load()[0] == {"control.left.kp": 0.7}
    before = {each.name: each.stat().st_mtime_ns for each in tmp_path.iterdir()}
    kept.drop_those_of(options.load_file())
    assert {each.name: each.stat().st_mtime_ns for each in tmp_path.iterdir()} == before
