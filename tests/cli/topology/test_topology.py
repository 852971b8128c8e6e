"""`robotctl topology` and `robotctl plan --topological` as a user types them."""

import math

import pytest
from typer.testing import CliRunner

from robotctl.cli.commands import app
from robotctl.config.robot_file import find_file
from robotctl.errors import ConfigError
from robotctl.maps.topology_file import load_places, load_topology, save_topology
from robotctl.workbench.topology.topology import build_topology


def run(*words):
    return CliRunner().invoke(app, [*map(str, words)])


@pytest.fixture
def flat(tmp_path):
    """The file of the flat, with names."""
    file = tmp_path / "flat.toml"
    marks = tmp_path / "marks.toml"
    marks.write_text('[[mark]]\nname = "lounge"\nx_m = 2.0\ny_m = 2.0\n', encoding="utf-8")
    built = run("topology", "build", "flat", "--marks", marks, "--out", file,
                "--plot", tmp_path / "flat.png")  # fmt: skip
    assert built.exit_code == 0, built.output
    assert "lounge: " in built.output
    assert "2 places, 1 passage\n" in built.output
    assert (tmp_path / "flat.png").read_bytes().startswith(b"\x89PNG")
    assert run("topology", "name", file, "room 2", "kitchen").exit_code == 0
    return file


def test_a_way_leads_through_places_by_name(flat):
    result = run("plan", "--topological", flat, "lounge", "kitchen")
    assert result.exit_code == 0, result.output
    assert result.output.startswith("lounge\n  through passage 1 (0.9")
    assert "\nkitchen\n1 passage, about " in result.output


def test_a_file_without_coordinates_is_as_good(flat, tmp_path):
    lines = flat.read_text(encoding="utf-8").splitlines()
    bare = [line for line in lines if line.split(" ")[0] not in {"x_m", "y_m"}]
    flat.write_text("\n".join(bare), encoding="utf-8")
    assert math.isnan(load_topology(flat).places[0].x_m)
    assert run("plan", "--topological", flat, "lounge", "kitchen").exit_code == 0
    assert load_places(str(flat), tmp_path).undrivable == ""


OLD = """\
version = 1
[[place]]
name = "lounge"
kind = "room"
passages = ["door"]
area_m2 = 20.0
width_m = 4.0
depth_m = [2.0, 2.0, 2.0, 2.0]
[[place]]
name = "kitchen"
kind = "room"
passages = ["door"]
area_m2 = 9.0
width_m = 3.0
[[passage]]
name = "door"
between = ["lounge", "kitchen"]
width_m = 0.9
length_m = 4.0
"""


def test_ways_are_found_in_a_file_of_version_1_but_not_driven(tmp_path):
    file = tmp_path / "old.toml"
    file.write_text(OLD, encoding="utf-8")
    assert run("plan", "--topological", file, "lounge", "kitchen").exit_code == 0
    with pytest.raises(ConfigError, match="what lounge looks like and where its exits are; "):
        load_places(str(file), tmp_path)
    file.write_text(OLD.replace("version = 1", "version = 3"), encoding="utf-8")
    with pytest.raises(ConfigError, match="version 3 of the file found, 1 and 2 are read"):
        load_topology(file)


def test_exits_must_be_those_of_the_passages(flat):
    text = flat.read_text(encoding="utf-8")
    flat.write_text(text.replace('passage = "passage 1"', 'passage = "hatch"'), encoding="utf-8")
    with pytest.raises(ConfigError, match="hatch found; needed: passage 1"):
        load_topology(flat)


def test_a_file_gives_the_map_back(flat, tmp_path):
    again = tmp_path / "again.toml"
    save_topology(load_topology(flat), again)
    assert again.read_bytes() == flat.read_bytes()


def test_no_way_is_status_1(tmp_path):
    file = tmp_path / "apart.toml"
    file.write_text(OLD.partition("[[passage]]")[0].replace('["door"]', "[]"), encoding="utf-8")
    result = run("plan", "--topological", file, "lounge", "kitchen")
    assert result.exit_code == 1
    assert result.output == "no way from lounge to kitchen\n"


def test_bad_input_is_said(flat, tmp_path):
    refused = {
        ("plan", "--topological", flat, "lounge", "kitchn"): "no place 'kitchn'; did you mean",
        ("plan", "--topological", flat, "lounge"): "two places are needed, found lounge",
        ("plan", "--topological", flat, "lounge", "kitchen", "--start", "1,1"): "has no effect",
        ("plan", "--topological", tmp_path / "none.toml", "a", "b"): "cannot be read",
        ("plan", "lounge", "kitchen"): "places are for --topological",
        ("plan", "--map", "flat"): "--start, --goal: needed",
        ("topology", "name", flat, "lounge", "kitchen"): "must be unique, found 'kitchen'",
        ("topology", "name", flat, "attic", "loft"): "no place 'attic'",
    }
    for words, text in refused.items():
        result = run(*words)
        assert isinstance(result.exception, ConfigError), result.output
        assert text in str(result.exception)
    marks = tmp_path / "taken.toml"
    marks.write_text('[[mark]]\nname = "room 2"\nx_m = 2.0\ny_m = 2.0\n', encoding="utf-8")
    taken = run("topology", "build", "flat", "--marks", marks, "--out", tmp_path / "taken")
    assert isinstance(taken.exception, ConfigError)
    assert "must be unique, found 'room 2'" in str(taken.exception)
    passages = flat.read_text(encoding="utf-8").replace('["lounge", "kitchen"]', '["lounge", "x"]')
    flat.write_text(passages, encoding="utf-8")
    result = run("plan", "--topological", flat, "lounge", "kitchen")
    assert "disagree on passage 'passage 1'" in str(result.exception)


def test_marks_that_are_missing_are_told_before_the_map_is_read(tmp_path):
    with pytest.raises(ConfigError, match=r"MISSING.*allowed: .*office"):
        build_topology("no such map", find_file("diff_drive"), (), "MISSING")
    marks = tmp_path / "broken.toml"
    marks.write_text("[[mark]]\nnam = 3\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"broken\.toml"):
        build_topology("no such map", find_file("diff_drive"), (), str(marks))


def test_marks_that_come_along_are_found_by_name(tmp_path):
    result = run("topology", "build", "flat", "--marks", "office", "--out", tmp_path / "flat.toml")
    assert isinstance(result.exception, ConfigError)
    assert "places/office.toml: " in str(result.exception)
    assert "is at no place of flat" in str(result.exception)
