"""What the figures were measured on, and how tables are printed."""

from __future__ import annotations

import datetime as dt
import os
import platform
import shutil
import statistics
import subprocess
import sys
import sysconfig
from collections.abc import Iterable, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def describe() -> str:
    """Return date, commit, processor, kernel and load of the machine, one line each."""
    lines = [
        f"date     {dt.datetime.now(dt.UTC):%Y-%m-%d %H:%M} UTC",
        f"commit   {_commit()}",
        f"machine  {_processor()}, {os.cpu_count()} cores, {platform.release()}",
        f"python   {platform.python_version()} ({_optimised()})",
        f"load     {load()}",
    ]
    return "\n".join(lines)


def load() -> str:
    """Return the load average."""
    one, five, fifteen = os.getloadavg()
    return f"{one:.2f} {five:.2f} {fifteen:.2f} (1, 5, 15 min)"


def stolen_s() -> float:
    """Return the processor time that the hypervisor gave to others since the start [s]."""
    try:
        fields = Path("/proc/stat").read_text(encoding="ascii").split("\n", 1)[0].split()
        return int(fields[8]) / os.sysconf("SC_CLK_TCK")
    except (OSError, IndexError, ValueError):
        return float("nan")


def _optimised() -> str:
    """Return how the interpreter was built: it makes up to a third of all figures."""
    arguments = str(sysconfig.get_config_var("CONFIG_ARGS") or "")
    return "profile-guided" if "--enable-optimizations" in arguments else "not profile-guided"


def _commit() -> str:
    git = shutil.which("git")
    if git is None:
        return "unknown"
    answer = subprocess.run(
        [git, "log", "-1", "--format=%h"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    return answer.stdout.strip() or "unknown"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def median(values: Iterable[float]) -> float:
    """Return the median; nan of nothing."""
    present = list(values)
    return statistics.median(present) if present else float("nan")


def spread(values: Sequence[float], digits: int = 0) -> str:
    """Return `median (least to greatest)`."""
    if not values:
        return "-"
    low, high = min(values), max(values)
    return f"{median(values):.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def table(title: str, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a Markdown table."""
    cells = [list(heads), *(list(row) for row in rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(heads))]
    out = [f"\n### {title}\n"]
    for number, row in enumerate(cells):
        padded = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        out.append(f"| {' | '.join(padded)} |")
        if number == 0:
            out.append(f"|{'|'.join('-' * (width + 2) for width in widths)}|")
    sys.stdout.write("\n".join(out) + "\n")
    sys.stdout.flush()


def note(text: str) -> None:
    """Print a line of progress or explanation."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()
