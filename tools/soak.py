"""Run the fault tests over and over and print how long each reaction took: `make soak`.

Each repeat is one run of the tests of faults and safety stops in `hil_tests/`. One failure in any
repeat fails the whole; its output is shown at once, and the last line says all exit statuses. On
simcan tests run side by side, two for each processor: a robot takes a quarter of one with real-time
priority, one with a flooded bus as much as three others, and where such tasks leave nothing to
ordinary ones for a second, the kernel takes 50 ms for those. A test that failed while the machine
itself stood is run again, and counted (`hil_tests/pauses.py`). Ctrl-C and SIGTERM end it early,
with the table of the repeats until then.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from reactions import reaction_table

ROOT = Path(__file__).resolve().parent.parent
SUITE = sorted(
    str(path.relative_to(ROOT))
    for pattern in ("test_*_safety_stops.py", "test_*_faults.py")
    for path in (ROOT / "hil_tests").glob(pattern)
)


def repeat(options: argparse.Namespace, reactions: Path) -> tuple[int, str, list[str]]:
    """Run the suite once; return its exit status, its output, and which tests were run again."""
    command = [
        *(sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"),
        *SUITE,
        *("--bus", options.bus, "--reactions", str(reactions)),
        *(("-k", options.only) if options.only else ()),
        *(("-n", str(options.workers), "--dist", "worksteal") if options.workers > 1 else ()),
    ]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    again = [line for line in ended.stdout.splitlines() if line.startswith("RUN AGAIN")]
    return ended.returncode, ended.stdout + ended.stderr, again


def verdict(statuses: list[int], wanted: int, runs_again: int) -> str:
    """Return the last line: what became of the repeats, and with which exit statuses they ended."""
    cut = "" if len(statuses) == wanted else ", the next one cut short"
    failed = sum(map(bool, statuses)) or "none"
    counts = sorted(Counter(statuses).items(), key=lambda each: (each[0] != 0, -each[0]))
    told = ", ".join(f"{status} of {count}" for status, count in counts) or "of none"
    return (
        f"{len(statuses)} of {wanted} repeats done{cut}; {failed} failed, "
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
    add("--keep", type=Path, metavar="FILE", help="add each reaction to this file, a JSON a line")
    add("--only", default="", metavar="EXPRESSION", help="as pytest's -k")
    options = parser.parse_args()
    if options.bus != "simcan":
        options.workers = 1
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    statuses: list[int] = []
    runs_again = 0
    with tempfile.TemporaryDirectory(prefix="soak-") as directory:
        reactions = (options.keep or Path(directory) / "reactions.jsonl").resolve()
        reactions.touch()
        begin_s = time.monotonic()
        with contextlib.suppress(KeyboardInterrupt):  # it has ended the tests
            while len(statuses) < options.repeats:
                status, output, again = repeat(options, reactions)
                statuses.append(status)
                runs_again += len(again)
                for text in ([output] if status else []) + again:
                    print(text, flush=True)
                minutes = (time.monotonic() - begin_s) / 60
                text = (
                    f"repeat {len(statuses)} of {options.repeats}: exit {status}, {minutes:.1f} min"
                )
                print(text, file=sys.stderr, flush=True)
        print(reaction_table(reactions.read_text(encoding="utf-8").splitlines()))
    print(verdict(statuses, options.repeats, runs_again))
    return 1 if any(statuses) or len(statuses) < options.repeats else 0


if __name__ == "__main__":
    sys.exit(main())
