"""Lockstep of this tree beside that of another revision, in turn: has the patrol become slower?

Both run as commands with the packages of this environment, since only the command is the same in
both. A run of a second is taken off a whole one, so that the rate has nothing of the start in it.
"""

from __future__ import annotations

import io
import json
import resource
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import NamedTuple

from benchmarks import machine

ROBOTS = ("diff_drive", "tricycle", "ackermann")
_MAIN = "from robotctl.cli.main import main; main()"
_START = ("--max-seconds", "1")


class _Drive(NamedTuple):
    rate: float
    """Simulated time per processor time, without the start."""
    start_s: float
    """Processor time until the first tick [s]."""
    step_us: float
    """Median of the host's step [us]."""


def run(rounds: int, _seconds: float, against: str) -> None:
    """Drive the patrol with each robot in both trees, of which each is the first in turn."""
    revision = against or _last_release()
    if not revision:
        machine.note("paired: no release is tagged here; --against REVISION names another commit")
        return
    with tempfile.TemporaryDirectory() as folder:
        other = Path(folder)
        _unpack(revision, other)
        trees = {"this tree": machine.ROOT, revision: other}
        rows = []
        for robot in ROBOTS:
            drives: dict[str, list[_Drive]] = {name: [] for name in trees}
            for tree in trees.values():  # compiles what is not, and warms the machine up
                _command(tree, robot)
            for number in range(rounds):
                for name in list(trees)[:: -1 if number % 2 else 1]:
                    drives[name].append(_drive(trees[name], robot))
            rows += _rows(robot, drives)
    heads = (
        "robot",
        "tree",
        "x real time of one core (rounds)",
        "ratio (rounds)",
        "start, CPU s",
        "host's step p50 us",
    )
    machine.table(f"Lockstep: this tree and {revision} in turn", heads, rows)


def _rows(robot: str, drives: dict[str, list[_Drive]]) -> list[tuple[str, ...]]:
    ours, others = drives.values()
    ratios = [one.rate / other.rate for one, other in zip(ours, others, strict=True)]
    return [
        (
            robot,
            name,
            machine.spread([each.rate for each in driven], 1),
            machine.spread(ratios, 2) if driven is ours else "1",
            f"{machine.median(each.start_s for each in driven):.2f}",
            f"{machine.median(each.step_us for each in driven):.1f}",
        )
        for name, driven in drives.items()
    ]


def _drive(tree: Path, robot: str) -> _Drive:
    short_s, begun = _command(tree, robot, *_START)
    whole_s, driven = _command(tree, robot)
    rate = (driven["duration_s"] - begun["duration_s"]) / (whole_s - short_s)
    start_s = short_s - begun["duration_s"] / rate
    return _Drive(rate, start_s, driven["loop"]["step_us"]["p50"])


def _command(tree: Path, robot: str, *options: str) -> tuple[float, dict]:
    """Run a patrol of a tree; return its processor time [s] and its report."""
    with tempfile.NamedTemporaryFile(suffix=".json") as report:
        command = (
            *(sys.executable, "-c", _MAIN, "sim", "--lockstep", "--headless", "--robot", robot),
            *("--mission", "patrol", "--seed", "3", "--report", report.name, *options),
        )
        before_s = _children_s()
        done = subprocess.run(command, cwd=tree, capture_output=True, text=True, check=False)
        took_s = _children_s() - before_s
        content = Path(report.name).read_text(encoding="utf-8")
    if not content:
        raise SystemExit(f"paired: {tree}: no report of the patrol\n{done.stderr or done.stdout}")
    return took_s, json.loads(content)


def _children_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def _unpack(revision: str, folder: Path) -> None:
    """Write the files of a revision into a folder."""
    archive = _git("archive", "--format=tar", revision)
    with tarfile.open(fileobj=io.BytesIO(archive)) as files:
        files.extractall(folder, filter="data")


def _last_release() -> str:
    """Return the newest tag before this commit; empty without one."""
    tags = _git("tag", "--merged", "HEAD", "--sort=-creatordate").decode().split()
    return tags[0] if tags else ""


def _git(*arguments: str) -> bytes:
    git = shutil.which("git") or "git"
    done = subprocess.run([git, *arguments], cwd=machine.ROOT, capture_output=True, check=False)
    if done.returncode:
        raise SystemExit(f"paired: git {' '.join(arguments)}: {done.stderr.decode().strip()}")
    return done.stdout
