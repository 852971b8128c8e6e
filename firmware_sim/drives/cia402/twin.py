"""A drive of CiA 402 on the bus: NMT, SDO, PDOs, emergency messages, supervision of the host."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from firmware_sim.bus.frame import REMOTE_FLAG
from firmware_sim.drives.cia402.axes import Axes, Units
from firmware_sim.drives.cia402.objects import (
    RPDO_BASES,
    indices,
    objects_of,
)
from firmware_sim.drives.cia402.pdo import Pdos
from firmware_sim.drives.cia402.settings import Cia402Settings
from firmware_sim.drives.cia402.state import PowerAxis, State
from firmware_sim.drives.twin import NEVER_NS, Motor, Twin, stored
from firmware_sim.nodes.object_dictionary import ObjectDictionary
from firmware_sim.nodes.parameter_store import ParameterStore
from firmware_sim.nodes.power_stage import PowerStage
from firmware_sim.nodes.sdo_server import SdoServer
from firmware_sim.nodes.variables import AbortCode, SdoAbortError

MS: Final = 1_000_000
NMT, SYNC, EMERGENCY_BASE = 0x000, 0x080, 0x080
SDO_RESPONSE_BASE, SDO_REQUEST_BASE, HEARTBEAT_BASE = 0x580, 0x600, 0x700
INITIALISING, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0, 4, 5, 127
START, STOP, TO_PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION = 1, 2, 128, 129, 130
HEARTBEAT_LOST, PDO_TOO_SHORT = 0x8130, 0x8210
SIGNATURE_SAVE: Final = 0x65766173

_ABORT_FAULT, _ABORT_DISABLE, _ABORT_QUICK_STOP = 1, 2, 3
"""Actions of the abort connection option code, 6007h."""
_TO_PRE_OPERATIONAL, _TO_STOPPED = 0, 2
"""Error behaviours, 1029h."""
_CURRENT_SHARE: Final = 1.25
"""Multiple of the current limit at which a motor's current is a fault."""
_OVER_CURRENT: Final = {"generic": 0x2310, "zlac8015d": 0x0004, "roboteq": 0x0008}
_OVER_TEMPERATURE: Final = {"generic": 0x4310, "zlac8015d": 0x0400, "roboteq": 0x0001}
"""Error codes of the dialects."""


class Cia402Twin(Twin):
    """A drive of CiA 402.

    Parameters
    ----------
    name
        Name of the drive.
    dialect
        "generic", "zlac8015d" or "roboteq".
    node_id
        Its true node id.
    units
        Its true units.
    motors, ratios
        Its motors, and the motor turns per wheel turn, > 0; None: an axis without a motor.
    settings
        Other true properties.
    stage, run_to, store
        Power stage, clock of the plant, and non-volatile memory.
    """

    def __init__(
        self,
        name: str,
        dialect: str,
        node_id: int,
        units: Units,
        motors: Sequence[Motor],
        ratios: Sequence[float],
        settings: Cia402Settings,
        stage: PowerStage,
        run_to: Callable[[int], int],
        store: ParameterStore,
    ) -> None:
        super().__init__(name, run_to)
        self.node_id = node_id
        self._is_zlac = dialect == "zlac8015d"
        self._has_off_line_time = self._is_zlac or settings.off_line_ms > 0.0
        self._dialect = dialect
        self._settings = settings
        self._store = store
        self.nmt_state = INITIALISING
        objects = tuple(objects_of(dialect, node_id, len(motors), settings))
        self._indices = indices(objects)
        self.dictionary = ObjectDictionary(objects)
        self._sdo = SdoServer(self.dictionary)
        self._sdo_free_ns = 0
        self._pdos = Pdos(
            self.dictionary,
            self.send,
            MS // 2 if self._is_zlac else MS,
            lambda: self._emergency(PDO_TOO_SHORT),
        )
        self.axes = Axes(
            dialect,
            units,
            motors,
            ratios,
            settings,
            self.dictionary,
            self._indices,
            stage,
            self._at_motors,
        ).axes
        self._boot_ns = self._heartbeat_ns = NEVER_NS
        self._lost_ns = NEVER_NS
        """Time at which the host is lost [ns]: by heartbeat, node guarding, or off-line time."""
        self._look_ns = 0
        """Time of the next check of a stop [ns]."""
        self._toggle = 0
        self._words: list[int] = []
        self._endangered: set[PowerAxis] = set()
        """Axes whose current or temperature is a fault."""
        self._connect()

    def _connect(self) -> None:
        """Give frames and objects their handlers."""
        node_id = self.node_id
        self._handlers = {
            NMT: self._on_nmt,
            SYNC: self._on_sync,
            SDO_REQUEST_BASE + node_id: self._on_sdo,
            HEARTBEAT_BASE + node_id | REMOTE_FLAG: self._on_guard,
        }
        for base in RPDO_BASES:
            self._handlers[base + node_id] = self._pdo_handler(base + node_id)
        if 0x1016 in self._indices:
            for other in range(1, 128):
                if other != node_id:
                    self._handlers[HEARTBEAT_BASE + other] = self._beat_handler(other)
        self._connect_objects()

    def _connect_objects(self) -> None:
        """Connect the objects to the state that they show."""
        dictionary = self.dictionary
        dictionary.on_write(0x1017, 0, self._set_heartbeat)
        dictionary.on_write(0x1010, 1, self._save)
        for index in (each for each in self._indices if 0x1400 <= each < 0x1C00):
            for sub in range(6):
                dictionary.on_write(index, sub, self._note_pdo)
        if self._is_zlac:
            dictionary.on_write(0x2010, 0, self._save_all)

    def _note_pdo(self, _: int) -> None:
        self._pdos.is_stale = True

    def _set_heartbeat(self, period_ms: int) -> None:
        self.dictionary.set(0x1017, 0, period_ms)
        self._heartbeat_ns = self._now_ns + period_ms * MS if period_ms else NEVER_NS

    def _save(self, signature: int) -> None:
        if signature != SIGNATURE_SAVE:
            raise SdoAbortError(AbortCode.TRANSFER)
        self._store.save(self.dictionary.stored())

    def _save_all(self, wanted: int) -> None:
        if wanted:
            self._store.save(self.dictionary.stored())

    # Faults and power, for tests and scenarios --------------------------------------------------

    def trip(self, code: int, axis: int = 0) -> None:
        """Raise a fault of an axis, with its error code."""
        self._at_motors()
        self.axes[axis].fault(code)
        self._emergency(code)
        self._changed()
        self._reschedule()

    def heal(self) -> None:
        """Remove the causes of all faults."""
        for axis in self.axes:
            axis.has_cause = False
            if self._settings.heals and axis.state is State.FAULT:
                axis.error = 0
                axis.state = State.SWITCH_ON_DISABLED
        self._changed()
        self._reschedule()

    # Frames -------------------------------------------------------------------------------------

    def _at_motors(self) -> None:
        self._run_to(self._now_ns)

    def _on_power_up(self, now_ns: int) -> None:
        self.dictionary.reset()
        self.dictionary.restore(stored(self._store))
        self._sdo.reset()
        self.nmt_state = INITIALISING
        self._boot_ns = now_ns + round(self._settings.boot_ms * MS)
        self._heartbeat_ns = self._lost_ns = NEVER_NS
        self._toggle = 0
        self._pdos.is_stale = True
        for axis in self.axes:
            axis.power_up()

    def _on_nmt(self, data: bytes, now_ns: int) -> None:
        if len(data) != 2 or data[1] not in {0, self.node_id} or self.nmt_state == INITIALISING:
            return
        command = data[0]
        if command in (RESET_NODE, RESET_COMMUNICATION):
            self._at_motors()
            self._on_power_up(now_ns)
        elif command == START:
            self.nmt_state = OPERATIONAL
            self._pdos.refresh(now_ns)
            self._changed()
        elif command == STOP:
            self._leave(STOPPED)
        elif command == TO_PRE_OPERATIONAL:
            self._leave(PRE_OPERATIONAL)
        self._heard(is_command=False)

    def _leave(self, state: int) -> None:
        """Leave operational; stopping aborts the connection (CiA 402-2, 6007h)."""
        self.nmt_state = state
        if state == STOPPED:
            self._at_motors()
            self._abort_connection(self._reaction())

    def _on_sdo(self, data: bytes, now_ns: int) -> None:
        if self.nmt_state not in (PRE_OPERATIONAL, OPERATIONAL):
            return
        self._heard(is_command=False)
        self._at_motors()
        too_soon = now_ns < self._sdo_free_ns
        self._sdo_free_ns = now_ns + round(self._settings.sdo_pause_ms * MS)
        if too_soon:
            return
        response = self._sdo.respond(data)
        if response is not None:
            self.send(SDO_RESPONSE_BASE + self.node_id, response)
        if self._pdos.is_stale and self.nmt_state == OPERATIONAL:
            self._pdos.refresh(now_ns)
        self._changed()

    def _pdo_handler(self, identifier: int) -> Callable[[bytes, int], None]:
        def handle(data: bytes, _: int) -> None:
            if self.nmt_state == OPERATIONAL:
                self._heard(is_command=True)
                if self._pdos.on_frame(identifier, data):
                    self._changed()

        return handle

    def _on_sync(self, _data: bytes, _now_ns: int) -> None:
        if self.nmt_state == OPERATIONAL:
            self._heard(is_command=False)
            self._at_motors()
            self._guard()
            self._pdos.on_sync()

    def _beat_handler(self, node_id: int) -> Callable[[bytes, int], None]:
        def handle(_data: bytes, now_ns: int) -> None:
            consumer = self.dictionary.number(0x1016, 1)
            if consumer >> 16 & 0x7F == node_id and consumer & 0xFFFF:
                self._lost_ns = now_ns + (consumer & 0xFFFF) * MS

        return handle

    def _on_guard(self, _data: bytes, now_ns: int) -> None:
        if self.dictionary.number(0x1017):
            return  # heartbeat or node guarding, not both (CiA 301, 7.2.8.2)
        self.send(HEARTBEAT_BASE + self.node_id, bytes((self.nmt_state | self._toggle,)))
        self._toggle ^= 0x80
        if 0x100C in self._indices:
            number = self.dictionary.number
            life_ms = number(0x100C) * number(0x100D)
            self._lost_ns = now_ns + life_ms * MS if life_ms else self._lost_ns

    def _heard(self, *, is_command: bool) -> None:
        """Restart the off-line time of a drive that has one."""
        settings = self._settings
        if not self._has_off_line_time:
            return
        if is_command or settings.off_line_frames == "all":
            time_ms = settings.off_line_ms or self.dictionary.number(0x2000)
            self._lost_ns = self._now_ns + round(time_ms * MS) if time_ms else NEVER_NS

    # Time ---------------------------------------------------------------------------------------

    def _step(self, now_ns: int) -> None:
        self._at_motors()
        if now_ns >= self._boot_ns:
            self._boot_ns = NEVER_NS
            self.nmt_state = PRE_OPERATIONAL
            for axis in self.axes:
                axis.initialise()
            self.send(HEARTBEAT_BASE + self.node_id, b"\0")
            self._set_heartbeat(self.dictionary.number(0x1017))
        if now_ns >= self._heartbeat_ns:
            self._heartbeat_ns += self.dictionary.number(0x1017) * MS
            self.send(HEARTBEAT_BASE + self.node_id, bytes((self.nmt_state,)))
        if now_ns >= self._lost_ns:
            self._lost_ns = NEVER_NS
            self._lose_host()
        self._guard()
        self._look_ns = now_ns + MS
        for axis in self.axes:
            axis.step(now_ns)
        if self.nmt_state == OPERATIONAL:
            self._pdos.step(now_ns)
        self._changed()

    def _guard(self) -> None:
        """Check current and temperature of the motors."""
        settings = self._settings
        for axis in self.axes:
            code = 0
            if abs(axis.motor.current_a) > _CURRENT_SHARE * settings.current_limit_a:
                code = _OVER_CURRENT[self._dialect]
            elif axis.motor.temperature_c > settings.motor_max_c:
                code = _OVER_TEMPERATURE[self._dialect]
            if code and not axis.error:
                axis.fault(code)
                self._emergency(code)
                self._endangered.add(axis)
            elif not code and axis in self._endangered:
                axis.has_cause = False
                self._endangered.discard(axis)

    def _due_ns(self) -> int:
        due_ns = min(self._boot_ns, self._heartbeat_ns, self._lost_ns)
        if self.nmt_state == OPERATIONAL:
            due_ns = min(due_ns, self._pdos.due_ns)
        if any(axis.is_stopping for axis in self.axes):
            due_ns = min(due_ns, self._look_ns)
        return due_ns

    def _changed(self) -> None:
        """Send the event-driven PDOs whose status word changed."""
        words = [axis.status_word & 0x6F for axis in self.axes]
        if words != self._words:
            self._words = words
            if self.nmt_state == OPERATIONAL:
                self._pdos.on_change()

    # The host is lost ---------------------------------------------------------------------------

    def _lose_host(self) -> None:
        """React to a host that was silent for too long."""
        if self._has_off_line_time:
            self._end_off_line_time()
            return
        self._emergency(HEARTBEAT_LOST)
        behaviour = self.dictionary.number(0x1029, 1) if 0x1029 in self._indices else 0
        if self.nmt_state == OPERATIONAL and behaviour in (_TO_PRE_OPERATIONAL, _TO_STOPPED):
            self.nmt_state = PRE_OPERATIONAL if behaviour == _TO_PRE_OPERATIONAL else STOPPED
        self._abort_connection(self._reaction())

    def _reaction(self) -> int:
        """Return the action of 6007h, or the true one of a drive without it."""
        if 0x6007 in self._indices:
            return self.dictionary.number(0x6007)
        lost = self._settings.lost_reaction
        return {"none": 0, "coast": _ABORT_DISABLE, "brake": _ABORT_QUICK_STOP}[lost]

    def _abort_connection(self, action: int) -> None:
        for axis in self.axes:
            if action == _ABORT_FAULT:
                axis.fault(HEARTBEAT_LOST)
                axis.has_cause = False
            elif action == _ABORT_DISABLE:
                axis.release()
            elif action == _ABORT_QUICK_STOP and axis.state is State.OPERATION_ENABLED:
                axis.quick_stop()

    def _end_off_line_time(self) -> None:
        for axis in self.axes:
            match self._settings.off_line_reaction:
                case "brake":
                    axis.brake()
                case "coast":
                    axis.release()
                case "fault":
                    axis.fault(0x0040)
                    axis.has_cause = False

    def _emergency(self, code: int) -> None:
        """Send an emergency message."""
        if self.nmt_state in (PRE_OPERATIONAL, OPERATIONAL):
            data = code.to_bytes(2, "little") + b"\x01" + bytes(5)
            self.send(EMERGENCY_BASE + self.node_id, data)
