"""What systemd hears, over a real datagram socket; and the exit log on the disk."""

import datetime as dt
import json
import os
import socket
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from robotctl.app.supervision import exit_log
from robotctl.app.supervision.exit_log import ExitLog
from robotctl.app.supervision.service import ServiceNotifier
from robotctl.app.supervision.supervised import Exit, ProcessPhase
from robotctl.app.supervision.supervisor import Supervisor
from robotctl.runtime.storage.log_folder import LogError

NOW = dt.datetime(2026, 1, 2, 3, 4, 5, tzinfo=dt.UTC)
EXIT = Exit("navigation", 17, -9, False, True, False, 42, 1.5, 0.25)


class Manager:
    """The ear of systemd."""

    def __init__(self, address: str) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind("\0" + address[1:] if address.startswith("@") else address)
        self.socket.setblocking(False)
        self.environment = {"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "4000000"}

    def heard(self) -> list[str]:
        lines = []
        while True:
            try:
                lines.append(self.socket.recv(4096).decode())
            except BlockingIOError:
                return lines


@pytest.fixture(params=["path", "abstract"])
def manager(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Manager]:
    address = str(tmp_path / "n") if request.param == "path" else f"@robotctl-test-{os.getpid()}"
    made = Manager(address)
    yield made
    made.socket.close()


class FakeStack:
    """Processes that do as the test says."""

    modules = ("robotctl.app.processes.control", "robotctl.app.processes.navigation")

    def __init__(self) -> None:
        self.ticks = (1, 0)
        self.ready = False
        self.exits: list[Exit] = []
        self.closed = False
        self.told: list[str] = []

    def watch(self) -> list[str]:
        return [each.words() for each in self.exits]

    def tell(self, line: str) -> None:
        self.told.append(line)

    def phase(self, module: str) -> ProcessPhase:
        return ProcessPhase.READY

    def close(self) -> None:
        self.closed = True


def test_a_service_says_ready_status_watchdog_and_stopping_in_this_order(manager: Manager) -> None:
    stack, notifier = FakeStack(), ServiceNotifier(manager.environment)
    with Supervisor(stack, notifier, None) as supervisor:
        supervisor.step([], 100.0)
        heard = manager.heard()
        assert "READY=1" not in heard
        assert "WATCHDOG=1" not in heard  # a process is there, but its loop has not ticked
        stack.ready, stack.ticks = True, (1, 5)
        supervisor.step([], 102.0)
        assert manager.heard() == ["READY=1", "WATCHDOG=1"]
        supervisor.step([], 103.0)
        assert manager.heard() == []
    assert manager.heard() == ["STOPPING=1", "STATUS=stopping"]
    assert stack.closed


def test_the_watchdog_is_fed_only_while_the_control_loop_ticks(manager: Manager) -> None:
    stack, notifier = FakeStack(), ServiceNotifier(manager.environment)
    assert notifier.feed_s == 1.0
    fed = []
    with Supervisor(stack, notifier, None) as supervisor:
        for tenth in range(100):
            if tenth < 50:
                stack.ticks = (1, 20 * tenth)
            elif tenth >= 80:
                stack.ticks = (2, 20 * (tenth - 80))
            supervisor.step([], 100.0 + tenth / 10)
            fed += [tenth / 10] * manager.heard().count("WATCHDOG=1")
    assert len([each for each in fed if each < 5.0]) in range(4, 7)
    assert [each for each in fed if 5.0 <= each < 8.0 and each > 6.0] == []
    assert [each for each in fed if each >= 8.0]


def test_readiness_is_said_again_until_a_busy_manager_takes_it(manager: Manager) -> None:
    stack, notifier = FakeStack(), ServiceNotifier(manager.environment)
    with Supervisor(stack, notifier, None) as supervisor:
        while notifier.ready():  # the queue of a socket that nobody reads
            pass
        stack.ready = True
        supervisor.step([], 100.0)
        manager.heard()
        supervisor.step([], 100.1)
        assert manager.heard()[0] == "READY=1"
        supervisor.step([], 100.2)
        assert "READY=1" not in manager.heard()


def test_a_new_control_process_does_not_feed_the_watchdog_before_it_ticks(
    manager: Manager,
) -> None:
    stack, notifier = FakeStack(), ServiceNotifier(manager.environment)
    with Supervisor(stack, notifier, None) as supervisor:
        stack.ticks = (1, 100)
        supervisor.step([], 100.0)
        assert "WATCHDOG=1" in manager.heard()
        stack.ticks = (2, 0)
        supervisor.step([], 105.0)
        assert "WATCHDOG=1" not in manager.heard()
        stack.ticks = (2, 1)
        supervisor.step([], 106.0)
        assert "WATCHDOG=1" in manager.heard()


def test_without_a_manager_or_with_one_that_is_gone_nothing_happens(tmp_path: Path) -> None:
    for environment in ({}, {"NOTIFY_SOCKET": str(tmp_path / "gone")}, {"NOTIFY_SOCKET": ""}):
        notifier = ServiceNotifier(environment)
        assert notifier.feed_s is None
        notifier.ready()
        notifier.status("x")
        notifier.close()


def test_the_variables_are_taken_so_that_no_child_speaks_for_the_service(manager: Manager) -> None:
    environment = {**manager.environment, "WATCHDOG_PID": "1", "HOME": "/"}
    notifier = ServiceNotifier(environment)
    assert environment == {"HOME": "/"}
    assert notifier.feed_s is None  # the watchdog of somebody else
    notifier.close()


def test_the_status_line_is_one_line_and_is_sent_when_it_changes(manager: Manager) -> None:
    notifier = ServiceNotifier(manager.environment)
    for line in ("a\nb", "a\nb", "c"):
        notifier.status(line)
    assert manager.heard() == ["STATUS=a b", "STATUS=c"]
    notifier.close()


def test_each_end_is_a_line_of_json_on_the_disk(tmp_path: Path) -> None:
    stack = FakeStack()
    log = ExitLog(tmp_path / "new" / "folder")
    with Supervisor(stack, ServiceNotifier({}), log) as supervisor:
        stack.exits = [EXIT]
        lines = supervisor.step([], 0.0)
        stack.exits = []
        supervisor.step([], 0.1)
    (line,) = (tmp_path / "new" / "folder" / exit_log.NAME).read_text().splitlines()
    entry = json.loads(line)
    assert dt.datetime.fromisoformat(entry.pop("time")).tzinfo is not None
    assert entry == {
        "name": "navigation", "pid": 17, "status": -9, "hung": False, "was_ready": True,
        "asked": False, "beats": 42, "ran_s": 1.5, "restart_in_s": 0.25,
    }  # fmt: skip
    assert any("SIGKILL" in each for each in lines)


def test_a_file_in_place_of_the_folder_of_logs_is_said_to_be_none(tmp_path: Path) -> None:
    file = tmp_path / "logs"
    file.write_text("notes")
    for folder in (file, file / "below"):
        with pytest.raises(LogError, match=f"^{folder}: is not a folder$"):
            ExitLog(folder)


def test_the_exit_log_keeps_two_files_of_bounded_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(exit_log, "MAX_BYTES", 1000)
    log = ExitLog(tmp_path)
    for _ in range(100):
        assert log.write(EXIT, NOW) == ""
    sizes = {each.name: each.stat().st_size for each in tmp_path.iterdir()}
    assert set(sizes) == {"exits.jsonl", "exits.jsonl.1"}
    assert all(size < 1500 for size in sizes.values())


def test_a_log_that_cannot_be_written_is_said_and_stops_nothing(tmp_path: Path) -> None:
    log = ExitLog(tmp_path / "logs")
    (tmp_path / "logs" / exit_log.NAME).mkdir()
    assert "navigation" in log.write(EXIT, NOW)


def test_a_robot_that_ends_for_good_logs_why_first(tmp_path: Path) -> None:
    stack = SimpleNamespace(**{name: getattr(FakeStack(), name) for name in ("ticks", "ready")})
    stack.exits, stack.close = [EXIT], lambda: None

    def watch() -> list[str]:
        raise RuntimeError("control is lost")

    stack.watch = watch
    with (
        pytest.raises(RuntimeError),
        Supervisor(stack, ServiceNotifier({}), ExitLog(tmp_path)) as supervisor,
    ):
        supervisor.step([], 0.0)
    assert "navigation" in (tmp_path / exit_log.NAME).read_text()
