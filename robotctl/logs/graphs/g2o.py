"""g2o's files: poses and points in the plane and in space, with full information matrices.

Format: https://github.com/RainerKuemmerle/g2o/wiki/File-Format. Quaternions are x, y, z, w. The
residuals of the factors are g2o's, so chi2 is what g2o reports.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Final

import numpy as np

from robotctl.estimation.slam.factors.between import BETWEEN_2D, BETWEEN_3D
from robotctl.estimation.slam.factors.landmarks import BEARING, RANGE, SEEN_2D
from robotctl.estimation.slam.factors.points_in_space import SEEN_3D
from robotctl.estimation.slam.factors.prior import (
    POSITION_2D,
    PRIOR_2D,
    PRIOR_3D,
    PRIOR_POINT_2D,
)
from robotctl.estimation.slam.graph.builder import GraphBuilder
from robotctl.estimation.slam.graph.factor import FactorBlock, FactorKind
from robotctl.estimation.slam.graph.variables import POINT2, POINT3, SE2, SE3, Floats
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

_ZERO: Final = 1e-6
"""Length below which a quaternion is none."""
_EXACT: Final = 1e-15
_SE2: Final = ("x", "y", "theta")
_SE3: Final = ("x", "y", "z", "qx", "qy", "qz", "qw")


def _normalised(rows: Rows) -> Floats:
    """Return poses (n, 7) whose quaternions have length 1."""
    length = np.linalg.norm(rows.numbers[:, 3:7], axis=1)
    rows.check(length > _ZERO, "the quaternion is 0; needed is one of length 1, as 0 0 0 1")
    poses = rows.numbers[:, :7].copy()
    # What is of length 1 to the last digit stays as it is written.
    off = np.abs(length - 1.0) > _EXACT
    poses[off, 3:] /= length[off, None]
    return poses


def _split(rows: Rows, size: int) -> tuple[Floats, Floats]:
    """Return measurements in the first numbers, information of `size` in the last."""
    behind = size * (size + 1) // 2
    numbers = _normalised(rows) if size == SE3.dof else rows.numbers[:, :-behind]
    return numbers, symmetric(rows.numbers[:, -behind:], size)


def _factor(kind: FactorKind, columns: tuple[str, ...]) -> Tag:
    size = kind.size
    return factor_tag((*columns, *triangle(size)), kind, lambda rows: _split(rows, size))


def _without_offset(kind: FactorKind, columns: tuple[str, ...]) -> Tag:
    """Return the tag of factors that name, as their first number, the place of a sensor."""
    size = kind.size

    def split(rows: Rows) -> tuple[Floats, Floats]:
        return _split(replace(rows, numbers=rows.numbers[:, 1:]), size)

    return factor_tag(("parameter id", *columns, *triangle(size)), kind, split)


def _offset(_: GraphBuilder, rows: Rows) -> None:
    rows.check(
        np.all(rows.numbers == [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], axis=1),
        "a sensor that is not at the origin of the pose is not supported",
    )


TAGS: Final[dict[str, Tag]] = {
    "VERTEX_SE2": variable_tag(_SE2, SE2, lambda rows: rows.numbers),
    "VERTEX_XY": variable_tag(_SE2[:2], POINT2, lambda rows: rows.numbers),
    "VERTEX_SE3:QUAT": variable_tag(_SE3, SE3, _normalised),
    "VERTEX_TRACKXYZ": variable_tag(_SE3[:3], POINT3, lambda rows: rows.numbers),
    "EDGE_SE2": _factor(BETWEEN_2D, _SE2),
    "EDGE_SE3:QUAT": _factor(BETWEEN_3D, _SE3),
    "EDGE_SE2_XY": _factor(SEEN_2D, _SE2[:2]),
    "EDGE_BEARING_SE2_XY": _factor(BEARING, ("bearing",)),
    "EDGE_RANGE_SE2_XY": _factor(RANGE, ("range",)),
    "EDGE_PRIOR_SE2": _factor(PRIOR_2D, _SE2),
    "EDGE_PRIOR_SE2_XY": _factor(POSITION_2D, _SE2[:2]),
    "EDGE_PRIOR_XY": _factor(PRIOR_POINT_2D, _SE2[:2]),
    "EDGE_SE3_PRIOR": _without_offset(PRIOR_3D, _SE3),
    "EDGE_SE3_TRACKXYZ": _without_offset(SEEN_3D, _SE3[:3]),
    "PARAMS_SE3OFFSET": Tag(1, _SE3, _offset),
}
"""All that is read."""

_VARIABLES: Final = {SE2: "VERTEX_SE2", POINT2: "VERTEX_XY", SE3: "VERTEX_SE3:QUAT", POINT3: "VERTEX_TRACKXYZ"}  # fmt: skip # noqa: E501
_FACTORS: Final = {
    BETWEEN_2D: "EDGE_SE2",
    BETWEEN_3D: "EDGE_SE3:QUAT",
    SEEN_2D: "EDGE_SE2_XY",
    BEARING: "EDGE_BEARING_SE2_XY",
    RANGE: "EDGE_RANGE_SE2_XY",
    PRIOR_2D: "EDGE_PRIOR_SE2",
    POSITION_2D: "EDGE_PRIOR_SE2_XY",
    PRIOR_POINT_2D: "EDGE_PRIOR_XY",
    PRIOR_3D: "EDGE_SE3_PRIOR",
    SEEN_3D: "EDGE_SE3_TRACKXYZ",
}
_WITH_OFFSET: Final = (PRIOR_3D, SEEN_3D)


def _lines(path: Path, file: GraphFile) -> Iterable[str]:
    """Return the lines of a graph."""
    text = []
    if any(block.kind in _WITH_OFFSET for block in file.graph.blocks):
        text.append("PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1")
    for kind, ids in file.graph.ids.items():
        text += lines_of(_VARIABLES[kind], ids[:, None], file.values[kind])
    for each in file.fixed:
        kind, row = file.graph.place(int(each))
        own = int(file.graph.ids[kind][row])
        if sum(own in ids for ids in file.graph.ids.values()) > 1:
            raise GraphFormatError(f"{path}: FIX {own}: a pose and a point have this id")
        text.append(f"FIX {own}")

    def lines(block: FactorBlock) -> Iterable[str] | None:
        if block.kind not in _FACTORS:
            return None
        ids = ids_of(file, block)
        if block.kind in _WITH_OFFSET:
            ids = np.column_stack([ids, np.zeros(len(ids), np.int64)])
        numbers = np.hstack([block.measurements, upper(block.information)])
        return lines_of(_FACTORS[block.kind], ids, numbers)

    return chain(text, factor_lines(path, file, "g2o", lines))


G2O: Final = tagged_format("g2o", ".g2o", TAGS, _lines, fix="FIX")
