"""Turns on the spot in the states of a robot, and in a recording."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from robotctl.config.robot_file import RobotConfig
from robotctl.errors import PlaceError
from robotctl.estimation.odometry.odometry_history import OdometryHistory
from robotctl.estimation.places.signature_turn import Turn, TurnCollector
from robotctl.estimation.places.signatures import SignatureConfig
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.logs.log_poses import best_poses
from robotctl.messages.control import ControlState
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.new_sonar_readings import NewSonarReadings
from robotctl.model.sensors.sonar import SonarMount

Progress: TypeAlias = Callable[[float], None]
"""Called with the angle that the robot has turned [rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class Visited:
    """A turn, and where `base` stood at its end in `world`; None if unknown."""

    turn: Turn
    pose: SE2 | None


class StateTurns:
    """Finds turns on the spot in the states of the control process.

    Parameters
    ----------
    robot
        Its sonars.
    signatures
        How signatures are made.
    """

    def __init__(self, robot: RobotConfig, signatures: SignatureConfig) -> None:
        self._history = OdometryHistory()
        self._notices = NewSonarReadings(robot.localisation.sonar.max_range_m)
        self._collector = TurnCollector(robot.sonar, signatures)

    @property
    def turned_rad(self) -> float:
        """Angle turned on the present spot [rad]."""
        return self._collector.turned_rad

    def step(self, control: ControlState) -> Turn | None:
        """Take a state; return the turn that it completes."""
        self._history.add(control.stamp_ns, control.T_odom_base)
        done = None
        for reading in self._notices.take(
            control.stamp_ns, control.sonar_stamp_ns, control.sonar_m
        ):
            odometry = self._history.at(reading.stamp_ns)
            if odometry is not None:
                done = self._collector.add(reading, odometry) or done
        return done


def recorded_turns(
    log: Path,
    mounts: Sequence[SonarMount],
    signatures: SignatureConfig,
    began: SE2 | None,
    tell: Callable[[str], None],
) -> list[Visited]:
    """Return all turns on the spot of a recording.

    Where `began` is None the recording says where they ended, if it knows: see `best_poses`.

    Parameters
    ----------
    log
        Of any kind that is read.
    mounts
        Where the sonars sit, if the log does not say.
    signatures
        How signatures are made.
    began
        `base` in `world` as the first turn began; None: unknown.
    tell
        Called with each note of the log's reader.

    Raises
    ------
    LogFormatError
        If the log cannot be read.
    PlaceError
        If it has no sonars or no whole turn.
    """
    recording = read_recording(log)
    if not recording.sonars:
        raise PlaceError(f"{log}: no sonar ranges of use in it{recording.why()}")
    for note in recording.notes:
        tell(note)
    mounts = recording.sonar_mounts or mounts
    count = len(recording.sonars[0].reading.ranges_m)
    if len(mounts) != count:
        raise PlaceError(f"{log}: {count} sonars in it, but the robot's file has {len(mounts)}")
    collector = TurnCollector(mounts, signatures)
    turns, most_rad = [], 0.0
    for each in recording.sonars:
        turn = collector.add(each.reading, each.odometry)
        most_rad = max(most_rad, collector.turned_rad)
        turns += [] if turn is None else [turn]
    if not turns:
        raise PlaceError(
            f"{log}: the robot turns on the spot by {math.degrees(most_rad):.0f} deg at most, "
            "360 deg are needed"
        )
    if began is not None:
        T_world_odom = began @ turns[0].began.inverse()
        return [Visited(turn, T_world_odom @ turn.odometry) for turn in turns]
    known = best_poses(log, recording)
    return [Visited(turn, known[0].at(turn.stamp_ns) if known else None) for turn in turns]
