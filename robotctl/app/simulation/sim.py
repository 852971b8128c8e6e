"""A simulated run: firmware_sim and the whole stack as processes, one mission, one score."""

from __future__ import annotations

import os
import queue
import shutil
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from typing import TypeAlias

import zmq

from firmware_sim.faults.scenario import not_begun
from robotctl.app.processes.navigator import load_mission
from robotctl.app.simulation.camera_score import camera_score
from robotctl.app.simulation.held_up import HeldUp
from robotctl.app.simulation.journey_score import journey_score
from robotctl.app.simulation.map_truth import map_truth
from robotctl.app.simulation.operator import MissionOperator
from robotctl.app.simulation.room import arrived, goals, load_furnished
from robotctl.app.simulation.run_score import RunScore
from robotctl.app.simulation.run_status import BEST_EFFORT, PATIENCE, RunStatus, Truth
from robotctl.app.simulation.score import (
    Report,
    StampedPose,
    bus_report,
    is_over,
    loop_report,
    run_message,
)
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.app.simulation.simulator_files import (
    SimulatorError,
    bus_overrides,
    load_faults,
    simulation_overrides,
)
from robotctl.app.simulation.time_limit import TimeLimit
from robotctl.app.supervision.child_process import lines_of, start_child
from robotctl.app.supervision.exit_log import ExitLog
from robotctl.app.supervision.pause import state_of
from robotctl.app.supervision.stack import CONTROL, Stack
from robotctl.app.supervision.supervised import ProcessPhase
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig, load_robot
from robotctl.errors import DiskError
from robotctl.maps.map_fit import misfit
from robotctl.messages.control import (
    ControlState,
    Mode,
    NavigationState,
    Notice,
    SafetyState,
    Severity,
)
from robotctl.messages.estimation import (
    CameraView,
    LiveMap,
    LocalisationState,
    ParticleCloud,
    PlanView,
)
from robotctl.messages.ports import Clock
from robotctl.model.sensors.camera import SIMULATED
from robotctl.model.sensors.lidar import SOCKET
from robotctl.model.wall_map import WallMap
from robotctl.runtime.clock import RealClock
from robotctl.runtime.ipc.run_folder import hold_folder, remove_dead_runs, simulated_instance
from robotctl.runtime.ipc.topics import (
    Endpoints,
    RequestSender,
    Subscriber,
    endpoint_directory,
    ring_path,
)
from robotctl.runtime.storage.log_folder import LogFolder
from robotctl.web.links import read_links

_READY_S = 180.0
_BELOW_CONTROL = 10
_POLL_S = 0.05
_SAY_S = 5.0
_SILENT_S, _HELD_S = 0.3, 1.0
"""Silence of firmware_sim after which it is asked why, and said in any case [s]."""
_LATE_NS = 1_000_000_000
"""A notice that was said longer ago is shown with its age [ns]."""
_READY, _FAULT = "ready", "fault at "
"""Prefix of firmware_sim's lines."""


_Heard: TypeAlias = (
    ControlState
    | NavigationState
    | LocalisationState
    | ParticleCloud
    | PlanView
    | LiveMap
    | CameraView
    | Notice
)


class SimRun:
    """One run with processes in real time; use as a context manager.

    Parameters
    ----------
    options
        What to run.
    stopped
        Asked all the time whether to end.
    """

    def __init__(self, options: SimOptions, stopped: Callable[[], bool] = lambda: False) -> None:
        self._options = options
        self._stopped = stopped
        self.mission = load_mission(options.mission)
        self.world = options.find_world(self.mission)
        overrides: tuple[str, ...] = (
            PATIENCE,
            BEST_EFFORT,
            *options.settings(self.world),
            *bus_overrides(options),
        )
        robot = options.robot.resolve()
        self.config: RobotConfig = load_robot(robot, overrides)
        if self.config.lidar is not None:  # the simulator publishes the scans
            overrides += (f'lidar.driver="{SOCKET}"',)
            self.config = load_robot(robot, overrides)
        room = load_furnished(self.world, options, self.mission)
        self.walls = WallMap(room.segments)
        unfit = misfit(self.config, robot, self.world, self.walls)
        self._scenario = load_faults(options)
        start = options.start_of(self.mission)
        remove_dead_runs()
        instance = simulated_instance()
        self._held = hold_folder(instance)
        record = str(options.record.resolve()) if options.record else ""
        self._folder = endpoint_directory(instance)
        self._clock_file = ring_path(instance).with_suffix(".clock")
        self._stack_options = StackOptions(
            instance=instance,
            robot=str(robot),
            overrides=overrides,
            mission=str(options.mission.resolve()),
            x_m=start.x_m,
            y_m=start.y_m,
            theta_rad=start.pose.theta_rad,
            record=record,
            flights=record,
            state=str(self._folder),
            clock="" if options.hard_real_time else str(self._clock_file),
            run=uuid.uuid4().hex,
        )
        self._endpoints = Endpoints(self._folder)
        self._context = zmq.Context()
        self._states = Subscriber[_Heard](self._context, self._endpoints.published, _Heard)
        self._truths = Subscriber[Truth](self._context, (self._endpoints.truth,), Truth)
        self._to_control = RequestSender(self._context, self._endpoints.control_requests)
        self._to_navigation = RequestSender(self._context, self._endpoints.navigation_requests)
        self._said: queue.Queue[str | None] = queue.Queue()
        self._is_ready = False
        self._faults: list[str] = []
        self._run = 0
        self._clock: Clock = RealClock()
        self._held_up = HeldUp(self._clock)
        self._firmware: subprocess.Popen[str] | None = None
        self._stack: Stack | None = None
        self._exit_log: ExitLog | None = None
        self._operator = MissionOperator()
        self._said_waiting = False
        self._ended = ""
        """Why the run ended."""
        self._was_ready = False
        """Whether there has been a run that could be scored."""
        self._firmware_silent = False
        self._truth_s = 0.0
        """When the truth was last heard, monotonic [s]."""
        self._attended = self.config.web.enabled
        """Whether a robot that was stopped may be armed again: from the page, or the keyboard that
        stopped it."""
        self._score = RunScore(
            map_truth(options, room, self.mission, self.config),
            journey_score(options, room, self.mission, self.config),
            camera_score(self.config, options, room),
            has_localiser=self.config.localisation.method != "none",
            is_recorded=options.record is not None,
        )
        camera = self.config.camera
        self.progress = RunStatus(
            navigation_period_ns=round(1e9 / self.config.navigation.rate_hz),
            camera_period_ns=round(2e9 / camera.rate_hz) if camera is not None else 0,
        )
        if unfit:
            self.progress.lines.append(unfit)

    def __enter__(self) -> SimRun:
        """Start firmware_sim, then the stack.

        Raises
        ------
        KeyboardInterrupt
            Where the run was stopped meanwhile.
        """
        try:
            self._start_firmware()
            self._clock = self._stack_options.open_clock()
            self._held_up = HeldUp(self._clock)
            self._stack = Stack(self._stack_options)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_error: object) -> None:
        """End the stack first, so that its motors stop on a live bus."""
        if self._stack is not None:
            self._stack.close()
            self._stack = None
        if self._firmware is not None:
            self._firmware.terminate()
            try:
                self._firmware.wait(3.0)
            except subprocess.TimeoutExpired:
                self._firmware.kill()
                self._firmware.wait()
            if self._firmware.stdout is not None:
                self._firmware.stdout.close()
            self._firmware = None
        self._context.destroy(linger=0)
        shutil.rmtree(self._folder, ignore_errors=True)
        self._clock_file.unlink(missing_ok=True)
        os.close(self._held)

    def _start_firmware(self) -> None:
        """Start firmware_sim and wait for its nodes."""
        options, start = self._options, self._options.start_of(self.mission)
        buses = [
            f"simcan:{bus.channel}" if bus.interface == "simcan" else bus.channel
            for bus in self.config.buses
        ]
        command = [
            sys.executable,
            "-m",
            "firmware_sim",
            *("--robot", str(options.robot)),
            *("--world", str(self.world)),
            *(f"--bus={bus}" for bus in buses),
            *("--seed", str(options.seed)),
            f"--start={start.x_m},{start.y_m},{start.heading_deg}",
            *("--truth", self._endpoints.truth),
            *("--priority", str(max(0, self.config.runtime.priority - _BELOW_CONTROL))),
        ]
        if options.people:
            command += ["--people", str(options.people)]
        if options.clutter:
            command += ["--clutter", str(options.clutter)]
            command += [f"--keep-clear={x_m},{y_m}" for x_m, y_m in goals(self.mission)]
        for override in simulation_overrides(options.overrides):
            command += ["--set", override]
        if "lidar" in self.config.simulation:
            command += ["--lidar", self._endpoints.lidar]
        camera = self.config.camera
        if camera is not None and camera.enabled and camera.source == SIMULATED:
            command += ["--camera", self._endpoints.camera_frames]
        if self._stack_options.clock:
            command += ["--clock", self._stack_options.clock]
        if options.record is not None:
            folder = LogFolder(options.record, self.config.log)
            self._exit_log = ExitLog(options.record)
            self._run = folder.begin_run()
            command += ["--log", str(folder.new("simulator", "log"))]
            command += ["--log-mb", str(self.config.log.file_mb)]
            command += ["--epoch-ns", str(self._stack_options.epoch_ns)]
        if options.faults is not None:
            command += ["--faults", str(options.faults)]
        self._firmware = start_child(command, stdout=subprocess.PIPE, text=True, errors="replace")
        self._said = lines_of(self._firmware)
        self._await_firmware(self._firmware)

    def _await_firmware(self, process: subprocess.Popen[str]) -> None:
        """Wait until firmware_sim is ready; its earlier output is read too."""
        deadline_s = time.monotonic() + _READY_S
        while not self._is_ready:
            if self._stopped():
                raise KeyboardInterrupt
            if process.poll() is not None or time.monotonic() > deadline_s:
                process.kill()
                status = process.wait()
                raise SimulatorError(f"firmware_sim did not become ready (exit status {status})")
            time.sleep(_POLL_S)
            self._listen_to_firmware()

    @property
    def connections(self) -> tuple[str, ...]:
        """Where ground stations and CAN tools can connect."""
        links = tuple(f"MAVLink {link.url}" for link in self.config.mavlink.link)
        buses = tuple(f"CAN -i {bus.interface} -c {bus.channel}" for bus in self.config.buses)
        return (*links, *buses)

    def steps(self, *, until_done: bool = True) -> Iterator[RunStatus]:
        """Arm and start the mission, each once, and yield the progress until the run is over.

        Without `until_done` the robot stays in service after its mission, for ground stations.
        Anyone who disarms, holds or takes over the robot meanwhile keeps it.
        """
        clock, limit = self._clock, TimeLimit(self._options.max_seconds)
        begin_ns, real_begin_ns = clock.now_ns(), time.monotonic_ns()
        while True:
            self._listen()
            progress = self.progress
            self._note_page(progress)
            self._note_silence(progress)
            progress.elapsed_s = now_s = (progress.now_ns - begin_ns) / 1e9
            real_ns = time.monotonic_ns() - real_begin_ns
            progress.real_time_factor = 1e9 * now_s / real_ns if real_ns else 1.0
            late_ns = 0 if progress.truth is None else progress.truth.late_max_ns
            progress.lines += self._held_up.step(progress.control, late_ns)
            self._ended = self._end(limit, until_done=until_done)
            if self._ended:
                progress.lines.append(self._ended)
            yield progress
            if self._ended:
                self._faults += not_begun(self._scenario, self._faults)
                return
            if not self._control_began_anew:
                self._ask(progress)
            if self._stack is not None:
                try:
                    progress.lines += self._stack.watch()
                finally:
                    if self._exit_log is not None:
                        progress.lines += self._exit_log.note(self._stack.exits)
            if self._firmware is not None and self._firmware.poll() is not None:
                ended = f"firmware_sim ended (status {self._firmware.returncode})"
                if self._stack is not None:
                    self._stack.tell(ended, Severity.CRITICAL)
                raise SimulatorError(ended)
            time.sleep(_POLL_S)

    def _note_page(self, progress: RunStatus) -> None:
        """Note where the web page is, once its process has said so."""
        if not self.config.web.enabled or progress.page:
            return
        if (links := read_links(self._endpoints.web_links)) is not None:
            progress.page = links.drive
            progress.lines += [f"web page: {each}" for each in (links.address, *links.remarks)]

    def _note_silence(self, progress: RunStatus) -> None:
        """Note what is silent, and say so where nobody else does."""
        progress.now_ns = self._clock.now_ns()
        phase = ProcessPhase.IDLE if self._stack is None else self._stack.phase(CONTROL)
        progress.control_phase = "" if phase is ProcessPhase.READY else phase.value
        if progress.truth is None or self._firmware is None:
            return
        # Simulated time stands still with the simulator at first.
        silent_s = time.monotonic() - self._truth_s
        if silent_s > _SILENT_S and not self._firmware_silent:
            why = state_of(self._firmware.pid)
            if why.startswith("stopped") or silent_s > _HELD_S:
                self._firmware_silent = True
                progress.lines.append(
                    f"firmware_sim is held up: silent for {silent_s:.1f} s ({why})"
                )
        elif silent_s <= _SILENT_S and self._firmware_silent:
            self._firmware_silent = False
            progress.lines.append("firmware_sim goes on")

    def _end(self, limit: TimeLimit, *, until_done: bool) -> str:
        """Return why the run ends now; empty if it goes on."""
        control, navigation, stack = self.progress.control, self.progress.navigation, self._stack
        if self._stopped():
            return "stopped by the user"
        if stack is not None and stack.shut_down:
            return "a ground station shut the robot down"
        if until_done and self._control_began_anew:
            return "the control process was restarted, so the robot may stand elsewhere"
        if until_done and control is not None and self._is_over:
            return run_message(control, navigation) or "the mission is over"
        is_ready = stack is not None and stack.ready
        return limit.step(control, self._clock.now_ns(), is_ready=is_ready)

    @property
    def _is_over(self) -> bool:
        control = self.progress.control
        if self._attended and control is not None and control.state is SafetyState.EMERGENCY_STOP:
            return False
        return is_over(control, self.progress.navigation)

    @property
    def _control_began_anew(self) -> bool:
        """Whether the control process was lost: the robot may stand elsewhere than it believes."""
        return self._stack is not None and self._stack.starts(CONTROL) > 1

    def emergency_stop(self) -> None:
        """Stop the robot at once; it stays stopped until a ground station arms it."""
        if self._stack is not None:
            self._stack.emergency_stop()

    def emergency_key(self) -> None:
        """Stop the robot at once from the keyboard: the run continues, to be armed again."""
        self._attended = True
        self.emergency_stop()

    def arm(self, *, arm: bool) -> None:
        """Ask to arm or disarm, as an operator."""
        self._to_control.send(self._operator.arm(self._clock.now_ns(), arm=arm))

    def set_mode(self, mode: Mode) -> None:
        """Ask for a mode, as an operator."""
        self._to_navigation.send(self._operator.set_mode(self._clock.now_ns(), mode))

    def _ask(self, progress: RunStatus) -> None:
        """Request the next of arming and mode AUTO."""
        waits = progress.control is not None and progress.navigation is None
        if waits and progress.elapsed_s > _SAY_S and not self._said_waiting:
            self._said_waiting = True
            progress.lines.append("waiting for navigation, which prepares its estimators")
        now_ns = self._clock.now_ns()
        if arm := self._operator.arming(now_ns):
            self._to_control.send(arm)
        if mode := self._operator.mode(now_ns):
            self._to_navigation.send(mode)

    def _listen(self) -> None:
        """Take published messages."""
        progress = self.progress
        self._listen_to_firmware()
        for truth in self._truths.receive():
            progress.truth = truth
            self._truth_s = time.monotonic()
            pose = StampedPose(truth.stamp_ns, truth.x_m, truth.y_m, truth.theta_rad)
            self._score.truth(pose, truth.people)
        for message in self._states.receive():
            match message:
                case ControlState():
                    progress.control = message
                    progress.pose = self._score.control(message)
                    self._operator.hear(message)
                    self._was_ready |= message.state is not SafetyState.BOOT
                case LocalisationState():
                    progress.localisation = message
                    self._score.localisation(message)
                case LiveMap():
                    progress.map = message
                    self._score.map(message)
                case ParticleCloud() | PlanView():
                    progress.picture(message)
                case CameraView():
                    progress.view = message
                    self._score.view(message)
                case NavigationState():
                    progress.navigation = message
                    self._operator.hear(message)
                case Notice():
                    late_ns = self._clock.now_ns() - message.stamp_ns
                    late = f" ({late_ns / 1e9:.1f} s ago)" if late_ns > _LATE_NS else ""
                    progress.lines.append(message.text + late)

    def _listen_to_firmware(self) -> None:
        """Take readiness and begun faults."""
        while not self._said.empty():
            line = self._said.get() or ""
            self._is_ready |= line.startswith(_READY)
            if line.startswith(_FAULT):
                self._faults.append(line.removeprefix(_FAULT).rstrip())
                self.progress.lines.append(line.rstrip())

    def report(self) -> Report:
        """Return the score of the run so far; with a record, write truth and map beside it.

        Raises
        ------
        KeyboardInterrupt
            Where the run was stopped before the robot was ready.
        SimulatorError
            If a process never sent a message.
        """
        progress = self.progress
        control, navigation, truth = progress.control, progress.navigation, progress.truth
        was_there = self._was_ready and navigation is not None and truth is not None
        if self._stopped() and not was_there:
            raise KeyboardInterrupt
        if control is None or navigation is None or truth is None:
            missing = [
                name
                for name, part in (
                    ("control", control),
                    ("navigation", navigation),
                    ("firmware_sim", truth),
                )
                if part is None
            ]
            raise SimulatorError(f"no messages received from {', '.join(missing)}")
        log_trouble = ""
        if self._options.record is not None:
            try:
                self._score.save(self._options.record, self._run, self._stack_options.epoch_ns)
            except DiskError as error:
                log_trouble = str(error)
        return Report(
            robot=self.config.robot.name,
            world=self.world.stem,
            mission=self.mission.name,
            seed=self._options.seed,
            bus_kind=self._options.bus,
            mission_completed=navigation.mission_completed,
            message=run_message(control, navigation),
            ended=self._ended,
            items_done=navigation.item,
            items=navigation.items,
            duration_s=round(progress.elapsed_s, 3),
            distance_m=round(truth.distance_m, 3),
            collisions=truth.collisions,
            ran_into=truth.ran_into,
            unsafe_motions=truth.unsafe_motions,
            unsafe_reason=truth.unsafe_reason,
            **self._score.journey.report(),
            arrived=arrived(self.mission, navigation),
            plans=navigation.plans,
            recoveries=navigation.recoveries,
            pose_error=self._score.pose_error,
            loop=loop_report(control.loop),
            bus=bus_report(control.bus),
            real_time_factor=round(progress.real_time_factor, 4),
            held_up_ms=round(self._held_up.longest_ms, 1),
            silent=progress.silences,
            faults=tuple(self._faults),
            log_trouble=log_trouble,
            localisation=self._score.localisation_report,
            slam=self._score.slam_report,
            map_quality=self._score.map_quality,
            camera=self._score.camera_report,
        )
