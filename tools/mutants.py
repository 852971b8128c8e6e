"""Mutation testing of the modules that stop the robot: `make mutants`.

mutmut copies the project into `mutants/`, makes one small change after another to the modules that
`[tool.mutmut]` names, and runs the tests that reach the change. A change that no test notices is a
survivor. Each survivor stands with its reason in docs/mutants.md.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MUTMUT = str(Path(sys.executable).with_name("mutmut"))
LEAST = 0.95
NOTICED = ("killed", "timeout")
NOT_RUN = "not checked"


def tally(results: Iterable[str]) -> dict[str, Counter[str]]:
    """Return how often each status came, by module, from the lines of `mutmut results`."""
    found: dict[str, Counter[str]] = defaultdict(Counter)
    for line in results:
        mutant, _, status = line.strip().rpartition(": ")
        if mutant and status != NOT_RUN:
            found[mutant.rpartition(".")[0]][status] += 1
    return found


def row(name: str, counts: Counter[str]) -> str:
    """Return one line of the table."""
    killed = sum(counts[status] for status in NOTICED)
    total = counts.total()
    return f"| {name} | {total} | {killed} | {total - killed} | {killed / total:.1%} |"


def table(found: dict[str, Counter[str]]) -> str:
    """Return a Markdown table: module, mutants, killed, survived, share of killed."""
    lines = ["| module | mutants | killed | survived | rate |", "|---|---|---|---|---|"]
    lines += [row(f"`{module}`", counts) for module, counts in sorted(found.items())]
    return "\n".join([*lines, row("all", sum(found.values(), Counter()))])


def main() -> int:
    """Run the command; 1 where a module has too many survivors."""
    parser = argparse.ArgumentParser(prog="tools/mutants.py", description=__doc__)
    add = parser.add_argument
    add("names", nargs="*", help="only these, in the copy of last time: 'robotctl.safety.health*'")
    add("--workers", type=int, default=os.cpu_count(), help="mutants side by side (%(default)s)")
    options = parser.parse_args()
    if not options.names:
        shutil.rmtree(ROOT / "mutants", ignore_errors=True)
    command = [MUTMUT, "run", "--max-children", str(options.workers), *options.names]
    subprocess.run(command, cwd=ROOT, check=True)
    results = subprocess.run(
        [MUTMUT, "results", "--all", "true"],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    ).stdout.splitlines()
    survivors = [line for line in results if not line.endswith((*NOTICED, NOT_RUN))]
    print("\n".join(["", *survivors, "", "`.venv/bin/mutmut show NAME` shows one.", ""]))
    found = tally(results)
    print(table(found))
    rates = [
        sum(counts[status] for status in NOTICED) / counts.total() for counts in found.values()
    ]
    return 0 if rates and min(rates) >= LEAST else 1


if __name__ == "__main__":
    raise SystemExit(main())
