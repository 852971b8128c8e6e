"""Run the fault tests over and over and print how long each reaction took: `make soak`.

Each repeat is one run of the tests of faults and safety stops in `hil_tests/`. One failure in any
repeat fails the whole; its output is shown at once, and the last line says all exit statuses. On
simcan tests run side by side, two for each processor: a robot takes a quarter of one with real-time
priority, one with a flooded bus as much as three others, and where such tasks leave nothing to
ordinary ones for a second, the kernel takes 50 ms for those. A test that failed while the machine
itself stood is run again, and counted (`hil_tests/pauses.py`). Ctrl-C and SIGTERM end it early,
with the table of the repeats until then.

Each repeat has its number as the seed (`--seed` of the tests): of what is drawn by the simulated
robot, and of the moments at which faults strike. Under virtual time it can thus be had again.

A soak may take days: with `--keep FILE` (`runs/soak.jsonl`, which git ignores) each repeat is kept
in a line, with what was printed where a test failed, and a later soak of the same code on the same
bus continues after them.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from pathlib import Path

import msgspec

from reactions import reaction_table
from run_tests import SETTINGS

ROOT = Path(__file__).resolve().parent.parent
CODE = ("configs", "firmware_sim", "hil_tests", "native_kernels", "robotctl")
"""What a soak tests: the folders whose files make one state of the code."""
SUITE = sorted(
    str(path.relative_to(ROOT))
    for pattern in ("test_*_safety_stops.py", "test_*_faults.py")
    for path in (ROOT / "hil_tests").glob(pattern)
)


LONGEST_S = 1800
"""A repeat that takes longer hangs (a test that is run again has no time-out of its own): it is
ended, with exit status 124."""


class Repeat(msgspec.Struct, frozen=True):
    """What became of one run of the suite: a line of the file that is kept.

    Parameters
    ----------
    state
        Of the code, see `state_of_code`.
    bus
        simcan or an interface of the kernel.
    status
        Exit status of pytest.
    again
        What it said of each test that was run again.
    reactions
        Times of each fault [ms].
    output
        What pytest printed where a test failed, otherwise empty.
    """

    state: str
    bus: str
    status: int
    again: tuple[str, ...] = ()
    reactions: dict[str, list[float]] = {}
    output: str = ""


def state_of_code(root: Path) -> str:
    """Return the beginning of a hash of all files in the folders `CODE`."""
    hashed = hashlib.sha256()
    for folder in CODE:
        for path in sorted((root / folder).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                hashed.update(f"{path.relative_to(root)} {path.stat().st_size}\n".encode())
                hashed.update(path.read_bytes())
    return hashed.hexdigest()[:12]


def kept(file: Path, state: str, bus: str) -> list[Repeat]:
    """Return the repeats of a file.

    Raises
    ------
    ValueError
        If a line is no repeat, or one of another state or bus.
    """
    repeats: list[Repeat] = []
    for number, line in enumerate(file.read_bytes().splitlines(), 1):
        try:
            each = msgspec.json.decode(line, type=Repeat)
        except msgspec.DecodeError as error:
            raise ValueError(f"{file}:{number}: no repeat of a soak: {error}") from None
        if (each.state, each.bus) != (state, bus):
            raise ValueError(
                f"{file}:{number}: a repeat of state {each.state} on {each.bus} found, "
                f"{state} on {bus} is to be tested: keep those in another file"
            )
        repeats.append(each)
    return repeats


def repeat(options: argparse.Namespace, state: str, number: int) -> Repeat:
    """Run the suite once, with its number as the seed; return what became of it."""
    with tempfile.TemporaryDirectory(prefix="soak-") as directory:
        reactions = Path(directory) / "reactions.jsonl"
        reactions.touch()
        command = [
            *("timeout", "--foreground", "--signal=INT", "--kill-after=60", str(LONGEST_S)),
            *(sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"),
            *SUITE,
            *("--bus", options.bus, "--seed", str(number), "--reactions", str(reactions)),
            *(("-k", options.only) if options.only else ()),
            *(("-n", str(options.workers), "--dist", "worksteal") if options.workers > 1 else ()),
        ]
        ended = subprocess.run(
            command,
            cwd=ROOT,
            env=os.environ | SETTINGS,
            capture_output=True,
            text=True,
            check=False,
        )
        again = [line for line in ended.stdout.splitlines() if line.startswith("RUN AGAIN")]
        times: dict[str, list[float]] = defaultdict(list)
        for line in reactions.read_text(encoding="utf-8").splitlines():
            reaction = json.loads(line)
            times[reaction["fault"]].append(reaction["ms"])
    output = ended.stdout + ended.stderr if ended.returncode else ""
    return Repeat(state, options.bus, ended.returncode, tuple(again), times, output)


def table(repeats: list[Repeat]) -> str:
    """Return the table of the reaction times of all repeats."""
    return reaction_table(
        json.dumps({"fault": fault, "bus": each.bus, "ms": ms})
        for each in repeats
        for fault, times in each.reactions.items()
        for ms in times
    )


def verdict(repeats: list[Repeat], wanted: int, before: int) -> str:
    """Return the last line: what became of the repeats, and with which exit statuses they ended."""
    statuses = [each.status for each in repeats]
    cut = "" if len(statuses) >= wanted else ", the next one cut short"
    earlier = f", {before} of them earlier" if before else ""
    failed = sum(map(bool, statuses)) or "none"
    counts = sorted(Counter(statuses).items(), key=lambda each: (each[0] != 0, -each[0]))
    told = ", ".join(f"{status} of {count}" for status, count in counts) or "of none"
    runs_again = sum(len(each.again) for each in repeats)
    return (
        f"{len(statuses)} of {wanted} repeats done{earlier}{cut}; {failed} failed, "
        f"{runs_again} tests run again; exit status {told}"
    )


def main() -> int:
    """Run the command; 1 where a repeat failed or was not run."""
    parser = argparse.ArgumentParser(prog="tools/soak.py", description=__doc__)
    add = parser.add_argument
    add("--repeats", type=int, default=200, help="runs of the whole suite (%(default)s)")
    add("--bus", default="simcan", help="simcan or vcan0 (%(default)s)")
    workers = 2 * (os.cpu_count() or 1)
    add("--workers", type=int, default=workers, help="tests side by side, on simcan (%(default)s)")
    add("--keep", type=Path, metavar="FILE", help="go on behind the repeats that this file has")
    add("--only", default="", metavar="EXPRESSION", help="as pytest's -k")
    options = parser.parse_args()
    if options.bus != "simcan":
        options.workers = 1
    state = state_of_code(ROOT)
    repeats: list[Repeat] = []
    if options.keep is not None and options.keep.exists():
        try:
            repeats = kept(options.keep, state, options.bus)
        except ValueError as error:
            parser.error(str(error))
    if options.keep is not None:
        options.keep.parent.mkdir(parents=True, exist_ok=True)
    before = len(repeats)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    begin_s = time.monotonic()
    with contextlib.suppress(KeyboardInterrupt):  # it has ended the tests
        while len(repeats) < options.repeats:
            done = repeat(options, state, len(repeats) + 1)
            repeats.append(done)
            if options.keep is not None:
                with options.keep.open("ab") as file:
                    file.write(msgspec.json.encode(done) + b"\n")
            for text in filter(None, (done.output, *done.again)):
                print(text, flush=True)
            minutes = (time.monotonic() - begin_s) / 60
            text = f"repeat {len(repeats)} of {options.repeats}: exit {done.status}"
            print(f"{text}, {minutes:.1f} min", file=sys.stderr, flush=True)
    print(table(repeats))
    print(verdict(repeats, options.repeats, before))
    return 1 if any(each.status for each in repeats) or len(repeats) < options.repeats else 0


if __name__ == "__main__":
    sys.exit(main())
