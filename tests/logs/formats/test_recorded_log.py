"""Which kind a recording is, and what is said of what is none."""

import gzip
from dataclasses import replace

import numpy as np
import pytest

from robotctl.errors import ConfigError
from robotctl.logs.formats import recorded_log
from robotctl.logs.formats.log_format import LogFormat
from robotctl.logs.formats.log_text import LogFormatError, inflated
from robotctl.logs.formats.recorded_log import is_log, read_recording, read_reference
from robotctl.logs.formats.tum import read_tum
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import Recording
from robotctl.model.trajectory import Trajectory


def test_a_file_that_is_not_there_is_named_with_the_nearest_one(tmp_path):
    (tmp_path / "intel.log.gz").write_text("")
    with pytest.raises(LogFormatError, match=r'intl\.log\.gz: no such .* mean "intel\.log\.gz"\?'):
        read_recording(tmp_path / "intl.log.gz")


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(LogFormatError, match=r"the folder .*away does not exist"):
        read_recording(tmp_path / "away" / "a.log")


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"1686487 0 0 0\n", "the first line begins with '1686487'"),
        (b"# nothing\n", "no text in it"),
        (b"\x01\x02\0\0", "no text in it"),
    ],
)
def test_a_file_of_no_known_kind_is_refused_with_the_kinds(tmp_path, content, found):
    path = tmp_path / "a.log"
    path.write_bytes(content)
    with pytest.raises(LogFormatError, match=f"{found}; needed is a CARMEN log, a MRCLAM folder"):
        read_recording(path)


def test_a_folder_of_no_known_kind_is_refused_with_the_kinds(tmp_path):
    with pytest.raises(LogFormatError, match=r"neither RobotN_Odometry\.dat"):
        read_recording(tmp_path)


def test_the_name_of_a_file_does_not_matter(tmp_path):
    path = tmp_path / "anything"
    path.write_text("# a comment\nODOM 1 2 3 0 0 0 1.5 host 1.5\n")
    assert read_recording(path).odometry.poses.tolist() == [[1.0, 2.0, 3.0]]


LINE = "ODOM 1 2 3 0 0 0 1.5 host 1.5\n"


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
@pytest.mark.parametrize("pack", [bytes, gzip.compress])
def test_a_mark_of_the_encoding_is_no_part_of_the_text(tmp_path, encoding, pack):
    path = tmp_path / "a.log"
    path.write_bytes(pack(LINE.encode(encoding)))
    assert read_recording(path).odometry.poses.tolist() == [[1.0, 2.0, 3.0]]


def test_damaged_gzip_data_are_refused_with_the_first_line_that_is_odd(tmp_path):
    rng = np.random.default_rng(1)
    lines = [f"ODOM {x:.6f} {y:.6f} 0 0 0 0 {i} host {i}" for i, (x, y) in
             enumerate(rng.normal(size=(4000, 2)))]  # fmt: skip
    text = "\n".join(lines) + "\n"
    packed, found, early = gzip.compress(text.encode()), 0, 0
    for at in rng.integers(100, len(packed) - 20, 10).tolist():
        bad = bytearray(packed)
        bad[at] ^= 0x10
        (tmp_path / "a.log.gz").write_bytes(bad)
        with pytest.raises(LogFormatError, match=r"a\.log\.gz:\d+: the gzip data are dam") as error:
            read_recording(tmp_path / "a.log.gz")
        line = int(str(error.value).split("gz:")[1].split(":")[0])
        content = inflated(bytes(bad))[0].decode(errors="replace").split("\n")
        true = next((i for i, (a, b) in enumerate(zip(content, lines), 1) if a != b), len(content))  # noqa: B905
        early += line < true
        found += line <= true + 20
    assert early == 0
    assert found >= 6


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"image: a.pgm\nresolution: 0.05\n", "a ROS map, which is for --map"),
        (b"resolution: 0.05\nimage: a.pgm\n", "a ROS map, which is for --map"),
        (b"P5\n2 2\n255\n1234", "a picture"),
        (b"\x89PNG\r\n\x1a\n\0\0", "a picture"),
        (b"[world]\nname = 'a'\n", "a TOML file, as worlds, missions and robots are"),
        (b"1,5;2,5\n", "begins with '1,5;2,5'; the columns are separated by ';', needed are space"),
        (b"t,x,y\n1,2,3\n", "begins with 't,x,y'; the columns are separated by commas"),
    ],
)
def test_what_is_no_log_is_called_by_its_name(tmp_path, content, found):
    path = tmp_path / "a.log"
    path.write_bytes(content)
    with pytest.raises(LogFormatError, match=rf"{found}.*; needed is a CARMEN log"):
        read_recording(path)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1;0;0;0;0;0;0;1", r"a\.tum:2: found 1 words, .*; the columns are separated by ';'"),
        ("1,0,0,0,0,0,0,1", r"a\.tum:2: found 1 words, .*; the columns are separated by commas"),
        ("1,5 0 0 0 0 0 0 1", r"a\.tum:2: t: found '1,5', .*; it has decimal commas"),
    ],
)
def test_separators_and_decimals_of_other_tables_are_named(tmp_path, line, message):
    path = tmp_path / "a.tum"
    path.write_text(f"0 0 0 0 0 0 0 1\n{line}\n")
    with pytest.raises(LogFormatError, match=message):
        read_tum(path)


def test_decimal_commas_in_a_log_are_named(tmp_path):
    path = tmp_path / "a.log"
    path.write_text(LINE + "ODOM 1,5 2 3 0 0 0 1.5 host 1.5\n")
    with pytest.raises(LogFormatError, match=r"a\.log:2: found '1,5', .* decimal commas"):
        read_recording(path)


@pytest.mark.recordings("cases/robotlaser1-bom.log.gz")
def test_the_public_log_with_a_mark_is_read(recordings):
    recording = read_recording(recordings / "cases" / "robotlaser1-bom.log.gz")
    assert len(recording.scans) == 40


def compass_log(path):
    """Return whether a file has the format of these tests: `# compass`, then one line a pose."""
    return path.is_file() and path.read_bytes().startswith(b"# compass\n")


def read_compass_log(path, options):
    rows = [line.split() for line in path.read_text().splitlines()[1:]]
    stamps_ns = [int(row[0]) for row in rows]
    poses = [SE2(*map(float, row[1:])) for row in rows]
    return Recording(path.name, odometry=Trajectory.of(stamps_ns, poses))


COMPASS = LogFormat("a compass log", compass_log, read_compass_log, has_time_unit=False)


@pytest.fixture
def with_compass_logs(monkeypatch):
    """Add the one line that a new format needs."""
    monkeypatch.setattr(recorded_log, "LOG_FORMATS", (*recorded_log.LOG_FORMATS, COMPASS))


def test_a_format_is_added_by_one_entry(tmp_path, with_compass_logs):
    path = tmp_path / "a.txt"
    path.write_text("# compass\n0 0 0 0\n1000000000 0.5 0 0.1\n")
    assert is_log(path)
    assert read_recording(path).odometry.poses.tolist() == [[0.0, 0.0, 0.0], [0.5, 0.0, 0.1]]
    with pytest.raises(ConfigError, match=r"--time-unit ms: the times of .* are nanoseconds"):
        read_recording(path, time_unit="ms")


def test_what_is_read_is_listed_from_the_registry(tmp_path, with_compass_logs):
    path = tmp_path / "a.txt"
    path.write_text("nothing known\n")
    with pytest.raises(LogFormatError) as error:
        read_recording(path)
    places = [str(error.value).find(each.name) for each in recorded_log.LOG_FORMATS]
    assert -1 not in places
    assert places == sorted(places)


def test_the_files_that_tell_a_folder_are_listed_from_the_registry(tmp_path):
    with pytest.raises(LogFormatError) as error:
        read_recording(tmp_path)
    for kind in recorded_log.LOG_FORMATS:
        assert kind.in_folder in str(error.value)


def test_no_two_formats_claim_one_file(tmp_path):
    (tmp_path / "a.log").write_text(LINE)
    (tmp_path / "Robot1_Odometry.dat").write_text("# t v w\n1 0 0\n")
    (tmp_path / "r_motors.txt").write_text("M 0 0 0 0 0 0\n")
    (tmp_path / "a.tum").write_text("0 0 0 0 0 0 0 1\n")
    (tmp_path / "a.bag").write_bytes(b"#ROSBAG V2.0\n")
    (tmp_path / "a.mcap").write_bytes(b"\x89MCAP0\r\n robotctl")
    (tmp_path / "b.mcap").write_bytes(b"\x89MCAP0\r\n ros2")
    (tmp_path / "a.keyframes").write_bytes(b"robotctl-keyframes 1\n")
    claims = {
        path.name: [kind.name for kind in recorded_log.LOG_FORMATS if kind.matches(path)]
        for path in tmp_path.iterdir()
    }
    assert {name: len(names) for name, names in claims.items()} == dict.fromkeys(claims, 1)
    assert len({names[0] for names in claims.values()}) == len(recorded_log.LOG_FORMATS)


def test_a_trajectory_is_a_reference_and_no_log(tmp_path):
    path = tmp_path / "a.tum"
    path.write_text("0 0 0 0 0 0 0 1\n1 0.5 0 0 0 0 0 1\n")
    reference, has_heading = read_reference(path)
    assert reference.poses.tolist() == [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]
    assert has_heading
    with pytest.raises(LogFormatError, match=r"a TUM trajectory .*no motion of the robot; needed"):
        read_recording(path)


def test_a_log_without_a_reference_is_no_reference(tmp_path):
    path = tmp_path / "a.log"
    path.write_text(LINE)
    with pytest.raises(LogFormatError, match=r"a\.log: no reference in it; a TUM trajectory"):
        read_reference(path)


def test_a_log_that_has_a_reference_is_one(tmp_path, monkeypatch):
    path = tmp_path / "a.txt"
    path.write_text("# compass\n0 0 0 0\n")
    truth = Trajectory.of([0, 1], [SE2(), SE2(1.0, 2.0, 0.0)])
    tracked = replace(
        COMPASS,
        read=lambda path, options: Recording(
            path.name, reference=truth, reference_has_heading=False
        ),
    )
    monkeypatch.setattr(recorded_log, "LOG_FORMATS", (*recorded_log.LOG_FORMATS, tracked))
    assert read_reference(path) == (truth, False)
