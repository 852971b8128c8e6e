"""Help of every command says, at 80 columns, what its source says: whole, and in plain words."""

import inspect
import re
import typing

import pytest
from typer.testing import CliRunner

from robotctl.cli.commands import COMMANDS, app, load


def below(words, command):
    """Yield all commands and groups from one on, with the words that call them."""
    yield words, command
    for name, inner in getattr(command, "commands", {}).items():
        yield from below((*words, name), inner)


ALL = {words: each for name in COMMANDS for words, each in below((name,), load(name))}


def help_of(*words):
    result = CliRunner().invoke(app, [*words, "--help"], env={"COLUMNS": "80"})
    assert result.exit_code == 0, result.output
    return result.output


def squeezed(text):
    """Return a text without the gaps of its lines, which also break words at hyphens."""
    return "".join(text.split())


def summary_of(command):
    text = inspect.getdoc(command.callback) if command.callback else command.help
    return text.partition("\n\n")[0]


@pytest.mark.parametrize("words", [(), *ALL], ids=" ".join)
def test_help_fits_and_shows_neither_markup_nor_types_of_python(words):
    text = help_of(*words)
    assert max(map(len, text.splitlines())) <= 80
    assert not re.search(r"<\w|list\[|\[/|\[bold", text)


@pytest.mark.parametrize("words", ALL, ids=" ".join)
def test_help_says_all_that_the_source_says(words):
    command, text = ALL[words], squeezed(help_of(*words))
    if command.callback is None:  # a group
        for name, inner in command.commands.items():
            assert squeezed(f"{name} {summary_of(inner)}") in text
        return
    assert squeezed(inspect.getdoc(command.callback)) in text
    hints = typing.get_type_hints(command.callback, include_extras=True)
    written = [
        each.help
        for hint in hints.values()
        for each in getattr(hint, "__metadata__", ())
        if getattr(each, "help", None)
    ]
    assert len(written) == sum(parameter.help is not None for parameter in command.params)
    for each in written:
        assert squeezed(each) in text


def test_the_list_of_commands_is_not_cut():
    text = squeezed(help_of())
    for name, (_, summary) in COMMANDS.items():
        assert squeezed(f"{name} {summary}") in text
