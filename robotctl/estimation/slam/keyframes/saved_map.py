"""A map of keyframes as bytes: each change on its own, and all together.

Changes follow each other; the later one holds. Arrays are little-endian: scans in 32 bits, numbers
of the graph in 64. A change is whole: a keyframe comes with the links that hold it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import msgspec
import numpy as np
from msgspec.structs import replace

from robotctl.estimation.places.visual.features import Features, features_in, features_message
from robotctl.estimation.sensor_names import LIDAR
from robotctl.estimation.slam.front_end.surface import RANGE_LIMIT_M, Floats
from robotctl.estimation.slam.keyframes.back_end import BackEnd, KeyframeLink, KeyframeLinks
from robotctl.estimation.slam.keyframes.keyframe import Keyframe
from robotctl.messages.estimation import ImageFeatures
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan

HEADING: Final = b"robotctl-keyframes 1\n"
"""First bytes of a file of changes."""

MOST_IMAGES: Final = 1000
"""Maximum number of images kept, the last ones: 20 kB each."""

Row = tuple[float, float, float]


class SavedScan(msgspec.Struct, frozen=True, array_like=True):
    """A keyframe.

    Parameters
    ----------
    number
        Number of the keyframe; an existing one gets this scan.
    stamp_ns, travelled_m
        As in `Keyframe`.
    x_m, y_m, max_range_m
        As in `RangeScan` [m].
    angles, ranges
        As in `RangeScan`, "<f4" [rad], [m].
    others
        Scans of other sensors at the same time, each with this number.
    """

    number: int
    stamp_ns: int
    travelled_m: float
    x_m: float
    y_m: float
    max_range_m: float
    angles: bytes
    ranges: bytes
    others: tuple[SavedScan, ...] = ()


class SavedOdometry(msgspec.Struct, frozen=True, array_like=True):
    """`base` in `odom` at a time.

    Parameters
    ----------
    epoch_ns
        When that frame began [ns].
    stamp_ns
        The time [ns].
    pose
        x, y [m], theta [rad].
    """

    epoch_ns: int
    stamp_ns: int
    pose: Row


class Change(msgspec.Struct, frozen=True, omit_defaults=True):
    """Change of a map since it was saved last.

    Parameters
    ----------
    frame
        `map` in `world`: x, y [m], theta [rad].
    sensor
        Name of the sensor of the scans; empty: unknown, or a lidar.
    scans
        Keyframes that are new, or have another scan.
    new_poses
        Initial poses of the keyframes after those of `poses`, (k, 3) "<f8".
    links
        New ones, (l, 12) "<f8": first, second, x, y, theta, upper triangle of the information, 1 of
        a loop, 2 of a loop that a person gave, else 0.
    poses, weights
        Poses of all keyframes, (n, 3), weights of all links, (m,), "<f8"; empty: unchanged.
    images
        Images by new keyframe.
    place, odometry
        The robot's keyframe and `base` in it; its odometry there.
    """

    frame: Row | None = None
    sensor: str = ""
    scans: list[SavedScan] = []
    new_poses: bytes = b""
    links: bytes = b""
    poses: bytes = b""
    weights: bytes = b""
    images: dict[int, ImageFeatures] = {}
    place: tuple[int, Row] | None = None
    odometry: SavedOdometry | None = None


@dataclass(frozen=True, slots=True, eq=False)
class KeyframeMap:
    """A map that was saved.

    Parameters
    ----------
    frame
        `map` in `world`.
    sensor
        Name of the sensor of the scans.
    keyframes, images
        Scans that are kept; images by which places are known, by keyframe.
    poses
        Poses of the keyframes in `map`, (n, 3) [m, m, rad].
    links, weights
        Links between them, and the weight of each.
    place, odometry
        The robot's last place: a keyframe, and `base` in it; its odometry there, None: not known.
    """

    frame: SE2
    sensor: str
    keyframes: list[Keyframe]
    images: dict[int, Features]
    poses: Floats
    links: Sequence[KeyframeLink]
    weights: list[float]
    place: tuple[int, SE2]
    odometry: SavedOdometry | None


_DECODER: Final = msgspec.msgpack.Decoder(Change)
_UPPER: Final = np.triu_indices(3)
_GIVEN: Final = 2


def encoded(change: Change) -> bytes:
    """Return a change as a record."""
    return msgspec.msgpack.encode(change)


def compacted(records: Sequence[bytes]) -> list[bytes]:
    """Return one record for many; none for none.

    Raises
    ------
    ValueError
        If a record is invalid.
    """
    return [encoded(joined_changes(records))] if records else []


def joined_changes(records: Sequence[bytes]) -> Change:
    """Return all changes as one.

    Raises
    ------
    ValueError
        If a record is invalid.
    """
    whole, scans, images = Change(), dict[int, SavedScan](), dict[int, ImageFeatures]()
    poses, weights, links = b"", b"", []
    for record in records:
        change = _DECODER.decode(record)
        whole = replace(
            whole, frame=change.frame or whole.frame, sensor=change.sensor or whole.sensor
        )
        if change.place is not None:
            whole = replace(whole, place=change.place, odometry=change.odometry)
        scans |= {each.number: each for each in change.scans}
        images |= change.images
        poses = (change.poses or poses) + change.new_poses
        links.append(change.links)
        weights = change.weights or weights
    return replace(
        whole,
        scans=list(scans.values()),
        links=b"".join(links),
        poses=poses,
        weights=weights,
        images=dict(list(images.items())[-MOST_IMAGES:]),
    )


def saved_scan(number: int, keyframe: Keyframe) -> SavedScan:
    """Return a keyframe as it is saved."""
    return _saved(number, keyframe.travelled_m, keyframe.scan)


def _saved(number: int, travelled_m: float, scan: RangeScan) -> SavedScan:
    return SavedScan(
        number,
        scan.stamp_ns,
        travelled_m,
        scan.x_m,
        scan.y_m,
        scan.max_range_m,
        scan.angles_rad.astype("<f4").tobytes(),
        scan.ranges_m.astype("<f4").tobytes(),
        tuple(_saved(number, travelled_m, each) for each in scan.others),
    )


def _saved_links(links: KeyframeLinks, begin: int) -> bytes:
    """Return the links from one on as they are saved."""
    rows = np.column_stack(
        [
            links.ends[begin:],
            links.poses[begin:],
            links.information[begin:][:, *_UPPER],
            links.is_loop[begin:].astype("<f8") + links.is_given[begin:],
        ]
    )
    return rows.astype("<f8").tobytes()


def restored(records: Sequence[bytes]) -> KeyframeMap | None:
    """Return the map of all changes; None if there is no keyframe in it.

    Raises
    ------
    ValueError
        If they do not make up a map.
    """
    change = joined_changes(records)
    if not change.scans or change.frame is None or change.place is None:
        return None
    scans = sorted(change.scans, key=lambda each: each.number)
    angles = {each.angles: _floats(each.angles) for each in scans}
    keyframes = [_keyframe(each, angles[each.angles]) for each in scans]
    poses = np.frombuffer(change.poses, "<f8").reshape(-1, 3)
    links = KeyframeLinks(map(_link, np.frombuffer(change.links, "<f8").reshape(-1, 12)))
    weights = np.ones(len(links))
    known = np.frombuffer(change.weights, "<f8")
    count = len(keyframes)
    ends = [*links.ends.ravel().tolist(), change.place[0], *change.images]
    if scans[-1].number != count - 1 or len(poses) != count or len(known) > len(links):
        raise ValueError(f"{count} keyframes, {len(poses)} poses and {len(links)} links of one map")
    if any(not 0 <= end < count for end in ends):
        raise ValueError(f"a link, a place or an image of a keyframe that is none of {count}")
    weights[: len(known)] = known
    number, place = change.place
    images = {number: features_in(each) for number, each in change.images.items()}
    return KeyframeMap(
        SE2(*change.frame), change.sensor or LIDAR, keyframes, images, poses, links,
        weights.tolist(), (number, SE2(*place)), change.odometry,
    )  # fmt: skip


def _floats(saved: bytes) -> Floats:
    return np.frombuffer(saved, "<f4").astype(np.float64)


def _keyframe(saved: SavedScan, angles: Floats) -> Keyframe:
    scan = _scan(saved, angles)
    if not any(np.any(each.ranges_m < min(each.max_range_m, RANGE_LIMIT_M)) for each in scan.parts):
        raise ValueError(f"keyframe {saved.number} has no echo within {RANGE_LIMIT_M} m")
    return Keyframe(scan, saved.travelled_m)


def _scan(saved: SavedScan, angles: Floats) -> RangeScan:
    return RangeScan(
        saved.stamp_ns,
        angles,
        _floats(saved.ranges),
        saved.max_range_m,
        saved.x_m,
        saved.y_m,
        others=tuple(_scan(each, _floats(each.angles)) for each in saved.others),
    )


def _link(row: Floats) -> KeyframeLink:
    information = np.zeros((3, 3))
    information[_UPPER] = row[5:11]
    information += np.triu(information, 1).T
    is_loop, is_given = bool(row[11]), bool(row[11] == _GIVEN)
    return KeyframeLink(
        int(row[0]), int(row[1]), SE2(*row[2:5].tolist()), information, is_loop, is_given
    )


class Mapped(Protocol):
    """The part of a `SlamMapper` that is saved."""

    keyframes: list[Keyframe]
    images: dict[int, Features]
    back_end: BackEnd
    epoch: int


class ChangeLog:
    """Reports what is new about a map since the last call."""

    def __init__(self) -> None:
        self._keyframes: list[Keyframe] = []
        self._images = 0
        self._links = 0
        self._epoch = 0

    def forget(self) -> None:
        """Report everything at the next call."""
        self._epoch = -1

    def skip(self, saved: KeyframeMap) -> None:
        """Count a map as reported."""
        self._keyframes = list(saved.keyframes)
        self._images = len(saved.images)
        self._links = len(saved.links)

    def changes(self, mapper: Mapped) -> Change:
        """Return new scans, images and links; after a closed loop, all poses and weights."""
        known, before = len(self._keyframes), self._links
        keyframes, back_end = mapper.keyframes, mapper.back_end
        numbers = [
            number
            for number, each in enumerate(keyframes)
            if number >= known or each is not self._keyframes[number]
        ]
        images = dict(list(mapper.images.items())[self._images :])
        self._images += len(images)
        has_jumped = mapper.epoch != self._epoch
        self._keyframes, self._links = list(keyframes), len(back_end.links)
        self._epoch = mapper.epoch
        poses = back_end.poses.astype("<f8")
        return Change(
            scans=[saved_scan(number, keyframes[number]) for number in numbers],
            new_poses=b"" if has_jumped else poses[known:].tobytes(),
            links=_saved_links(back_end.links, before),
            poses=poses.tobytes() if has_jumped else b"",
            weights=np.array(back_end.weights, "<f8").tobytes() if has_jumped else b"",
            images={each: features_message(image) for each, image in images.items()},
        )


def whole_map(
    mapper: Mapped, sensor: str, frame: SE2, place: tuple[int, SE2],
    odometry: SavedOdometry | None = None,
) -> bytes:  # fmt: skip
    """Return the record of a whole map, made of scans of a sensor.

    `frame` is `map` in `world`, `place` the robot's keyframe and `base` in it, `odometry` its
    odometry there. A file is `HEADING` and the records.
    """
    log = ChangeLog()
    log.forget()
    number, pose = place
    change = log.changes(mapper)
    return encoded(
        replace(
            change, frame=as_saved(frame), sensor=sensor, place=(number, as_saved(pose)),
            odometry=odometry,
        )
    )  # fmt: skip


def as_saved(pose: SE2) -> Row:
    """Return x, y [m], theta [rad]."""
    return float(pose.x_m), float(pose.y_m), float(pose.theta_rad)
