"""All tests in order: unit, HIL on simcan, HIL on a real vcan. `make test` calls it.

The vcan part runs on this kernel where it has vcan and rights allow, else in the guest of
`tools/vcan-guest`: the whole under virtual time, a short smoke in real time. What the bus alone
decides runs there alone, unless it is left out.

What must be compiled first, is at once: kernels, the guest's kernel, and the tests themselves,
which two workers would do both.

Robots in real time leave half of the processors idle. Guests under virtual time take that half from
the beginning on, and no more: nothing is late for them. Missions on simcan run beside nothing else:
their navigation has no priority, and holds the robot when others leave it no processor for half a
second. Every stage runs even if one before it failed; the last lines say what ran and what did not.
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
from pathlib import Path
from typing import IO, TypeAlias

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
    for name in ("8_mission", "12_robot_faults", "13_runs", "16_procedures")
)
"""As long as all other HIL tests together, in a guest."""

MISSION_TESTS = tuple(f"hil_tests/test_{name}.py" for name in ("13_runs", "8_mission"))
"""Of whole runs, whose navigation has no priority. The longest come last: each worker gets one."""

PREPARED = (*PYTEST, "-k", Path(__file__).stem)
"""Loads all tests, so that their byte code is there, and runs those of this tool."""

ON_SIMCAN = ("--bus", "simcan", "-n", "2")
FAULT_ROWS = "hil_tests/test_12_robot_faults.py"
PATROL = "hil_tests/test_8_mission.py::test_patrol_is_completed_without_collision"
PATROLS = (f"{PATROL}[tricycle]", f"{PATROL}[ackermann]")
"""With the fault rows: what the bus decides. On simcan, too, only where vcan is left out."""
ON_VCAN = ("--bus", INTERFACE, f"--deselect={PATROL}[diff_drive]")
"""That patrol is driven on simcan."""
SMOKE = ("tests/vcan", "hil_tests/test_1_link.py", *ON_VCAN)
LIMIT_S = 3600.0
"""A stage that takes longer hangs: the longest takes 40 minutes on two slow processors."""
POLL_S = 0.2
IDLE_TIME = ("chrt", "--idle", "0")
"""Lets a command run where no other process wants to."""

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


class Stage:
    """Commands side by side; the first one's output is passed on as it comes.

    Parameters
    ----------
    in_background
        Whether they only take what others leave of the processors, until their outcome is awaited.
    """

    def __init__(self, name: str, *commands: tuple[str, ...], in_background: bool = False) -> None:
        self._name, self._in_background = name, in_background
        self._begin_s = time.monotonic()
        self._outputs = [tempfile.TemporaryFile() for _ in commands]  # noqa: SIM115 - see outcome
        self._running = [
            subprocess.Popen(
                (*(IDLE_TIME if in_background else ()), *command),
                cwd=ROOT,
                env=os.environ | SETTINGS,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
            )
            for command, output in zip(commands, self._outputs, strict=True)
        ]

    def outcome(self) -> Outcome:
        """Wait for the end of all commands and return what became of them."""
        print(f"\n=== {self._name}", flush=True)
        awaited_s = time.monotonic()
        passed_on, late = 0, False
        while any(process.poll() is None for process in self._running) and not late:
            if self._in_background:
                for process in self._running:
                    take_full_time(process.pid)
            time.sleep(POLL_S)
            passed_on += os.write(1, read_from(self._outputs[0], passed_on))
            late = time.monotonic() - awaited_s > LIMIT_S
        for process in self._running:
            process.kill()
            process.wait()
        heard = [read_from(output, 0) for output in self._outputs]
        for output in self._outputs:
            output.close()
        print(b"\n".join((heard[0][passed_on:], *heard[1:])).decode(errors="replace"), flush=True)
        failed = [
            f"exit {process.returncode}: {last_line(output)}"  # where a program says its reason
            for process, output in zip(self._running, heard, strict=True)
            if process.returncode
        ]
        ended_s = time.monotonic()
        notes = ["ended: it took too long"] if late else [*failed]
        if self._in_background:
            notes.append(f"of which {ended_s - awaited_s:.0f} s behind all others")
        tests = tuple(test for output in heard for test in told(output))
        taken_s, result = ended_s - self._begin_s, FAILED if failed else PASSED
        return Outcome(self._name, result, taken_s, ", ".join(notes), tests)


def take_full_time(pid: int) -> None:
    """Let a process and all that it has started run as others do again."""
    parents = {}
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # others come and go
            behind_name = (entry / "stat").read_text(errors="replace").rpartition(")")[2]
            parents[int(entry.name)] = int(behind_name.split()[1])
    family = [pid]
    for each in family:
        family += [child for child, parent in parents.items() if parent == each]
        session = Path(f"/proc/{each}/autogroup")
        with contextlib.suppress(OSError):  # not all kernels share processors out among sessions
            if session.read_text().endswith(" nice 19\n"):
                session.write_text("0")
        for task in Path(f"/proc/{each}/task").glob("*"):
            with contextlib.suppress(ProcessLookupError):
                if os.sched_getscheduler(int(task.name)) == os.SCHED_IDLE:
                    os.sched_setscheduler(int(task.name), os.SCHED_OTHER, os.sched_param(0))


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


Begin: TypeAlias = Callable[..., Stage]
"""Begins a stage of a name with its commands."""


def has_byte_code() -> bool:
    """Return whether the tests were loaded before, so that little of them is to be compiled."""
    return any((ROOT / "tests" / "__pycache__").glob("conftest.*.pyc"))


def prepare(begin: Begin, in_guest: bool) -> list[Outcome]:
    """Compile side by side what all stages need; the last outcome is that of the guest."""
    # What two workers would compile side by side, within the time limit of a test.
    begun = [begin("kernels", (sys.executable, "-m", "robotctl", "compile"))]
    if not has_byte_code():
        begun.append(begin("byte code of the tests", PREPARED))
    if in_guest:
        # Booting once tells the guest's own failure (125) from that of tests.
        begun.append(begin("vcan guest: kernel and boot", (sys.executable, GUEST, "true")))
    return [stage.outcome() for stage in begun]


def vcan_in_guests(begin: Begin) -> tuple[list[Outcome], Stage]:
    """Try the guest, and begin all HIL tests in two of them, which have a processor each."""
    tool = begin("vcan guest: the tool's own tests", (*PYTEST, "tests/guest")).outcome()
    guest = (sys.executable, GUEST)
    return [tool], begin(
        "HIL on vcan, two guests, virtual time, in the background",
        (*guest, *PYTEST, *LONG, *ON_VCAN),
        (*guest, *PYTEST, *DRIVERS, *(file for file in HIL if file not in LONG), *ON_VCAN),
        in_background=True,
    )


def stages(wanted: str, begin: Begin) -> list[Outcome]:
    """Run all stages, those of a real SocketCAN bus here or in the guest."""

    def run(name: str, *commands: tuple[str, ...]) -> Outcome:
        return begin(name, *commands).outcome()

    here, guests = wanted != "off" and vcan_here(), None
    in_guest = wanted != "off" and not here
    outcomes = prepare(begin, in_guest)
    if in_guest and outcomes[-1].result == PASSED:
        tried, guests = vcan_in_guests(begin)
        outcomes += tried
    outcomes += [
        # One worker makes a file's costly fixtures, and never two a robot of the same file.
        run("unit tests", (*PYTEST, "-n", "2", "--dist", "loadfile")),
        run("HIL on simcan", on_simcan(wanted)),
        run("missions on simcan", missions(wanted)),
    ]
    if here:
        outcomes.append(
            run("HIL on vcan, this kernel, real time", (*PYTEST, *DRIVERS, *HIL, *ON_VCAN))
        )
    elif guests is not None:
        smoke = (sys.executable, GUEST, "--real-time", *PYTEST, *SMOKE)
        outcomes += [run("smoke on vcan, guest, real time", smoke), guests.outcome()]
    else:
        failed = "neither this kernel's vcan nor the guest can be had; VCAN=off leaves it out"
        note = "VCAN=off" if wanted == "off" else failed
        outcomes.append(Outcome("HIL on vcan", NOT_RUN, note=note))
    return outcomes


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
    outcomes = stages(wanted, Stage)
    print("\n=== summary")
    print("\n".join(outcome.lines() for outcome in outcomes))
    line, status = verdict(outcomes, wanted)
    print(line, flush=True)
    return status


if __name__ == "__main__":
    sys.exit(main())
