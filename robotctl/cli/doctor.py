"""`robotctl doctor`: a line for each check, and for each failure what to do."""

from __future__ import annotations

import sys
from json import dumps
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.console import Console
from rich.text import Text

from robotctl.cli.console import plain_console
from robotctl.cli.options import takes_options
from robotctl.config.arguments import DEFAULT_ROBOT, Overrides, RobotFile
from robotctl.deploy.check_result import Finding, Verdict
from robotctl.deploy.doctor import LAG_SECONDS, LOGS, examine
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
    robot: RobotFile = DEFAULT_ROBOT,
    json: Annotated[bool, typer.Option("--json", help="Print the results as JSON.")] = False,
    logs: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Folder whose disk is tested.")
    ] = LOGS,
    seconds: Annotated[
        float, typer.Option(min=0.1, max=3600.0, help="How long to measure wake-ups.")
    ] = LAG_SECONDS,
    overrides: Overrides = (),
) -> None:
    """Check whether this computer and the robot on it are fit to drive; moves nothing.

    Status 0: fit, perhaps with warnings. 1: something must be mended.
    """
    findings = []
    console = plain_console()
    for finding in examine(robot, overrides, logs, lag_seconds=seconds):
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


def _print(console: Console, finding: Finding) -> None:
    """Print one finding, and its fix below."""
    line = Text(f"{finding.verdict.value:4}", style=_STYLE[finding.verdict])
    line.append(f"  {finding.check}: {finding.found}", style="default")
    console.print(line, soft_wrap=True)
    if finding.fix:
        console.print(Text(f"      fix: {finding.fix}"), soft_wrap=True)
