"""Faults of the CAN interface and of the wall clock, on a kernel that is ours to disturb."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Callable, Iterator

import pytest

import can_link
from hil_tests.rig import GUEST_TIME, PATIENT_S, Rig
from robotctl.messages.control import SafetyState
from robotctl.messages.faults import FaultCode


@pytest.fixture
def own_kernel(bus: str) -> Iterator[str]:
    """Name of a vcan interface that may be taken away; as it was again afterwards."""
    if not GUEST_TIME:
        pytest.skip("takes vcan0 away and sets the clock: run in tools/vcan-guest")
    yield bus
    with contextlib.suppress(FileExistsError):
        can_link.add_vcan(bus)
    can_link.set_link(bus, up=True)


def take_down(name: str) -> None:
    can_link.set_link(name, up=False)


def bring_up(name: str) -> None:
    can_link.set_link(name, up=True)


def make_anew(name: str) -> None:
    can_link.add_vcan(name)
    can_link.set_link(name, up=True)


@pytest.mark.parametrize(
    ("cut", "mend"), [(take_down, bring_up), (can_link.delete, make_anew)], ids=["down", "removed"]
)
def test_without_its_interface_the_robot_stops_and_waits_for_arming_when_it_is_back(
    own_kernel: str,
    armed: Rig,
    cut: Callable[[str], None],
    mend: Callable[[str], None],
    reaction: Callable[[str, float], None],
) -> None:
    armed.drive(0.5, 0.0, 1.0)
    armed.at_any_moment()
    cut_ns = time.monotonic_ns()
    cut(own_kernel)
    state = armed.wait_for_state(SafetyState.FAULT, 2.0)
    assert state.fault == FaultCode.BUS_DOWN, state.reason
    reaction(f"interface {cut.__name__}: host", (state.stamp_ns - cut_ns) / 1e6)
    armed.at_rest()
    mend(own_kernel)
    armed.wait(
        lambda: not any(node.problem for node in armed.control.nodes), PATIENT_S, "nodes are back"
    )
    before = armed.fresh_truth()
    armed.drive(0.5, 0.0, 1.0)
    assert armed.control.state == SafetyState.FAULT
    assert armed.truth.distance_m - before.distance_m < 1e-3
    armed.arm()
    armed.drive(0.3, 0.0, 1.0)
    assert armed.fresh_truth().distance_m - before.distance_m > 0.1


@pytest.mark.parametrize("step_s", [3600.0, -3600.0])
def test_setting_the_wall_clock_neither_stops_the_robot_nor_hides_a_silent_drive(
    own_kernel: str, armed: Rig, step_s: float, reaction: Callable[[str, float], None]
) -> None:
    armed.drive(0.5, 0.0, 0.5)
    before = armed.fresh_truth()
    time.clock_settime(time.CLOCK_REALTIME, time.time() + step_s)
    try:
        armed.drive(0.5, 0.0, 1.0)
        assert armed.fresh_truth().distance_m - before.distance_m > 0.4
        assert armed.control.state == SafetyState.DRIVING
        armed.drive(0.5, 0.0, 0.1)
        armed.at_any_moment()
        silent_ns = time.monotonic_ns()
        armed.send_signal("firmware", signal.SIGSTOP)
        state = armed.wait_for_state(SafetyState.FAULT, 1.0)
        armed.send_signal("firmware", signal.SIGCONT)
        assert state.fault == FaultCode.WHEELS_STALE, state.reason
        taken_ms = (state.stamp_ns - silent_ns) / 1e6
        reaction(f"clock stepped by {step_s:+.0f} s, then a silent drive", taken_ms)
        assert taken_ms < 100.0
    finally:
        time.clock_settime(time.CLOCK_REALTIME, time.time() - step_s)
