"""A robot with an IMU: it comes up, feeds, is missed by its name, and is needed to arm."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from hil_tests.rig import PATIENT_S, Rig
from robotctl.config.robot_file import find_file
from robotctl.messages.control import SafetyState
from robotctl.messages.faults import FaultCode

IMU = 4
WITH_IMU = "[imu]\nenabled = true"
GONE = {(FaultCode.IMU_STALE, "imu"), (FaultCode.NODE_SILENT, "imu")}


def robot_file(directory: Path) -> str:
    """Write the default robot with its IMU switched on, as a user would."""
    text = find_file("diff_drive").read_text(encoding="utf-8")
    assert text.count("[imu]\nenabled = false") == 1
    path = directory / "with_imu.toml"
    path.write_text(text.replace("[imu]\nenabled = false", WITH_IMU), encoding="utf-8")
    return str(path)


@pytest.fixture
def sensing(make_rig: Callable[..., Rig], tmp_path: Path) -> Rig:
    """Firmware with an IMU, and control, ready to arm."""
    rig = make_rig(robot=robot_file(tmp_path))
    rig.start_firmware()
    rig.start()
    rig.wait_for_state(SafetyState.STANDBY)
    return rig


def test_the_imu_says_who_it_is_and_is_brought_into_service_with_the_others(sensing: Rig) -> None:
    assert sensing.read_objects(IMU, [(0x1018, 1), (0x1018, 2)]) == [0x00526F62, IMU]
    assert sensing.control is not None
    assert [(node.name, node.problem) for node in sensing.control.nodes] == [
        (name, "") for name in ("drive", "sonar", "power", "imu")
    ]
    assert sensing.read_objects(IMU, [(0x2400, 0)]) == [20]


def test_the_robot_drives_with_it_and_stops_by_its_name_when_it_dies(sensing: Rig) -> None:
    sensing.arm()
    sensing.drive(0.2, 0.0, 0.3)
    sensing.inject("node_silent node=imu duration=1.5")
    state = sensing.wait_for_state(SafetyState.FAULT)
    assert (state.fault, state.fault_part) in GONE, state.reason
    sensing.wait(
        lambda: sensing.control is not None and sensing.control.nodes[-1].problem,
        PATIENT_S,
        "the node is missed",
    )
    assert sensing.control is not None
    assert sensing.control.nodes[-1].problem.startswith("imu (node 4): no heartbeat for")


@pytest.mark.parametrize(
    ("fault", "code"),
    [
        ("tilted pitch=40", FaultCode.ROBOT_TILTED),
        ("tilted pitch=0 roll=-40", FaultCode.ROBOT_TILTED),
        ("carried", FaultCode.PICKED_UP),
        ("imu_stuck", FaultCode.IMU_STUCK),
        ("gyro_biased rate=1", FaultCode.GYRO_CONTRADICTS),
    ],
)
def test_the_robot_stops_by_what_its_imu_says(sensing: Rig, fault: str, code: FaultCode) -> None:
    sensing.arm()
    sensing.drive(0.2, 0.4, 0.3)
    sensing.inject(fault)
    sensing.velocity(0.2, 0.4, 5.0)
    state = sensing.wait_for_state(SafetyState.FAULT)
    assert state.fault is code, state.reason


def test_without_the_imu_that_it_must_have_the_robot_does_not_arm(sensing: Rig) -> None:
    sensing.inject("node_silent node=imu duration=3600")
    state = sensing.wait_for_state(SafetyState.BOOT)
    assert (state.fault, state.fault_part) == (FaultCode.NODE_SILENT, "imu"), state.reason
    request = sensing.ask_to_arm()
    sensing.wait(lambda: request in sensing.acks, PATIENT_S, "the answer")
    assert not sensing.acks[request].accepted
    reasons = {(reason.code, reason.part) for reason in sensing.acks[request].reasons}
    assert (FaultCode.NODE_SILENT, "imu") in reasons


def test_a_robot_that_wants_no_imu_does_not_ask_for_it(armed: Rig) -> None:
    assert armed.control is not None
    assert "imu" not in [node.name for node in armed.control.nodes]
