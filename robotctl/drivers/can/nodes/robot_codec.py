"""The codec of the robot's own messages: what `robot_can` needs of the DBC, checked and compiled.

Everything that the host relies on (messages, signals, value tables, protection) is looked up here,
at the start, so that a DBC that does not fit is refused before any frame is sent.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import IntEnum
from typing import Final

from robotctl.drivers.can.codec import Decoder, compile_decoder, compile_encoder, data_id_crc
from robotctl.drivers.can.dbc import HOST, Dbc, Message
from robotctl.drivers.can.nodes.sdo import NODE_ID_MAX, REQUEST_BASE
from robotctl.errors import ConfigError
from robotctl.messages.control import DriveFault, DriveState, EmergencyStopSource

COMMAND: Final = "MotorCommand"
WHEELS: Final = "WheelFeedback"
MOTOR: Final = "MotorStatus"
DRIVE: Final = "DriveStatus"
BATTERY: Final = "Battery"
SONARS: Final = ("SonarRangesA", "SonarRangesB", "SonarRangesC", "SonarRangesD")
EMERGENCY_STOP: Final = "EmergencyStop"
SYNC: Final = "Sync"
NMT: Final = "NmtControl"

_FAULT_SIGNALS = {
    DriveFault.OVER_CURRENT: "FaultOverCurrent",
    DriveFault.OVER_TEMPERATURE: "FaultOverTemperature",
    DriveFault.UNDER_VOLTAGE: "FaultUnderVoltage",
    DriveFault.ENCODER: "FaultEncoder",
    DriveFault.COMMAND_TIMEOUT: "FaultCommandTimeout",
    DriveFault.PARAMETER: "FaultParameter",
}
_STATES = tuple(DriveState)


class RobotCodec:
    """Compiled functions for the frames of the robot.

    Parameters
    ----------
    dbc
        A file with the messages of `configs/robot.dbc`.

    Raises
    ------
    ConfigError
        If the file lacks a message, a signal, a protection or a named value that the host needs,
        or two data ids have the same CRC.
    """

    def __init__(self, dbc: Dbc) -> None:
        self.dbc = dbc
        self.command_id = dbc.message(COMMAND).arbitration_id
        self.sync_id = dbc.message(SYNC).arbitration_id
        self.nmt_id = dbc.message(NMT).arbitration_id
        self.emergency_stop_id = dbc.message(EMERGENCY_STOP).arbitration_id
        foreign = {self.emergency_stop_id, self.nmt_id, *_sdo_requests(dbc)}
        self.arbitration_ids = tuple(sorted({*foreign, *dbc.received_by(HOST)}))
        """What the host listens to: what is meant for it; emergency stops, NMT and SDO requests by
        others."""
        for name in (COMMAND, WHEELS, MOTOR, DRIVE, BATTERY, *SONARS):
            dbc.protection(name)
        _check_data_ids(dbc)
        _check_names(dbc, MOTOR, "State", DriveState)
        _check_names(dbc, EMERGENCY_STOP, "EmergencyStopSource", EmergencyStopSource)
        self.encode_command = compile_encoder(
            dbc.message(COMMAND),
            _present(dbc, COMMAND, "Counter", "Enable", "Brake", "Duty1", "Duty2", "SteeringAngle"),
        )
        steering = dbc.signal(COMMAND, "SteeringAngle")
        self.steering_range_rad = (
            steering.raw_minimum * steering.scale + steering.offset,
            steering.raw_maximum * steering.scale + steering.offset,
        )
        """The steering angles that a command can carry [rad]; DriveStatus says more than these."""
        self.decode_wheels = self._decoder(WHEELS, "Timestamp", "Count1", "Count2")
        self.decode_motor = self._decoder(
            MOTOR,
            "State",
            "Current1",
            "Current2",
            "Temperature1",
            "Temperature2",
            *_FAULT_SIGNALS.values(),
        )
        self.decode_drive = self._decoder(
            DRIVE, "EchoCounter", "SteeringAngle", "BusVoltage", "CommandAge", "RejectedCommands"
        )
        self.decode_battery = self._decoder(
            BATTERY,
            "Voltage",
            "Current",
            "Charge",
            "Temperature",
            "BatteryLow",
            "BatteryCritical",
        )
        self.decode_sonars = tuple(
            _sonar_decoder(dbc, name, group) for group, name in enumerate(SONARS)
        )

    def _decoder(self, message: str, *signals: str) -> Decoder:
        return compile_decoder(self.dbc.message(message), _present(self.dbc, message, *signals))


def drive_state(raw: int) -> DriveState:
    """Return the state of a raw value; one that the DBC does not know is taken as a fault."""
    return _STATES[raw] if raw < len(_STATES) else DriveState.FAULT


def fault_bits(flags: tuple[int, ...]) -> int:
    """Return `DriveFault` bits of the six fault signals, as `decode_motor` orders them."""
    bits = 0
    for fault, flag in zip(_FAULT_SIGNALS, flags, strict=True):
        if flag:
            bits |= fault.value
    return bits


def _sonar_decoder(
    dbc: Dbc, message: str, group: int
) -> Callable[[bytes], tuple[float, float, float, float]]:
    """Compile the decoder of one group of ranges [m]: inf no echo, nan no sensor or a fault."""
    names = _present(dbc, message, *(f"Range{4 * group + offset}" for offset in range(4)))
    decode = compile_decoder(dbc.message(message), names, raw=names)
    scale = dbc.signal(message, names[0]).scale
    special = {
        dbc.value(message, names[0], "no_echo"): math.inf,
        dbc.value(message, names[0], "fault"): math.nan,
    }

    def decode_ranges(data: bytes) -> tuple[float, float, float, float]:
        a, b, c, d = decode(data)
        return (
            special[a] if a in special else a * scale,
            special[b] if b in special else b * scale,
            special[c] if c in special else c * scale,
            special[d] if d in special else d * scale,
        )

    return decode_ranges


def _sdo_requests(dbc: Dbc) -> list[int]:
    """Return the identifiers of requests to the SDO servers of the nodes."""
    numbers = (message.arbitration_id for message in dbc.messages.values())
    return [each for each in numbers if REQUEST_BASE < each <= REQUEST_BASE + NODE_ID_MAX]


def _present(dbc: Dbc, message: str, *signals: str) -> tuple[str, ...]:
    """Return the names of signals that must exist."""
    return tuple(dbc.signal(message, name).name for name in signals)


def _check_data_ids(dbc: Dbc) -> None:
    """Refuse data ids of which the CRC does not tell one message from another.

    All that a data id adds to a frame's CRC is its own, eight bits of sixteen.
    """
    seen: dict[int, Message] = {}
    for message in sorted(dbc.messages.values(), key=lambda each: each.arbitration_id):
        if message.protection is None:
            continue
        other = seen.setdefault(data_id_crc(message.protection.data_id), message)
        if other is not message and other.protection is not None:
            raise ConfigError(
                f"{dbc.path}: {message.name}: its E2E_DataId 0x{message.protection.data_id:04X} "
                f"has the CRC of {other.name}'s 0x{other.protection.data_id:04X}, so that each "
                "passes for the other"
            )


def _check_names(dbc: Dbc, message: str, signal: str, kind: type[IntEnum]) -> None:
    """Check that a value table says the same as the enumeration of the messages."""
    for member in kind:
        raw = dbc.value(message, signal, member.name.lower())
        if raw != member.value:
            raise ConfigError(
                f"{dbc.path}: {message}.{signal}: {member.name.lower()} is {raw}, "
                f"must be {member.value}"
            )
