"""`robotctl slam --sensor NAME`: scans to a map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from robotctl.cli.console import say_compiling
from robotctl.cli.files import give_plot
from robotctl.cli.progress import progress_bar
from robotctl.cli.slam.output import end_by_verdict, error_words, write_slam
from robotctl.words import counted
from robotctl.workbench.slam.options import SlamOptions

if TYPE_CHECKING:
    from robotctl.workbench.slam.scans import ScanResult


def slam_by_scans(
    options: SlamOptions, sensor: str, out: Path, plot: Path | None, console: Console
) -> None:
    """Make trajectory, map and graph of a recorded drive and write them into a folder."""
    with progress_bar(console, options.log.name, "SLAM") as tell:
        # It takes a second or more, in which nothing would be seen.
        from robotctl.workbench.slam.scan_files import write_scan_results  # noqa: PLC0415
        from robotctl.workbench.slam.scans import scan_slam  # noqa: PLC0415

        say_compiling(console)
        result = scan_slam(
            options.log,
            options.time_unit,
            tell,
            options.onto,
            sensor,
            options.images,
            options.sweep_s,
        )
    write_slam(
        out,
        console,
        result.recording.notes,
        lambda folder: write_scan_results(result, folder),
    )
    give_plot(plot, lambda file: save_scan_plot(result, file))
    print(_sentence(result.report()))
    end_by_verdict(result.verdict, console)


def _sentence(report: dict[str, Any]) -> str:
    """Return the outcome for people."""
    loops, compared = report["loops"], report["trajectory"]
    refused = sum(loops["refused"].values())
    parts = [
        counted(report["scans"], "scan") + ("" if report["odometry"] else " without odometry"),
        counted(report["keyframes"], "keyframe"),
        f"{counted(loops['closed'], 'loop')} closed, {refused} refused",
        f"{counted(report['links_of_loops'], 'link')} of loops",
    ]
    if "images" in report:
        pictures = report["images"]
        parts.append(f"{pictures['recognised']} of {pictures['looked_at']} images recognised")
    if report["unmatched"]:
        parts.append(f"matched nowhere: {counted(report['unmatched'], 'scan')}")
    if report["slips"]:
        parts.append(f"the wheels slipped {counted(report['slips'], 'time')}")
    parts.append(error_words(compared))
    times = report["time_ms"]
    parts.append(f"{times['mean']:.1f} ms a scan, {1e-3 * (times['scans'] + times['grid']):.1f} s")
    return ", ".join(parts)


def save_scan_plot(result: ScanResult, file: Path) -> None:
    """Draw the map with trajectory and closed loops; a reference is turned onto them."""
    import numpy as np  # noqa: PLC0415

    from robotctl.cli.picture import draw_map, drawing, see_from_above  # noqa: PLC0415
    from robotctl.estimation.grid.occupancy_grid import STRAYS  # noqa: PLC0415
    from robotctl.model.geometry.points import align, moved  # noqa: PLC0415

    with drawing(file, 11.0, 11.0, dpi=150) as figure:
        axes = figure.subplots()
        draw_map(axes, result.grid.map_rows(strays=STRAYS).whole())
        path = result.estimate
        pairs = [
            (own, (true.x_m, true.y_m))
            for own, stamp_ns in zip(path.poses, path.stamps_ns.tolist(), strict=True)
            if result.recording.reference is not None
            and (true := result.recording.reference.at(stamp_ns)) is not None
        ]
        if len(pairs) > 1:
            places = np.array([each for _, each in pairs])
            motion = align(places, np.array([own[:2] for own, _ in pairs]))
            axes.plot(*moved(motion, places).T, color="tab:green", linewidth=1.0, label="reference")
        axes.plot(*path.poses[:, :2].T, color="tab:red", linewidth=0.7, label="trajectory")
        poses = result.mapper.back_end.poses
        for number, loop in enumerate(each for each in result.mapper.loops.log if not each.reason):
            axes.plot(
                *poses[[loop.keyframe, loop.other], :2].T,
                "o-",
                color="tab:blue",
                markersize=3,
                linewidth=1.0,
                label="closed loop" if number == 0 else None,
            )
        see_from_above(axes, "datalim")
        axes.legend(loc="best")
        figure.suptitle(result.recording.name)
