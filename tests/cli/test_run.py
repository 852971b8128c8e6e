"""What `robotctl run` refuses before anything starts."""

import os
import subprocess
import sys
import zlib
from pathlib import Path

import msgspec
import pytest

from robotctl.app.processes.progress import NAME, StoredProgress, progress_file
from robotctl.cli.run import place_of
from robotctl.config.robot_file import find_file
from robotctl.errors import RobotctlError
from tests.cli.command import status_of


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"item": 99}, "the mission has 5 items, against 99 done in the run saved there"),
        ({"item": -1}, "item must be at least 0, not -1"),
        ({"x_m": 1e308}, "x_m and y_m must be below 1000000, not 1e+308 and 0"),
    ],
)
def test_progress_that_no_robot_can_have_made_is_refused_with_a_sentence_alone(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    changes: dict[str, float],
    sentence: str,
) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    crc = zlib.crc32(find_file("patrol", "missions").read_bytes())
    values = msgspec.to_builtins(StoredProgress("first", 5.0, 0.0, 0.0, 0.0, crc, 1))
    body = msgspec.json.encode(values | changes)
    heading = b"robotctl-state 1 %d %08x\n" % (len(body), zlib.crc32(body))
    (tmp_path / NAME).write_bytes(heading + body)
    assert status_of("run", "--mission", "patrol", "--resume") == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert sentence in said.err


@pytest.mark.parametrize(
    ("item", "items", "words"),
    [
        (0, 5, "with item 1 of 5"),
        (4, 5, "with item 5 of 5"),
        (5, 5, "after the last item of its mission"),
        (0, 0, "without a mission"),
    ],
)
def test_it_says_where_it_goes_on(item: int, items: int, words: str) -> None:
    saved = StoredProgress("first", 5.0, 3.0, 4.0, 0.5, 1, item)
    assert place_of(saved, items) == f"{words} at x 3.00 m, y 4.00 m, 29 deg"


def test_what_is_damaged_is_said_where_the_generation_before_is_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    crc = zlib.crc32(find_file("patrol", "missions").read_bytes())
    for item in (1, 2):
        progress_file(tmp_path).save(StoredProgress("first", 5.0, 3.0, 4.0, 0.0, crc, item))
    (tmp_path / NAME).write_bytes(b"")

    def end() -> None:
        raise RobotctlError("far enough")

    monkeypatch.setattr("robotctl.cli.run.StopFlag", end)
    assert status_of("run", "--mission", "patrol", "--resume") == 2
    first, second = capsys.readouterr().out.splitlines()
    assert "set aside as" in first
    assert second.startswith("resuming with item 2 of 5 at x 3.00 m, y 4.00 m")


SPEAKS = """
from robotctl.cli.live.voice import Voice
with Voice() as voice:
    for _ in range(10_000):
        voice.say("x" * 80)
raise SystemExit(7)
"""


def test_a_robot_whose_words_nobody_can_take_drives_on() -> None:
    with Path("/dev/full").open("wb") as full:
        ended = subprocess.run([sys.executable, "-c", SPEAKS], stdout=full, check=False)
    assert ended.returncode == 7


def test_a_robot_whose_words_nobody_reads_drives_on_and_can_be_ended() -> None:
    reading, writing = os.pipe()
    try:
        ended = subprocess.run(
            [sys.executable, "-c", SPEAKS], stdout=writing, check=False, timeout=60.0
        )
    finally:
        os.close(writing)
        os.close(reading)
    assert ended.returncode == 7


def test_its_last_words_are_printed_before_it_ends() -> None:
    program = SPEAKS.replace("10_000", "500")
    ended = subprocess.run([sys.executable, "-c", program], stdout=subprocess.PIPE, check=False)
    assert ended.stdout == b"".join([b"x" * 80 + b"\n"] * 500)
