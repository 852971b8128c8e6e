"""Frame by which a drive knows that the host is there, sent again and again."""

from __future__ import annotations

from typing import Final

from robotctl.drivers.can.bus_part import Send
from robotctl.drivers.can.drives.cia402.device import Silence
from robotctl.drivers.can.drives.cia402.settings import DriveSetup
from robotctl.drivers.can.nodes.identifiers import CobId, NmtState
from robotctl.messages.actuators import NEVER_NS
from robotctl.messages.ports import REMOTE_FLAG

BEATS: Final = 4
"""Heartbeats of the host within the drive's time-out: all but one may be lost."""


class HostBeat:
    """Sends a frame in even periods.

    Parameters
    ----------
    frame
        Identifier with its flags, and data.
    timeout_ms
        Time-out of the drive [ms].
    """

    __slots__ = ("_period_ns", "_sent_ns", "frame")

    def __init__(self, frame: tuple[int, bytes], timeout_ms: int) -> None:
        self.frame = frame
        self._sent_ns = NEVER_NS
        self._period_ns = timeout_ms * 1_000_000 // BEATS

    def step(self, send: Send, now_ns: int) -> None:
        """Send the frame when it is due [ns]."""
        if now_ns - self._sent_ns >= self._period_ns:
            self._sent_ns = now_ns
            send(*self.frame)


def host_beat(plan: DriveSetup) -> HostBeat | None:
    """Return the heartbeat of the host, or the requests of node guarding; None: neither is set."""
    silence = plan.device.silence
    if silence is Silence.HEARTBEAT:
        frame = CobId.HEARTBEAT + plan.host_id, bytes((NmtState.OPERATIONAL,))
    elif silence is Silence.GUARDING:
        frame = CobId.HEARTBEAT + plan.node_id | REMOTE_FLAG, b"\0"
    else:
        return None
    return HostBeat(frame, plan.timeout_ms)
