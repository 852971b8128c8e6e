"""State kept over restarts: odometer and mission progress.

The control process reads it before its loop starts, navigation before its first step; only the
recorder process writes it, because writing waits for the disk.
"""

from __future__ import annotations

import math
import os
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import msgspec

from robotctl.config.options import StackOptions
from robotctl.messages.control import ControlState, NavigationState
from robotctl.messages.estimation import LocalisationState
from robotctl.messages.requests import FARTHEST_M
from robotctl.messages.world_pose import WorldPose
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.runtime.storage.state_file import StateError, StateFile

NAME: Final = "progress.json"

_SAVE_NS: Final = 5_000_000_000
"""Maximum loss in a power cut while driving [ns]."""
_SAY_NS: Final = 10_000_000_000
"""Interval of notices that saving fails [ns]."""
_SAVE_AT_REST_NS: Final = 1_000_000_000
_SILENCE_NS: Final = 300_000_000
"""Silence after which a process may be about to restart [ns]."""
_REST_M_S: Final = 0.005
_SAME_M, _SAME_RAD = 0.01, 0.01
"""A localiser moves a robot at rest by less, again and again; cards wear out by being written."""


class StoredProgress(msgspec.Struct, frozen=True):
    """The stored state.

    Parameters
    ----------
    run
        Which run of the stack the pose and the mission's progress belong to.
    odometer_m
        Distance driven in the robot's life [m].
    x_m, y_m, theta_rad
        Pose of `base` in `world` [m, rad].
    mission_crc
        CRC-32 of the mission's file; 0 without a mission.
    item, item_s_m
        Mission item in progress, from 0, and the distance along it [m].
    loop_counts
        How often each repeat and jump of the mission was taken.
    mission_file
        File of a mission that was loaded since the start; empty: it is that of the options.
    home
        x, y [m] and heading [rad] in `world` of where RTL leads to; None: it was not moved.

    Raises
    ------
    ValueError
        If a value can be none of a robot's; in a file that is damage like any other.
    """

    run: str
    odometer_m: float
    x_m: float
    y_m: float
    theta_rad: float
    mission_crc: int = 0
    item: int = 0
    item_s_m: float = 0.0
    loop_counts: tuple[int, ...] = ()
    mission_file: str = ""
    home: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        """Check the ranges; the odometer is nan if it is unknown."""
        if self.odometer_m < 0.0 or math.isinf(self.odometer_m):
            raise ValueError(f"odometer_m must be finite and at least 0, not {self.odometer_m:g}")
        if not (abs(self.x_m) < FARTHEST_M and abs(self.y_m) < FARTHEST_M):
            raise ValueError(
                f"x_m and y_m must be below {FARTHEST_M:.0f}, not {self.x_m:g} and {self.y_m:g}"
            )
        if not math.isfinite(self.theta_rad):
            raise ValueError(f"theta_rad must be finite, not {self.theta_rad:g}")
        if self.home is not None and not max(map(abs, self.home)) < FARTHEST_M:
            raise ValueError(f"home must be a place, not {self.home}")
        if self.item < 0:
            raise ValueError(f"item must be at least 0, not {self.item}")
        if not 0.0 <= self.item_s_m < math.inf:
            raise ValueError(f"item_s_m must be finite and at least 0, not {self.item_s_m:g}")
        if any(count < 0 for count in self.loop_counts):
            raise ValueError(f"loop_counts must be at least 0, not {self.loop_counts}")

    def fits(self, options: StackOptions) -> bool:
        """Return whether pose and mission item are those of this run and this mission."""
        crc = mission_crc(self.mission_file or options.mission)
        return self.run == options.run and self.mission_crc == crc


def progress_file(directory: Path) -> StateFile[StoredProgress]:
    """Return the file in a state directory, which is created if missing.

    Raises
    ------
    StateError
        If the directory cannot be made.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StateError(f"{directory}: cannot be created: {error.strerror}") from error
    return StateFile(directory / NAME, StoredProgress)


def state_directory(environment: Mapping[str, str]) -> Path:
    """Return the state folder: systemd's STATE_DIRECTORY, otherwise the user's.

    Raises
    ------
    StateError
        If the user has no home.
    """
    given = environment.get("STATE_DIRECTORY", "").partition(":")[0]
    if given:
        return Path(given)
    if home := environment.get("XDG_STATE_HOME"):
        return Path(home) / "robotctl"
    try:
        return Path.home() / ".local" / "state" / "robotctl"
    except RuntimeError as error:
        raise StateError(
            f"user {os.geteuid()} has no home to keep state in; set HOME or XDG_STATE_HOME"
        ) from error


def resumed(
    options: StackOptions, items: int
) -> tuple[StackOptions, StoredProgress, tuple[str, ...]]:
    """Return options that resume the interrupted run, its place, and notes.

    Parameters
    ----------
    options
        Of the new run.
    items
        How many its mission has; 0 without a mission.

    Returns
    -------
    tuple
        The options, what was saved, and a sentence for each file that was found damaged.

    Raises
    ------
    StateError
        If there is none, or its mission was another, or had fewer items than are saved.
    """
    saved, notes = load_progress(options)
    if saved is None or not saved.run:  # without a run it cannot be read
        raise StateError("\n".join((*notes, f"{options.state}: there is no run to resume")))
    options = msgspec.structs.replace(options, run=saved.run)
    if not saved.fits(options):
        raise StateError(
            "\n".join((*notes, f"{options.state}: the run saved there is of another mission"))
        )
    if saved.mission_file:  # has taken the place of the one in the options
        return msgspec.structs.replace(options, mission=saved.mission_file), saved, notes
    if saved.item > items:
        why = f"the mission has {items} items, against {saved.item} done in the run saved there"
        raise StateError("\n".join((*notes, f"{options.state}: {why}")))
    return options, saved, notes


def mission_crc(file: str) -> int | None:
    """Return the CRC-32 of a mission's file; 0 without one, None if it cannot be read."""
    try:
        return zlib.crc32(Path(file).read_bytes()) if file else 0
    except OSError:
        return None


def load_progress(options: StackOptions) -> tuple[StoredProgress | None, tuple[str, ...]]:
    """Return the progress saved in the state directory, and a sentence for each damaged file.

    If the disk cannot be read, the odometer is nan, which is never saved over the true one.
    """
    if not options.state:
        return None, ()
    try:
        return progress_file(Path(options.state)).load()
    except StateError as error:
        return StoredProgress("", math.nan, 0.0, 0.0, 0.0), (str(error),)


def last_pose(saved: StoredProgress | None, options: StackOptions) -> SE2 | None:
    """Return where `base` was last in `world` in this run of the stack; None if it begins."""
    if saved is None or not saved.run or saved.run != options.run:
        return None
    return SE2(saved.x_m, saved.y_m, saved.theta_rad)


class ProgressKeeper:
    """Decides when there is something to save, and saves it.

    Saved are: each new mission item, each stop, every five seconds of driving, and at once what
    was last heard of a process that falls silent.

    Parameters
    ----------
    file
        Where to.
    options
        Of the stack: run and mission.
    saved
        Present content of the file.
    localised
        Whether the robot has a localiser. While the pose in `world` is unknown, that saved of this
        run stays; without one, the odometry's is saved, which begins at the start of the mission.
    """

    def __init__(
        self,
        file: StateFile[StoredProgress],
        options: StackOptions,
        saved: StoredProgress | None,
        *,
        localised: bool,
    ) -> None:
        self._file = file
        self._run = options.run
        self._mission_crc = mission_crc(options.mission) or 0
        self._world = WorldPose(has_localiser=localised)
        self._control: ControlState | None = None
        self._navigation: NavigationState | None = None
        self._saved = saved if saved is not None and saved.fits(options) else None
        self._tried_ns = 0
        self._trouble = False
        self._said_ns: int | None = None
        """When a failed save was last reported [ns]."""

    def step(self, messages: Sequence[object], now_ns: int) -> tuple[str, ...]:
        """Take published messages; return a sentence if saving fails."""
        for message in messages:
            if isinstance(message, ControlState):
                self._control = message
            elif isinstance(message, LocalisationState):
                self._world.localise(message)
            elif isinstance(message, NavigationState):
                self._navigation = message
        progress = self._present()
        if progress is None or not self._due(progress, now_ns):
            return ()
        if self._saved is not None and _are_alike(progress, self._saved):
            return ()
        return self._save(progress, now_ns)

    def close(self) -> tuple[str, ...]:
        """Save the end."""
        progress = self._present()
        if progress is None or progress == self._saved:
            return ()
        return self._save(progress, self._tried_ns)

    def _present(self) -> StoredProgress | None:
        """Return the progress to save.

        None before anything was received, without odometer, and for values that would be refused on
        reading.
        """
        control = self._control
        if control is None or not math.isfinite(control.odometer_m):
            return None
        place: SE2 | StoredProgress | None = self._world.pose(control)
        if place is None:
            place = control.T_odom_base if self._saved is None else self._saved
        try:
            return StoredProgress(
                self._run,
                control.odometer_m,
                place.x_m,
                place.y_m,
                place.theta_rad,
                *self._mission(),
                self._home(),
            )
        except ValueError:
            return None

    def _home(self) -> tuple[float, float, float] | None:
        """Return where RTL leads to; None: it was not moved."""
        known = self._navigation or self._saved
        return None if known is None else known.home

    def _mission(self) -> tuple[int, int, float, tuple[int, ...], str]:
        """Return the fields of `StoredProgress` from `mission_crc` to `mission_file`."""
        now, saved = self._navigation, self._saved
        if now is not None:
            crc = now.mission_crc if now.mission_file else self._mission_crc
            return crc, now.item, now.item_s_m, now.loop_counts, now.mission_file
        if saved is not None:
            return (
                saved.mission_crc,
                saved.item,
                saved.item_s_m,
                saved.loop_counts,
                saved.mission_file,
            )
        return self._mission_crc, 0, 0.0, (), ""

    def _due(self, progress: StoredProgress, now_ns: int) -> bool:
        """Return whether to save now."""
        control, navigation, saved = self._control, self._navigation, self._saved
        if control is None:
            return False
        age_ns = now_ns - self._tried_ns
        if self._trouble:
            return age_ns >= _SAVE_NS
        if saved is None:
            return True
        stamps = [control.stamp_ns] + ([navigation.stamp_ns] if navigation else [])
        return (
            _place(progress) != _place(saved)
            or age_ns >= _SAVE_NS
            or (age_ns >= _SAVE_AT_REST_NS and abs(control.v_m_s) < _REST_M_S)
            or any(now_ns - stamp_ns >= _SILENCE_NS for stamp_ns in stamps)
        )

    def _save(self, progress: StoredProgress, now_ns: int) -> tuple[str, ...]:
        """Save, and report failure every 10 s, for late subscribers."""
        self._tried_ns = now_ns
        try:
            self._file.save(progress)
        except StateError as error:
            self._trouble = True
            if self._said_ns is not None and now_ns - self._said_ns < _SAY_NS:
                return ()
            self._said_ns = now_ns
            return (str(error),)
        self._saved, self._trouble, self._said_ns = progress, False, None
        return ()


def _are_alike(a: StoredProgress, b: StoredProgress) -> bool:
    """Return whether two states are the same but for the last digits."""
    return (
        a.run == b.run
        and _place(a) == _place(b)
        and abs(a.odometer_m - b.odometer_m) < _SAME_M
        and math.hypot(a.x_m - b.x_m, a.y_m - b.y_m) < _SAME_M
        and abs(wrap_angle(a.theta_rad - b.theta_rad)) < _SAME_RAD
        and abs(a.item_s_m - b.item_s_m) < _SAME_M
    )


def _place(progress: StoredProgress) -> tuple[object, ...]:
    """Return home, the mission and where it is, but for the distance along an item."""
    mission = progress.mission_crc, progress.mission_file, progress.item, progress.loop_counts
    return progress.home, *mission
