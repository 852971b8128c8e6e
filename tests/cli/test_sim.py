"""`robotctl sim` as a process: however it ends, it leaves no folder and no process behind."""

import fcntl
import os
import pty
import select
import signal
import subprocess
import sys
import tempfile
import termios
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

DEADLINE_S = 90.0
NOT_COMPLETED = 3
ROBOTCTL = [sys.executable, "-c", "from robotctl.cli.main import main; main()"]


@pytest.fixture
def runtime() -> Iterator[Path]:
    """A folder with a short path: those of sockets may have 107 bytes."""
    with tempfile.TemporaryDirectory(prefix="run-") as folder:
        yield Path(folder)


@contextmanager
def sim(runtime: Path, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Start `robotctl sim` on a bus of its own, with `runtime` as the folder of its sockets."""
    runtime.chmod(0o700)
    bus = [] if "--lockstep" in arguments else ["--bus", f"simcan:{runtime}/hub"]
    command = [*ROBOTCTL, "sim", "--headless", "--mission", "patrol", *bus]
    with subprocess.Popen(
        [*command, "--set", "mavlink.link=[]", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | {"XDG_RUNTIME_DIR": str(runtime), "PYTHONUNBUFFERED": "1"},
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def left_behind(runtime: Path) -> tuple[list[str], list[str]]:
    """Return the files below `runtime`, and the commands of processes that still use it."""
    files = [str(each.relative_to(runtime)) for each in runtime.rglob("*")]
    processes = []
    for each in Path("/proc").glob("[0-9]*"):
        try:
            environment = (each / "environ").read_bytes()
            if f"XDG_RUNTIME_DIR={runtime}\0".encode() in environment:
                processes.append((each / "cmdline").read_text().replace("\0", " "))
        except OSError:
            continue
    return [each for each in files if each != "robotctl"], processes


def test_a_run_that_ends_by_itself_leaves_nothing(runtime: Path) -> None:
    with sim(runtime, "--max-seconds", "3") as process:
        output, _ = process.communicate(timeout=DEADLINE_S)
    assert process.returncode in (2, 3), output  # 2: a busy computer did not start in that time
    assert left_behind(runtime) == ([], [])


@pytest.mark.parametrize(("line", "times"), [("starting firmware_sim", 20), ("connect: CAN", 1)])
def test_a_run_that_is_interrupted_leaves_nothing(runtime: Path, line: str, times: int) -> None:
    with sim(runtime) as process:
        assert process.stdout is not None
        assert any(line in each for each in process.stdout)
        for _ in range(times):
            process.send_signal(signal.SIGINT)
            time.sleep(0.02)
        output, _ = process.communicate(timeout=DEADLINE_S)
    assert "Traceback" not in output
    if process.returncode == NOT_COMPLETED:  # a quick computer may have been ready
        assert "ready to arm" in output
    else:
        assert (process.returncode, output.splitlines()[-1]) == (130, "robotctl: interrupted")
    assert left_behind(runtime) == ([], [])


@pytest.mark.parametrize(
    ("option", "status", "last"), [("--stay", 0, "└"), ("--until-done", NOT_COMPLETED, "└")]
)
def test_a_run_that_is_interrupted_under_way_is_scored_and_one_that_stays_ends_well(
    runtime: Path, option: str, status: int, last: str
) -> None:
    with sim(runtime, option) as process:
        assert process.stdout is not None
        assert any("armed" in each for each in process.stdout)
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=DEADLINE_S)
    assert "stopped by the user" in output
    assert output.splitlines()[-1].startswith(last)
    assert process.returncode == status
    assert left_behind(runtime) == ([], [])


def test_a_run_that_is_refused_leaves_nothing(runtime: Path) -> None:
    with sim(runtime, "--world", "no_such_world") as process:
        output, _ = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 2
    assert "no_such_world" in output
    assert left_behind(runtime) == ([], [])


def test_a_folder_that_cannot_be_made_is_named_without_a_traceback(runtime: Path) -> None:
    with sim(runtime, "--record", "/proc/no_such_folder") as process:
        output, _ = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 2
    assert "robotctl: /proc/no_such_folder: cannot be created: No such file or directory" in output
    assert "Traceback" not in output
    assert left_behind(runtime) == ([], [])


def test_a_report_without_its_folder_is_refused_before_the_run(runtime: Path) -> None:
    target = runtime / "no_such_folder" / "report.json"
    with sim(runtime, "--lockstep", "--max-seconds", "1", "--report", str(target)) as process:
        output, _ = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 2
    assert output == f"robotctl: {target}: the folder {target.parent} does not exist\n"


def test_a_bus_that_a_run_in_lockstep_would_not_use_is_refused(runtime: Path) -> None:
    with sim(runtime, "--lockstep", "--bus", "vcan0") as process:
        output, _ = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 2
    assert output.startswith("robotctl: --bus vcan0: not allowed with --lockstep")


def test_settings_of_a_localiser_are_allowed_where_an_option_chooses_it(runtime: Path) -> None:
    keyframes = ("--set", 'localisation.keyframes="office.keyframes"')
    with sim(runtime, "--slam", *keyframes, "--lockstep", "--bus", "vcan0") as process:
        words, _ = process.communicate(timeout=DEADLINE_S)
    assert "keyframes" not in words
    assert "--bus vcan0: not allowed with --lockstep" in words


def test_a_report_on_a_full_disk_does_not_lose_the_score(runtime: Path) -> None:
    with sim(runtime, "--lockstep", "--max-seconds", "1", "--report", "/dev/full") as process:
        output, _ = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 4
    assert "not completed" in output
    assert "robotctl: /dev/full: cannot be written: No space left on device" in output
    assert "Traceback" not in output


def test_ctrl_c_while_the_command_is_still_being_read_is_no_error() -> None:
    program = """
import importlib.abc, sys
class Interrupted(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == "robotctl.cli.sim":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupted())
from robotctl.cli.main import main
main()
"""
    command = [sys.executable, "-c", program, "sim"]
    ended = subprocess.run(command, capture_output=True, check=False)
    assert (ended.returncode, ended.stderr) == (130, b"robotctl: interrupted\n")


def test_who_stops_the_robot_by_key_may_arm_it_again_and_drive_on(runtime: Path) -> None:
    terminal, child = pty.openpty()
    environment = {"XDG_RUNTIME_DIR": str(runtime), "TERM": "xterm", "COLUMNS": "80", "LINES": "24"}
    command = [
        *ROBOTCTL,
        "sim",
        "--mission",
        "patrol",
        "--bus",
        f"simcan:{runtime}/hub",
        "--set",
        "mavlink.link=[]",
    ]
    runtime.chmod(0o700)
    with subprocess.Popen(
        command,
        stdin=child,
        stdout=child,
        stderr=child,
        start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),  # noqa: PLW1509 - no threads
        env=os.environ | environment,
    ) as process:
        os.close(child)
        try:
            for sought, key in (
                (b" DRIVING ", b" "),
                (b" EMERGENCY_STOP ", b""),
                (b"a arms it again, m then resumes the mission", b"a"),
                (b" ARMED ", b"m"),
                (b" DRIVING ", b"\x03"),
            ):
                read_until(terminal, sought)
                os.write(terminal, key)
            with suppress(OSError):  # its end closes the terminal
                while os.read(terminal, 65536):
                    pass
            assert process.wait(DEADLINE_S) == NOT_COMPLETED
        finally:
            process.kill()
            os.close(terminal)
    assert left_behind(runtime) == ([], [])


def read_until(terminal: int, sought: bytes) -> None:
    """Read what a terminal shows until `sought` is there."""
    shown, deadline_s = b"", time.monotonic() + DEADLINE_S
    while sought not in shown:
        assert time.monotonic() < deadline_s, shown[-2000:]
        if select.select([terminal], [], [], 1.0)[0]:
            shown += os.read(terminal, 65536)
