"""Recordings that somebody starts and stops, and what the recorder says of itself."""

from __future__ import annotations

import shutil

import msgspec
import pytest
from mcap.reader import make_reader

from robotctl.app.processes.recorder import RobotRecorder
from robotctl.messages.control import LoopStatistics
from robotctl.runtime.clock import RealClock
from robotctl.runtime.ipc.topics import ring_path
from robotctl.workbench.replay.replay import replay_file
from tests.app.supervision.test_full_disk import CONFIG, OPTIONS, Loop, full_disk

SECOND_NS = 1_000_000_000


@pytest.fixture
def loop(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return Loop(ring_path("robot"))


def recorder(folder: str) -> RobotRecorder:
    return RobotRecorder(CONFIG, msgspec.structs.replace(OPTIONS, record=folder))


def messages_in(path) -> int:
    with path.open("rb") as file:
        return make_reader(file).get_summary().statistics.channel_message_counts[1]


def test_a_recording_that_is_stopped_is_complete_and_the_next_has_other_files(loop, tmp_path):
    logs = tmp_path / "logs"
    recording = recorder(str(logs))
    assert recording.state(0).is_recording
    state = loop.core.snapshot(0, LoopStatistics())

    def record(seconds) -> None:
        for second in seconds:
            loop.ticks(10)
            recording.step(
                [msgspec.structs.replace(state, stamp_ns=second * SECOND_NS)], second * SECOND_NS
            )

    record(range(3))
    assert recording.set_recording(on=True) == ()
    (said,) = recording.set_recording(on=False)
    assert "recording ended" in said
    assert not recording.state(0).is_recording
    assert messages_in(logs / "robot-0001.mcap") == 3
    record(range(3, 5))
    assert recording.set_recording(on=False) == ()
    assert [path.name for path in logs.glob("robot-*")] == ["robot-0001.mcap"]
    (said,) = recording.set_recording(on=True)
    assert "recording begins" in said
    record(range(5, 10))
    loop.ring.close()
    recording.finish(list, RealClock())
    assert messages_in(logs / "robot-0002.mcap") == 5
    assert replay_file(logs / "control-0002.rec").result.difference is None


def test_a_robot_without_a_folder_says_so_and_records_nothing(loop, tmp_path):
    recording = recorder("")
    assert recording.set_recording(on=True) == ()
    state = recording.state(5)
    assert (state.stamp_ns, state.folder, state.is_recording, state.free_bytes) == (
        5,
        "",
        False,
        None,
    )
    loop.ring.close()
    recording.finish(list, RealClock())


def test_a_full_disk_is_said_until_there_is_room(loop, tmp_path):
    logs = tmp_path / "logs"
    recording = recorder(str(logs))
    state = loop.core.snapshot(0, LoopStatistics())
    loop.ticks(10)
    assert recording.state(0).trouble == ""
    with full_disk():
        (said,) = recording.step([state], 0)
        assert recording.state(0).trouble == said
        assert recording.state(0).is_recording
        recording.step([state], SECOND_NS)
        assert recording.state(0).trouble == said, "it has not tried again"
    recording.step([state], 20 * SECOND_NS)
    assert recording.state(0).trouble == ""
    free = shutil.disk_usage(logs).free
    assert recording.state(0).free_bytes == pytest.approx(free, rel=0.2)
    loop.ring.close()
    recording.finish(list, RealClock())
