"""`robotctl slam edit`: a map of keyframes, changed by hand."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from robotctl.cli.console import plain_console, say_compiling
from robotctl.cli.files import check_files, give_plot
from robotctl.cli.progress import progress_bar
from robotctl.cli.slam.output import check_folder, end_by_verdict, write_slam
from robotctl.errors import ConfigError
from robotctl.words import counted

_BETWEEN_NUMBERS_M: Final = 1.5
"""Distance between keyframes whose numbers are drawn [m]."""

if TYPE_CHECKING:
    from robotctl.workbench.slam.edit import EditedResult


def edit(
    onto: Annotated[
        Path,
        typer.Option("--map", metavar="FILE", help="Map of keyframes; it stays as it is."),
    ],
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Write the new map into this folder.")
    ],
    edits: Annotated[
        Path | None,
        typer.Option(
            help="TOML file of [[loop]], [[refuse]], [[move]], [[drop]], [[cut]] and [[join]]; "
            "default: change nothing."
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(help="Plot the map with numbers of keyframes to a .png, .svg or .pdf."),
    ] = None,
) -> None:
    """Close, refuse and move by hand in a map that was made by scans, or join two of them.

    Writes map.yaml, map.pgm, map.keyframes, graph.g2o, keyframes.csv and report.json. By lidar
    status 0: the map is good. 3: it is doubtful. 1: it is no map.
    """
    check_folder(out)
    if (out / "map.keyframes").resolve() == onto.resolve():
        raise ConfigError(f"--out {out}: would overwrite --map {onto}; name another folder")
    check_files(plot=plot)
    console = plain_console(stderr=True)
    with progress_bar(console, onto.name, "linking") as tell:
        # It takes a second or more, in which nothing would be seen.
        from robotctl.workbench.slam.edit import edit_map  # noqa: PLC0415
        from robotctl.workbench.slam.scan_files import write_edited  # noqa: PLC0415

        say_compiling(console)
        result = edit_map(onto, edits, tell)
    write_slam(out, console, (), lambda folder: write_edited(result, folder))
    give_plot(plot, lambda file: _save_plot(result, file))
    print(_sentence(result.report()))
    end_by_verdict(result.verdict, console)


def _sentence(report: dict[str, Any]) -> str:
    """Return the outcome for people."""
    moved, seconds = report["moved_m"], 1e-3 * sum(report["time_ms"].values())
    parts = [
        counted(report["keyframes"], "keyframe"),
        counted(len(report["edits"]), "edit"),
        f"{counted(report['linked_again'], 'link')} found by them",
        f"{counted(report['links_of_loops'], 'link')} of loops",
        f"{report['given']} given by hand, {report['switched_off']} switched off",
        f"keyframes moved by {moved['rms']:.3f} m rms, at most {moved['max']:.3f} m",
        f"{seconds:.1f} s",
    ]
    return ", ".join(parts)


def _save_plot(result: EditedResult, file: Path) -> None:
    """Draw the map with the way, loops and numbers of keyframes."""
    import numpy as np  # noqa: PLC0415

    from robotctl.cli.picture import draw_map, drawing, see_from_above  # noqa: PLC0415
    from robotctl.estimation.grid.occupancy_grid import STRAYS  # noqa: PLC0415

    edited = result.edited
    poses = edited.back_end.poses
    with drawing(file, 13.0, 13.0, dpi=150) as figure:
        axes = figure.subplots()
        draw_map(axes, result.grid.map_rows(strays=STRAYS).whole())
        for drive in np.unique(edited.drives):
            axes.plot(*poses[edited.drives == drive, :2].T, ".-", linewidth=0.6, markersize=2)
        for link in edited.back_end.links:
            ends = poses[[link.first, link.second], :2].T
            if link.is_given:
                axes.plot(*ends, color="tab:red", linewidth=1.0, zorder=3)
            elif link.is_loop:
                axes.plot(*ends, color="tab:blue", linewidth=0.3, alpha=0.2)
        shown = np.full(2, np.inf)
        for number, place in enumerate(poses[:, :2]):
            if np.hypot(*(place - shown)) > _BETWEEN_NUMBERS_M:
                axes.annotate(str(number), place, fontsize=5, color="tab:purple")
                shown = place
        see_from_above(axes, "datalim")
        figure.suptitle(result.sources[0].name)
