"""The score of a run on one screen."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.table import Table

from robotctl.app.scoring.score import CameraReport, Report, SlamReport
from robotctl.app.simulation.held_up import SAY_MS
from robotctl.words import counted

_FAULTS_SHOWN = 8


def score_table(report: Report) -> Table:
    """Return the report as a table for a terminal."""
    verdict = "completed" if report.mission_completed else "not completed"
    table = Table(
        title=f"{report.robot} · {report.mission} in {report.world} · seed {report.seed}",
        show_header=False,
        title_justify="left",
    )
    pose = report.pose_error
    done = f"{verdict}, {report.items_done} of {counted(report.items, 'item')}"
    why = [each for each in (report.ended, report.message) if each]
    unsafe = report.unsafe_motions
    people = f", people ran into it {counted(report.ran_into, 'time')}" if report.ran_into else ""
    rows: tuple[tuple[str, str], ...] = (
        ("mission", ": ".join((done, "; ".join(dict.fromkeys(why)))) if why else done),
        ("duration", f"{report.duration_s:.1f} s, {report.real_time_factor:.2f} × real time"),
        (
            "distance",
            f"{report.distance_m:.2f} m, {counted(report.collisions, 'collision')}{people}",
        ),
        (
            "safety",
            f"{counted(unsafe, 'unsafe motion')}, the last: {report.unsafe_reason}"
            if unsafe
            else "no unsafe motion",
        ),
        (
            "pose error",
            (
                f"rmse {pose.rmse_m:.3f} m, max {pose.max_m:.3f} m, final {pose.final_m:.3f} m "
                f"and {math.degrees(pose.final_rad):.1f}°"
            ),
        ),
    )
    rows += _loop_rows(report)
    if report.log_trouble:
        rows += (("logs", report.log_trouble),)
    rows = (*rows[:3], *_journey_rows(report), *rows[3:])
    for name, text in (*rows, *_computer_rows(report), *_place_rows(report), *_fault_rows(report)):
        table.add_row(name, text)
    return table


def _loop_rows(report: Report) -> tuple[tuple[str, str], ...]:
    """Return how regular the loop was, and how full the bus."""
    loop, bus = report.loop, report.bus
    lag, step = loop["lag_us"], loop["step_us"]
    return (
        (
            "loop",
            (
                f"{loop['rate_hz']:.0f} Hz, {counted(loop['ticks'], 'tick')}, "
                f"{counted(loop['overruns'], 'overrun')}"
            ),
        ),
        (
            "lag",
            (
                f"p50 {lag['p50']:.0f} µs, p99 {lag['p99']:.0f} µs, p99.9 {lag['p999']:.0f} µs, "
                f"max {lag['max']:.0f} µs"
            ),
        ),
        ("step", f"p50 {step['p50']:.0f} µs, p99 {step['p99']:.0f} µs"),
        (
            f"bus {report.bus_kind}",
            (
                f"{counted(bus['frames'], 'frame')}, load {100 * bus['load']:.1f} %, "
                f"{counted(bus['errors'], 'error')}"
            ),
        ),
    )


def _journey_rows(report: Report) -> list[tuple[str, str]]:
    """Return how the robot got on, where it drove by plan."""
    if not report.plans:
        return []
    best = ""
    if report.time_by_best is not None:
        best = f"{report.time_by_best:.2f} × the best time of {report.best_s:.1f} s; "
    text = f"{best}{counted(report.plans, 'plan')}, " + counted(
        report.recoveries, "recovery", "recoveries"
    )
    if report.min_clearance_m is not None:
        text += f"; {report.min_clearance_m:.3f} m clear, "
        text += counted(report.near_misses, "near miss", "near misses")
    return [("journey", text)]


def _computer_rows(report: Report) -> list[tuple[str, str]]:
    """Return what was silent at the end, and how long this computer was held up."""
    rows = [("silent", "; ".join(report.silent))] if report.silent else []
    if report.held_up_ms >= SAY_MS:
        text = f"held up for {report.held_up_ms:.0f} ms at most; not so in lockstep"
        rows.append(("computer", text))
    return rows


def _place_rows(report: Report) -> list[tuple[str, str]]:
    """Return what localiser and mapper did, where there were any."""
    rows = []
    place, quality = report.localisation, report.map_quality
    if place is not None:
        error = place.error
        found = (
            "never"
            if place.localised_after_s is None
            else f"after {place.localised_after_s:.1f} s, {100 * place.localised_share:.0f} % since"
        )
        wrong = f", wrong for {place.wrong_s:.1f} s" if place.wrong_s else ""
        rows += [
            ("localised", f"{place.method}: {found}{wrong}; {place.step_ms:.1f} ms a step"),
            (
                "then",
                (
                    f"rmse {error.rmse_m:.3f} m, max {error.max_m:.3f} m, "
                    f"{math.degrees(error.heading_rmse_rad):.2f}° "
                    f"(odometry alone {place.odometry_rmse_m:.3f} m)"
                ),
            ),
            (
                "consistency",
                (
                    f"NEES {_share(place.nees_inside_95)}{_too_sure(place.nees_above_95)}, "
                    f"NIS {_share(place.nis_inside_95)}"
                ),
            ),
        ]
    if report.slam is not None:
        rows += _slam_rows(report.slam)
    if quality is not None:
        rows += [
            ("map", f"precision {quality.precision:.3f}, recall {quality.recall:.3f}"),
            (
                "laid over",
                (f"precision {quality.aligned_precision:.3f}, recall {quality.aligned_recall:.3f}"),
            ),
        ]
    return rows + _camera_rows(report.camera)


def _slam_rows(slam: SlamReport) -> list[tuple[str, str]]:
    """Return how good a trajectory by SLAM is, and its loops."""
    by_metre = f"{1000.0 * slam.rpe_m:.0f} mm and {math.degrees(slam.rpe_rad):.2f}° a metre"
    false = f"{slam.false_loops} of them false" if slam.false_loops else "none false"
    return [
        ("trajectory", f"ape {slam.ape_m:.3f} m, rpe {by_metre}"),
        ("loops", f"{counted(slam.loops, 'link')} to places seen before, {false}"),
        *([("verdict", slam.verdict)] if slam.verdict else []),
    ]


def _too_sure(above: float | None) -> str:
    """Return how much of the NEES is above its bounds, as text."""
    return "" if above is None else f" ({100 * above:.0f} % too sure)"


def _camera_rows(camera: CameraReport | None) -> list[tuple[str, str]]:
    """Return what the camera saw, where there was one."""
    if camera is None:
        return []
    blind = f", {camera.untrusted} of them not judged" if camera.untrusted else ""
    rows = [
        ("camera", f"{counted(camera.pictures, 'picture')}{blind}, {camera.step_ms:.1f} ms each")
    ]
    if camera.range_error is not None and camera.within_3_sigma is not None:
        ranges = f"median error {100 * camera.range_error:.2f} %"
        rows.append(("ranges", f"{ranges}, {100 * camera.within_3_sigma:.1f} % within 3 σ"))
    where = "" if camera.obstacle_rmse_m is None else f", {camera.obstacle_rmse_m:.3f} m rms"
    found = f"{camera.found} of {camera.obstacles} sights found{where}, {camera.false} false"
    return [*rows, ("obstacles", found)]


def _share(inside: float | None) -> str:
    """Return how much of something lies inside its 95 % bounds."""
    return "-" if inside is None else f"{100 * inside:.0f} % inside 95 %"


def _fault_rows(report: Report) -> list[tuple[str, str]]:
    """Return a row for the faults that befell the robot, and one for those that could not."""
    failed = report.failed_faults
    begun = [each for each in report.faults if each not in failed]
    rows = (("faults", begun), ("not applied", failed))
    return [(name, _first_lines(lines)) for name, lines in rows if lines]


def _first_lines(lines: Sequence[str]) -> str:
    """Return the first lines and how many more there are."""
    more = len(lines) - _FAULTS_SHOWN
    return "\n".join([*lines[:_FAULTS_SHOWN], *([f"and {more} more"] if more > 0 else [])])
