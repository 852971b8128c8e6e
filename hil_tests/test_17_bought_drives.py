"""Drives that people can buy, as processes on a real bus: proof, motion, and what a dead host does.

With the twins of `firmware_sim`; on `vcan0` that is real SocketCAN, CAN FD for moteus.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from hil_tests.rig import PATIENT_S, Rig
from robotctl.app.supervision.stack import CONTROL
from robotctl.config.robot_file import find_file, load_robot
from robotctl.drivers.can.config import FD_MTU
from robotctl.messages.control import SafetyState
from robotctl.messages.faults import FaultCode
from tests.drivers.can.drives.drive_rig import DriveRig

sys.path.append(str(Path(__file__).parents[1] / "tools"))
import can_link

ROBOTS = ("odrive", "vesc_car", "moteus", "zlac8015d", "roboteq", "cia402", "skid_steer", "mecanum")
SHORT_MTU = 16
MONITOR_MS = 6.0
"""The simulator looks at the wheels' power each 5 ms, in steps of 1 ms."""
HOST_MS = 5.0
"""From the last frame of the host to its end."""

React = Callable[[str, float], None]


def proofs(robot: str) -> str:
    """Return the table `[proof]` of a robot, by what its twins tell in lockstep."""
    drives = DriveRig(robot).commission().parts.drives
    lines = (f"{each.drive.status.name}={json.dumps(each.drive.proof)}" for each in drives)
    return f"proof={{{', '.join(lines)}}}"


@pytest.fixture
def make_bench(bus: str, make_rig: Callable[..., Rig]) -> Iterator[Callable[..., Rig]]:
    """Makes a bench of a robot, on an interface that carries its frames."""
    is_long = False

    def make(robot: str, **kwargs: str) -> Rig:
        nonlocal is_long
        is_fd = any(each.data_bitrate for each in load_robot(find_file(robot)).buses)
        if bus.startswith("vcan") and is_fd:
            is_long = True
            change_mtu(bus, FD_MTU)
        rig = make_rig(robot=robot, **kwargs)
        rig.tolerates_rejects = True  # no controller of ours counts them
        rig.start_firmware()
        rig.start()
        return rig

    yield make
    if is_long:
        change_mtu(bus, SHORT_MTU)


def change_mtu(interface: str, mtu: int) -> None:
    """Set the longest frame of a virtual interface [byte]."""
    can_link.set_link(interface, up=False)
    can_link.set_mtu(interface, mtu)
    can_link.set_link(interface, up=True)


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_killed_host_is_stopped_by_the_drives_themselves(
    robot: str, make_bench: Callable[..., Rig], reaction: React
) -> None:
    rig = make_bench(robot, override=proofs(robot))
    rig.arm()
    before = rig.fresh_truth()
    rig.drive(0.3, 0.0, 1.5)
    driving = rig.fresh_truth()
    assert driving.x_m - before.x_m > 0.2
    assert abs(driving.y_m - before.y_m) < 0.05
    rig.at_any_moment()
    killed_ns = time.monotonic_ns()
    rig.kill(CONTROL)
    rig.wait(lambda: rig.truth.power_off_ns > killed_ns - 10_000_000, 3.0, "the wheels lose power")
    taken_ms = (rig.truth.power_off_ns - killed_ns) / 1e6
    reaction(f"host: SIGKILL, {robot}", taken_ms)
    period_ms = rig.config.runtime.period_ns / 1e6
    assert taken_ms <= rig.config.safety.command_timeout_ms + period_ms + MONITOR_MS + HOST_MS
    rig.at_rest()


@pytest.mark.parametrize("robot", ["odrive", "moteus"])
def test_a_drive_that_was_never_proven_does_not_arm_on_a_real_bus(
    robot: str, bus: str, make_bench: Callable[..., Rig]
) -> None:
    if bus == "simcan":
        pytest.skip("nothing hangs on a simulated bus: it needs no proof")
    rig = make_bench(robot)
    rig.wait(
        lambda: (
            rig.control
            and any(node.fault == FaultCode.DRIVE_UNPROVEN for node in rig.control.nodes)
        ),
        PATIENT_S,
        "the drive is named as not proven",
    )
    rig.ask_to_arm()
    rig.velocity(0.3, 0.0)
    time.sleep(1.0)
    rig.listen()
    assert rig.control.state in (SafetyState.BOOT, SafetyState.STANDBY)
    assert rig.fresh_truth().distance_m == 0.0
