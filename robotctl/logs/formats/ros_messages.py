"""The messages of ROS bags, read by rosbags, whose errors are translated here."""

from __future__ import annotations

import errno
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

from robotctl.errors import ConfigError
from robotctl.logs.formats.log_text import LogFormatError

_ROS1: Final = b"#ROSBAG V2.0"
_SQLITE: Final = b"SQLite format 3\0"
_MCAP: Final = b"\x89MCAP0\r\n"
_OWN: Final = b"robotctl"
_HEAD_BYTES: Final = 256
_SHOWN: Final = 200


class BagMessage(NamedTuple):
    """A message: its topic, kind, content, bytes, and time of reception by the bag."""

    topic: str
    kind: str
    message: Any
    raw: bytes
    log_ns: int


def is_ros_bag(path: Path) -> bool:
    """Return whether a file or a folder is a bag, by its content."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file() or bool(_bags_in(path))
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    return head.startswith((_ROS1, _SQLITE)) or (head.startswith(_MCAP) and _OWN not in head)


def _bags_in(folder: Path) -> list[Path]:
    """Return the parts of a ROS 1 bag, or the single file of a ROS 2 bag without metadata."""
    parts = sorted(folder.glob("*.bag"))
    single = [*folder.glob("*.db3"), *folder.glob("*.mcap")]
    return parts or (single if len(single) == 1 and is_ros_bag(single[0]) else [])


def bag_messages(path: Path, kinds: Sequence[str]) -> Iterator[BagMessage]:
    """Yield the messages of some kinds, in the order in which they were recorded.

    Parameters
    ----------
    path
        A file, or the folder of a bag.
    kinds
        Names of types in ROS 2.

    Raises
    ------
    ConfigError
        If the package rosbags is not installed.
    LogFormatError
        If the bag is damaged, or has no such message.
    OSError
        If it cannot be read.
    """
    try:
        from rosbags.highlevel import AnyReader  # noqa: PLC0415 - an extra
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415
    except ImportError:
        raise ConfigError(
            f"{path}: a ROS bag, for which rosbags is needed, and it is not installed; install it "
            "with\n  sudo /opt/robotctl/bin/pip install '/opt/robotctl-source[bags]'\n"
            "where these are the installation and your copy of robotctl (in a checkout: make setup)"
        ) from None
    files = [path]
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        files = _bags_in(path)
    with _damage_told(path):
        reader = AnyReader(files, default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        reader.open()
    try:
        wanted = [each for each in reader.connections if each.msgtype in kinds]
        if not wanted:
            found = Counter(each.msgtype for each in reader.connections)
            raise LogFormatError(
                f"{path}: neither LaserScan nor Odometry nor tf messages in it, but "
                f"{', '.join(found) or 'nothing'}"
            )
        messages = reader.messages(wanted)
        while True:
            with _damage_told(path):
                entry = next(messages, None)
                if entry is None:
                    return
                connection, log_ns, raw = entry
                message = reader.deserialize(raw, connection.msgtype)
            yield BagMessage(connection.topic, connection.msgtype, message, bytes(raw), log_ns)
    finally:
        reader.close()


@contextmanager
def _damage_told(path: Path) -> Iterator[None]:
    """Turn rosbags' exceptions on damaged bytes into an error that names the file.

    It trusts lengths, offsets and texts of a bag, so a wrong one may raise anything:
    AssertionError, TypeError, struct.error, MemoryError, errors of SQLite and of zstd.
    """
    try:
        yield
    except OSError as error:
        if error.errno != errno.EINVAL:  # of a seek to an offset below 0
            raise
        raise _damaged(path, error) from error
    except Exception as error:
        raise _damaged(path, error) from error


def _damaged(path: Path, error: Exception) -> LogFormatError:
    """Return the error of a damaged bag, with a remedy."""
    words = f"{type(error).__name__}: {error}".rstrip(".: ")
    advice = ""
    if path.suffix == ".mcap":
        advice = f"; `robotctl record recover {path}` keeps what is whole"
    elif path.suffix == ".bag":
        advice = "; `rosbag reindex` of ROS 1 completes a bag that was cut"
    return LogFormatError(f"{path}: the bag is damaged or incomplete: {words[:_SHOWN]}{advice}")
