"""Every kind of fault there is: `CATALOGUE`; `docs/faults.md` is written from it.

Faults of frames and bus are those of `firmware_sim.bus.faults`; those of the drive and the sonars
sit between the true robot and its firmware, in `firmware_sim.faulty_parts`.
"""

from __future__ import annotations

from collections.abc import Callable
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
from firmware_sim.fault_kinds import DURATION, Arguments, Kind, Parameter, Undo
from firmware_sim.faulty_parts import REVERSED, STUCK
from firmware_sim.nodes import wire

if TYPE_CHECKING:
    from firmware_sim.faults import Faults

Begin: TypeAlias = "Callable[[Faults, Arguments], Undo | None]"

WHEELS: Final = {"left": 0, "right": 1, "drive": 0}
NODES: Final = ("drive", "sonar", "power")
DRIVE_FEEDBACK: Final = (wire.WHEEL_FEEDBACK, wire.MOTOR_STATUS, wire.DRIVE_STATUS)

_LASTING: Final = {DURATION: Parameter(0.0, "s; 0: until `clear`", 0.0, 3600.0)}
_ON_BUS: Final = {DURATION: Parameter(0.5, "s", 0.001, 3600.0)}
_NODE: Final = {"node": Parameter("drive", "which", words=NODES)}
_WHEEL: Final = {"wheel": Parameter("left", "whose", words=tuple(WHEELS))}
_OF_WHEEL: Final = {**_WHEEL, **_LASTING}
_ON_NODE: Final = {**_NODE, **_ON_BUS}
_ON_FRAMES: Final = {
    "id": Parameter(0.0, "identifier, 0x201 or 513; 0: any", 0.0, 0x7FF),
    "probability": Parameter(1.0, "for each frame", 0.001, 1.0),
    **_ON_BUS,
}


def _channel(arguments: Arguments) -> int:
    return WHEELS[str(arguments["wheel"])]


def _number(arguments: Arguments, key: str) -> float:
    return float(arguments[key])


# Drive and sonars -------------------------------------------------------------------------------


def _encoder(factor: int) -> Begin:
    return lambda faults, arguments: faults.stage.break_encoder(_channel(arguments), factor)


def _glitch(faults: Faults, arguments: Arguments) -> None:
    faults.stage.jump(_channel(arguments), int(_number(arguments, "counts")))


def _freeze(faults: Faults, _: Arguments) -> Undo:
    ends = [faults.stage.break_encoder(channel, STUCK) for channel in (0, 1)]

    def end() -> None:
        for each in ends:
            each()

    return end


def _current(faults: Faults, arguments: Arguments) -> Undo:
    return faults.stage.add_current(_channel(arguments), _number(arguments, "amperes"))


def _heat(faults: Faults, arguments: Arguments) -> Undo:
    return faults.stage.add_heat(_channel(arguments), _number(arguments, "kelvin"))


_DRIVE_AND_SONARS: Final[dict[str, Kind]] = {
    "encoder_stuck": Kind("an encoder counts no more", _encoder(STUCK), _OF_WHEEL),
    "encoder_reversed": Kind("an encoder counts backwards", _encoder(REVERSED), _OF_WHEEL),
    "encoder_glitch": Kind(
        "an encoder's count jumps once", _glitch,
        {**_WHEEL, "counts": Parameter(500.0, "counts", -32000.0, 32000.0)},
    ),
    "wheels_swapped": Kind(
        "the encoders' cables are in each other's sockets",
        lambda faults, _: faults.stage.swap(), _LASTING,
    ),
    "feedback_frozen": Kind(
        "the drive's feedback goes on with the counts of long ago", _freeze, _LASTING
    ),
    "wheel_blocked": Kind(
        "a wheel cannot turn",
        lambda faults, arguments: faults.stage.block(_channel(arguments)), _OF_WHEEL,
    ),
    "over_current": Kind(
        "a motor draws more current than it shows torque", _current,
        {**_WHEEL, "amperes": Parameter(20.0, "A", 0.1, 100.0), **_LASTING},
    ),
    "over_temperature": Kind(
        "a winding is hotter", _heat,
        {**_WHEEL, "kelvin": Parameter(150.0, "K", 1.0, 200.0), **_LASTING},
    ),
    "under_voltage": Kind(
        "the supply at the drive breaks down",
        lambda faults, arguments: faults.stage.lose_voltage(_number(arguments, "volts")),
        {"volts": Parameter(5.0, "V", 0.1, 12.0), **_LASTING},
    ),
    "sonar_stuck": Kind(
        "the sonar ring repeats its last ranges", lambda faults, _: faults.ring.stick(), _LASTING
    ),
}  # fmt: skip


# Nodes and bus ----------------------------------------------------------------------------------


def _lose(*identifiers: int) -> Begin:
    def lose(faults: Faults, arguments: Arguments) -> None:
        for identifier in identifiers:
            faults.on_bus(Drop, arguments, arbitration_id=identifier)

    return lose


def _bus(make: Callable[..., BusFault]) -> Begin:
    return lambda faults, arguments: faults.on_bus(make, arguments)


def _node(make: Callable[..., BusFault]) -> Begin:
    return lambda faults, arguments: faults.on_bus(make, arguments, node=arguments["node"])


def _host(make: Callable[..., BusFault]) -> Begin:
    return lambda faults, arguments: faults.on_bus(make, arguments, node=faults.host())


def _reset(faults: Faults, arguments: Arguments) -> None:
    faults.simulation.power_cycle(str(arguments["node"]))


_NODES_AND_BUS: Final[dict[str, Kind]] = {
    "node_reset": Kind("a node loses its supply for a moment and boots", _reset, _NODE),
    "node_silent": Kind(
        "a node's program hangs: it sends nothing, heartbeat neither", _node(Mute), _ON_NODE
    ),
    "feedback_lost": Kind(
        "the drive's feedback is missing, its heartbeat goes on", _lose(*DRIVE_FEEDBACK), _ON_BUS
    ),
    "sonar_silent": Kind(
        "the sonar ring sends no ranges, its heartbeat goes on",
        _lose(*wire.SONAR_RANGES), _ON_BUS,
    ),
    "bus_cut": Kind("the wire is cut everywhere", _bus(Cut), _ON_BUS),
    "bus_short": Kind("the bus is held dominant", _bus(Dominant), _ON_BUS),
    "node_cut": Kind("a node is cut off", _node(Cut), _ON_NODE),
    "host_cut": Kind("the host is cut off", _host(Cut), _ON_BUS),
    "babble": Kind("a node sends identifier 0 without a pause", _node(Babble), _ON_NODE),
}  # fmt: skip


# Frames -----------------------------------------------------------------------------------------


def _frames(make: Callable[..., FrameFault], **more: object) -> Begin:
    return lambda faults, arguments: faults.on_frames(make, arguments, **more)


def _delay(faults: Faults, arguments: Arguments) -> None:
    faults.on_frames(Delay, arguments, delay_ns=round(_number(arguments, "delay") * 1e9))


def _masquerade(faults: Faults, arguments: Arguments) -> None:
    faults.on_bus(
        Babble, arguments, node="sonar", arbitration_id=wire.MOTOR_COMMAND,
        data=bytes.fromhex("0010E803E8030000"), period_ns=5_000_000,
    )  # fmt: skip


_FRAMES: Final[dict[str, Kind]] = {
    "masquerade": Kind(
        "the sonar node sends motor commands, with a CRC that does not fit", _masquerade, _ON_BUS
    ),
    "frames_destroyed": Kind(
        "frames break on the wire: CAN's own CRC sees it and they are sent again",
        _frames(Destroy, error=BusError.CRC_ERROR), _ON_FRAMES,
    ),
    "frames_corrupt": Kind(
        "one bit of the payload changes before the frame is sent: only E2E sees it",
        _frames(Corrupt), _ON_FRAMES,
    ),
    "frames_lost": Kind("receivers lose frames", _frames(Drop), _ON_FRAMES),
    "frames_repeated": Kind("frames are sent twice", _frames(Duplicate), _ON_FRAMES),
    "frames_late": Kind(
        "frames are handed to the controller late; others overtake them", _delay,
        {**_ON_FRAMES, "delay": Parameter(0.02, "s", 0.0001, 10.0)},
    ),
}  # fmt: skip


CATALOGUE: Final[dict[str, Kind]] = {**_DRIVE_AND_SONARS, **_NODES_AND_BUS, **_FRAMES}


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
