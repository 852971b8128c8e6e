"""The operator of simulated runs asks for arming and for AUTO, each until it was had once."""

from __future__ import annotations

import msgspec
import pytest

from robotctl.app.processes.robot import make_core
from robotctl.app.simulation.operator import MissionOperator
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.messages.control import (
    ControlState,
    LoopStatistics,
    Mode,
    NavigationState,
    SafetyState,
)
from robotctl.safety.state_machine import POWERED

STATE = make_core(load_robot(find_file("diff_drive")), StackOptions("x", "")).snapshot(
    0, LoopStatistics()
)
SECOND_NS = 1_000_000_000


def control(state: SafetyState) -> ControlState:
    return msgspec.structs.replace(STATE, state=state)


def navigation(mode: Mode) -> NavigationState:
    return NavigationState(
        stamp_ns=0,
        mode=mode,
        mission="m",
        item=0,
        items=1,
        item_name="",
        mission_completed=False,
        mission_failed=False,
        message="",
    )


@pytest.fixture
def ready() -> MissionOperator:
    """An operator who sees a robot that may be armed."""
    operator = MissionOperator()
    operator.hear(control(SafetyState.STANDBY))
    operator.hear(navigation(Mode.HOLD))
    return operator


def test_nothing_is_asked_for_before_navigation_is_there() -> None:
    operator = MissionOperator()
    operator.hear(control(SafetyState.STANDBY))
    assert operator.arming(SECOND_NS) is None
    operator.hear(control(SafetyState.ARMED))
    assert operator.mode(SECOND_NS) is None


def test_arming_is_asked_for_again_half_a_second_later(ready: MissionOperator) -> None:
    first = ready.arming(SECOND_NS)
    assert first is not None
    assert ready.arming(SECOND_NS + 499_999_999) is None
    again = ready.arming(SECOND_NS + 500_000_000)
    assert again is not None
    assert again.request_id > first.request_id


@pytest.mark.parametrize("state", [each for each in SafetyState if each != SafetyState.STANDBY])
def test_arming_is_asked_for_in_standby_alone(ready: MissionOperator, state: SafetyState) -> None:
    ready.hear(control(state))
    assert ready.arming(SECOND_NS) is None


def test_who_was_armed_once_is_not_armed_again(ready: MissionOperator) -> None:
    assert ready.arming(SECOND_NS) is not None
    ready.hear(control(SafetyState.ARMED))
    ready.hear(control(SafetyState.STANDBY))
    assert ready.arming(9 * SECOND_NS) is None


@pytest.mark.parametrize("state", sorted(POWERED))
def test_auto_is_asked_for_until_the_robot_steers_itself(
    ready: MissionOperator, state: SafetyState
) -> None:
    ready.hear(control(state))
    wish = ready.mode(SECOND_NS)
    assert wish is not None
    assert wish.mode is Mode.AUTO
    assert ready.mode(SECOND_NS + 1) is None
    assert ready.mode(2 * SECOND_NS) is not None
    ready.hear(navigation(Mode.AUTO))
    ready.hear(navigation(Mode.HOLD))
    assert ready.mode(9 * SECOND_NS) is None


def test_whoever_sits_at_the_keys_has_the_robot_from_then_on(ready: MissionOperator) -> None:
    assert not ready.arm(SECOND_NS, arm=False).arm
    assert ready.arming(9 * SECOND_NS) is None
    ready.hear(control(SafetyState.ARMED))
    assert ready.set_mode(SECOND_NS, Mode.MANUAL).mode is Mode.MANUAL
    assert ready.mode(9 * SECOND_NS) is None
