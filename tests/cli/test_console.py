"""What users named is printed as they named it."""

import io
from collections.abc import Callable

import pytest
from rich.console import Console
from rich.table import Table

from robotctl.cli.console import plain_console
from robotctl.cli.progress import progress_bar

NAME = "[bold]a[/x] :car: log[0].rec"


def printed(show: Callable[[Console], object]) -> str:
    """Return what a command shows where there is room for it."""
    console = plain_console()
    console.file = io.StringIO()
    console.width = 120
    show(console)
    return console.file.getvalue()


def table() -> Table:
    shown = Table(NAME, title=NAME)
    shown.add_row(NAME)
    return shown


@pytest.mark.parametrize(
    ("show", "times"),
    [(lambda console: console.print(NAME), 1), (lambda console: console.print(table()), 3)],
    ids=["a line", "a table"],
)
def test_a_name_is_no_markup(show: Callable[[Console], object], times: int) -> None:
    assert printed(show).count(NAME) == times


def test_the_name_of_a_log_is_no_markup_beside_a_bar() -> None:
    screen = io.StringIO()
    terminal = Console(
        file=screen, force_terminal=True, width=120, _environ={"TERM": "xterm"}, markup=True
    )
    with progress_bar(terminal, NAME, NAME) as tell:
        tell(1, 2)
    assert f"reading {NAME}" in screen.getvalue()


def test_errors_and_notes_go_to_the_standard_error() -> None:
    assert plain_console(stderr=True).stderr
