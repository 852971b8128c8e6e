"""Which kind a recording is, and what is said of what is none."""

import pytest

from robotctl.telemetry.log_text import LogFormatError
from robotctl.telemetry.recorded_log import read_recording


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
        (b"\x89PNG\r\n\0\0", "no text in it"),
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
