"""The solvers by name; a new one is a file and a line here."""

from __future__ import annotations

from typing import Final

from robotctl.estimation.slam.solvers.batch import dog_leg, gauss_newton, levenberg_marquardt
from robotctl.estimation.slam.solvers.belief_propagation import belief_propagation
from robotctl.estimation.slam.solvers.filtering import extended_kalman
from robotctl.estimation.slam.solvers.incremental import incremental
from robotctl.estimation.slam.solvers.problem import Solver

SOLVERS: Final[dict[str, Solver]] = {
    "gn": gauss_newton,
    "lm": levenberg_marquardt,
    "dogleg": dog_leg,
    "isam": incremental,
    "gbp": belief_propagation,
    "ekf": extended_kalman,
}
IN_ORDER: Final = ("isam", "ekf")
"""Solvers that go pose by pose, from odometry."""
CONSISTENT: Final = "consistent"
"""The only robust kernel of `isam`; for others, `isam` says first what is on."""
