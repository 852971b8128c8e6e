"""The bus-load budget: the share of the bus that the protocol of the DBC takes at a loop rate.

Frame lengths are the worst case of bit stuffing (Davis, Burns, Bril, Lukkien, "Controller Area
Network (CAN) schedulability analysis", 2007, eq. 1): a classic frame with an 11-bit identifier and
n data bytes takes at most 55 + 10 n bits, interframe space included.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from robotctl.drivers.can.dbc import Dbc, Message

MAX_LOAD: Final = 0.5
"""Share of the wire that cyclic traffic may take at most."""

SYNC: Final = "Sync"
COMMAND: Final = "MotorCommand"
STEERING_STATUS: Final = "DriveStatus"
SONARS_PER_FRAME: Final = 4

_SONAR_FRAMES = ("SonarRangesA", "SonarRangesB", "SonarRangesC", "SonarRangesD")
_TRANSMISSION_TYPE_MAX = 240
_IMU = "IMU"


@dataclass(frozen=True, slots=True)
class MessageLoad:
    """One message: its period [ms], worst-case length [bit], share of the wire [0, 1]."""

    name: str
    arbitration_id: int
    period_ms: float
    bits: int
    load: float


@dataclass(frozen=True, slots=True)
class BusLoad:
    """The budget: `total` is a share of the wire [0, 1]; rows are in the order of urgency."""

    rate_hz: float
    bitrate: int
    total: float
    rows: tuple[MessageLoad, ...]


def worst_case_bits(length: int) -> int:
    """Return the longest a frame of `length` data bytes can be on the wire [bit]."""
    return 55 + 10 * length


def nominal_bits(length: int) -> int:
    """Return the length of a frame of `length` data bytes without any stuff bit [bit]."""
    return 47 + 8 * length


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
    bitrate: int,
    *,
    sonars: int = 16,
    steered: bool = False,
    imu: bool = False,
) -> BusLoad:
    """Add up the cyclic traffic. Events (EMCY, NMT, SDO, emergency stop) are not in it.

    Parameters
    ----------
    dbc
        Messages and their cycle times.
    rate_hz
        Rate of the control loop, hence of SYNC, MotorCommand and what is sent on every SYNC [Hz].
    bitrate
        [bit/s].
    sonars
        Number of sonars, which decides how many frames of ranges there are.
    steered
        Whether DriveStatus comes on every SYNC, as on a robot with a steering angle.
    imu
        Whether there is an IMU.

    Raises
    ------
    ConfigError
        If the DBC has no SYNC.
    """
    sync = dbc.message(SYNC)
    absent = _SONAR_FRAMES[-(-sonars // SONARS_PER_FRAME) :]
    rows = []
    for message in sorted(dbc.messages.values(), key=lambda m: m.arbitration_id):
        if message.cycle_ms == 0 or message.name in absent:
            continue
        if not imu and message.senders == (_IMU,):
            continue
        period_ms = _period_ms(message, sync, rate_hz, steered=steered)
        bits = worst_case_bits(message.length)
        load = bits / bitrate / period_ms * 1000
        rows.append(MessageLoad(message.name, message.arbitration_id, period_ms, bits, load))
    return BusLoad(rate_hz, bitrate, sum(row.load for row in rows), tuple(rows))


def _period_ms(message: Message, sync: Message, rate_hz: float, *, steered: bool) -> float:
    """Return the time between two frames of a cyclic message [ms]."""
    loop_period_ms = 1000 / rate_hz
    if message.name in (SYNC, COMMAND):
        return loop_period_ms
    if message.send_type == "OnSync":
        return loop_period_ms * transmission_type(message, sync, rate_hz, steered=steered)
    return message.cycle_ms
