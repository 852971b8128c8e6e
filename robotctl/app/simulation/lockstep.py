"""Lockstep: firmware, bus and controller in one process under one virtual clock.

The same seed gives the same run to the byte, as fast as the processor allows. Nothing here
differs from the real processes but the clock and the way frames and messages travel.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from firmware_sim.errors import SimulationError
from firmware_sim.faults.scenario import not_begun, play
from firmware_sim.world.world import World
from robotctl.app.localisation.load_estimators import load_estimators
from robotctl.app.processes.pilot import Pilot, load_mission
from robotctl.app.processes.robot import make_codec, make_core, node_parameters, record_header
from robotctl.app.simulation.camera_score import camera_score
from robotctl.app.simulation.lockstep_camera import LockstepCamera
from robotctl.app.simulation.lockstep_logs import LockstepLogs
from robotctl.app.simulation.room import load_room
from robotctl.app.simulation.run_score import RunScore
from robotctl.app.simulation.score import (
    Report,
    StampedPose,
    bus_report,
    is_over,
    loop_report,
    run_message,
)
from robotctl.app.simulation.sim_options import (
    SimOptions,
    SimulatorError,
    load_faults,
    simulated_robot,
)
from robotctl.app.supervision.compile_progress import compile_progress
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig
from robotctl.core.control_core import ControlCore, Inputs, Outputs
from robotctl.drivers.can.memory_port import MemoryPort
from robotctl.drivers.can.nodes.robot_can import CanRobot
from robotctl.errors import DiskError
from robotctl.logs.mcap.entries import Published
from robotctl.maps.map_fit import misfit
from robotctl.messages.control import (
    Arm,
    ControlRequest,
    ControlState,
    LoopStatistics,
    Mode,
    NavigationState,
    SafetyState,
    SetMode,
    WheelCommand,
)
from robotctl.messages.estimation import CameraView, LidarScan, LiveMap, LocalisationState
from robotctl.model.wall_map import WallMap
from robotctl.runtime.clock import VirtualClock
from robotctl.runtime.histogram import Histogram
from robotctl.runtime.storage.log_folder import LogFolder
from robotctl.safety.state_machine import POWERED

if TYPE_CHECKING:
    from firmware_sim.simulation import Simulation

_ARM_RETRY_NS = 1_000_000_000
_NO_FIGURES = LoopStatistics()


class Bench:
    """A simulated robot with its controller on one virtual clock, moved tick by tick.

    Parameters
    ----------
    config, options
        The robot and its start pose.
    simulation
        The other end of the wire.
    """

    def __init__(self, config: RobotConfig, options: StackOptions, simulation: Simulation) -> None:
        self.clock = VirtualClock(simulation.now_ns)
        self.simulation = simulation
        self.period_ns = config.runtime.period_ns
        self.step_ns = Histogram()
        codec = make_codec()
        wire = simulation.bus.attach(
            "host",
            lambda frame: port.deliver(*frame),
            accept=codec.arbitration_ids,
            errors=True,
        )
        port = MemoryPort(wire.send, codec.arbitration_ids, config.can.bitrate, self.clock)
        self.robot = CanRobot(port, codec, node_parameters(config))
        self.core: ControlCore = make_core(config, options)
        self.inputs = Inputs(self.robot.receive(self.clock.now_ns()))
        self.ticks = 0

    def tick(self, requests: tuple[ControlRequest, ...] = ()) -> Outputs:
        """Let one period pass, then do what the control process does in a tick."""
        now_ns = self._advance()
        begin_ns = time.perf_counter_ns()
        self.inputs = Inputs(self.robot.receive(now_ns), requests)
        outputs = self.core.step(self.inputs, now_ns)
        if outputs.emergency_stop is not None:
            self.robot.emergency_stop(outputs.emergency_stop)
        if outputs.clear_faults:
            self.robot.clear_faults()
        self.robot.send(outputs.command, now_ns)
        self.step_ns.add((time.perf_counter_ns() - begin_ns) // 100)
        return outputs

    def open_loop_tick(self, law: Callable[[Inputs], WheelCommand]) -> Inputs:
        """Let one period pass and send what `law` makes of it past the core, for identification."""
        now_ns = self._advance()
        self.inputs = Inputs(self.robot.receive(now_ns))
        self.robot.send(law(self.inputs), now_ns)
        return self.inputs

    def _advance(self) -> int:
        """Move firmware and clock by one period."""
        self.ticks += 1
        now_ns = self.clock.now_ns() + self.period_ns
        self.simulation.advance(now_ns)
        self.clock.sleep_until(now_ns)
        return now_ns

    def snapshot(self) -> ControlState:
        """Return the control core's state now, without the loop's figures (see `statistics`)."""
        return self.core.snapshot(self.clock.now_ns(), _NO_FIGURES)

    def statistics(self) -> LoopStatistics:
        """Return the loop's figures: no lag under a virtual clock, but real times of the step."""
        p50, p99 = self.step_ns.percentiles(0.5, 0.99)
        return LoopStatistics(
            rate_hz=1e9 / self.period_ns,
            ticks=self.ticks,
            step_us_p50=p50 / 10,
            step_us_p99=p99 / 10,
        )


def make_simulation(
    robot: Path,
    world: Path | World,
    seed: int,
    start: tuple[float, float, float],
    overrides: Sequence[str] = (),
) -> Simulation:
    """Return the simulated robot in its world, compiled and ready.

    Raises
    ------
    SimulatorError
        If a file is wrong or the robot cannot stand at `start` (x [m], y [m], heading [rad]).
    """
    simulated = simulated_robot(robot, overrides)
    try:
        # It loads numba, for which those who only type `robotctl --help` need not wait.
        from firmware_sim.simulation import Simulation  # noqa: PLC0415

        simulation = Simulation(simulated, world, seed, start)
    except SimulationError as error:
        raise SimulatorError(str(error)) from error
    simulation.warm()
    return simulation


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
        What is to be said before it begins.
    """

    def __init__(self, options: SimOptions) -> None:
        self._options = options
        self._mission = load_mission(options.mission)
        self.world = options.find_world(self._mission)
        room = load_room(self.world)
        start = self._mission.start.pose
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
        self._stack = stack
        self._pilot = Pilot(self.config, stack)
        self._estimators = load_estimators(self.config, stack)
        if self._estimators is not None and self._estimators.world_map is not None:
            self._pilot.learn_map(self._estimators.world_map)
        self._camera = LockstepCamera.load(self.config)
        walls = WallMap(room.segments)
        seen = camera_score(self.config, options, room)
        self._score = RunScore(
            walls,
            seen,
            has_localiser=self.config.localisation.method != "none",
            is_recorded=options.record is not None,
        )
        self.notices = [] if self._estimators is None else self._estimators.take_notices()
        if said := misfit(self.config, options.robot, self.world, walls):
            self.notices.append(said)
        self._faults: list[str] = []
        self._scenario = load_faults(options)
        self._navigation: NavigationState | None = None
        self._localisation: LocalisationState | None = None
        self._asked_ns = -_ARM_RETRY_NS
        self._scanned_ns = 0
        self._request_id = 0
        self._log_trouble = ""
        simulation = make_simulation(
            options.robot,
            room,
            options.seed,
            (start.x_m, start.y_m, start.theta_rad),
            options.overrides,
        )
        self.bench = Bench(self.config, stack, simulation)
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
        bench, record = self.bench, self._options.record
        every = max(1, round(self._pilot.period_ns / bench.period_ns))
        end_ns = round(self._options.max_seconds * 1e9)
        with nullcontext() if record is None else self._open_logs(record) as logs:
            requests: tuple[ControlRequest, ...] = ()
            while bench.clock.now_ns() < end_ns:
                outputs = bench.tick(requests)
                if logs is not None:
                    logs.tick(bench.clock.now_ns(), bench.inputs, outputs)
                requests = ()
                if bench.ticks % every == 0:
                    control = bench.snapshot()
                    seen = self._see(control)
                    views = [each for each in seen if isinstance(each, CameraView)]
                    navigation, requests = self._navigate(control, views)
                    if logs is not None:
                        logs.states((control, *seen, navigation), control.stamp_ns)
                    yield control, navigation
                    if is_over(control, navigation):
                        break
            self._faults += not_begun(self._scenario, self._faults)
            bench.robot.close()
            if logs is not None:
                self._save_score(logs)
        if logs is not None:
            self._log_trouble = logs.trouble or self._log_trouble

    def _save_score(self, logs: LockstepLogs) -> None:
        """Write truth and map beside the logs."""
        try:
            self._score.save(logs.directory, logs.run)
        except DiskError as error:
            self._log_trouble = str(error)

    def _open_logs(self, directory: Path) -> LockstepLogs:
        """Log into `directory`."""
        return LockstepLogs(
            LogFolder(directory, self.config.log),
            self.bench.simulation.bus,
            record_header(self.config, self._stack),
            self.bench.core,
            self.config,
        )

    def _see(self, control: ControlState) -> list[Published]:
        """Let the estimators work, and score them; return what they saw and believe."""
        now_ns, simulation = control.stamp_ns, self.bench.simulation
        self._score.truth(StampedPose(now_ns, *simulation.pose()))
        self._score.control(control)
        scans: list[LidarScan | CameraView] = []
        if self._camera is not None:
            for view in self._camera.step(simulation, control):
                self._score.view(view)
                scans.append(view)
        if self._estimators is None:
            return [*scans]
        lidar = simulation.config.simulation.lidar
        if lidar is not None and now_ns - self._scanned_ns >= 1e9 / lidar.rate_hz:
            self._scanned_ns = now_ns
            scan = simulation.scan()
            scans += [] if scan is None else [LidarScan(**msgspec.structs.asdict(scan))]
        seen: list[Published] = [*scans]
        begin_ns = time.perf_counter_ns()
        state = self._estimators.step(control, scans, (), now_ns)
        if state is not None:
            step_us = (time.perf_counter_ns() - begin_ns) / 1000
            self._localisation = msgspec.structs.replace(state, step_us=step_us)
            self._score.localisation(self._localisation)
            seen.append(state)
        seen += self._estimators.given_map(now_ns)
        for picture in self._estimators.pictures(now_ns):
            seen.append(picture)
            if isinstance(picture, LiveMap):
                self._score.map(picture)
        return seen

    def _navigate(
        self, control: ControlState, views: Sequence[CameraView]
    ) -> tuple[NavigationState, tuple[ControlRequest, ...]]:
        """Do what the navigation process and the operator do, 20 times a second."""
        now_ns, monitor = control.stamp_ns, self.bench.simulation.monitor
        for ack in control.acks:
            if not ack.accepted:
                monitor.on_refusal(ack.request_id)
        wishes: tuple[SetMode, ...] = ()
        if (
            control.state in POWERED
            and self._navigation is not None
            and self._navigation.mode == Mode.HOLD
        ):
            wishes = (SetMode(now_ns, Mode.AUTO),)
        command, self._navigation = self._pilot.step(
            control, self._localisation, wishes, now_ns, views
        )
        if control.state == SafetyState.STANDBY and now_ns - self._asked_ns >= _ARM_RETRY_NS:
            self._asked_ns = now_ns
            self._request_id += 1
            monitor.on_arming(self._request_id)
            return self._navigation, (Arm(now_ns, self._request_id, arm=True),)
        return self._navigation, (command,)

    def _report(self, took_s: float) -> Report:
        """Return the score; only times of computation differ between two runs of one seed."""
        control, navigation = self.bench.snapshot(), self._navigation
        truth = self.bench.simulation.truth()
        duration_s = self.bench.clock.now_ns() * 1e-9
        return Report(
            robot=self.config.robot.name,
            world=self.world.stem,
            mission=self._mission.name,
            seed=self._options.seed,
            bus_kind="lockstep",
            mission_completed=navigation is not None and navigation.mission_completed,
            message=run_message(control, navigation),
            items_done=navigation.item if navigation else 0,
            items=navigation.items if navigation else 0,
            duration_s=round(duration_s, 3),
            distance_m=round(truth.distance_m, 3),
            collisions=truth.collisions,
            unsafe_motions=truth.unsafe_motions,
            unsafe_reason=truth.unsafe_reason,
            pose_error=self._score.pose_error,
            loop=loop_report(self.bench.statistics()),
            bus=bus_report(control.bus),
            real_time_factor=round(duration_s / took_s, 2),
            faults=tuple(self._faults),
            log_trouble=self._log_trouble,
            localisation=self._score.localisation_report,
            map_quality=self._score.map_quality,
            camera=self._score.camera_report,
        )


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
