"""The process that draws the pictures: the same as in lockstep, newest only, and its end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias

import pytest

from firmware_sim.camera.camera import Camera
from firmware_sim.camera.process import CameraProcess
from firmware_sim.errors import SimulationError
from firmware_sim.simulation import Simulation
from firmware_sim.world.world import load_world
from robotctl.drivers.camera.simulated_camera import SimulatedCamera
from robotctl.messages.camera_port import CameraFrame
from tests.firmware_sim.camera.camera_rig import CONFIGS, DIFF, SMALL, robot

WORLD = CONFIGS / "worlds" / "clutter.toml"
SEED = 7
DEADLINE_S = 20.0
FOLDED = "camera.intrinsics.distortion=[-0.9, 0.0, 0.0, 0.0, 0.0]"
LATENCY_NS = 400_000_000
Drawing: TypeAlias = tuple[CameraProcess, SimulatedCamera]


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


@pytest.fixture(scope="module")
def drawing(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Drawing]:
    address = f"ipc://{tmp_path_factory.mktemp('camera')}/sockets/camera"
    listening = SimulatedCamera(address)
    with CameraProcess(
        arguments(address, f"simulation.camera.latency_ms={LATENCY_NS / 1e6}")
    ) as process:
        yield process, listening
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


def test_the_process_draws_what_lockstep_draws_after_the_cameras_latency(drawing: Drawing) -> None:
    expected = Camera(robot(SMALL), load_world(WORLD), SEED)
    for number in (3, 4):
        frame = frame_of(*drawing, number)
        assert time.monotonic_ns() - frame.stamp_ns >= LATENCY_NS
        assert (frame.image == expected.look(1.0, 2.0, 0.3, number).picture).all()


def test_of_all_exposures_that_wait_the_last_is_drawn(drawing: Drawing) -> None:
    process, camera = drawing
    frame_of(process, camera, 5)
    os.kill(process.pid, signal.SIGSTOP)
    os.waitpid(process.pid, os.WUNTRACED)
    for number in range(100, 500):
        process.expose(number, time.monotonic_ns(), (1.0, 2.0, 0.3))
    os.kill(process.pid, signal.SIGCONT)
    seen = []
    deadline = time.monotonic() + DEADLINE_S
    while 499 not in seen and time.monotonic() < deadline:
        frame = camera.read()
        seen += [] if frame is None or frame.sequence == 5 else [frame.sequence]
        time.sleep(0.002)
    assert seen == [499]


def test_a_long_latency_delays_pictures_and_does_not_drop_them(drawing: Drawing) -> None:
    process, camera = drawing
    number = 1000
    seen = [0, 0, 0, 0]
    deadline = time.monotonic() + DEADLINE_S
    while seen[-1] < 1003 or seen[-1] - seen[-4] != 3:
        assert time.monotonic() < deadline, seen
        process.expose(number, time.monotonic_ns(), (1.0, 2.0, 0.3))
        number += 1
        for _ in range(10):
            time.sleep(0.002)
            frame = camera.read()
            if frame is not None:
                assert time.monotonic_ns() - frame.stamp_ns >= LATENCY_NS
                seen.append(frame.sequence)


STRUCK = """
import os, signal
from firmware_sim.camera.process import CameraProcess
from robotctl.drivers.camera.simulated_camera import SimulatedCamera
from tests.firmware_sim.camera.test_camera_process import arguments, frame_of

for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
    signal.signal(number, lambda *_: None)
with CameraProcess(arguments({address!r})) as process:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.killpg(0, number)
    camera = SimulatedCamera({address!r})
    frame_of(process, camera, 1)
    camera.close()
    print("drawn", flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_the_process_outlives_signals_to_the_simulators_group_but_not_the_simulator(
    address: str,
) -> None:
    ran = subprocess.run(
        [sys.executable, "-c", STRUCK.format(address=address)],
        cwd=CONFIGS.parent,
        start_new_session=True,
        capture_output=True,
        timeout=2 * DEADLINE_S,
        check=False,
    )
    # That it came here: standard error ends with the last who holds it, the process that draws.
    assert (ran.returncode, ran.stdout, ran.stderr) == (-signal.SIGKILL, b"drawn\n", b"")


def test_a_process_whose_simulator_has_gone_while_it_made_ready_ends_in_silence(
    address: str,
) -> None:
    heard, told = os.pipe()
    os.close(heard)
    ran = subprocess.run(
        [sys.executable, "-m", "firmware_sim.camera.process", *arguments(address)],
        stdin=subprocess.DEVNULL,
        stdout=told,
        stderr=subprocess.PIPE,
        timeout=DEADLINE_S,
        check=False,
    )
    os.close(told)
    assert (ran.returncode, ran.stderr) == (0, b"")


def test_an_address_that_is_none_is_told_before_the_camera_is_made() -> None:
    with pytest.raises(SimulationError, match="--camera: nowhere: not an address"):
        CameraProcess(arguments("nowhere", FOLDED))


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
    with pytest.raises(SimulationError, match="--camera: diff_drive: camera: distortion: folds"):
        CameraProcess(arguments(address, FOLDED))
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
