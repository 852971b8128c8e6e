"""Faults of the simulated robot, each set off by one line: `encoder_stuck wheel=left duration=0.5`.

`CATALOGUE` is the one list of what can go wrong; `docs/faults.md` is written from it. Faults of the
bus are those of `firmware_sim.bus.faults`; those of the drive and its sensors sit between the
plant and the drive's firmware, so that the true robot does what physics says while the firmware
sees what is broken.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Final, TypeAlias

from firmware_sim.bus.errors import BusError
from firmware_sim.bus.faults import (
    Babble,
    Corrupt,
    Cut,
    Delay,
    Destroy,
    Dominant,
    Drop,
    Duplicate,
    FrameFault,
    Mute,
)
from firmware_sim.bus.faults import Fault as BusFault
from firmware_sim.errors import SimulationError
from firmware_sim.nodes import wire
from firmware_sim.plant import Bridge, Plant

if TYPE_CHECKING:
    from firmware_sim.simulation import Simulation

Value: TypeAlias = str | float
Arguments: TypeAlias = Mapping[str, Value]

WHEELS: Final = {"left": 0, "right": 1, "drive": 0}
NODES: Final = ("drive", "sonar", "power")
DRIVE_FEEDBACK: Final = (wire.WHEEL_FEEDBACK, wire.MOTOR_STATUS, wire.DRIVE_STATUS)


class _Encoder:
    """Counts as the firmware reads them: continuous whenever what is broken changes."""

    def __init__(self) -> None:
        self.factor = 1
        self._read = self._true = 0

    def read(self, true: int) -> int:
        """Return what is read where the wheel is truly at `true`."""
        return self._read + self.factor * (true - self._true)

    def change(self, true: int, factor: int, jump: int = 0) -> None:
        """From now on count by `factor`: 1 sound, 0 stuck, -1 reversed; jump by so much."""
        self.anchor(self.read(true) + jump, true)
        self.factor = factor

    def anchor(self, read: int, true: int) -> None:
        """Read `read` where the wheel is truly at `true`."""
        self._read, self._true = read, true


class FaultyStage:
    """The power stage as the drive's firmware sees it, between it and the plant.

    Parameters
    ----------
    plant
        The true one.
    """

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._encoders = (_Encoder(), _Encoder())
        self.swapped = False
        self.added_a = [0.0, 0.0]
        self.added_c = [0.0, 0.0]
        self.lost_v = 0.0

    def _true(self, channel: int) -> int:
        return self._plant.count2 if (channel == 1) != self.swapped else self._plant.count1

    def change_encoder(self, channel: int, factor: int, jump: int = 0) -> None:
        """Let an encoder count by `factor` and jump; see `_Encoder.change`."""
        self._encoders[channel].change(self._true(channel), factor, jump)

    def swap(self, *, swapped: bool) -> None:
        """Plug the cables of the encoders into each other's sockets, or back."""
        before = self.count1, self.count2
        self.swapped = swapped
        for channel in (0, 1):
            self._encoders[channel].anchor(before[channel], self._true(channel))

    @property
    def count1(self) -> int:
        """Count of channel 1."""
        return self._encoders[0].read(self._true(0))

    @property
    def count2(self) -> int:
        """Count of channel 2."""
        return self._encoders[1].read(self._true(1))

    @property
    def current1_a(self) -> float:
        """Current of motor 1 [A]."""
        return self._plant.current1_a + self.added_a[0]

    @property
    def current2_a(self) -> float:
        """Current of motor 2 [A]."""
        return self._plant.current2_a + self.added_a[1]

    @property
    def temperature1_c(self) -> float:
        """Winding temperature of motor 1 [degC]."""
        return self._plant.temperature1_c + self.added_c[0]

    @property
    def temperature2_c(self) -> float:
        """Winding temperature of motor 2 [degC]."""
        return self._plant.temperature2_c + self.added_c[1]

    @property
    def bus_voltage_v(self) -> float:
        """Supply at the bridges [V]."""
        return self._plant.bus_voltage_v - self.lost_v

    @property
    def steering_rad(self) -> float:
        """Measured steering angle [rad]."""
        return self._plant.steering_rad

    def command(self, duty1: float, duty2: float, steering_rad: float, bridge: Bridge) -> None:
        """Pass a command on."""
        self._plant.command(duty1, duty2, steering_rad, bridge)


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a kind of fault: a number in its range, or one of some words."""

    default: Value
    help: str
    low: float = 0.0
    high: float = 0.0
    words: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of fault: what it is, what it needs, how it begins and how it ends."""

    help: str
    begin: Callable[[Faults, Arguments], None]
    end: Callable[[Faults, Arguments], None] | None = None
    parameters: Mapping[str, Parameter] = field(default_factory=dict)


class Faults:
    """The faults of one simulation.

    Parameters
    ----------
    simulation
        The robot that they befall.
    stage
        What its drive reads.
    """

    def __init__(self, simulation: Simulation, stage: FaultyStage) -> None:
        self.simulation = simulation
        self.stage = stage
        self.sonar_stuck = False
        self._present: list[tuple[Kind, Arguments]] = []

    def inject(self, line: str) -> str:
        """Let one fault begin now; return its kind. `clear` ends all that last.

        Raises
        ------
        SimulationError
            If the line is wrong.
        """
        name, *words = line.split()
        if name == "clear" and not words:
            self.clear()
            return name
        arguments: dict[str, Value] = {}
        for word in words:
            key, equals, value = word.partition("=")
            if not equals:
                raise SimulationError(f"fault {name}: {word!r} is not of the form key=value")
            arguments[key] = value
        self.begin(name, arguments)
        return name

    def begin(self, name: str, given: Arguments) -> None:
        """Let a fault begin now; raises SimulationError where name or arguments are wrong."""
        kind, arguments = check(name, given)
        kind.begin(self, arguments)
        if kind.end is None:
            return
        entry = (kind, arguments)
        self._present.append(entry)
        duration_s = float(arguments["duration"])
        if duration_s > 0.0:
            bus = self.simulation.bus
            bus.schedule(bus.now_ns + round(duration_s * 1e9), partial(self._finish, entry))

    def clear(self) -> None:
        """End all faults that last; those of the bus end by themselves."""
        for entry in list(self._present):
            self._finish(entry)

    def _finish(self, entry: tuple[Kind, Arguments]) -> None:
        if entry not in self._present:
            return
        self._present.remove(entry)
        kind, arguments = entry
        if kind.end is not None:
            kind.end(self, arguments)

    def on_bus(self, make: Callable[..., BusFault], arguments: Arguments, **more: object) -> None:
        """Inject a fault of the bus from now for its duration."""
        now_ns = self.simulation.bus.now_ns
        end_ns = now_ns + round(float(arguments["duration"]) * 1e9)
        self.simulation.bus.inject(make(start_ns=now_ns, end_ns=end_ns, **more))

    def on_frames(
        self, make: Callable[..., BusFault], arguments: Arguments, **more: object
    ) -> None:
        """Inject a fault of frames: with the identifier and the probability of the arguments."""
        number = int(float(arguments["id"]))
        self.on_bus(
            make,
            arguments,
            arbitration_id=number or None,
            probability=float(arguments["probability"]),
            **more,
        )

    def host(self) -> str:
        """Name of the host's port, which is no node of the robot.

        Raises
        ------
        SimulationError
            Where no host is on the bus.
        """
        for port in self.simulation.bus.ports:
            if port.name == "host" or port.name.startswith("bridge:"):
                return port.name
        raise SimulationError("no host is on the bus")


def check(name: str, given: Arguments) -> tuple[Kind, dict[str, Value]]:
    """Return a kind of fault and its arguments, defaults filled in, numbers as numbers.

    Raises
    ------
    SimulationError
        If the kind or an argument is unknown, or a value is not allowed.
    """
    kind = CATALOGUE.get(name)
    if kind is None:
        near = difflib.get_close_matches(name, [*CATALOGUE, "clear"], n=1)
        hint = f'; did you mean "{near[0]}"?' if near else ""
        raise SimulationError(f"fault {name}: unknown{hint}")
    for key in given:
        if key not in kind.parameters:
            allowed = ", ".join(kind.parameters) or "none"
            raise SimulationError(f"fault {name}: {key}: unknown, allowed: {allowed}")
    return kind, {
        key: _value(f"fault {name}: {key}", parameter, given.get(key, parameter.default))
        for key, parameter in kind.parameters.items()
    }


def _value(where: str, parameter: Parameter, given: Value) -> Value:
    if parameter.words:
        if given not in parameter.words:
            raise SimulationError(f"{where}: {given!r}, allowed: {', '.join(parameter.words)}")
        return given
    try:
        number = float(int(given, 16)) if str(given).startswith("0x") else float(given)  # type: ignore[arg-type]
    except ValueError:
        raise SimulationError(f"{where}: {given!r} is no number") from None
    if not parameter.low <= number <= parameter.high:
        raise SimulationError(
            f"{where}: {number:g}, allowed: {parameter.low:g} to {parameter.high:g}"
        )
    return number


# The catalogue ---------------------------------------------------------------------------------

_LASTING = Parameter(0.0, "s; 0: until `clear`", 0.0, 3600.0)
_WHEEL = Parameter("left", "whose", words=tuple(WHEELS))
_NODE = Parameter("drive", "which", words=NODES)
_TIME = Parameter(0.5, "s", 0.001, 3600.0)
_ON_BUS: Final = {"duration": _TIME}
_ON_NODE: Final = {"node": _NODE, "duration": _TIME}
_ON_FRAMES: Final = {
    "id": Parameter(0.0, "identifier, 0x201 or 513; 0: any", 0.0, 0x7FF),
    "probability": Parameter(1.0, "for each frame", 0.001, 1.0),
    "duration": _TIME,
}
_OF_WHEEL: Final = {"wheel": _WHEEL, "duration": _LASTING}


def _channel(arguments: Arguments) -> int:
    return WHEELS[str(arguments["wheel"])]


def _encoder(factor: int) -> Callable[[Faults, Arguments], None]:
    return lambda faults, arguments: faults.stage.change_encoder(_channel(arguments), factor)


def _glitch(faults: Faults, arguments: Arguments) -> None:
    faults.stage.change_encoder(_channel(arguments), 1, int(float(arguments["counts"])))


def _add(attribute: str, key: str, sign: float) -> Callable[[Faults, Arguments], None]:
    def add(faults: Faults, arguments: Arguments) -> None:
        getattr(faults.stage, attribute)[_channel(arguments)] += sign * float(arguments[key])

    return add


def _block(blocked: bool) -> Callable[[Faults, Arguments], None]:
    return lambda faults, arguments: faults.simulation.plant.block(
        _channel(arguments) + 1, blocked=blocked
    )


def _lose_v(sign: float) -> Callable[[Faults, Arguments], None]:
    def lose(faults: Faults, arguments: Arguments) -> None:
        faults.stage.lost_v += sign * float(arguments["volts"])

    return lose


def _freeze(factor: int) -> Callable[[Faults, Arguments], None]:
    def freeze(faults: Faults, _: Arguments) -> None:
        for channel in (0, 1):
            faults.stage.change_encoder(channel, factor)

    return freeze


def _stick(stuck: bool) -> Callable[[Faults, Arguments], None]:
    def stick(faults: Faults, _: Arguments) -> None:
        faults.sonar_stuck = stuck

    return stick


def _lose(*identifiers: int) -> Callable[[Faults, Arguments], None]:
    def lose(faults: Faults, arguments: Arguments) -> None:
        for identifier in identifiers:
            faults.on_bus(Drop, arguments, arbitration_id=identifier)

    return lose


def _bus(make: Callable[..., BusFault]) -> Callable[[Faults, Arguments], None]:
    return lambda faults, arguments: faults.on_bus(make, arguments)


def _node(make: Callable[..., BusFault]) -> Callable[[Faults, Arguments], None]:
    return lambda faults, arguments: faults.on_bus(make, arguments, node=arguments["node"])


def _frames(make: Callable[..., FrameFault], **more: object) -> Callable[[Faults, Arguments], None]:
    return lambda faults, arguments: faults.on_frames(make, arguments, **more)


def _delay(faults: Faults, arguments: Arguments) -> None:
    faults.on_frames(Delay, arguments, delay_ns=round(float(arguments["delay"]) * 1e9))


def _masquerade(faults: Faults, arguments: Arguments) -> None:
    faults.on_bus(
        Babble, arguments, node="sonar", arbitration_id=wire.MOTOR_COMMAND,
        data=bytes.fromhex("0010E803E8030000"), period_ns=5_000_000,
    )  # fmt: skip


CATALOGUE: Final[dict[str, Kind]] = {
    "node_reset": Kind(
        "a node loses its supply for a moment and boots",
        lambda faults, arguments: faults.simulation.power_cycle(str(arguments["node"])),
        parameters={"node": _NODE},
    ),
    "node_silent": Kind(
        "a node's program hangs: it sends nothing, heartbeat neither",
        _node(Mute), parameters=_ON_NODE,
    ),
    "feedback_lost": Kind(
        "the drive's feedback is missing, its heartbeat goes on",
        _lose(*DRIVE_FEEDBACK), parameters=_ON_BUS,
    ),
    "feedback_frozen": Kind(
        "the drive's feedback goes on with the counts of long ago",
        _freeze(0), _freeze(1), {"duration": _LASTING},
    ),
    "encoder_stuck": Kind("an encoder counts no more", _encoder(0), _encoder(1), _OF_WHEEL),
    "encoder_reversed": Kind("an encoder counts backwards", _encoder(-1), _encoder(1), _OF_WHEEL),
    "encoder_glitch": Kind(
        "an encoder's count jumps once", _glitch,
        parameters={"wheel": _WHEEL, "counts": Parameter(500.0, "counts", -32000.0, 32000.0)},
    ),
    "wheels_swapped": Kind(
        "the encoders' cables are in each other's sockets",
        lambda faults, _: faults.stage.swap(swapped=True),
        lambda faults, _: faults.stage.swap(swapped=False),
        {"duration": _LASTING},
    ),
    "wheel_blocked": Kind("a wheel cannot turn", _block(True), _block(False), _OF_WHEEL),
    "over_current": Kind(
        "a motor draws more current than it shows torque", _add("added_a", "amperes", 1.0),
        _add("added_a", "amperes", -1.0),
        {"wheel": _WHEEL, "amperes": Parameter(20.0, "A", 0.1, 100.0), "duration": _LASTING},
    ),
    "over_temperature": Kind(
        "a winding is hotter", _add("added_c", "kelvin", 1.0), _add("added_c", "kelvin", -1.0),
        {"wheel": _WHEEL, "kelvin": Parameter(150.0, "K", 1.0, 200.0), "duration": _LASTING},
    ),
    "under_voltage": Kind(
        "the supply at the drive breaks down", _lose_v(1.0), _lose_v(-1.0),
        {"volts": Parameter(5.0, "V", 0.1, 12.0), "duration": _LASTING},
    ),
    "sonar_silent": Kind(
        "the sonar ring sends no ranges, its heartbeat goes on",
        _lose(*wire.SONAR_RANGES), parameters=_ON_BUS,
    ),
    "sonar_stuck": Kind(
        "the sonar ring repeats its last ranges", _stick(True), _stick(False),
        {"duration": _LASTING},
    ),
    "bus_cut": Kind("the wire is cut everywhere", _bus(Cut), parameters=_ON_BUS),
    "bus_short": Kind("the bus is held dominant", _bus(Dominant), parameters=_ON_BUS),
    "node_cut": Kind("a node is cut off", _node(Cut), parameters=_ON_NODE),
    "host_cut": Kind(
        "the host is cut off",
        lambda faults, arguments: faults.on_bus(Cut, arguments, node=faults.host()),
        parameters=_ON_BUS,
    ),
    "babble": Kind(
        "a node sends identifier 0 without a pause", _node(Babble), parameters=_ON_NODE
    ),
    "masquerade": Kind(
        "the sonar node sends motor commands, with a CRC that does not fit", _masquerade,
        parameters=_ON_BUS,
    ),
    "frames_destroyed": Kind(
        "frames break on the wire: CAN's own CRC sees it and they are sent again",
        _frames(Destroy, error=BusError.CRC_ERROR), parameters=_ON_FRAMES,
    ),
    "frames_corrupt": Kind(
        "one bit of the payload changes before the frame is sent: only E2E sees it",
        _frames(Corrupt), parameters=_ON_FRAMES,
    ),
    "frames_lost": Kind("receivers lose frames", _frames(Drop), parameters=_ON_FRAMES),
    "frames_repeated": Kind("frames are sent twice", _frames(Duplicate), parameters=_ON_FRAMES),
    "frames_late": Kind(
        "frames are handed to the controller late; others overtake them", _delay,
        parameters={**_ON_FRAMES, "delay": Parameter(0.02, "s", 0.0001, 10.0)},
    ),
}  # fmt: skip
"""Every fault there is."""


def describe() -> str:
    """Return the catalogue as a Markdown table."""
    rows = ["| fault | what happens | parameters |", "|---|---|---|"]
    for name, kind in CATALOGUE.items():
        parameters = "; ".join(
            f"`{key}={parameter.default}` {parameter.help}"
            + (f" ({', '.join(parameter.words)})" if parameter.words else "")
            for key, parameter in kind.parameters.items()
        )
        rows.append(f"| `{name}` | {kind.help} | {parameters} |")
    return "\n".join(rows)
