"""EKF-style filtering as a solver: one joint Gaussian, that forgets what no factor returns to.

The extended Kalman filter over poses and points in the order of the poses (Smith, Self and
Cheeseman 1990; with earlier poses in the state: Leonard and Rikoski 2001). A pose or point is
marginalised out, and keeps its last estimate, once no later factor mentions it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from robotctl.estimation.kalman.growing_gaussian import GrowingGaussian
from robotctl.estimation.slam.equations import GraphError
from robotctl.estimation.slam.graph.factor import (
    ROUNDING,
    Ints,
    Linearised,
    inverses,
    is_definite,
    scaled,
)
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, chi2_of, values_of
from robotctl.estimation.slam.graph.variables import SE3, Floats, VariableKind
from robotctl.estimation.slam.incremental.placing import carried
from robotctl.estimation.slam.solvers.incremental import arrivals
from robotctl.estimation.slam.solvers.optimum import is_optimum
from robotctl.estimation.slam.solvers.problem import Problem, Solution, Tell, check_pairs, solver
from robotctl.estimation.slam.start.chordal import matrices
from robotctl.estimation.slam.start.twists import twist_increments

MOST_NUMBERS: Final = 6000
"""Maximum size of the state; its covariance then takes 144 MB."""
_LOST_M: Final = 100.0
_LOST_RAD: Final = 3.0
"""Standard deviations of a variable that no single factor places [m], [rad]."""
_SINGULAR: Final = 1e8
"""Condition of a Jacobian from which on a factor does not place a variable."""
_PLACING: Final = 10
"""Maximum steps of Newton's method that place a variable."""


def _in_space(kind: VariableKind, values: Floats) -> tuple[Floats, Floats]:
    """Return positions (n, 3) and rotation matrices (n, 3, 3) of poses, those of the plane too."""
    if kind is SE3:
        return values[:, :3], matrices(values[:, 3:])
    R, c, s = np.tile(np.eye(3), (len(values), 1, 1)), np.cos(values[:, 2]), np.sin(values[:, 2])
    R[:, 0, 0], R[:, 0, 1], R[:, 1, 0], R[:, 1, 1] = c, -s, s, c
    return np.column_stack([values[:, :2], np.zeros(len(values))]), R


def _local(kind: VariableKind, value: Floats) -> Floats:
    """Return the increment of a pose by its error, (dof, dof): the adjoint of its inverse."""
    result: Floats = twist_increments(kind, value[None], np.zeros(kind.positions))[0]
    return result


def moved(kind: VariableKind, values: Floats, errors: Floats) -> Floats:
    """Return poses (n, size) moved by errors (n, dof): Exp(error) T."""
    t, R = _in_space(kind, values)
    twists = np.zeros((len(values), 6))
    twists[:, range(6) if kind is SE3 else [0, 1, 5]] = errors
    u, w = twists[:, :3], twists[:, 3:]
    angle = np.maximum(np.linalg.norm(w, axis=1), 1e-6)[:, None]
    a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle**2
    wu, wt = np.cross(w, u), np.cross(w, t)
    away = u + b * wu + (1.0 - a) / angle**2 * np.cross(w, wu) + a * wt + b * np.cross(w, wt)
    local = np.einsum("nji,nkj->nki", R, np.stack([away, w], axis=1)).reshape(-1, 6)
    return kind.retract(values, local if kind is SE3 else np.ascontiguousarray(local[:, [0, 1, 5]]))


def departures(graph: FactorGraph, steps: list[list[tuple[int, int]]]) -> Ints:
    """Return after which step no factor mentions a variable any more, (n,); -1: none ever does."""
    last = np.full(graph.size, -1, np.int64)
    numbers = [np.column_stack(graph.numbers(block)) for block in graph.blocks]
    for step, factors in enumerate(steps):
        for index, row in factors:
            last[numbers[index][row]] = step
    return last


class GraphFilter:
    """The state: estimates of all variables, and the covariance of those that are in it.

    The error of a pose is a twist in the world, Exp(error) T: x, y, z [m] of what is at the origin,
    then the rotation [rad]. So a turned drive turns as a whole, whatever it looks like now (Barrau
    and Bonnabel, The invariant extended Kalman filter, IEEE Trans. Automatic Control 62, 2017).

    Parameters
    ----------
    problem
        Its start is used for fixed variables, and where no single factor places one.
    """

    def __init__(self, problem: Problem) -> None:
        self.graph = problem.graph
        self.start = problem.start
        self.values = {kind: each.copy() for kind, each in problem.start.items()}
        self.members: list[int] = []
        """Numbers of the variables in the state."""
        self._dof = self.graph.dof()
        self._D = int(self._dof.max(initial=1))
        self._errors = GrowingGaussian(np.empty(0), np.empty((0, 0)))
        self._is_known = np.zeros(self.graph.size, np.bool_)
        self._is_known[problem.fixed] = True
        self._is_definite = [is_definite(block.information) for block in self.graph.blocks]
        self._kinds = {kind: self.graph.first(kind) for kind in self.graph.ids}
        self._of = np.repeat(np.arange(len(self._kinds)), [len(x) for x in self.graph.ids.values()])

    def covariance(self, number: int) -> Floats:
        """Return the covariance (dof, dof) of a variable in the state, in its tangent space."""
        own, (kind, row) = self._slot(number), self._place(number)
        P = self._errors.block(own[: kind.dof])
        if not kind.is_pose:
            return P
        G = _local(kind, self.values[kind][row])
        return G @ P @ G.T

    def _place(self, number: int) -> tuple[VariableKind, int]:
        """Return the kind of a variable, and its row among the values of that kind."""
        kind = list(self._kinds)[self._of[number]]
        return kind, number - self._kinds[kind]

    def _slot(self, number: int) -> Ints:
        """Return the columns of a variable in the state, (D,)."""
        return self.members.index(number) * self._D + np.arange(self._D)

    def step(self, factors: list[tuple[int, int]]) -> None:
        """Take in factors: block and row of each; those first that place something."""
        waiting, count = list(factors), -1
        while len(waiting) != count:
            count = len(waiting)
            waiting = [each for each in waiting if not self._is_placed_by(*each)]
        for index, row in waiting:
            for numbers in self.graph.numbers(self.graph.blocks[index]):
                if not self._is_known[numbers[row]]:
                    self._guess(int(numbers[row]))
            self._update(index, row)

    def _linearised(self, index: int, row: int) -> tuple[Floats, list[Floats], Floats]:
        """Return residual (m,), Jacobians (m, D) by errors, and covariance of a factor.

        Of a factor with singular information these are the m directions of which it says anything.
        """
        block = self.graph.blocks[index].take(np.array([row]))
        at = Linearised.empty(block)
        values = values_of(block, self.values)
        at.fill(block, values)
        jacobians = []
        for kind, value, own in zip(block.kind.variables, values, at.jacobians, strict=True):
            J = np.zeros((block.kind.size, self._D))
            J[:, : kind.dof] = own[0] @ _local(kind, value[0]) if kind.is_pose else own[0]
            jacobians.append(J)
        if self._is_definite[index][row]:
            return at.residuals[0], jacobians, inverses(block.information)[0]
        (own,), (roots,) = scaled(block.information)
        squares, directions = np.linalg.eigh(own)
        told = squares > ROUNDING
        rows = directions[:, told].T * roots
        R = np.diag(1.0 / squares[told])
        return rows @ at.residuals[0], [rows @ J for J in jacobians], R

    def _is_placed_by(self, index: int, row: int) -> bool:
        """Place the only unknown variable of a factor, if it says all of it; return whether."""
        block = self.graph.blocks[index]
        ends = [int(numbers[row]) for numbers in self.graph.numbers(block)]
        unknown = [slot for slot, number in enumerate(ends) if not self._is_known[number]]
        if len(unknown) != 1 or block.kind.size != self._dof[ends[unknown[0]]]:
            return False
        if not self._is_definite[index][row]:
            return False
        (new,) = unknown
        kind, at = self._place(ends[new])
        others = [each for slot, each in enumerate(ends) if slot != new]
        self._carry(ends[new], others)
        for _ in range(_PLACING):
            r, jacobians, R = self._linearised(index, row)
            J = jacobians[new][:, : kind.dof]
            if np.linalg.cond(J) > _SINGULAR:
                return False
            error = np.zeros((1, kind.dof))
            error[0] = -np.linalg.solve(J, r)
            if np.max(np.abs(error)) < 1e-12:
                break
            self._move(kind, np.array([at]), error)
        inverse = np.linalg.inv(J).astype(np.float64)
        A = -inverse @ jacobians[1 - new] if others else np.zeros((kind.dof, self._D))
        self._add(ends[new], A, others, inverse @ R @ inverse.T)
        return True

    def _carry(self, number: int, others: list[int]) -> None:
        """Begin a variable where its start is as seen from another one, if that is a pose."""
        kind, row = self._place(number)
        for other in others:
            anchor, at = self._place(other)
            if anchor.is_pose:
                before, now = self.start[anchor][at], self.values[anchor][at]
                self.values[kind][row] = carried(kind, self.start[kind][row], anchor, before, now)

    def _add(self, number: int, A: Floats, others: list[int], own: Floats) -> None:
        """Add a variable with an error of A (dof, D) times that of another one, plus its own."""
        dof, D = len(own), self._D
        J, noise = np.zeros((D, 0)), np.zeros((D, D))
        columns = np.empty(0, np.int64)
        noise[:dof, :dof] = own
        if others and others[0] in self.members:
            columns, J = self._slot(others[0]), np.zeros((D, D))
            J[:dof] = A
        self._errors.append(np.zeros(D), columns, J, noise)
        self.members.append(number)
        self._is_known[number] = True

    def _guess(self, number: int) -> None:
        """Add a variable of which next to nothing is known, at its start."""
        kind, _ = self._place(number)
        sigma = np.where(np.arange(kind.dof) < kind.positions, _LOST_M, _LOST_RAD)
        self._carry(number, self.members[-1:])
        self._add(number, np.zeros((kind.dof, self._D)), [], np.diag(sigma**2))

    def _update(self, index: int, row: int) -> None:
        """Correct the whole state by a factor of variables that are known."""
        r, jacobians, R = self._linearised(index, row)
        ends = [int(numbers[row]) for numbers in self.graph.numbers(self.graph.blocks[index])]
        there = [(self._slot(e), J) for e, J in zip(ends, jacobians, strict=True)
                 if e in self.members]  # fmt: skip
        if not there or len(r) == 0:  # between fixed variables, or without information
            return
        columns = np.concatenate([slot for slot, _ in there])
        J = np.ascontiguousarray(np.hstack([each for _, each in there]))
        try:
            self._errors.update(columns[None], J[None], -r[None], R[None])
        except ValueError:
            raise GraphError(
                f"the filter is no Gaussian any more at {self.graph.names(ends)}: measurements "
                "that differ too much in precision, or positions too far from 0; use another solver"
            ) from None
        errors = self._errors.x.reshape(-1, self._D)
        members = np.array(self.members, np.int64)
        for kind, first in self._kinds.items():
            chosen = (members >= first) & (members < first + len(self.graph.ids[kind]))
            self._move(kind, members[chosen] - first, errors[chosen, : kind.dof])
        self._errors.x[:] = 0.0

    def _move(self, kind: VariableKind, rows: Ints, errors: Floats) -> None:
        """Move values of a kind by errors, (n, dof)."""
        values = self.values[kind][rows]
        self.values[kind][rows] = moved(kind, values, errors) if kind.is_pose else values + errors

    def forget(self, numbers: list[int]) -> None:
        """Marginalise variables out: of a Gaussian in moments, their rows and columns."""
        for number in numbers:
            at = self.members.index(number)
            self._errors.remove(at * self._D, self._D)
            self.members[at] = self.members[-1]
            self.members.pop()


def most_at_once(steps: list[list[tuple[int, int]]], last: Ints, graph: FactorGraph) -> int:
    """Return how many variables are in the state at once."""
    numbers = [np.column_stack(graph.numbers(block)) for block in graph.blocks]
    seen, count, most = np.zeros(graph.size, np.bool_), 0, 0
    leaving = np.bincount(last[last >= 0], minlength=len(steps))
    for step, factors in enumerate(steps):
        for index, row in factors:
            for number in numbers[index][row]:
                count += not seen[number]
                seen[number] = True
        most = max(most, count)
        count -= int(leaving[step])
    return most


@solver
def extended_kalman(problem: Problem, tell: Tell) -> Solution:
    """Solve by an extended Kalman filter, in the order of the poses.

    What it says of a variable is the estimate when that left the state: of the last ones it is
    that of all measurements, of the others that of the measurements up to then.

    Raises
    ------
    GraphError
        If too many variables would be in the state at once, or some have too few measurements.
    """
    graph = problem.graph
    check_pairs(graph, "ekf")
    steps = arrivals(graph)
    last = departures(graph, steps)
    most = most_at_once(steps, last, graph)
    allowed = MOST_NUMBERS // int(graph.dof().max(initial=1))
    if most > allowed:
        raise GraphError(
            f"the filter would hold {most} variables at once, as later factors return to them; "
            f"at most {allowed} are allowed; use another solver"
        )
    own = GraphFilter(problem)
    leaving: list[list[int]] = [[] for _ in steps]
    for number in np.flatnonzero(last >= 0).tolist():
        leaving[last[number]].append(number)
    tell("order", 1, 1)
    for step, factors in enumerate(steps):
        own.step(factors)
        if step < len(steps) - 1:
            own.forget([each for each in leaving[step] if each in own.members])
        tell("step", step + 1, len(steps))
    history = [chi2_of(graph, each) for each in (problem.start, own.values)]
    weights = [np.ones(len(block)) for block in graph.blocks]
    return Solution(own.values, history, weights, is_optimum(problem, own.values, weights))
