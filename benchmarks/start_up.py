"""Time until a command answers: what a person at the prompt waits for."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

from benchmarks import machine

ROBOTCTL = str(Path(sys.executable).parent / "robotctl")
COMMANDS = {
    "python -c pass": ("-c", "pass"),
    "robotctl --help": (ROBOTCTL, "--help"),
    "robotctl version": (ROBOTCTL, "version"),
    "robotctl sim --help": (ROBOTCTL, "sim", "--help"),
    "robotctl config check": (ROBOTCTL, "config", "check", "diff_drive"),
    "import robotctl.app.processes.control": ("-c", "import robotctl.app.processes.control"),
    "import robotctl.app.simulation.sim": ("-c", "import robotctl.app.simulation.sim"),
    "import robotctl.app.simulation.lockstep": ("-c", "import robotctl.app.simulation.lockstep"),
}


def run(rounds: int, _seconds: float) -> None:
    """Start each command some times."""
    rows = []
    for name, arguments in COMMANDS.items():
        times_s = [_took_s(arguments) for _ in range(rounds)]
        rows.append((name, machine.spread(times_s, 2)))
    machine.table("Start-up", ("command", "s (rounds)"), rows)


def _took_s(arguments: tuple[str, ...]) -> float:
    begin_s = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - begin_s
