"""One CANopen node as the host sees it: present or lost, commissioned or not, and why not."""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import Final

from robotctl.drivers.can.nodes.commissioning import Script, Setting, Start
from robotctl.drivers.can.nodes.identifiers import CobId, NmtCommand, NmtState
from robotctl.drivers.can.nodes.process_data import Claim, ProcessData
from robotctl.drivers.can.nodes.read_back import ReadBack
from robotctl.drivers.can.nodes.sdo import Request, SdoClient, SdoResponse
from robotctl.drivers.can.presence import Presence
from robotctl.drivers.can.stranger_book import StrangerBook
from robotctl.messages.control import StrangerKind
from robotctl.messages.faults import Fault, FaultCode

_PUT_OUT: Final[dict[int, tuple[NmtState, str]]] = {
    NmtCommand.STOP: (NmtState.STOPPED, "was stopped"),
    NmtCommand.ENTER_PRE_OPERATIONAL: (NmtState.PRE_OPERATIONAL, "was put into pre-operational"),
    NmtCommand.RESET_NODE: (NmtState.BOOT_UP, "was reset"),
    NmtCommand.RESET_COMMUNICATION: (NmtState.BOOT_UP, "was reset"),
}
"""NMT commands that take a node out of service: the state it is in then, and words."""

_SDO_COMMAND: Final = 0xE0
_SDO_DOWNLOAD: Final = 0x20
_SDO_ABORT: Final = b"\x80"
"""Command specifiers of CiA 301, 7.2.4.3."""

START_TIMEOUT_NS: Final = 250_000_000
"""Time for a heartbeat with the new NMT state [ns]: two heartbeats and a half."""

START_ATTEMPTS: Final = 3
RETRY_NS: Final = 1_000_000_000
"""Delay from a failed commissioning to the next attempt [ns]."""


class NodePhase(enum.Enum):
    """Phases of a node's commissioning."""

    SILENT = "not heard"
    WAKING = "goes to pre-operational"
    IDENTIFYING = "script runs"
    STARTING = "waits for operational"
    VERIFYING = "script runs on, operational"
    READY = "in service"
    REFUSED = "failed, waits for another attempt"


class Node(Presence):
    """State machine of one node, advanced by frames and by `poll`.

    Parameters
    ----------
    node_id
        CANopen node id, 1 to 127.
    name
        Name shown to people.
    script
        Makes a new run of its commissioning script.
    heartbeat_timeout_ns
        A node silent for longer is lost [ns].
    strangers
        Where it is noted what others do in its name, or to it.
    knock
        Sent now and then to a node that is not heard; starts the heartbeat of one that has none of
        its own accord. None: nothing.
    rests
        Whether the script needs the node in pre-operational, as where it maps PDOs.
    sdo_pause_ns
        Least time from one request to its SDO server to the next [ns].

    Attributes
    ----------
    phase
        Phase of its commissioning.
    busy
        Whether `poll` may have something to send.
    data
        Its process data.
    """

    def __init__(
        self,
        node_id: int,
        name: str,
        script: Callable[[], Script],
        heartbeat_timeout_ns: int,
        strangers: StrangerBook,
        *,
        knock: Request | None = None,
        rests: bool = False,
        sdo_pause_ns: int = 0,
    ) -> None:
        fault = Fault(FaultCode.NODE_NOT_HEARD, "not heard on the bus")
        super().__init__(node_id, name, NmtState.BOOT_UP, fault)
        self.phase = NodePhase.SILENT
        self.busy = knock is not None
        self.data = ProcessData()
        self._make_script = script
        self._timeout_ns = heartbeat_timeout_ns
        self._strangers = strangers
        self._sdo = SdoClient(sdo_pause_ns)
        self._knock = knock
        self._rests = rests
        self._script: Script | None = None
        self._extra: Request | None = None
        self._answered: Callable[[SdoResponse], None] | None = None
        self._read_back = ReadBack()
        self._foreign_write = False
        """Whether the answer to such a write is awaited."""
        self._attempts = 0
        self._wait_until_ns = 0
        self._refresh()

    def on_heartbeat(self, data: bytes, stamp_ns: int) -> None:
        """Take a heartbeat or boot-up message received at `stamp_ns` [ns].

        One that says that a node in service booted, or left operational, anybody may have sent. A
        node that did sends no process data any more (CiA 301), so its next frames decide.
        """
        if len(data) != 1:
            return
        state = data[0] & 0x7F
        in_service = self.phase in (NodePhase.VERIFYING, NodePhase.READY)
        if in_service and state != NmtState.OPERATIONAL and self.data.receivers:
            if self.data.claim is None:
                self.data.claim = Claim(state, stamp_ns)
            return
        self._enter(state, stamp_ns)

    def _enter(self, state: int, stamp_ns: int) -> None:
        """Follow a node that is in an NMT state."""
        self.nmt_state = state
        self.heard_ns = stamp_ns
        # CANopen: a node that has sent its boot-up message is in pre-operational (CiA 301).
        if state == NmtState.BOOT_UP:
            self.data.restart()
            self.boots += 1
            self.nmt_state = NmtState.PRE_OPERATIONAL
            self._begin()
        elif self.phase is NodePhase.SILENT:
            self.boots += 1  # nothing is known of its past: never seen, or lost
            self._begin()
        elif self.phase is NodePhase.STARTING and state == NmtState.OPERATIONAL:
            self.phase = NodePhase.VERIFYING
            self._advance(SdoResponse())
        elif self.phase is NodePhase.WAKING and state == NmtState.PRE_OPERATIONAL:
            self._identify()
        elif self.phase in (NodePhase.VERIFYING, NodePhase.READY) and state != NmtState.OPERATIONAL:
            self.boots += 1  # its boot-up was lost, or another device put it out of service
            self._begin()
        self._refresh()

    def on_foreign_nmt(self, command: int) -> None:
        """Handle another device's NMT command to the node: it is out of service."""
        if command in _PUT_OUT and self.phase in (NodePhase.VERIFYING, NodePhase.READY):
            self.nmt_state, words = _PUT_OUT[command]
            self._begin()
            self._say(Fault(FaultCode.NODE_PUT_OUT, f"{words} by another device on the bus (NMT)"))

    def on_sdo(self, data: bytes) -> None:
        """Take a frame of the node's SDO server."""
        response = self._sdo.receive(data)
        if response is not None:
            self._advance(response)
        elif self._foreign_write:
            self._foreign_write = False
            if data[:1] == _SDO_ABORT:
                self._strangers.note_refused(StrangerKind.SDO_WRITE, "SDO", self.name)

    def _weigh(self, claim: Claim, now_ns: int) -> bool:
        """Judge a claim by the process data since; return whether it was found to be true."""
        is_true = self.data.verdict(claim, now_ns)
        if is_true is None:
            return False
        self.data.claim = None
        if is_true:
            self._enter(*claim)
            return True
        name = "boot-up message" if claim.state == NmtState.BOOT_UP else "heartbeat"
        heartbeat_id = CobId.HEARTBEAT + self.node_id
        self._strangers.note(
            StrangerKind.FALSE_STATE, name, heartbeat_id, self.name, claim.stamp_ns
        )
        return False

    def check(self, now_ns: int) -> bool:
        """Return whether the node is out of service since the last call.

        It is where it has booted, or its heartbeat is too old.
        """
        claim = self.data.claim
        if claim is not None and self._weigh(claim, now_ns):
            return True
        if now_ns - self.heard_ns <= self._timeout_ns or self.phase is NodePhase.SILENT:
            return False
        self._stop_script()
        self.phase = NodePhase.SILENT
        self.busy = self._knock is not None
        self._say(Fault(FaultCode.NODE_SILENT, f"no heartbeat for {self._timeout_ns / 1e6:g} ms"))
        return True

    def request(
        self, request: Request, answered: Callable[[SdoResponse], None] | None = None
    ) -> bool:
        """Start a transfer beside the script; False if the node is not in service or busy.

        `answered` is called with its end.
        """
        if self.phase is not NodePhase.READY or self._extra is not None:
            return False
        self._read_back.is_reading = False  # that can wait
        self._extra = request
        self._answered = answered
        self._sdo.start(request)
        self.busy = True
        return True

    def on_foreign_sdo(self, data: bytes, stamp_ns: int) -> None:
        """Leave the node's single SDO channel to another tool's request for a while [ns]."""
        self._read_back.give_way(stamp_ns)
        self._foreign_write = len(data) > 0 and data[0] & _SDO_COMMAND == _SDO_DOWNLOAD
        if self._foreign_write:
            request_id = CobId.SDO_REQUEST + self.node_id
            self._strangers.note(StrangerKind.SDO_WRITE, "SDO", request_id, self.name, stamp_ns)

    def read_back(self, now_ns: int) -> None:
        """Start reading the next setting of a node in service, if no transfer is in progress."""
        if self.phase is NodePhase.READY and self._sdo.idle:
            reading = self._read_back.next(now_ns)
            if reading is not None:
                self._sdo.start(reading)
                self.busy = True

    def withdraw(self) -> None:
        """Abandon a transfer beside the script."""
        if self._extra is not None:
            self._sdo.cancel()
            self._extra = None
            self.busy = False

    def poll(self, now_ns: int) -> tuple[int, bytes] | None:
        """Return the one frame to send now, if any; `sent` says that the bus took it."""
        if self._sdo.expired(now_ns):
            self._advance(SdoResponse())
        data = self._sdo.poll(now_ns)
        if data is not None:
            return CobId.SDO_REQUEST + self.node_id, data
        if now_ns < self._wait_until_ns:
            return None
        if self.phase is NodePhase.SILENT and self._knock is not None:
            return CobId.SDO_REQUEST + self.node_id, self._knock.frame()
        if self.phase is NodePhase.REFUSED:
            self._begin(again=True)
        elif self.phase in (NodePhase.WAKING, NodePhase.STARTING):
            if self._attempts < START_ATTEMPTS:
                return CobId.NMT, bytes((self._nmt_command(), self.node_id))
            text = f"does not become {self._nmt_target()}"
            self._refuse(Fault(FaultCode.NODE_REFUSED, text), now_ns)
        return None

    def sent(self, now_ns: int) -> None:
        """Note that the frame of the last `poll` was sent."""
        if not self._sdo.idle:
            self._sdo.sent(now_ns)
        else:
            self._attempts += 1
            self._wait_until_ns = now_ns + START_TIMEOUT_NS

    def _begin(self, *, again: bool = False) -> None:
        """Start commissioning; a repeated attempt leaves the sentence of the last failure."""
        self._stop_script()
        self.data.claim = None
        self._attempts = 0
        self._wait_until_ns = 0
        self.busy = True
        if not again:
            self._say(Fault(FaultCode.NODE_STARTING, "is being identified"))
        if self.nmt_state == NmtState.STOPPED or (
            self._rests and self.nmt_state != NmtState.PRE_OPERATIONAL
        ):
            self.phase = NodePhase.WAKING
        else:
            self._identify()

    def _identify(self) -> None:
        """Run the script from its first transfer."""
        self.phase = NodePhase.IDENTIFYING
        self._wait_until_ns = 0
        self._script = self._make_script()
        self._carry_out(next(self._script))

    def _carry_out(self, step: Request | Start) -> None:
        """Start the script's next transfer."""
        if isinstance(step, Request):
            self._sdo.start(step)
            return
        self.phase = NodePhase.STARTING
        self._attempts = 0
        self._wait_until_ns = 0

    def _advance(self, response: SdoResponse) -> None:
        """Pass the end of a transfer to its initiator."""
        if self._read_back.is_reading:
            self._compare(response)
            return
        if self._extra is not None:
            self._extra = None
            self.busy = False
            if self._answered is not None:
                self._answered(response)
            return
        if self._script is None:
            return
        try:
            self._carry_out(self._script.send(response))
        except StopIteration as stop:
            self._script = None
            if isinstance(stop.value, Fault):
                self._refuse(stop.value, self.heard_ns)
            else:
                self._finish(stop.value)

    def _compare(self, response: SdoResponse) -> None:
        """Take the node out of service if a setting differs or is unreadable."""
        found = self._read_back.take(response)
        self.busy = isinstance(found, Request)
        if isinstance(found, Request):
            self._sdo.start(found)
        elif found is not None:
            self._refuse(found, self.heard_ns)

    def _refuse(self, fault: Fault, now_ns: int) -> None:
        """Keep the node out of service and say why; try again later."""
        self.phase = NodePhase.REFUSED
        self.busy = True
        self._wait_until_ns = now_ns + RETRY_NS
        self._say(fault)

    def _finish(self, kept: tuple[Setting, ...]) -> None:
        """Put the node into service; `kept` must stay as it is."""
        self.phase = NodePhase.READY
        self.busy = False
        self._read_back.begin(kept)
        self._say(None)

    def _stop_script(self) -> None:
        """Drop the transfer in progress."""
        self._sdo.cancel()
        self._extra = None
        self._read_back.is_reading = False
        if self._script is not None:
            self._script.close()
            self._script = None

    def _nmt_command(self) -> int:
        """Return the NMT command of the present phase."""
        return (
            NmtCommand.ENTER_PRE_OPERATIONAL if self.phase is NodePhase.WAKING else NmtCommand.START
        )

    def _nmt_target(self) -> str:
        """Return the target NMT state, as text."""
        return "pre-operational" if self.phase is NodePhase.WAKING else "operational"
