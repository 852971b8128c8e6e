"""The real processes of a robot on a simulated bus without nodes: killed, hung, told to stop."""

import contextlib
import errno
import itertools
import json
import os
import pty
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import zmq
from mcap.reader import make_reader
from pymavlink.dialects.v20 import common

from robotctl.app.signing_files import write_new_key
from robotctl.app.supervision.child_process import start_child
from robotctl.app.supervision.restart import RestartPolicy
from robotctl.app.supervision.stack import (
    CAMERA,
    CAMERA_ROLE,
    CONTROL,
    LIDAR,
    NAVIGATION,
    RECORDER,
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
from robotctl.messages.control import ControlState, NavigationState, Notice, SafetyState
from robotctl.messages.supervision import LIFE_NS, Restart, ShutDown
from robotctl.runtime.ipc.topics import (
    Endpoints,
    RequestSender,
    Subscriber,
    endpoint_directory,
)

DEADLINE_S = 40.0


def wait(condition: Callable[[], Any], what: str) -> Any:
    deadline_s = time.monotonic() + DEADLINE_S
    while not (found := condition()):
        assert time.monotonic() < deadline_s, what
        time.sleep(0.01)
    return found


@pytest.fixture(scope="module")
def channel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    name = str(tmp_path_factory.mktemp("bus") / "hub")
    command = [sys.executable, "-m", "firmware_sim.bus", "--channel", name, "--ack"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as hub:
        wait(Path(name).exists, "the bus is there")
        yield name
        hub.terminate()


class Ear:
    """Hears the control process's state."""

    def __init__(self, instance: str) -> None:
        self.context: zmq.Context = zmq.Context()
        kinds = ControlState | NavigationState | Notice
        endpoints = Endpoints(endpoint_directory(instance))
        self.subscriber = Subscriber(self.context, endpoints.published, kinds)

    def newest(self) -> ControlState | None:
        states = [each for each in self.subscriber.receive() if isinstance(each, ControlState)]
        return states[-1] if states else None

    def is_in(self, state: SafetyState) -> bool:
        newest = self.newest()
        return newest is not None and newest.state is state


@pytest.fixture
def ear(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[Ear]:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("run")))
    made = Ear("robot")
    yield made
    made.context.destroy(linger=0)


def overrides(channel: str) -> tuple[str, ...]:
    bus = ('can.interface="simcan"', f'can.channel="{channel}"')
    return (*bus, "mavlink.link=[]", "runtime.allow_best_effort=true")


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


class Run:
    """`robotctl run` on a terminal of its own."""

    def __init__(self, channel: str, record: Path, manager: Path, link: str = "") -> None:
        self.record = record
        self.manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.manager.bind(str(manager))
        self.manager.setblocking(False)
        service = {"NOTIFY_SOCKET": str(manager), "WATCHDOG_USEC": "400000"}
        self.terminal, child = pty.openpty()

        def take_terminal() -> None:
            os.setsid()
            os.close(os.open(os.ttyname(child), os.O_RDWR))

        links = (f'mavlink.link=[{{url="{link}"}}]',) if link else ()
        given = (*overrides(channel), *links)
        settings = [part for each in given for part in ("--set", each)]
        self.process = subprocess.Popen(
            [
                *(sys.executable, "-c", "from robotctl.cli.main import main; main()", "run"),
                *("--record", str(record), *settings),
            ],
            stdin=child,
            stdout=child,
            stderr=child,
            env=os.environ | service,
            preexec_fn=take_terminal,  # noqa: PLW1509 - nothing but system calls
        )
        os.close(child)
        os.set_blocking(self.terminal, False)
        self.output = self.status = ""
        self.ready = False

    def said(self, words: str) -> bool:
        with contextlib.suppress(BlockingIOError, OSError):
            self.output += os.read(self.terminal, 65536).decode()
        return words in self.output

    def told(self) -> list[str]:
        """Return what systemd was told since the last call."""
        lines = []
        with contextlib.suppress(BlockingIOError):
            while True:
                lines.append(self.manager.recv(4096).decode())
        self.ready |= "READY=1" in lines
        self.status = ([each for each in lines if each.startswith("STATUS=")] or [self.status])[-1]
        return lines

    def child(self, module: str) -> int:
        """Return the process id of a child, as the kernel knows it."""
        path = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")
        for pid in path.read_text().split():
            if module in Path(f"/proc/{pid}/cmdline").read_text():
                return int(pid)
        raise AssertionError(f"no {module} below {self.process.pid}")


@pytest.fixture
def run(
    channel: str, ear: Ear, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Run]:
    made = Run(channel, tmp_path / "record", tmp_path_factory.mktemp("manager") / "notify")

    def ready() -> bool:
        made.told()
        assert made.process.poll() is None, made.output
        return made.said("ready:")

    wait(ready, "the robot is ready")
    made.told()
    yield made
    made.process.terminate()
    made.process.wait(DEADLINE_S)
    os.close(made.terminal)
    made.manager.close()


def test_sigusr1_to_the_supervisor_stops_the_robot(run: Run, ear: Ear) -> None:
    pid = run.child(CONTROL)
    run.process.send_signal(signal.SIGUSR1)
    wait(lambda: ear.is_in(SafetyState.EMERGENCY_STOP), "latched")
    assert run.child(CONTROL) == pid


def test_sigusr1_straight_to_the_control_process_stops_the_robot(run: Run, ear: Ear) -> None:
    pid = run.child(CONTROL)
    os.kill(run.process.pid, signal.SIGSTOP)  # no supervisor helps
    try:
        os.kill(pid, signal.SIGUSR1)
        wait(lambda: ear.is_in(SafetyState.EMERGENCY_STOP), "latched")
    finally:
        os.kill(run.process.pid, signal.SIGCONT)
    assert run.child(CONTROL) == pid


def test_a_key_in_the_terminal_stops_the_robot(run: Run, ear: Ear) -> None:
    assert run.said("Space or e")
    os.write(run.terminal, b"x")
    time.sleep(0.3)  # that nothing follows has no sign to wait for
    assert not ear.is_in(SafetyState.EMERGENCY_STOP)
    os.write(run.terminal, b" ")
    wait(lambda: ear.is_in(SafetyState.EMERGENCY_STOP), "latched")


def test_an_end_is_said_and_logged_and_sigterm_ends_the_robot_in_order(run: Run) -> None:
    os.kill(run.child(TELEMETRY), signal.SIGKILL)
    wait(lambda: run.said("telemetry ended after"), "the end is said")
    (line,) = (run.record / "exits.jsonl").read_text().splitlines()
    assert json.loads(line)["status"] == -signal.SIGKILL
    run.process.terminate()
    assert run.process.wait(DEADLINE_S) == 0


def test_systemd_hears_of_a_control_loop_that_stands_by_hearing_nothing(run: Run) -> None:
    assert run.ready
    wait(lambda: "WATCHDOG=1" in run.told(), "the watchdog is fed")
    os.kill(run.child(CONTROL), signal.SIGSTOP)
    stopped_s = time.monotonic()
    fed_s: list[float] = []

    def fed_again() -> bool:
        fed_s.extend([time.monotonic()] * run.told().count("WATCHDOG=1"))
        return bool(fed_s) and fed_s[-1] - stopped_s > 1.0 and run.said("it hung")

    wait(fed_again, "the watchdog is fed for the new control process")
    gaps_s = [after - before for before, after in itertools.pairwise([stopped_s, *fed_s])]
    assert max(gaps_s) > 1.0  # the supervisor lived and watched, and yet did not feed it


class Station:
    """A ground station that collects what it is told, put together from its chunks."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(type=socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.socket.setblocking(False)
        self.texts: list[str] = []
        self._mav = common.MAVLink(None, 255, 190)
        self._chunks: dict[int, str] = {}
        self._beat_s = 0.0

    def heard(self, words: str) -> bool:
        if time.monotonic() - self._beat_s > 0.5:
            self._beat_s = time.monotonic()
            with contextlib.suppress(ConnectionRefusedError):
                self.socket.send(common.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(self._mav))
        with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
            while True:
                for message in self._mav.parse_buffer(self.socket.recv(4096)) or ():
                    if message.get_type() == "STATUSTEXT":
                        self._take(message)
        return any(words in text for text in self.texts)

    def _take(self, message: Any) -> None:
        text = self._chunks.pop(message.id, "") + message.text
        if message.id and len(message.text) == 50:
            self._chunks[message.id] = text
        else:
            self.texts.append(text)


ENDS = [
    (CONTROL, signal.SIGKILL, 0.0, "control ended after", "signal 9, SIGKILL"),
    (CONTROL, signal.SIGSTOP, 0.6, "control is held up", "stopped by a signal"),
    (CONTROL, signal.SIGSTOP, 3.0, "control ended after", "it hung, signal 9, SIGKILL: stopped by"),
    (NAVIGATION, signal.SIGKILL, 0.0, "navigation ended after", "signal 9, SIGKILL"),
    (NAVIGATION, signal.SIGSTOP, 2.0, "navigation was held up for", "stopped by a signal"),
    (NAVIGATION, signal.SIGABRT, 0.0, "navigation ended after", "signal 6, SIGABRT"),
    (RECORDER, signal.SIGKILL, 0.0, "recorder ended after", "signal 9, SIGKILL"),
    (TELEMETRY, signal.SIGSTOP, 2.0, "telemetry was held up for", "stopped by a signal"),
    (TELEMETRY, signal.SIGKILL, 0.0, "telemetry ended after", "signal 9, SIGKILL"),
]
"""Which process, the signal, how long until SIGCONT [s], and parts of what is to be said."""


def logged(record: Path) -> list[str]:
    """Return all lines in the logs of states of a record."""
    lines = []
    for path in record.glob("*.mcap"):
        with path.open("rb") as file:
            for _, channel, message in make_reader(file).iter_messages():
                if channel.topic == "notice":
                    lines.append(json.loads(message.data)["message"])
    return lines


def test_every_end_and_every_pause_reaches_terminal_ground_station_log_and_exit_log(
    channel: str, ear: Ear, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    with socket.socket(type=socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    record = tmp_path / "record"
    notify = tmp_path_factory.mktemp("manager") / "notify"
    run = Run(channel, record, notify, f"udpin:127.0.0.1:{port}")
    station = Station(port)
    try:
        wait(lambda: (run.told(), run.said("ready: control"))[1], "the robot is ready")
        for module, number, pause_s, what, why in ENDS:
            wait(lambda: all_run(run), "all processes run")
            run.output, station.texts = "", []
            pid = run.child(module)
            os.kill(pid, number)
            if pause_s:
                time.sleep(pause_s)  # the pause is what is tested
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGCONT)
            wait(lambda what=what: run.said(what), f"the terminal says {what}")
            wait(lambda what=what: station.heard(what), f"the ground station hears {what}")
            for lines in (run.output.splitlines(), station.texts):
                assert any(what in line and why in line for line in lines), (what, why, lines)
        run.output, station.texts = "", []
        os.kill(run.process.pid, signal.SIGSTOP)
        time.sleep(2.0)
        os.kill(run.process.pid, signal.SIGCONT)
        own = "the supervisor was held up for"
        wait(lambda: run.said(own), "the terminal says it")
        wait(lambda: station.heard(own), "the ground station hears it")
        entries = [json.loads(line) for line in (record / "exits.jsonl").read_text().splitlines()]
        recorder = Path(f"/proc/{run.child(RECORDER)}")
        run.process.send_signal(signal.SIGKILL)
        gone = "the supervisor ended: so does robotctl"
        wait(lambda: station.heard(gone), "the ground station hears of the supervisor's end")
        wait(lambda: not recorder.exists(), "the logs are closed")
    finally:
        run.process.kill()
        run.process.wait(DEADLINE_S)
        os.close(run.terminal)
        run.manager.close()
        station.socket.close()
    lines = logged(record)
    for module, _, pause_s, what, why in ENDS:
        assert any(what in line and why in line for line in lines), (what, why, lines)
        name = module.rpartition(".")[2]
        assert any(
            each["name"] == name and ("paused_s" in each) == ("held up" in what) for each in entries
        ), (name, pause_s, entries)
    assert any(own in line for line in lines)
    assert any(each["name"] == "the supervisor" for each in entries)


def all_run(run: Run) -> bool:
    """Return whether all processes work: of one that starts no pause is said."""
    run.told()
    return run.status.count(" running") == len(ROLES)
