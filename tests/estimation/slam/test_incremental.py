"""Incremental smoothing: at each step what a dense solution gives; on public graphs the optimum."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.graphs import city
from robotctl.estimation.slam.equations import NormalEquations
from robotctl.estimation.slam.factors.registry import FACTORS
from robotctl.estimation.slam.graph.factor import FactorBlock
from robotctl.estimation.slam.graph.factor_graph import FactorGraph
from robotctl.estimation.slam.graph.variables import POINT2, SE2
from robotctl.estimation.slam.incremental import smoother as module
from robotctl.estimation.slam.incremental.smoother import IncrementalSmoother, SmootherConfig
from robotctl.estimation.slam.solvers.problem import Problem, gauge
from robotctl.estimation.slam.solvers.registry import SOLVERS
from robotctl.estimation.slam.start.registry import start_values
from robotctl.logs.graphs.graph_files import read_graph

pytestmark = pytest.mark.timeout(600)  # the first of them compiles


class Drive:
    """Random poses, links and sightings, given to a smoother one by one."""

    def __init__(self, rng, config):
        self.rng = rng
        self.smoother = IncrementalSmoother(config)
        self.values = {SE2: [], POINT2: []}
        self.numbers = {SE2: [], POINT2: []}
        self.added = []  # kind, rows, measurement, information, number of the factor

    def variable(self, kind):
        value = self.rng.normal(0.0, 2.0, kind.size)
        self.values[kind].append(value)
        self.numbers[kind].append(self.smoother.variable(kind, value))

    def factor(self, name, *rows):
        kind = FACTORS[name]
        half = self.rng.normal(0.0, 1.0, (kind.size, kind.size))
        information = half @ half.T + np.eye(kind.size)
        z = self.rng.normal(0.0, 1.0, kind.measurement)
        numbers = [self.numbers[v][row] for v, row in zip(kind.variables, rows, strict=True)]
        number = self.smoother.factor(kind, numbers, z, information)
        self.added.append((kind, rows, z, information, number))

    def step(self):
        pose = len(self.values[SE2])
        self.variable(SE2)
        if pose == 0:
            self.factor("prior_2d", 0)
        else:
            self.factor("between_2d", pose - 1, pose)
        if pose > 1 and self.rng.random() < 0.4:
            self.factor("between_2d", int(self.rng.integers(0, pose - 1)), pose)
        for _ in range(self.rng.integers(0, 3)):
            if not self.values[POINT2] or self.rng.random() < 0.3:
                self.variable(POINT2)
            self.factor("seen_2d", pose, int(self.rng.integers(0, len(self.values[POINT2]))))
        # A point that is there must be held: its first sighting may have gone to another.
        for row in range(len(self.values[POINT2])):
            if not any(k is FACTORS["seen_2d"] and r[1] == row for k, r, *_ in self.added):
                self.factor("seen_2d", pose, row)

    def wanted(self):
        """Return the values that one dense Gauss-Newton step gives."""
        blocks = []
        for kind in {each[0] for each in self.added}:
            mine = [each for each in self.added if each[0] is kind]
            rows = np.array([each[1] for each in mine])
            columns = tuple(np.ascontiguousarray(rows[:, k]) for k in range(rows.shape[1]))
            z, information = (np.array([each[k] for each in mine]) for k in (2, 3))
            blocks.append(FactorBlock(kind, columns, z, information))
        ids = {kind: np.arange(len(each)) for kind, each in self.values.items() if each}
        values = {kind: np.array(self.values[kind]) for kind in ids}
        equations = NormalEquations(FactorGraph(ids, tuple(blocks)), [])
        equations.assemble(equations.linearise(values))
        assert equations.factorise() is None
        moved = equations.retract(values, equations.solve())
        dense = np.linalg.inv(np.array([equations.product(e) for e in np.eye(equations.total)]))
        begins = {kind: equations.columns[equations.graph.first(kind) + np.arange(len(each))] for kind, each in ids.items()}  # fmt: skip # noqa: E501
        return moved, {kind: [dense[b : b + kind.dof, b : b + kind.dof] for b in begins[kind]] for kind in ids}  # fmt: skip # noqa: E501

    def check(self):
        values, covariances = self.wanted()
        for kind, wanted in values.items():
            off = self.smoother.estimates(kind) - wanted
            if kind is SE2:
                off[:, 2] = np.sin(off[:, 2])
            np.testing.assert_allclose(off, 0.0, atol=1e-6)
            for number, covariance in zip(self.numbers[kind], covariances[kind], strict=True):
                found = self.smoother.covariance(number)
                np.testing.assert_allclose(found, covariance, atol=1e-6 * np.abs(covariance).max())


@pytest.mark.parametrize("renewal", [0.0, np.inf])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_each_step_gives_what_all_factors_at_once_give_also_after_some_were_removed(seed, renewal):
    rng = np.random.default_rng(seed)
    drive = Drive(rng, SmootherConfig(relinearise=np.inf, wildfire=0.0, renewal=renewal))
    for _ in range(12):
        drive.step()
        drive.smoother.update()
        drive.check()
    loops = [each for each in drive.added if each[0] is FACTORS["between_2d"] and each[1][1] - each[1][0] > 1]  # fmt: skip # noqa: E501
    for each in loops[:2]:
        drive.smoother.remove(each[4])
        drive.added.remove(each)
        drive.smoother.update()
        drive.check()


def test_a_tree_that_is_large_is_renewed_only_when_many_loops_are_held(monkeypatch):
    (block,) = city(600, 700).graph.blocks
    count, renewals = 600, []
    renew = module.renew
    monkeypatch.setattr(module, "renew", lambda *a: (renewals.append(1), renew(*a))[1])
    smoother = IncrementalSmoother(SmootherConfig(relinearise=np.inf, wildfire=0.0, renewal=0.0))
    exact = IncrementalSmoother(SmootherConfig(relinearise=np.inf, wildfire=0.0, renewal=np.inf))
    latest = np.maximum(*block.variables)
    for pose in range(count):
        value = np.zeros(3)
        if pose:
            at, z = smoother.estimate(pose - 1), block.measurements[pose - 1]
            c, s = np.cos(at[2]), np.sin(at[2])
            value = at + np.array([c * z[0] - s * z[1], s * z[0] + c * z[1], z[2]])
        for each in (smoother, exact):
            each.variable(SE2, value, fixed=pose == 0)
            for row in np.flatnonzero(latest == pose):
                ends = [int(variables[row]) for variables in block.variables]
                each.factor(block.kind, ends, block.measurements[row], block.information[row])
        before = len(renewals)
        smoother.update()
        own = len(renewals) - before
        exact.update()
        del renewals[before + own :]
        if pose % 50 == 49:
            off = smoother.estimates(SE2) - exact.estimates(SE2)
            np.testing.assert_allclose(np.sin(off[:, 2]), 0.0, atol=1e-8)
            np.testing.assert_allclose(off[:, :2], 0.0, atol=1e-8)
    assert 2 <= len(renewals) <= 6  # 101 loops of 3 rows, of which 128 are held


@pytest.mark.recordings("posegraph")
@pytest.mark.parametrize(
    ("name", "optimum"), [("intel", 45.00470), ("CSAIL", 40.55513), ("MIT", 41.16327)]
)
def test_public_graphs_come_to_their_optimum_pose_by_pose(recordings, name, optimum):
    file = read_graph(recordings / "posegraph" / f"{name}.g2o")
    fixed = gauge(file.graph)
    start = start_values(file.graph, file.values, file.known, fixed, "odometry")
    steps = []
    solution = SOLVERS["isam"](
        Problem(file.graph, start, fixed), lambda what, done, _: steps.append((what, done))
    )
    assert steps[-1] == ("step", len(file.graph.ids[SE2]))
    assert solution.chi2[-1] == pytest.approx(optimum, rel=1e-4)


def test_a_smoother_does_not_mind_what_nothing_determines():
    smoother = IncrementalSmoother()
    first = smoother.variable(SE2, np.zeros(3), fixed=True)
    far = smoother.variable(POINT2, np.array([3.0, 1.0]))
    smoother.factor(FACTORS["bearing"], (first, far), np.array([0.3]), np.eye(1))
    smoother.update()
    assert np.all(np.isfinite(smoother.estimates(POINT2)))
    lonely = smoother.variable(SE2, np.array([1.0, 2.0, 3.0]))
    smoother.update()
    np.testing.assert_allclose(smoother.estimate(lonely), (1.0, 2.0, 3.0))
