"""The optimum of a graph of a file, and its figures: the work of `robotctl optimize`."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from robotctl.errors import ConfigError
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values, chi2_of, chosen
from robotctl.estimation.slam.marginals import factored, marginals
from robotctl.estimation.slam.robust.kernels import KERNELS
from robotctl.estimation.slam.robust.robust_cost import OFF
from robotctl.estimation.slam.solvers.incremental import incremental
from robotctl.estimation.slam.solvers.problem import Problem, Solution, gauge
from robotctl.estimation.slam.solvers.registry import CONSISTENT, IN_ORDER, SOLVERS
from robotctl.estimation.slam.start.registry import STARTS, start_values
from robotctl.logs.graphs.graph_files import format_of, read_graph
from robotctl.logs.graphs.graph_format import GraphFile
from robotctl.toml_source import nearest

GRADUATED: Final = "gnc"


@dataclass(frozen=True, slots=True)
class OptimizeOptions:
    """The user's options.

    Parameters
    ----------
    graph
        A file of a graph.
    solver, robust, init
        Names of `SOLVERS`, `KERNELS` ("": none) and `STARTS`.
    marginals
        Ids of variables whose covariance is wanted; a point may have an l before its id.
    keeps_course
        Whether the values after each iteration are wanted.
    """

    graph: Path
    solver: str = "lm"
    robust: str = ""
    init: str = "chordal"
    marginals: tuple[str, ...] = ()
    keeps_course: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class OptimizeResult:
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

    options: OptimizeOptions
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

    def report(self) -> dict[str, Any]:
        """Return the figures; chi2 as g2o reports it."""
        off = self.switched_off()
        graph = self.graph
        kept = chi2_of(chosen(graph, [~mask for mask in off]), self.solution.values)
        names = [
            " - ".join(graph.name(int(each)) for each in ends)
            for block, mask in zip(graph.blocks, off, strict=True)
            for ends in np.column_stack(graph.numbers(block))[mask]
        ]
        report: dict[str, Any] = {
            "chi2_initial": chi2_of(graph, self.start),
            "chi2_final": chi2_of(graph, self.solution.values),
            "chi2_kept": kept,
            "iterations": len(self.solution.chi2) - 1,
            "converged": self.solution.is_converged,
            "time_ms": {name: round(each, 3) for name, each in self.time_ms.items()},
            "vertices": graph.size,
            "edges": graph.factors,
            "connected_components": int(graph.components().max(initial=-1)) + 1,
            "fixed": [graph.name(int(each)) for each in self.fixed],
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


def optimize(
    options: OptimizeOptions, tell: Callable[[str, int, int], None] = lambda *_: None
) -> OptimizeResult:
    """Read a graph and find its optimum.

    Raises
    ------
    ConfigError
        If a file or a name is wrong, or the solver has no robust kernels.
    GraphError
        If the factors do not determine all variables.
    """
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
    clock = _Clock(tell)
    begin_s = clock.now_s
    file = read_graph(options.graph)
    clock.lap("parse")
    wanted = {name: variable(file.graph, name) for name in options.marginals}
    fixed = gauge(file.graph, file.fixed)
    start = start_values(file.graph, file.values, file.known, fixed, options.init)
    clock.lap("start")
    kernel = KERNELS[options.robust] if options.robust else None
    problem = Problem(file.graph, start, fixed, kernel, options.robust == GRADUATED)
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
    return OptimizeResult(
        options, file, start, fixed, solution, times, clock.steps, covariances, course
    )


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
    if word.lstrip("-").isdigit():
        for kind, ids in graph.ids.items():
            row = int(np.searchsorted(ids, int(word)))
            if (word == name or not kind.is_pose) and row < len(ids) and ids[row] == int(word):
                return graph.first(kind) + row
    ids = np.concatenate(list(graph.ids.values()))
    raise ConfigError(
        f"--marginals {name}: there is no such variable; ids go from {ids.min()} to {ids.max()}"
    )


def write_graph(result: OptimizeResult, file: Path) -> None:
    """Write the graph with the values found, in the format that the suffix says."""
    found = {kind: np.ones(len(ids), np.bool_) for kind, ids in result.graph.ids.items()}
    optimum = GraphFile(result.graph, result.solution.values, found, result.file.fixed)
    format_of(file).write(file, optimum)


def write_report(result: OptimizeResult, file: Path) -> None:
    """Write the figures as JSON."""
    file.write_text(json.dumps(result.report(), indent=2) + "\n", encoding="utf-8")
