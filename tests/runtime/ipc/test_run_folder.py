"""What killed simulated runs left in shared memory goes at the next start, of no live one."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from robotctl.runtime.ipc import topics
from robotctl.runtime.ipc.run_folder import hold_folder, remove_dead_runs
from robotctl.runtime.ipc.topics import endpoint_directory, ring_path
from robotctl.runtime.storage.ring_file import crashed

HOLDER = """
import sys
from robotctl.runtime.ipc.run_folder import hold_folder
hold_folder(sys.argv[1])
print("held", flush=True)
sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def own_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(topics, "_MEMORY", tmp_path)


def files_of(instance: str) -> list[Path]:
    ring = ring_path(instance)
    paths = [ring, crashed(ring), ring.with_suffix(".clock")]
    for path in paths:
        path.write_bytes(b"left behind")
    return [endpoint_directory(instance), *paths]


@pytest.fixture
def holder() -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, "sim-1"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"held\n"
        yield process
        process.kill()


def test_files_of_a_run_go_only_when_its_last_process_is_killed(
    holder: subprocess.Popen[bytes],
) -> None:
    alive = files_of("sim-1")
    remove_dead_runs()
    assert all(path.exists() for path in alive)
    holder.kill()
    holder.wait()
    remove_dead_runs()
    assert not any(path.exists() for path in alive)


def test_what_a_robot_left_is_kept_for_its_next_start() -> None:
    kept = files_of("robot")
    remove_dead_runs()
    assert all(path.exists() for path in kept)


def test_a_folder_removed_before_it_was_held_is_made_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = []

    def make(instance: str) -> Path:
        folder = endpoint_directory(instance)
        if not made:  # another start takes it for a dead one's, just before it is locked
            folder.rename(folder.with_name("gone"))
        made.append(folder)
        return folder

    monkeypatch.setattr("robotctl.runtime.ipc.run_folder.endpoint_directory", make)
    held = hold_folder("sim-2")
    assert len(made) == 2
    assert os.path.samestat(os.fstat(held), made[1].stat())
    os.close(held)
