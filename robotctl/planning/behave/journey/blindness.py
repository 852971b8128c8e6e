"""Waiting while the robot sees nothing."""

from __future__ import annotations

from robotctl.planning.behave.behaviours.behaviour import BehaviourOutput, failed


class BlindWait:
    """Lets the robot stand while it sees nothing, for a while.

    Parameters
    ----------
    longest_s
        Time after which it gives up [s].
    """

    def __init__(self, longest_s: float) -> None:
        self._longest_s = longest_s
        self._since_ns = 0
        """When it began [ns]; 0: the robot sees."""

    def end(self) -> None:
        """Note that the robot sees, or that its time does not count."""
        self._since_ns = 0

    def step(self, blindness: str, now_ns: int) -> BehaviourOutput:
        """Return rest, with why nothing is seen; failed after a while."""
        self._since_ns = self._since_ns or now_ns
        if now_ns - self._since_ns > round(1e9 * self._longest_s):
            return failed(f"{blindness} for {self._longest_s:g} s")
        return BehaviourOutput(0.0, 0.0, text=f"waiting: {blindness}")
