"""Recordings as telemetry logs and as one MCAP file: what pymavlink and mcap find in them."""

import json
import math
import os
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

os.environ["MAVLINK20"] = "1"

import msgspec
import numpy as np
import pytest
from mcap.reader import make_reader
from pymavlink import mavutil
from pymavlink.dialects.v20 import common

from robotctl.app.simulation.lockstep import run_lockstep
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.messages.control import Notice
from robotctl.workbench.logs.mcap import export_mcap
from robotctl.workbench.logs.record_rows import record_rows
from robotctl.workbench.logs.tlog import export_tlog
from tests.app.simulation.missions import PATROL
from tests.cli.command import status_of
from tests.logs.mcap.schema_check import checked_topics
from tests.mavlink.conftest import CONTROL
from tests.workbench.logs.test_export import EPOCH_NS, write_log

SECONDS = 12.0


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recorded run with a localiser, in several files."""
    folder = tmp_path_factory.mktemp("run")
    run_lockstep(
        SimOptions(
            find_file("diff_drive"),
            PATROL,
            record=folder,
            max_seconds=SECONDS,
            localisation=('localisation.method="mcl"',),
            overrides=("log.file_mb=0.2", "log.total_mb=100"),
        )
    )
    assert len(list(folder.glob("robot-*.mcap"))) > 1
    return folder


def logged(*files: Path) -> dict[str, list[tuple[int, dict[str, Any]]]]:
    """Return times and contents of each topic, as the reference reader finds them."""
    found = defaultdict(list)
    for path in files:
        with path.open("rb") as file:
            for _, channel, message in make_reader(file, validate_crcs=True).iter_messages():
                found[channel.topic].append((message.log_time, json.loads(message.data)))
    return found


@pytest.fixture(scope="module")
def topics(run: Path) -> dict[str, list[tuple[int, dict[str, Any]]]]:
    return logged(*sorted(run.glob("robot-*.mcap")))


def frames(file: Path) -> Iterator[Any]:
    """Yield what pymavlink reads in a telemetry log, garbage too."""
    log = mavutil.mavlink_connection(str(file), dialect="common")
    while (message := log.recv_match()) is not None:
        yield message
    log.close()


@pytest.fixture(scope="module")
def sent(run: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Any]]:
    file = tmp_path_factory.mktemp("tlog") / "run.tlog"
    count, notes = export_tlog(run, file)
    found = defaultdict(list)
    for message in frames(file):
        found[message.get_type()].append(message)
    assert "BAD_DATA" not in found
    assert sum(map(len, found.values())) == count
    assert notes == []
    return found


def by_boot_ms(states: list[tuple[int, dict[str, Any]]]) -> dict[int, tuple[int, dict[str, Any]]]:
    return {state["stamp_ns"] // 1_000_000: (time_ns, state) for time_ns, state in states}


def test_places_and_headings_are_those_of_the_log(topics: Any, sent: Any) -> None:
    poses = dict(topics["T_world_base"])
    states = by_boot_ms(topics["control"])
    assert len(sent["LOCAL_POSITION_NED"]) > 80
    distances = []
    for position in sent["LOCAL_POSITION_NED"]:
        time_ns, state = states[position.time_boot_ms]
        place = poses[time_ns]["pose"]["position"]
        distances.append(math.hypot(position.x - place["y"], position.y - place["x"]))
        speed = math.hypot(position.vx, position.vy)
        assert speed == pytest.approx(abs(state["v_m_s"]), abs=1e-5)
    turns = []
    for attitude in sent["ATTITUDE"]:
        time_ns, _ = states[attitude.time_boot_ms]
        north_rad = math.pi / 2 - poses[time_ns]["theta_rad"]
        turns.append(abs(math.remainder(attitude.yaw - north_rad, math.tau)))
    # A newer message of the localiser may come between the two.
    for errors, least in ((distances, 1e-5), (turns, 1e-5)):
        assert np.median(errors) < least
        assert np.max(errors) < 0.05


def test_each_frame_has_the_time_at_which_it_would_have_been_sent(topics: Any, sent: Any) -> None:
    states = by_boot_ms(topics["control"])
    for message in sent["LOCAL_POSITION_NED"]:
        age_s = message._timestamp - 1e-9 * states[message.time_boot_ms][0]
        assert 0.0 <= age_s <= 0.07  # a period of the states, and one of telemetry
    for message in sent["SYSTEM_TIME"]:
        assert 1e-6 * message.time_unix_usec == pytest.approx(message._timestamp, abs=1e-6)
    times = [each._timestamp for kind in sent.values() for each in kind]
    first, last = (1e-9 * topics["control"][i][0] for i in (0, -1))
    assert first <= min(times) <= first + 1.1
    assert last <= max(times) <= last + 0.02


def test_rates_are_those_of_telemetry(sent: Any) -> None:
    expected = {"HEARTBEAT": 1.0, "ATTITUDE": 10.0, "WHEEL_DISTANCE": 5.0, "BATTERY_STATUS": 1.0,
                "DISTANCE_SENSOR": 40.0, "SYS_STATUS": 1.0}  # fmt: skip
    for kind, rate_hz in expected.items():
        count = len(sent[kind])
        assert count == pytest.approx(rate_hz * SECONDS, rel=0.2, abs=4), kind


def test_wheels_and_arming_are_those_of_the_log(topics: Any, sent: Any) -> None:
    states = by_boot_ms(topics["control"])
    for message in sent["WHEEL_DISTANCE"]:
        _, state = states[message.time_usec // 1000]
        assert list(message.distance[: message.count]) == state["wheel_distance_m"]
    armed = {bool(each.base_mode & common.MAV_MODE_FLAG_SAFETY_ARMED) for each in sent["HEARTBEAT"]}
    assert armed == {False, True}


def test_texts_are_the_notices(topics: Any, sent: Any) -> None:
    texts: list[str] = []
    chunks: dict[int, str] = {}
    for message in sent["STATUSTEXT"]:
        chunks[message.id] = chunks.get(message.id, "") + message.text
        if message.id == 0 or len(message.text) < 50:
            texts.append(chunks.pop(message.id))
    notices = [line for _, each in topics["notice"] for line in each["message"].splitlines()]
    assert texts == notices


def test_a_record_becomes_a_telemetry_log_of_its_odometry(run: Path, tmp_path: Path) -> None:
    file = tmp_path / "dump.tlog"
    export_tlog(run / "control-0001.rec", file)
    ticks = {
        time_ns // 1_000_000: row
        for _, time_ns, row in record_rows(run / "control-0001.rec", [], {"control"})
    }
    places = [each for each in frames(file) if each.get_type() == "LOCAL_POSITION_NED"]
    assert len(places) > 10
    for place in places:
        row = ticks[place.time_boot_ms]
        expected = (row["T_odom_base.y_m"], row["T_odom_base.x_m"])
        assert (place.x, place.y) == pytest.approx(expected, abs=1e-5)


def test_the_files_of_a_run_are_one(run: Path, topics: Any, tmp_path: Path) -> None:
    file = tmp_path / "whole.mcap"
    count, notes = export_mcap(run, file)
    assert notes == []
    whole = logged(file)
    assert whole.keys() == topics.keys()
    for topic, entries in topics.items():
        assert whole[topic] == entries
    assert sum(map(len, whole.values())) == count
    assert sum(checked_topics(file).values()) == count
    with file.open("rb") as source:
        summary = make_reader(source).get_summary()
    assert summary is not None
    assert len({each.topic for each in summary.channels.values()}) == len(summary.channels)


def test_what_is_damaged_is_left_out_and_told(run: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    first, second, *_ = sorted(run.glob("robot-*.mcap"))
    (folder / first.name).write_bytes(first.read_bytes()[: first.stat().st_size // 2])
    (folder / second.name).write_bytes(second.read_bytes())
    count, (note, *more) = export_mcap(folder, tmp_path / "whole.mcap")
    assert first.name in note
    assert more == []
    after = logged(tmp_path / "whole.mcap")
    assert sum(map(len, after.values())) == count
    assert len(after["control"]) > len(logged(second)["control"])


def test_a_record_of_the_control_loop_has_the_states_that_were_published(
    run: Path, topics: Any, tmp_path: Path
) -> None:
    file = tmp_path / "ticks.mcap"
    export_mcap(run / "control-0001.rec", file)
    checked_topics(file)
    found = logged(file)
    ticks = dict(found["control"])
    assert len(ticks) == len(found["control"]) > 5 * len(topics["control"]) / 2
    compared = 0
    for time_ns, state in topics["control"]:
        if time_ns in ticks:
            tick = ticks[time_ns]
            for missing in ("loop", "odometer_m"):
                state.pop(missing, None)
                tick.pop(missing, None)
            assert tick == state
            compared += 1
    assert compared > 10
    assert {"frames", "sensor_frames", "outline", "sonar_cones"} <= found.keys()
    said = [each["message"] for _, each in found["notice"]]
    assert "armed" in said


@pytest.mark.parametrize("option", ["--tlog", "--mcap"])
def test_what_is_no_recording_is_empty_or_would_be_lost_is_told_in_one_sentence(
    option: str, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "text.txt").write_text("no recording\n" * 100)
    (tmp_path / "empty").mkdir()
    write_log(tmp_path / "nothing.mcap")
    taken = tmp_path / "taken"
    taken.write_text("mine")
    for source, target, words in (
        (tmp_path / "missing", "new", "no such file or folder"),
        (tmp_path / "text.txt", "new", "control"),
        (tmp_path / "empty", "new", "no robot-*.mcap in it"),
        (tmp_path / "nothing.mcap", "new", "is in it"),
        (run, "taken", "is there, and would be lost"),
        (run, "nowhere/new", "nowhere does not exist"),
    ):
        assert status_of("record", "export", source, option, tmp_path / target) == 2
        told = capsys.readouterr().err
        assert words in told
        assert "Traceback" not in told
        assert not (tmp_path / "new").exists()
        assert not list(tmp_path.glob("*.part"))
    assert taken.read_text() == "mine"
    assert status_of("record", "export", run, option, tmp_path / "new") == 0
    assert str(tmp_path / "new") in capsys.readouterr().out


def test_two_runs_of_one_folder_follow_each_other_in_a_telemetry_log(tmp_path: Path) -> None:
    times_ns = range(0, 2_000_000_000, 20_000_000)
    states = [msgspec.structs.replace(CONTROL, stamp_ns=each) for each in times_ns]
    write_log(tmp_path / "robot-0001.mcap", *states, Notice(times_ns[-1], 6, "first"))
    write_log(tmp_path / "robot-0002.mcap", *states, Notice(times_ns[-1], 6, "second"))
    export_tlog(tmp_path, tmp_path / "both.tlog")
    kinds = Counter(each.get_type() for each in frames(tmp_path / "both.tlog"))
    assert kinds["HEARTBEAT"] == 4
    texts = [
        each.text for each in frames(tmp_path / "both.tlog") if each.get_type() == "STATUSTEXT"
    ]
    assert texts == ["first", "second"]
    stamps = [each._timestamp for each in frames(tmp_path / "both.tlog")]
    assert min(stamps) >= EPOCH_NS / 1e9
