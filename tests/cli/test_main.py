"""How `robotctl` ends when a disk, or whoever reads its output, does not take what it writes."""

import errno
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from robotctl.config.robot_file import find_file

DEADLINE_S = 90.0
ROBOTCTL = [sys.executable, "-c", "from robotctl.cli.main import main; main()"]
ONE_BY_ONE = """
import json, sys
from robotctl.cli.main import main
ended = []
place = sys.argv[2]
for words in json.loads(sys.argv[1]):
    sys.argv[1:] = words
    try:
        main()
    except SystemExit as end:
        ended.append(end.code)
with open(place, "w") as file:
    json.dump(ended, file)
"""
"""Several commands in one process, which loads numba once; their statuses go into a file."""


PRINTS = [["config", "schema"], ["config", "show"], ["version"], ["sim", "--help"]]


@pytest.mark.parametrize("command", PRINTS)
def test_what_only_prints_fails_onto_a_full_disk(command: list[str]) -> None:
    done = onto_a_full_disk(command)
    assert done.returncode == 2
    assert done.stderr == "robotctl: standard output: No space left on device\n"


@pytest.mark.parametrize("command", [*PRINTS, ["can", "budget"]])
def test_a_reader_that_has_gone_is_no_error(command: list[str]) -> None:
    done = to_nobody(command)
    assert (done.returncode, done.stderr) == (0, "")


def onto_a_full_disk(command: list[str]) -> "subprocess.CompletedProcess[str]":
    with Path("/dev/full").open("w") as full:
        return subprocess.run(
            [*ROBOTCTL, *command], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )


def to_nobody(command: list[str]) -> "subprocess.CompletedProcess[str]":
    """Run a command whose standard output nobody reads."""
    reading, writing = os.pipe()
    os.close(reading)
    try:
        return subprocess.run(
            [*ROBOTCTL, *command], stdout=writing, stderr=subprocess.PIPE, text=True, check=False
        )
    finally:
        os.close(writing)


def with_everything_closed(command: list[str]) -> "subprocess.CompletedProcess[str]":
    script = 'exec "$@" <&- >&- 2>&-'
    return subprocess.run(
        ["sh", "-c", script, "sh", *ROBOTCTL, *command], capture_output=True, text=True, check=False
    )


def with_an_unreadable_error(command: list[str]) -> "subprocess.CompletedProcess[str]":
    with Path("/dev/full").open("w") as full:
        return subprocess.run(
            [*ROBOTCTL, *command], stdout=full, stderr=full, text=True, check=False
        )


def in_ascii(command: list[str]) -> "subprocess.CompletedProcess[str]":
    return in_encoding("ascii", command)


def in_cp437(command: list[str]) -> "subprocess.CompletedProcess[str]":
    return in_encoding("cp437", command)


def in_encoding(name: str, command: list[str]) -> "subprocess.CompletedProcess[str]":
    done = subprocess.run(
        [*ROBOTCTL, *command], env=os.environ | {"PYTHONIOENCODING": name},
        capture_output=True, check=False,
    )  # fmt: skip
    said, errors = done.stdout.decode(name), done.stderr.decode(name)
    assert said
    return subprocess.CompletedProcess(done.args, done.returncode, said, errors)


def in_a_plain_locale(command: list[str]) -> "subprocess.CompletedProcess[str]":
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    return subprocess.run(
        [*ROBOTCTL, *command], env=os.environ | plain, capture_output=True, text=True,
        encoding="ascii", check=False,
    )  # fmt: skip


WAYS = [
    onto_a_full_disk, to_nobody, with_everything_closed, with_an_unreadable_error, in_ascii,
    in_cp437, in_a_plain_locale,
]  # fmt: skip
TUNED = {onto_a_full_disk, in_ascii}
"""Where a command that computes for longer runs, too."""


@pytest.mark.parametrize("way", WAYS)
def test_files_are_written_and_the_status_is_kept_whoever_reads_along(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    way: Callable[[list[str]], "subprocess.CompletedProcess[str]"],
) -> None:
    report, log, patch, ended = (
        tmp_path / name for name in ("report.json", "one.log", "patch.toml", "ended.json")
    )
    log.write_text(f"FLASER 180 {'2.0 ' * 180}1 1 0 1 1 0 1.0 host 1.0\n")
    commands = [
        ["sim", "--mission", "patrol", "--lockstep", "--max-seconds", "1", "--report", str(report)],
        ["map", "--log", str(log), "--out", str(tmp_path / "room")],
    ]
    if way in TUNED:
        commands.append(["tune", "--wheel", "left", "--out", str(patch)])
    monkeypatch.setattr(f"{__name__}.ROBOTCTL", [sys.executable, "-c", ONE_BY_ONE])
    done = way([json.dumps(commands), str(ended)])
    assert "Traceback" not in (done.stderr or "")
    assert json.loads(ended.read_text()) == [3, 0, 0][: len(commands)]
    assert "the limit of 1 s after arming" in json.loads(report.read_text())["ended"]
    assert way not in TUNED or "[control.left]" in patch.read_text()
    assert (tmp_path / "room.yaml").exists()
    assert (tmp_path / "room.pgm").exists()


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
    assert (done.returncode, done.stderr) == (4, f"robotctl: {os.strerror(number)}\n")


def test_an_error_of_the_system_that_is_no_disks_is_a_defect_and_shows_where() -> None:
    done = refused_with(errno.EBADF)
    assert done.returncode == 1
    assert "Traceback" in done.stderr


def refused_with(number: int) -> "subprocess.CompletedProcess[str]":
    """Run a command in which a write fails with this error number."""
    program = f"""
import os
from robotctl.config import robot_file as config
def refuse(*_):
    raise OSError({number}, os.strerror({number}))
config.load_robot = refuse
from robotctl.cli.main import main
main()
"""
    command = [sys.executable, "-c", program, "config", "check", "diff_drive"]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_a_simulated_run_whose_record_fills_the_disk_goes_on_and_is_scored(tmp_path: Path) -> None:
    program = """
from pathlib import Path
from robotctl.runtime.storage.log_folder import LogFolder
new = LogFolder.new
def on_a_full_disk(self, kind, suffix):
    return Path("/dev/full") if kind == "control" else new(self, kind, suffix)
LogFolder.new = on_a_full_disk
from robotctl.cli.main import main
main()
"""
    command = ["sim", "--mission", "patrol", "--lockstep", "--max-seconds", "2"]
    command += ["--record", str(tmp_path)]
    done = subprocess.run(
        [sys.executable, "-c", program, *command],
        env=os.environ | {"COLUMNS": "300"},
        capture_output=True, text=True, check=False, timeout=DEADLINE_S,
    )  # fmt: skip
    assert done.returncode == 3, done.stderr
    assert "not completed" in done.stdout
    assert f"{tmp_path}: logging stopped: No space left" in done.stdout
    assert "Traceback" not in done.stderr
