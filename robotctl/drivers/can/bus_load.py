"""The bus-load budget: the share of the bus that the protocol of the DBC takes at a loop rate.

Frame lengths are the worst case of bit stuffing (Davis, Burns, Bril, Lukkien, "Controller Area
Network (CAN) schedulability analysis", 2007, eq. 1): a classic frame with an 11-bit identifier and
n data bytes takes at most 55 + 10 n bits, interframe space included, and with a 29-bit identifier
80 + 10 n.

A frame of CAN FD (ISO 11898-1:2015) has two bit rates. At the first it has start of frame,
identifier and control bits up to BRS, 17 or 36 bits with at most 3 or 8 stuff bits, and
acknowledgement, end of frame and interframe space, 12 bits. At the second it has ESI, DLC, data,
at most 1 + 2 n stuff bits, and the CRC field with its fixed stuff bits and delimiter: 28 bits, and
33 for more than 16 bytes.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final, NamedTuple

from robotctl.drivers.can.config import CanConfig
from robotctl.drivers.can.dbc import HOST, Dbc, Message, urgency
from robotctl.errors import ConfigError
from robotctl.messages.ports import EXTENDED_FLAG, FD_FLAG

MAX_LOAD: Final = 0.5
"""Share of the wire that cyclic traffic may take at most."""

SYNC: Final = "Sync"
COMMAND: Final = "MotorCommand"
STEERING_STATUS: Final = "DriveStatus"
DRIVE: Final = "DRIVE"
"""Our motor controller, by its name in the DBC."""
SONARS_PER_FRAME: Final = 4

_SONAR_FRAMES = ("SonarRangesA", "SonarRangesB", "SonarRangesC", "SonarRangesD")
_TRANSMISSION_TYPE_MAX = 240
_IMU = "IMU"
_SHORT_CRC_LENGTH = 16
"""Data bytes up to which CAN FD has the CRC of 17 bits."""


class FrameBits(NamedTuple):
    """Length of a frame [bit] at the bit rate, and at the data bit rate of CAN FD."""

    nominal: int
    data: int = 0

    def seconds(self, bus: CanConfig) -> float:
        """Return how long the frame takes on a bus [s]; one of CAN FD only on such a bus."""
        if not self.data:
            return self.nominal / bus.bitrate
        return self.nominal / bus.bitrate + self.data / bus.data_bitrate


class Cyclic(NamedTuple):
    """A frame that robot.dbc does not have, and how often it is sent.

    Parameters
    ----------
    name
        Its name.
    arbitration_id
        Its identifier, with flags as in `Frame`.
    length
        Data bytes; of a remote request none, whatever it asks for.
    rate_hz
        Frames a second, at most.
    """

    name: str
    arbitration_id: int
    length: int
    rate_hz: float


@dataclass(frozen=True, slots=True)
class MessageLoad:
    """One message: its period [ms], worst-case length, share of the wire [0, 1]."""

    name: str
    arbitration_id: int
    period_ms: float
    bits: FrameBits
    load: float


@dataclass(frozen=True, slots=True)
class BusLoad:
    """The budget: `total` is a share of the wire [0, 1]; rows are in the order of urgency."""

    rate_hz: float
    bus: CanConfig
    total: float
    rows: tuple[MessageLoad, ...]


def worst_case_bits(arbitration_id: int, length: int) -> FrameBits:
    """Return the longest that a frame of `length` data bytes can be, by its flags as in `Frame`."""
    bits = nominal_bits(arbitration_id, length)
    extended = arbitration_id & EXTENDED_FLAG
    if arbitration_id & FD_FLAG:
        return FrameBits(bits.nominal + (8 if extended else 3), bits.data + 1 + 2 * length)
    return FrameBits(bits.nominal + (13 if extended else 8) + 2 * length)


def nominal_bits(arbitration_id: int, length: int) -> FrameBits:
    """Return the length of a frame without dynamic stuff bits, as `worst_case_bits`."""
    extended = arbitration_id & EXTENDED_FLAG
    if arbitration_id & FD_FLAG:
        crc_field = 28 if length <= _SHORT_CRC_LENGTH else 33
        return FrameBits(48 if extended else 29, 5 + 8 * length + crc_field)
    return FrameBits((67 if extended else 47) + 8 * length)


def transmission_type(message: Message, sync: Message, rate_hz: float, *, steered: bool) -> int:
    """Return n such that a PDO sent on every n-th SYNC keeps its cycle time at another rate.

    A message that the DBC gives the cycle of SYNC itself comes on every SYNC at any rate, and so
    does the steering angle of a robot that is `steered`.
    Source: CiA 301, transmission types 1 to 240.
    """
    if message.cycle_ms <= sync.cycle_ms or (steered and message.name == STEERING_STATUS):
        return 1
    return min(max(round(message.cycle_ms * rate_hz / 1000), 1), _TRANSMISSION_TYPE_MAX)


def budget(
    dbc: Dbc,
    rate_hz: float,
    bus: CanConfig,
    *,
    sonars: int = 16,
    steered: bool = False,
    imu: bool = False,
    elsewhere: Collection[str] = (),
    foreign: Collection[Cyclic] = (),
) -> BusLoad:
    """Add up the cyclic traffic. Events (EMCY, NMT, SDO, emergency stop) are not in it.

    Parameters
    ----------
    dbc
        Messages and their cycle times.
    rate_hz
        Rate of the control loop, hence of SYNC, MotorCommand and what is sent on every SYNC [Hz].
    bus
        Its bit rates.
    sonars
        Number of sonars, which decides how many frames of ranges there are.
    steered
        Whether DriveStatus comes on every SYNC, as on a robot with a steering angle.
    imu
        Whether there is an IMU.
    elsewhere
        Nodes, by their names in the DBC, that are not on this bus.
    foreign
        Frames of drives that the DBC does not have. One of an identifier that it has is the same.

    Raises
    ------
    ConfigError
        If the DBC has no SYNC, or messages of CAN FD for a bus without it.
    """
    sync = dbc.message(SYNC)
    absent = _SONAR_FRAMES[-(-sonars // SONARS_PER_FRAME) :]
    rows = []
    for message in sorted(dbc.messages.values(), key=lambda m: urgency(m.arbitration_id)):
        if message.cycle_ms == 0 or message.name in absent:
            continue
        if not imu and message.senders == (_IMU,):
            continue
        nodes = {*message.senders, *message.receivers} - {HOST}
        if nodes and nodes.issubset(elsewhere):
            continue
        if message.name == SYNC and DRIVE in elsewhere:
            continue  # no other node of ours waits for it
        period_ms = _period_ms(message, sync, rate_hz, steered=steered)
        _check_fd(message.arbitration_id, f"{dbc.path}: {message.name} is a message", bus)
        bits = worst_case_bits(message.arbitration_id, message.length)
        load = bits.seconds(bus) / period_ms * 1000
        rows.append(MessageLoad(message.name, message.arbitration_id, period_ms, bits, load))
    known = {row.arbitration_id for row in rows}
    rows += [_foreign_load(each, bus) for each in foreign if each.arbitration_id not in known]
    rows.sort(key=lambda row: urgency(row.arbitration_id))
    return BusLoad(rate_hz, bus, sum(row.load for row in rows), tuple(rows))


def _foreign_load(frame: Cyclic, bus: CanConfig) -> MessageLoad:
    """Return the load of a frame that the DBC does not have."""
    _check_fd(frame.arbitration_id, f"{frame.name} is a frame", bus)
    bits = worst_case_bits(frame.arbitration_id, frame.length)
    load = bits.seconds(bus) * frame.rate_hz
    return MessageLoad(frame.name, frame.arbitration_id, 1000.0 / frame.rate_hz, bits, load)


def _check_fd(arbitration_id: int, what: str, bus: CanConfig) -> None:
    """Raise ConfigError for a frame of CAN FD on a bus without it."""
    if arbitration_id & FD_FLAG and not bus.data_bitrate:
        raise ConfigError(
            f'{what} of CAN FD, but can.data_bitrate of the bus "{bus.name}" is 0; set it to the '
            "drives' data bit rate"
        )


def _period_ms(message: Message, sync: Message, rate_hz: float, *, steered: bool) -> float:
    """Return the time between two frames of a cyclic message [ms]."""
    loop_period_ms = 1000 / rate_hz
    if message.name in (SYNC, COMMAND):
        return loop_period_ms
    if message.send_type == "OnSync":
        return loop_period_ms * transmission_type(message, sync, rate_hz, steered=steered)
    return message.cycle_ms
