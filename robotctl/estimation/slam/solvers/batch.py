"""Batch optimisation: all variables at once, by Gauss-Newton steps that are damped or bounded.

Gauss-Newton; Levenberg-Marquardt with Marquardt's scaling and the damping of Madsen, Nielsen and
Tingleff, Methods for non-linear least squares problems (2004), algorithm 3.16; Powell's dog-leg,
algorithm 3.21 there. With a robust kernel the weights are renewed at each step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

import numpy as np

from robotctl.estimation.slam.equations import Equations, GraphError, Linearisation, NormalEquations
from robotctl.estimation.slam.graph.variables import Floats
from robotctl.estimation.slam.robust.graduated import Graduation
from robotctl.estimation.slam.robust.robust_cost import RobustCost
from robotctl.estimation.slam.solvers.problem import (
    Problem,
    Solution,
    Tell,
    doubtful,
    singular,
    solver,
)

SETTLED: Final = 1e-7
"""A step that lowers the cost by less than this share is the last."""
_TINY: Final = 1e-12
_LARGEST_DAMPING: Final = 1e12
_STEPS_EACH: Final = 2
"""At most, for each value of mu."""


class Descent:
    """The present values of a graph, with what steps need."""

    def __init__(self, problem: Problem, equations: Equations, cost: RobustCost) -> None:
        self.problem = problem
        self.equations = equations
        self.cost = cost
        self.at = equations.linearise(problem.start)
        self.spare: Linearisation | None = None
        self.fixed_weights: list[Floats] | None = None
        self.total = self.total_of(self.at)

    def total_of(self, at: Linearisation) -> float:
        """Return the cost that is to be lowered."""
        if self.fixed_weights is None:
            return self.cost.total(at.squares)
        return float(sum(w @ s for w, s in zip(self.fixed_weights, at.squares, strict=True)))

    def hold_weights(self, weights: list[Floats] | None) -> None:
        """Keep these weights from now on; None: those of the kernel."""
        self.fixed_weights = weights
        self.total = self.total_of(self.at)

    def assemble(self) -> None:
        """Fill the equations at the present values."""
        weights = self.fixed_weights
        if weights is None and self.cost.kernel is not None:
            weights = self.cost.weights(self.at.squares)
        self.equations.assemble(self.at, weights)

    def factorise(self, damping: Floats | None = None) -> bool:
        """Factor; return whether that was possible."""
        self.failed = self.equations.factorise(damping)
        return self.failed is None

    def gauss_newton_step(self) -> Floats:
        """Return the solution of the equations as they are.

        Raises
        ------
        GraphError
            If they have none.
        """
        if not self.factorise() and self.failed is not None:
            raise singular(self.problem.graph, self.failed)
        return self.equations.solve()

    def look(self, step: Floats) -> tuple[Linearisation, float]:
        """Return the graph after a step, and its cost."""
        values = self.equations.retract(self.at.values, step)
        there = self.equations.linearise(values, self.spare)
        return there, self.total_of(there)

    def go(self, there: Linearisation, total: float) -> None:
        """Take a step that was looked at."""
        self.at, self.spare, self.total = there, self.at, total

    def stay(self, there: Linearisation) -> None:
        """Do not take it."""
        self.spare = there


class Rule(Protocol):
    """A way to make steps."""

    def step(self, descent: Descent) -> bool:
        """Make one step; return whether to go on."""
        ...


def _is_worth_more(before: float, after: float) -> bool:
    return before - after > SETTLED * after and after > _TINY


class GaussNewton:
    """Takes each step in full; it may diverge."""

    def step(self, descent: Descent) -> bool:
        """Make one step; return whether to go on."""
        before = descent.total
        descent.assemble()
        descent.go(*descent.look(descent.gauss_newton_step()))
        return abs(before - descent.total) > SETTLED * descent.total > _TINY


class LevenbergMarquardt:
    """Damps steps until they lower the cost."""

    def __init__(self) -> None:
        self.damping = 1e-8
        self._growth = 2.0

    def step(self, descent: Descent) -> bool:
        """Make one step; return whether to go on."""
        equations = descent.equations
        descent.assemble()
        diagonal = equations.diagonal
        while self.damping < _LARGEST_DAMPING:
            damping = self.damping * diagonal
            if descent.factorise(damping):
                step = equations.solve()
                expected = float(step @ (damping * step - equations.gradient))
                if expected <= _TINY * descent.total:
                    return False
                there, total = descent.look(step)
                gain = (descent.total - total) / expected
                if gain > 0.0:
                    before = descent.total
                    descent.go(there, total)
                    self.damping = max(
                        1e-12, self.damping * max(0.1, 1.0 - (2.0 * gain - 1.0) ** 3)
                    )
                    self._growth = 2.0
                    return _is_worth_more(before, total)
                descent.stay(there)
            self.damping *= self._growth
            self._growth *= 2.0
        if descent.failed is not None:
            raise singular(descent.problem.graph, descent.failed)
        return False


class DogLeg:
    """Bounds steps by a radius, and bends those that are too long towards steepest descent."""

    def __init__(self) -> None:
        self._radius = 0.0

    def step(self, descent: Descent) -> bool:
        """Make one step; return whether to go on."""
        equations = descent.equations
        descent.assemble()
        newton = descent.gauss_newton_step()
        gradient = equations.gradient
        curvature = float(gradient @ equations.product(gradient))
        square = float(gradient @ gradient)
        if square == 0.0:
            return False
        steepest = -(square / curvature) * gradient
        length = float(np.linalg.norm(newton))
        self._radius = self._radius or length
        while True:
            step = _bent(newton, steepest, self._radius)
            expected = -float(2.0 * (gradient @ step) + step @ equations.product(step))
            if expected <= _TINY * descent.total or self._radius < _TINY * (1.0 + length):
                return False
            there, total = descent.look(step)
            gain = (descent.total - total) / expected
            taken = float(np.linalg.norm(step))
            if gain > 0.75:
                self._radius = max(self._radius, 3.0 * taken)
            elif gain < 0.25:
                self._radius = 0.5 * taken
            if gain > 0.0:
                before = descent.total
                descent.go(there, total)
                return _is_worth_more(before, total)
            descent.stay(there)


def _bent(newton: Floats, steepest: Floats, radius: float) -> Floats:
    """Return the step of the dog-leg that is as long as the radius, or the whole of Newton's."""
    if np.linalg.norm(newton) <= radius:
        return newton
    length = float(np.linalg.norm(steepest))
    if length >= radius:
        shortened: Floats = (radius / length) * steepest
        return shortened
    leg = newton - steepest
    a, b, c = float(leg @ leg), float(steepest @ leg), length**2 - radius**2
    share = float((-b + np.sqrt(b * b - a * c)) / a)
    return steepest + share * leg


def solve(problem: Problem, tell: Tell, make_rule: Callable[[], Rule]) -> Solution:
    """Return the optimum that a rule finds.

    Raises
    ------
    GraphError
        If the factors do not determine all variables; it names them.
    """
    return descend(problem, tell, NormalEquations(problem.graph, problem.fixed), make_rule)


def descend(
    problem: Problem, tell: Tell, equations: Equations, make_rule: Callable[[], Rule]
) -> Solution:
    """Return where the steps of a rule end, with any equations of the problem.

    Raises
    ------
    GraphError
        If there is no step, or the steps leave all bounds.
    """
    tell("order", 1, 1)
    suspects = doubtful(problem.graph)
    descent = Descent(problem, equations, RobustCost(problem.graph, problem.kernel, suspects))
    descent.hold_weights(problem.weights)
    history = [descent.at.chi2]
    problem.watch(descent.at.values)
    rule, goes_on = make_rule(), True
    if problem.graduated:
        _graduate(problem, descent, make_rule, history, tell)
    iterations = 0
    while goes_on and iterations < problem.most_iterations:
        goes_on = rule.step(descent)
        iterations += 1
        if not np.isfinite(descent.total):
            raise GraphError("the steps have left all bounds; lm, which damps them, does not")
        history.append(descent.at.chi2)
        problem.watch(descent.at.values)
        tell("iteration", iterations, problem.most_iterations)
    weights = descent.fixed_weights or descent.cost.weights(descent.at.squares)
    return Solution(descent.at.values, history, weights, not goes_on)


def _graduate(
    problem: Problem, descent: Descent, make_rule: Callable[[], Rule], history: list[float],
    tell: Tell,
) -> None:  # fmt: skip
    """Let truncated least squares grow from a convex cost, and keep the weights of the end."""
    graduation = Graduation(problem.graph, descent.cost.doubtful)
    graduation.begin(descent.at.squares)
    done = 0
    weights = [np.ones(len(block)) for block in problem.graph.blocks]
    while True:
        descent.hold_weights(weights)
        rule = make_rule()
        for _ in range(_STEPS_EACH):
            if not rule.step(descent):
                break
        history.append(descent.at.chi2)
        problem.watch(descent.at.values)
        done += 1
        tell("graduation", done, done + 1)
        if done > 1 and graduation.is_done(weights):
            return
        weights = graduation.weights(descent.at.squares)
        graduation.advance()


@solver
def gauss_newton(problem: Problem, tell: Tell) -> Solution:
    """Solve by Gauss-Newton."""
    return solve(problem, tell, GaussNewton)


@solver
def levenberg_marquardt(problem: Problem, tell: Tell) -> Solution:
    """Solve by Levenberg-Marquardt."""
    return solve(problem, tell, LevenbergMarquardt)


@solver
def dog_leg(problem: Problem, tell: Tell) -> Solution:
    """Solve by Powell's dog-leg."""
    return solve(problem, tell, DogLeg)
