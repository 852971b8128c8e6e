"""Faults at run time: one line on standard input each, one line on standard output in answer.

The answer is `fault KIND at NANOSECONDS`, CLOCK_MONOTONIC of the start of the fault, or `error: `
and the reason. See `firmware_sim.faults.faults`.
"""

from __future__ import annotations

import os
import select
from typing import TYPE_CHECKING

from firmware_sim.command_line import tell
from firmware_sim.errors import SimulationError

if TYPE_CHECKING:
    from firmware_sim.simulation import Simulation

STDIN = 0


class FaultConsole:
    """A service of `RealTime` that reads fault lines until the end of input.

    Parameters
    ----------
    simulation
        Simulation that has the faults.
    descriptor
        Descriptor of the input.
    """

    def __init__(self, simulation: Simulation, descriptor: int = STDIN) -> None:
        self._faults = simulation.faults
        self._descriptor = descriptor
        self._never, self._never_written = os.pipe()
        self._open = True
        self._rest = b""

    def fileno(self) -> int:
        """Return the descriptor to wait for; after the end of input one that never wakes."""
        return self._descriptor if self._open else self._never

    def service(self, now_ns: int) -> None:
        """Execute the received lines; `now_ns` is CLOCK_MONOTONIC."""
        if not self._open or not select.select([self._descriptor], (), (), 0)[0]:
            return
        try:
            data = os.read(self._descriptor, 65536)
        except OSError:  # a closed input, or a terminal now owned by another process
            data = b""
        if not data:
            self._open = False
            return
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            if line.strip():
                tell(self._answer(line.decode(errors="replace").strip(), now_ns))

    def _answer(self, line: str, now_ns: int) -> str:
        try:
            return f"fault {self._faults.inject(line)} at {now_ns}"
        except SimulationError as error:
            return f"error: {error}"
