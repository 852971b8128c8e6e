"""The lidar process: an RPLIDAR on a pseudo terminal, and its scans on the robot's socket."""

import contextlib
import math
import subprocess
import tempfile
import time

import numpy as np
import pytest
import zmq

from robotctl.config.options import StackOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import ConfigError
from robotctl.estimation.ranging.scan_messages import lidar_scan
from robotctl.messages.estimation import LidarScan
from robotctl.runtime.ipc.topics import Endpoints, Subscriber, endpoint_directory
from tests.drivers.lidar.rplidar_double import RplidarDouble, revolution

DEADLINE_S = 20.0


@contextlib.contextmanager
def process(double, instance):
    """Run the process on a double."""
    robot = str(find_file("diff_drive").resolve())
    settings = (
        'lidar.driver="rplidar"',
        f'lidar.device="{double.device}"',
        "lidar.yaw_deg=90",
        "lidar.x_m=0.1",
    )
    command = StackOptions(instance, robot, settings).command("robotctl.app.processes.lidar")
    child = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        yield child
    finally:
        child.terminate()
        child.communicate()


def next_scan(subscriber, double):
    """Let the lidar turn until a scan is heard."""
    end = time.monotonic() + DEADLINE_S
    turn = revolution(1.0 + 0.001 * np.arange(360))
    while time.monotonic() < end:
        if b"\xa5\x20" in double.asked:
            double.send(turn)
        time.sleep(0.1)
        for scan in subscriber.receive():
            return scan
    pytest.fail("no scan was heard")


@pytest.fixture
def instance(monkeypatch):
    with tempfile.TemporaryDirectory() as folder:  # pytest's own is too long for a socket
        monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
        yield "lidar"


def test_scans_are_published_as_they_were_measured(instance):
    address = Endpoints(endpoint_directory(instance)).lidar
    context = zmq.Context()
    subscriber = Subscriber[LidarScan](context, (address,), LidarScan)
    with RplidarDouble() as double, process(double, instance):
        scan = lidar_scan(next_scan(subscriber, double))
    context.destroy(linger=0)
    assert (scan.x_m, scan.y_m, len(scan.ranges_m)) == (0.1, 0.0, 360)
    assert 0.0 <= time.monotonic_ns() - scan.stamp_ns < DEADLINE_S * 1e9
    # 30 degrees clockwise of a zero that looks to the left: 60 degrees to the left of forward.
    beam = np.argmin(np.abs(scan.angles_rad - math.radians(60.0)))
    assert scan.ranges_m[beam] == pytest.approx(1.03, abs=0.002)


def test_a_lidar_that_is_not_there_ends_the_process_with_a_sentence(instance):
    with RplidarDouble(mute=True) as double, process(double, instance) as child:
        _, said = child.communicate(timeout=DEADLINE_S)
    assert child.returncode == 1
    assert "robotctl lidar: lidar: " in said
    assert "is it an RPLIDAR" in said


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ('lidar.driver="rplidr"', "rplidar"),
        ("lidar.beams=4", "lidar.beams: must be 8 to 3600, not 4"),
        ("lidar.min_range_m=20", "0 <= min_range_m < max_range_m"),
        ("lidar.baud=0", "lidar.baud: must be > 0"),
        ("lidar.yaw_deg=inf", "lidar.yaw_deg: must be finite"),
    ],
)
def test_a_wrong_table_is_refused(setting, said):
    settings = ('lidar.driver="rplidar"', setting)
    with pytest.raises(ConfigError, match=said.replace("<", ".")):
        load_robot(find_file("diff_drive"), settings)
