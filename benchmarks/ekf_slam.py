"""EKF-SLAM: one update beside NumPy, consistency over seeds, public logs of ROBOTCTL_DATA."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks import machine
from robotctl.estimation.kalman.chi_squared import chi2_bounds
from robotctl.estimation.slam.ekf_slam.features import POINT
from robotctl.estimation.slam.ekf_slam.filter import EkfSlam
from robotctl.logs.formats.mrclam_log import read_mrclam
from robotctl.model.drives.motion import arc
from robotctl.model.drives.motion_noise import MotionNoise
from robotctl.model.geometry.se2 import SE2
from robotctl.workbench.slam.options import SlamOptions
from robotctl.workbench.slam.slam import slam, slam_of_recording

GOAL_US, GOAL_M, GOAL_INSIDE = 30.0, 0.3, 0.8
LANDMARKS = 200
REPEATS = 100
SEEDS = 50
R = np.diag([0.05**2, 0.02**2])
NOISE = MotionNoise(0.02, 0.02, 0.03)


def filled(count: int, *, invariant: bool) -> EkfSlam:
    """Return a filter with many landmarks that it has seen from several places."""
    rng = np.random.default_rng(0)
    slam_ = EkfSlam(np.zeros(3), 1e-6 * np.eye(3), invariant=invariant)
    for number, place in enumerate(rng.uniform(-20.0, 20.0, (count, 2))):
        x, y = slam_.pose.inverse().apply(*place.tolist())
        slam_.add(POINT, number, np.array([math.hypot(x, y), math.atan2(y, x)]), R)
        slam_.move(0.05, 0.02, NOISE)
    return slam_


def ours(count: int, *, invariant: bool) -> Callable[[], object]:
    """Return one update, from the measurement to state and covariance."""
    slam_ = filled(count, invariant=invariant)
    which, noise = np.array([count // 2]), R[np.newaxis]
    z = POINT.expected(slam_.x_v, slam_.features[which])[0]
    return lambda: slam_.update(POINT, which, z, noise)


def model(x: np.ndarray, at: int) -> tuple[np.ndarray, np.ndarray]:
    """Return expected range and bearing, and the Jacobian by robot and landmark, (2, 5)."""
    dx, dy = x[at] - x[0], x[at + 1] - x[1]
    q = dx * dx + dy * dy
    r = math.sqrt(q)
    H = np.array(
        [[-dx / r, -dy / r, 0.0, dx / r, dy / r], [dy / q, -dx / q, -1.0, -dy / q, dx / q]]
    )
    return np.array([r, math.atan2(dy, dx) - x[2]]), H


def structured(count: int) -> Callable[[], object]:
    """Return the same in NumPy, with the five columns that the Jacobian has, in place."""
    slam_ = filled(count, invariant=False)
    x, P, at = slam_.belief.x.copy(), slam_.belief.covariance(), 3 + 2 * (count // 2)
    z = model(x, at)[0]
    columns = [0, 1, 2, at, at + 1]

    def step() -> None:
        expected, H = model(x, at)
        PHt = P[:, columns] @ H.T
        S = H @ PHt[columns] + R
        K = PHt @ np.linalg.inv(S)
        off = z - expected
        off[1] = math.remainder(off[1], math.tau)
        x[:] += K @ off
        P[:] -= K @ PHt.T

    return step


def dense(count: int) -> Callable[[], object]:
    """Return the same in NumPy with whole matrices, as textbooks print it."""
    slam_ = filled(count, invariant=False)
    x, P, at = slam_.belief.x.copy(), slam_.belief.covariance(), 3 + 2 * (count // 2)
    z = model(x, at)[0]
    whole = np.eye(len(x))

    def step() -> None:
        nonlocal x, P
        expected, own = model(x, at)
        H = np.zeros((2, len(x)))
        H[:, [0, 1, 2, at, at + 1]] = own
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        off = z - expected
        off[1] = math.remainder(off[1], math.tau)
        x = x + K @ off
        P = (whole - K @ H) @ P

    return step


def cost_us(step: Callable[[], object], repeats: int) -> float:
    """Return the processor time of one call [us]."""
    step()
    began_ns = time.process_time_ns()
    for _ in range(repeats):
        step()
    return 1e-3 * (time.process_time_ns() - began_ns) / repeats


def updates(rounds: int) -> None:
    """Compare the cost of an update."""
    makers: dict[str, Callable[[int], Callable[[], object]]] = {
        "EkfSlam": lambda count: ours(count, invariant=True),
        "EkfSlam, invariant=False": lambda count: ours(count, invariant=False),
        "NumPy, structured": structured,
        "NumPy, dense": dense,
    }
    rows = []
    for count in (25, 50, 100, LANDMARKS, 2 * LANDMARKS):
        steps = {name: make(count) for name, make in makers.items()}
        costs: dict[str, list[float]] = {name: [] for name in makers}
        for _ in range(rounds):
            for name, step in steps.items():
                costs[name].append(cost_us(step, REPEATS if name != "NumPy, dense" else 5))
        rows.append((str(count), *(machine.spread(values, 1) for values in costs.values())))
        if count == LANDMARKS:
            best = machine.median(costs["EkfSlam, invariant=False"])
    machine.table("One update, us", ("landmarks", *makers), rows)
    machine.note(f"goal at {LANDMARKS}: <= {GOAL_US:g} us: {best:.1f}")


def simulated_nees(seed: int, *, invariant: bool, sigma_rad: float) -> float:
    """Return the NEES of the pose after 25 m among 30 landmarks, the first heading in doubt."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-6.0, -4.0], [8.0, 12.0], (30, 2))
    start = np.diag([0.01, 0.01, sigma_rad**2])
    slam_ = EkfSlam(np.sqrt(np.diag(start)) * rng.standard_normal(3), start, invariant=invariant)
    pose = SE2()
    for k in range(100):
        d, a = 0.25, 0.12 * math.sin(0.05 * k) + 0.05
        spread = math.sqrt(NOISE.f_rad_per_sqrt_m**2 * d + NOISE.g_rad_per_sqrt_rad**2 * abs(a))
        along = NOISE.e_m_per_sqrt_m * math.sqrt(d) * rng.standard_normal()
        pose = arc(pose, d + along, a + spread * rng.standard_normal())
        slam_.move(d, a, NOISE)
        dx, dy = (points - [pose.x_m, pose.y_m]).T
        z = np.stack([np.hypot(dx, dy), np.arctan2(dy, dx) - pose.theta_rad], axis=1)
        near = np.flatnonzero(z[:, 0] < 6.0)
        z = z[near] + rng.standard_normal((len(near), 2)) @ np.sqrt(R)
        slam_.sight(POINT, near.tolist(), z, np.tile(R, (len(near), 1, 1)))
    return slam_.nees(pose)


def consistency() -> None:
    """Compare the NEES with what it should be."""
    low, high = (bound / SEEDS for bound in chi2_bounds(3 * SEEDS))
    rows = []
    for sigma_rad in (0.001, 0.07, 0.3):
        for invariant in (True, False):
            nees = [
                simulated_nees(seed, invariant=invariant, sigma_rad=sigma_rad)
                for seed in range(SEEDS)
            ]
            mean = float(np.mean(nees))
            kind = "invariant" if invariant else "textbook"
            inside = "yes" if low <= mean <= high else "no"
            rows.append((kind, f"{sigma_rad:g}", f"{mean:.2f}", inside))
    heads = ("filter", "sigma of the first heading, rad", "mean NEES", "inside")
    machine.table(f"NEES over {SEEDS} seeds, {low:.2f} to {high:.2f} is consistent", heads, rows)


def logs(folder: Path) -> None:
    """Follow the robots of MRCLAM with and without names, and Victoria Park."""
    rows = []
    for robot in (1, 2):
        path = folder / "mrclam" / "MRCLAM_Dataset7"
        recording = read_mrclam(path, robot)
        for association in ("names", "joint", "nearest"):
            options = SlamOptions(log=path, association=association)
            report = slam_of_recording(recording, options, lambda *_: None).report()
            whole, online = report["trajectory"], report["online"]
            rows.append(
                (
                    str(robot),
                    association,
                    str(report["landmarks"]),
                    f"{whole['rmse_m']:.3f}",
                    f"{whole['nees_inside_95']:.2f}",
                    f"{online['rmse_m']:.3f}",
                    f"{online['nees_inside_95']:.2f}",
                    f"{1e-3 * sum(report['time_ms'].values()):.1f}",
                )
            )
    heads = ("robot", "association", "landmarks", "rmse m", "NEES in 95 %", "online rmse m")
    machine.table("MRCLAM 7, after alignment", (*heads, "online NEES in 95 %", "CPU s"), rows)
    machine.note(f"goal without names: rmse <= {GOAL_M:g} m, NEES inside >= {GOAL_INSIDE:g}")
    path = folder / "landmark" / "victoria_park.txt"
    rows = []
    slam(SlamOptions(log=path, solver="graph"), lambda *_: None)  # compiles
    for solver in ("ekf", "graph"):
        result = slam(SlamOptions(log=path, solver=solver), lambda *_: None)
        spent = result.figures["time_ms"]
        chi2 = result.figures.get("chi2")
        rows.append(
            (
                solver,
                str(len(result.landmarks.names)),
                f"{spent['filter']:.0f}",
                f"{spent['graph']:.0f}" if "graph" in spent else "-",
                "-" if chi2 is None else f"{chi2:.1f}",
            )
        )
    heads = ("solver", "landmarks", "filter, CPU ms", "smoother, CPU ms", "chi2")
    machine.table("Victoria Park, the whole log, association known", heads, rows)


def run(rounds: int, _seconds: float) -> None:
    """Measure all."""
    updates(rounds)
    consistency()
    folder = Path(os.environ.get("ROBOTCTL_DATA", machine.ROOT.parent / "shared" / "data"))
    if (folder / "mrclam").is_dir() and (folder / "landmark").is_dir():
        logs(folder)
    else:
        machine.note(f"logs: not measured, no {folder / 'mrclam'}; set ROBOTCTL_DATA")
