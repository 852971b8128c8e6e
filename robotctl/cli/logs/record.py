"""`robotctl record`: the flight recorder on request, logs completed, recordings as tables."""

from __future__ import annotations

import datetime as dt
import difflib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from robotctl.cli.console import plain_console
from robotctl.cli.files import check_files
from robotctl.cli.progress import progress_bar
from robotctl.errors import ConfigError, LinkError
from robotctl.runtime.flight.recorder import RecordError, read_record
from robotctl.runtime.flight.ring import dump as dump_ring
from robotctl.runtime.ipc.topics import ring_folder, ring_name
from robotctl.runtime.storage.ring_file import is_written
from robotctl.words import counted

app = typer.Typer(help="The flight recorder and the logs.", no_args_is_help=True)


@app.command()
def dump(
    file: Annotated[
        Path | None, typer.Argument(help="Output file; default: flight-TIME.rec in this folder.")
    ] = None,
    instance: Annotated[
        str,
        typer.Option(
            help="Robot, by its name or that of its ring; default: the only one running, or the "
            "only one."
        ),
    ] = "",
) -> None:
    """Write the last minute of the control loop to a record, for `robotctl replay`.

    Works while the robot drives, which it does not notice, and after its processes were killed.
    """
    check_files(file)
    if file is not None:
        file = file.resolve()
        _check_target(file)
    ring = find_ring(instance)
    now = dt.datetime.now(dt.UTC)
    target = file or Path(f"flight-{now:%Y%m%dT%H%M%S}.{now.microsecond // 1000:03d}Z.rec")
    try:
        dump_ring(ring, target)
    except OSError as error:
        raise RecordError(f"{target}: cannot be written: {error.strerror}") from error
    print(f"{ring} written to {target}, {target.stat().st_size} bytes")


@app.command()
def recover(
    file: Annotated[
        Path, typer.Argument(help="robot-*.mcap, or another MCAP file, that was cut short.")
    ],
) -> None:
    """Complete an MCAP log that was not closed, in place; the recorder does so when it starts.

    A whole log stays as it is. If anything is left out, the log as it was is kept, as
    FILE.damaged-1 and so on.
    """
    from robotctl.logs.mcap.recovery import recover as recover_log  # noqa: PLC0415 - loads zstd

    try:
        recovered = recover_log(file)
    except OSError as error:
        raise RecordError(f"{file}: cannot be recovered: {error.strerror}") from error
    if recovered.was_intact:
        print(f"{file}: is complete, {counted(recovered.messages, 'message')}; left as it is")
    else:
        print(f"{file}: complete, {counted(recovered.messages, 'message')}{recovered.loss()}")


@app.command()
def export(
    run: Annotated[
        Path,
        typer.Argument(
            help="Folder of --record, a robot-*.mcap of it, or a record: fault-*.rec, a dump."
        ),
    ],
    csv: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Folder for tables, one file per topic.")
    ] = None,
    tum: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Folder for paths: odometry, believed, truth."),
    ] = None,
    tlog: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="New telemetry log: what ground stations would get."),
    ] = None,
    mcap: Annotated[
        Path | None, typer.Option(metavar="FILE", help="New MCAP log: all files of it in one.")
    ] = None,
) -> None:
    """Write a recording as tables, paths, a telemetry log or one MCAP log.

    CSV, the units in the headings, is for spreadsheets and pandas; TUM for evo and other tools for
    trajectories; a .tlog for QGroundControl, Mission Planner and pymavlink; MCAP for Foxglove.
    """
    if csv is None and tum is None and tlog is None and mcap is None:
        raise ConfigError(
            "nothing to write: give --csv FOLDER, --tum FOLDER, --tlog FILE, --mcap FILE or several"
        )
    check_files(tlog, mcap)
    for option, file in (("--tlog", tlog), ("--mcap", mcap)):
        if file is not None and file.exists():
            raise ConfigError(f"{option} {file}: is there, and would be lost; a new name is needed")
    for option, folder in (("--csv", csv), ("--tum", tum)):
        if folder is not None and folder.exists() and not folder.is_dir():
            raise ConfigError(f"{option} {folder}: is a file, a folder is needed")
    if csv is not None:
        _export_tables(run, csv)
    if tum is not None:
        _export_paths(run, tum)
    if tlog is not None:
        from robotctl.workbench.logs.tlog import export_tlog  # noqa: PLC0415 - loads pymavlink

        _export_file(run, tlog, export_tlog, "frame")
    if mcap is not None:
        from robotctl.workbench.logs.mcap import export_mcap  # noqa: PLC0415 - loads zstd

        _export_file(run, mcap, export_mcap, "message")


def _export_tables(run: Path, folder: Path) -> None:
    """Write a table for each topic, and say so."""
    console = plain_console(stderr=True)
    with progress_bar(console, run.name, "writing") as tell:
        from robotctl.workbench.logs.export import export_csv  # noqa: PLC0415 - loads zstd

        exported = export_csv(run, folder, tell)
    for note in exported.notes:
        console.print(f"note: {note}", soft_wrap=True)
    for each in exported.files:
        print(f"{each.path}: {counted(each.rows, 'row')}, {counted(each.columns, 'column')}")


def _export_paths(run: Path, folder: Path) -> None:
    """Write the paths, and say so."""
    from robotctl.workbench.logs.trajectories import export_tum  # noqa: PLC0415 - loads zstd

    files, notes = export_tum(run, folder)
    console = plain_console(stderr=True)
    for note in notes:
        console.print(f"note: {note}", soft_wrap=True)
    for each in files:
        print(f"{each.path}: {counted(each.poses, 'pose')}")


def _export_file(
    run: Path, file: Path, write: Callable[[Path, Path], tuple[int, list[str]]], what: str
) -> None:
    """Write one file, and say so."""
    console = plain_console(stderr=True)
    with console.status(f"writing {file.name}"):
        count, notes = write(run, file)
    for note in notes:
        console.print(f"note: {note}", soft_wrap=True)
    print(f"{file}: {counted(count, what)}")


def _check_target(file: Path) -> None:
    """Refuse to replace anything but a record.

    Raises
    ------
    RecordError
        If something else is there.
    """
    if not file.exists():
        return
    if not file.is_file():
        raise RecordError(f"{file}: is not a regular file: write to one, and copy it from there")
    try:
        with file.open("rb") as present:
            read_record(present, str(file))
    except RecordError as error:
        raise RecordError(f"{file}: is there, and would be lost: {error}") from error
    except OSError as error:
        raise RecordError(f"{file}: cannot be read: {error.strerror}") from error


def find_ring(instance: str) -> Path:
    """Return the ring that a name leads to, or without a name the only one of a robot that runs.

    Where none runs it is the only one that crashed.

    A name is that of a robot, or as `ring_names` has it. Makes nothing.

    Raises
    ------
    RecordError
        If there is none, or more than one to choose from.
    """
    folder = ring_folder()
    rings = sorted((*folder.glob("*.ring"), *folder.glob("*.ring.crashed")))
    if not rings:
        raise RecordError(f"{folder}: no flight recorder found: no robot is running or has crashed")
    if not instance:
        for choice in ([ring for ring in rings if is_written(ring)], rings):
            if len(choice) == 1:
                return choice[0]
    names = ring_names(rings)
    if instance in names:
        return names[instance]
    robots = {_robot(path) for path in rings}
    if not instance or instance in robots:
        raise RecordError(f"{folder}: which robot? {_choice(rings, names)}")
    near = difflib.get_close_matches(instance, sorted(robots | names.keys()), n=1, cutoff=0.5)
    hint = f'; did you mean "{near[0]}"?' if near else "."
    raise RecordError(f"{instance}: no flight recorder has that name{hint} {_choice(rings, names)}")


def ring_names(rings: Sequence[Path]) -> dict[str, Path]:
    """Return the ring that each name leads to.

    Parameters
    ----------
    rings
        Sorted, the ring of a live process before one that the same robot left in a crash.

    Returns
    -------
    dict
        By the file's name; by its stem, such as `robot-0e531925`; and by that of the robot, where
        there is one ring of such a robot or one belongs to our own folder of sockets.
    """
    stems = {_stem(path): path for path in reversed(rings)}
    names: dict[str, Path] = {}
    for robot in {_robot(path) for path in rings}:
        of_robot = {stem: path for stem, path in stems.items() if _robot(path) == robot}
        with suppress(LinkError):  # whose sockets would not fit here, hence are elsewhere
            own = Path(ring_name(robot)).stem
            of_robot = {own: of_robot[own]} if own in of_robot else of_robot
        if len(of_robot) == 1:
            names[robot] = next(iter(of_robot.values()))
    return names | stems | {path.name: path for path in rings}


def _choice(rings: Sequence[Path], names: Mapping[str, Path]) -> str:
    """Return what there is to choose from: of each ring the shortest name that leads to it."""
    words = []
    for path in rings:
        with suppress(FileNotFoundError):  # it ended meanwhile
            begun = dt.datetime.fromtimestamp(path.stat().st_mtime, dt.UTC)
            lives = "runs" if is_written(path) else "ended"
            name = min((each for each in names if names[each] == path), key=len)
            words.append(f"{name} ({lives}, begun {begun:%Y-%m-%d %H:%M:%S} UTC)")
    return f"--instance is one of: {', '.join(words)}"


def _stem(path: Path) -> str:
    """Return the name of a ring without its crash mark."""
    return path.name.removesuffix(".crashed").removesuffix(".ring")


def _robot(path: Path) -> str:
    """Return the name of the robot whose ring it is."""
    return _stem(path).rpartition("-")[0]
