"""The process firmware_sim of a simulated run."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from typing import Final

from robotctl.app.simulation.room import goals
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.app.simulation.simulator_files import SimulatorError, simulation_overrides
from robotctl.app.supervision.child_process import lines_of, start_child
from robotctl.app.supervision.pause import state_of
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig
from robotctl.model.sensors.camera import SIMULATED
from robotctl.planning.behave.mission.mission_file import Mission
from robotctl.runtime.ipc.topics import Endpoints
from robotctl.runtime.storage.log_folder import LogFolder

_READY_S: Final = 180.0
_BELOW_CONTROL: Final = 10
_POLL_S: Final = 0.05
_SILENT_S, _HELD_S = 0.3, 1.0
"""Silence after which it is asked why, and said in any case [s]."""
_READY, _FAULT = "ready", "fault at "
"""Prefix of its lines."""


class Simulator:
    """The process, from its start until `close`.

    Parameters
    ----------
    command
        Arguments of firmware_sim.
    faults
        Faults that have begun are added to it.
    say
        Given what the user should know.
    """

    def __init__(self, command: list[str], faults: list[str], say: Callable[[str], object]) -> None:
        self._faults = faults
        self._say = say
        self._is_ready = False
        self._truth_s: float | None = None
        self._is_silent = False
        python = [sys.executable, "-m", "firmware_sim"]
        self._process = start_child(
            python + command, stdout=subprocess.PIPE, text=True, errors="replace"
        )
        self._said = lines_of(self._process)

    def await_ready(self, stopped: Callable[[], bool]) -> None:
        """Wait until its nodes are there; its earlier output is read too.

        Raises
        ------
        KeyboardInterrupt
            Where the run was stopped meanwhile.
        SimulatorError
            If it ends, or takes too long.
        """
        deadline_s = time.monotonic() + _READY_S
        while not self._is_ready:
            if stopped():
                raise KeyboardInterrupt
            if self._process.poll() is not None or time.monotonic() > deadline_s:
                self._process.kill()
                status = self._process.wait()
                raise SimulatorError(f"firmware_sim did not become ready (exit status {status})")
            time.sleep(_POLL_S)
            self.listen()

    def listen(self) -> None:
        """Take readiness and begun faults."""
        while not self._said.empty():
            line = self._said.get() or ""
            self._is_ready |= line.startswith(_READY)
            if line.startswith(_FAULT):
                self._faults.append(line.removeprefix(_FAULT).rstrip())
                self._say(line.rstrip())

    def hear_truth(self) -> None:
        """Note that the truth was published."""
        self._truth_s = time.monotonic()

    def note_silence(self) -> None:
        """Say when it falls silent, which simulated time shows only later, and when it goes on."""
        if self._truth_s is None:
            return
        silent_s = time.monotonic() - self._truth_s
        if silent_s > _SILENT_S and not self._is_silent:
            why = state_of(self._process.pid)
            if why.startswith("stopped") or silent_s > _HELD_S:
                self._is_silent = True
                self._say(f"firmware_sim is held up: silent for {silent_s:.1f} s ({why})")
        elif silent_s <= _SILENT_S and self._is_silent:
            self._is_silent = False
            self._say("firmware_sim goes on")

    @property
    def end(self) -> str:
        """How it ended; empty while it runs."""
        status = self._process.poll()
        return "" if status is None else f"firmware_sim ended (status {status})"

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        try:
            self._process.wait(3.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()


def simulator_arguments(
    options: SimOptions, mission: Mission, stack: StackOptions, config: RobotConfig, ends: Endpoints
) -> list[str]:
    """Return the arguments of firmware_sim for a run."""
    start = options.start_of(mission)
    buses = (
        f"simcan:{bus.channel}" if bus.interface == "simcan" else bus.channel
        for bus in config.buses
    )
    arguments = [
        *("--robot", str(options.robot)),
        *("--world", str(options.find_world(mission))),
        *(f"--bus={bus}" for bus in buses),
        *("--seed", str(options.seed)),
        f"--start={start.x_m},{start.y_m},{start.heading_deg}",
        *("--truth", ends.truth),
        *("--priority", str(max(0, config.runtime.priority - _BELOW_CONTROL))),
    ]
    if options.people:
        arguments += ["--people", str(options.people), "--manner", options.manner]
    if options.clutter:
        arguments += ["--clutter", str(options.clutter)]
        arguments += [f"--keep-clear={x_m},{y_m}" for x_m, y_m in goals(mission)]
    for override in simulation_overrides(options.overrides):
        arguments += ["--set", override]
    if "lidar" in config.simulation:
        arguments += ["--lidar", ends.lidar]
    camera = config.camera
    if camera is not None and camera.enabled and camera.source == SIMULATED:
        arguments += ["--camera", ends.camera_frames]
    if stack.clock:
        arguments += ["--clock", stack.clock]
    if options.faults is not None:
        arguments += ["--faults", str(options.faults)]
    return arguments


def log_arguments(folder: LogFolder, config: RobotConfig, stack: StackOptions) -> list[str]:
    """Return the arguments with which firmware_sim logs the buses into a folder."""
    return [
        *("--log", str(folder.new("simulator", "log"))),
        *("--log-mb", str(config.log.file_mb)),
        *("--epoch-ns", str(stack.epoch_ns)),
    ]
