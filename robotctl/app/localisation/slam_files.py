"""The file in which SLAM keeps its map while the robot drives."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import msgspec

from robotctl.errors import ConfigError
from robotctl.estimation.slam.keyframes.back_end import as_row
from robotctl.estimation.slam.keyframes.saved_map import (
    HEADING,
    ChangeLog,
    KeyframeMap,
    compacted,
    encoded,
)
from robotctl.logs.formats.keyframes_log import load_keyframes
from robotctl.runtime.storage.record_log import (
    DamagedLogError,
    RecordLog,
    read_records,
    set_aside,
)

if TYPE_CHECKING:
    from robotctl.app.localisation.slam_localiser import SlamLocaliser

NAME: Final = "slam.keyframes"
"""In the folder of what survives restarts."""
_PLACE_NS: Final = 500_000_000
"""Between two saved places of the robot [ns]."""


def keyframes_to_localise(path: Path) -> KeyframeMap:
    """Return the map in a file that is only read.

    Raises
    ------
    ConfigError
        If there is none.
    """
    saved = load_keyframes(path)
    if saved is None:
        raise ConfigError(f"{path}: no map of keyframes; localisation.mapping = true makes one")
    return saved


class KeyframeFile:
    """Keeps the map of one mapper in a file.

    Parameters
    ----------
    path
        The file. A damaged one is renamed, and the map begins anew.

    Attributes
    ----------
    saved
        The map that was in it.

    Raises
    ------
    DiskError
        If it cannot be read or written, or another process writes it.
    """

    def __init__(self, path: Path) -> None:
        self._notices: list[str] = []
        self.saved = self._load(path)
        records = compacted(read_records(path, HEADING)) if self.saved is not None else []
        self._log = RecordLog(path, HEADING, records, compacted)
        self._changes = ChangeLog()
        if self.saved is not None:
            self._changes.skip(self.saved)
        self._placed_ns = 0
        self._has_frame = self.saved is not None
        self._problem = ""

    def _load(self, path: Path) -> KeyframeMap | None:
        """Return the map in the file; rename it if it is damaged."""
        try:
            saved = load_keyframes(path)
        except DamagedLogError as error:
            self._notices.append(f"{error}; set aside as {set_aside(path)}, the map begins anew")
            return None
        if saved is not None:
            self._notices.append(f"{path}: goes on with its map of {len(saved.keyframes)} scans")
        return saved

    def take_notices(self) -> list[str]:
        """Return sentences for people since the last call."""
        if self._log.problem != self._problem:
            self._problem = self._log.problem
            self._notices.append(self._problem or "the map is saved again")
        notices, self._notices = self._notices, []
        return notices

    def step(self, localiser: SlamLocaliser, now_ns: int) -> None:
        """Have written what is new about a map; twice a second where the robot is on it."""
        mapper = localiser.mapper
        if not mapper.keyframes or mapper.is_lost:
            return
        change = self._changes.changes(mapper)
        is_new = bool(change.scans or change.links or change.poses)
        if not is_new and now_ns - self._placed_ns < _PLACE_NS:
            return
        self._placed_ns = now_ns
        x, y, theta = as_row(mapper.place.pose).tolist()
        change = msgspec.structs.replace(change, place=(mapper.place.keyframe, (x, y, theta)))
        if not self._has_frame:
            x, y, theta = as_row(localiser.T_world_map).tolist()
            change = msgspec.structs.replace(change, frame=(x, y, theta))
            self._has_frame = True
        self._log.add([encoded(change)])

    def close(self) -> None:
        """Have all written, and let the file go."""
        self._log.close()
