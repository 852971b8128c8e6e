"""A factor of one's own, of three variables: a point halfway between two, and its covariance.

python examples/pose_graph_own_factor.py
"""

import numpy as np

from robotctl.estimation.slam import POINT2, FactorKind, IncrementalSmoother

halfway = FactorKind(
    "halfway", (POINT2,) * 3, 2, 2, lambda a, b, middle, z: middle - (a + b) / 2 - z
)
smoother = IncrementalSmoother()
left = smoother.variable(POINT2, np.array([0.0, 0.0]), fixed=True)
right = smoother.variable(POINT2, np.array([4.0, 0.0]), fixed=True)
middle = smoother.variable(POINT2, np.array([1.0, 1.0]))
smoother.factor(halfway, (left, right, middle), np.zeros(2), np.eye(2) / 0.1**2)
smoother.update()
(x_m, y_m), (var_x_m2, _), (_, var_y_m2) = smoother.estimate(middle), *smoother.covariance(middle)
print(f"halfway at ({x_m:.3f}, {y_m:.3f}) m, sigma ({var_x_m2**0.5:.3f}, {var_y_m2**0.5:.3f}) m")
