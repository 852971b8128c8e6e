"""`robotctl doctor`: a line for each check, and for each failure what to do."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from json import dumps
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

from robotctl.cli.arguments import refuse_unused
from robotctl.cli.compile import compile_missing
from robotctl.cli.console import plain_console
from robotctl.cli.options import takes_options
from robotctl.config.arguments import DEFAULT_ROBOT, Overrides, RobotFile
from robotctl.deploy.check_result import Finding, Verdict
from robotctl.deploy.doctor import BENCH_SECONDS, LAG_SECONDS, LOGS, examine
from robotctl.words import counted

NOT_FIT = 1
_STYLE = {
    Verdict.OK: "green",
    Verdict.WARN: "yellow",
    Verdict.RISK: "bold red",
    Verdict.FAIL: "bold red",
    Verdict.NONE: "dim",
}


@takes_options
def doctor(
    ctx: typer.Context,
    robot: RobotFile = DEFAULT_ROBOT,
    json: Annotated[bool, typer.Option("--json", help="Print the results as JSON.")] = False,
    logs: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Folder whose disk is tested.")
    ] = LOGS,
    bench: Annotated[
        bool,
        typer.Option(
            "--bench",
            help="Instead, drive the robot in simulation, at rest and beside busy programs: "
            "what this computer can carry.",
        ),
    ] = False,
    seconds: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            max=3600.0,
            help=f"How long to measure wake-ups [default: {LAG_SECONDS:g}], or with --bench "
            f"everything [default: {BENCH_SECONDS:g}].",
        ),
    ] = None,
    overrides: Overrides = (),
) -> None:
    """Check whether this computer and the robot on it are fit to drive; moves nothing.

    --bench needs no robot: it measures tick, lag, navigation and processes in real time, and says
    which rates would be possible.

    Status 0: fit, perhaps with warnings. 1: something must be mended.
    """
    findings = []
    console = plain_console()
    if bench:
        refuse_unused(ctx, "with --bench, which tests no disk", "logs")
        checks = _bench(robot, overrides, seconds or BENCH_SECONDS)
    else:
        checks = examine(robot, overrides, logs, lag_seconds=seconds or LAG_SECONDS)
    for finding in checks:
        findings.append(finding)
        if not json:
            _print(console, finding)
    failures = sum(each.verdict is Verdict.FAIL for each in findings)
    warnings = sum(each.verdict is Verdict.WARN for each in findings)
    if json:
        report = {"fit": failures == 0, "findings": findings}
        print(dumps(msgspec.to_builtins(report), indent=2))  # of names that are no UTF-8, too
    else:
        console.print(
            f"{counted(len(findings), 'check')}: {failures} failed, {counted(warnings, 'warning')}"
        )
    sys.exit(NOT_FIT if failures else 0)


def _bench(robot: Path, overrides: tuple[str, ...], seconds: float) -> Iterator[Finding]:
    """Yield the findings of the bench, behind a progress bar."""
    from robotctl.deploy.doctor_bench import bench  # noqa: PLC0415 - NumPy

    compile_missing(simulated=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    console = plain_console(stderr=True)
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("starting", total=0.5 * seconds)

        def tell(phase: str, now_s: float) -> None:
            bar.update(task, description=f"driving {phase}", completed=now_s)

        yield from bench(robot, overrides, seconds, tell)


def _print(console: Console, finding: Finding) -> None:
    """Print one finding, and its fix below."""
    line = Text(f"{finding.verdict.value:4}", style=_STYLE[finding.verdict])
    line.append(f"  {finding.check}: {finding.found}", style="default")
    console.print(line, soft_wrap=True)
    if finding.fix:
        console.print(Text(f"      fix: {finding.fix}"), soft_wrap=True)
