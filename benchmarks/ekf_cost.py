"""Cost of the EKF: predict and update of three states beside filterpy alone, and its budget."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from numpy.typing import NDArray

from benchmarks import machine
from robotctl.estimation.kalman.ekf import PoseEkf
from robotctl.estimation.kalman.ekf_config import EkfConfig
from robotctl.estimation.kalman.ekf_models import bearing_residual, landmark_sighting
from robotctl.estimation.kalman.robust_kalman import RobustKalman
from robotctl.model.geometry.pose_estimate import LocalisationStatus, PoseEstimate
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount
from robotctl.model.wall_map import WallMap

TARGET = 1.2
REPEATS = 3000

LANDMARK = (3.0, 1.0)
START = np.diag([0.01, 0.01, 0.01])
F, Q = np.eye(3), np.diag([1e-4, 1e-4, 1e-5])
R = np.diag([0.01, 0.001])
Z = np.array([3.15, 0.33])

# What the navigation process does in a second, with the rates of configs/diff_drive.toml.
STEPS_HZ, SONARS_HZ, POSES_HZ = 20.0, 8 * 20.0, 5.0


class Moved(ExtendedKalmanFilter):
    """filterpy with a non-linear motion: its hook takes the moved state."""

    def predict_x(self, u=0):
        self.x = u


def filterpy_alone() -> Callable[[], None]:
    """Return one predict and update as filterpy wants them called."""
    kalman = Moved(dim_x=3, dim_z=2)
    kalman.x, kalman.P = np.zeros(3), START

    def jacobian(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return landmark_sighting(SE2(*x), LANDMARK)[1]

    def expected(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return landmark_sighting(SE2(*x), LANDMARK)[0]

    def step() -> None:
        kalman.F, kalman.Q = F, Q
        kalman.predict(kalman.x)
        kalman.update(Z, jacobian, expected, R, residual=bearing_residual)

    return step


def filterpy_model_once() -> Callable[[], None]:
    """Return the same, with the model computed once for both."""
    kalman = Moved(dim_x=3, dim_z=2)
    kalman.x, kalman.P = np.zeros(3), START

    def step() -> None:
        kalman.F, kalman.Q = F, Q
        kalman.predict(kalman.x)
        h, H = landmark_sighting(SE2(*kalman.x), LANDMARK)
        kalman.update(Z, lambda _: H, lambda _: h, R, residual=bearing_residual)

    return step


def robust() -> Callable[[], None]:
    """Return the same with the weighing of outliers around it."""
    kalman = RobustKalman(np.zeros(3), START)

    def step() -> None:
        kalman.predict(kalman.x, F, Q)
        h, H = landmark_sighting(SE2(*kalman.x), LANDMARK)
        kalman.update(Z, h, H, R, bearing_residual)

    return step


def pose_ekf(what: str) -> Callable[[], None]:
    """Return one operation of the live filter, with its history: five states."""
    start = PoseEstimate(0, SE2(), START, LocalisationStatus.LOCALISED)
    ekf = PoseEkf(EkfConfig(), start)
    walls = WallMap(
        np.array([[x, -3.0, x, 3.0] for x in np.linspace(2.0, 9.0, 30)], dtype=np.float64)
    )
    mount = SonarMount("front", 0.1, 0.0, 0.0)
    now_ns = 0

    def step() -> None:
        nonlocal now_ns
        if what == "predict":
            now_ns += 50_000_000
            ekf.predict(now_ns, 0.0, 1e-3)
        elif what == "sonar":
            ekf.update_sonar(now_ns, mount, 1.9, walls)
        elif what == "pose fix":
            ekf.update_pose(now_ns, SE2(), START)
        else:
            now_ns += 50_000_000
            ekf.predict(now_ns, 0.0, 1e-3)
            ekf.update_pose(now_ns - 425_000_000, SE2(), START)

    return step


def cost_us(step: Callable[[], None], repeats: int) -> float:
    """Return the processor time of one call [us]."""
    began_ns = time.process_time_ns()
    for _ in range(repeats):
        step()
    return 1e-3 * (time.process_time_ns() - began_ns) / repeats


def run(rounds: int, seconds: float) -> None:
    """Measure all in turn, several rounds."""
    makers = {
        "filterpy alone": filterpy_alone,
        "filterpy, model computed once": filterpy_model_once,
        "RobustKalman (filterpy inside)": robust,
    }
    costs: dict[str, list[float]] = {name: [] for name in makers}
    for _ in range(rounds):
        for name, maker in makers.items():
            costs[name].append(cost_us(maker(), REPEATS))
    alone = machine.median(costs["filterpy alone"])
    rows = [
        (name, machine.spread(values, 1), f"{machine.median(values) / alone:.2f}")
        for name, values in costs.items()
    ]
    machine.table(
        "EKF predict + update, 3 states, range and bearing", ("filter", "us", "ratio"), rows
    )
    ours = machine.median(costs["RobustKalman (filterpy inside)"])
    once = machine.median(costs["filterpy, model computed once"])
    machine.note(
        f"{ours / alone:.2f} times filterpy's own cost, {ours / once:.2f} times if that computed "
        f"the model once, {TARGET:g} allowed"
    )
    _budget(rounds)


def _budget(rounds: int) -> None:
    """Say what the live filter takes of a core at its rates."""
    rates = {"predict": STEPS_HZ, "sonar": SONARS_HZ, "pose fix": POSES_HZ}
    rows, total = [], 0.0
    for what, rate_hz in rates.items():
        values = [cost_us(pose_ekf(what), 400) for _ in range(rounds)]
        share = 1e-4 * machine.median(values) * rate_hz
        total += share
        rows.append((what, machine.spread(values, 0), f"{rate_hz:g}", f"{share:.2f}"))
    late = [cost_us(pose_ekf("late"), 200) for _ in range(rounds)]
    share = 1e-4 * machine.median(late) * POSES_HZ
    rows.append(("the same, 425 ms late", machine.spread(late, 0), f"{POSES_HZ:g}", f"{share:.2f}"))
    machine.table(
        "PoseEkf, live: x, y, theta, v, omega; 30 walls",
        ("operation", "us", "per second", "% of a core"),
        rows,
    )
    machine.note(f"{total + share:.1f} % of a core at these rates")
