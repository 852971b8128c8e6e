"""Whether two loop closures whose ends are near each other say the same."""

from __future__ import annotations

from typing import Final

import numpy as np

from robotctl.estimation.slam.graph.factor import FactorKind, Linearised
from robotctl.estimation.slam.graph.variables import Floats
from robotctl.estimation.slam.incremental.closures import Closures
from robotctl.estimation.slam.incremental.placing import carried
from robotctl.estimation.slam.incremental.smoother import IncrementalSmoother

_STEP: Final = 1e-5


def cycle_nis(smoother: IncrementalSmoother, closures: Closures, a: int, b: int) -> float:
    """Return the normalised square of what is left around a cycle of two closures, by their rows.

    It leads along `a`, from its end to that of `b`, back along `b`, and to where it began.
    """
    kind = closures.kind
    pose = kind.variables[0]
    identity = np.array(pose.identity)
    ends_a, ends_b = closures.variables(a), closures.variables(b)
    first, second = (smoother.estimate(each) for each in ends_a)
    start = (closures.measurement(a), *(smoother.estimate(each) for each in ends_b))

    def left(by: Floats) -> Floats:
        """Return the residual of `b`; measurement `a` and poses of `b` moved by (3, dof)."""
        z, x, y = (
            pose.retract(each[None], step[None])[0] for each, step in zip(start, by, strict=True)
        )
        seen = carried(pose, z, pose, identity, first)
        at = carried(pose, y, pose, second, seen)
        r: Floats = kind.residual(x[None], at[None], closures.measurement(b)[None])[0]
        return r

    # Covariances are those of residuals; in space these are half of a rotation vector.
    z = closures.measurement(a)
    exact = Linearised.of_one(kind, (identity, z), z)
    to_increments = np.linalg.inv(exact.jacobians[1][0])
    none = np.zeros((3, pose.dof))
    r = left(none)
    covariance = closures.noise(b)
    covariances = (
        closures.noise(a),
        *(_between(smoother, kind, *ends) for ends in zip(ends_a, ends_b, strict=True)),
    )
    for slot, own in enumerate(covariances):
        jacobian = np.empty((kind.size, pose.dof))
        for column in range(pose.dof):
            step = none.copy()
            step[slot, column] = _STEP
            jacobian[:, column] = (left(step) - r) / _STEP
        jacobian = jacobian @ to_increments
        covariance = covariance + jacobian @ own @ jacobian.T
    return float(r @ np.linalg.solve(covariance, r))


def _between(smoother: IncrementalSmoother, kind: FactorKind, one: int, other: int) -> Floats:
    """Return the covariance of one pose in another, as of a factor that measures it."""
    pose = kind.variables[0]
    if one == other:
        return np.zeros((kind.size, kind.size))
    identity = np.array(pose.identity)
    seen = carried(pose, smoother.estimate(other), pose, smoother.estimate(one), identity)
    return smoother.forecast(kind, (one, other), seen)[1]
