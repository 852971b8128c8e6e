"""The process that draws the pictures: the same as in lockstep, newest only, and its end."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from firmware_sim.camera import Camera
from firmware_sim.camera_process import CameraProcess
from firmware_sim.errors import SimulationError
from firmware_sim.simulation import Simulation
from firmware_sim.world import load_world
from robotctl.drivers.simulated_camera import SimulatedCamera
from robotctl.runtime.camera_port import CameraFrame
from tests.firmware.camera_rig import CONFIGS, DIFF, SMALL, robot

WORLD = CONFIGS / "worlds" / "clutter.toml"
SEED = 7
DEADLINE_S = 20.0


def arguments(address: str, *settings: str) -> list[str]:
    small = [f"--set={key}={value}" for key, value in SMALL.items()]
    return [
        f"--robot={DIFF}",
        f"--world={WORLD}",
        f"--seed={SEED}",
        f"--camera={address}",
        *small,
        *(f"--set={each}" for each in settings),
    ]


@pytest.fixture
def address(tmp_path: Path) -> str:
    return f"ipc://{tmp_path}/sockets/camera"


@pytest.fixture
def camera(address: str) -> Iterator[SimulatedCamera]:
    listening = SimulatedCamera(address)
    yield listening
    listening.close()


def frame_of(process: CameraProcess, camera: SimulatedCamera, number: int) -> CameraFrame:
    """Expose this number until its picture arrives: the listener may still be on its way."""
    deadline = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline:
        process.expose(number, time.monotonic_ns(), (1.0, 2.0, 0.3))
        time.sleep(0.05)
        frame = camera.read()
        if frame is not None and frame.sequence == number:
            return frame
    raise AssertionError("no picture came")


def test_the_process_draws_what_lockstep_draws_after_the_cameras_latency(
    address: str, camera: SimulatedCamera
) -> None:
    expected = Camera(robot(SMALL), load_world(WORLD), SEED)
    with CameraProcess(arguments(address, "simulation.camera.latency_ms=40.0")) as process:
        for number in (3, 4):
            frame = frame_of(process, camera, number)
            assert time.monotonic_ns() - frame.stamp_ns >= 40_000_000
            assert (frame.image == expected.look(1.0, 2.0, 0.3, number).picture).all()
        # Of many exposures that wait, the last is drawn; who is too slow misses some.
        for number in range(100, 160):
            process.expose(number, time.monotonic_ns(), (1.0, 2.0, 0.3))
        seen = []
        deadline = time.monotonic() + DEADLINE_S
        while (not seen or seen[-1] < 159) and time.monotonic() < deadline:
            frame = camera.read()
            seen += [] if frame is None else [frame.sequence]
            time.sleep(0.002)
        assert seen[-1] == 159
        assert len(seen) < 60


def test_a_process_that_dies_is_told_once_and_the_simulation_goes_on(
    address: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with CameraProcess(arguments(address)) as process:
        os.kill(process.pid, signal.SIGKILL)
        deadline = time.monotonic() + DEADLINE_S
        said = ""
        while not said and time.monotonic() < deadline:
            process.expose(1, time.monotonic_ns(), (1.0, 2.0, 0.3))
            said = capfd.readouterr().err
        process.expose(2, time.monotonic_ns(), (1.0, 2.0, 0.3))
        assert said == "the camera's process has ended: no more pictures\n"
        assert not capfd.readouterr().err


def test_a_camera_that_cannot_be_does_not_start_and_says_why(
    address: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SimulationError, match=r"--camera: .*below the floor"):
        CameraProcess(arguments(address, "simulation.camera.z_error_m=-1.0"))
    assert not capfd.readouterr().err


def test_lockstep_numbers_its_pictures_and_stamps_them_in_its_own_time() -> None:
    simulation = Simulation(robot(SMALL), load_world(WORLD), SEED)
    first = simulation.camera_frame()
    simulation.advance(100_000_000)
    second = simulation.camera_frame(origin_ns=5)
    assert first is not None
    assert second is not None
    assert (first.sequence, first.stamp_ns) == (0, 0)
    assert (second.sequence, second.stamp_ns) == (1, 100_000_005)
    expected = Camera(robot(SMALL), load_world(WORLD), SEED).look(*simulation.pose(), number=1)
    assert second.pixels == expected.picture.tobytes()
    assert (second.width, second.height, second.encoding) == (160, 120, "bgr8")


def test_a_robot_without_a_camera_gives_no_picture() -> None:
    assert Simulation(CONFIGS / "tricycle.toml", load_world(WORLD)).camera_frame() is None
