"""The control process with faults built in, each set off by a signal in the middle of a tick."""

from __future__ import annotations

import gc
import signal
import sys
import time
from collections.abc import Callable
from types import FrameType

from robotctl.app.processes import control
from robotctl.app.processes.entry import enter

HANG, SPIN, COLLECT = signal.SIGRTMIN, signal.SIGRTMIN + 1, signal.SIGRTMIN + 2
PAUSE_S = 0.2
"""Twice the drive's time-out: longer would hold up the tests beside this one for nothing."""
_RINGS = 400_000


def _hang() -> None:
    """Wait for something that takes long."""
    time.sleep(PAUSE_S)


def _spin() -> None:
    """Compute for long."""
    end_s = time.monotonic() + PAUSE_S
    while time.monotonic() < end_s:
        pass


def _collect() -> None:
    """Leave so much circular garbage that collecting it takes long."""
    end_s = time.monotonic() + PAUSE_S
    while time.monotonic() < end_s:
        for _ in range(_RINGS):
            ring: list[object] = []
            ring.append(ring)
        gc.collect()


FAULTS: dict[int, Callable[[], None]] = {HANG: _hang, SPIN: _spin, COLLECT: _collect}


def main() -> int:
    """Run the control process until SIGTERM."""
    pending: list[Callable[[], None]] = []

    class FaultyTick(control.ControlTick):
        def control(self, now_ns: int) -> None:
            while pending:
                pending.pop()()
            super().control(now_ns)

    def on_signal(number: int, _frame: FrameType | None) -> None:
        pending.append(FAULTS[number])

    for number in FAULTS:
        signal.signal(number, on_signal)
    control.ControlTick = FaultyTick  # type: ignore[misc]
    return enter("control", control.run)


if __name__ == "__main__":
    sys.exit(main())
