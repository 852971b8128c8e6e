"""Parameters written into a robot's file: by tomllib, what was meant, and nothing else."""

import shutil
import tomllib

import pytest

from robotctl.config import file_edit
from robotctl.config.file_edit import edit
from robotctl.config.file_writing import ParameterWriter
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import config_directory, contradictions, load_robot
from robotctl.config_values import problems, replaced
from robotctl.errors import ConfigError, InvalidValue
from robotctl.mavlink.parameters.parameter import Change
from robotctl.mavlink.parameters.parameter_set import Configurations, ParameterSet

ROBOTS = sorted(
    each.stem for each in config_directory().glob("*.toml") if "[robot]" in each.read_text()
)
KP = "control.left.kp"


def copied(tmp_path, name):
    file = tmp_path / f"{name}.toml"
    shutil.copy(config_directory() / file.name, file)
    return file


def writer_of(file, *overrides):
    return ParameterWriter(StackOptions("test", str(file), overrides).validated())


@pytest.fixture
def file(tmp_path):
    return copied(tmp_path, "diff_drive")


def flat(tables, before=""):
    found = {}
    for key, value in tables.items():
        if isinstance(value, dict):
            found |= flat(value, f"{before}{key}.")
        else:
            found[before + key] = value
    return found


def comments(text):
    return [line.partition("#")[2] for line in text.splitlines() if "#" in line]


@pytest.mark.parametrize("name", ROBOTS)
def test_every_parameter_of_every_robot_is_written_and_read_back(tmp_path, name):
    file = copied(tmp_path, name)
    before = file.read_text()
    was, config = flat(tomllib.loads(before)), load_robot(file)
    known = ParameterSet(Configurations(config, config, contradictions), {}).parameters
    values = {}
    for parameter in known:
        value = getattr_of(config, parameter.key)
        other = not value if isinstance(value, bool) else value + 1
        other = other if isinstance(value, bool | int) else value * 0.97 + 0.001
        try:
            tried = replaced(config, parameter.key, other)
        except InvalidValue:
            continue
        if parameter.change is Change.NEVER or problems(tried, contradictions):
            continue
        after, _ = edit(before, [file_edit.Change((*parameter.key.split("."),), other)])
        assert flat(tomllib.loads(after)) == was | {parameter.key: other}
        assert comments(after) == comments(before)
        config = tried
        values[parameter.key] = other
    assert len(values) > 40
    assert set(writer_of(file).save(values)[2]) == set(values)
    assert flat(tomllib.loads(file.read_text())) == was | values
    assert comments(file.read_text()) == comments(before)


def getattr_of(config, key):
    for part in key.split("."):
        config = getattr(config, part)
    return config


def test_the_old_file_stays_as_a_copy_and_no_copy_is_overwritten(file):
    writer, first = writer_of(file), file.read_text()
    assert writer.save({KP: 0.7}) == (file.name, f"{file.name}.~1~", (KP,))
    second = file.read_text()
    assert writer.save({KP: 0.65, "control.left.ki": 5.0})[1] == f"{file.name}.~2~"
    assert (file.parent / f"{file.name}.~1~").read_text() == first
    assert (file.parent / f"{file.name}.~2~").read_text() == second
    found = tomllib.loads(file.read_text())["control"]["left"]
    assert (found["kp"], found["ki"]) == (0.65, 5.0)


def test_where_nothing_differs_nothing_is_written(file):
    before = file.stat()
    assert writer_of(file).save({KP: 0.65}) == (file.name, "", ())
    assert (file.stat().st_ino, file.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
    assert [each.name for each in file.parent.iterdir()] == [file.name]


def test_a_file_that_somebody_changed_meanwhile_is_left_alone(file):
    writer = writer_of(file)
    writer.save({KP: 0.7})
    changed = file.read_text().replace("v_max_m_s = 0.8", "v_max_m_s = 0.7")
    file.write_text(changed)
    with pytest.raises(ConfigError, match="has changed since the robot started"):
        writer.save({KP: 0.8})
    assert file.read_text() == changed


def test_comments_that_somebody_wrote_meanwhile_stay(file):
    writer = writer_of(file)
    file.write_text(f"# tuned on the bench\n{file.read_text()}")
    writer.save({KP: 0.7})
    assert file.read_text().startswith("# tuned on the bench\n")


def test_a_file_that_would_be_wrong_is_left_alone(file):
    before = file.read_text()
    with pytest.raises(ConfigError, match="a_max_m_s2"):
        writer_of(file).save({"navigation.guard.deceleration_m_s2": 20.0})
    assert file.read_text() == before
    assert [each.name for each in file.parent.iterdir()] == [file.name]


def test_a_link_to_the_file_stays_a_link(file, tmp_path):
    link = tmp_path / "robot.toml"
    link.symlink_to(file)
    writer_of(link).save({KP: 0.7})
    assert link.is_symlink()
    assert load_robot(file).control.left.kp == 0.7


def test_a_setting_on_top_of_the_file_is_not_written_into_it(file):
    before = file.read_text()
    assert writer_of(file, "control.left.kp=0.9").save({KP: 0.9})[2] == ()
    assert file.read_text() == before


def test_a_file_in_a_folder_that_may_not_be_written_is_not_offered(file, monkeypatch):
    assert writer_of(file).writable == str(file)
    monkeypatch.setattr("os.access", lambda path, _mode: path != file.parent)
    assert writer_of(file).writable == ""
