"""Runs of `robotctl sim` side by side, each with its report."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any, TypeVar

RAN = (0, 3)
"""Statuses of `robotctl sim`: arrived, and not."""

Case = TypeVar("Case")
Result = TypeVar("Result")


def simulated(words: Sequence[str], report: Path) -> dict[str, Any]:
    """Run `robotctl sim` with these words and return its report, which stays in a file.

    Raises
    ------
    RuntimeError
        If it could not run.
    """
    report.unlink(missing_ok=True)
    command = [sys.executable, "-m", "robotctl", "sim", *words, "--report", str(report)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in RAN:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr}")
    found: dict[str, Any] = json.loads(report.read_text(encoding="utf-8"))
    return found


def side_by_side(
    drive: Callable[[Case], Result], cases: Iterable[Case], jobs: int
) -> Iterator[Result]:
    """Drive cases, so many at a time; yield each result as soon as it is there."""
    with ThreadPoolExecutor(jobs) as pool:
        for run in as_completed([pool.submit(drive, case) for case in cases]):
            yield run.result()
