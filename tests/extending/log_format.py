"""The log format of docs/extending.md is read like any other."""

import pytest

from robotctl.logs.formats.log_text import LogFormatError
from robotctl.logs.formats.recorded_log import is_log, read_recording

GOOD = "stamp_ns,x_m,y_m,theta_rad\n0,0,0,0\n1000000000,0.5,0,0.1\n"


def test_it_is_told_by_its_headings_and_read(tmp_path):
    path = tmp_path / "drive.txt"
    path.write_text(GOOD)
    assert is_log(path)
    odometry = read_recording(path).odometry
    assert odometry.stamps_ns.tolist() == [0, 1_000_000_000]
    assert odometry.poses.tolist() == [[0.0, 0.0, 0.0], [0.5, 0.0, 0.1]]


def test_a_line_that_is_wrong_is_named(tmp_path):
    path = tmp_path / "drive.txt"
    path.write_text(GOOD + "2000000000,1,zero,0\n")
    with pytest.raises(LogFormatError, match=r"drive\.txt:4: '2000000000,1,zero,0' found"):
        read_recording(path)


def test_messages_name_it_among_the_others(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("nothing known\n")
    with pytest.raises(LogFormatError, match="odometry as CSV"):
        read_recording(path)
