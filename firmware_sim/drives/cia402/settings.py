"""`[simulation.twin.NAME]` of a CiA 402 drive: its true properties, documented or not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from firmware_sim.config.quantities import NotNegative, Positive, closed

NodeId: TypeAlias = Annotated[int, Field(strict=True, ge=0, le=127)]
Counts: TypeAlias = Annotated[int, Field(strict=True, ge=0, le=10_000_000)]
Unsigned: TypeAlias = Annotated[int, Field(strict=True, ge=0, le=0xFFFF_FFFF)]


@closed
@dataclass(frozen=True, slots=True)
class Cia402Settings:
    """The true drive.

    Attributes
    ----------
    node_id
        Its node id; 0: as the robot's file says.
    counts_per_turn
        Position units in one turn of its motors; 0: as the robot's file says.
    boot_ms
        Time from power-up to the boot-up message [ms].
    vendor, product
        Identity, object 1018h.
    profile
        Device profile, the low word of 1000h.
    lacks
        Indices of objects that this firmware does not have, in hexadecimal.
    stop_options
        Values that 605Ah and 605Eh take.
    quick_stop, fault_stop
        Reactions of a drive without 605Ah or 605Eh, as values of those.
    sdo_pause_ms
        Minimum pause between SDO requests; an earlier one is lost [ms].
    current_limit_a
        Maximum current of a motor [A]; a quarter more is a fault.
    motor_max_c
        Motor temperature above which the drive has a fault [degC].
    rated_current_a
        Object 6075h [A].
    speed_max_rad_s
        Maximum controlled speed of a motor [rad/s].
    off_line_frames
        Frames that restart its off-line time: all to it, or commands by PDO.
    off_line_reaction
        Reaction after its off-line time.
    off_line_ms
        Off-line time that the maker's tool has set where CANopen cannot, Roboteq's RWD [ms]; 0: the
        one of 2000h, if it has that, else none.
    ramps_are_full_scale
        ZLAC8015D: whether 6083h and 6084h are times from rest to the maximum speed, not from
        speed to speed.
    lost_reaction
        Reaction of a drive without 6007h to a silent host: goes on, coasts, or brakes.
    heals
        Whether it leaves the fault state unasked when the cause is over.
    """

    node_id: NodeId = 0
    counts_per_turn: Counts = 0
    boot_ms: NotNegative = 50.0
    vendor: Unsigned = 0
    product: Unsigned = 0
    profile: Unsigned = 402
    lacks: tuple[str, ...] = ()
    stop_options: tuple[int, ...] = (0, 1, 2, 3, 4, 5, 6, 7, 8)
    quick_stop: Annotated[int, Field(strict=True, ge=0, le=8)] = 2
    fault_stop: Annotated[int, Field(strict=True, ge=0, le=4)] = 0
    sdo_pause_ms: NotNegative = 0.0
    current_limit_a: Positive = 20.0
    motor_max_c: Positive = 120.0
    rated_current_a: Positive = 10.0
    speed_max_rad_s: Positive = 1000.0
    off_line_frames: Literal["all", "commands"] = "all"
    off_line_reaction: Literal["brake", "coast", "fault"] = "brake"
    off_line_ms: NotNegative = 0.0
    ramps_are_full_scale: bool = True
    lost_reaction: Literal["none", "coast", "brake"] = "none"
    heals: bool = False
