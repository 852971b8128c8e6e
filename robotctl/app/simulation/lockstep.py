"""Lockstep: firmware, bus and controller in one process under one virtual clock.

The same seed gives the same run to the byte, as fast as the processor allows. The ticks of control
and navigation are those of the processes; what differs is the clock, and in `Operator` who asks for
something and where messages go.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from firmware_sim.faults.scenario import not_begun, play
from robotctl.app.compile_progress import compile_progress
from robotctl.app.localisation.load_estimators import load_estimators
from robotctl.app.processes.navigator import equip, load_mission, make_navigation
from robotctl.app.processes.robot import record_header
from robotctl.app.scoring.run_score import RunFacts, RunScore
from robotctl.app.scoring.score import (
    Report,
    StampedPose,
    is_over,
    run_message,
)
from robotctl.app.simulation.lockstep_camera import LockstepCamera
from robotctl.app.simulation.lockstep_stack import LockstepStack, make_simulation
from robotctl.app.simulation.operator import MissionOperator
from robotctl.app.simulation.room import load_furnished
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.app.simulation.simulator_files import load_faults, simulated_robot
from robotctl.app.simulation.time_limit import TimeLimit
from robotctl.config.options import StackOptions
from robotctl.core.navigation_tick import NavigationTick
from robotctl.core.operator import Operator
from robotctl.errors import DiskError
from robotctl.maps.map_fit import misfit
from robotctl.messages.control import (
    ControlRequest,
    ControlState,
    NavigationRequest,
    NavigationState,
)
from robotctl.messages.estimation import CameraView, LidarScan, LiveMap, LocalisationState
from robotctl.model.wall_map import WallMap
from robotctl.runtime.storage.log_folder import LogFolder

if TYPE_CHECKING:
    from robotctl.app.simulation.lockstep_logs import LockstepLogs
    from robotctl.logs.mcap.entries import Published


class LockstepRun:
    """One mission in lockstep.

    Parameters
    ----------
    options
        What to run; the bus is always the one in this process.

    Attributes
    ----------
    world
        File of the world.
    notices
        Notices before the start.
    """

    def __init__(self, options: SimOptions) -> None:
        self._options = options
        self._mission = load_mission(options.mission)
        self.world = options.find_world(self._mission)
        room = load_furnished(self.world, options, self._mission)
        start = options.start_of(self._mission).pose
        stack = StackOptions(
            instance="lockstep",
            robot=str(options.robot),
            overrides=options.settings(self.world),
            mission=str(options.mission),
            x_m=start.x_m,
            y_m=start.y_m,
            theta_rad=start.theta_rad,
            epoch_ns=0,
        )
        self.config = stack.load()
        self._stack_options = stack
        self._operator = MissionOperator()
        self._estimators = load_estimators(self.config, stack)
        adapter = make_navigation(self.config, stack)
        self._uses_lidar = equip(adapter.navigator, self.config, stack, self._estimators)
        self._tick = NavigationTick(adapter, self._estimators, Operator(self._ask, self._hear))
        self._camera = LockstepCamera.load(self.config)
        walls = WallMap(room.segments)
        self._score = RunScore.of(
            self.config,
            simulated_robot(options.robot, options.overrides),
            room,
            start,
            self._mission,
            is_recorded=options.record is not None,
        )
        self.notices = [] if self._estimators is None else self._estimators.take_notices()
        if said := misfit(self.config, options.robot, self.world, walls):
            self.notices.append(said)
        self._faults: list[str] = []
        self._scenario = load_faults(options)
        self._heard: list[Published] = []
        """Messages published since the last log entry."""
        self._scanned_ns: dict[int, int] = {}
        """Time of the last scan of each lidar, by its number [ns]."""
        self._localise_us = 0.0
        self._log_trouble = ""
        self._ended = ""
        """Why the run ended."""
        simulation = make_simulation(
            options.robot,
            room,
            options.seed,
            (start.x_m, start.y_m, start.theta_rad),
            options.overrides,
            options.people,
            options.manners,
        )
        self.stack = LockstepStack(self.config, stack, simulation, self._hear)
        play(self._scenario, simulation.faults, self._faults.append)

    def run(self, tell: Callable[[ControlState, NavigationState], None] | None = None) -> Report:
        """Drive until the mission is over or the time is up; `tell` is given all states."""
        begin_s = time.perf_counter()
        for control, navigation in self.steps():
            if tell is not None:
                tell(control, navigation)
        return self._report(time.perf_counter() - begin_s)

    def steps(self) -> Iterator[tuple[ControlState, NavigationState]]:
        """Drive as `run` does; yield the states after each step of the navigator."""
        stack, record = self.stack, self._options.record
        every = max(1, round(self._tick.period_ns / stack.period_ns))
        limit = TimeLimit(self._options.max_seconds)
        with nullcontext() if record is None else self._open_logs(record) as logs:
            requests: tuple[ControlRequest, ...] = ()
            while not self._ended:
                outputs = stack.tick(requests)
                requests = ()
                if logs is not None:
                    logs.tick(stack.clock.now_ns(), stack.control.inputs, outputs)
                if stack.ticks % every == 0:
                    control = stack.snapshot()
                    navigation, requests = self._navigate(control)
                    self._log(logs)
                    yield control, navigation
                    self._ended = self._end(control, navigation, limit)
                self._log(logs)
            self._faults += not_begun(self._scenario, self._faults)
            stack.control.robot.close()
            if self._estimators is not None:
                self._estimators.close()
            if logs is not None:
                self._save_score(logs)
        if logs is not None:
            self._log_trouble = logs.trouble or self._log_trouble

    def _end(self, control: ControlState, navigation: NavigationState, limit: TimeLimit) -> str:
        """Return why the run ends now; empty if it goes on."""
        if is_over(control, navigation):
            return run_message(control, navigation) or "the mission is over"
        return limit.step(control, self.stack.clock.now_ns(), is_ready=True)

    def _log(self, logs: LockstepLogs | None) -> None:
        """Log the messages published since the last call, and the newest picture."""
        if logs is not None:
            if self._heard:
                logs.states(self._heard, self.stack.clock.now_ns())
            if self._camera is not None:
                logs.picture(self._camera.frame)
        self._heard.clear()

    def _save_score(self, logs: LockstepLogs) -> None:
        """Write truth and map beside the logs."""
        try:
            self._score.save(logs.directory, logs.run)
        except DiskError as error:
            self._log_trouble = str(error)

    def _open_logs(self, directory: Path) -> LockstepLogs:
        """Log into `directory`."""
        # A tenth of a second, which most runs need not wait for.
        from robotctl.app.simulation.lockstep_logs import LockstepLogs  # noqa: PLC0415

        return LockstepLogs(
            LogFolder(directory, self.config.log),
            self.stack.simulation.buses,
            record_header(self.config, self._stack_options),
            self.stack.core,
            self.config,
        )

    def _navigate(
        self, control: ControlState
    ) -> tuple[NavigationState, tuple[ControlRequest, ...]]:
        """Run the steps of the navigation process and the operator, 20 times a second."""
        now_ns, monitor, tick = control.stamp_ns, self.stack.simulation.monitor, self._tick
        for ack in control.acks:
            if not ack.accepted:
                monitor.on_refusal(ack.request_id)
        self._operator.hear(control)
        self._heard.append(control)
        seen = self._see(control)
        tick.receive(control, seen)
        begin_ns = time.perf_counter_ns()
        tick.localise(now_ns)
        self._localise_us = (time.perf_counter_ns() - begin_ns) / 1000
        command, navigation = tick.navigate(now_ns)
        tick.publish(now_ns, is_watched=self._options.record is not None)
        arm = self._operator.arming(now_ns)
        if arm is None:
            return navigation, (command,)
        monitor.on_arming(arm.request_id)
        return navigation, (command, arm)

    def _ask(self) -> list[NavigationRequest]:
        """Return the operator's request to navigation."""
        mode = self._operator.mode(self.stack.clock.now_ns())
        return [] if mode is None else [mode]

    def _hear(self, message: Published) -> None:
        """Take published messages."""
        self._heard.append(message)
        match message:
            case NavigationState():
                self._operator.hear(message)
            case LocalisationState():
                self._score.localisation(
                    msgspec.structs.replace(message, step_us=self._localise_us)
                )
            case LiveMap():
                self._score.map(message)

    def _see(self, control: ControlState) -> list[LidarScan | CameraView]:
        """Return views and scans since the last step."""
        now_ns, simulation = control.stamp_ns, self.stack.simulation
        pose = StampedPose(now_ns, *simulation.pose())
        self._score.truth(pose, simulation.people_m, simulation.plant.body_state)
        self._score.control(control)
        seen: list[LidarScan | CameraView] = []
        if self._camera is not None:
            for view in self._camera.step(simulation, control):
                self._score.view(view)
                seen.append(view)
        lidars = simulation.config.simulation.lidars if self._uses_lidar else ()
        for number, lidar in enumerate(lidars):
            if now_ns - self._scanned_ns.get(number, 0) >= 1e9 / lidar.rate_hz:
                self._scanned_ns[number] = now_ns
                scan = simulation.scan(number)
                seen += [] if scan is None else [LidarScan(**msgspec.structs.asdict(scan))]
        self._heard += seen
        return seen

    def _report(self, took_s: float) -> Report:
        """Return the score; only times of computation differ between two runs of one seed."""
        control, navigation = self.stack.snapshot(), self._tick.state
        truth = self.stack.simulation.truth()
        duration_s = self.stack.clock.now_ns() * 1e-9
        facts = RunFacts(
            robot=self.config.robot.name,
            world=self.world.stem,
            mission=self._mission,
            seed=self._options.seed,
            bus_kind="lockstep",
            ended=self._ended,
            duration_s=duration_s,
            real_time_factor=round(duration_s / took_s, 2),
            faults=tuple(self._faults),
            log_trouble=self._log_trouble,
        )
        return self._score.report(facts, control, navigation, truth, self.stack.statistics())


def run_lockstep(
    options: SimOptions,
    say: Callable[[str], None] = lambda _: None,
    tell: Callable[[ControlState, NavigationState], None] | None = None,
) -> Report:
    """Drive a mission in lockstep and score it.

    Parameters
    ----------
    options
        What to run.
    say
        Given what the user should know before.
    tell
        Given the states after each step of the navigator.

    Raises
    ------
    ConfigError, MissionError, SimulatorError
        If a file is wrong or robot, mission and world do not fit.
    """
    with compile_progress(say):
        run = LockstepRun(options)
        for notice in run.notices:
            say(notice)
        return run.run(tell)
