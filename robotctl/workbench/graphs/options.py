"""Options of `robotctl optimise`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer


def _ids(text: str) -> tuple[str, ...]:
    """Return the ids of a list with commas."""
    return tuple(filter(None, text.replace(" ", "").split(",")))


@dataclass(frozen=True, slots=True)
class OptimiseOptions:
    """A graph, and how to solve it.

    Parameters
    ----------
    keeps_course
        Whether the values after each iteration are wanted.
    """

    graph: Annotated[Path, typer.Argument(help="A g2o, TORO or GTSAM file.", metavar="IN")]
    solver: Annotated[str, typer.Option(help="gn, lm, dogleg, isam, gbp or ekf.")] = "lm"
    robust: Annotated[
        str,
        typer.Option(
            metavar="KERNEL", help="consistent, huber, cauchy, geman-mcclure, dcs or gnc."
        ),
    ] = ""
    init: Annotated[str, typer.Option(help="odometry, tree, chordal or file.")] = ""
    clip_indefinite: Annotated[
        bool,
        typer.Option(
            "--clip-indefinite",
            help="Put 0 in place of negative eigenvalues of information matrices.",
        ),
    ] = False
    marginals: Annotated[
        tuple[str, ...],
        typer.Option(
            parser=_ids, metavar="ID,...", help="Covariances of these variables; l5 is a point."
        ),
    ] = ()
    keeps_course: bool = False
