"""All tests in order: unit, HIL on simcan, HIL on a real vcan. `make test` calls it.

The vcan part runs on this kernel where it has vcan and rights allow, else in the guest of
`tools/vcan-guest`: the whole under virtual time, a short smoke in real time. What the bus alone
decides runs there alone, unless it is left out. Missions on simcan run beside nothing: their
navigation has no priority, and holds the robot when others leave it no processor for half a second.
Every stage runs even if one before it failed; the last lines say what ran and what did not.
Environment: VCAN=off leaves the vcan part out.
"""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO

sys.path.insert(0, str(Path(__file__).resolve().parent))

from can_link import add_vcan, set_link

ROOT = Path(__file__).resolve().parent.parent
GUEST = str(ROOT / "tools" / "vcan-guest")
PYTEST = (sys.executable, "-m", "pytest")
INTERFACE = "vcan0"
# Also the tests of drivers that need SocketCAN, which the unit stage names as skipped.
DRIVERS = ("tests/vcan", "tests/drivers/can/test_can_port_contract.py")
HIL = tuple(sorted(str(path.relative_to(ROOT)) for path in ROOT.glob("hil_tests/test_*.py")))
LONG = tuple(
    f"hil_tests/test_{name}.py"
    for name in ("8_mission", "11_emergency_stop_faults", "12_robot_faults", "13_runs")
)
"""As long as all other HIL tests together, in a guest."""

MISSION_TESTS = tuple(f"hil_tests/test_{name}.py" for name in ("8_mission", "13_runs"))
"""Of whole runs, whose navigation has no priority."""

ON_SIMCAN = ("--bus", "simcan", "-n", "2")
FAULT_ROWS = "hil_tests/test_12_robot_faults.py"
PATROLS = tuple(
    f"hil_tests/test_8_mission.py::test_patrol_is_completed_without_collision[{robot}]"
    for robot in ("tricycle", "ackermann")
)
"""With the fault rows: what the bus decides. On simcan, too, only where vcan is left out."""
ON_VCAN = ("--bus", INTERFACE)
SMOKE = ("tests/vcan", "hil_tests/test_1_link.py", *ON_VCAN)
GUEST_LIMIT_S = 2400.0
POLL_S = 0.2

LEFT_OUT = "not run, "
TOLD = ("FAILED ", "ERROR ", "RUN AGAIN ", LEFT_OUT)
SETTINGS = {"COLUMNS": "200", "PYTHONDONTWRITEBYTECODE": ""}
"""Else pytest cuts what it says at 80 columns, and each process compiles all code anew."""

PASSED, FAILED, NOT_RUN = "passed", "FAILED", "NOT RUN"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one stage."""

    name: str
    result: str
    seconds: float = 0.0
    note: str = ""
    tests: tuple[str, ...] = ()
    """What pytest's summary said of tests that failed, were run again, or were not run."""

    def lines(self) -> str:
        """Return the stage's lines of the summary."""
        taken = f"{self.seconds:7.1f} s" if self.result != NOT_RUN else " " * 9
        left_out = sum(test.startswith(LEFT_OUT) for test in self.tests)
        notes = (self.note, f"{left_out} tests not run" if left_out else "")
        note = ", ".join(filter(None, notes))
        line = f"  {self.name:<58} {self.result:<8} {taken}  {note}".rstrip()
        return "\n".join((line, *(f"    {test}" for test in self.tests)))


def told(output: bytes) -> tuple[str, ...]:
    """Return the lines in which pytest's summary names a test."""
    lines = output.decode(errors="replace").splitlines()
    return tuple(line for line in lines if line.startswith(TOLD))


def last_line(output: bytes) -> str:
    """Return the last line of an output that has something in it."""
    lines = output.decode(errors="replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "no output")


def read_from(output: IO[bytes], begin: int) -> bytes:
    """Return what commands have written to a file since `begin`."""
    return os.pread(output.fileno(), os.fstat(output.fileno()).st_size - begin, begin)


def stage(name: str, *commands: tuple[str, ...]) -> Outcome:
    """Run one stage: its commands side by side, the first one's output passed on as it comes."""
    print(f"\n=== {name}", flush=True)
    begin_s = time.monotonic()
    with contextlib.ExitStack() as stack:
        outputs = [stack.enter_context(tempfile.TemporaryFile()) for _ in commands]
        running = [
            subprocess.Popen(
                command,
                cwd=ROOT,
                env=os.environ | SETTINGS,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
            )
            for command, output in zip(commands, outputs, strict=True)
        ]
        passed_on, late = 0, False
        while any(process.poll() is None for process in running) and not late:
            time.sleep(POLL_S)
            passed_on += os.write(1, read_from(outputs[0], passed_on))
            late = time.monotonic() - begin_s > GUEST_LIMIT_S
        for process in running:
            process.kill()
            process.wait()
        heard = [read_from(output, 0) for output in outputs]
    print(b"\n".join((heard[0][passed_on:], *heard[1:])).decode(errors="replace"), flush=True)
    failed = [
        f"exit {process.returncode}: {last_line(output)}"  # where a program says its reason
        for process, output in zip(running, heard, strict=True)
        if process.returncode
    ]
    note = "ended: it took too long" if late else ", ".join(failed)
    tests = tuple(test for output in heard for test in told(output))
    return Outcome(name, FAILED if failed else PASSED, time.monotonic() - begin_s, note, tests)


def vcan_here() -> bool:
    """Return whether this kernel has vcan0 or lets us make it (it loads its module by itself)."""
    if INTERFACE not in {name for _, name in socket.if_nameindex()}:
        if os.geteuid() != 0:
            return False
        try:
            add_vcan(INTERFACE)
        except OSError:
            return False
    with contextlib.suppress(PermissionError):  # not ours to change: if it is down the tests say so
        set_link(INTERFACE, up=True)
    return True


def missions(wanted: str) -> tuple[str, ...]:
    """Return the command of missions on simcan."""
    left = () if wanted == "off" else tuple(f"--deselect={each}" for each in PATROLS)
    return (*PYTEST, *MISSION_TESTS, *ON_SIMCAN, *left)


def on_simcan(wanted: str) -> tuple[str, ...]:
    """Return the command of all other HIL tests on simcan."""
    left = MISSION_TESTS if wanted == "off" else (*MISSION_TESTS, FAULT_ROWS)
    return (*PYTEST, *(file for file in HIL if file not in left), *ON_SIMCAN)


def late_stages(wanted: str, run: Callable[..., Outcome]) -> list[Outcome]:
    """Run missions on simcan and all HIL tests on a real SocketCAN bus, here or in the guest."""
    alone = partial(run, "missions on simcan", missions(wanted))
    if wanted == "off":
        return [alone(), Outcome("HIL on vcan", NOT_RUN, note="VCAN=off")]
    if vcan_here():
        whole = (*PYTEST, *DRIVERS, *HIL, *ON_VCAN)
        return [alone(), run("HIL on vcan, this kernel, real time", whole)]
    # Booting once tells the guest's own failure (125) from that of tests.
    ready = run("vcan guest: kernel and boot", (sys.executable, GUEST, "true"))
    if ready.result != PASSED:
        note = "neither this kernel's vcan nor the guest can be had; VCAN=off leaves it out"
        return [ready, alone(), Outcome("HIL on vcan", NOT_RUN, note=note)]
    guest = (sys.executable, GUEST)
    return [
        ready,
        run("vcan guest: the tool's own tests", (*PYTEST, "tests/guest")),
        alone(),
        run(  # a guest has one processor
            "HIL on vcan, two guests, virtual time",
            (*guest, *PYTEST, *LONG, *ON_VCAN),
            (*guest, *PYTEST, *DRIVERS, *(file for file in HIL if file not in LONG), *ON_VCAN),
        ),
        run("smoke on vcan, guest, real time", (*guest, "--real-time", *PYTEST, *SMOKE)),
    ]


def verdict(outcomes: list[Outcome], wanted: str) -> tuple[str, int]:
    """Return the last line of the run and its exit status."""
    if any(outcome.result == FAILED for outcome in outcomes):
        return "make test: FAILED", 1
    if any(outcome.result == NOT_RUN for outcome in outcomes):
        if wanted == "off":
            return "make test: passed, without real vcan (VCAN=off)", 0
        return "make test: FAILED, not everything could run", 1
    return "make test: passed", 0


def main() -> int:
    """Run everything and sum up."""
    wanted = os.environ.get("VCAN", "")
    if wanted not in {"", "on", "off"}:
        print(f"VCAN={wanted}: unknown value; allowed: on, off", file=sys.stderr)
        return 2
    outcomes = [
        # What two workers would compile side by side, within the time limit of a test.
        stage("kernels", (sys.executable, "-m", "robotctl", "compile")),
        # One worker makes a file's costly fixtures, and never two a robot of the same file.
        stage("unit tests", (*PYTEST, "-n", "2", "--dist", "loadfile")),
        stage("HIL on simcan", on_simcan(wanted)),
        *late_stages(wanted, stage),
    ]
    print("\n=== summary")
    print("\n".join(outcome.lines() for outcome in outcomes))
    line, status = verdict(outcomes, wanted)
    print(line, flush=True)
    return status


if __name__ == "__main__":
    sys.exit(main())
