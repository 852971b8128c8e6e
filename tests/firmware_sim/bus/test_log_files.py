"""Logs of the bus that go on in the next file."""

import math
from pathlib import Path

import pytest

from firmware_sim.bus.core import Bus
from firmware_sim.bus.log import LogWriter, next_log


@pytest.mark.parametrize(
    ("name", "following"),
    [
        ("run-0007.log", "run-0008.log"),
        ("run-0099.log", "run-0100.log"),
        ("run-9.log", "run-10.log"),
        ("run.log", "run-0002.log"),
        ("run-2026-a.log", "run-2026-a-0002.log"),
    ],
)
def test_the_number_of_a_log_goes_on(name: str, following: str, tmp_path: Path) -> None:
    assert next_log(tmp_path / name) == tmp_path / following


def test_a_number_that_is_there_is_passed_over(tmp_path: Path) -> None:
    (tmp_path / "run-0002.log").write_text("old")
    assert next_log(tmp_path / "run.log").name == "run-0003.log"


def test_a_longer_log_goes_on_in_the_next_file_between_two_lines(tmp_path: Path) -> None:
    logs = []
    for name, size in (("whole.log", math.inf), ("part-0001.log", 100)):
        bus = Bus()
        sender, _ = (bus.attach(node, lambda _frame: None) for node in ("sender", "listener"))
        with LogWriter(bus, tmp_path / name, file_bytes=size):
            for number in range(10):
                sender.send(number, bytes(8))
                bus.advance(bus.now_ns + 1_000_000)
        logs.append(sorted(tmp_path.glob(f"{name[:4]}*.log")))
    (whole,), parts = logs
    assert len(parts) == 4
    assert "".join(path.read_text() for path in parts) == whole.read_text()
    assert all(100 < path.stat().st_size < 150 for path in parts[:-1])
