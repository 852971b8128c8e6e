"""The optimum of a graph of a file, and its figures: the work of `robotctl optimise`."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri  # type: ignore[import-untyped]

from robotctl.errors import ConfigError
from robotctl.estimation.slam.equations import GraphError
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values, chi2_of, chosen
from robotctl.estimation.slam.marginals import factored, marginals
from robotctl.estimation.slam.robust.kernels import KERNELS
from robotctl.estimation.slam.robust.robust_cost import OFF
from robotctl.estimation.slam.solvers.anchors import Anchor, anchors
from robotctl.estimation.slam.solvers.incremental import incremental
from robotctl.estimation.slam.solvers.problem import Problem, Solution, gauge
from robotctl.estimation.slam.solvers.registry import CONSISTENT, IN_ORDER, SOLVERS
from robotctl.estimation.slam.start.registry import STARTS, start_values
from robotctl.logs.graphs.graph_files import format_of, read_graph
from robotctl.logs.graphs.graph_format import GraphFile
from robotctl.logs.graphs.tagged_text import id_of
from robotctl.toml_source import nearest
from robotctl.workbench.graphs.options import OptimiseOptions

GRADUATED: Final = "gnc"
_SUSPICIOUS: Final = 4.0
"""Share of chi2 to degrees of freedom from which on the noise is twice as large as stated."""
_BY_CHANCE: Final = 1e-6
_NOT_CONVERGED: Final = {
    "ekf": "a filter does not go back to what has left its state; try --solver isam or lm",
    "isam": "a further step would lower chi2; try --solver lm",
}
"""Remarks on solvers that go pose by pose, by their names."""


@dataclass(frozen=True, slots=True, eq=False)
class OptimiseResult:
    """The optimum, with what led there.

    Parameters
    ----------
    options, file
        What was asked for.
    start
        Values that the optimisation began with.
    fixed
        Numbers of the variables that keep their values.
    solution
        What the solver found.
    time_ms
        Of each stage [ms].
    steps_ms
        Of each step of a solver that goes step by step [ms]; else empty.
    covariances
        Of the variables asked for, by name.
    course
        The values at the start and after each iteration, if they were asked for.
    """

    options: OptimiseOptions
    file: GraphFile
    start: Values
    fixed: NDArray[np.int64]
    solution: Solution
    time_ms: dict[str, float]
    steps_ms: list[float]
    covariances: dict[str, NDArray[np.float64]]
    course: list[Values]

    @property
    def graph(self) -> FactorGraph:
        """The graph."""
        return self.file.graph

    def switched_off(self) -> list[NDArray[np.bool_]]:
        """Return of each block which factors the robust kernel left next to nothing of, (n,)."""
        return [weights < OFF for weights in self.solution.weights]

    def held(self) -> list[Anchor]:
        """Return the directions that nothing determines, as the solver held them."""
        return anchors(self.graph, self.solution.values, self.fixed)

    def surplus(self, kept: FactorGraph) -> int:
        """Return by how much the measured numbers of a graph outnumber the unknown ones."""
        told = sum(
            int(np.count_nonzero(np.diagonal(block.information, axis1=1, axis2=2)))
            for block in kept.blocks
        )
        held = sum(len(anchor.coordinates) for anchor in self.held())
        dof = self.graph.dof()
        return told - int(dof.sum() - dof[self.fixed].sum()) + held

    def report(self) -> dict[str, Any]:
        """Return the figures; chi2 as g2o reports it."""
        off = self.switched_off()
        graph = self.graph
        rest = chosen(graph, [~mask for mask in off])
        kept = chi2_of(rest, self.solution.values)
        names = [
            " - ".join(graph.name(int(each)) for each in ends)
            for block, mask in zip(graph.blocks, off, strict=True)
            for ends in np.column_stack(graph.numbers(block))[mask]
        ]
        report: dict[str, Any] = {
            "chi2_initial": chi2_of(graph, self.start),
            "chi2_final": chi2_of(graph, self.solution.values),
            "chi2_kept": kept,
            "degrees_of_freedom": self.surplus(rest),
            "iterations": len(self.solution.chi2) - 1,
            "converged": self.solution.is_converged,
            "time_ms": {name: round(each, 3) for name, each in self.time_ms.items()},
            "vertices": graph.size,
            "edges": graph.factors,
            "connected_components": int(graph.components().max(initial=-1)) + 1,
            "fixed": [graph.name(int(each)) for each in self.fixed],
            "held": [each.name(graph) for each in self.held()],
            "notes": list(self.file.notes),
            "switched_off": len(names),
            "switched_off_factors": names,
        }
        if self.solution.rounds:
            report["rounds"] = self.solution.rounds
            report["left_sigma"] = self.solution.left_sigma
        if self.steps_ms:
            report["step_ms"] = {
                "mean": round(float(np.mean(self.steps_ms)), 4),
                "p99": round(float(np.percentile(self.steps_ms, 99)), 4),
                "max": round(float(np.max(self.steps_ms)), 4),
            }
        if self.covariances:
            report["marginals"] = {name: P.tolist() for name, P in self.covariances.items()}
        report["advice"] = advice(self.options, report)
        return report


@dataclass(slots=True)
class _Clock:
    """The times of stages and steps, as the solver tells of them."""

    tell: Callable[[str, int, int], None]
    now_s: float = field(default_factory=time.perf_counter)
    stages: dict[str, float] = field(default_factory=dict)
    steps: list[float] = field(default_factory=list)

    def lap(self, stage: str) -> float:
        """Add the time since the last lap to a stage [ms]."""
        now_s = time.perf_counter()
        spent = 1e3 * (now_s - self.now_s)
        self.stages[stage] = self.stages.get(stage, 0.0) + spent
        self.now_s = now_s
        return spent

    def __call__(self, what: str, done: int, total: int) -> None:
        """Be told by a solver."""
        spent = self.lap("order" if what == "order" else "optimise")
        if what == "step":
            self.steps.append(spent)
        if what != "order":
            self.tell(what, done, total)
            self.now_s = time.perf_counter()


def optimise(
    options: OptimiseOptions, tell: Callable[[str, int, int], None] = lambda *_: None
) -> OptimiseResult:
    """Read a graph and find its optimum.

    Raises
    ------
    ConfigError
        If a file or a name is wrong, or the solver has no robust kernels.
    GraphError
        If the factors do not determine all variables.
    """
    options = _checked(options)
    clock = _Clock(tell)
    begin_s = clock.now_s
    file = read_graph(options.graph, clip_indefinite=options.clip_indefinite)
    clock.lap("parse")
    wanted = {name: variable(file.graph, name) for name in options.marginals}
    fixed = gauge(file.graph, file.fixed)
    start = start_values(file.graph, file.values, file.known, fixed, options.init)
    clock.lap("start")
    problem = _problem(options, file.graph, start, fixed)
    course: list[Values] = []
    if options.keeps_course:
        problem = replace(problem, watch=lambda values: course.append(_copy(values)))
    if options.robust == CONSISTENT and options.solver not in IN_ORDER:
        first = incremental(problem, clock)
        clock.steps.clear()
        problem = replace(problem, start=first.values, kernel=None, weights=first.weights)
    solution = SOLVERS[options.solver](problem, clock)
    clock.lap("optimise")
    covariances = {}
    if wanted:
        equations = factored(file.graph, solution.values, fixed, solution.weights)
        found = marginals(equations, list(wanted.values()))
        covariances = dict(zip(wanted, found, strict=True))
        clock.lap("marginals")
    times = {name: clock.stages.get(name, 0.0) for name in ("parse", "start", "order", "optimise")}
    if wanted:
        times["marginals"] = clock.stages["marginals"]
    times["total"] = 1e3 * (time.perf_counter() - begin_s)
    return OptimiseResult(
        options, file, start, fixed, solution, times, clock.steps, covariances, course
    )


def _checked(options: OptimiseOptions) -> OptimiseOptions:
    """Return options whose names exist and go together, with a start; raises `ConfigError`."""
    if not options.init:
        goes_along = options.robust or options.solver in IN_ORDER
        options = replace(options, init="odometry" if goes_along else "chordal")
    for option, name, names in (
        ("--solver", options.solver, SOLVERS),
        ("--init", options.init, STARTS),
        *((("--robust", options.robust, KERNELS),) if options.robust else ()),
    ):
        if name not in names:
            raise ConfigError(f"{option} {name}: unknown{nearest(name, list(names))}")
    if options.robust and options.solver == "ekf":
        raise ConfigError("--robust works with all solvers but ekf, which cannot take back a loop")
    if options.robust not in ("", CONSISTENT) and options.solver in IN_ORDER:
        raise ConfigError(
            f"--robust {options.robust} does not work with {options.solver}; allowed: {CONSISTENT}"
        )
    if options.keeps_course and options.solver in IN_ORDER:
        whole = ", ".join(name for name in SOLVERS if name not in IN_ORDER)
        raise ConfigError(f"--animate works with {whole}; {options.solver} adds pose after pose")
    return options


def _problem(
    options: OptimiseOptions, graph: FactorGraph, start: Values, fixed: NDArray[np.int64]
) -> Problem:
    """Return the problem to solve.

    Raises
    ------
    GraphError
        If the start is beyond all bounds: far motions, one upon the other.
    """
    kernel = KERNELS[options.robust] if options.robust else None
    try:
        return Problem(graph, start, fixed, kernel, options.robust == GRADUATED)
    except ValueError as error:
        raise GraphError(f"{options.graph}: --init {options.init}: {error}") from error


def _copy(values: Values) -> Values:
    return {kind: numbers.copy() for kind, numbers in values.items()}


def variable(graph: FactorGraph, name: str) -> int:
    """Return the number of the variable that people call `name`: 12, or l12 for a point.

    Raises
    ------
    ConfigError
        If there is none.
    """
    word = name.removeprefix("l")
    number = id_of(word)
    if number is not None:
        for kind, ids in graph.ids.items():
            row = int(np.searchsorted(ids, number))
            if (word == name or not kind.is_pose) and row < len(ids) and ids[row] == number:
                return graph.first(kind) + row
    ids = np.concatenate(list(graph.ids.values()))
    raise ConfigError(
        f"--marginals {name}: there is no such variable; ids go from {ids.min()} to {ids.max()}"
    )


def advice(options: OptimiseOptions, figures: dict[str, Any]) -> str:
    """Return what to try where a result is doubtful; empty where it is not.

    Parameters
    ----------
    options
        What was asked for.
    figures
        The report.
    """
    if not figures["converged"]:
        return _NOT_CONVERGED.get(options.solver, "try another --init, or --robust")
    count, chi2 = figures["degrees_of_freedom"], figures["chi2_kept"]
    if count < 1 or chi2 < max(_SUSPICIOUS * count, float(chdtri(count, _BY_CHANCE))):
        return ""
    others = [] if options.solver == "isam" else ["--solver isam (it follows the drive)"]
    others += [] if options.robust else ["--robust geman-mcclure (loops may be false)"]
    return (
        f"chi2 is {chi2 / count:.3g} times the degrees of freedom ({count}), with the noise that "
        "the file states it would be about once: a local minimum, wrong measurements, or too large "
        f"information; try {' or '.join(others) or 'another --init'}"
    )


def write_graph(result: OptimiseResult, file: Path) -> None:
    """Write the graph with the values found, in the format that the suffix says."""
    found = {kind: np.ones(len(ids), np.bool_) for kind, ids in result.graph.ids.items()}
    optimum = replace(result.file, values=result.solution.values, known=found)
    format_of(file).write(file, optimum)


def write_report(result: OptimiseResult, file: Path) -> None:
    """Write the figures as JSON."""
    file.write_text(json.dumps(result.report(), indent=2) + "\n", encoding="utf-8")
