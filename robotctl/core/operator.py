"""The operator: all that differs between a robot's processes and a simulated run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from robotctl.messages.faults import Fault

Request = TypeVar("Request")


@dataclass(frozen=True, slots=True)
class Operator(Generic[Request]):
    """Source of a tick's requests and destination of its messages; all else is the tick's.

    Parameters
    ----------
    ask
        Returns the requests since the last call, oldest first: those of a socket, or of a
        simulated operator.
    tell
        Takes each message that is to be published: a publisher, a log, a score.
    objections
        Objections of the host computer to arming.
    """

    ask: Callable[[], Sequence[Request]]
    tell: Callable[[Any], object]
    objections: tuple[Fault, ...] = ()
