"""Draws pictures in a process of its own, so that the simulator's loop never waits for one.

The loop writes 40 bytes into a pipe for each exposure: number, time, pose. This process draws the
newest of them and drops those that it is too slow for; each picture is published when the camera's
latency is over. It ends with the pipe, or with the simulator, and has a process group of its own:
Ctrl-C only reaches the simulator.
"""

from __future__ import annotations

import argparse
import os
import select
import struct
import subprocess
import sys
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

from firmware_sim.command_line import parse_pose, tell
from firmware_sim.config.config import load_robot, parse_override
from firmware_sim.errors import SimulationError
from firmware_sim.pace import ClockReader, MonotonicPace
from firmware_sim.parent import end_with_parent
from firmware_sim.world.clutter import add_options, load_cluttered
from firmware_sim.world.publisher import Publisher
from firmware_sim.world.truth import Picture

_EXPOSURE = struct.Struct("<qqddd")
_WAITING = 65_536 // _EXPOSURE.size
"""Exposures read at once: all that a pipe holds (pipe(7)), so that the last is the newest."""
_QUEUE_LIMIT = 4
"""Maximum pictures kept for a slow subscriber."""
_NICE = 5
_READY = "ready"


class CameraProcess:
    """The simulator's end of the pipe; use as a context manager.

    Parameters
    ----------
    arguments
        Options of `main`, those of the simulator itself.

    Raises
    ------
    SimulationError
        If the process did not become ready, with the reason.
    """

    def __init__(self, arguments: Sequence[str]) -> None:
        command = [sys.executable, "-m", "firmware_sim.camera.process", *arguments]
        self._child = subprocess.Popen(  # noqa: S603 - our own module
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, process_group=0
        )
        if self._child.stdin is None or self._child.stdout is None:
            raise AssertionError("both are pipes")
        self._pipe = self._child.stdin
        said = self._child.stdout.readline().decode()
        if said.strip() != _READY:
            said += self._child.stdout.read().decode()
            self.close()
            raise SimulationError(f"--camera: {said.strip() or 'its process has died'}")
        os.set_blocking(self._pipe.fileno(), False)
        self._lost = False

    @property
    def pid(self) -> int:
        """Id of the process that draws."""
        return self._child.pid

    def expose(self, sequence: int, stamp_ns: int, pose: tuple[float, float, float]) -> None:
        """Ask for a picture; never waits. A process that has died is reported once."""
        try:
            os.write(self._pipe.fileno(), _EXPOSURE.pack(sequence, stamp_ns, *pose))
        except BlockingIOError:
            pass  # A pipe full of them is waiting: the process hangs.
        except BrokenPipeError:
            if not self._lost:
                self._lost = True
                sys.stderr.write("the camera's process has ended: no more pictures\n")

    def close(self) -> None:
        """End the process."""
        self._pipe.close()
        if self._child.stdout is not None:
            self._child.stdout.close()
        try:
            self._child.wait(2.0)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()

    def __enter__(self) -> CameraProcess:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw the exposures of standard input until it ends; return 0, or 2 on bad input."""
    end_with_parent()
    parser = argparse.ArgumentParser(prog="python -m firmware_sim.camera.process")
    add = parser.add_argument
    add("--robot", type=Path, required=True)
    add("--world", type=Path, required=True)
    add("--set", action="append", default=[])
    add("--seed", type=int, default=0)
    add("--camera", required=True)
    add("--clock", type=Path)
    add("--start", type=parse_pose)
    add_options(add)
    options = parser.parse_args(arguments)
    os.nice(_NICE)
    try:
        _serve(options)
    except SimulationError as error:
        tell(str(error))
        return 2
    return 0


def _serve(options: argparse.Namespace) -> None:
    robot = load_robot(options.robot, dict(parse_override(text) for text in options.set))
    latency_ns = round(robot.simulation.camera.latency_ms * 1e6)
    clock = MonotonicPace() if options.clock is None else ClockReader(options.clock)
    with Publisher(options.camera, _QUEUE_LIMIT) as publisher:
        # Loading numba takes a second, which `--help` need not wait for.
        from firmware_sim.camera.camera import Camera  # noqa: PLC0415

        world = load_cluttered(
            options.world, options.start, options.clutter, options.seed, options.keep_clear
        )
        camera = Camera(robot, world, options.seed)
        camera.look(*world.start)
        tell(_READY)
        drawn: deque[Picture] = deque()
        while True:
            due_s = None
            if drawn:
                due_s = max(0, drawn[0].stamp_ns + latency_ns - clock.now_ns()) / 1e9
            asked, _, _ = select.select([sys.stdin], (), (), due_s)
            while drawn and drawn[0].stamp_ns + latency_ns <= clock.now_ns():
                publisher.publish(drawn.popleft())
            if asked:
                exposure = _newest()
                if exposure is None:
                    return
                sequence, stamp_ns, pose = exposure
                view = camera.look(*pose, number=sequence)
                drawn.append(view.framed(stamp_ns, sequence))


def _newest() -> tuple[int, int, tuple[float, float, float]] | None:
    """Wait for an exposure and return the newest one; None at the end. Writes are whole."""
    data = os.read(sys.stdin.fileno(), _WAITING * _EXPOSURE.size)
    if not data:
        return None
    sequence, stamp_ns, x_m, y_m, theta_rad = _EXPOSURE.unpack(data[-_EXPOSURE.size :])
    return sequence, stamp_ns, (x_m, y_m, theta_rad)


if __name__ == "__main__":
    sys.exit(main())
