"""What the sonars heard in recordings of ours: by states, by records, and by both."""

import math

import msgspec
import pytest

from robotctl.core.control_core import Inputs, Outputs
from robotctl.logs.formats.log_text import LogFormatError
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.logs.mcap.log import McapLog
from robotctl.messages.control import Feedback, SonarFeedback, WheelCommand
from robotctl.runtime.flight.recorder import Recorder, RecordHeader
from tests.mavlink.conftest import CONTROL

MS = 1_000_000
EPOCH_NS = 1_700_000_000_000_000_000
SPEED_M_S = 343.0
PERIOD_NS = 50 * MS
ROBOT = '{"sonar": [{"name": "front", "x_m": 0.1, "y_m": 0.0, "heading_deg": 0.0}]}'


def heard(k, salt=0.0):
    """What the sonar hears at 50 k ms [m]: other things in another run."""
    return 1.0 + 0.01 * k + salt


def write_log(path, ticks, epoch_ns=EPOCH_NS, salt=0.0, sonars=1):
    """Write the states at 50 k ms for each k, telling what came right then, and one before."""
    with path.open("wb") as file:
        log = McapLog(file, epoch_ns, "rover")
        for k in (ticks[0] - 1, *ticks):
            log.add(
                msgspec.structs.replace(
                    CONTROL,
                    stamp_ns=k * PERIOD_NS,
                    x_m=0.1 * k,
                    sonar_m=(heard(k, salt),) * sonars,
                    sonar_stamp_ns=(k * PERIOD_NS if k in ticks else 0,) * sonars,
                )
            )
        log.close()


def write_record(path, ticks, salt=0.0, robot=ROBOT):
    """Write a record that has each frame of the states, and one more between them."""
    with path.open("wb") as file:
        recorder = Recorder(file.write, RecordHeader("1", robot, 0.0, 0.0, 0.0))
        for k in ticks:
            for now_ns, range_m in (
                (k * PERIOD_NS - 20 * MS, math.inf),
                (k * PERIOD_NS, heard(k, salt)),
            ):
                frame = SonarFeedback(now_ns, 0, (range_m, *(3 * (math.nan,))))
                feedback = Feedback(sonars=(frame,))
                recorder.record(now_ns, Inputs(feedback), Outputs(WheelCommand()))


def ranges(recording):
    return [entry.reading.ranges_m for entry in recording.sonars]


def times_ms(recording, epoch_ns=EPOCH_NS):
    """When each sound with an echo came back [ms]."""
    return [
        round((sent_ns - epoch_ns + 2e9 * heard_m[0] / SPEED_M_S) / MS)
        for sent_ns, heard_m in (entry.reading for entry in recording.sonars)
        if math.isfinite(heard_m[0])
    ]


def test_the_records_tell_what_the_states_miss(tmp_path):
    write_log(tmp_path / "robot-0001.mcap", range(10, 20))
    write_record(tmp_path / "control-0001.rec", range(10, 20))
    recording = read_recording(tmp_path)
    assert ranges(recording).count((math.inf,)) == 10
    assert times_ms(recording) == list(range(500, 1000, 50))
    assert recording.notes == ()


def test_before_and_after_the_records_the_states_count(tmp_path):
    write_log(tmp_path / "robot-0001.mcap", range(10, 30))
    write_record(tmp_path / "control-0001.rec", range(15, 20))
    recording = read_recording(tmp_path)
    assert ranges(recording).count((math.inf,)) == 5
    assert times_ms(recording) == list(range(500, 1500, 50))
    stamps_ns = [entry.reading.stamp_ns for entry in recording.sonars]
    assert stamps_ns == sorted(stamps_ns)


def test_frames_that_two_records_repeat_are_read_once(tmp_path):
    write_log(tmp_path / "robot-0001.mcap", range(10, 20))
    write_record(tmp_path / "control-0001.rec", range(10, 17))
    write_record(tmp_path / "control-0002.rec", range(13, 20))
    assert len(read_recording(tmp_path).sonars) == 20


@pytest.mark.parametrize("begin", [5, 50])
def test_after_a_boot_each_state_has_its_own_time_and_the_states_alone_count(tmp_path, begin):
    later_ns = EPOCH_NS + 3600 * 10**9
    write_log(tmp_path / "robot-0001.mcap", range(10, 20))
    write_log(tmp_path / "robot-0002.mcap", range(begin, begin + 8), later_ns)
    write_record(tmp_path / "control-0001.rec", range(10, 20))
    recording = read_recording(tmp_path)
    before, after = times_ms(recording)[:10], times_ms(recording, later_ns)[10:]
    assert len(recording.sonars) == 18
    assert before == list(range(500, 1000, 50))
    assert after == list(range(50 * begin, 50 * begin + 400, 50))
    # Each at its own place, not at that of the same time after another boot.
    assert [entry.odometry.x_m for entry in recording.sonars[10:]] == pytest.approx(
        [0.1 * k - 4.0 * heard(k) / SPEED_M_S for k in range(begin, begin + 8)], abs=1e-6
    )
    assert (math.inf,) not in ranges(recording)
    assert any("2 epochs" in note for note in recording.notes)


def test_of_one_log_only_the_records_of_its_run_count(tmp_path):
    later_ns = EPOCH_NS + 3600 * 10**9
    write_log(tmp_path / "robot-0001.mcap", range(10, 20))
    write_log(tmp_path / "robot-0002.mcap", range(10, 20), later_ns, salt=0.5)
    write_record(tmp_path / "control-0001.rec", range(10, 20))
    write_record(tmp_path / "control-0002.rec", range(10, 20), salt=0.5)
    for name, epoch_ns, salt in (("0001", EPOCH_NS, 0.0), ("0002", later_ns, 0.5)):
        recording = read_recording(tmp_path / f"robot-{name}.mcap")
        assert ranges(recording).count((math.inf,)) == 10
        assert times_ms(recording, epoch_ns) == list(range(500, 1000, 50))
        finite = [each for (each,) in ranges(recording) if each < math.inf]
        assert finite == pytest.approx([heard(k, salt) for k in range(10, 20)])
        assert [note for note in recording.notes if "another run" in note] == list(recording.notes)


def test_a_record_of_a_robot_with_other_sonars_is_not_used(tmp_path):
    write_log(tmp_path / "robot-0001.mcap", range(10, 20), sonars=2)
    write_record(tmp_path / "control-0001.rec", range(10, 20))
    recording = read_recording(tmp_path)
    assert recording.sonar_mounts == ()
    assert len(recording.sonars) == 10


def test_a_damaged_record_counts_up_to_the_damage_and_then_the_states(tmp_path):
    record = tmp_path / "control-0001.rec"
    write_log(tmp_path / "robot-0001.mcap", range(10, 20))
    write_record(record, range(10, 15))
    whole = record.read_bytes()
    record.write_bytes(whole + (8).to_bytes(4, "little") + 8 * b"\xc1")
    recording = read_recording(tmp_path)
    assert ranges(recording).count((math.inf,)) == 5
    assert times_ms(recording) == list(range(500, 1000, 50))
    assert recording.sonar_mounts[0].name == "front"
    (note,) = recording.notes
    assert "is damaged" in note
    assert note.endswith("from there on sonar ranges are those of the states")


def test_a_record_that_is_none_leaves_the_states(tmp_path):
    write_log(tmp_path / "robot-0001.mcap", range(10, 20))
    (tmp_path / "control-0001.rec").write_bytes(b"")
    recording = read_recording(tmp_path)
    assert times_ms(recording) == list(range(500, 1000, 50))
    assert recording.notes[0].endswith("sonar ranges are those of the states")


def test_runs_whose_times_overlap_are_not_mixed(tmp_path):
    write_log(tmp_path / "robot-0001.mcap", range(10, 20))
    write_log(tmp_path / "robot-0002.mcap", range(5, 25), salt=0.5)
    recording = read_recording(tmp_path)
    assert times_ms(recording) == list(range(250, 1250, 50))
    found = [each for (each,) in ranges(recording)]
    assert found == pytest.approx([heard(k, 0.5) for k in range(5, 25)])
    assert any("set back by 0.750 s" in note for note in recording.notes)
    assert any("left out are 11 of 32 control states" in note for note in recording.notes)


def test_robots_with_different_sonars_are_refused(tmp_path):
    write_log(tmp_path / "robot-0001.mcap", range(10, 20))
    write_log(tmp_path / "robot-0002.mcap", range(20, 30), sonars=2)
    with pytest.raises(LogFormatError, match="states with 1 and 2 sonars"):
        read_recording(tmp_path)


def test_without_sonars_the_records_are_not_opened(tmp_path):
    write_log(tmp_path / "robot-0001.mcap", range(10, 20))
    (tmp_path / "control-0001.rec").write_bytes(b"")
    recording = read_recording(tmp_path, with_sonars=False)
    assert recording.sonars == ()
    assert recording.notes == ()
