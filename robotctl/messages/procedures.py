"""Procedures that control carries out while the robot is disarmed, and their progress."""

from __future__ import annotations

import enum

import msgspec


class Outcome(enum.IntEnum):
    """State of a procedure."""

    NONE = 0
    RUNNING = 1
    DONE = 2
    REFUSED = 3
    """Refused: never started."""
    FAILED = 4
    CANCELLED = 5


class CalibrateGyro(msgspec.Struct, frozen=True, tag=True):
    """Request to measure the gyro's bias again."""

    stamp_ns: int
    request_id: int


class MotorTest(msgspec.Struct, frozen=True, tag=True):
    """Request to turn one wheel; to be repeated, since it is void after `expires_ns`.

    `wheel` counts from 0, in the order of the drive. `effort` is the share of the supply's voltage
    at its motor, [-1, 1], positive forwards. It lasts `duration_ns` (ns).
    """

    stamp_ns: int
    expires_ns: int
    request_id: int
    wheel: int
    effort: float
    duration_ns: int


class CancelProcedure(msgspec.Struct, frozen=True, tag=True):
    """Request to end a procedure at once."""

    stamp_ns: int
    request_id: int


class Procedure(msgspec.Struct, frozen=True):
    """The last requested procedure.

    `progress` is the completed share [0, 1]; `text` the result, or why it ended.
    """

    request_id: int = 0
    outcome: Outcome = Outcome.NONE
    progress: float = 0.0
    text: str = ""
