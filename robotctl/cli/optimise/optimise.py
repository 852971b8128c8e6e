"""`robotctl optimise`: the optimum of a pose graph or factor graph."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.console import Console

from robotctl.cli.console import plain_console, say_compiling
from robotctl.cli.files import check_files, write_file
from robotctl.cli.options import takes_options
from robotctl.words import counted
from robotctl.workbench.graphs.options import OptimiseOptions

if TYPE_CHECKING:
    from robotctl.workbench.graphs.optimise import OptimiseResult

_SHOWN: Final = 3


@takes_options
def optimise(
    choice: partial[OptimiseOptions],
    out: Annotated[Path | None, typer.Option(help="Write the optimum here.")] = None,
    report: Annotated[Path | None, typer.Option(help="Write the figures here, JSON.")] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw start, optimum and chi2 here: .png, .svg or .pdf.")
    ] = None,
    animate: Annotated[
        Path | None, typer.Option(help="Draw the graph after each iteration here: .gif.")
    ] = None,
) -> None:
    """Find the poses and points that fit the measurements of a graph best.

    Without --init the start is the chordal relaxation, with --robust, isam or ekf the odometry.
    The status is 1 if the solver did not converge.
    """
    check_files(out, report, plot=plot)
    check_files(plot=animate, option="--animate", suffixes=(".gif",))
    # It loads numba, which other subcommands can do without.
    from robotctl.cli.progress import progress_bar  # noqa: PLC0415
    from robotctl.logs.graphs.graph_files import format_of  # noqa: PLC0415
    from robotctl.workbench.graphs.optimise import optimise as work  # noqa: PLC0415

    written = None if out is None else format_of(out)
    console = plain_console(stderr=True)
    say_compiling(console)
    options = choice(keeps_course=animate is not None)
    with progress_bar(console, options.graph.name, "optimising") as tell:
        result = work(options, lambda _, done, total: tell(done, total))
    _write(result, console, out, report, plot, animate)
    print(summary(result))
    if written is not None and len(result.file.fixed) and not written.has_fixed:
        print(f"note: {out}: {written.name} has no word for fixed variables; g2o has")
    if not result.solution.is_converged:
        raise typer.Exit(1)


def _write(
    result: OptimiseResult, console: Console, out: Path | None, report: Path | None,
    plot: Path | None, animate: Path | None,
) -> None:  # fmt: skip
    """Write the files that were asked for."""
    from robotctl.cli.progress import progress_bar  # noqa: PLC0415
    from robotctl.workbench.graphs.optimise import write_graph, write_report  # noqa: PLC0415

    if report is not None:
        write_file(report, lambda file: write_report(result, file))
    if out is not None:
        write_file(out, lambda file: write_graph(result, file))
    if plot is not None:
        from robotctl.cli.optimise.plot import save_plot  # noqa: PLC0415 - an extra

        write_file(plot, lambda file: save_plot(result, file))
    if animate is not None:
        from robotctl.cli.optimise.plot import save_animation  # noqa: PLC0415 - an extra

        with progress_bar(console, result.options.graph.name, "drawing") as tell:
            write_file(animate, lambda file: save_animation(result, file, tell))


def _kept_in_place(result: OptimiseResult) -> str:
    """Return what keeps its place, and what is held since nothing determines it."""
    graph = result.graph
    if len(result.fixed) == graph.size:
        return "all variables are fixed: there is nothing to find"
    parts = [graph.names(result.fixed.tolist())] if len(result.fixed) else []
    parts += [each.name(graph) for each in result.held()[:_SHOWN]]
    return f"kept in place: {'; '.join(parts) or 'nothing, priors do that'}"


def summary(result: OptimiseResult) -> str:
    """Return what there is to say of an optimum."""
    figures = result.report()
    time_ms = figures["time_ms"]["total"]
    count = figures["connected_components"]
    parts = "all connected" if count == 1 else f"in {count} separate parts"
    lines = [
        ", ".join(
            (counted(figures["vertices"], "variable"), counted(figures["edges"], "factor"), parts)
        ),
        "chi2 {chi2_initial:.6g} -> {chi2_final:.8g} in ".format(**figures)
        + f"{counted(figures['iterations'], 'iteration')}, {time_ms:.1f} ms",
    ]
    if "rounds" in figures:
        lines.append(
            f"{counted(figures['rounds'], 'round')} of messages; the last means are within "
            f"{figures['left_sigma']:.2g} standard deviations of the solution"
        )
    if figures["switched_off"]:
        lines.append(
            f"{counted(figures['switched_off'], 'factor')} switched off; chi2 of the rest "
            f"{figures['chi2_kept']:.8g}"
        )
    lines += [f"note: {each}" for each in figures["notes"]]
    lines.append(_kept_in_place(result))
    if not figures["converged"]:
        lines.append(f"not converged: {figures['advice']}")
    elif figures["advice"]:
        lines.append(figures["advice"])
    for name, covariance in result.covariances.items():
        sigma = ", ".join(f"{each:.3g}" for each in covariance.diagonal() ** 0.5)
        lines.append(f"{name}: standard deviations {sigma} in its own frame, m and rad")
    return "\n".join(lines)
