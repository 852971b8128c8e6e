"""Content of the page about a run: its paths, map, figures over time, states and notices."""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from robotctl.logs.formats.robotctl_log import json_messages, read_own
from robotctl.messages.control import SafetyState
from robotctl.model.geometry.se2 import SE2
from robotctl.model.trajectory import Trajectory
from robotctl.workbench.logs.rows import state_logs
from robotctl.workbench.logs.series import Selection, select
from robotctl.workbench.logs.trajectories import trajectories_of

FIELDS: Final = (
    "control.v_ref_m_s",
    "control.v_m_s",
    "control.omega_ref_rad_s",
    "control.omega_rad_s",
    "control.bus_voltage_v",
    "control.loop.lag_us_p99",
)
"""Fields that are drawn over time."""
_MAPS: Final = frozenset({"map", "live_map"})
_LEVELS: Final = {1: "debug", 2: "info", 3: "warning", 4: "error", 5: "fatal"}
"""Levels of `foxglove.Log`."""


@dataclass(frozen=True, slots=True)
class Line:
    """A notice for people."""

    time_s: float
    level: str
    text: str


@dataclass(frozen=True, slots=True)
class MapPicture:
    """A map as grey values, (rows, columns) from the lower edge, 0 black to 254 white.

    `corner` is its lower left corner in `world`, from which it is `width_m` along x wide.
    """

    greys: NDArray[np.uint8]
    corner: SE2
    width_m: float
    height_m: float


@dataclass(frozen=True, slots=True)
class RunReport:
    """Everything that the page shows.

    Parameters
    ----------
    name
        Name of the recording.
    paths
        Paths of the robot by name; see `trajectories_of`.
    map
        The last map; None: there is none.
    selection
        `FIELDS` over time, and the states of the robot.
    reasons
        Time since the first entry [s], state and reason of each change of either.
    notices
        What people were told.
    score
        Figures of the score by name; empty without one.
    notes
        Sentences on what could not be read.
    """

    name: str
    paths: Mapping[str, Trajectory]
    map: MapPicture | None
    selection: Selection
    reasons: tuple[tuple[float, str, str], ...]
    notices: tuple[Line, ...]
    score: Mapping[str, str]
    notes: tuple[str, ...]


def report_of(
    run: Path, score: Mapping[str, Any] | None, tell: Callable[[int, int], None]
) -> RunReport:
    """Read what the page about a recording shows.

    Parameters
    ----------
    run
        Folder of `--record`, or one `robot-*.mcap` of it.
    score
        Content of the file of `sim --report`.
    tell
        Called with how much is read, and how much there is.

    Raises
    ------
    RecordingError
        If it is no recording of ours.
    OSError
        If it cannot be read.
    """
    files = state_logs(run)
    selection = select(run, FIELDS, tell)
    recording = read_own(run, with_sonars=False)
    reasons: list[tuple[float, str, str]] = []
    notices: list[Line] = []
    picture: MapPicture | None = None
    begin_ns: int | None = None
    for file in files:
        for topic, message in json_messages(file, []):
            begin_ns = message.log_time if begin_ns is None else min(begin_ns, message.log_time)
            time_s = (message.log_time - begin_ns) / 1e9
            if topic in _MAPS:
                picture = _map_of(msgspec.json.decode(message.data))
            elif topic == "notice":
                content = msgspec.json.decode(message.data)
                level = _LEVELS.get(content["level"], "")
                notices.append(Line(time_s, level, content["message"]))
            elif topic == "control":
                now = _decode_state(message.data)
                words = now.state.name.lower().replace("_", " "), now.reason
                if not reasons or reasons[-1][1:] != words:
                    reasons.append((time_s, *words))
    return RunReport(
        run.name,
        trajectories_of(recording),
        picture,
        selection,
        tuple(reasons),
        tuple(notices),
        {} if score is None else _flat(score),
        (*selection.notes, *recording.notes),
    )


class _State(msgspec.Struct):
    """The part of a logged control state that says why the robot stands."""

    state: SafetyState
    reason: str = ""


_decode_state = msgspec.json.Decoder(_State).decode


def _map_of(content: Mapping[str, Any]) -> MapPicture:
    """Return the picture of a `foxglove.Grid`."""
    columns, stride, step = content["column_count"], content["row_stride"], content["cell_stride"]
    cells = np.frombuffer(base64.b64decode(content["data"]), np.uint8).reshape(-1, stride)
    greys = cells[:, : columns * step : step]  # red, green and blue are the same
    at, turned = content["pose"]["position"], content["pose"]["orientation"]
    corner = SE2(at["x"], at["y"], 2.0 * math.atan2(turned["z"], turned["w"]))
    side = content["cell_size"]
    return MapPicture(greys, corner, columns * side["x"], len(greys) * side["y"])


def _flat(score: Mapping[str, Any], name: str = "") -> dict[str, str]:
    """Return the figures of a score that are there, one below the other."""
    found: dict[str, str] = {}
    for key, value in score.items():
        words = f"{name} {key}".strip().replace("_", " ")
        if isinstance(value, Mapping):
            found |= _flat(value, words)
        elif isinstance(value, list):
            if value:
                found[words] = "; ".join(map(str, value))
        elif isinstance(value, float):
            found[words] = f"{value:.4g}"
        elif isinstance(value, bool):
            found[words] = "yes" if value else "no"
        elif value not in (None, ""):
            found[words] = str(value)
    return found
