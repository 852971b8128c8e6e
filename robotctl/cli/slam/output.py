"""Output shared by the kinds of `robotctl slam`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import typer
from rich.console import Console

from robotctl.cli.files import write_file
from robotctl.errors import ConfigError

if TYPE_CHECKING:
    from robotctl.estimation.slam.verdict.verdict import Verdict

_STATUS: Final = {"doubtful": 3, "not a map": 1}
"""Status to end with by the verdict on the map."""


def check_folder(out: Path) -> None:
    """Refuse a folder that cannot be made.

    Raises
    ------
    ConfigError
        If the folder around it does not exist, or it is a file.
    """
    if not out.parent.is_dir():
        raise ConfigError(f"--out {out}: the folder {out.parent} does not exist")
    if out.exists() and not out.is_dir():
        raise ConfigError(f"--out {out}: is a file, a folder is needed")


def write_slam(
    out: Path,
    console: Console,
    notes: Iterable[str],
    write: Callable[[Path], object],
) -> None:
    """Print notes, and write the results into a folder."""
    for note in notes:
        console.print(f"note: {note}", soft_wrap=True)
    write_file(out, lambda folder: folder.mkdir(exist_ok=True))
    write_file(out, write)


def end_by_verdict(verdict: Verdict | None, console: Console) -> None:
    """Tell why a map is not good, and end with the status for that; its files are written."""
    if verdict is not None and verdict.reasons:
        console.print(f"verdict: {verdict}", soft_wrap=True)
        raise typer.Exit(_STATUS[verdict.quality])


def error_words(compared: Mapping[str, Any] | None) -> str:
    """Return how far a trajectory is from the log's reference, for people."""
    if compared is None:
        return "no reference to compare with"
    return (
        f"position error {compared['rmse_m']:.3f} m rms after alignment, at most "
        f"{compared['max_m']:.3f} m"
    )
