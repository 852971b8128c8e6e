"""Whether an ODrive is in service: heard, commissioned, and with its settings as they were."""

from __future__ import annotations

import enum
from typing import Final

from robotctl.drivers.can.drives.motor_drive import Send
from robotctl.drivers.can.drives.odrive.settings import (
    READ_BACK_NS,
    RETRY_NS,
    Commissioned,
    Commissioning,
    Setting,
    commission,
    no_answer,
)
from robotctl.messages.actuators import NEVER_NS
from robotctl.messages.control import NodeStatus
from robotctl.messages.faults import Fault, FaultCode

IN_SERVICE, OUT_OF_SERVICE = 5, 127
"""`NodeStatus.nmt_state`, as a CANopen node has it."""

UNREAD_MAX: Final = 5
"""Consecutive readings of a setting that may go unanswered."""


class Phase(enum.Enum):
    """Phases of the drive's commissioning."""

    SILENT = "no heartbeat"
    COMMISSIONING = "script runs"
    READY = "in service"
    REFUSED = "failed, waits for another attempt"


class Service:
    """Commissions a drive and watches over it.

    Parameters
    ----------
    name
        Name of the drive.
    node_id
        Its number on the bus.
    timeout_ms
        Time without a command after which it must give no power [ms].
    silent_ms
        Time without a heartbeat after which it is lost [ms].
    endpoints
        Those of its watchdog, or none.

    Attributes
    ----------
    phase
        Present phase.
    boots
        How often it was found anew.
    proof
        As of `MotorDrive`.
    is_old
        Whether its firmware is 0.5; None: not known.
    """

    def __init__(
        self,
        name: str,
        node_id: int,
        timeout_ms: int,
        silent_ms: int,
        endpoints: tuple[int, ...],
    ) -> None:
        self.phase = Phase.SILENT
        self.boots = 0
        self.proof: str | None = None
        self.is_old: bool | None = None
        self._name = name
        self._node_id = node_id
        self._timeout_ms = timeout_ms
        self._silent_ns = silent_ms * 1_000_000
        self._endpoints = (endpoints[0], endpoints[1]) if endpoints else None
        self._commissioning = self._new_commissioning()
        self._kept: tuple[Setting, ...] = ()
        """Settings to read back; the first is next."""
        self._doubted = False
        """Whether the last reading differed: a single one may be a damaged frame."""
        self._unread = 0
        self._read_ns = self._retry_ns = self._beat_ns = NEVER_NS
        self._stopped: Fault | None = None
        """Reason for which it went out of service since the last `check`."""
        self._problem: Fault | None = Fault(
            FaultCode.NODE_NOT_HEARD, "not heard on the bus (its heartbeat rate must not be 0)"
        )

    def heard(self, stamp_ns: int) -> None:
        """Take a heartbeat's time of reception [ns]."""
        self._beat_ns = stamp_ns
        if self.phase is Phase.SILENT:
            self.restart()

    def restart(self) -> None:
        """Commission the drive, which has come or may have restarted."""
        self.boots += 1
        self._begin()

    def take(self, command: int, data: bytes) -> None:
        """Take a message of the drive that only comes as an answer."""
        found = self._commissioning.take(command, data)
        if found is None:
            return
        setting = self._kept[0]
        self._unread = 0
        if found == setting.wanted:
            self._doubted = False
            self._kept = (*self._kept[1:], setting)
        elif not self._doubted:
            self._doubted = True
            self._commissioning.read(setting.reading(self._node_id))
        else:
            text = f"{setting.differs(found)}: it was changed, or the drive restarted"
            self._stop(Fault(FaultCode.NODE_CHANGED, text), self._beat_ns)

    def check(self, now_ns: int) -> Fault | None:
        """Note silence, unanswered queries and the end of commissioning.

        Returns
        -------
        Fault | None
            Why a drive that was in service is not any more.
        """
        if self.phase is Phase.SILENT:
            return None
        commissioning = self._commissioning
        if now_ns - self._beat_ns > self._silent_ns:
            silence = f"no heartbeat for {self._silent_ns / 1e6:g} ms"
            self._stop(Fault(FaultCode.NODE_SILENT, silence), now_ns)
            self.phase = Phase.SILENT
        elif commissioning.waiting:
            unanswered = commissioning.expire(now_ns)
            if unanswered is not None:
                self._unread += 1
                if self._unread > UNREAD_MAX:
                    self._stop(no_answer(unanswered), now_ns)
        if self.phase is Phase.COMMISSIONING and commissioning.end is not None:
            self._finish(commissioning.end, now_ns)
        stopped, self._stopped = self._stopped, None
        return stopped

    def serve(self, send: Send, now_ns: int) -> bool:
        """Send at most one frame; whether it did."""
        if self.phase is Phase.SILENT:
            return False
        if self.phase is Phase.REFUSED:
            if now_ns < self._retry_ns:
                return False
            self._begin()
        commissioning = self._commissioning
        if self._kept and now_ns - self._read_ns >= READ_BACK_NS and not commissioning.waiting:
            self._read_ns = now_ns
            commissioning.read(self._kept[0].reading(self._node_id))
        frame = commissioning.poll(now_ns)
        if frame is None or not send(*frame):
            return False
        commissioning.sent(now_ns)
        return True

    def _new_commissioning(self) -> Commissioning:
        return Commissioning(commission(self._node_id, self._timeout_ms, self._endpoints))

    def _begin(self) -> None:
        """Start commissioning; a repeated attempt leaves the sentence of the last failure."""
        if self.phase is not Phase.REFUSED:
            self._problem = Fault(FaultCode.NODE_STARTING, "is being identified")
        self.phase = Phase.COMMISSIONING
        self._forget()
        self._commissioning = self._new_commissioning()

    def _finish(self, end: Commissioned | Fault, now_ns: int) -> None:
        """Put the drive into service, or say why not."""
        if isinstance(end, Fault):
            self._refuse(end, now_ns)
            return
        self.phase = Phase.READY
        self.is_old, self._kept, self.proof = end.is_old, end.kept, end.proof
        self._read_ns = now_ns
        self._problem = None

    def _stop(self, fault: Fault, now_ns: int) -> None:
        """Take the drive out of service."""
        self._stopped = fault
        self._refuse(fault, now_ns)

    def _refuse(self, fault: Fault, now_ns: int) -> None:
        """Keep the drive out of service and say why; try again later."""
        self.phase = Phase.REFUSED
        self._retry_ns = now_ns + RETRY_NS
        self._problem = fault
        self._forget()

    def _forget(self) -> None:
        """Know nothing of the drive any more."""
        self._commissioning.cancel()
        self.is_old, self._kept, self.proof = None, (), None
        self._doubted, self._unread = False, 0

    @property
    def status(self) -> NodeStatus:
        """Present status."""
        fault = self._problem
        return NodeStatus(
            self._node_id,
            self._name,
            IN_SERVICE if self.phase is Phase.READY else OUT_OF_SERVICE,
            self._beat_ns,
            self.boots,
            f"{self._name} (node {self._node_id}): {fault}" if fault else "",
            fault.code if fault else FaultCode.NONE,
        )
