"""The MCAP log: what readers find in it, complete or cut by a kill."""

import io
import json
import math
import signal
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from robotctl.logs.mcap.log import McapLog
from robotctl.logs.mcap.recovery import McapLogError, is_complete, recover
from robotctl.messages.control import (
    Ack,
    ControlState,
    LoopStatistics,
    Mode,
    NavigationState,
    NodeStatus,
    Notice,
    SafetyState,
)
from robotctl.messages.faults import Fault, FaultCode
from tests.mavlink.conftest import CONTROL, NAVIGATION

EPOCH_NS = 1_700_000_000_000_000_000
FULL = msgspec.structs.replace(
    CONTROL,
    acks=(Ack(1, accepted=False, reasons=(Fault(FaultCode.BATTERY_LOW, "low"),)),),
    nodes=(NodeStatus(1, "drive", 5, 12, 1, ""),),
    loop=LoopStatistics(stage_us_p50={"receive": 1.5}, overrun_causes={"send": 2}),
    sonar_m=(math.inf, math.nan, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0),
    state=SafetyState.DRIVING,
)


def written(*messages: ControlState | NavigationState | Notice) -> bytes:
    file = io.BytesIO()
    log = McapLog(file, EPOCH_NS, "rover")
    for message in messages:
        log.add(message)
    log.close()
    return file.getvalue()


def read(data: bytes) -> list[tuple[str, str, int, dict]]:
    """What the reference reader finds: topic, schema, time and content."""
    return [
        (channel.topic, schema.name, message.log_time, json.loads(message.data))
        for schema, channel, message in make_reader(io.BytesIO(data)).iter_messages()
    ]


def test_all_messages_come_back_with_names_times_and_values() -> None:
    navigation = msgspec.structs.replace(NAVIGATION, stamp_ns=20, mode=Mode.AUTO, item_s_m=1.25)
    data = written(msgspec.structs.replace(FULL, stamp_ns=10), navigation, Notice(30, 4, "look"))
    control, frames, pose, navigated, notice = read(data)
    assert control[:3] == ("control", "ControlState", EPOCH_NS + 10)
    assert frames[:3] == ("frames", "foxglove.FrameTransforms", EPOCH_NS + 10)
    assert pose[:3] == ("T_world_base", "foxglove.PoseInFrame", EPOCH_NS + 10)
    assert control[3]["T_odom_base"] == {"x_m": FULL.x_m, "y_m": FULL.y_m, "theta_rad": 0.0}
    assert control[3]["state"] == SafetyState.DRIVING.value
    assert control[3]["battery"]["voltage_v"] == FULL.battery.voltage_v
    assert control[3]["nodes"][0]["name"] == "drive"
    assert control[3]["sonars"][:3] == [
        {"name": "0", "stamp_ns": 0, "out_of_range": True},
        {"name": "1", "stamp_ns": 0, "out_of_range": False},
        {"name": "2", "stamp_ns": 0, "range_m": 0.5, "out_of_range": False},
    ]
    assert control[3]["loop"]["stage_us_p50"] == {"receive": 1.5}
    assert navigated[:3] == ("navigation", "NavigationState", EPOCH_NS + 20)
    assert (navigated[3]["mode"], navigated[3]["item_s_m"]) == (Mode.AUTO.value, 1.25)
    assert notice[:3] == ("notice", "foxglove.Log", EPOCH_NS + 30)
    assert notice[3]["timestamp"] == {"sec": 1_700_000_000, "nsec": 30}
    assert (notice[3]["message"], notice[3]["level"], notice[3]["name"]) == ("look", 3, "rover")


@pytest.mark.parametrize(
    ("severity", "level"), [(0, 5), (2, 5), (3, 4), (4, 3), (5, 2), (6, 2), (7, 1)]
)
def test_severities_become_the_levels_of_log_panels(severity: int, level: int) -> None:
    assert read(written(Notice(0, severity, "x")))[0][3]["level"] == level


def chunk_places(content: bytes) -> list[range]:
    """Return which bytes are those of each chunk, by the log's own index."""
    summary = make_reader(io.BytesIO(content)).get_summary()
    assert summary is not None
    return [
        range(each.chunk_start_offset, each.chunk_start_offset + each.chunk_length)
        for each in summary.chunk_indexes
    ]


@given(st.data())
@settings(max_examples=60)
def test_a_log_cut_anywhere_is_recovered_to_its_last_flush(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    file = io.BytesIO()
    log = McapLog(file, EPOCH_NS, "rover")
    for second in range(8):
        for tenth in range(10):
            log.add(Notice(second * 10**9 + tenth * 10**8, 6, f"{second}.{tenth}"))
        log.flush()
    log.close()
    whole = file.getvalue()
    cut = data.draw(st.integers(8, len(whole)))
    path = tmp_path_factory.mktemp("log") / "robot-0001.mcap"
    path.write_bytes(whole[:cut])
    assert is_complete(path) == (cut == len(whole))
    chunks = chunk_places(whole)
    kept = sum(chunk.stop <= cut for chunk in chunks)
    if kept == 0:  # one chunk of zstd is one block: nothing of it can be read
        with pytest.raises(McapLogError, match=r"no message in it can be .*; left as it is"):
            recover(path)
        assert path.read_bytes() == whole[:cut]
        assert [each.name for each in path.parent.iterdir()] == ["robot-0001.mcap"]
        return
    recovered = recover(path)
    assert recovered.messages == 10 * kept
    assert is_complete(path)
    texts = [content["message"] for *_, content in read(path.read_bytes())]
    assert texts == [f"{s}.{tenth}" for s in range(8) for tenth in range(10)][: 10 * kept]
    beside = [each for each in path.parent.iterdir() if each != path]
    if any(chunk.start + 9 < cut < chunk.stop for chunk in chunks):
        assert "left out the cut end, " in recovered.loss()
        assert beside == [recovered.kept_aside]
        assert beside[0].read_bytes() == whole[:cut]
    else:
        assert (recovered.loss(), beside) == ("", [])


def test_what_is_no_log_stays_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "robot-0001.mcap"
    path.write_bytes(b"something else entirely")
    with pytest.raises(McapLogError, match="not an MCAP file"):
        recover(path)
    assert path.read_bytes() == b"something else entirely"


KILLED = """
import sys, time
from pathlib import Path
from robotctl.runtime.storage.log_folder import LogConfig, LogFolder
from robotctl.logs.logs import StateLog
from robotctl.messages.control import Notice
log = StateLog(LogFolder(Path(sys.argv[1]), LogConfig()), 0, "rover")
begin = time.monotonic_ns()
while True:
    now_ns = time.monotonic_ns()
    log.step((Notice(now_ns - begin, 6, "x" * 50),), now_ns)
    print(now_ns - begin, flush=True)
    time.sleep(0.005)
"""


def test_the_log_of_a_killed_process_opens_up_to_its_last_second(tmp_path: Path) -> None:
    child = subprocess.Popen(
        [sys.executable, "-c", KILLED, str(tmp_path)],
        stdout=subprocess.PIPE,
        cwd=Path(__file__).parents[3],
    )
    with child:
        assert child.stdout is not None
        last_ns = 0
        while last_ns < 2_600_000_000:
            last_ns = int(child.stdout.readline())
        child.send_signal(signal.SIGKILL)
        child.wait()
        for line in child.stdout:
            last_ns = int(line) if line.endswith(b"\n") else last_ns
    path = tmp_path / "robot-0001.mcap"
    assert not is_complete(path)
    begin_s = time.monotonic()
    assert recover(path).messages > 100
    assert time.monotonic() - begin_s < 10.0
    *_, (_, _, time_ns, _) = read(path.read_bytes())
    assert last_ns - time_ns <= 1_100_000_000
