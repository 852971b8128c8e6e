"""Bring-up, first step: is there a bus, and who is on it?"""

from itertools import pairwise

import pytest

from hil_tests.bus_tool import NODE_NAMES
from hil_tests.rig import Rig


def test_without_a_host_each_node_sends_ten_times_a_second_that_it_is_pre_operational_and_no_more(
    rig: Rig,
) -> None:
    messages = rig.heard(1.55)
    assert {m.arbitration_id for m in messages} == {0x700 + node for node in NODE_NAMES}
    assert {bytes(m.data) for m in messages} == {b"\x7f"}
    for node in NODE_NAMES:
        stamps = [m.timestamp for m in messages if m.arbitration_id == 0x700 + node]
        assert len(stamps) >= 14, node
        gaps = [b - a for a, b in pairwise(stamps)]
        assert sum(gaps) / len(gaps) == pytest.approx(0.1, rel=0.05), node


def test_the_bus_carries_no_error_frames_while_the_robot_drives(armed: Rig) -> None:
    armed.velocity(0.3, 0.0, ttl_s=1.0)
    messages = armed.heard(1.0)
    assert len(messages) > 500
    assert not any(m.is_error_frame for m in messages)
