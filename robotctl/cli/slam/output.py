"""Output shared by the kinds of `robotctl slam`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from robotctl.cli.files import check_files, write_file
from robotctl.errors import ConfigError


def write_slam(
    out: Path,
    console: Console,
    notes: Iterable[str],
    write: Callable[[Path], object],
    draw: Callable[[Path], object],
) -> None:
    """Print notes, write the results into a folder, and a picture where matplotlib is there."""
    for note in notes:
        console.print(f"note: {note}", soft_wrap=True)
    write_file(out, lambda folder: folder.mkdir(exist_ok=True))
    write_file(out, write)
    plot = out / "plot.png"
    try:
        check_files(plot=plot)
    except ConfigError as error:
        console.print(f"note: no picture: {error}", soft_wrap=True)
    else:
        write_file(plot, draw)


def error_words(compared: Mapping[str, Any] | None) -> str:
    """Return how far a trajectory is from the log's reference, for people."""
    if compared is None:
        return "no reference to compare with"
    return (
        f"position error {compared['rmse_m']:.3f} m rms after alignment, at most "
        f"{compared['max_m']:.3f} m"
    )
