"""The guest tool, booted from the host; run by `make test` where vcan needs the guest."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

TOOL = Path(__file__).resolve().parents[2] / "tools" / "vcan-guest"
MODES = pytest.mark.parametrize("mode", [(), ("--real-time",)], ids=["virtual", "real"])


def guest(*arguments: str, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, TOOL, *arguments], capture_output=True, text=True, check=False, **options
    )


def processes_of(folder: Path) -> list[int]:
    """Return the processes of guests whose files are in `folder`."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and f"uml_dir={folder}" in (entry / "cmdline").read_text():
                found.append(int(entry.name))
        except (OSError, UnicodeDecodeError):
            continue
    return found


def wait_until(condition, seconds: float = 20.0) -> None:
    deadline_s = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline_s, "not in time"
        time.sleep(0.02)


@pytest.fixture
def own_folder(tmp_path, monkeypatch):
    """Where the tool keeps what it needs during a run of this test."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    return folder


def test_code_compiled_for_the_hosts_processor_is_the_guests_too():
    told = "from native_kernels.library import _processor_lines; print(_processor_lines())"
    here = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    there = guest(sys.executable, "-c", told)
    assert "model name" in here.stdout
    assert there.stdout == here.stdout


@MODES
def test_status_outputs_folder_and_environment_are_the_commands(mode, tmp_path, monkeypatch):
    monkeypatch.setenv("FROM_HERE", "a 'quoted' $value")
    script = 'pwd; echo "$FROM_HERE" $VCAN_GUEST; echo problem >&2; echo kept > file; exit 7'
    result = guest(*mode, "sh", "-c", script, cwd=tmp_path)
    kind = "real" if mode else "virtual"
    assert result.stdout == f"{tmp_path}\na 'quoted' $value {kind}\n"
    assert result.stderr == "problem\n"
    assert result.returncode == 7
    assert (tmp_path / "file").read_text() == "kept\n"


def test_output_comes_while_the_command_runs(tmp_path):
    script = "echo first; while [ ! -e go ]; do sleep 0.1; done; echo second"
    with subprocess.Popen(
        [sys.executable, TOOL, "--real-time", "sh", "-c", script],
        stdout=subprocess.PIPE,
        cwd=tmp_path,
    ) as process:
        assert process.stdout.readline() == b"first\n"
        assert process.poll() is None
        (tmp_path / "go").touch()
        assert process.stdout.read() == b"second\n"
    assert process.returncode == 0


def test_a_long_output_arrives_whole():
    wanted = "".join(f"{number}\n" for number in range(1, 200_001))
    assert guest("seq", "1", "200000").stdout == wanted


@pytest.mark.parametrize(
    ("command", "status"),
    [
        (("no-such-command",), 127),
        (("/etc/passwd",), 126),
        (("sh", "-c", "kill -9 $$"), 137),
    ],
)
def test_the_status_is_the_one_a_shell_would_give(command, status):
    assert guest(*command).returncode == status


def test_what_the_command_leaves_running_ends_with_the_guest(own_folder):
    assert guest("sh", "-c", "sleep 1000 & echo done").stdout == "done\n"
    assert not processes_of(own_folder)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_no_process_of_a_guest_outlives_the_tool(number, own_folder):
    with subprocess.Popen(
        [sys.executable, TOOL, "--real-time", "sh", "-c", "echo up; sleep 1000"],
        stdout=subprocess.PIPE,
    ) as process:
        assert process.stdout.readline() == b"up\n"
        assert processes_of(own_folder)
        process.send_signal(number)
        wanted = -9 if number == signal.SIGKILL else 128 + number
        assert process.wait(20) == wanted
    wait_until(lambda: not processes_of(own_folder))


def test_a_guest_that_dies_is_an_error_of_the_tool(own_folder):
    with subprocess.Popen(
        [sys.executable, TOOL, "--real-time", "sh", "-c", "echo up; sleep 1000"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stdout.readline() == b"up\n"
        os.kill(min(processes_of(own_folder)), signal.SIGKILL)
        assert process.wait(20) == 125
        assert b"the guest ended" in process.stderr.read()
    wait_until(lambda: not processes_of(own_folder))


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="one processor for all")
def test_each_guest_has_a_processor_of_its_own(own_folder):
    command = [sys.executable, TOOL, "--real-time", "sh", "-c", "echo up; sleep 1000"]
    with contextlib.ExitStack() as stack:
        for _ in range(2):
            process = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE))
            stack.callback(process.terminate)
            assert process.stdout.readline() == b"up\n"
        processors = [os.sched_getaffinity(pid) for pid in processes_of(own_folder)]
    assert {len(some) for some in processors} == {1}
    assert len(set.union(*processors)) == 2


def test_a_guest_stands_back_as_its_caller_does(own_folder):
    command = [sys.executable, TOOL, "--real-time", "sh", "-c", "echo up; sleep 1000"]
    with subprocess.Popen(("chrt", "--idle", "0", *command), stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"up\n"
        guest = min(processes_of(own_folder))
        session = Path(f"/proc/{guest}/autogroup")
        policies = {os.sched_getscheduler(pid) for pid in processes_of(own_folder)}
        nice = session.read_text() if session.exists() else " nice 19\n"
        process.terminate()
    assert policies == {os.SCHED_IDLE}
    assert nice.endswith(" nice 19\n")


def test_guests_run_side_by_side():
    command = [sys.executable, TOOL, "ip", "-brief", "link", "show", "vcan0"]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(2)]
    outputs = [process.communicate(timeout=60)[0] for process in both]
    assert all(output.startswith(b"vcan0") for output in outputs)


def test_closed_standard_streams_do_not_matter():
    script = f"{sys.executable} {TOOL} sh -c 'exit 3' <&- >&- 2>&-"
    assert subprocess.run(["sh", "-c", script], check=False).returncode == 3
