"""A map from a recorded log: the work of `robotctl map`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from robotctl.errors import ConfigError
from robotctl.estimation.grid.config import OccupancyGridConfig
from robotctl.estimation.grid.map_rows import MapRows
from robotctl.estimation.grid.occupancy_grid import STRAYS, GridFigures, OccupancyGrid
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.maps.map_file import save_map
from robotctl.model.grid_map import GridMap
from robotctl.model.recording import RecordedScan, Recording
from robotctl.toml_source import nearest
from robotctl.workbench.localise.map_options import MapOptions

_TAKEN: Final = {"all": slice(None), "even": slice(0, None, 2), "odd": slice(1, None, 2)}
_AT_ONCE: Final = 256


@dataclass(frozen=True, slots=True)
class MapResult:
    """A map that was made and written.

    Parameters
    ----------
    options
        As asked for.
    rows
        The map, row by row.
    figures
        How much of it is known.
    used, of
        Number of scans used, and in the log.
    from_reference
        Whether the poses are the log's reference; else they are its odometry.
    files
        The files.
    notes
        The reader's notes.
    """

    options: MapOptions
    rows: MapRows
    figures: GridFigures
    used: int
    of: int
    from_reference: bool
    files: tuple[Path, Path]
    notes: tuple[str, ...]

    @property
    def grid(self) -> GridMap:
        """The map as a whole."""
        return self.rows.whole()


def choose_scans(recording: Recording, which: str) -> Sequence[RecordedScan]:
    """Return all scans of a recording, or those of even or odd place.

    Raises
    ------
    ConfigError
        If `which` is none of these, or there is no such scan.
    """
    if which not in _TAKEN:
        raise ConfigError(f"--scans {which}: unknown{nearest(which, tuple(_TAKEN))}")
    scans = recording.scans[_TAKEN[which]]
    if not scans:
        raise ConfigError(
            f"{recording.name}: {len(recording.scans)} lidar scans in it, none of them in --scans "
            f"{which}{recording.why()}"
        )
    return scans


def make_map(options: MapOptions, progress: Callable[[int, int], None] | None = None) -> MapResult:
    """Read a log, map its scans at its poses and write the map.

    Parameters
    ----------
    options
        The options.
    progress
        Called with the number of scans done, and of all.

    Raises
    ------
    ConfigError
        If an option is wrong, or the log has no scans.
    LogFormatError
        If the log cannot be read.
    OSError
        If a file cannot be read or written.
    """
    grid = _empty_grid(options)
    used, of, from_reference, notes = _fill(grid, options, progress)
    rows = grid.map_rows(strays=STRAYS)
    return MapResult(
        options,
        rows,
        grid.figures(),
        used,
        of,
        from_reference,
        save_map(_bare(options.prefix), rows),
        notes,
    )


def _fill(
    grid: OccupancyGrid, options: MapOptions, progress: Callable[[int, int], None] | None
) -> tuple[int, int, bool, tuple[str, ...]]:
    """Map the scans of a log, which is forgotten after.

    Returns
    -------
    used, of
        Numbers of scans.
    from_reference
        Whether their poses are the log's reference.
    notes
        Of the log.
    """
    recording = read_recording(
        options.log,
        with_sonars=False,
        time_unit=options.time_unit,
        max_range_m=options.max_range_m,
        sweep_s=options.sweep_s,
    )
    scans, notes = choose_scans(recording, options.scans), list(recording.notes)
    known = [scan for scan in scans if scan.reference is not None]
    from_reference = 2 * len(known) >= len(scans)
    if from_reference and len(known) < len(scans):
        notes.append(
            f"{len(scans) - len(known)} of {len(scans)} scans left out: the reference says nothing "
            "at their times"
        )
        scans = known
    taken = [
        scan.reference if from_reference and scan.reference else scan.odometry for scan in scans
    ]
    poses = np.array([(pose.x_m, pose.y_m, pose.theta_rad) for pose in taken])
    for begin in range(0, len(scans), _AT_ONCE):
        end = min(begin + _AT_ONCE, len(scans))
        try:
            grid.update_scans(poses[begin:end], [scan.scan for scan in scans[begin:end]])
        except ValueError as error:
            raise ConfigError(f"{options.log}: scans {begin} to {end - 1}: {error}") from error
        if progress is not None:
            progress(end, len(scans))
    return len(scans), len(recording.scans), from_reference, tuple(notes)


def _bare(prefix: Path) -> Path:
    """Return a prefix without the suffix of one of its files."""
    return prefix.with_suffix("") if prefix.suffix in {".yaml", ".pgm"} else prefix


def _empty_grid(options: MapOptions) -> OccupancyGrid:
    """Return the grid to fill; check what can be checked before the log is read."""
    if options.prefix.is_dir():
        raise ConfigError(
            f"--out {options.prefix}: is a folder; give a PREFIX, such as {options.prefix / 'map'}"
        )
    if not options.prefix.parent.is_dir():
        raise ConfigError(
            f"--out {options.prefix}: the folder {options.prefix.parent} does not exist"
        )
    try:
        return OccupancyGrid(OccupancyGridConfig(resolution_m=options.resolution_m))
    except ValueError as error:
        raise ConfigError(f"--resolution {options.resolution_m:g}: {error}") from error
