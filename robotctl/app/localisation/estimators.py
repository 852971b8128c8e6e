"""The estimating half of navigation: a place in the world and a map, from sensors and odometry."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Final, TypeAlias, TypeVar

import msgspec
import numpy as np

from robotctl.app.localisation.localiser import (
    LocaliserBegin,
    LocaliserInput,
    MadeLocaliser,
    sensed_robot,
)
from robotctl.app.localisation.mapper import Mapper
from robotctl.config.robot_file import RobotConfig
from robotctl.config_values import Value, tuned
from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.estimation.localisers import LOCALISERS
from robotctl.estimation.odometry.odometry_history import OdometryHistory
from robotctl.estimation.ranging.unwinding import unwound
from robotctl.estimation.sensors.registry import load_sensors
from robotctl.estimation.sensors.sensor import Listener, Measured, SensedRobot
from robotctl.maps.localisation_map import off_map
from robotctl.messages.control import ControlState, ExternalPose
from robotctl.messages.estimation import (
    CameraView,
    GivenMap,
    LiveMap,
    LocalisationState,
    ParticleCloud,
    SensorMessage,
    SlamGraph,
)
from robotctl.messages.map_message import map_message
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.sensors.range_scan import RangeScan

Picture: TypeAlias = ParticleCloud | LiveMap | SlamGraph
Stamped = TypeVar("Stamped", bound=SensorMessage | ExternalPose)

_PICTURE_NS: Final = 500_000_000
"""Period of data for display [ns]."""
_GIVEN_NS: Final = 10_000_000_000
"""Period of repeating the static map, for late subscribers [ns]."""
_JUMP_M: Final = 0.25
_JUMP_RAD: Final = 0.25
"""Jump of the estimate between two steps from which a new epoch begins [m], [rad]: corrections of
the drift are smaller. Logs and clients rely on it, so no file changes it."""
_SHOWN: Final = 300
"""Particles in a picture."""
_OLDEST_NS: Final = 2_000_000_000
"""Age beyond which a past pose of the robot is unknown [ns]."""

_WORDS: Final = {
    LocalisationStatus.SEARCHING: "the robot does not know where it is; it looks around",
    LocalisationStatus.LOCALISED: "the robot knows where it is",
    LocalisationStatus.LOST: "what the robot sees does not match its believed place",
}


class Estimators:
    """Localiser and growing map of one robot, either of which may be missing.

    Attributes
    ----------
    rejected
        Scans that were no scans.
    untimely
        Scans, views and poses from after now, or too old.

    Parameters
    ----------
    made
        The localiser and the map that grows, both of the same `history`.
    history
        History of the odometry.
    robot
        The robot as its sensors need to know it.
    """

    def __init__(
        self,
        made: MadeLocaliser,
        history: OdometryHistory,
        robot: SensedRobot,
    ) -> None:
        self.close = made.close
        self.localiser = made.localiser
        self.mapper = made.drawing
        self.rejected = 0
        self.untimely = 0
        self._history = history
        self._listeners = {name: each.listener(robot) for name, each in load_sensors().items()}
        self._state: LocalisationState | None = None
        self.world_map = None if made.world_map is None else made.world_map.grid
        """The map that the robot localises itself in, where there is one."""
        self._given = None if self.world_map is None else map_message(self.world_map, 0)
        self._given_ns = -_GIVEN_NS
        self._pictured_ns = 0
        self._status: LocalisationStatus | None = None
        self._odom_epoch_ns: int | None = None
        """Epoch of the odometry in the last control state."""
        self._said_rejected = False
        self._said_untimely = False
        self._notices = list(made.notices)
        self._settings = robot.settings
        self._is_paused = False
        self.retune({})

    def step(
        self,
        control: ControlState,
        seen: Sequence[SensorMessage],
        poses: Sequence[ExternalPose],
        now_ns: int,
    ) -> LocalisationState | None:
        """Take all inputs since the last step; return the localiser's estimate."""
        if control.odom_epoch_ns != self._odom_epoch_ns:
            self._odom_epoch_ns = control.odom_epoch_ns
            if self.localiser is not None:
                self.localiser.begin_odometry()
        self._history.add(control.stamp_ns, control.T_odom_base, control.odom_epoch_ns)
        messages = (control, *self._timely(seen, now_ns))
        measured = {name: self._good(each, messages) for name, each in self._listeners.items()}
        images = [each for each in messages if isinstance(each, CameraView) and each.features]
        inputs = LocaliserInput(measured, self._timely(poses, now_ns), images, self._is_paused)
        if self.localiser is not None:
            self._state = self._stamped(self.localiser.step(control, inputs, now_ns), control)
        if self.mapper is not None:
            self.mapper.step(self._state, inputs)
        return self._state

    def _stamped(self, state: LocalisationState, control: ControlState) -> LocalisationState:
        """Return a state with the epoch of its odometry, and its own."""
        before, odometry = self._state, control.T_odom_base
        epoch_ns = state.stamp_ns
        if before is not None and before.odom_epoch_ns == control.odom_epoch_ns:
            was, now = before.T_world_odom @ odometry, state.T_world_odom @ odometry
            moved_m = math.hypot(now.x_m - was.x_m, now.y_m - was.y_m)
            turned_rad = abs(wrap_angle(now.theta_rad - was.theta_rad))
            if moved_m <= _JUMP_M and turned_rad <= _JUMP_RAD:
                epoch_ns = before.epoch_ns
        return msgspec.structs.replace(
            state,
            odom_epoch_ns=control.odom_epoch_ns,
            epoch_ns=epoch_ns,
            paused=self._is_paused,
        )

    def retune(self, values: Mapping[str, Value]) -> None:
        """Pause mapping, or go on with it."""
        is_paused = tuned({"localisation": self._settings}, values)["localisation"].paused
        if is_paused != self._is_paused:
            self._is_paused = is_paused
            text = "paused: the map stays as it is" if is_paused else "goes on"
            self._notices.append(f"mapping {text}")

    def _timely(self, messages: Sequence[Stamped], now_ns: int) -> list[Stamped]:
        """Return messages of plausible time; drop and count the others, and report them once.

        A sender that stamps with another clock than CLOCK_MONOTONIC would move the robot into the
        future, where all timely messages count as late.
        """
        timely = [each for each in messages if 0 <= now_ns - each.stamp_ns <= _OLDEST_NS]
        self.untimely += len(messages) - len(timely)
        if len(timely) < len(messages) and not self._said_untimely:
            self._said_untimely = True
            wrong = next(each for each in messages if each not in timely)
            late_s = (now_ns - wrong.stamp_ns) / 1e9
            when = f"{late_s:.1f} s old" if late_s > 0.0 else f"{-late_s:.3f} s ahead of its time"
            self._notices.append(
                f"a {type(wrong).__name__} is {when} and is left out, as those like it will be: "
                "by which clock does its sender stamp?"
            )
        return timely

    def _good(
        self, listen: Listener[Measured], messages: Sequence[ControlState | SensorMessage]
    ) -> list[Measured]:
        """Return what a sensor measured; invalid messages are dropped and counted."""
        good: list[Measured] = []
        for message in messages:
            try:
                good += map(self._unwound, listen(message))
            except ValueError:
                self.rejected += 1
        return good

    def _unwound(self, measured: Measured) -> Measured:
        """Return a scan as from the place of its last beam; anything else as it is."""
        if isinstance(measured, RangeScan):
            return unwound(measured, self._history.at)
        return measured

    def settled_map(self) -> GridMap | None:
        """Return the map that the robot makes to find itself in, drawn as it is known now."""
        return None if self.mapper is None else self.mapper.settled_map()

    def take_notices(self) -> list[str]:
        """Return sentences on changes since the last call."""
        said, self._notices = self._notices, []
        said += [] if self.localiser is None else self.localiser.take_notices()
        if self._state is not None and self._state.status is not self._status:
            self._status = self._state.status
            said.append(_WORDS[self._status])
        if self.rejected and not self._said_rejected:
            self._said_rejected = True
            said.append("a scan was no scan and is left out, as those like it will be")
        return said

    def pictures(self, now_ns: int) -> list[Picture]:
        """Return the estimators' data for display, twice a second."""
        if now_ns - self._pictured_ns < _PICTURE_NS:
            return []
        self._pictured_ns = now_ns
        found: list[Picture] = []
        if self.localiser is not None and len(self.localiser.particles):
            every = math.ceil(len(self.localiser.particles) / _SHOWN)
            shown = self.localiser.particles[::every].astype(np.dtype("<f4"))
            found.append(ParticleCloud(now_ns, shown.tobytes()))
        if self.mapper is not None:
            found += self.mapper.pictures(now_ns)
        return found

    def given_map(self, now_ns: int) -> list[GivenMap]:
        """Return the localiser's map, if it is time to publish it again."""
        if self._given is None or now_ns - self._given_ns < _GIVEN_NS:
            return []
        self._given_ns = now_ns
        return [GivenMap(now_ns, self._given)]


def make_estimators(
    config: RobotConfig, start: SE2, beside: Path, state: Path | None = None
) -> Estimators:
    """Return the estimators of a robot that starts at a pose, compiled and ready.

    `beside` is the folder of the robot's file, where its map may lie, `state` that of what survives
    restarts; None: there is none.

    Raises
    ------
    ConfigError, DiskError
        If the map cannot be read or does not fit the method; if it cannot be kept.
    """
    settings = config.localisation
    history = OdometryHistory()
    made, notices = MadeLocaliser(None), list[str]()
    if settings.method in LOCALISERS:
        made = make_localiser(LocaliserBegin(config, start, history, beside, state))
    if made.world_map is not None and settings.start == "known":
        notices += filter(None, [off_map(made.world_map, start)])
    if settings.mapping and made.drawing is None:
        made = made._replace(drawing=_mapper(config, history))
    made = made._replace(notices=[*notices, *made.notices])
    return Estimators(made, history, sensed_robot(config))


def make_localiser(begin: LocaliserBegin) -> MadeLocaliser:
    """Return the localiser that a robot's file names, imported now.

    Raises
    ------
    ConfigError, DiskError
        If what it needs cannot be read, or kept.
    """
    kind = LOCALISERS[begin.config.localisation.method]
    made: MadeLocaliser = import_module(kind.module).make(begin)
    return made


def _mapper(config: RobotConfig, history: OdometryHistory) -> Mapper:
    """Return the mapper of a robot, its kernels compiled or loaded from the cache."""
    robot, rehearsed = sensed_robot(config), OccupancyGrid(config.localisation.grid)
    for sensor in load_sensors().values():
        if (measured := sensor.rehearsal(robot)) is not None:
            for _, update in sensor.cells(measured, robot):
                update(rehearsed, SE2())
    rehearsed.to_map()
    return Mapper(OccupancyGrid(config.localisation.grid), robot, history)
