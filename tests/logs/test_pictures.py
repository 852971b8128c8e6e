"""Pictures of the camera beside the logs: which are kept, when, and for how long."""

import resource

import numpy as np
import pytest
import zmq
from PIL import Image

from robotctl.app.processes.recorder import RobotRecorder
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.drivers.camera.simulated_camera import picture_message
from robotctl.logs.formats.image_folder import timed_images
from robotctl.logs.pictures import PictureLog
from robotctl.messages.camera_port import CameraFrame
from robotctl.runtime.clock import RealClock
from robotctl.runtime.ipc.topics import Endpoints, Publisher, endpoint_directory
from robotctl.runtime.storage.log_folder import LogConfig, LogFolder

MS = 1_000_000
RED_BGR = (20, 30, 200)


def picture(stamp_ns, bgr=RED_BGR, size=(48, 64)):
    return CameraFrame(stamp_ns, 0, np.full((*size, 3), bgr, dtype=np.uint8))


def test_a_picture_is_a_jpeg_named_by_the_time_of_the_logs(tmp_path):
    log = PictureLog(LogFolder(tmp_path, LogConfig()), 0.5, epoch_ns=1_795_764_000_000_000_000)
    log.step(None)
    log.step(picture(123_456_789))
    (file,) = (tmp_path / "pictures-0001").iterdir()
    assert file.name == "1795764000123456789.jpg"
    with Image.open(file) as image:
        assert image.size == (64, 48)
        assert image.getpixel((30, 20)) == pytest.approx(RED_BGR[::-1], abs=4)


def test_pictures_are_kept_at_the_period_though_stamps_jitter(tmp_path):
    log = PictureLog(LogFolder(tmp_path, LogConfig()), 0.5, epoch_ns=0)
    stamps_ms = [1000, 1090, 1480, 1500, 1980, 2100, 2460, 5000, 5100, 5600]
    for stamp_ms in stamps_ms:
        log.step(picture(stamp_ms * MS))
        log.step(picture(stamp_ms * MS))
    kept = [each.stamp_ns // MS for each in timed_images(tmp_path / "pictures-0001")]
    assert kept == [1000, 1480, 1980, 2460, 5000, 5600]


def test_the_folder_has_the_number_of_the_runs_log_of_states(tmp_path):
    folder = LogFolder(tmp_path, LogConfig())
    (tmp_path / "robot-0004.mcap").touch()
    assert folder.pictures().name == "pictures-0005"
    assert folder.begin_run() == 5
    assert folder.pictures().name == "pictures-0005"


def test_the_oldest_pictures_of_all_runs_go_first(tmp_path):
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 255, (120, 160, 3), dtype=np.uint8)
    folder = LogFolder(tmp_path, LogConfig(file_mb=0.05, total_mb=0.5))
    for first_s in (0, 45):
        run = folder.begin_run()
        log = PictureLog(folder, 0.5, epoch_ns=0)
        for second in range(first_s, first_s + 45):
            log.step(CameraFrame(second * 1000 * MS, second, noise.copy()))
    assert run == 2
    assert [each.name for each in tmp_path.glob("pictures-*")] == ["pictures-0002"]
    kept = timed_images(tmp_path / "pictures-0002")
    sizes = [each.path.stat().st_size for each in kept]
    assert 0.5e6 - max(sizes) < sum(sizes) <= 0.5e6
    kept_s = [each.stamp_ns // (1000 * MS) for each in kept]
    assert kept_s == list(range(90 - len(kept_s), 90))


def test_of_a_picture_that_the_disk_refuses_nothing_stays(tmp_path):
    log = PictureLog(LogFolder(tmp_path, LogConfig()), 0.5, epoch_ns=0)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200, before[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            log.step(picture(0))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == []
    log.step(picture(1000 * MS))
    assert [each.stamp_ns for each in timed_images(tmp_path / "pictures-0001")] == [1000 * MS]


def test_the_recorder_keeps_what_the_camera_publishes(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    config = load_robot(
        find_file("diff_drive"), ["camera.enabled=true", "log.pictures_every_s=0.2"]
    )
    options = StackOptions(
        "robot", str(find_file("diff_drive")), record=str(tmp_path / "logs"), epoch_ns=5
    )
    recording = RobotRecorder(config, options)
    context = zmq.Context()
    sender = Publisher(context, Endpoints(endpoint_directory("robot")).camera_frames, queue=1)
    kept = tmp_path / "logs" / "pictures-0001"
    clock, number = RealClock(), 0
    end_ns = clock.now_ns() + 10_000 * MS
    while not (kept.is_dir() and len(list(kept.iterdir())) == 3) and clock.now_ns() < end_ns:
        number += 1
        sender.send_bytes(picture_message(picture(number * 200 * MS)))
        clock.sleep_until(clock.now_ns() + 5 * MS)
        assert recording.step([], number * 100 * MS) == ()
    recording.finish(list, clock)
    context.destroy(linger=0)
    stamps_ns = np.array([each.stamp_ns for each in timed_images(kept)])
    assert len(stamps_ns) == 3
    assert np.all((stamps_ns - 5) % (200 * MS) == 0)
    assert np.all(np.diff(stamps_ns) >= 200 * MS)
