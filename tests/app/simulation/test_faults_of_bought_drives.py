"""Faults of the catalogue on robots with bought drives, with the control core in the loop.

Whatever fails, the wheels lose their power in time, the host says why, and nothing starts again by
itself, although the velocity is commanded on and on.
"""

from __future__ import annotations

from typing import NamedTuple

import pytest

from hil_tests.fault_rows import BUS_BROKEN, NODE_GONE, Row
from reactions import MILLISECOND_NS, Run, can_feel
from robotctl.app.simulation.simulator_files import simulated_robot
from robotctl.config.robot_file import find_file
from robotctl.messages.faults import FaultCode as C


class Drive(NamedTuple):
    """First drive of a robot: name, frames of its motion and of its command, a fault of its own."""

    name: str
    feedback: int
    command: int
    fault: int
    code: C
    words: str


ROBOTS = {
    "odrive": Drive("left_drive", 0x429, 0x42D, 0x400, C.DRIVE_OVER_CURRENT, "DC_BUS_OVER_CURRENT"),
    "skid_steer": Drive(
        "drive_front_left", 0x29, 0x2D, 0x4000000, C.DRIVE_ENCODER, "SPINOUT_DETECTED"
    ),
    "vesc_car": Drive("vesc", 0x8000_090A, 0x8000_030A, 3, C.DRIVE_FAULT, "gate driver"),
    "moteus": Drive("moteus_left", 0x100, 0x8000_8001, 35, C.DRIVE_ENCODER, "encoder"),
    "mecanum": Drive("moteus_front_left", 0x100, 0x8000_8001, 33, C.DRIVE_FAULT, "motor driver"),
    "cia402": Drive("motors", 0x18A, 0x20A, 0x7305, C.DRIVE_ENCODER, "incremental sensor 1"),
    "zlac8015d": Drive("motors", 0x18A, 0x20A, 0x0200, C.DRIVE_ENCODER, "Hall sensor"),
    "roboteq": Drive("motors", 0x18A, 0x20A, 0x40, C.DRIVE_FAULT, "MOSFET failure"),
}

WHEEL = frozenset({C.WHEEL_ASTRAY})
# An ODrive has a limit of speed of its own.
RUNS_AWAY = WHEEL | {C.DRIVE_FAULT, C.ENCODER_JUMPS}
STALE = frozenset({C.WHEELS_STALE, C.MOTOR_STALE})
GONE = STALE | frozenset(NODE_GONE) | {C.BUS_SILENT}
# Frames that a ZLAC8015D could not send follow later and say that it is enabled.
CUT = BUS_BROKEN | GONE | {C.DRIVES_UNASKED}
# Without a checksum any field may be the one that lies, such as the clock of a moteus.
UNREADABLE = frozenset(
    {C.DRIVE_UNREADABLE, C.DRIVE_FAULT, C.DRIVE_STOPPED, C.ENCODER_JUMPS, C.ENCODER_WRONG}
    | {C.NODE_RESTARTED}
)


def rows(drive: Drive) -> tuple[Row, ...]:
    """Return the faults, with a time that the drive's own braking is part of."""
    name, feedback, command = drive.name, f"id={drive.feedback:#x}", f"id={drive.command:#x}"
    return (
        Row("encoder_stuck wheel=left", WHEEL, 250),
        Row("encoder_reversed wheel=left", RUNS_AWAY, 250),
        Row("wheels_swapped", frozenset({C.ENCODERS_SWAPPED}), 250),
        Row("wheel_blocked wheel=left", WHEEL, 250),
        Row("feedback_frozen", frozenset({C.ENCODER_STUCK}), 500),
        Row("over_current amperes=30", frozenset({C.DRIVE_OVER_CURRENT}), 200),
        Row("over_temperature kelvin=170", frozenset({C.DRIVE_OVER_TEMPERATURE}), 200),
        Row("brown_out volts=4", frozenset({C.DRIVE_UNDER_VOLTAGE}), 250),
        Row(f"drive_fault drive={name} code={drive.fault}", frozenset({drive.code}), 200),
        Row(f"node_reset node={name}", GONE, 100),
        Row(f"node_silent node={name} duration=0.5", GONE, 200),
        Row(f"node_cut node={name} duration=0.3", CUT, 105),
        Row("bus_cut duration=0.3", CUT, 105),
        Row(f"frames_lost {feedback} duration=0.5", STALE, 350),
        Row(f"frames_lost {command} duration=0.5", STALE | {C.DRIVE_COMMAND_TIMEOUT}, 105),
        # The field that lies may be the supply.
        Row(
            f"frames_corrupt {feedback} duration=0.5",
            UNREADABLE | WHEEL | {C.DRIVE_UNDER_VOLTAGE},
            350,
        ),
    )


def feels(robot: str, row: Row) -> bool:
    """Return whether the robot shows the fault: by its parts, and by its protocol."""
    # The heartbeat of the host, not its commands, keeps drives of CiA 402 alive.
    is_alive = row.fault.startswith("frames_lost id=0x20a")
    return not is_alive and can_feel(simulated_robot(find_file(robot)), row)


FELT = [
    pytest.param(robot, row, id=f"{robot}-{row.name}")
    for robot, drive in ROBOTS.items()
    for row in rows(drive)
    if feels(robot, row)
]


@pytest.mark.parametrize(("robot", "row"), FELT)
def test_the_robot_stops_in_time_says_why_and_stays_so(robot, row):
    run = Run(find_file(robot), 11, 0.3)
    run.drive(run.now_ns() + 600 * MILLISECOND_NS)
    assert run.reaction_ms(row, 0) <= row.limit_ms
    code, part = run.fault()
    assert row.explains(code, part), (code.name, part, run.reason())
    if row.fault.startswith("drive_fault"):
        assert part == ROBOTS[robot].name
        assert ROBOTS[robot].words in run.reason()
    run.simulation.faults.clear()
    assert not run.insist(500 * MILLISECOND_NS)


def test_what_a_drive_does_not_watch_is_no_fault_of_its_robot():
    missing = {
        robot: {row.fault.split()[0] for row in rows(drive) if not feels(robot, row)}
        for robot, drive in ROBOTS.items()
    }
    on_the_heartbeat, hot, flowing = "frames_lost", "over_temperature", "over_current"
    assert missing == {
        "odrive": {hot},
        "skid_steer": {hot},
        "vesc_car": {"wheels_swapped"},
        "moteus": {flowing},
        "mecanum": {flowing},
        **{key: {on_the_heartbeat} for key in ("cia402", "zlac8015d", "roboteq")},
    }
