"""The score of a simulated run, collected while it lasts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from firmware_sim.config.config import RobotConfig as SimulatedRobot
from firmware_sim.world.truth import Truth as SimulatedTruth
from firmware_sim.world.world import World
from robotctl.app.scoring.camera_score import CameraScore, camera_score
from robotctl.app.scoring.journey_score import JourneyScore, journey_score
from robotctl.app.scoring.localisation_score import LocalisationScore
from robotctl.app.scoring.map_truth import MapTruth, map_truth
from robotctl.app.scoring.score import (
    PoseError,
    PoseScore,
    Report,
    StampedPose,
    Truth,
    arrived,
    bus_report,
    loop_report,
    run_message,
)
from robotctl.config.robot_file import RobotConfig
from robotctl.errors import DiskError
from robotctl.logs.formats.tum import write_tum
from robotctl.maps.map_file import save_map
from robotctl.messages.control import ControlState, LoopStatistics, NavigationState
from robotctl.messages.estimation import CameraView, LiveMap, LocalisationState
from robotctl.messages.map_message import grid_of
from robotctl.messages.world_pose import WorldPose
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.trajectory import Trajectory
from robotctl.planning.behave.mission.mission_file import Mission


@dataclass(frozen=True, slots=True)
class RunFacts:
    """Facts of a run that no message has; `Report` says what the fields are."""

    robot: str
    world: str
    mission: Mission
    seed: int
    bus_kind: str
    ended: str
    duration_s: float
    real_time_factor: float
    faults: tuple[str, ...]
    log_trouble: str
    held_up_ms: float = 0.0
    silent: tuple[str, ...] = ()


class RunScore:
    """Compares where the robot believes to be, and its map, with the truth.

    Parameters
    ----------
    map_truth
        What a map is compared with.
    journey
        Score of its way through the world.
    camera
        Score of the camera; None without one.
    has_localiser
        Whether the robot has one.
    is_recorded
        Whether `save` is to come, for which all true poses are kept.
    """

    def __init__(
        self,
        map_truth: MapTruth,
        journey: JourneyScore,
        camera: CameraScore | None = None,
        *,
        has_localiser: bool,
        is_recorded: bool,
    ) -> None:
        self._map_truth = map_truth
        self._camera = camera
        self.journey = journey
        self._pose = PoseScore()
        self._localisation = LocalisationScore()
        self._has_localiser = has_localiser
        self._world = WorldPose(has_localiser=has_localiser)
        self._control: ControlState | None = None
        self._map: GridMap | None = None
        self._truths: list[StampedPose] | None = [] if is_recorded else None

    @classmethod
    def of(
        cls,
        robot: RobotConfig,
        simulated: SimulatedRobot,
        room: World,
        start: SE2,
        mission: Mission,
        *,
        is_recorded: bool,
    ) -> RunScore:
        """Return the score of a robot that starts in a room, as it is and as it is simulated."""
        return cls(
            map_truth(simulated, room, start, robot),
            journey_score(simulated, room, start, mission, robot),
            camera_score(robot, simulated, room),
            has_localiser=robot.localisation.method != "none",
            is_recorded=is_recorded,
        )

    def truth(
        self, pose: StampedPose, people_m: Sequence[tuple[float, float]] = (), body: int = 0
    ) -> None:
        """Take a true pose, where people are then (x, y), and the state of the body."""
        if self._truths is not None:
            self._truths.append(pose)
        self._pose.truth(pose)
        self.journey.truth(pose, people_m, body)
        if self._has_localiser:
            self._localisation.truth(pose)
        if self._camera is not None:
            self._camera.truth(pose)

    def control(self, control: ControlState) -> SE2 | None:
        """Take a state of the control process; return its pose in `world`, if known."""
        self._control = control
        pose = self._world.pose(control)
        if pose is not None:
            self._pose.estimate(_stamped(control.stamp_ns, pose))
        return pose

    def localisation(self, state: LocalisationState) -> None:
        """Take an estimate of the localiser."""
        self._world.localise(state)
        control = self._control
        if control is not None and control.odom_epoch_ns == state.odom_epoch_ns:
            odometry = control.T_odom_base
            self._localisation.estimate(  # right or wrong, whatever its status
                _stamped(control.stamp_ns, state.T_world_odom @ odometry),
                state,
                _stamped(control.stamp_ns, odometry),
            )

    def view(self, view: CameraView) -> None:
        """Take a view of the camera."""
        if self._camera is not None:
            self._camera.view(view)

    def map(self, message: LiveMap) -> None:
        """Take the present map."""
        self._map = grid_of(message)

    @property
    def pose_error(self) -> PoseError:
        """Error of the pose that the robot uses."""
        return self._pose.result()

    def report(
        self,
        run: RunFacts,
        control: ControlState,
        navigation: NavigationState | None,
        truth: Truth | SimulatedTruth,
        loop: LoopStatistics,
    ) -> Report:
        """Return the report of a run, after its last messages."""
        completed = navigation is not None and navigation.mission_completed
        return Report(
            robot=run.robot,
            world=run.world,
            mission=run.mission.name,
            seed=run.seed,
            bus_kind=run.bus_kind,
            mission_completed=completed,
            message=run_message(control, navigation),
            ended=run.ended,
            items_done=navigation.item if navigation else 0,
            items=navigation.items if navigation else 0,
            duration_s=round(run.duration_s, 3),
            distance_m=round(truth.distance_m, 3),
            collisions=truth.collisions,
            ran_into=truth.ran_into,
            unsafe_motions=truth.unsafe_motions,
            unsafe_reason=truth.unsafe_reason,
            **self.journey.report(completed=completed),
            arrived=arrived(run.mission, navigation),
            plans=navigation.plans if navigation else 0,
            recoveries=navigation.recoveries if navigation else 0,
            pose_error=self.pose_error,
            loop=loop_report(loop),
            bus=bus_report(control.bus),
            real_time_factor=run.real_time_factor,
            held_up_ms=run.held_up_ms,
            silent=run.silent,
            faults=run.faults,
            log_trouble=run.log_trouble,
            localisation=self._localisation.result(),
            slam=self._localisation.slam(),
            map_quality=None if self._map is None else self._map_truth.quality(self._map),
            camera=None if self._camera is None else self._camera.result(),
        )

    def save(self, folder: Path, run: int, epoch_ns: int = 0) -> None:
        """Write the true path of a run, and its map, if there is one.

        Parameters
        ----------
        folder
            Where its logs are.
        run
            Result of `LogFolder.begin_run`: `truth-0001.tum`, `map-0001.yaml`.
        epoch_ns
            Added to the times of the poses to get those of the logs [ns].

        Raises
        ------
        DiskError
            If the disk refuses.
        """
        truths, grid = self._truths, self._map
        if truths:
            stamps = np.array([pose.stamp_ns + epoch_ns for pose in truths])
            poses = np.array([pose[1:] for pose in truths])
            way = Trajectory(stamps, poses)
            _write(folder / f"truth-{run:04d}.tum", lambda path: write_tum(path, way))
        if grid is not None:
            _write(folder / f"map-{run:04d}", lambda path: save_map(path, grid))


def _write(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file; raises DiskError if that is refused."""
    try:
        write(path)
    except OSError as error:
        raise DiskError(f"{path}: cannot be written: {error.strerror}") from error


def _stamped(stamp_ns: int, pose: SE2) -> StampedPose:
    return StampedPose(stamp_ns, pose.x_m, pose.y_m, pose.theta_rad)
