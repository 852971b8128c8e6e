"""Which kind a recording is, and what is said of what is none."""

import gzip

import numpy as np
import pytest

from robotctl.logs.formats.log_text import LogFormatError, inflated
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.logs.formats.tum import read_tum


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
    for at in rng.integers(100, len(packed) - 20, 20).tolist():
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
    assert found >= 12


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
        ("1,5 0 0 0 0 0 0 1", r"a\.tum:2: t: found '1,5', .*; its decimals stand behind a comma"),
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
    with pytest.raises(LogFormatError, match=r"a\.log:2: found '1,5', .* behind a comma"):
        read_recording(path)


@pytest.mark.recordings("cases/robotlaser1-bom.log.gz")
def test_the_public_log_with_a_mark_is_read(recordings):
    recording = read_recording(recordings / "cases" / "robotlaser1-bom.log.gz")
    assert len(recording.scans) == 40
