"""Bring-up, second step: are they the nodes we think, with the parameters we want?"""

import zlib

from hil_tests.bus_tool import DRIVE, NODE_NAMES
from hil_tests.rig import Rig
from robotctl.config.robot_file import config_directory
from robotctl.messages.control import SafetyState
from robotctl.messages.faults import FaultCode


def test_each_node_tells_who_it_is_and_the_drive_that_it_speaks_the_wire_of_our_dbc(
    rig: Rig,
) -> None:
    for node in NODE_NAMES:
        vendor, product = rig.read_objects(node, [(0x1018, 1), (0x1018, 2)])
        assert (vendor, product) == (0x00526F62, node)
    (wire,) = rig.read_objects(DRIVE, [(0x2001, 0)])
    assert wire == zlib.crc32((config_directory() / "robot.dbc").read_bytes())


def test_the_host_brings_all_nodes_into_service_writes_the_time_out_and_waits_to_be_armed(
    rig: Rig,
) -> None:
    rig.start()
    state = rig.wait_for_state(SafetyState.STANDBY)
    assert [(node.name, node.problem) for node in state.nodes] == [
        (name, "") for name in NODE_NAMES.values()
    ]
    assert rig.read_objects(DRIVE, [(0x2000, 0)]) == [rig.config.safety.command_timeout_ms]


def test_without_the_firmware_the_host_says_what_is_missing_and_does_not_arm(make_rig) -> None:
    rig = make_rig()
    rig.start_firmware()
    rig.start()
    rig.wait_for_state(SafetyState.STANDBY)
    rig.kill("firmware")
    state = rig.wait_for_state(SafetyState.BOOT)
    assert (state.fault, state.fault_part) == (FaultCode.NODE_SILENT, "drive"), state.reason
