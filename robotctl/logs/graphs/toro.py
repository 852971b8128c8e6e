"""TORO's files: poses in the plane and in space, as `.graph`.

VERTEX2 id x y theta; EDGE2 a b x y theta I11 I12 I22 I33 I13 I23; VERTEX3 and EDGE3 with roll,
pitch, yaw (R = Rz Ry Rx) and the upper triangle of the information; EQUIV a b: two poses are one.
Some files have EDGE2 with the upper triangle by rows, as GTSAM's w20000.txt: they are told by that
only one of the two orders gives matrices without negative eigenvalues.
Grisetti, Stachniss and Burgard, https://openslam-org.github.io/toro.html
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import numpy as np

from robotctl.estimation.slam.factors.between import BETWEEN_2D, BETWEEN_3D
from robotctl.estimation.slam.graph.factor import FactorBlock, is_semidefinite
from robotctl.estimation.slam.graph.variables import SE2, SE3, Floats
from robotctl.logs.graphs.graph_format import (
    GraphFile,
    GraphFormatError,
    factor_lines,
    ids_of,
)
from robotctl.logs.graphs.tagged_text import (
    Rows,
    Tag,
    factor_tag,
    lines_of,
    symmetric,
    tagged_format,
    triangle,
    upper,
    variable_tag,
)

_SE2: Final = ("x", "y", "theta")
_SE3: Final = ("x", "y", "z", "roll", "pitch", "yaw")
_ORDER: Final = [0, 1, 3, 5, 2, 4]
"""Order of the upper triangle by rows, in EDGE2; its inverse is `_BACK`."""
_BACK: Final = [0, 1, 4, 2, 5, 3]


def quaternion_poses(numbers: Floats) -> Floats:
    """Return poses (n, 7) of x, y, z, roll, pitch, yaw (n, 6)."""
    c, s = np.cos(0.5 * numbers[:, 3:]).T, np.sin(0.5 * numbers[:, 3:]).T
    return np.column_stack(
        [
            numbers[:, :3],
            s[0] * c[1] * c[2] - c[0] * s[1] * s[2],
            c[0] * s[1] * c[2] + s[0] * c[1] * s[2],
            c[0] * c[1] * s[2] - s[0] * s[1] * c[2],
            c[0] * c[1] * c[2] + s[0] * s[1] * s[2],
        ]
    )


def euler_poses(poses: Floats) -> Floats:
    """Return x, y, z, roll, pitch, yaw (n, 6) of poses (n, 7)."""
    x, y, z, w = poses[:, 3:].T
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return np.column_stack([poses[:, :3], roll, pitch, yaw])


def _split_2d(rows: Rows) -> tuple[Floats, Floats]:
    information = symmetric(rows.numbers[:, 3:][:, _BACK], 3)
    if not np.all(is_semidefinite(information)):
        by_rows = symmetric(rows.numbers[:, 3:], 3)
        if np.all(is_semidefinite(by_rows)):
            rows.notes.append(
                "EDGE2: information taken in the order I11 I12 I13 I22 I23 I33; in TORO's it would "
                "have negative eigenvalues"
            )
            return rows.numbers[:, :3], by_rows
    return rows.numbers[:, :3], information


def _split_3d(rows: Rows) -> tuple[Floats, Floats]:
    # Roll, pitch and yaw are twice the vector part of the quaternion, to first order.
    double = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    information = symmetric(rows.numbers[:, 6:], 6) * np.outer(double, double)
    return quaternion_poses(rows.numbers[:, :6]), information


VERTEX2: Final = variable_tag(_SE2, SE2, lambda rows: rows.numbers)
EDGE2: Final = factor_tag((*_SE2, "I11", "I12", "I22", "I33", "I13", "I23"), BETWEEN_2D, _split_2d)
TAGS: Final[dict[str, Tag]] = {
    "VERTEX2": VERTEX2,
    "EDGE2": EDGE2,
    "VERTEX3": variable_tag(_SE3, SE3, lambda rows: quaternion_poses(rows.numbers)),
    "EDGE3": factor_tag(
        (*_SE3, *triangle(6)),
        BETWEEN_3D,
        _split_3d,
        tuple(map(repr, upper(np.eye(6)[None])[0].tolist())),
    ),
}


def edge2_lines(file: GraphFile, block: FactorBlock) -> Iterator[str]:
    """Return the lines of measured poses in the plane."""
    numbers = np.hstack([block.measurements, upper(block.information)[:, _ORDER]])
    return lines_of("EDGE2", ids_of(file, block), numbers)


def _factor_lines(file: GraphFile, block: FactorBlock) -> Iterable[str] | None:
    if block.kind is BETWEEN_2D:
        return edge2_lines(file, block)
    if block.kind is not BETWEEN_3D:
        return None
    half = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
    information = upper(block.information * np.outer(half, half))
    return lines_of(
        "EDGE3", ids_of(file, block), np.hstack([euler_poses(block.measurements), information])
    )


def _lines(path: Path, file: GraphFile) -> list[str]:
    """Return the lines of a graph."""
    text: list[str] = []
    gone, kept = file.merged.T
    for kind, ids in file.graph.ids.items():
        if not kind.is_pose:
            raise GraphFormatError(f"{path}: TORO has no points")
        names = np.concatenate([ids, gone])
        rows = np.concatenate([np.arange(len(ids)), np.searchsorted(ids, kept)])
        poses = file.values[kind][rows]
        tag, numbers = ("VERTEX2", poses) if kind is SE2 else ("VERTEX3", euler_poses(poses))
        text += lines_of(tag, names[:, None], numbers)
    text += factor_lines(path, file, "TORO", lambda block: _factor_lines(file, block))
    text += [f"EQUIV {a} {b}" for a, b in file.merged[:, ::-1].tolist()]
    return text


TORO: Final = tagged_format("TORO", ".graph", TAGS, _lines, merge="EQUIV")
