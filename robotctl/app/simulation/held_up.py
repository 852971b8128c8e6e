"""Stalls of the computer in a simulated run, as text for the user."""

from __future__ import annotations

from typing import Final

from robotctl.messages.control import ControlState
from robotctl.messages.ports import Clock
from robotctl.runtime.simulated_clock import SimulatedClock

SAY_MS: Final = 20.0
"""Minimum length of a stall that is reported [ms]."""

_GROWTH: Final = 2.0
"""Growth after which it is reported again."""


class HeldUp:
    """Looks after the clock of a run.

    Parameters
    ----------
    clock
        Of the run. Only a `SimulatedClock` pauses time.
    """

    def __init__(self, clock: Clock) -> None:
        self.longest_ms = 0.0
        """At most at a time, since the robot was there [ms]."""
        self._clock = clock
        self._began = False
        self._said_ms = SAY_MS / _GROWTH

    def step(self, control: ControlState | None, simulator_ns: int) -> tuple[str, ...]:
        """Return a message if it is new.

        Parameters
        ----------
        control
            State of the control process; None before the robot is there.
        simulator_ns
            Maximum lateness of the simulator itself [ns].
        """
        if control is None:
            return ()
        clock = self._clock
        if isinstance(clock, SimulatedClock):
            if not self._began:
                clock.forget_longest()
                self._began = True
            self.longest_ms = clock.longest_ns / 1e6
        else:
            self.longest_ms = max(control.loop.lag_us_max / 1e3, simulator_ns / 1e6)
        if self.longest_ms < _GROWTH * self._said_ms:
            return ()
        self._said_ms = self.longest_ms
        return (self.words(),)

    def words(self) -> str:
        """Return the effect on the run."""
        meant = (
            "simulated time paused meanwhile"
            if isinstance(self._clock, SimulatedClock)
            else "`--lockstep` does not depend on it"
        )
        return f"this computer was held up for {self.longest_ms:.0f} ms; {meant}"
