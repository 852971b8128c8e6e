"""The table `[[motor]]` of a CiA 402 drive."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Final, Literal

from robotctl.drivers.can.bus_load import Cyclic
from robotctl.drivers.can.drives.axis import Axis, AxisConfig
from robotctl.drivers.can.drives.cia402.device import (
    PROFILE_VELOCITY,
    VELOCITY,
    Device,
    Silence,
)
from robotctl.drivers.can.drives.cia402.dialects import DIALECTS
from robotctl.drivers.can.drives.cia402.drive import Cia402Drive
from robotctl.drivers.can.drives.cia402.eds import find_eds, load_eds
from robotctl.drivers.can.drives.cia402.host_beat import BEATS
from robotctl.drivers.can.drives.cia402.readings import READ_NS
from robotctl.drivers.can.drives.cia402.scan import cia402_probe
from robotctl.drivers.can.drives.cia402.settings import DriveSetup
from robotctl.drivers.can.drives.cia402.wire import (
    RPDO_BASES,
    TPDO_BASES,
    Layout,
    Pdo,
    Role,
)
from robotctl.drivers.can.drives.motor_drive import DriveNeeds, MotorDrive
from robotctl.drivers.can.nodes.identifiers import NODE_ID_MAX, CobId
from robotctl.drivers.can.probe import Probe
from robotctl.errors import InvalidValue
from robotctl.messages.faults import FaultCode
from robotctl.model.actuators import Abilities, Takes
from robotctl.safety.ages import AgeLimit
from robotctl.safety.state_machine import SafetyConfig

_MODES: Final = {"profile_velocity": PROFILE_VELOCITY, "velocity": VELOCITY}
_SUPPLY_NS: Final = 2_000_000_000
"""Greatest age of a supply voltage that is read by SDO, in turn with others [ns]."""
_I16_MAX: Final = 0x7FFF


@dataclass(frozen=True, slots=True)
class Cia402Motor:
    """A drive of CiA 402 over CANopen.

    Parameters
    ----------
    kind
        Always "cia402".
    name
        Name of the drive in messages and logs.
    axes
        Its axes; `axis` 1 is the drive's first (of a ZLAC8015D: left), `ratio` the gear.
    node_id
        CANopen node id, 1 to 127.
    bus
        Name of its bus; empty: the first.
    dialect
        Make of the drive: "generic" is any with an EDS.
    eds
        Its electronic data sheet (CiA 306): a path, or the name of a file beside the robot files
        that come with robotctl. Needed for "generic".
    mode
        Mode of operation. "velocity" (6042h) counts in rpm.
    counts_per_turn
        Position units (6064h) in one turn of the motor; 0: as the dialect knows.
    speed_unit
        Velocity unit of 60FFh and 606Ch, where the dialect does not know it.
    host_id
        Node id by which this computer sends its heartbeat; no device on the bus may have it.
    accept_coasting
        Accept that the drive may coast, or even drive on, when this computer falls silent: needed
        where it has no time-out that CANopen can set, or does not say that it brakes.
    """

    kind: Literal["cia402"]
    name: str
    axes: tuple[AxisConfig, ...]
    node_id: int
    bus: str = ""
    dialect: Literal["generic", "zlac8015d", "roboteq"] = "generic"
    eds: str = ""
    mode: Literal["profile_velocity", "velocity"] = "profile_velocity"
    counts_per_turn: int = 0
    speed_unit: Literal["counts/s", "rpm", "0.1 rpm"] = "counts/s"
    host_id: int = 127
    accept_coasting: bool = False

    accept_timeout_ms: ClassVar[int] = 0

    def __post_init__(self) -> None:
        """Check the values, and that the drive has what is needed."""
        for key in ("node_id", "host_id"):
            value = getattr(self, key)
            if not 1 <= value <= NODE_ID_MAX:
                raise InvalidValue(key, f"must be 1 to {NODE_ID_MAX}, not {value}", value)
        if self.host_id == self.node_id:
            raise InvalidValue("host_id", f"must not be the drive's, {self.node_id}", self.host_id)
        dialect = DIALECTS[self.dialect]
        numbers = [axis.axis for axis in self.axes]
        if len(set(numbers)) < len(numbers) or not set(numbers) <= set(range(1, dialect.axes + 1)):
            found = ", ".join(map(str, numbers))
            text = f"each must have one of 1 to {dialect.axes} to itself, found {found}"
            raise InvalidValue("axes", text, numbers)
        if dialect.objects is None and not self.eds:
            raise InvalidValue("eds", "must name the EDS of a generic drive, found ''", self.eds)
        if dialect.layout is not None and self.mode != "profile_velocity":
            text = f'must be "profile_velocity" with {self.dialect}, not "{self.mode}"'
            raise InvalidValue("mode", text, self.mode)
        if self.counts_per_turn < 0 or not (self.counts_per_turn or dialect.counts_per_turn):
            text = f"must be above 0 with {self.dialect}, not {self.counts_per_turn}"
            raise InvalidValue("counts_per_turn", text, self.counts_per_turn)
        self._layout(self._device())

    def _device(self) -> Device:
        eds = load_eds(find_eds(self.eds)) if self.eds else None
        numbers = [axis.axis for axis in self.axes]
        return Device(DIALECTS[self.dialect], eds, numbers, _MODES[self.mode])

    def _layout(self, device: Device) -> Layout:
        try:
            return device.layout()
        except ValueError as error:
            raise InvalidValue("eds", f"must fit: {error}", self.eds) from None

    @property
    def node_ids(self) -> tuple[int, ...]:
        """Its node id."""
        return (self.node_id,)

    @property
    def abilities(self) -> Abilities:
        """Abilities, as its EDS or its dialect tells them."""
        device = self._device()
        parts = {role for pdo in self._layout(device).transmit for role, _ in pdo.parts}
        parts |= {
            each.role or Role.OTHER
            for each in device.dialect.polled
            if device.eds is None or device.has(each.index, each.subindex)
        }
        return Abilities(
            takes=Takes.SPEED,
            stops_alone=device.surely_stops,
            brakes=False,
            tells_speed=Role.SPEED in parts,
            tells_current=Role.CURRENT in parts,
            tells_temperature=Role.OTHER in parts,
            tells_voltage=Role.VOLTAGE in parts,
        )

    @property
    def silence(self) -> str:
        """Reaction to a silent host, in words."""
        device = self._device()
        found = device.silence
        if found is Silence.OFF_LINE_TIME:
            index = device.dialect.off_line_ms
            return f"stops after object {index:04X}h; its maker does not say whether it brakes"
        if device.surely_stops:
            return f"misses {found.value}, brakes and goes into fault after command_timeout_ms"
        if found is Silence.NONE:
            return "nothing that CANopen can set: as its maker's tool says"
        return f"misses {found.value} after command_timeout_ms; it does not say that it brakes"

    def ages(self, safety: SafetyConfig, period_ns: int) -> tuple[AgeLimit, ...]:
        """Return the maximum ages of its reports."""
        wheels_ns = safety.feedback_timeout_periods * period_ns
        status_ns = safety.status_timeout_ms * 1_000_000
        name = self.name
        return (
            AgeLimit("motion", FaultCode.WHEELS_STALE, "wheel feedback is", name, wheels_ns),
            AgeLimit("report", FaultCode.MOTOR_STALE, "motor status is", name, status_ns),
            AgeLimit("supply", FaultCode.DRIVE_STALE, "supply voltage is", name, _SUPPLY_NS),
        )

    def make(self, axes: tuple[Axis, ...], needs: DriveNeeds) -> MotorDrive:
        """Return the drive.

        Raises
        ------
        InvalidValue
            If it does not say that it stops when the host is silent, and the table does not accept
            that; or if the robot's wheels can be faster than it takes.
        """
        device = self._device()
        if not (device.surely_stops or self.accept_coasting):
            text = f"must be true for this drive, which {self.silence}"
            raise InvalidValue("accept_coasting", text, self.accept_coasting)
        dialect = device.dialect
        counts = self.counts_per_turn or dialect.counts_per_turn
        target, actual = self._units(counts)
        top = dialect.target_max if self.mode == "profile_velocity" else _I16_MAX
        fastest = tuple(
            abs(axis.to_motor(needs.max_rad_s)) / (2.0 * math.pi) * target for axis in axes
        )
        if max(fastest) > top:
            axis = self.axes[fastest.index(max(fastest))]
            text = (
                f"ratio of {axis.actuator}: the robot's limits need a target velocity of "
                f"{max(fastest):.0f}, the drive takes at most {top}"
            )
            raise InvalidValue("axes", text, axis.ratio)
        plan = DriveSetup(
            self.node_id,
            device,
            self._layout(device),
            max(10, needs.heartbeat_timeout_ms // 3),
            needs.command_timeout_ms,
            self.host_id,
            1_000_000 // needs.rate_hz,
            fastest,
        )
        turn = 2.0 * math.pi
        return Cia402Drive(self.name, plan, target / turn, turn / actual, counts, axes, needs)

    def traffic(self, safety: SafetyConfig, rate_hz: int) -> tuple[Cyclic, ...] | None:
        """Return its frames: each tick SYNC and PDOs, and now and then heartbeats and a read."""
        name, node_id, device = self.name, self.node_id, self._device()
        layout = self._layout(device)
        beat_hz = min(1000.0 * BEATS / safety.command_timeout_ms, rate_hz)
        read_hz = 1e9 / READ_NS
        frames = [
            Cyclic(
                f"{name} heartbeat", CobId.HEARTBEAT + node_id, 1, 1000.0 / self._beat_ms(safety)
            ),
            Cyclic(f"{name} read", CobId.SDO_REQUEST + node_id, 8, read_hz),
            Cyclic(f"{name} value", CobId.SDO_RESPONSE + node_id, 8, read_hz),
        ]
        if any(pdo.every for pdo in layout.transmit):
            frames.append(Cyclic("Sync", CobId.SYNC, 0, rate_hz))
        if device.silence is Silence.HEARTBEAT:
            frames.append(Cyclic("host heartbeat", CobId.HEARTBEAT + self.host_id, 1, beat_hz))
        for bases, word, pdos in (
            (RPDO_BASES, "command", layout.receive),
            (TPDO_BASES, "feedback", layout.transmit),
        ):
            frames += [
                Cyclic(
                    f"{name} {word} {pdo.number}",
                    bases[pdo.number - 1] + node_id,
                    _length(pdo),
                    rate_hz / max(pdo.every, 1),
                )
                for pdo in pdos
            ]
        return tuple(frames)

    @staticmethod
    def _beat_ms(safety: SafetyConfig) -> int:
        """Return the period of its heartbeats [ms]."""
        return max(10, safety.heartbeat_timeout_ms // 3)

    @staticmethod
    def probe() -> Probe:
        """Return a probe that finds drives of this kind."""
        return cia402_probe()

    def _units(self, counts: int) -> tuple[float, float]:
        """Return target and actual velocity for one turn per second of the motor."""
        dialect = DIALECTS[self.dialect]
        if self.mode == "velocity":
            return 60.0, 60.0
        if dialect.target_per_turn:
            return dialect.target_per_turn, dialect.actual_per_turn
        unit = {"counts/s": float(counts), "rpm": 60.0, "0.1 rpm": 600.0}[self.speed_unit]
        return unit, unit


def _length(pdo: Pdo) -> int:
    """Return the data bytes of a PDO."""
    return sum(each.bits for each in pdo.objects) // 8
