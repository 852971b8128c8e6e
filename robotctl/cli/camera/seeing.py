"""`robotctl camera ranges` and `robotctl camera obstacles`: what pictures say of the floor."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from robotctl.cli.console import plain_console
from robotctl.cli.files import check_files, write_file
from robotctl.cli.options import takes_options
from robotctl.errors import ConfigError
from robotctl.words import counted
from robotctl.workbench.camera.options import SeeingOptions

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from robotctl.workbench.camera.seeing import SeenPicture

BLIND = 1


@dataclass(frozen=True, slots=True)
class _Kind:
    """Kind of measurement: its name, and the headings of the table with their columns."""

    name: str
    cells: dict[str, str]


_RANGES = _Kind(
    "ranges",
    {
        "angle deg": "angle_deg",
        "range m": "range_m",
        "σ m": "sigma_m",
        "x, y m": "x_m y_m",
        "": "seen",
    },
)
_OBSTACLES = _Kind(
    "obstacles",
    {
        "foot x, y m": "foot_x_m foot_y_m",
        "σ far, wide": "sigma_along_m sigma_across_m",
        "centre x, y": "centre_x_m centre_y_m",
        "width": "width_m",
        "height": "height_m",
        "cut": "cut",
    },
)

Out = Annotated[
    Path | None,
    typer.Option(help="Write annotated pictures: a file for one, otherwise an existing folder."),
]
CsvFile = Annotated[Path | None, typer.Option("--csv", help="Write the table here as CSV.")]
JsonFile = Annotated[Path | None, typer.Option("--json", help="Write all results here as JSON.")]


@takes_options
def ranges(
    options: SeeingOptions, out: Out = None, csv: CsvFile = None, json: JsonFile = None
) -> None:
    """Measure where the floor ends, as a range scan from below the camera.

    Status 0: all pictures are trusted. 1: in some, which are named, the floor could not be
    distinguished from the rest. 2: bad input.
    """
    _run(_RANGES, options, out, csv, json)


@takes_options
def obstacles(
    options: SeeingOptions, out: Out = None, csv: CsvFile = None, json: JsonFile = None
) -> None:
    """Find free-standing objects on the floor: position, width, height.

    Status 0: all pictures are trusted. 1: in some, which are named, the floor could not be
    distinguished from the rest. 2: bad input.
    """
    _run(_OBSTACLES, options, out, csv, json)


def _run(
    kind: _Kind, options: SeeingOptions, out: Path | None, csv: Path | None, json: Path | None
) -> None:
    """Look at all pictures, show and write what was asked for."""
    check_files(csv, json)
    from robotctl.compiled import COMPILING, cache_is_cold  # noqa: PLC0415 - numba

    progress = plain_console(stderr=True)
    if cache_is_cold():
        progress.print(f"{COMPILING} …")
    from robotctl.workbench.camera import seeing as app  # noqa: PLC0415 - OpenCV and numba

    seeing = app.Seeing(options)
    targets = _targets(seeing.files, out)
    rows_of: Callable[[SeenPicture], list[dict[str, Any]]]
    keys, rows_of = (
        (app.RANGE_KEYS, app.range_rows)
        if kind is _RANGES
        else (app.OBSTACLE_KEYS, app.obstacle_rows)
    )
    rows, entries = [], []
    for seen, target in zip(seeing.look(), targets, strict=True):
        mine = rows_of(seen)
        rows += mine
        entries.append(app.report_entry(seen, kind.name, mine))
        if csv is None and json is None:
            plain_console().print(_table(kind, seen, mine))
        else:
            progress.print(f"{seen.name}: {_summary(kind, mine)}")
        if not seen.view.trusted:
            print(f"{seen.name}: not trusted: {seen.view.why}", file=sys.stderr)
        if target is not None:
            _write_annotated(target, seeing.annotated(seen))
    if csv is not None:
        write_file(csv, lambda file: app.write_rows(file, keys, rows))
        print(f"table: {csv}")
    if json is not None:
        write_file(json, lambda file: app.write_report(file, kind.name, entries))
        print(f"report: {json}")
    if not all(entry["trusted"] for entry in entries):
        sys.exit(BLIND)


def _write_annotated(target: Path, picture: NDArray[np.uint8]) -> None:
    """Write an annotated picture and say where."""
    from robotctl.workbench.camera.pictures import write_picture  # noqa: PLC0415 - OpenCV

    write_file(target, lambda file: write_picture(file, picture))
    print(f"annotated: {target}")


def _targets(files: tuple[Path, ...], out: Path | None) -> list[Path | None]:
    """Return where each annotated picture goes; raises ConfigError if that cannot be."""
    if out is None:
        return [None] * len(files)
    if out.is_dir():
        targets = [out / f"{file.stem}_seen.png" for file in files]
        if len(set(targets)) < len(targets):
            raise ConfigError(f"--out {out}: two of the pictures have the same name")
        return list(targets)
    if len(files) > 1:
        raise ConfigError(f"--out {out}: not a folder; for {len(files)} pictures make one first")
    from robotctl.workbench.camera.pictures import check_suffix  # noqa: PLC0415 - OpenCV

    check_files(out)
    check_suffix(out)
    return [out]


def _table(kind: _Kind, seen: SeenPicture, rows: list[dict[str, Any]]) -> Table:
    """Return the rows of one picture for a terminal."""
    trust = "" if seen.view.trusted else ", not trusted"
    table = Table(title=f"{seen.name}{trust}", title_justify="left")
    for heading in kind.cells:
        table.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(*(_cell([row[key] for key in keys.split()]) for keys in kind.cells.values()))
    return table


def _cell(values: list[object]) -> str:
    """Return values as they are shown together."""
    if isinstance(values[0], bool):
        return "yes" if values[0] else ""
    if values[0] is None:
        return ""
    return ", ".join(f"{v:.3f}" if isinstance(v, float) else str(v) for v in values)


def _summary(kind: _Kind, rows: list[dict[str, Any]]) -> str:
    """Return one line about a picture."""
    if kind is _OBSTACLES:
        return counted(len(rows), "obstacle")
    hits = [row["range_m"] for row in rows if row["range_m"] is not None]
    nearest = f", nearest {min(hits):.2f} m" if hits else ""
    return f"{len(hits)} of {len(rows)} beams end at a boundary{nearest}"
