"""A simulated run: firmware_sim and the whole stack as processes, one mission, one score."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

from firmware_sim.faults.scenario import not_begun
from robotctl.app.processes.navigator import load_mission
from robotctl.app.scoring.run_score import RunFacts, RunScore
from robotctl.app.scoring.score import (
    Report,
    StampedPose,
    is_over,
    run_message,
)
from robotctl.app.simulation.held_up import HeldUp
from robotctl.app.simulation.operator import MissionOperator
from robotctl.app.simulation.room import load_furnished
from robotctl.app.simulation.run_links import Heard, RunLinks
from robotctl.app.simulation.run_status import BEST_EFFORT, PATIENCE, RunStatus
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.app.simulation.simulator import Simulator, log_arguments, simulator_arguments
from robotctl.app.simulation.simulator_files import (
    SimulatorError,
    bus_overrides,
    load_faults,
    simulated_robot,
)
from robotctl.app.simulation.time_limit import TimeLimit
from robotctl.app.supervision.exit_log import ExitLog
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
from robotctl.model.sensors.lidar import SOCKET
from robotctl.model.wall_map import WallMap
from robotctl.planning.behave.mission.mission_file import Mission
from robotctl.runtime.clock import RealClock
from robotctl.runtime.storage.log_folder import LogFolder
from robotctl.web.links import read_links

_POLL_S = 0.05
_SAY_S = 5.0
_LATE_NS = 1_000_000_000
"""A notice that was said longer ago is shown with its age [ns]."""


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
        overrides, self.config = _settings(options, self.world)
        room = load_furnished(self.world, options, self.mission)
        self.walls = WallMap(room.segments)
        unfit = misfit(self.config, options.robot.resolve(), self.world, self.walls)
        self._scenario = load_faults(options)
        self._score = RunScore.of(
            self.config,
            simulated_robot(options.robot, options.overrides),
            room,
            options.start_of(self.mission).pose,
            self.mission,
            is_recorded=options.record is not None,
        )
        self._links = RunLinks()
        self._stack_options = _stack_options(options, self.mission, overrides, self._links)
        self._run = 0
        self._clock: Clock = RealClock()
        self._held_up = HeldUp(self._clock)
        self._simulator: Simulator | None = None
        self._faults: list[str] = []
        self._stack: Stack | None = None
        self._exit_log: ExitLog | None = None
        self._operator = MissionOperator()
        self._attended = self.config.web.enabled
        """Whether a robot that was stopped may be armed again: from the page, or the keyboard that
        stopped it."""
        camera = self.config.camera
        self.progress = RunStatus(
            lines=[unfit] if unfit else [],
            navigation_period_ns=round(1e9 / self.config.navigation.rate_hz),
            camera_period_ns=round(2e9 / camera.rate_hz) if camera is not None else 0,
        )

    def __enter__(self) -> SimRun:
        """Start firmware_sim, then the stack.

        Raises
        ------
        KeyboardInterrupt
            Where the run was stopped meanwhile.
        """
        try:
            self._start_simulator()
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
        if self._simulator is not None:
            self._simulator.close()
            self._simulator = None
        self._links.close()

    def _start_simulator(self) -> None:
        """Start firmware_sim and wait for its nodes."""
        options, stack = self._options, self._stack_options
        arguments = simulator_arguments(
            options, self.mission, stack, self.config, self._links.endpoints
        )
        if options.record is not None:
            folder = LogFolder(options.record, self.config.log)
            self._exit_log = ExitLog(options.record)
            self._run = folder.begin_run()
            arguments += log_arguments(folder, self.config, stack)
        self._simulator = Simulator(arguments, self._faults, self.progress.lines.append)
        self._simulator.await_ready(self._stopped)

    @property
    def connections(self) -> tuple[str, ...]:
        """Addresses at which ground stations and CAN tools can connect."""
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
            progress.ended = self._end(limit, until_done=until_done)
            if progress.ended:
                progress.lines.append(progress.ended)
            yield progress
            if progress.ended:
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
            if self._simulator is not None and (ended := self._simulator.end):
                if self._stack is not None:
                    self._stack.tell(ended, Severity.CRITICAL)
                raise SimulatorError(ended)
            time.sleep(_POLL_S)

    def _note_page(self, progress: RunStatus) -> None:
        """Note where the web page is, once its process has said so."""
        if not self.config.web.enabled or progress.page:
            return
        if (links := read_links(self._links.endpoints.web_links)) is not None:
            progress.page = links.drive
            progress.lines += [f"web page: {each}" for each in (links.address, *links.remarks)]

    def _note_silence(self, progress: RunStatus) -> None:
        """Note what is silent, and report it unless another process does."""
        progress.now_ns = self._clock.now_ns()
        phase = ProcessPhase.IDLE if self._stack is None else self._stack.phase(CONTROL)
        progress.control_phase = "" if phase is ProcessPhase.READY else phase.value
        if self._simulator is not None:
            self._simulator.note_silence()

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
        self._links.to_control.send(self._operator.arm(self._clock.now_ns(), arm=arm))

    def set_mode(self, mode: Mode) -> None:
        """Ask for a mode, as an operator."""
        self._links.to_navigation.send(self._operator.set_mode(self._clock.now_ns(), mode))

    def _ask(self, progress: RunStatus) -> None:
        """Request the next of arming and mode AUTO."""
        waits = progress.control is not None and progress.navigation is None
        if waits and progress.elapsed_s > _SAY_S and not progress.said_waiting:
            progress.said_waiting = True
            progress.lines.append("waiting for navigation, which prepares its estimators")
        now_ns = self._clock.now_ns()
        if arm := self._operator.arming(now_ns):
            self._links.to_control.send(arm)
        if mode := self._operator.mode(now_ns):
            self._links.to_navigation.send(mode)

    def _listen(self) -> None:
        """Take published messages."""
        if self._simulator is not None:
            self._simulator.listen()
        for truth in self._links.truths.receive():
            self.progress.truth = truth
            if self._simulator is not None:
                self._simulator.hear_truth()
            pose = StampedPose(truth.stamp_ns, truth.x_m, truth.y_m, truth.theta_rad)
            self._score.truth(pose, truth.people, truth.body)
        for message in self._links.states.receive():
            self._hear(message)

    def _hear(self, message: Heard) -> None:
        """Take a message of the robot."""
        progress = self.progress
        match message:
            case ControlState():
                progress.control = message
                progress.pose = self._score.control(message)
                self._operator.hear(message)
                progress.was_ready |= message.state is not SafetyState.BOOT
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
        was_there = progress.was_ready and navigation is not None and truth is not None
        if self._stopped() and not was_there:
            raise KeyboardInterrupt
        if control is None or navigation is None or truth is None:
            parts = {"control": control, "navigation": navigation, "firmware_sim": truth}
            missing = [name for name, part in parts.items() if part is None]
            raise SimulatorError(f"no messages received from {', '.join(missing)}")
        log_trouble = ""
        if self._options.record is not None:
            try:
                self._score.save(self._options.record, self._run, self._stack_options.epoch_ns)
            except DiskError as error:
                log_trouble = str(error)
        facts = RunFacts(
            robot=self.config.robot.name,
            world=self.world.stem,
            mission=self.mission,
            seed=self._options.seed,
            bus_kind=self._options.bus,
            ended=progress.ended,
            duration_s=progress.elapsed_s,
            real_time_factor=round(progress.real_time_factor, 4),
            held_up_ms=round(self._held_up.longest_ms, 1),
            silent=progress.silences,
            faults=tuple(self._faults),
            log_trouble=log_trouble,
        )
        return self._score.report(facts, control, navigation, truth, control.loop)


def _settings(options: SimOptions, world: Path) -> tuple[tuple[str, ...], RobotConfig]:
    """Return the settings of the robot of a run, and its configuration by them."""
    robot = options.robot.resolve()
    overrides = (PATIENCE, BEST_EFFORT, *options.settings(world), *bus_overrides(options))
    config: RobotConfig = load_robot(robot, overrides)
    if config.lidar is None:
        return overrides, config
    several = isinstance(config.lidar, tuple)
    tables = [f"lidar.{number}" for number in range(len(config.lidars))] if several else ["lidar"]
    # The simulator publishes the scans.
    overrides += tuple(f'{table}.driver="{SOCKET}"' for table in tables)
    return overrides, load_robot(robot, overrides)


def _stack_options(
    options: SimOptions, mission: Mission, overrides: tuple[str, ...], links: RunLinks
) -> StackOptions:
    """Return how to start the processes of a run."""
    start = options.start_of(mission)
    record = str(options.record.resolve()) if options.record else ""
    return StackOptions(
        instance=links.instance,
        robot=str(options.robot.resolve()),
        overrides=overrides,
        mission=str(options.mission.resolve()),
        x_m=start.x_m,
        y_m=start.y_m,
        theta_rad=start.pose.theta_rad,
        record=record,
        flights=record,
        state=str(links.folder),
        clock="" if options.hard_real_time else str(links.clock_file),
        run=uuid.uuid4().hex,
    )
