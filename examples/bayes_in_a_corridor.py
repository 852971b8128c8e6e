"""Bayes' rule by itself: which door of a corridor, and how far a wall is when one range is wild.

python examples/bayes_in_a_corridor.py
"""

import numpy as np

from robotctl.estimation.bayes import (
    DiscreteBayes,
    Gaussian,
    gaussian_likelihood,
    robust_likelihood,
    shift_transition,
)

# Twelve cells with three doors; the sensor sees 8 of 10 doors, and takes 1 of 10 walls for one.
sees_door = np.where(np.isin(np.arange(12), [1, 4, 9]), 0.8, 0.1)
robot = DiscreteBayes(np.ones(12))
robot.update(sees_door)
robot.predict(shift_transition(12, 3, [0.1, 0.8, 0.1]))  # 3 cells, at times one more or less
robot.update(sees_door)
print(f"cell {np.argmax(robot.belief)}: {100 * robot.belief.max():.0f} %")

# A sonar good to 0.10 m and an infrared sensor good to 0.05 m: inverse variances add.
wall = Gaussian(2.10, 0.10**2) * Gaussian(2.00, 0.05**2)
print(f"both sensors: {wall.mean:.2f} m, sigma {wall.sigma:.3f} m")

places = np.linspace(0.0, 5.0, 101)
by_gauss, by_robust = DiscreteBayes(np.ones(101)), DiscreteBayes(np.ones(101))
for range_m in (2.0, 2.05, 1.95, 2.0, 4.8):  # the last one is wild
    by_gauss.update(gaussian_likelihood(range_m, places, 0.1))
    by_robust.update(robust_likelihood(range_m, places, 0.1, 0.05))
print(f"Gaussian: {by_gauss.belief @ places:.2f} m; robust: {by_robust.belief @ places:.2f} m")
