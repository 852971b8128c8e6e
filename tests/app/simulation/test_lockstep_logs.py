"""What a recorded run in lockstep leaves in its folder."""

import hashlib
from pathlib import Path

import pytest

from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.logs.formats.robotctl_log import truth_files
from robotctl.logs.formats.tum import read_tum
from robotctl.runtime.flight.recorder import Tick, read_record
from robotctl.runtime.storage.log_folder import LogConfig, LogError, LogFolder
from robotctl.workbench.replay.replay import replay_file
from tests.app.simulation.missions import PATROL, drive, fingerprint

SMALL = ("log.file_mb=0.05", "log.total_mb=100")


def joined(folder: Path, pattern: str) -> bytes:
    return b"".join(path.read_bytes() for path in sorted(folder.glob(pattern)))


def ticks(path: Path) -> list[Tick]:
    with path.open("rb") as file:
        return [each for each in read_record(file, path.name)[1] if isinstance(each, Tick)]


def test_a_second_run_into_the_same_folder_numbers_on_and_touches_nothing(tmp_path: Path) -> None:
    options = {"localisation": ("localisation.mapping=true",), "max_seconds": 2, "record": tmp_path}
    drive(seed=1, **options)
    first = fingerprint(tmp_path)
    drive(seed=2, **options)
    both = fingerprint(tmp_path)
    assert {name: both[name] for name in first} == first
    added = sorted(both.keys() - first.keys())
    assert added == sorted(name.replace("0001", "0002") for name in first)
    assert {"can-0002.log", "map-0002.yaml", "map-0002.pgm", "truth-0002.tum"} <= set(added)


def test_each_log_of_a_folder_of_runs_has_the_truth_of_its_own_run(tmp_path: Path) -> None:
    for seed in (1, 2):
        drive(seed=seed, max_seconds=6, record=tmp_path, overrides=SMALL)
    first, second = sorted(tmp_path.glob("truth-*.tum"))
    begin = int(second.stem.removeprefix("truth-"))
    logs = sorted(tmp_path.glob("robot-*.mcap"))
    assert 1 < begin < len(logs)
    assert [truth_files(log) for log in logs] == [
        [first if number < begin else second] for number in range(1, len(logs) + 1)
    ]
    drives = read_recording(logs[0]), read_recording(logs[begin - 1])
    for own, other in (drives, drives[::-1]):
        assert own.reference is not None
        assert other.reference is not None
        assert (own.reference.poses[-1] != other.reference.poses[-1]).any()


def test_a_run_that_was_broken_off_has_no_truth_of_the_run_before(tmp_path: Path) -> None:
    drive(max_seconds=2, record=tmp_path)
    broken_off = LockstepRun(SimOptions(find_file("diff_drive"), PATROL, record=tmp_path)).steps()
    for _ in range(20):
        next(broken_off)
    broken_off.close()
    assert read_recording(tmp_path / "robot-0001.mcap").reference is not None
    assert read_recording(tmp_path / "robot-0002.mcap").reference is None


def test_a_run_that_was_broken_off_at_once_leaves_the_next_ones_truth_with_its_log(
    tmp_path: Path,
) -> None:
    assert LogFolder(tmp_path, LogConfig()).begin_run() == 1
    drive(max_seconds=1, record=tmp_path)
    (log,) = tmp_path.glob("robot-*.mcap")
    assert truth_files(log) == [tmp_path / "truth-0002.tum"]
    assert read_recording(log).reference is not None


def test_files_change_at_their_greatest_size_and_nothing_is_lost_between_two(
    tmp_path: Path,
) -> None:
    report = drive(seed=3, max_seconds=5, record=tmp_path / "whole")
    drive(seed=3, max_seconds=5, record=tmp_path / "parts", overrides=SMALL)
    records = sorted((tmp_path / "parts").glob("control-*.rec"))
    logs = sorted((tmp_path / "parts").glob("can-*.log"))
    assert len(records) > 3
    assert len(logs) > 3
    # A line or tick may go beyond; a record begins with some kilobytes of its own.
    assert max(path.stat().st_size for path in (*records, *logs)) < 51_000
    assert joined(tmp_path / "parts", "can-*.log") == joined(tmp_path / "whole", "can-*.log")
    whole = ticks(tmp_path / "whole" / "control-0001.rec")
    assert [tick for path in records for tick in ticks(path)] == whole
    assert len(whole) == round(200 * report.duration_s) > 1000


def test_every_file_of_a_run_replays_by_itself(tmp_path: Path) -> None:
    report = drive(max_seconds=5, record=tmp_path, overrides=SMALL)
    replayed = [replay_file(path).result for path in sorted(tmp_path.glob("control-*.rec"))]
    assert [each.difference for each in replayed] == [None] * len(replayed)
    assert sum(each.agreed for each in replayed) == round(200 * report.duration_s) > 1000


@pytest.mark.parametrize("robot", ["diff_drive", "tricycle", "ackermann"])
def test_the_same_seed_gives_the_same_files_in_turn_to_the_byte(robot: str, tmp_path: Path) -> None:
    for name in ("a", "b"):
        drive(robot, seed=7, max_seconds=5, record=tmp_path / name, overrides=SMALL)
    assert (tmp_path / "a" / "control-0002.rec").is_file()
    assert fingerprint(tmp_path / "a") == fingerprint(tmp_path / "b")


def test_the_oldest_files_go_while_a_run_is_longer_than_the_folder_may_be(tmp_path: Path) -> None:
    bounds = ("log.file_mb=0.02", "log.total_mb=0.2")
    report = drive(max_seconds=10, record=tmp_path, overrides=bounds)
    # Room is made when a file begins: four kinds have had one since.
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) < 0.2e6 + 4 * 0.022e6
    assert not (tmp_path / "control-0001.rec").exists()
    assert not (tmp_path / "can-0001.log").exists()
    assert read_tum(tmp_path / "truth-0001.tum").stamps_ns[-1] == 1e9 * report.duration_s
    newest = max(tmp_path.glob("control-*.rec"))
    assert replay_file(newest).result.difference is None


def test_what_is_in_a_folder_of_an_older_version_stays(tmp_path: Path) -> None:
    old = {"can.log": b"old", "truth.tum": b"0 1 2 0 0 0 0 1\n", "map.yaml": b"old"}
    for name, data in old.items():
        (tmp_path / name).write_bytes(data)
    drive(max_seconds=1, record=tmp_path)
    found = fingerprint(tmp_path)
    for name, data in old.items():
        assert found[name] == hashlib.sha256(data).hexdigest()


@pytest.mark.parametrize("below", ["", "sub"])
def test_a_file_in_the_place_of_the_folder_is_named(tmp_path: Path, below: str) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(LogError, match=r"is not a folder$"):
        LogFolder(tmp_path / "file" / below, LogConfig())
