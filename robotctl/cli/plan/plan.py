"""`robotctl plan`: the path between two places of a map, or why there is none."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.cli.arguments import refuse_unused
from robotctl.cli.console import plain_console, say_compiling
from robotctl.cli.files import check_files, write_file
from robotctl.cli.options import takes_options
from robotctl.cli.topology.topology import way_lines
from robotctl.errors import ConfigError
from robotctl.words import counted
from robotctl.workbench.planning.options import PlanOptions

if TYPE_CHECKING:
    from robotctl.workbench.planning.plan import PlanResult


@takes_options
def plan(
    ctx: typer.Context,
    options: PlanOptions,
    places: Annotated[
        list[str] | None,
        typer.Argument(metavar="FROM TO", help="With --topological: from where to where."),
    ] = None,
    topological: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Map of places, of `robotctl topology build`."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Write the path here, CSV.")] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw map and path here: .png, .svg or .pdf.")
    ] = None,
    report: Annotated[Path | None, typer.Option(help="Write the figures here, JSON.")] = None,
) -> None:
    """Find the path between two places of a map, or say why there is none.

    The status is 0 if there is a path, and 1 if there is none. On a MovingAI map the robot is
    a point, and lengths are in cells. With --topological the way leads through places by name.
    """
    if topological is not None:
        _plan_by_places(ctx, topological, places or [])
        return
    _check_given(places or [], options)
    check_files(out, report, plot=plot)
    # It loads numba, which other subcommands can do without.
    from robotctl.workbench.planning.plan import (  # noqa: PLC0415
        make_plan,
        write_path,
        write_report,
    )

    say_compiling(plain_console(stderr=True))
    result = make_plan(options)
    found = result.report()["found"]
    if report is not None:
        write_file(report, lambda file: write_report(result, file))
    if out is not None and found:
        write_file(out, lambda file: write_path(result, file))
    if plot is not None:
        from robotctl.cli.plan.plot import save_plot  # noqa: PLC0415 - an extra

        write_file(plot, lambda file: save_plot(result, file))
    print(summary(result))
    if not found:
        raise typer.Exit(1)


def _plan_by_places(ctx: typer.Context, file: Path, places: list[str]) -> None:
    """Print the way between two places; status 1 if there is none."""
    from robotctl.workbench.topology.topology import find_way  # noqa: PLC0415 - it loads scipy

    unused = ("map", "start", "goal", "planner", "steering", "robot", "overrides")
    refuse_unused(
        ctx, "with --topological", *unused, "time_limit_s", "seed", "out", "plot", "report"
    )
    if len(places) != 2:
        found = ", ".join(places) or "none"
        raise ConfigError(f"--topological {file}: two places are needed, found {found}")
    way = find_way(file, *places)
    if way is None:
        print(f"no way from {places[0]} to {places[1]}")
        raise typer.Exit(1)
    print("\n".join(way_lines(places[0], way)))


def _check_given(places: list[str], options: PlanOptions) -> None:
    """Refuse a plan by coordinates without them, or with names of places."""
    if places:
        raise ConfigError(f"{places[0]}: places are for --topological FILE")
    needed = ("map", "start", "goal")
    if missing := [f"--{each}" for each in needed if not getattr(options, each)]:
        raise ConfigError(
            f"{', '.join(missing)}: needed for a plan by coordinates; or --topological FILE"
        )


def summary(result: PlanResult) -> str:
    """Return what there is to say of a plan."""
    figures = result.report()
    effort = f"{figures['expanded']} expanded, {figures['time_ms']:.1f} ms"
    if not figures["found"]:
        return f"no path: {figures['reason']} ({effort})"
    unit = "cells" if result.is_cells else "m"
    return (
        f"{result.planner}: {figures['length_m']:.3f} {unit}, "
        f"cost {figures['cost']:.3f} {unit}, smallest clearance "
        f"{figures['min_clearance_m']:.2f} {unit}, "
        f"{counted(len(result.path), 'pose')}, {effort}"
    )
