"""The real processes of a robot: killed, hung, told to stop."""

import contextlib
import errno
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import zmq

from robotctl.app.signing_files import write_new_key
from robotctl.app.supervision.child_process import start_child
from robotctl.app.supervision.restart import RestartPolicy
from robotctl.app.supervision.stack import (
    CAMERA,
    CAMERA_ROLE,
    CONTROL,
    LIDAR,
    NAVIGATION,
    ROLES,
    TELEMETRY,
    Stack,
    StackError,
)
from robotctl.app.supervision.supervised import ProcessPhase
from robotctl.config.changes import ParameterFile
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file
from robotctl.errors import ConfigError
from robotctl.messages.control import SafetyState
from robotctl.messages.supervision import LIFE_NS, Restart, ShutDown
from robotctl.runtime.ipc.topics import (
    Endpoints,
    RequestSender,
    endpoint_directory,
)
from tests.app.supervision.bench import Ear, overrides, wait


@pytest.fixture
def stack(channel: str, ear: Ear, monkeypatch: pytest.MonkeyPatch) -> Iterator[Stack]:
    """Start the stack with smaller budgets for what control can do without."""
    quick = RestartPolicy(crashes=2, first_delay_s=0.1)
    roles = [role if role.vital else replace(role, restart=quick) for role in ROLES]
    monkeypatch.setattr("robotctl.app.supervision.stack.ROLES", roles)
    robot = str(find_file("diff_drive").resolve())
    made = Stack(StackOptions("robot", robot, overrides(channel)))
    try:
        yield made
    finally:
        made.close()


def watch_until(stack: Stack, condition: Callable[[], Any], what: str) -> list[str]:
    lines: list[str] = []

    def watched() -> Any:
        lines.extend(stack.watch())
        return condition()

    wait(watched, f"{what}: {lines}")
    return lines


def test_control_starts_first_and_the_others_when_its_loop_ticks(stack: Stack) -> None:
    assert stack.phase(CONTROL) is ProcessPhase.STARTING
    assert stack.starts(NAVIGATION) == stack.starts(TELEMETRY) == 0
    watch_until(stack, lambda: stack.starts(NAVIGATION), "navigation is started")
    assert stack.ticks[1] > 0
    watch_until(stack, lambda: stack.ready, "the whole robot is ready")


def test_navigation_and_telemetry_may_die_until_they_are_given_up_and_control_ticks_on(
    stack: Stack,
) -> None:
    watch_until(stack, lambda: stack.ready, "ready")
    control = stack.pid(CONTROL)

    def killed() -> bool:
        for module in (NAVIGATION, TELEMETRY):
            with contextlib.suppress(StackError):
                os.kill(stack.pid(module), signal.SIGKILL)
        return all(stack.phase(each) is ProcessPhase.GIVEN_UP for each in (NAVIGATION, TELEMETRY))

    watch_until(stack, killed, "both are given up")
    ticks = stack.ticks
    watch_until(stack, lambda: stack.ticks[1] > ticks[1] + 50, "control ticks on")
    assert stack.ticks[0] == 1
    assert stack.pid(CONTROL) == control


def test_processes_started_again_have_the_configuration_of_before_whatever_the_file_says(
    channel: str, ear: Ear, tmp_path: Path
) -> None:
    robot = tmp_path / "robot.toml"
    robot.write_text(find_file("diff_drive").read_text())
    with contextlib.closing(Stack(StackOptions("robot", str(robot), overrides(channel)))) as stack:
        watch_until(stack, lambda: stack.ready, "ready")
        robot.write_text("[robot]\nname = 1\n")
        os.kill(stack.pid(TELEMETRY), signal.SIGKILL)
        os.kill(stack.pid(CONTROL), signal.SIGKILL)
        again = (CONTROL, NAVIGATION, TELEMETRY)
        watch_until(
            stack,
            lambda: all(
                stack.starts(each) == 2 and stack.phase(each) is ProcessPhase.READY
                for each in again
            ),
            "all are ready again",
        )


def ask(stack: Stack, request: Restart | ShutDown) -> None:
    """Send a request as telemetry does."""
    context: zmq.Context = zmq.Context()
    sender = RequestSender(context, Endpoints(endpoint_directory("robot")).supervisor_requests)
    watch_until(stack, lambda: sender.send(request), "the supervisor takes requests")
    context.destroy(linger=1000)


def test_a_restart_that_is_asked_for_renews_all_processes_with_the_parameters_kept_now(
    channel: str, ear: Ear, tmp_path: Path
) -> None:
    robot, key = str(find_file("diff_drive").resolve()), tmp_path / "mavlink.key"
    write_new_key(key)
    settings = (*overrides(channel), f'mavlink.signing_key="{key}"')
    options = StackOptions("robot", robot, settings, state=str(tmp_path))
    with contextlib.closing(Stack(options)) as stack:
        watch_until(stack, lambda: stack.ready, "ready")
        ask(stack, Restart(time.monotonic_ns() - 2 * LIFE_NS))
        key.chmod(0o644)
        stack.restart()
        ticks = stack.ticks[1]
        watch_until(stack, lambda: stack.ticks[1] > ticks + 50, "control ticks on")
        assert stack.ticks[0] == 1, "the request is too old, and telemetry would find no key"
        key.chmod(0o600)
        before = {each: stack.pid(each) for each in stack.modules}
        assert ParameterFile(str(tmp_path)).save({"limits.v_max_m_s": 0.25})
        ask(stack, Restart(time.monotonic_ns()))
        again = lambda: all(stack.starts(each) == 2 for each in stack.modules)  # noqa: E731
        lines = watch_until(stack, lambda: again() and stack.ready, "back")
        assert next(line for line in lines if "begins anew" in line).startswith("control")
        for module, pid in before.items():
            assert stack.pid(module) != pid
            command = Path(f"/proc/{stack.pid(module)}/cmdline").read_bytes()
            assert b'"changes":{"limits.v_max_m_s":0.25}' in command


def test_shutting_down_that_is_asked_for_is_left_to_who_has_the_stack(
    stack: Stack, ear: Ear
) -> None:
    watch_until(stack, lambda: stack.ready, "ready")
    assert not stack.shut_down
    ask(stack, ShutDown(time.monotonic_ns()))
    watch_until(stack, lambda: stack.shut_down, "it is to end")
    assert stack.starts(CONTROL) == 1


def camera_stack(channel: str, *settings: str) -> Stack:
    robot = str(find_file("diff_drive").resolve())
    looks = (*overrides(channel), "camera.enabled=true", *settings)
    return Stack(StackOptions("robot", robot, looks))


def test_a_camera_process_is_there_where_the_robot_looks_and_is_started_again(
    channel: str, ear: Ear, stack: Stack
) -> None:
    assert CAMERA not in stack.modules
    stack.close()
    with contextlib.closing(camera_stack(channel)) as looking:
        watch_until(looking, lambda: looking.ready, "ready")
        os.kill(looking.pid(CAMERA), signal.SIGKILL)
        again = lambda: looking.starts(CAMERA) == 2 and looking.ready  # noqa: E731
        lines = watch_until(looking, again, "it is back")
        assert any("camera ended" in line and "SIGKILL" in line for line in lines)
        assert looking.starts(CONTROL) == 1


def test_a_camera_that_is_not_there_is_given_up_and_the_robot_is_ready_without(
    channel: str, ear: Ear, monkeypatch: pytest.MonkeyPatch
) -> None:
    quick = replace(CAMERA_ROLE, restart=RestartPolicy(crashes=1, first_delay_s=0.1))
    monkeypatch.setattr("robotctl.app.supervision.stack.CAMERA_ROLE", quick)
    with contextlib.closing(camera_stack(channel, 'camera.source="/nowhere.avi"')) as looking:
        watch_until(
            looking, lambda: looking.phase(CAMERA) is ProcessPhase.GIVEN_UP, "it is given up"
        )
        watch_until(looking, lambda: looking.ready, "ready without")
        assert looking.starts(CONTROL) == 1


def test_a_lidar_process_is_there_where_our_driver_reads_it_alone(channel: str) -> None:
    robot = str(find_file("diff_drive").resolve())
    for driver, there in (("rplidar", True), ("socket", False)):
        settings = (*overrides(channel), f'lidar.driver="{driver}"', 'lidar.device="/nowhere"')
        with contextlib.closing(Stack(StackOptions("robot", robot, settings))) as stack:
            assert (LIDAR in stack.modules) is there


def test_a_killed_control_process_comes_back_unarmed_and_navigation_begins_anew(
    stack: Stack, ear: Ear
) -> None:
    watch_until(stack, lambda: stack.ready, "ready")
    navigation = stack.pid(NAVIGATION)
    telemetry = stack.pid(TELEMETRY)
    os.kill(stack.pid(CONTROL), signal.SIGKILL)
    lines = watch_until(stack, lambda: stack.starts(CONTROL) == 2 and stack.ready, "back")
    assert any("control ended" in line and "SIGKILL" in line for line in lines)
    assert wait(ear.newest, "state").state is SafetyState.BOOT
    watch_until(stack, lambda: stack.phase(NAVIGATION) is ProcessPhase.READY, "navigation is back")
    assert stack.pid(NAVIGATION) != navigation
    assert stack.pid(TELEMETRY) == telemetry


def test_a_control_process_that_hangs_is_replaced(stack: Stack) -> None:
    watch_until(stack, lambda: stack.ready, "ready")
    os.kill(stack.pid(CONTROL), signal.SIGSTOP)
    lines = watch_until(stack, lambda: stack.starts(CONTROL) == 2 and stack.ready, "back")
    assert any("it hung" in line for line in lines)


def test_a_control_process_that_keeps_dying_ends_the_stack(stack: Stack) -> None:
    def kill() -> bool:
        with contextlib.suppress(StackError):
            os.kill(stack.pid(CONTROL), signal.SIGKILL)
        stack.watch()
        return False

    with pytest.raises(StackError, match="control process ended 4 times"):
        wait(kill, "never")


def test_an_emergency_stop_during_a_restart_of_control_is_carried_out_by_the_new_one(
    stack: Stack, ear: Ear
) -> None:
    watch_until(stack, lambda: stack.ready, "ready")
    os.kill(stack.pid(CONTROL), signal.SIGKILL)
    watch_until(stack, lambda: stack.phase(CONTROL) is ProcessPhase.WAITING, "control has ended")
    stack.emergency_stop()
    watch_until(stack, lambda: ear.is_in(SafetyState.EMERGENCY_STOP), "latched")
    assert stack.starts(CONTROL) == 2


def test_an_emergency_stop_that_a_hanging_control_did_not_hear_goes_to_the_next_one(
    stack: Stack, ear: Ear
) -> None:
    watch_until(stack, lambda: stack.ready, "ready")
    stack.watch()
    for _ in range(5):  # it goes on after the supervisor's last look, and hangs then
        wait(ear.newest, "control says what it does")
    os.kill(stack.pid(CONTROL), signal.SIGSTOP)
    stack.emergency_stop()
    stack.watch()
    os.kill(stack.pid(CONTROL), signal.SIGKILL)
    watch_until(stack, lambda: ear.is_in(SafetyState.EMERGENCY_STOP), "latched")
    assert stack.starts(CONTROL) == 2


def test_what_cannot_be_started_again_for_want_of_memory_ends_nothing_else(
    stack: Stack, monkeypatch: pytest.MonkeyPatch
) -> None:
    watch_until(stack, lambda: stack.ready, "ready")

    def no_memory(*_: object, **__: object) -> None:
        raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))

    monkeypatch.setattr("robotctl.app.supervision.supervised.start_child", no_memory)
    os.kill(stack.pid(TELEMETRY), signal.SIGKILL)
    lines = watch_until(
        stack, lambda: stack.phase(TELEMETRY) is ProcessPhase.GIVEN_UP, "telemetry is given up"
    )
    assert any("telemetry" in line and "Cannot allocate memory" in line for line in lines), lines
    assert stack.phase(CONTROL) is ProcessPhase.READY


def test_a_first_start_for_which_memory_is_short_is_tried_again(
    stack: Stack, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[list[str]] = []

    def short_at_first(command: list[str], **more: Any) -> subprocess.Popen[bytes]:
        if TELEMETRY in command:
            tried.append(command)
            if len(tried) == 1:
                raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))
        return start_child(command, **more)

    monkeypatch.setattr("robotctl.app.supervision.supervised.start_child", short_at_first)
    lines = watch_until(stack, lambda: stack.ready, "ready")
    assert any("telemetry" in line and "Cannot allocate memory" in line for line in lines), lines
    assert (stack.starts(TELEMETRY), len(tried)) == (1, 2)
    assert stack.starts(CONTROL) == 1


def test_an_emergency_stop_during_the_very_start_is_carried_out(stack: Stack, ear: Ear) -> None:
    stack.emergency_stop()
    watch_until(stack, lambda: ear.is_in(SafetyState.EMERGENCY_STOP), "latched")
    assert stack.starts(CONTROL) == 1


def test_a_bad_configuration_ends_the_start_at_once(ear: Ear) -> None:
    robot = str(find_file("diff_drive").resolve())
    stack = Stack(StackOptions("robot", robot, overrides("no-such-bus")))
    try:
        with pytest.raises(StackError, match="control process did not start"):
            wait(lambda: stack.watch() and False, "never")
    finally:
        stack.close()


def test_a_signing_key_that_cannot_be_read_is_refused_before_anything_starts(
    ear: Ear, channel: str, tmp_path: Path
) -> None:
    robot = str(find_file("diff_drive").resolve())
    key = f'mavlink.signing_key="{tmp_path / "mavlink.key"}"'
    with pytest.raises(ConfigError, match="keygen"):
        Stack(StackOptions("robot", robot, (*overrides(channel), key)))


@pytest.mark.parametrize(("instance", "own_bus"), [("other", False), ("robot", True)])
def test_a_second_robot_on_the_same_bus_or_of_the_same_name_is_refused_and_disturbs_nothing(
    stack: Stack, ear: Ear, channel: str, capfd: pytest.CaptureFixture[str], instance: str,
    own_bus: bool,
) -> None:  # fmt: skip
    watch_until(stack, lambda: stack.ready, "ready")
    robot = str(find_file("diff_drive").resolve())
    bus = f"{channel}-of-its-own" if own_bus else channel
    second = Stack(StackOptions(instance, robot, overrides(bus)))
    lines: list[str] = []
    try:
        with pytest.raises(StackError, match="control process did not start"):
            wait(lambda: lines.extend(stack.watch()) or (second.watch() and False), "never")
    finally:
        second.close()
    told = capfd.readouterr().err
    assert (str(endpoint_directory("robot")) if own_bus else f"simcan {channel}") in told
    assert "another robotctl of this computer has it" in told
    for _ in range(5):
        lines += watch_until(stack, ear.newest, "the first one goes on")
    assert lines == []
    assert stack.ready
