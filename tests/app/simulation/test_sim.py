"""What a recorded run in real time leaves in its folder."""

import json
import os
import re
from pathlib import Path

import pytest
from mcap.reader import make_reader

from robotctl.app.simulation.sim import SimRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.runtime.flight.recorder import read_record

LINE = re.compile(r"\((\d+)\.(\d{6})\) \S+ ([0-9A-F]+)#(\w*)")


def frames(folder: Path, pattern: str) -> dict[tuple[str, str], list[int]]:
    """Return when each frame was on the bus [us], by identifier and data."""
    found: dict[tuple[str, str], list[int]] = {}
    for path in sorted(folder.glob(pattern)):
        for line in path.read_text(encoding="ascii").splitlines():
            if (match := LINE.fullmatch(line)) is not None:
                seconds, micros, frame_id, data = match.groups()
                found.setdefault((frame_id, data), []).append(int(seconds) * 10**6 + int(micros))
    return found


def check_one_time_base(folder: Path) -> None:
    """Check that what several logs tell stands at the same time in each."""
    host, simulator = frames(folder, "can-*.log"), frames(folder, "simulator-*.log")
    pairs = [(time_us, key) for key, times_us in host.items() for time_us in times_us]
    assert len(pairs) > 500
    assert all(time_us in simulator[key] for time_us, key in pairs)
    # A state says when each sonar's frame came, by the robot's clock.
    on_bus_us = {time_us for times_us in host.values() for time_us in times_us}
    epochs, heard_us = set(), set()
    for path in sorted(folder.glob("robot-*.mcap")):
        with path.open("rb") as file:
            for _, _, message in make_reader(file).iter_messages("control"):
                state = json.loads(message.data)
                epochs.add(message.log_time - state["stamp_ns"])
                heard_us |= {each["stamp_ns"] for each in state["sonars"] if each["stamp_ns"]}
    (epoch_ns,) = epochs
    heard_us = {(stamp_ns + epoch_ns) // 1000 for stamp_ns in heard_us}
    heard_us = {each for each in heard_us if min(on_bus_us) <= each <= max(on_bus_us)}
    assert len(heard_us) > 20
    assert heard_us <= on_bus_us
    for path in folder.glob("control-*.rec"):
        with path.open("rb") as file:
            assert read_record(file, path.name)[0].epoch_ns == epoch_ns


@pytest.mark.timeout(120)
def test_a_run_in_real_time_numbers_on_and_its_truth_has_the_times_of_its_log(
    tmp_path: Path,
) -> None:
    old = {"simulator-0001.log": b"old", "truth-0001.tum": b"1 0 0 0 0 0 0 1\n", "can.log": b"old"}
    for name, data in old.items():
        (tmp_path / name).write_bytes(data)
    options = SimOptions(
        find_file("diff_drive"),
        find_file("patrol", "missions"),
        bus=f"simcan:record-{os.getpid()}",
        max_seconds=30.0,
        record=tmp_path,
        overrides=("mavlink.link=[]", "log.file_mb=0.05", "log.total_mb=100"),
    )
    third, states = tmp_path / "simulator-0003.log", tmp_path / "robot-0002.mcap"
    with SimRun(options) as run:
        for progress in run.steps():
            is_logged = states.exists() and states.stat().st_size > 20_000
            if progress.navigation is not None and third.exists() and is_logged:
                break
        run.report()
    assert {name: (tmp_path / name).read_bytes() for name in old} == old
    assert 50_000 < (tmp_path / "simulator-0002.log").stat().st_size < 51_000
    recording = read_recording(states)
    assert recording.reference is not None
    middle_ns = int(recording.odometry.stamps_ns[len(recording.odometry.stamps_ns) // 2])
    assert recording.reference.at(middle_ns) is not None
    check_one_time_base(tmp_path)
