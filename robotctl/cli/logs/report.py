"""`robotctl report`: a recording as one page for a browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
import typer

from robotctl.cli.console import plain_console
from robotctl.cli.files import check_files, write_file
from robotctl.cli.progress import progress_bar
from robotctl.errors import ConfigError


def report(
    run: Annotated[Path, typer.Argument(help="Folder of --record, or one robot-*.mcap of it.")],
    out: Annotated[Path, typer.Option(help="Page to write, a .html.")],
    score: Annotated[
        Path | None, typer.Option(help="Score of the run, as `sim --report` wrote it.")
    ] = None,
) -> None:
    """Show a recording on one page: map, paths, figures over time, states and notices.

    The page is a single file that loads nothing else, to be sent or kept.
    """
    check_page(out, "--out")
    write_report(run, out, None if score is None else read_score(score))
    print(f"page: {out}")


def read_score(file: Path) -> dict[str, object]:
    """Return the content of a file of `sim --report`.

    Raises
    ------
    ConfigError
        If it cannot be read, or is none.
    """
    try:
        return msgspec.json.decode(file.read_bytes(), type=dict[str, object])
    except OSError as error:
        raise ConfigError(f"--score {file}: cannot be read: {error.strerror}") from error
    except msgspec.DecodeError as error:
        raise ConfigError(f"--score {file}: not a file of `sim --report`: {error}") from error


def check_page(out: Path, option: str) -> None:
    """Refuse a page that could not be written, before any work; see `check_files`."""
    check_files(plot=out, option=option, suffixes=(".html", ".htm"))


def write_report(run: Path, out: Path, score: dict[str, object] | None) -> None:
    """Write the page about a recording; see `report`."""
    console = plain_console(stderr=True)
    with progress_bar(console, run.name, "reading") as tell:
        from robotctl.workbench.logs.run_report import report_of  # noqa: PLC0415 - loads numpy

        found = report_of(run, score, tell)
    from robotctl.cli.logs.report_page import page_of  # noqa: PLC0415 - an extra

    page = page_of(found)
    write_file(out, lambda file: file.write_text(page, encoding="utf-8"))
