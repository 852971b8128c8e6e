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
from robotctl.estimation.slam.linear.assembly import inner
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
_LEAST_DAMPING: Final = 1e-14
"""Damping below rounding, as a multiple of the diagonal; less is none."""
_LARGEST_DAMPING: Final = 1e12
_POOR: Final = 0.25
"""Share of the expected gain below which the next step is damped more."""
_MARGIN: Final = 10.0
"""Factor by which steps may converge more slowly than the last ones did."""
_STEPS_OVER: Final = 5
"""Further steps that may bring the cost below what it was before one that raised it."""
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
        return self.cost.total(at.squares, self.fixed_weights)

    def hold_weights(self, weights: list[Floats] | None) -> None:
        """Keep these weights from now on; None: those of the kernel."""
        self.fixed_weights = weights
        self.total = self.total_of(self.at)

    def assemble(self) -> None:
        """Fill the equations at the present values."""
        is_weighted = self.fixed_weights is not None or self.cost.is_robust
        self.equations.assemble(self.at, self.weights() if is_weighted else None)

    def weights(self) -> list[Floats]:
        """Return the weights of all factors at the present values."""
        return self.cost.weights(self.at.squares, self.fixed_weights)

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
    """Damps steps where Gauss-Newton's do not lower the cost.

    The first is not damped: a long drive that few loops hold has directions so weak that damping
    by 1e-9 of the diagonal makes steps along them far too short.
    """

    def __init__(self) -> None:
        self.damping = 0.0
        self._growth = 2.0
        self._decrease = 0.0

    def step(self, descent: Descent) -> bool:
        """Make one step; return whether to go on."""
        equations, before = descent.equations, descent.total
        descent.assemble()
        diagonal = equations.diagonal
        while self.damping < _LARGEST_DAMPING:
            damping = self.damping * diagonal
            if descent.factorise(damping):
                step = equations.solve()
                expected = inner(step, damping * step - equations.gradient)
                if expected <= _TINY * before:
                    return False
                there, total = descent.look(step)
                gain = (before - total) / expected
                if gain > 0.0:
                    descent.go(there, total)
                    self._adapt(gain)
                    return self._is_far(before, total, gain) and _is_worth_more(before, total)
                if self.damping == 0.0 and _goes_over(descent, there, total):
                    return _is_worth_more(before, descent.total)
                descent.stay(there)
            self.damping = max(_LEAST_DAMPING, self.damping * self._growth)
            self._growth *= 2.0
        if descent.failed is not None:
            raise singular(descent.problem.graph, descent.failed)
        return False

    def _is_far(self, before: float, after: float, gain: float) -> bool:
        """Return whether the next step may lower the cost by more than `SETTLED`.

        Near the optimum, undamped steps lower it by a share of what the one before did, at least
        linearly; that share is about what it was last, or what the linear model was off by.
        """
        last, self._decrease = self._decrease, before - after
        if self.damping > 0.0 or last <= 0.0:
            return True
        share = _MARGIN * max(self._decrease / last, abs(1.0 - gain))
        return share * self._decrease > SETTLED * after

    def _adapt(self, gain: float) -> None:
        """Damp the next step by which share of the expected gain this one had."""
        if gain < _POOR:
            self.damping = max(_LEAST_DAMPING, 4.0 * self.damping)
        else:
            self.damping *= max(0.1, 1.0 - (2.0 * gain - 1.0) ** 3)
        if self.damping < _LEAST_DAMPING:
            self.damping = 0.0
        self._growth = 2.0


def _goes_over(descent: Descent, there: Linearisation, total: float) -> bool:
    """Take a full step that raises the cost if a few more lower it; return whether it did.

    Along a curved valley a step goes up the side, and only the next ones down to the floor
    (watchdog technique: Chamberlain et al., Mathematical Programming Study 16, 1982).
    """
    here, before = descent.at, descent.total
    for _ in range(_STEPS_OVER):
        descent.at, descent.spare, descent.total = there, None, total
        descent.assemble()
        if not descent.factorise():
            break
        there, total = descent.look(descent.equations.solve())
        if total < before:
            descent.go(there, total)
            return True
        if not total < descent.total:
            break
    descent.at, descent.total = here, before
    descent.assemble()
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
        curvature = inner(gradient, equations.product(gradient))
        square = inner(gradient, gradient)
        if square == 0.0:
            return False
        steepest = -(square / curvature) * gradient
        length = float(np.linalg.norm(newton))
        self._radius = self._radius or length
        while True:
            step = _bent(newton, steepest, self._radius)
            expected = -(2.0 * inner(gradient, step) + inner(step, equations.product(step)))
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
    a, b, c = inner(leg, leg), inner(steepest, leg), length**2 - radius**2
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
    return Solution(descent.at.values, history, descent.weights(), not goes_on)


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
