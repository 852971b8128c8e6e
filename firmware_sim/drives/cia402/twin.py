"""A drive of CiA 402 on the bus: NMT, SDO, PDOs, emergency messages, and who it listens for."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final, NamedTuple

from firmware_sim.bus.frame import REMOTE_FLAG
from firmware_sim.drives.cia402.objects import (
    AXIS_OFFSET,
    RPDO_BASES,
    indices,
    objects_of,
)
from firmware_sim.drives.cia402.pdo import Pdos
from firmware_sim.drives.cia402.settings import Cia402Settings
from firmware_sim.drives.cia402.state import STAYS, Options, PowerAxis, Ramps, State
from firmware_sim.drives.twin import NEVER_NS, Motor, Twin
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
_TURN: Final = 2.0 * math.pi


class Units(NamedTuple):
    """Units of a drive.

    Attributes
    ----------
    counts_per_turn
        Position units in one turn of the motor.
    target, actual
        Velocity units for 1 rad/s of the motor.
    """

    counts_per_turn: int
    target: float
    actual: float


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
        Its motors, and turns of each for one of its wheel, > 0; None: an axis without a motor.
    settings
        What else is true of it.
    stage, run_to, store
        The supply, the plant's clock, and its non-volatile memory.
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
        self._units = units
        self._settings = settings
        self._stage = stage
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
        self.axes = [
            PowerAxis(
                motor,
                ratio,
                settings.current_limit_a,
                self._speed_max(),
                partial(self._options, axis),
                partial(self._ramps, axis),
            )
            for axis, (motor, ratio) in enumerate(zip(motors, ratios, strict=True))
        ]
        self._boot_ns = self._heartbeat_ns = NEVER_NS
        self._lost_ns = NEVER_NS
        """When the host counts as lost [ns]: by heartbeat, node guarding, or off-line time."""
        self._look_ns = 0
        """When a stop is looked at next [ns]."""
        self._toggle = 0
        self._words: list[int] = []
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
        """Connect the objects to what they stand for."""
        dictionary = self.dictionary
        dictionary.on_write(0x1017, 0, self._set_heartbeat)
        dictionary.on_write(0x1010, 1, self._save)
        for index in (each for each in self._indices if 0x1400 <= each < 0x1C00):
            for sub in range(6):
                dictionary.on_write(index, sub, self._note_pdo)
        for axis in range(len(self.axes)):
            if self._is_zlac:
                self._connect_half(axis)
            else:
                self._connect_axis(axis)
        if self._is_zlac:
            self._connect_zlac()
        elif self._dialect == "roboteq":
            self._connect_roboteq()
        if 0x6079 in self._indices:
            dictionary.on_read(0x6079, 0, lambda: round(1000.0 * self._stage.bus_voltage_v))

    # Objects ------------------------------------------------------------------------------------

    def _connect_axis(self, number: int) -> None:
        """Connect the objects of an axis as the standard has them."""
        offset, axis, dictionary = AXIS_OFFSET * number, self.axes[number], self.dictionary
        read, write = dictionary.on_read, dictionary.on_write
        per_rad, per_turn = self._units.actual, self._units.counts_per_turn
        rpm_per_rad = 60.0 / _TURN
        read(0x603F + offset, 0, lambda: axis.error)
        read(0x6041 + offset, 0, lambda: axis.status_word)
        read(0x6044 + offset, 0, lambda: _fit(axis.motor.speed_rad_s * rpm_per_rad, 16))
        read(0x6061 + offset, 0, lambda: dictionary.number(0x6060 + offset))
        read(0x6064 + offset, 0, lambda: _wrap(axis.motor.encoder_count(per_turn), 32))
        read(0x606C + offset, 0, lambda: _fit(axis.motor.speed_rad_s * per_rad, 32))
        rated_a = self._settings.rated_current_a
        read(0x6078 + offset, 0, lambda: _fit(1000.0 * axis.motor.current_a / rated_a, 16))
        write(0x6040 + offset, 0, lambda word: self._control([axis], word))

        def turn(index: int, unit: float) -> None:
            def target(value: int) -> None:
                is_mode = dictionary.number(0x6060 + offset) == (2 if index == 0x6042 else 3)
                if is_mode:
                    axis.target_rad_s = value / unit
                    self._at_motors()
                    axis.drive()

            write(index + offset, 0, target)

        turn(0x60FF, self._units.target)
        turn(0x6042, rpm_per_rad)
        for index in (0x605A, 0x605E):
            write(index + offset, 0, self._check_option)

    def _check_option(self, value: int) -> None:
        if value not in self._settings.stop_options:
            raise SdoAbortError(AbortCode.RANGE)

    def _connect_half(self, number: int) -> None:
        """Connect the objects of one wheel of a ZLAC8015D."""
        axis, sub, read = self.axes[number], number + 1, self.dictionary.on_read
        per_turn = self._units.counts_per_turn
        read(0x6064, sub, lambda: _wrap(axis.motor.encoder_count(per_turn), 32))
        read(0x606C, sub, lambda: _fit(axis.motor.speed_rad_s * self._units.actual, 32))
        read(0x6077, sub, lambda: _fit(10.0 * axis.motor.current_a, 16))
        read(0x2032, sub, lambda: max(0, round(10.0 * axis.motor.axis.temperature_c)))
        self.dictionary.on_write(0x60FF, sub, lambda value: self._turn(axis, value))

    def _connect_zlac(self) -> None:
        """Connect what both wheels of a ZLAC8015D share: left is the low half."""
        read, write, axes = self.dictionary.on_read, self.dictionary.on_write, self.axes
        read(0x603F, 0, lambda: _halves([axis.error for axis in axes]))
        read(0x6041, 0, lambda: _halves([axis.status_word for axis in axes]))
        read(0x6061, 0, lambda: self.dictionary.number(0x6060))
        read(0x6077, 3, lambda: _halves([_fit(10.0 * a.motor.current_a, 16) for a in axes]))
        read(0x2035, 0, lambda: round(100.0 * self._stage.bus_voltage_v))
        write(0x6040, 0, lambda word: self._control(axes, word))
        write(
            0x2010, 0, lambda value: self._store.save(self.dictionary.stored()) if value else None
        )

        def both(value: int) -> None:
            for axis, half in zip(axes, (value & 0xFFFF, value >> 16), strict=False):
                self._turn(axis, _wrap(half, 16))

        write(0x60FF, 3, both)

    def _connect_roboteq(self) -> None:
        read, axes = self.dictionary.on_read, self.axes
        for number, axis in enumerate(axes):
            read(0x2100, number + 1, partial(_current, axis.motor, 0.1))
        read(0x210D, 2, lambda: round(10.0 * self._stage.bus_voltage_v))
        read(0x210F, 2, lambda: _fit(axes[0].motor.axis.temperature_c, 8))
        read(0x2112, 0, lambda: max(axis.error for axis in axes))

    def _turn(self, axis: PowerAxis, value: int) -> None:
        if self.dictionary.number(0x6060) == 3:
            axis.target_rad_s = value / self._units.target
            self._at_motors()
            axis.drive()

    def _control(self, axes: Sequence[PowerAxis], word: int) -> None:
        self._at_motors()
        for axis in axes:
            axis.control(word)

    def _options(self, axis: int) -> Options:
        """Return the stop options; a drive without one of them keeps its maker's default."""
        number, offset = self.dictionary.number, 0 if self._is_zlac else AXIS_OFFSET * axis
        default = Options(quick_stop=self._settings.quick_stop, fault=self._settings.fault_stop)
        found = {
            index: number(index + offset) if index + offset in self._indices else fallback
            for index, fallback in (
                (0x605A, default.quick_stop),
                (0x605B, default.shutdown),
                (0x605C, default.disable),
                (0x605D, default.halt),
                (0x605E, default.fault),
            )
        }
        fault = min(found[0x605E], STAYS)
        return Options(found[0x605A], found[0x605B], found[0x605C], found[0x605D], fault)

    def _ramps(self, axis: int, target_rad_s: float) -> Ramps:
        """Return the ramps of an axis for a target speed [rad/s^2]."""
        number = self.dictionary.number
        if self._is_zlac:
            change = abs(target_rad_s - self.axes[axis].motor.speed_rad_s)
            span = self._speed_max() if self._settings.ramps_are_full_scale else max(change, 0.1)
            times_ms = [max(1, number(index, axis + 1)) for index in (0x6083, 0x6084, 0x6085)]
            return Ramps(*(span * 1000.0 / time_ms for time_ms in times_ms))
        offset = AXIS_OFFSET * axis
        if number(0x6060 + offset) == 2:
            rates = [
                number(index + offset, 1) / max(1, number(index + offset, 2)) * _TURN / 60.0
                for index in (0x6048, 0x6049, 0x604A)
            ]
        else:
            rates = [number(i + offset) / self._units.target for i in (0x6083, 0x6084, 0x6085)]
        return Ramps(*(max(rate, 0.1) for rate in rates))

    def _speed_max(self) -> float:
        top = self._settings.speed_max_rad_s
        return min(top, 1000.0 / self._units.target) if self._is_zlac else top

    def _note_pdo(self, _: int) -> None:
        self._pdos.is_stale = True

    def _set_heartbeat(self, period_ms: int) -> None:
        self.dictionary.set(0x1017, 0, period_ms)
        self._heartbeat_ns = self._now_ns + period_ms * MS if period_ms else NEVER_NS

    def _save(self, signature: int) -> None:
        if signature != SIGNATURE_SAVE:
            raise SdoAbortError(AbortCode.TRANSFER)
        self._store.save(self.dictionary.stored())

    # Faults and power, for tests and scenarios --------------------------------------------------

    def trip(self, code: int, axis: int = 0) -> None:
        """Let an axis have a fault, with its error code."""
        self._at_motors()
        self.axes[axis].fault(code)
        self._emergency(code)
        self._changed()
        self._reschedule()

    def heal(self) -> None:
        """Let the causes of all faults be over."""
        for axis in self.axes:
            axis.has_cause = False
            if self._settings.heals and axis.state is State.FAULT:
                axis.error = 0
                axis.state = State.SWITCH_ON_DISABLED
        self._changed()
        self._reschedule()

    def reboot(self, now_ns: int) -> None:
        """Restart, as after a short loss of its supply."""
        self.power_cycle(now_ns)

    # Frames -------------------------------------------------------------------------------------

    def _at_motors(self) -> None:
        self._run_to(self._now_ns)

    def _on_power_up(self, now_ns: int) -> None:
        self.dictionary.reset()
        self.dictionary.restore(self._store.load())
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
        """Leave operational: in stopped the connection is aborted (CiA 402-2, 6007h)."""
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
        self._look_ns = now_ns + MS
        for axis in self.axes:
            axis.step(now_ns)
        if self.nmt_state == OPERATIONAL:
            self._pdos.step(now_ns)
        self._changed()

    def _due_ns(self) -> int:
        due_ns = min(self._boot_ns, self._heartbeat_ns, self._lost_ns)
        if self.nmt_state == OPERATIONAL:
            due_ns = min(due_ns, self._pdos.due_ns)
        if any(axis.is_stopping for axis in self.axes):
            due_ns = min(due_ns, self._look_ns)
        return due_ns

    def _changed(self) -> None:
        """Send the event-driven PDOs where a status word changed."""
        words = [axis.status_word & 0x6F for axis in self.axes]
        if words != self._words:
            self._words = words
            if self.nmt_state == OPERATIONAL:
                self._pdos.on_change()

    # The host is lost ---------------------------------------------------------------------------

    def _lose_host(self) -> None:
        """React to a host that is silent for too long."""
        if self._has_off_line_time:
            self._end_off_line_time()
            return
        self._emergency(HEARTBEAT_LOST)
        behaviour = self.dictionary.number(0x1029, 1) if 0x1029 in self._indices else 0
        if self.nmt_state == OPERATIONAL and behaviour in (_TO_PRE_OPERATIONAL, _TO_STOPPED):
            self.nmt_state = PRE_OPERATIONAL if behaviour == _TO_PRE_OPERATIONAL else STOPPED
        self._abort_connection(self._reaction())

    def _reaction(self) -> int:
        """Return the action of 6007h; of a drive without it, what is true of that."""
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


def _current(motor: Motor, unit_a: float) -> int:
    """Return the current of a motor in a unit [A]."""
    return _fit(motor.current_a / unit_a, 16)


def _fit(value: float, bits: int) -> int:
    """Return the nearest integer that a signed object of so many bits holds."""
    top = (1 << bits - 1) - 1
    return round(min(max(value, -top), top))


def _wrap(value: int, bits: int) -> int:
    """Return a counter as a signed object of so many bits holds it."""
    half = 1 << bits - 1
    return (value + half) % (1 << bits) - half


def _halves(values: Sequence[int]) -> int:
    """Return two 16-bit values in one of 32, the first low."""
    low, high = (*values, 0)[:2]
    return low & 0xFFFF | (high & 0xFFFF) << 16
