"""The codec of the robot's own messages: the DBC as `robot_can` needs it, checked and compiled.

Everything that the host relies on (messages, signals, value tables, protection) is looked up here,
at the start, so that a DBC that does not fit is refused before any frame is sent.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Final

from robotctl.drivers.can.codec import Decoder, compile_decoder, compile_encoder, data_id_crc
from robotctl.drivers.can.dbc import Dbc, Message
from robotctl.drivers.can.nodes.can_node import Value
from robotctl.drivers.can.nodes.motor import FRAMES as DRIVE_FRAMES
from robotctl.drivers.can.nodes.registry import CAN_NODES
from robotctl.errors import ConfigError
from robotctl.messages.control import EmergencyStopSource

COMMAND: Final = "MotorCommand"
EMERGENCY_STOP: Final = "EmergencyStop"
SYNC: Final = "Sync"
NMT: Final = "NmtControl"


class RobotCodec:
    """Compiled functions for the frames of the robot.

    Parameters
    ----------
    dbc
        A file with the messages of `configs/robot.dbc`.

    Attributes
    ----------
    readers
        For each protected message of our drive and of `CAN_NODES`, the function from data and time
        of reception [ns] to what it says.

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
        self.host_only = {dbc.message(name).arbitration_id: name for name in (COMMAND, SYNC, NMT)}
        """Names of the frames that only the host may send, by identifier."""
        frames = [*DRIVE_FRAMES, *(frame for node in CAN_NODES for frame in node.frames)]
        for name in (COMMAND, *(frame.message for frame in frames)):
            dbc.protection(name)
        _check_data_ids(dbc)
        dbc.expect_values(EMERGENCY_STOP, "EmergencyStopSource", EmergencyStopSource)
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
        self.readers: dict[str, Callable[[bytes, int], Value]] = {
            frame.message: frame.reader(self) for frame in frames
        }

    def decoder(self, message: str, *signals: str, raw: Collection[str] = ()) -> Decoder:
        """Return the decoder of some signals, those of `raw` unscaled."""
        names = _present(self.dbc, message, *signals)
        return compile_decoder(self.dbc.message(message), names, raw)


def _present(dbc: Dbc, message: str, *signals: str) -> tuple[str, ...]:
    """Return the names of signals that must exist."""
    return tuple(dbc.signal(message, name).name for name in signals)


def _check_data_ids(dbc: Dbc) -> None:
    """Refuse data ids whose CRC does not distinguish the messages.

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
                f"has the CRC of {other.name}'s 0x{other.protection.data_id:04X}, so each would be "
                "accepted as the other"
            )
