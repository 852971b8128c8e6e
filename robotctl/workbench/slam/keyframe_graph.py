"""The keyframes of a map as a factor graph."""

from __future__ import annotations

import numpy as np

from robotctl.estimation.slam.factors.between import BETWEEN_2D
from robotctl.estimation.slam.graph.builder import GraphBuilder
from robotctl.estimation.slam.graph.variables import SE2 as POSES
from robotctl.estimation.slam.keyframes.back_end import BackEnd
from robotctl.estimation.slam.robust.robust_cost import OFF
from robotctl.logs.graphs.graph_format import GraphFile


def graph_of(back_end: BackEnd) -> GraphFile:
    """Return the graph of the keyframes at the estimate, without links that are switched off."""
    build = GraphBuilder()
    build.variables(POSES, np.arange(len(back_end.poses)), back_end.poses)
    weights, links = np.array(back_end.weights), back_end.links
    kept = np.flatnonzero(weights >= OFF)
    if len(kept):
        build.factors(
            BETWEEN_2D,
            links.ends[kept].astype(np.int64),
            links.poses[kept],
            weights[kept, None, None] * back_end.counted_of(kept),
        )
    return GraphFile(*build.build(), np.empty(0, np.int64))
