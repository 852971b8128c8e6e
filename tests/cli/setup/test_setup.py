"""`robotctl setup`: its words, its files, and a person at a terminal."""

import os
import shutil
import tomllib

import pytest

from robotctl.cli.setup import terminal
from robotctl.cli.setup.terminal import Terminal, prompt
from robotctl.config.robot_file import config_directory
from robotctl.deploy.setup.dialogue import Ask, Kind, PersonLeftError, Topic
from tests.cli.command import status_of

SHIPPED = config_directory() / "odrive.toml"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("odrive",), "copy it first"),
        (("prove",), "[STEP] ROBOT needed"),
        (("no_step", "odrive"), "STEP one of nodes, counts"),
        (("prove", "odrive", "more"), "[STEP] ROBOT needed"),
        (("--undo", "odrive"), "needs a step"),
        (("no_robot",), "no such file"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_what_can(words, said, capsys):
    assert status_of("setup", *words) == 2
    assert said in capsys.readouterr().err


def test_a_shipped_file_is_simulated_on_a_copy(capsys):
    before = SHIPPED.read_bytes()
    assert status_of("setup", "--simulate", "prove", "odrive") == 0
    assert SHIPPED.read_bytes() == before
    printed = capsys.readouterr().out
    assert "left_drive: power gone after" in printed
    tables = tomllib.loads(printed.partition("The file would be:")[2])
    assert set(tables["proof"]) == {"left_drive", "right_drive"}


def test_a_step_is_undone_from_the_command_line(tmp_path, capsys):
    file = tmp_path / "robot.toml"
    shutil.copy(SHIPPED, file)
    assert status_of("setup", "--simulate", "--undo", "prove", file) == 0
    assert "prove: undone" in capsys.readouterr().out


@pytest.fixture
def typed(monkeypatch):
    """Types at the terminal; closes it without arguments."""
    reading, writing = os.pipe()

    def put(*texts):
        for text in texts:
            os.write(writing, text)
        if not texts:
            os.close(writing)

    with os.fdopen(reading) as stdin:
        monkeypatch.setattr(terminal.sys, "stdin", stdin)
        yield put


def test_a_line_is_an_answer_and_half_a_line_is_none(typed):
    person = Terminal()
    person.ask(Ask(Topic.SPEED, "How fast?", Kind.NUMBER))
    assert person.answer() is None
    typed(b"0.")
    assert person.answer() is None
    typed(b"5\n")
    assert person.answer() == "0.5"
    assert person.answer() is None
    typed()


def test_what_was_typed_before_a_question_is_no_answer_to_it(typed):
    person = Terminal()
    typed(b"yes\n")
    person.ask(Ask(Topic.NEXT, "Go on?", Kind.YES_NO))
    assert person.answer() is None
    typed()


def test_a_key_interrupts_and_so_does_a_terminal_that_is_gone(typed):
    person = Terminal()
    person.ask(Ask(Topic.BLOCKS, "Ready?"))
    assert not person.interrupts()
    typed(b"\n")
    assert person.interrupts()
    person.ask(Ask(Topic.BLOCKS, "Ready?"))
    assert not person.interrupts()
    typed()
    assert person.interrupts()
    with pytest.raises(PersonLeftError, match="terminal is gone"):
        person.answer()


def test_a_question_shows_what_may_be_answered():
    ask = Ask(Topic.WHEEL, "Which wheel?", Kind.CHOICE, ("left", "right"), "left")
    assert prompt(ask) == "Which wheel? left/right [left]"
    assert prompt(Ask(Topic.BLOCKS, "Ready.")) == "Ready. [Enter]"
