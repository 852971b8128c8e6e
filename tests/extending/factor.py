"""The factor of docs/extending.md: headings of a compass hold a graph that odometry bends."""

import numpy as np
import pytest

from robotctl.estimation.slam.factors.registry import FACTORS
from robotctl.estimation.slam.graph.builder import GraphBuilder
from robotctl.estimation.slam.graph.variables import SE2
from robotctl.estimation.slam.solvers.problem import Problem, gauge, nobody
from robotctl.estimation.slam.solvers.registry import SOLVERS


def test_headings_straighten_a_drive_that_bends():
    n, builder = 20, GraphBuilder()
    links = np.column_stack([np.arange(n - 1), np.arange(1, n)])
    bent = np.tile([1.0, 0.0, 0.05], (n - 1, 1))
    builder.factors(FACTORS["between_2d"], links, bent, np.tile(np.eye(3), (n - 1, 1, 1)))
    headings = np.arange(n)[:, None]
    builder.factors(FACTORS["heading"], headings, np.zeros((n, 1)), np.full((n, 1, 1), 1e6))
    graph, values, _ = builder.build()
    for solver in ("gn", "lm", "dogleg"):
        found = SOLVERS[solver](Problem(graph, values, gauge(graph)), nobody).values[SE2]
        assert found[:, 1:] == pytest.approx(0.0, abs=1e-2)
        assert found[-1, 0] == pytest.approx(n - 1, abs=1e-2)
