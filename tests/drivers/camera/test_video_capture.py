"""A video that players turn gives its pictures as the sensor has them."""

from __future__ import annotations

import struct
import time

import cv2
import numpy as np
import pytest

from robotctl.drivers.camera.video_capture import open_camera
from robotctl.runtime.clock import RealClock

SIZE = (64, 48)
UPRIGHT = (1 << 16, 0, 0, 0, 1 << 16, 0, 0, 0, 1 << 30)
QUARTER = (0, 1 << 16, 0, -(1 << 16), 0, 0, 48 << 16, 0, 1 << 30)
HALF = (-(1 << 16), 0, 0, 0, -(1 << 16), 0, 64 << 16, 48 << 16, 1 << 30)
"""Matrices of a track's header, ISO/IEC 14496-12, 8.3.2."""


def video(path, matrix):
    """Write a video whose upper left quarter is light, and how it is to be turned."""
    picture = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    picture[:24, :32] = 250
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10.0, SIZE)
    for _ in range(5):
        writer.write(picture)
    writer.release()
    data, upright = path.read_bytes(), struct.pack(">9i", *UPRIGHT)
    at = data.index(upright, data.index(b"tkhd"))
    path.write_bytes(data[:at] + struct.pack(">9i", *matrix) + data[at + len(upright) :])
    return str(path)


@pytest.mark.parametrize("matrix", [UPRIGHT, QUARTER, HALF])
def test_a_video_is_not_turned_as_its_player_would_turn_it(tmp_path, matrix):
    source = video(tmp_path / "drive.mp4", matrix)
    plain = cv2.VideoCapture(source)
    turned_by = {UPRIGHT: 0.0, QUARTER: 90.0, HALF: 180.0}[matrix]
    assert plain.get(cv2.CAP_PROP_ORIENTATION_META) == turned_by
    plain.release()
    camera = open_camera(source, SIZE, 10.0, RealClock())
    try:
        frame, deadline = None, time.monotonic() + 10.0
        while frame is None and time.monotonic() < deadline:
            frame = camera.read()
    finally:
        camera.close()
    assert frame is not None
    assert frame.image.shape == (SIZE[1], SIZE[0], 3)
    light = frame.image[..., 0] > 128
    assert light[4:20, 4:28].all()
    assert not light[28:].any()
    assert not light[:, 36:].any()
