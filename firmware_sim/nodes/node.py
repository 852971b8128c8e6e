"""Common parts of all nodes: NMT, boot-up, heartbeat, EMCY, SDO, stored parameters (CiA 301).

A node receives every frame at its exact time (`on_frame`), and sets its alarm to be woken at an
exact time (`wake`). Its own clock (`clock`) determines its periods.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from typing import NamedTuple, Protocol

from firmware_sim.nodes import standard_objects as objects
from firmware_sim.nodes import wire
from firmware_sim.nodes.clock import LocalClock
from firmware_sim.nodes.object_dictionary import ObjectDictionary
from firmware_sim.nodes.parameter_store import MemoryStore, ParameterStore, StoreDamagedError
from firmware_sim.nodes.sdo_server import SdoServer
from firmware_sim.nodes.variables import AbortCode, SdoAbortError

MILLISECOND_NS = 1_000_000
NEVER_NS = 1 << 62
"""A time that does not come (146 years)."""

BOOT_NS = 5 * MILLISECOND_NS
"""Time from power-up to the boot-up message of node 1; each further node takes 1 ms longer."""

COMMANDED_NS = 500 * MILLISECOND_NS
"""Time after a command that enables the motors during which nodes refuse writes."""


class CanFrame(Protocol):
    """A received frame; `stamp_ns` is the time of its completion on the bus."""

    @property
    def arbitration_id(self) -> int:
        """Identifier, with the flags of `firmware_sim.bus.frame`."""

    @property
    def data(self) -> bytes:
        """Payload."""

    @property
    def stamp_ns(self) -> int:
        """Time of reception [ns]."""


class CanPort(Protocol):
    """Port of a node or a twin on its bus."""

    def send(self, arbitration_id: int, data: bytes) -> object:
        """Queue one frame at the bus's present time."""


class Alarm(Protocol):
    """An alarm clock."""

    def __call__(self, due_ns: int, node: Node) -> object:
        """Have `node.wake` called at `due_ns` [ns]."""


class NmtState(enum.IntEnum):
    """NMT states as the heartbeat carries them."""

    INITIALISING = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


class NmtCommand(enum.IntEnum):
    """NMT node control commands."""

    START = 1
    STOP = 2
    ENTER_PRE_OPERATIONAL = 128
    RESET_NODE = 129
    RESET_COMMUNICATION = 130


class Trouble(NamedTuple):
    """One kind of error: its EMCY code and its bits of the error register."""

    code: int
    register: int


GENERIC = 0x01
"""Bit of the error register that is set while there is any error."""

PARAMETERS_LOST = Trouble(0x6310, GENERIC)
NO_TROUBLE = 0x0000


class Node:
    """Base of the simulated CANopen nodes.

    Parameters
    ----------
    node_id
        1..127.
    name
        Short name, also of the file with its stored parameters.
    dictionary
        Its object dictionary, with at least the standard objects.
    store
        Its non-volatile memory.
    """

    def __init__(
        self,
        node_id: int,
        name: str,
        dictionary: ObjectDictionary,
        store: ParameterStore | None = None,
    ) -> None:
        self.node_id = node_id
        self.name = name
        self.dictionary = dictionary
        self.state = NmtState.INITIALISING
        self.next_due_ns = NEVER_NS
        self.clock = LocalClock()
        self._store = MemoryStore() if store is None else store
        self._port: CanPort | None = None
        self._alarm: Alarm | None = None
        self._alarm_ns = NEVER_NS
        self._sdo = SdoServer(dictionary)
        self._now_ns = 0
        self._boot_ns = NEVER_NS
        self._heartbeat_ns = NEVER_NS
        self._troubles: list[Trouble] = []
        self._history: list[int] = []
        self._parameters_lost = False
        self._powered_ns = -NEVER_NS
        self._handlers: dict[int, Callable[[bytes, int], None]] = {
            wire.NMT: self._on_nmt,
            wire.SDO_REQUEST_BASE + node_id: self._on_sdo,
            wire.MOTOR_COMMAND: self._on_motor_command,
        }
        self._connect_dictionary()

    @property
    def arbitration_ids(self) -> tuple[int, ...]:
        """Identifiers this node listens to (its acceptance filter)."""
        return tuple(self._handlers)

    def connect(self, port: CanPort, alarm: Alarm) -> None:
        """Connect the node to its port and its alarm clock."""
        self._port = port
        self._alarm = alarm
        self._alarm_ns = NEVER_NS

    def power_cycle(self, now_ns: int) -> None:
        """Switch the supply off and on: all but stored parameters is lost."""
        self._now_ns = now_ns
        self.clock.reset(now_ns)
        self._troubles = []
        self._history = []
        self._boot(now_ns)

    def on_frame(self, frame: CanFrame) -> None:
        """Take one frame from the bus."""
        handler = self._handlers.get(frame.arbitration_id)
        if handler is not None:
            self._now_ns = now_ns = frame.stamp_ns
            handler(frame.data, now_ns)

    def wake(self, now_ns: int) -> None:
        """Take an alarm at `now_ns` [ns]; one that has been overtaken does nothing."""
        if now_ns < self._alarm_ns:
            return
        self._alarm_ns = NEVER_NS
        if now_ns >= self.next_due_ns:
            self.step(now_ns)
        else:
            self._reschedule()

    def step(self, now_ns: int) -> None:
        """Do the work due at `now_ns` [ns], then update `next_due_ns`."""
        self._now_ns = now_ns
        if now_ns >= self._boot_ns:
            self._finish_boot(now_ns)
        if now_ns >= self._heartbeat_ns:
            self.send(wire.HEARTBEAT_BASE + self.node_id, bytes((self.state,)))
            self._schedule_heartbeat(self._heartbeat_ns)
        self._step(now_ns)
        self._reschedule()

    def send(self, arbitration_id: int, data: bytes) -> None:
        """Send one frame if the node is on a bus."""
        if self._port is not None:
            self._port.send(arbitration_id, data)

    def send_image(self, arbitration_id: int, image: int, data: bytes) -> None:
        """Send a PDO, and store it as the value of the object that it maps."""
        self.dictionary.set(image, 0, int.from_bytes(data, "little"))
        self.send(arbitration_id, data)

    # What a kind of node adds -------------------------------------------------------------------

    def _on_power_up(self) -> None:
        """Restart after loss of power or a warm reset, before the boot-up message."""

    def _on_nmt_change(self) -> None:
        """React to a new NMT state."""

    def _on_restore_failed(self) -> None:
        """React to stored parameters that were damaged."""

    def _on_stored(self) -> None:
        """React to newly stored parameters, or to a stored restore of defaults."""

    def _step(self, now_ns: int) -> None:
        """Do the work due now."""

    def _due_ns(self) -> int:
        """Return the next time for `_step` [ns]."""
        return NEVER_NS

    def _on_motor_command(self, data: bytes, now_ns: int) -> None:
        """Note whether the motors are commanded to turn."""
        if len(data) == 8:
            self._powered_ns = now_ns if data[1] & wire.ENABLE else -NEVER_NS

    def _is_locked(self) -> bool:
        """Return whether writes to the dictionary are refused: the robot is powered."""
        return self._now_ns - self._powered_ns < COMMANDED_NS

    # NMT ----------------------------------------------------------------------------------------

    def _boot(self, now_ns: int) -> None:
        self.state = NmtState.INITIALISING
        self._sdo.reset()
        self._heartbeat_ns = NEVER_NS
        self._boot_ns = now_ns + BOOT_NS + (self.node_id - 1) * MILLISECOND_NS
        self._load_parameters()
        self._on_power_up()
        self._reschedule()

    def _load_parameters(self) -> None:
        self.dictionary.reset()
        self._parameters_lost = False
        try:
            self.dictionary.restore(self._store.load())
        except (StoreDamagedError, ValueError):
            self.dictionary.reset()
            self._parameters_lost = True

    def _finish_boot(self, now_ns: int) -> None:
        self._boot_ns = NEVER_NS
        self.send(wire.HEARTBEAT_BASE + self.node_id, b"\0")
        self.state = NmtState.PRE_OPERATIONAL
        self._schedule_heartbeat(now_ns)
        for trouble in self._troubles:
            self._send_emergency(trouble.code)
        if self._parameters_lost:
            self._on_restore_failed()
            self.report(PARAMETERS_LOST)

    def _on_nmt(self, data: bytes, now_ns: int) -> None:
        if len(data) != 2 or data[1] not in {0, self.node_id} or self._boot_ns != NEVER_NS:
            return
        command = data[0]
        if command in {NmtCommand.RESET_NODE, NmtCommand.RESET_COMMUNICATION}:
            self._boot(now_ns)
            return
        state = _NMT_TARGET.get(command)
        if state is None or state is self.state:
            return
        self.state = state
        self._sdo.reset()
        self._on_nmt_change()
        self._reschedule()

    def _schedule_heartbeat(self, from_ns: int) -> None:
        period_ms = self.dictionary.number(objects.HEARTBEAT_TIME)
        period_ns = self.clock.span_ns(period_ms * MILLISECOND_NS)
        self._heartbeat_ns = from_ns + period_ns if period_ms else NEVER_NS

    def _reschedule(self) -> None:
        due_ns = min(self._boot_ns, self._heartbeat_ns, self._due_ns())
        self.next_due_ns = due_ns
        if due_ns < self._alarm_ns and self._alarm is not None:
            self._alarm_ns = due_ns
            self._alarm(due_ns, self)

    # Errors -------------------------------------------------------------------------------------

    @property
    def error_register(self) -> int:
        """Object 0x1001."""
        register = GENERIC if self._troubles else 0
        for trouble in self._troubles:
            register |= trouble.register
        return register

    def report(self, trouble: Trouble, detail: bytes = b"") -> None:
        """Note a new error and report it on the bus, unless it is already present."""
        if trouble in self._troubles:
            return
        self._troubles.append(trouble)
        self._history.insert(0, trouble.code | int.from_bytes(detail[:2], "little") << 16)
        del self._history[objects.ERROR_FIELD_LENGTH :]
        self._send_emergency(trouble.code, detail)

    def retract(self, *troubles: Trouble) -> None:
        """Clear errors that are over; report it on the bus (code 0) if one was present."""
        left = [each for each in self._troubles if each not in troubles]
        if len(left) != len(self._troubles):
            self._troubles = left
            self._send_emergency(NO_TROUBLE)

    def _send_emergency(self, code: int, detail: bytes = b"") -> None:
        if self.state in _TALKING:
            self.send(
                wire.EMERGENCY_BASE + self.node_id,
                wire.emergency(code, self.error_register, detail),
            )

    # Dictionary ---------------------------------------------------------------------------------

    def _on_sdo(self, data: bytes, _now_ns: int) -> None:
        if self.state not in _TALKING:
            return
        response = self._sdo.respond(data)
        if response is not None:
            self.send(wire.SDO_RESPONSE_BASE + self.node_id, response)
        self._reschedule()

    def _connect_dictionary(self) -> None:
        dictionary = self.dictionary
        dictionary.is_locked = self._is_locked
        dictionary.on_read(objects.ERROR_REGISTER, 0, lambda: self.error_register)
        dictionary.on_read(objects.ERROR_FIELD, 0, lambda: len(self._history))
        for number in range(objects.ERROR_FIELD_LENGTH):
            dictionary.on_read(objects.ERROR_FIELD, number + 1, self._history_reader(number))
        dictionary.on_write(objects.ERROR_FIELD, 0, self._clear_history)
        dictionary.on_read(objects.STORE, 1, lambda: 1)
        dictionary.on_read(objects.RESTORE, 1, lambda: 1)
        dictionary.on_write(objects.STORE, 1, self._save_parameters)
        dictionary.on_write(objects.RESTORE, 1, self._restore_defaults)
        dictionary.on_write(objects.HEARTBEAT_TIME, 0, self._change_heartbeat)

    def _history_reader(self, number: int) -> Callable[[], int]:
        def read() -> int:
            if number >= len(self._history):
                raise SdoAbortError(AbortCode.NO_DATA)
            return self._history[number]

        return read

    def _clear_history(self, value: int) -> None:
        if value != 0:
            raise SdoAbortError(AbortCode.RANGE)
        self._history = []

    def _change_heartbeat(self, period_ms: int) -> None:
        self.dictionary.set(objects.HEARTBEAT_TIME, 0, period_ms)
        self._schedule_heartbeat(self._now_ns)

    def _save_parameters(self, signature: int) -> None:
        if signature != objects.SIGNATURE_SAVE:
            raise SdoAbortError(AbortCode.TRANSFER)
        try:
            self._store.save(self.dictionary.stored())
        except OSError:
            raise SdoAbortError(AbortCode.HARDWARE) from None
        self._accept_stored()

    def _restore_defaults(self, signature: int) -> None:
        if signature != objects.SIGNATURE_LOAD:
            raise SdoAbortError(AbortCode.TRANSFER)
        try:
            self._store.clear()
        except OSError:
            raise SdoAbortError(AbortCode.HARDWARE) from None
        self._accept_stored()

    def _accept_stored(self) -> None:
        self._parameters_lost = False
        self._on_stored()
        self.retract(PARAMETERS_LOST)


_TALKING = frozenset({NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL})
"""States in which EMCY and SDO are allowed (CiA 301, table 38)."""

_NMT_TARGET = {
    int(NmtCommand.START): NmtState.OPERATIONAL,
    int(NmtCommand.STOP): NmtState.STOPPED,
    int(NmtCommand.ENTER_PRE_OPERATIONAL): NmtState.PRE_OPERATIONAL,
}
