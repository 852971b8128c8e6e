"""Waiting while the robot sees nothing."""

from __future__ import annotations

from typing import Final

from robotctl.planning.behave.behaviours.behaviour import BehaviourOutput, failed

_BLIND_NS: Final = 10_000_000_000
"""A robot that sees nothing for this long gives up [ns]."""


class BlindWait:
    """Lets the robot stand while it sees nothing, for a while."""

    def __init__(self) -> None:
        self._since_ns = 0
        """When it began [ns]; 0: the robot sees."""

    def end(self) -> None:
        """Note that the robot sees, or that its time does not count."""
        self._since_ns = 0

    def step(self, blindness: str, now_ns: int) -> BehaviourOutput:
        """Return rest, with why nothing is seen; failed after a while."""
        self._since_ns = self._since_ns or now_ns
        if now_ns - self._since_ns > _BLIND_NS:
            return failed(f"{blindness} for {_BLIND_NS / 1e9:g} s")
        return BehaviourOutput(0.0, 0.0, text=f"waiting: {blindness}")
