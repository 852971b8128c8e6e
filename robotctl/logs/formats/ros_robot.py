"""The robot of a ROS bag: its odometry, frames and lasers."""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from robotctl.logs.formats.log_text import LogFormatError
from robotctl.logs.formats.placing import Odometry
from robotctl.logs.formats.ros_content import BagContent, OdometrySource, ScanSource, in_plane
from robotctl.logs.formats.ros_frames import Frames
from robotctl.logs.formats.timeline import Series

_TRUTH: Final = re.compile(r"truth|(^|[/_])gt([/_]|$)|mocap|vicon|optitrack", re.IGNORECASE)
_BASES: Final = ("base_footprint", "base_link", "base")


@dataclass(frozen=True, slots=True)
class BagRobot:
    """The robot of a bag.

    Parameters
    ----------
    name
        Prefix of its topics or frames; "" if it has none.
    odometry
        Odometry, `base` in `odom`.
    odom, base
        Names of the two frames.
    """

    name: str
    odometry: Odometry
    odom: str
    base: str

    def mount_of(self, laser: ScanSource, content: BagContent, notes: list[str]) -> str | None:
        """Return the frame of the robot in which a laser's place is known.

        None if the laser is not on the robot. That, and any assumption, is noted.
        """
        frames, frame = content.frames, laser.frame
        if self._is_of_another(laser, content):
            notes.append(f"{laser} left out: they are not of the robot {self.name}")
            return None
        known = [
            each
            for each in (self.base, *named_bases(frames, self.name), *_BASES)
            if frames.common(each, frame) is not None
        ]
        if not known:
            if {frame, self.base} <= frames.names():
                notes.append(
                    f"{laser} left out: tf has {frame} and {self.base}, but nothing between them"
                )
                return None
            notes.append(
                f"{laser}: tf does not say where {frame} is in {self.base}: taken for the same"
            )
            return frame
        if not frames.are_one(known[0], frame):
            notes.append(f"{laser} left out: {frame} is not on the robot, it travels in {known[0]}")
            return None
        if known[0] != self.base:
            notes.append(f"{laser}: tf says where {frame} is in {known[0]}: taken for {self.base}")
        return known[0]

    def rank(self, laser: ScanSource, count: int) -> tuple[bool, int, str]:
        """Return the sort key of a laser; lasers in one frame are the same laser."""
        return _beginning(laser.topic) != self.name, -count, laser.topic

    def _is_of_another(self, laser: ScanSource, content: BagContent) -> bool:
        """Return whether a laser is of another robot by its names."""
        if not self.name:
            return False
        space = _space(laser.frame)
        if space:
            return space != self.name
        begins = {_beginning(each.topic) for each in content.scans}
        return self.name in begins and _beginning(laser.topic) != self.name


def robot_of(path: Path, content: BagContent, notes: list[str]) -> BagRobot:
    """Return the robot of a bag.

    Raises
    ------
    LogFormatError
        If it holds several, or has no motion of one.
    """
    by_name = _robots(content)
    if len(by_name) > 1:
        raise LogFormatError(f"{path}: {_choice(path, content, by_name)}")
    sources = [each for each in content.odometry if not _TRUTH.search(each.topic)]
    if not sources:
        return _by_tf(path, content, next(iter(by_name), ""), notes)
    best = max(
        sources, key=lambda each: (each.topic.endswith("/odom"), len(content.odometry[each]))
    )
    if len(sources) > 1:
        topics = sorted({each.topic for each in sources})
        notes.append(f"odometry in {', '.join(topics)}: {best.topic} is taken")
    name = next(iter(by_name))
    base = _base_of(best, content, name, notes)
    odom = best.frame or "odom"
    if odom == base:
        odom = next(iter(content.frames.chain(base)[1:]), "odom")
    odometry = Odometry(path, content.odometry[best], notes)
    notes.append(f"odometry: {best.topic}, {base} in {odom}")
    return BagRobot(name, odometry, odom, base)


def truth_of(robot: BagRobot, content: BagContent) -> OdometrySource | None:
    """Return the Odometry topic that has the robot's true poses; None if there is none."""
    found = [
        each
        for each in content.odometry
        if _TRUTH.search(each.topic) and _space(each.child) in ("", robot.name)
    ]
    return max(found, key=lambda each: len(content.odometry[each]), default=None)


def named_bases(frames: Frames, name: str) -> list[str]:
    """Return the frames of tf with a usual name of a robot's base, best first."""
    prefix = f"{name}/" if name else ""
    return [base for each in _BASES if len(frames.chain(base := f"{prefix}{each}")) > 1]


def _robots(content: BagContent) -> dict[str, list[OdometrySource | str]]:
    """Return the robots of a bag by name, each with its odometry, or its base or topics of tf."""
    frames = content.frames
    found: dict[str, list[OdometrySource | str]] = defaultdict(list)
    for source in content.odometry:
        if not _TRUTH.search(source.topic):
            found[_name_of(source, content)].append(source)
    if not found:
        for frame in sorted(frames.names()):
            space, _, last = frame.rpartition("/")
            if last in _BASES and any(map(frames.moves, frames.chain(frame))):
                found[space].append(frame)
    first, *others = list(found) or [""]
    for name in others:
        if any(
            _is_one(frames, _frame(one), _frame(other), is_named=bool(first and name))
            for one in found[first]
            for other in found[name]
        ):
            found[first] += found.pop(name)
    with_tf = {_beginning(topic) for topic in content.tf_topics} - {""}
    for name in sorted(with_tf - found.keys()) if len(with_tf) > 1 else ():
        found[name] = []  # its tf would mix with that of the other
    return dict(found)


def _is_one(frames: Frames, one: str, other: str, *, is_named: bool) -> bool:
    """Return whether two base frames are on one robot.

    Robots with separate names may use the same frame names.
    """
    return not is_named if one == other else frames.are_one(one, other)


def _frame(source: OdometrySource | str) -> str:
    return source if isinstance(source, str) else source.child


def _name_of(source: OdometrySource, content: BagContent) -> str:
    """Return the name of the robot of an odometry: the prefix of its frames, or of its topics."""
    space = _space(source.child) or _space(source.frame)
    if space:
        return space
    begins = _beginning(source.topic)
    shared = {_beginning(each.topic) for each in content.scans}
    shared |= {_beginning(each) for each in content.tf_topics}
    return begins if begins in shared else ""


def _choice(path: Path, content: BagContent, by_name: dict[str, list[OdometrySource | str]]) -> str:
    """Return the message that a bag holds several robots, and how to extract one."""
    topics: dict[str, list[str]] = {}
    for name, sources in by_name.items():
        own = {each.topic for each in sources if isinstance(each, OdometrySource)}
        for laser in content.scans:
            if name and name in (_space(laser.frame), _beginning(laser.topic)):
                own.add(laser.topic)
        own |= {each for each in content.tf_topics if name and _beginning(each) == name}
        topics[name] = sorted(own)
    named = [
        f"{name or 'one without a name'} ({', '.join(topics[name] or map(str, by_name[name]))})"
        for name in by_name
    ]
    words = f"{len(by_name)} robots in it, {' and '.join(named)}; a drive is of one"
    first, *others = topics.values()
    away = {topic for each in others for topic in each}
    if away and not away & set(first):
        words += (
            "; copy the topics of one, as of the first with\n  rosbags-convert --src "
            f"{path} --dst one --exclude-topic {' '.join(sorted(away))}"
        )
    return words


def _base_of(source: OdometrySource, content: BagContent, name: str, notes: list[str]) -> str:
    """Return the frame of the robot that an odometry moves.

    It is the child frame, unless the driver leaves that empty or names a frame in which the robot
    moves: the frame of the odometry itself, or one above the robot in tf.
    """
    frames, child, odom = content.frames, source.child, source.frame
    on_robot = [*named_bases(frames, name), *(each.frame for each in content.scans)]
    is_above = child in frames.chain(odom) or any(
        child in frames.chain(each) and not frames.are_one(child, each) for each in on_robot
    )
    if child and not is_above:
        return child
    below = [each for each in on_robot if odom in frames.chain(each)[1:]]
    named = next(iter(named_bases(frames, name)), None)
    if named is None and below:
        chain = frames.chain(below[0])
        named = chain[chain.index(odom) - 1]
    if child:
        notes.append(
            f"{source.topic}: its child_frame_id {child} is no frame of the robot, "
            f"{named or 'base'} is taken"
        )
    return named or "base"


def _by_tf(path: Path, content: BagContent, name: str, notes: list[str]) -> BagRobot:
    """Return a robot with its motion by tf only."""
    frames = content.frames
    base = next(iter(named_bases(frames, name)), "")
    chain = frames.chain(base) if base else []
    odom = next((frame for frame in chain[1:] if "odom" in frame), chain[-1] if chain else "")
    moving = [frame for frame in chain[: chain.index(odom)] if frames.moves(frame)] if base else []
    if not moving:
        raise LogFormatError(
            f"{path}: nothing says how the robot moves: neither nav_msgs/Odometry nor tf of "
            f"{' or '.join(_BASES)}"
        )
    stamps_ns = sorted({at for frame in moving for at in frames.series(frame).stamps_ns.tolist()})
    known = [
        (stamp_ns, in_plane(pose))
        for stamp_ns in stamps_ns
        if (pose := frames.lookup(odom, base, stamp_ns)) is not None
    ]
    log_ns = frames.series(moving[0]).log_ns if len(moving) == 1 else np.empty(0, np.int64)
    series = Series(
        f"tf of {base} in {odom}",
        np.array([stamp_ns for stamp_ns, _ in known], np.int64),
        log_ns if len(log_ns) == len(known) else np.empty(0, np.int64),
        [(pose.x_m, pose.y_m, pose.theta_rad) for _, pose in known],
        np.zeros(len(known), bool),
    )
    notes.append(f"odometry: tf, {base} in {odom}")
    return BagRobot(name, Odometry(path, series, notes), odom, base)


def _space(frame: str) -> str:
    """Return the prefix of a frame: robot1 for robot1/base_link."""
    return frame.rpartition("/")[0]


def _beginning(topic: str) -> str:
    """Return the first of several parts of a topic; "" if it has only one."""
    first, separator, _ = topic.strip("/").partition("/")
    return first if separator else ""
