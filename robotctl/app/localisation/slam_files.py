"""The file in which SLAM keeps its map while the robot drives."""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple, Protocol

import msgspec

from robotctl.errors import ConfigError
from robotctl.estimation.localisation_config import LocalisationConfig
from robotctl.estimation.sensor_names import LIDAR
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.estimation.slam.keyframes.saved_map import (
    HEADING,
    ChangeLog,
    KeyframeMap,
    SavedOdometry,
    as_saved,
    compacted,
    encoded,
)
from robotctl.logs.formats.keyframes_log import load_keyframes
from robotctl.model.geometry.se2 import SE2
from robotctl.runtime.storage.record_log import (
    DamagedLogError,
    RecordLog,
    read_records,
    set_aside,
)
from robotctl.words import counted

NAME: Final = "slam.keyframes"
"""In the folder of what survives restarts."""
_PLACE_NS: Final = 500_000_000
"""Interval between two saved places of the robot [ns]."""


class MapPlaces(NamedTuple):
    """Files in which the map of a robot is kept.

    Parameters
    ----------
    path
        The file; None: it is not kept.
    is_read_only
        Whether the file stays as it is.
    is_own
        Whether it is the robot's own file, which nobody chose.
    """

    path: Path | None
    is_read_only: bool = False
    is_own: bool = False


def keyframes_of(settings: LocalisationConfig, beside: Path, state: Path | None) -> MapPlaces:
    """Return where a robot keeps its map: as its file says, else in the folder `state`.

    A relative path counts from the folder `beside`, if the file is there, else from the working
    directory.
    """
    if settings.keyframes:
        here = beside / settings.keyframes
        file = here if here.is_file() else Path(settings.keyframes)
        return MapPlaces(file, is_read_only=not settings.mapping)
    return MapPlaces(None if state is None else state / NAME, is_own=True)


def keyframes_to_localise(path: Path, sensor: str) -> KeyframeMap:
    """Return the map in a file that is only read, for a robot that maps by a sensor.

    Raises
    ------
    ConfigError
        If there is none, or it was made by another sensor.
    """
    saved = load_keyframes(path)
    if saved is None:
        raise ConfigError(f"{path}: no map of keyframes; localisation.mapping = true makes one")
    if saved.sensor != sensor:
        raise ConfigError(_by_another(path, saved, sensor))
    return saved


def _by_another(path: Path, saved: KeyframeMap, sensor: str) -> str:
    return f"{path}: a map made by {saved.sensor}, of no use to a robot that maps by {sensor}"


class RobotOnMap(Protocol):
    """The robot as its map is written."""

    T_world_map: SE2

    @property
    def place(self) -> tuple[int, SE2]:
        """The robot's keyframe, and `base` in it."""

    @property
    def odometry(self) -> SavedOdometry | None:
        """Odometry in that pose."""


class KeyframeFile:
    """Keeps the map of one mapper in a file.

    Parameters
    ----------
    path
        The file. A damaged one is renamed, and the map begins anew.
    sensor
        By which the robot maps.
    is_own
        Whether a map made by another sensor is renamed as well, instead of refused.

    Attributes
    ----------
    saved
        The map that was in it.

    Raises
    ------
    ConfigError
        If the map was made by another sensor.
    DiskError
        If it cannot be read or written, or another process writes it.
    """

    def __init__(self, path: Path, sensor: str, *, is_own: bool = False) -> None:
        self._notices: list[str] = []
        self._sensor = sensor
        self.saved = self._load(path, is_own)
        records = compacted(read_records(path, HEADING)) if self.saved is not None else []
        self._log = RecordLog(path, HEADING, records, compacted)
        self._changes = ChangeLog()
        if self.saved is not None:
            self._changes.skip(self.saved)
        self._placed_ns = 0
        self._has_frame = self.saved is not None
        self._problem = ""

    def _load(self, path: Path, is_own: bool) -> KeyframeMap | None:
        """Return the map in the file; rename it if it is damaged, or the own one of another."""
        try:
            saved = load_keyframes(path)
        except DamagedLogError as error:
            self._notices.append(f"{error}; set aside as {set_aside(path)}, the map begins anew")
            return None
        if saved is None:
            return None
        if saved.sensor != self._sensor:
            said = _by_another(path, saved, self._sensor)
            if not is_own:
                raise ConfigError(f"{said}; name another file as localisation.keyframes")
            aside = set_aside(path, f"by-{saved.sensor}")
            self._notices.append(f"{said}; set aside as {aside}, the map begins anew")
            return None
        said = f"{path}: goes on with its map of {counted(len(saved.keyframes), 'scan')}"
        if saved.sensor != LIDAR:
            said += "; the robot is taken to be where it was last"
        self._notices.append(said)
        return saved

    def take_notices(self) -> list[str]:
        """Return sentences for people since the last call."""
        if self._log.problem != self._problem:
            self._problem = self._log.problem
            self._notices.append(self._problem or "the map is saved again")
        notices, self._notices = self._notices, []
        return notices

    def step(self, mapper: SlamMapper, robot: RobotOnMap, now_ns: int) -> None:
        """Have written what is new about a map; twice a second where the robot is on it."""
        if not mapper.keyframes or mapper.is_lost:
            return
        change = self._changes.changes(mapper)
        is_new = bool(change.scans or change.images or change.links or change.poses)
        if not is_new and now_ns - self._placed_ns < _PLACE_NS:
            return
        self._placed_ns = now_ns
        number, pose = robot.place
        place = number, as_saved(pose)
        change = msgspec.structs.replace(change, place=place, odometry=robot.odometry)
        if not self._has_frame:
            frame = as_saved(robot.T_world_map)
            change = msgspec.structs.replace(change, frame=frame, sensor=self._sensor)
            self._has_frame = True
        self._log.add([encoded(change)])

    def close(self) -> None:
        """Have all written, and let the file go."""
        self._log.close()
