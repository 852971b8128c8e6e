"""How `robotctl` ends when a disk, or whoever reads its output, does not take what it writes."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from robotctl.app.config import find_file

DEADLINE_S = 90.0
ROBOTCTL = [sys.executable, "-c", "from robotctl.cli.main import main; main()"]


@pytest.mark.parametrize("command", [["config", "schema"], ["version"], ["sim", "--help"]])
def test_output_onto_a_full_disk_ends_with_a_sentence(command: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [*ROBOTCTL, *command], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert (done.returncode, done.stderr) == (2, "robotctl: No space left on device\n")


def test_a_reader_that_has_gone_is_no_error_to_talk_about() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    try:
        done = subprocess.run(
            [*ROBOTCTL, "version"], stdout=writing, stderr=subprocess.PIPE, check=False
        )
    finally:
        os.close(writing)
    assert (done.returncode, done.stderr) == (1, b"")


@pytest.mark.parametrize(("command", "status"), [("version", 0), ("config check /nowhere.toml", 2)])
def test_a_closed_output_is_no_error(command: str, status: int) -> None:
    script = f'exec "$@" {command} >&-'
    done = subprocess.run(
        ["sh", "-c", script, "sh", *ROBOTCTL], stderr=subprocess.PIPE, text=True, check=False
    )
    assert done.returncode == status
    assert "Traceback" not in done.stderr


def named_strangely(folder: Path) -> str:
    """Return the path of a robot's file whose name is no UTF-8."""
    path = folder / os.fsdecode(b"caf\xe9.toml")
    path.write_bytes(find_file("diff_drive").read_bytes())
    return str(path)


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (["config", "check"], b"caf\xe9.toml: diff_drive, differential"),
        (["can", "budget", "--robot"], b"worst-case stuffing"),
        (["doctor", "--json", "--seconds", "0.1", "--robot"], rb"caf\udce9.toml: diff_drive"),
    ],
)
def test_names_that_are_no_utf_8_are_printed(
    tmp_path: Path, command: list[str], said: bytes
) -> None:
    done = subprocess.run(
        [*ROBOTCTL, *command, named_strangely(tmp_path)],
        env=os.environ | {"PYTHONIOENCODING": "utf-8:strict"}, capture_output=True, check=False,
    )  # fmt: skip
    assert b"Traceback" not in done.stderr
    assert said in done.stdout


def test_processes_are_not_started_with_names_that_are_no_utf_8(tmp_path: Path) -> None:
    command = ["sim", "--max-seconds", "1", "--robot", named_strangely(tmp_path)]
    done = subprocess.run([*ROBOTCTL, *command], capture_output=True, check=False)
    assert done.returncode == 2
    *_, last = done.stderr.splitlines()
    assert last.startswith(b"robotctl: robot: ")
    assert last.endswith(rb"caf\udce9.toml: not UTF-8")


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EIO])
def test_a_disk_that_refuses_without_naming_a_file_ends_with_what_it_says(number: int) -> None:
    done = refused_with(number)
    assert (done.returncode, done.stderr) == (2, f"robotctl: {os.strerror(number)}\n")


def test_an_error_of_the_system_that_is_no_disks_is_a_defect_and_shows_where() -> None:
    done = refused_with(errno.EBADF)
    assert done.returncode == 1
    assert "Traceback" in done.stderr


def refused_with(number: int) -> "subprocess.CompletedProcess[str]":
    """Run a command in which a write fails with this error number."""
    program = f"""
import os
from robotctl.cli import config
def refuse(*_):
    raise OSError({number}, os.strerror({number}))
config.load_robot = refuse
from robotctl.cli.main import main
main()
"""
    command = [sys.executable, "-c", program, "config", "check", "diff_drive"]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_a_simulated_run_whose_record_fills_the_disk_ends_with_a_sentence(tmp_path: Path) -> None:
    program = """
from pathlib import Path
from robotctl.app.log_folder import LogFolder
new = LogFolder.new
def on_a_full_disk(self, kind, suffix):
    return Path("/dev/full") if kind == "control" else new(self, kind, suffix)
LogFolder.new = on_a_full_disk
from robotctl.cli.main import main
main()
"""
    command = ["sim", "--lockstep", "--max-seconds", "2", "--record", str(tmp_path)]
    done = subprocess.run(
        [sys.executable, "-c", program, *command],
        capture_output=True, text=True, check=False, timeout=DEADLINE_S,
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert done.stderr.splitlines()[-1] == "robotctl: No space left on device"
    assert "Traceback" not in done.stderr
