"""Factor graphs beside GTSAM on the same files and starts, in turn, by processor time.

GTSAM is measured where it is installed: `uv pip install gtsam`. ROBOTCTL_DATA names the folder with
`posegraph`. chi2 is g2o's for both; each begins at the same poses, and is asked for no more than
its default.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import machine
from robotctl.estimation.slam.beliefs.linear_graph import LinearGraph
from robotctl.estimation.slam.beliefs.schedules import Synchronous
from robotctl.estimation.slam.factors.between import BETWEEN_2D
from robotctl.estimation.slam.graph.builder import GraphBuilder
from robotctl.estimation.slam.graph.factor import FactorBlock
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values, chi2_of
from robotctl.estimation.slam.graph.variables import SE2
from robotctl.estimation.slam.marginals import factored, marginals
from robotctl.estimation.slam.robust.kernels import KERNELS
from robotctl.estimation.slam.solvers.problem import Problem, gauge, nobody
from robotctl.estimation.slam.solvers.registry import CONSISTENT, SOLVERS
from robotctl.estimation.slam.start.registry import start_values
from robotctl.logs.graphs.graph_files import format_of, read_graph
from robotctl.logs.graphs.graph_format import GraphFile

STARTS = {
    "M3500": "odometry",
    "intel": "odometry",
    "CSAIL": "odometry",
    "MIT": "chordal",
    "sphere2500": "odometry",
    "city": "chordal",
}
SHARES = (0.0, 0.1, 0.3, 0.5)
SEEDS = 2


def run(rounds: int, _seconds: float) -> None:
    """Measure all."""
    folder = Path(os.environ.get("ROBOTCTL_DATA", machine.ROOT.parent / "shared" / "data"))
    files = {"city": city(10_000, 20_000)}
    for name in STARTS:
        if (path := folder / "posegraph" / f"{name}.g2o").is_file():
            files[name] = read_graph(path)
        elif name != "city":
            machine.note(f"{name}: not measured, no {path}; set ROBOTCTL_DATA")
    _batch(files, rounds)
    _messages(files)
    _filter(files)
    _incremental(files)
    _false_loops(files)
    _memory(files["city"])


def start_of(file: GraphFile, init: str) -> tuple[Values, np.ndarray]:
    """Return where both begin, and what is fixed."""
    fixed = gauge(file.graph, file.fixed)
    return start_values(file.graph, file.values, file.known, fixed, init), fixed


def _batch(files: dict[str, GraphFile], rounds: int) -> None:
    rows = []
    for name, init in STARTS.items():
        if name not in files:
            continue
        file = files[name]
        odometry, fixed = start_of(file, "odometry")
        works: dict[str, Callable[[], tuple[Values, int]]] = {
            f"robotctl {solver}": lambda f=file, i=init, s=solver: _solve(f, i, s)
            for solver in ("lm", "gn")
        }
        if find_spec("gtsam"):
            works["GTSAM LM"] = _gtsam(file, odometry, int(fixed[0]))
        times: dict[str, list[float]] = {each: [] for each in works}
        found = {}
        for round_ in range(rounds + 1):  # the first is compiled
            for each, work in works.items():
                began = time.process_time()
                found[each] = work()
                if round_:
                    times[each].append(1e3 * (time.process_time() - began))
        for each, (values, iterations) in found.items():
            ratio = machine.median(times[each]) / machine.median(times["robotctl lm"])
            rows.append((f"{name}, {init if 'robotctl' in each else 'odometry'}", each,
                         machine.spread(times[each], 1), f"{ratio:.2f}", str(iterations or "-"),
                         f"{chi2_of(file.graph, values):.5f}"))  # fmt: skip
    if not find_spec("gtsam"):
        machine.note("GTSAM: not measured, it is not installed")
    heads = ("graph, start", "solver", "CPU ms", "times robotctl lm", "iterations", "chi2")
    machine.table("Batch, with start, order and analysis", heads, rows)


def _solve(file: GraphFile, init: str, solver: str) -> tuple[Values, int]:
    start, fixed = start_of(file, init)
    solution = SOLVERS[solver](Problem(file.graph, start, fixed), nobody)
    return solution.values, len(solution.chi2) - 1


def _gtsam(file: GraphFile, start: Values, fixed: int) -> Callable[[], tuple[Values, int]]:
    """Return GTSAM's work on a pose graph; making its factors is not part of it."""
    gtsam: Any = import_module("gtsam")
    kind = file.graph.poses
    (block,) = file.graph.blocks
    is_plane = kind is SE2
    # GTSAM has the rotation first in space; half the rotation vector is the quaternion's part.
    order = [0, 1, 2] if is_plane else [3, 4, 5, 0, 1, 2]
    scale = np.ones(3) if is_plane else np.array([0.5, 0.5, 0.5, 1.0, 1.0, 1.0])
    between = gtsam.BetweenFactorPose2 if is_plane else gtsam.BetweenFactorPose3

    def pose(row: np.ndarray) -> Any:
        if is_plane:
            return gtsam.Pose2(*row)
        x, y, z, w = row[3:]
        return gtsam.Pose3(gtsam.Rot3.Quaternion(w, x, y, z), row[:3])

    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for i, j, z, information in zip(
        *block.variables, block.measurements, block.information, strict=True
    ):
        own = information[np.ix_(order, order)] * np.outer(scale, scale)
        noise = gtsam.noiseModel.Gaussian.Information(own)
        graph.add(between(int(i), int(j), pose(z), noise))
    for i, row in enumerate(start[kind]):
        values.insert(i, pose(row))
    graph.add(gtsam.NonlinearEqualityPose2(fixed, pose(start[kind][fixed])) if is_plane else
              gtsam.NonlinearEqualityPose3(fixed, pose(start[kind][fixed])))  # fmt: skip

    def work() -> tuple[Values, int]:
        optimizer = gtsam.LevenbergMarquardtOptimizer(graph, values)
        found = optimizer.optimize()
        result = np.empty_like(start[kind])
        for i in range(len(result)):
            if is_plane:
                at = found.atPose2(i)
                result[i] = at.x(), at.y(), at.theta()
            else:
                at = found.atPose3(i)
                q = at.rotation().toQuaternion()
                result[i] = *at.translation(), q.x(), q.y(), q.z(), q.w()
        return {kind: result}, optimizer.iterations()

    return work


def _messages(files: dict[str, GraphFile]) -> None:
    """Belief propagation: rounds, time, distance from the batch mean, and how sure beliefs are."""
    rows = []
    for name in ("intel", "M3500", "CSAIL", "MIT"):
        if name not in files:
            continue
        graph = files[name].graph
        start, fixed = start_of(files[name], STARTS[name])
        problem = Problem(graph, start, fixed)
        batch = SOLVERS["lm"](problem, nobody).values
        SOLVERS["gbp"](Problem(graph, start, fixed, most_iterations=1), nobody)  # compiled
        began = time.process_time()
        found = SOLVERS["gbp"](problem, nobody)
        spent = time.process_time() - began
        off = np.linalg.norm((found.values[SE2] - batch[SE2])[:, :2], axis=1)
        shares = _claimed(graph, batch, fixed)
        rows.append((f"{name}, {STARTS[name]}", "yes" if found.is_converged else "no",
                     str(len(found.chi2) - 1), str(found.rounds), f"{spent:.2f}",
                     f"{100.0 * np.sqrt(np.mean(off**2)):.5f}",
                     *(f"{np.median(each):.3f} ({each.min():.3f}-{each.max():.3f})"
                       for each in shares)))  # fmt: skip
    heads = ("graph, start", "converged", "iterations", "rounds", "CPU s", "rms to batch, cm",
             "claimed / exact sigma of positions", "of rotations")  # fmt: skip
    machine.table("Belief propagation", heads, rows)


def _filter(files: dict[str, GraphFile]) -> None:
    """Extended Kalman filter: time of a pose, and how far off poses are."""
    rows = []
    for name in ("intel", "M3500", "CSAIL"):
        if name not in files:
            continue
        graph = files[name].graph
        start, fixed = start_of(files[name], "odometry")
        problem = Problem(graph, start, fixed)
        batch, marks = SOLVERS["lm"](problem, nobody).values[SE2], []
        SOLVERS["ekf"](problem, nobody)  # compiled
        found = SOLVERS["ekf"](problem, lambda *_, m=marks: m.append(time.process_time())).values
        times = 1e3 * np.diff(marks)
        off, before = (np.linalg.norm((each - batch)[:, :2], axis=1)
                       for each in (found[SE2], start[SE2]))  # fmt: skip
        rms = [float(np.sqrt(np.mean(each**2))) for each in (off, before)]
        rows.append((name, f"{np.mean(times):.2f}", f"{np.percentile(times, 99):.1f}",
                     f"{max(times):.1f}", f"{off[-1]:.4f} ({before[-1]:.2f})",
                     f"{rms[0]:.2f} ({rms[1]:.2f})"))  # fmt: skip
    heads = ("graph", "mean, CPU ms a pose", "p99", "max",
             "last pose to batch (odometry), m", "all, when they left, rms")  # fmt: skip
    machine.table("Extended Kalman filter", heads, rows)


def _claimed(graph: FactorGraph, values: Values, fixed: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return which share of exact standard deviations beliefs claim: positions and rotations."""
    schedule = Synchronous()
    linear = LinearGraph(graph, fixed, schedule, 0.1)
    linear.assemble(linear.linearise(values))
    linear.factorise()
    free = np.setdiff1d(np.arange(graph.size), fixed)
    claimed = np.linalg.inv(schedule.precisions(linear)[free])
    ones = [np.ones(len(block)) for block in graph.blocks]
    exact = np.array(marginals(factored(graph, values, fixed, ones), free.tolist()))
    traces = [np.trace(each[:, :2, :2], axis1=1, axis2=2) for each in (claimed, exact)]
    return np.sqrt(traces[0] / traces[1]), np.sqrt(claimed[:, 2, 2] / exact[:, 2, 2])


def _incremental(files: dict[str, GraphFile]) -> None:
    rows = []
    for name in ("intel", "M3500", "CSAIL", "MIT"):
        if name not in files:
            continue
        file = files[name]
        start, fixed = start_of(file, "odometry")
        works: dict[str, Callable[[], tuple[list[float], float]]] = {
            "robotctl isam": lambda f=file, s=start, x=fixed: _isam(f, s, x)
        }
        if find_spec("gtsam"):
            works["GTSAM ISAM2"] = lambda f=file, s=start: _isam2(f, s[SE2])
        for each, work in works.items():
            if each == "robotctl isam":
                work()  # compiled
            times, chi2 = work()
            p99 = np.percentile(times, 99)
            rows.append((name, each, f"{np.mean(times):.3f}", f"{p99:.2f}", f"{max(times):.1f}",
                         f"{chi2:.5f}", f"{len(times)} of {len(file.graph.ids[SE2])}"))  # fmt: skip
    heads = ("graph", "solver", "mean, CPU ms", "p99", "max", "chi2 after the last pose", "poses")
    machine.table("Incremental, an estimate after every pose", heads, rows)


def _isam(file: GraphFile, start: Values, fixed: np.ndarray) -> tuple[list[float], float]:
    marks = []
    solution = SOLVERS["isam"](
        Problem(file.graph, start, fixed), lambda *_: marks.append(time.process_time())
    )
    return (1e3 * np.diff(marks)).tolist(), solution.chi2[1]


def _isam2(file: GraphFile, odometry: np.ndarray) -> tuple[list[float], float]:
    """Return GTSAM's times, until it throws, and chi2 of its last estimate."""
    gtsam: Any = import_module("gtsam")
    (block,) = file.graph.blocks
    latest = np.maximum(*block.variables)
    order = np.argsort(latest, kind="stable")
    isam, times, at = gtsam.ISAM2(), [], 0
    estimate = None
    for pose in range(len(odometry)):
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        if pose == 0:
            graph.add(gtsam.NonlinearEqualityPose2(0, gtsam.Pose2(*odometry[0])))
            values.insert(0, gtsam.Pose2(*odometry[0]))
        while at < len(order) and latest[order[at]] == pose:
            k = order[at]
            i, j = (int(each[k]) for each in block.variables)
            z = gtsam.Pose2(*block.measurements[k])
            noise = gtsam.noiseModel.Gaussian.Information(block.information[k])
            graph.add(gtsam.BetweenFactorPose2(i, j, z, noise))
            if abs(i - j) == 1 and not values.exists(pose):
                before = estimate.atPose2(pose - 1)
                values.insert(pose, before.compose(z if j == pose else z.inverse()))
            at += 1
        began = time.process_time()
        try:
            isam.update(graph, values)
            estimate = isam.calculateEstimate()
        except RuntimeError as error:
            machine.note(f"GTSAM at pose {pose}: {str(error).strip().splitlines()[0]}")
            return times, float("nan")
        times.append(1e3 * (time.process_time() - began))
    found = np.array(
        [[p.x(), p.y(), p.theta()] for p in map(estimate.atPose2, range(len(odometry)))]
    )
    return times, chi2_of(file.graph, {SE2: found})


def false_loops(file: GraphFile, share: float, seed: int) -> GraphFile:
    """Return a graph with so many of its loops again, between poses drawn at random."""
    rng = np.random.default_rng(seed)
    (block,) = file.graph.blocks
    n = len(file.graph.ids[SE2])
    loops = np.flatnonzero(np.abs(block.variables[1] - block.variables[0]) != 1)
    added = round(share * len(loops))
    again = block.take(rng.choice(loops, added))
    ends = rng.integers(0, n, (2, added))
    ends[1] = np.where(np.abs(ends[0] - ends[1]) < 5, (ends[0] + n // 2) % n, ends[1])
    joined = FactorBlock(
        block.kind,
        tuple(np.concatenate([a, b]) for a, b in zip(block.variables, ends, strict=True)),
        np.concatenate([block.measurements, again.measurements]),
        np.concatenate([block.information, again.information]),
    )
    graph = FactorGraph(file.graph.ids, (joined,))
    return GraphFile(graph, file.values, file.known, file.fixed)


def _false_loops(files: dict[str, GraphFile]) -> None:
    rows = []
    for name in ("intel", "M3500"):
        if name not in files:
            continue
        clean = _solve(files[name], "odometry", "gn")[0][SE2]
        for share in SHARES:
            for method, solve in (("batch, gnc", _graduated), ("isam, consistent", _consistent)):
                errors, times, steps = [], [], []
                for seed in range(SEEDS):
                    false = false_loops(files[name], share, seed)
                    start, fixed = start_of(false, "odometry")
                    marks = [time.process_time()]
                    found = solve(false, start, fixed, marks)
                    times.append(time.process_time() - marks[0])
                    steps += np.diff(marks[2:]).tolist()
                    off = np.linalg.norm((found - clean)[:, :2], axis=1)
                    errors.append(float(np.sqrt(np.mean(off**2))))
                each = f"{1e3 * np.mean(steps):.1f} / {1e3 * np.percentile(steps, 99):.0f}"
                rows.append((name, f"{share:.0%}", method,
                             ", ".join(f"{each:.4f}" for each in errors), machine.spread(times, 2),
                             each if method != "batch, gnc" else "-"))  # fmt: skip
    heads = ("graph", "false loops", "method", "rms distance from the clean optimum, m", "CPU s",
             "a pose, ms: mean / p99")  # fmt: skip
    machine.table("False loops, from odometry", heads, rows)


def _graduated(file: GraphFile, start: Values, fixed: np.ndarray, marks: list[float]) -> np.ndarray:
    problem = Problem(file.graph, start, fixed, KERNELS["gnc"], True)
    return SOLVERS["gn"](problem, lambda *_: marks.append(time.process_time())).values[SE2]


def _consistent(
    file: GraphFile, start: Values, fixed: np.ndarray, marks: list[float]
) -> np.ndarray:
    problem = Problem(file.graph, start, fixed, KERNELS[CONSISTENT])
    return SOLVERS["isam"](problem, lambda *_: marks.append(time.process_time())).values[SE2]


def city(poses: int, edges: int, seed: int = 0) -> GraphFile:
    """Return a walk through the streets of a grid, with loops where it comes by again."""
    rng = np.random.default_rng(seed)
    sigma = np.array([0.02, 0.02, 0.005])
    information = np.diag(1.0 / sigma**2)
    at, heading, side = np.zeros(2, int), 0, 40
    cells: dict[tuple[int, int], list[int]] = {}
    truth = np.empty((poses, 3))
    pairs = [(k, k + 1) for k in range(poses - 1)]
    near = []
    for k in range(poses):
        truth[k] = (*at, heading * np.pi / 2)
        near += [(other, k) for other in cells.get(tuple(at), ()) if other < k - 10]
        cells.setdefault(tuple(at), []).append(k)
        if k % 5 == 4:
            heading = (heading + rng.choice([-1, 0, 1])) % 4
        step = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)][heading])
        while np.any(np.abs(at + step) > side // 2):
            heading = (heading + 1) % 4
            step = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)][heading])
        at = at + step
    chosen = rng.choice(len(near), edges - len(pairs), replace=False)
    pairs += [near[k] for k in sorted(chosen)]
    ids = np.array(pairs)
    a, b = truth[ids[:, 0]], truth[ids[:, 1]]
    z = BETWEEN_2D.residual(a, b, np.zeros_like(a)) + rng.normal(0.0, sigma, (len(ids), 3))
    builder = GraphBuilder()
    builder.factors(BETWEEN_2D, ids, z, np.tile(information, (len(ids), 1, 1)))
    return GraphFile(*builder.build(), np.empty(0, np.int64))


def _memory(file: GraphFile) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "city.g2o"
        format_of(path).write(path, file)
        for name, words in (("robotctl", ["-m", "robotctl", "optimise", str(path)]),):
            before = time.perf_counter()
            subprocess.run([sys.executable, *words], check=True, capture_output=True)
            spent = time.perf_counter() - before
            peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
            machine.note(f"{name} optimise, the city: {peak:.0f} MiB at most, {spent:.1f} s in all")
