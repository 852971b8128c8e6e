"""TUM trajectories: written, read, and exact where it matters."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.logs.formats.log_text import LogFormatError
from robotctl.logs.formats.tum import read_tum, write_tum
from robotctl.model.trajectory import Trajectory


@given(
    start_ns=st.integers(0, 10**15),
    poses=st.lists(
        st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-3.14, 3.14)), min_size=1
    ),
)
def test_what_was_written_is_read_again(tmp_path_factory, start_ns, poses):
    path = tmp_path_factory.mktemp("tum") / "a.tum"
    stamps_ns = start_ns + 1_234_567 * np.arange(len(poses))
    write_tum(path, Trajectory(stamps_ns, np.array(poses)))
    again = read_tum(path)
    assert again.stamps_ns == pytest.approx(stamps_ns, abs=1)
    assert again.poses == pytest.approx(np.array(poses), abs=1e-6)


def test_a_line_is_time_position_and_quaternion(tmp_path):
    path = tmp_path / "a.tum"
    write_tum(path, Trajectory(np.array([1_248_446_182_116_000_001]), np.array([[1.5, -2.0, 2.0]])))
    words = path.read_text().split()
    assert words[0] == "1248446182.116000001"
    assert [float(word) for word in words[1:]] == pytest.approx(
        [1.5, -2.0, 0.0, 0.0, 0.0, math.sin(1.0), math.cos(1.0)]
    )


def test_of_wall_time_microseconds_are_read(tmp_path):
    path = tmp_path / "a.tum"
    path.write_text("# t x y z q\n1248446182.116001 1 2 3 0 0 0 1\n")
    assert read_tum(path).stamps_ns.tolist() == [1_248_446_182_116_001_000]


def test_the_heading_is_the_yaw_of_a_tilted_robot(tmp_path):
    yaw, pitch = 0.7, 0.2
    a, b, c, d = math.cos(yaw / 2), math.sin(yaw / 2), math.cos(pitch / 2), math.sin(pitch / 2)
    path = tmp_path / "a.tum"
    path.write_text(f"0 1 2 3 {-b * d} {a * d} {b * c} {a * c}\n")
    assert read_tum(path).poses[0] == pytest.approx([1.0, 2.0, yaw])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"a\.tum: no pose in it"),
        ("0 1 2 0 0 0 1\n", r"a\.tum:1: found 7 words, needed are 8"),
        ("0 1 2 0 0 0 0 2\n", r"a\.tum: pose 1: quaternion of length 2\.000"),
        ("2 1 2 0 0 0 0 1\n1 1 2 0 0 0 0 1\n", r"a\.tum: pose 2: its time lies before"),
    ],
)
def test_what_is_no_trajectory_is_refused(tmp_path, text, message):
    path = tmp_path / "a.tum"
    path.write_text(text)
    with pytest.raises(LogFormatError, match=message):
        read_tum(path)
