"""All kinds of faults: `CATALOGUE`; `docs/faults.md` is generated from it.

Faults of frames and bus are those of `firmware_sim.bus.faults`; those of the drive and the sonars
are between the true robot and its firmware, in `firmware_sim.faults.faulty_parts`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from firmware_sim.bus.errors import BusError
from firmware_sim.bus.faults import (
    Babble,
    Corrupt,
    Cut,
    Destroy,
    Dominant,
    Drop,
    Duplicate,
    Mute,
    Reorder,
    Stale,
    Unanswered,
)
from firmware_sim.bus.frame import EXTENDED_FLAG, EXTENDED_MASK
from firmware_sim.errors import SimulationError, nearest
from firmware_sim.faults import actions as act
from firmware_sim.faults import fits
from firmware_sim.faults.faulty_parts import RELEASE_V, RESET_V, REVERSED, STUCK
from firmware_sim.faults.parameters import DURATION, Parameter, Value, shown
from firmware_sim.nodes import wire


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of fault.

    Attributes
    ----------
    help
        Description, in one line.
    begin
        Starts the fault; returns what ends it, or None if it ends by itself.
    parameters
        Parameters by name.
    fits
        Yields the arguments that do not fit a robot.
    """

    help: str
    begin: act.Begin
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    fits: fits.Fits = fits.anything

    def value(self, key: str, given: object) -> Value:
        """Return the value of one parameter; raises SimulationError if it is unknown or invalid.

        The message begins with the key as it is `shown`.
        """
        parameter = self.parameters.get(key)
        if parameter is None:
            allowed = ", ".join(self.parameters) or "none"
            hint = nearest(key, self.parameters)
            raise SimulationError(f"{shown(key)}: unknown, allowed: {allowed}{hint}")
        try:
            return parameter.value(given)
        except SimulationError as error:
            raise SimulationError(f"{shown(key)}: {error}") from None

    def complete(self, given: Mapping[str, Value]) -> dict[str, Value]:
        """Return all arguments, with the defaults of those that are not given."""
        return {key: given.get(key, each.default) for key, each in self.parameters.items()}


DRIVE_FEEDBACK: Final = (wire.WHEEL_FEEDBACK, wire.MOTOR_STATUS, wire.DRIVE_STATUS)

_LASTING: Final = {DURATION: Parameter(0.0, "s, 0: until `clear`", 0.0, 3600.0)}
_FOR: Final = {DURATION: Parameter(0.5, "s", 0.001, 3600.0)}
_NODE: Final = {"node": Parameter("drive", "a node of the robot, or a drive", named=True)}
_WHEEL: Final = {"wheel": Parameter("left", "a wheel of the robot", named=True)}
_FRAMES: Final = {
    "id": Parameter(
        0.0,
        "identifier, 0x201 or 513, 0: any; of 29 bits with 0x80000000 added",
        0.0,
        EXTENDED_FLAG | EXTENDED_MASK,
        whole=True,
    ),
    "probability": Parameter(1.0, "for each frame", 0.001, 1.0),
    **_FOR,
}

DRIVE: Final[dict[str, Kind]] = {
    "encoder_stuck": Kind(
        "an encoder stops counting", act.encoder(STUCK), {**_WHEEL, **_LASTING},
        fits.wheel,
    ),
    "encoder_reversed": Kind(
        "an encoder counts backwards", act.encoder(REVERSED), {**_WHEEL, **_LASTING},
        fits.wheel,
    ),
    "encoder_glitch": Kind(
        "an encoder's count jumps once", act.glitch,
        {**_WHEEL, "counts": Parameter(500.0, "counts", -32000.0, 32000.0, whole=True)},
        fits.wheel,
    ),
    "encoder_disconnected": Kind(
        "an encoder's cable is open: it counts noise at random while the bridges switch, and "
        "nothing otherwise", act.disconnect_encoder,
        {**_WHEEL, "edges": Parameter(2000.0, "1/s, 0: none", 0.0, 50000.0), **_LASTING},
        fits.wheel,
    ),
    "wheels_swapped": Kind(
        "the encoder plugs of two wheels are swapped", act.swap,
        {**_WHEEL, "other": Parameter("right", "another wheel", named=True), **_LASTING},
        fits.exchange,
    ),
    "feedback_frozen": Kind(
        "the drive's feedback continues with old counts", act.freeze, _LASTING
    ),
    "carried": Kind(
        "somebody carries the robot to a random place in the room", act.carry
    ),
    "body": Kind(
        "the robot's body changes: it takes up a load, lifts its fork, couples a trailer; robotctl "
        "is not told", act.change_body,
        {"state": Parameter("", "a state of `[body]`", named=True), **_LASTING},
        fits.body,
    ),
    "wheel_blocked": Kind("a wheel cannot turn", act.block, {**_WHEEL, **_LASTING}, fits.wheel),
    "wheel_slipping": Kind(
        "a tyre has lost most of its grip: on oil, or nearly off the floor", act.slip,
        {**_WHEEL, "grip": Parameter(0.05, "share that is left", 0.0, 1.0), **_LASTING},
        fits.wheel,
    ),
    "over_current": Kind(
        "a motor draws current that produces no torque", act.draw_current,
        {**_WHEEL, "amperes": Parameter(20.0, "A", 0.1, 100.0), **_LASTING},
        fits.current,
    ),
    "over_temperature": Kind(
        "a motor winding is hotter", act.heat,
        {**_WHEEL, "kelvin": Parameter(150.0, "K", 1.0, 200.0), **_LASTING},
        fits.heat,
    ),
    "under_voltage": Kind(
        "the supply voltage at the drive drops", act.under_voltage,
        {"volts": Parameter(5.0, "V less", 0.1, 60.0), **_LASTING},
    ),
    "drive_fault": Kind(
        "a bought drive has a fault of its own, by its maker's code (docs/hardware.md)",
        act.trip,
        {
            "drive": Parameter("drive", "a bought drive of the robot", named=True),
            "code": Parameter(0.0, "its maker's number", 0.0, 0xFFFF_FFFF, whole=True),
            **_LASTING,
        },
        fits.drive_fault,
    ),
    "brown_out": Kind(
        f"the supply at the drive sags linearly; below {RESET_V:g} V its processor is held in "
        f"reset, above {RELEASE_V:g} V it boots", act.brown_out,
        {
            "volts": Parameter(4.0, "V that are left", 0.0, 60.0),
            "sag": Parameter(0.2, "s until then", 0.001, 60.0),
            **_LASTING,
        },
        fits.sag,
    ),
}  # fmt: skip

SONARS: Final[dict[str, Kind]] = {
    "sonar_silent": Kind(
        "the sonar ring sends no ranges, but its heartbeat continues",
        act.lose(*wire.SONAR_RANGES), _FOR, fits.sonars,
    ),
    "sonar_stuck": Kind(
        "the sonar ring repeats its last ranges", lambda robot, _: robot.ring.stick(), _LASTING,
        fits.sonars,
    ),
    "sonar_crosstalk": Kind(
        "a sonar mistakes the echo of another in its group of four for its own and reads too near",
        act.leak,
        {
            "sonar": Parameter(0.0, "number of the one that receives", 0.0, 15.0, whole=True),
            "other": Parameter(1.0, "number of the one that is received", 0.0, 15.0, whole=True),
            **_LASTING,
        },
        fits.crosstalk,
    ),
}  # fmt: skip

IMU: Final[dict[str, Kind]] = {
    "imu_stuck": Kind(
        "the IMU repeats its last sample", lambda robot, _: robot.imu.stick(), _LASTING, fits.imu
    ),
    "gyro_biased": Kind(
        "the gyro reads more about its upright axis", act.bias_gyro,
        {"rate": Parameter(0.5, "rad/s", -10.0, 10.0), **_LASTING},
        fits.imu,
    ),
    "tilted": Kind(
        "the robot tilts, as its IMU feels it: over a wheel, or in somebody's hands", act.tilt,
        {
            "roll": Parameter(0.0, "deg, left side up", -180.0, 180.0),
            "pitch": Parameter(30.0, "deg, nose down", -180.0, 180.0),
            "within": Parameter(0.5, "s until it does", 0.01, 60.0),
            **_LASTING,
        },
        fits.imu,
    ),
}  # fmt: skip

NODES: Final[dict[str, Kind]] = {
    "node_reset": Kind(
        "a node loses its supply for a moment and boots", act.reset, _NODE, fits.node
    ),
    "node_silent": Kind(
        "a node's program hangs: it sends nothing, not even its heartbeat",
        act.on_node(Mute), {**_NODE, **_FOR}, fits.node,
    ),
    "feedback_lost": Kind(
        "the drive's feedback is missing, but its heartbeat continues",
        act.lose(*DRIVE_FEEDBACK), _FOR, fits.controller,
    ),
    "parameter_lost": Kind(
        "a node's stored parameters are damaged: it boots with its defaults and reports it, at "
        "each boot until they are stored again",
        act.lose_parameters, _NODE, fits.node,
    ),
    "parameter_changed": Kind(
        "a parameter in a node's memory changes, as by a flipped bit or a write that should have "
        "been refused",
        act.change_parameter,
        {
            "parameter": Parameter("command_timeout", "which", words=tuple(fits.PARAMETERS)),
            "value": Parameter(
                2000.0, "in the unit of the object dictionary", 0.0, 65535.0, whole=True
            ),
        },
        fits.parameter,
    ),
    "wrong_firmware": Kind(
        "a node boots with another major revision, the drive with another wire version; "
        "afterwards it boots with its own", act.flash, {**_NODE, **_LASTING}, fits.own_node,
    ),
    "clock_drift": Kind(
        "a node's oscillator is off, and so are its periods, time-out and time stamps", act.drift,
        {**_NODE, "ppm": Parameter(50000.0, "ppm fast", -100000.0, 100000.0), **_LASTING},
        fits.own_node,
    ),
}  # fmt: skip

BUS: Final[dict[str, Kind]] = {
    "bus_cut": Kind("the wire is cut everywhere", act.on_bus(Cut), _FOR),
    "bus_short": Kind("the bus is held dominant", act.on_bus(Dominant), _FOR),
    "node_cut": Kind("a node is cut off", act.on_node(Cut), {**_NODE, **_FOR}, fits.node),
    "host_cut": Kind("the host is cut off", act.on_host(Cut), _FOR),
    "node_bus_off": Kind(
        "a node's transmitter corrupts each of its frames: it goes bus-off whenever it comes "
        "back", act.on_node(Destroy, error=BusError.BIT_ERROR), {**_NODE, **_FOR}, fits.node,
    ),
    "host_bus_off": Kind(
        "the host's transmitter corrupts each of its frames: it goes bus-off whenever it comes "
        "back", act.on_host(Destroy, error=BusError.BIT_ERROR), _FOR,
    ),
    "node_error_passive": Kind(
        "a node's transmitter corrupts enough frames to stay error-passive; all get through",
        act.node_passive, {**_NODE, **_LASTING}, fits.node,
    ),
    "host_error_passive": Kind(
        "the host's transmitter corrupts enough frames to stay error-passive; all get through",
        act.host_passive, _LASTING,
    ),
    "no_ack": Kind(
        "no node acknowledges the host: its frames are lost, but it receives",
        act.on_host(Unanswered), _FOR,
    ),
    "babble": Kind(
        "a node sends identifier 0 without a pause", act.on_node(Babble), {**_NODE, **_FOR},
        fits.node,
    ),
    "overload": Kind(
        "frames of an unknown node fill a share of the bus, at the lowest or the highest priority; "
        "it acknowledges no others",
        act.overload,
        {
            "priority": Parameter("low", "of its frames", words=tuple(act.OVERLOAD_IDS)),
            "load": Parameter(0.95, "share", 0.05, 1.0),
            **_FOR,
        },
    ),
}  # fmt: skip

FRAMES: Final[dict[str, Kind]] = {
    "frames_destroyed": Kind(
        "frames are corrupted on the wire: CAN's own CRC detects it and they are sent again",
        act.on_frames(Destroy, error=BusError.CRC_ERROR), _FRAMES, fits.frames,
    ),
    "frames_corrupt": Kind(
        "one bit of the payload changes before the frame is sent: only E2E detects it",
        act.on_frames(Corrupt), _FRAMES, fits.frames,
    ),
    "frames_lost": Kind("receivers lose frames", act.on_frames(Drop), _FRAMES, fits.frames),
    "frames_repeated": Kind(
        "frames are sent twice", act.on_frames(Duplicate), _FRAMES, fits.frames
    ),
    "frames_stale": Kind(
        "instead of a frame the previous good one is sent again", act.on_frames(Stale), _FRAMES,
        fits.frames,
    ),
    "frames_reordered": Kind(
        "a frame is sent after the next one of its identifier", act.on_frames(Reorder), _FRAMES,
        fits.frames,
    ),
    "frames_late": Kind(
        "frames reach the CAN controller late; others overtake them", act.delay,
        {**_FRAMES, "delay": Parameter(0.02, "s", 0.0001, 10.0)}, fits.frames,
    ),
    "masquerade": Kind(
        "the sonar node sends motor commands with a wrong CRC", act.masquerade, _FOR,
        fits.controller,
    ),
}  # fmt: skip

GROUPS: Final = {
    "The drive and its sensors": DRIVE,
    "The sonars": SONARS,
    "The IMU": IMU,
    "Nodes": NODES,
    "The bus": BUS,
    "Frames": FRAMES,
}
CATALOGUE: Final[dict[str, Kind]] = {
    name: kind for group in GROUPS.values() for name, kind in group.items()
}


def describe() -> str:
    """Return the catalogue in Markdown, a table for each group."""
    return "\n\n".join(f"### {title}\n\n{_table(group)}" for title, group in GROUPS.items())


def _table(group: dict[str, Kind]) -> str:
    rows = ["| kind | what happens | parameters, their defaults and bounds |", "|---|---|---|"]
    for name, kind in group.items():
        parameters = ", ".join(_parameter(key, each) for key, each in kind.parameters.items())
        rows.append(f"| `{name}` | {kind.help} | {parameters} |")
    return "\n".join(rows)


def _parameter(key: str, parameter: Parameter) -> str:
    if parameter.words:
        return f"`{key}={parameter.default}` ({parameter.help}: {', '.join(parameter.words)})"
    if parameter.named:
        return f"`{key}={parameter.default}` ({parameter.help})"
    return f"`{key}={parameter.default:g}` ({parameter.help}; {parameter.bounds})"
