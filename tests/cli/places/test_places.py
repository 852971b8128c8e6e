"""`robotctl places` as a user types it, on recordings written here."""

import math

import pytest
from typer.testing import CliRunner

from robotctl.cli.commands import app
from robotctl.errors import ConfigError
from tests.workbench.places.test_places import Shifted, write_log
from tests.workbench.places.turning_robot import hallway, kitchen, turning


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder with recordings of the kitchen, of the kitchen once more, and of a hallway."""
    path = tmp_path_factory.mktemp("places")
    write_log(path / "kitchen", turning(kitchen), Shifted(3.0, 4.0))
    write_log(path / "again", turning(kitchen, heading=0.4, drift=1.3))
    write_log(path / "hallway", turning(hallway))
    write_log(path / "nothing", turning(lambda _bearing: math.inf))
    return path


def run(*words):
    return CliRunner().invoke(app, ["places", *map(str, words)])


def test_a_place_is_learnt_listed_and_recognised(folder, tmp_path):
    book = ("--book", tmp_path / "b.toml")
    learnt = run("learn", "kitchen", *book, "--log", folder / "kitchen")
    assert learnt.exit_code == 0, learnt.output
    assert "kitchen: visit 1 at x 3.00 m, y 4.00 m" in learnt.output
    assert run("learn", "hallway", *book, "--log", folder / "hallway").exit_code == 0
    listed = run("list", *book, "--plot", tmp_path / "list.png")
    assert listed.exit_code == 0, listed.output
    for words in ("kitchen", "hallway", "expected, none measured", "2 measured"):
        assert words in listed.output
    assert (tmp_path / "list.png").read_bytes().startswith(b"\x89PNG")
    found = run("recognise", *book, "--log", folder / "again", "--plot", tmp_path / "found.svg")
    assert found.exit_code == 0, found.output
    assert found.output.startswith("kitchen: turned by ")
    assert "x 3.00 m, y 4.00 m" in found.output
    assert "<svg" in (tmp_path / "found.svg").read_text(encoding="utf-8")


def test_a_place_that_is_not_known_is_refused_with_status_3_and_a_reason(folder, tmp_path):
    book = ("--book", tmp_path / "b.toml")
    run("learn", "kitchen", *book, "--log", folder / "kitchen")
    for log, reason in (("hallway", "unknown: kitchen"), ("nothing", "unknown: kitchen")):
        found = run("recognise", *book, "--log", folder / log)
        assert found.exit_code == 3
        assert found.output.startswith("refused: ")
        assert reason in found.output


def test_a_second_name_for_one_place_is_remarked_on(folder, tmp_path):
    book = ("--book", tmp_path / "b.toml")
    run("learn", "kitchen", *book, "--log", folder / "kitchen")
    again = run("learn", "canteen", *book, "--log", folder / "again")
    assert "canteen is hardly told from kitchen" in again.output
    assert "may be taken for each other" in again.output
    found = run("recognise", *book, "--log", folder / "again")
    assert found.exit_code == 3
    assert "ambiguous: " in found.output


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("list", "--book", "none.toml"), "none.toml: cannot be read"),
        (("recognise", "--book", "none.toml", "--log", "LOG"), "none.toml: cannot be read"),
        (("learn", "x", "--book", "/nowhere/b.toml", "--log", "LOG"), "/nowhere does not exist"),
        (("list", "--book", "none.toml", "--plot", "a.txt"), "the suffix must be one of"),
        (("learn", "x", "--book", "b.toml"), "must give the place of the turn, found none"),
    ],
)
def test_what_does_not_fit_is_refused_with_a_sentence(folder, tmp_path, monkeypatch, words, says):
    monkeypatch.chdir(tmp_path)
    result = run(*(folder / "kitchen" if word == "LOG" else word for word in words))
    assert isinstance(result.exception, ConfigError), result.output
    assert says in str(result.exception)
