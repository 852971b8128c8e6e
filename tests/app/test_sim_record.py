"""What a recorded run in real time leaves in its folder."""

import os
from pathlib import Path

import pytest

from robotctl.app.config import find_file
from robotctl.app.sim import SimRun
from robotctl.app.sim_options import SimOptions
from robotctl.telemetry.recorded_log import read_recording


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
