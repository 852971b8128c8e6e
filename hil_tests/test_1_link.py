"""Bring-up, first step: is there a bus, and who is on it?"""

from itertools import pairwise

import pytest

from hil_tests.rig import NODE_NAMES, Rig


@pytest.mark.parametrize("node", NODE_NAMES)
def test_each_node_sends_its_heartbeat_ten_times_a_second(rig: Rig, node: int) -> None:
    stamps = [m.timestamp for m in rig.heard(1.55) if m.arbitration_id == 0x700 + node]
    assert len(stamps) >= 14
    gaps = [b - a for a, b in pairwise(stamps)]
    assert sum(gaps) / len(gaps) == pytest.approx(0.1, rel=0.05)


def test_nodes_are_pre_operational_and_send_no_process_data_without_a_host(rig: Rig) -> None:
    messages = rig.heard(0.5)
    assert {m.arbitration_id for m in messages} == {0x701, 0x702, 0x703}
    assert {bytes(m.data) for m in messages} == {b"\x7f"}


def test_the_bus_carries_no_error_frames_while_the_robot_drives(armed: Rig) -> None:
    armed.velocity(0.3, 0.0, ttl_s=1.0)
    messages = armed.heard(1.0)
    assert len(messages) > 500
    assert not any(m.is_error_frame for m in messages)
