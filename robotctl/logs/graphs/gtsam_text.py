"""GTSAM's text for the plane: odometry and landmarks, as its `load2D` reads.

ODOMETRY a b x y theta and the upper triangle of the covariance; LANDMARK pose point x y and that
of its covariance, in the frame of the pose; BR pose point bearing range and their standard
deviations; VERTEX2 and EDGE2 as TORO has them. Landmarks have numbers of their own. (From LANDMARK
GTSAM makes bearing and range, with a covariance guessed from the first number; here it is taken as
it stands.) https://github.com/borglab/gtsam/blob/develop/gtsam/slam/dataset.cpp
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Final

import numpy as np

from robotctl.estimation.slam.factors.between import BETWEEN_2D
from robotctl.estimation.slam.factors.landmarks import RANGE_BEARING, SEEN_2D
from robotctl.estimation.slam.graph.factor import FactorBlock, inverses, is_definite
from robotctl.estimation.slam.graph.variables import LARGEST, SE2, Floats, VariableKind
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
)
from robotctl.logs.graphs.toro import EDGE2, VERTEX2

_OWN: Final = frozenset({"ODOMETRY", "LANDMARK", "BR"})


def _informed(rows: Rows, triangles: Floats, size: int) -> Floats:
    """Return the information (n, size, size) of covariances, (n, ...) upper triangles by rows."""
    covariance = symmetric(triangles, size)
    rows.check(is_definite(covariance), "the covariance matrix is not positive definite")
    return _inverse(covariance)


def _inverse(matrices: Floats) -> Floats:
    """Return the inverses of symmetric matrices, symmetric to the last digit."""
    result = inverses(matrices)
    return 0.5 * (result + result.transpose(0, 2, 1))


def _odometry(rows: Rows) -> tuple[Floats, Floats]:
    return rows.numbers[:, :3], _informed(rows, rows.numbers[:, 3:], 3)


def _landmark(rows: Rows) -> tuple[Floats, Floats]:
    return rows.numbers[:, :2], _informed(rows, rows.numbers[:, 2:], 2)


def _bearing_range(rows: Rows) -> tuple[Floats, Floats]:
    sigma = rows.numbers[:, [3, 2]]
    rows.check(
        np.all(sigma >= 1.0 / np.sqrt(LARGEST), axis=1), "standard deviations above 0 are needed"
    )
    return rows.numbers[:, [1, 0]], np.eye(2) / sigma[:, None, :] ** 2


TAGS: Final[dict[str, Tag]] = {
    "VERTEX2": VERTEX2,
    "EDGE2": EDGE2,
    "ODOMETRY": factor_tag(("x", "y", "theta", *triangle(3, "C")), BETWEEN_2D, _odometry),
    "LANDMARK": factor_tag(("x", "y", *triangle(2, "C")), SEEN_2D, _landmark),
    "BR": factor_tag(
        ("bearing", "range", "sigma of the bearing", "sigma of the range"),
        RANGE_BEARING,
        _bearing_range,
    ),
}


def _factor_lines(path: Path, file: GraphFile, block: FactorBlock) -> Iterable[str] | None:
    ids, z, information = ids_of(file, block), block.measurements, block.information
    if block.kind not in (BETWEEN_2D, SEEN_2D, RANGE_BEARING):
        return None
    covariance = _inverse(information) if np.all(is_definite(information)) else -information
    # Rounding may bring a number beyond what is read.
    covariance = np.clip(covariance, -LARGEST, LARGEST)
    if not np.all(is_definite(covariance)):
        raise GraphFormatError(
            f"{path}: GTSAM's text has covariances, and none for {block.kind.name!r} whose "
            "information is singular; g2o has information"
        )
    if block.kind is RANGE_BEARING:
        if np.any(information[:, 0, 1]):
            return None
        sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        return lines_of("BR", ids, np.hstack([z[:, ::-1], sigma[:, ::-1]]))
    tag = "ODOMETRY" if block.kind is BETWEEN_2D else "LANDMARK"
    return lines_of(tag, ids, np.hstack([z, upper(covariance)]))


def _seen(file: GraphFile, kind: VariableKind) -> set[int]:
    """Return the rows of a kind that factors speak of."""
    return {
        row
        for block in file.graph.blocks
        for own, rows in zip(block.kind.variables, block.variables, strict=True)
        if own is kind
        for row in rows.tolist()
    }


def _lines(path: Path, file: GraphFile) -> list[str]:
    """Return the lines of a graph."""
    text: list[str] = []
    for kind, ids in file.graph.ids.items():
        if kind is SE2:
            text += lines_of("VERTEX2", ids[:, None], file.values[kind])
        elif kind.is_pose:
            raise GraphFormatError(f"{path}: GTSAM's text has no poses in space")
        else:
            unseen = len(ids) - len(_seen(file, kind))
            if unseen:
                raise GraphFormatError(
                    f"{path}: GTSAM's text has points only where something sees them, and nothing "
                    f"sees {unseen} of the graph's"
                )
    text += factor_lines(path, file, "GTSAM's text", lambda block: _factor_lines(path, file, block))
    return text


GTSAM: Final = tagged_format("GTSAM's text", ".txt", TAGS, _lines, own=_OWN)
