"""Memory of the control process while it drives, all of it locked."""

from __future__ import annotations

from benchmarks import machine
from benchmarks.rig import Driven

TARGET_MIB = 60.0


def run(rounds: int, seconds: float) -> None:
    """Read /proc/PID/status in the middle of each round."""
    figures = []
    for _ in range(min(rounds, 3)):
        with Driven(200) as robot:
            robot.drive(min(seconds, 5.0), end=False)
            figures.append(robot.resident_mib())
    resident = machine.median(each["VmRSS"] for each in figures)
    rows = [
        (name, machine.spread([each[name] for each in figures], 1))
        for name in ("VmRSS", "VmHWM", "VmLck")
    ]
    machine.table("Memory of the control process while driving", ("figure", "MiB"), rows)
    machine.note(f"{resident / TARGET_MIB:.2f} of the {TARGET_MIB:g} MiB allowed")
