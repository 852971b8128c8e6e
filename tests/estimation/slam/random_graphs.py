"""Small random graphs with fixed variables, priors and loops, and where all really is."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from robotctl.estimation.slam.factors.registry import FACTORS
from robotctl.estimation.slam.graph.builder import GraphBuilder
from robotctl.estimation.slam.graph.variables import POINT2, POINT3, SE2, SE3
from tests.estimation.slam.dense_oracle import RESIDUALS, Dense, coordinates, inverse, matrix_of

SIGMA = 0.02


class RandomGraph:
    """A graph, its values as a file has them, what is fixed, and the dense one."""

    def __init__(self, seed, *, space=False):
        self.rng = np.random.default_rng(seed)
        self.pose, self.point = (SE3, POINT3) if space else (SE2, POINT2)
        self.suffix = "_3d" if space else "_2d"
        self.truth = {self.pose: self._way(int(self.rng.integers(2, 7)))}
        points = int(self.rng.integers(0, 4))
        if points:
            self.truth[self.point] = self.rng.uniform(-4.0, 6.0, (points, self.point.size))
        self.factors = []
        self._add_all()
        self._fix()
        self.dense = Dense(self.factors, self.fixed_places)
        self._build()

    def _chance(self, share):
        return self.rng.random() < share

    def _way(self, count):
        poses = [np.array(self.pose.identity)]
        for _ in range(count - 1):
            T = matrix_of(poses[-1]) @ matrix_of(self._step())
            poses.append(self._value(T))
        return np.array(poses)

    def _step(self):
        if self.pose is SE2:
            return np.array([1.0, 0.0, self.rng.uniform(-1.5, 1.5)])
        turn = Rotation.from_rotvec(self.rng.uniform(-0.8, 0.8, 3)).as_quat()
        return np.concatenate([[1.0, 0.0, 0.0], turn])

    def _value(self, T):
        if self.pose is SE2:
            return coordinates(T)
        return np.concatenate([T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_quat()])

    def _noisy(self, value):
        d = self.pose.positions
        result = np.array(value, float)
        result[:d] += SIGMA * self.rng.standard_normal(d)
        if len(value) == 3 and self.pose is SE2:
            result[2] += SIGMA * self.rng.standard_normal()
        elif len(value) == 7:
            turn = Rotation.from_rotvec(SIGMA * self.rng.standard_normal(3))
            result[3:] = (Rotation.from_quat(value[3:]) * turn).as_quat()
        return result

    def _information(self, size, *, singular=False):
        half = np.eye(size) + 0.3 * self.rng.standard_normal((size, size))
        if singular:
            half[:, -1] = 0.0  # nothing is said of one direction; of all if there is just one
        return half @ half.T / SIGMA**2

    def _add(self, name, *rows, whole=False):
        kind = FACTORS[name]
        ends = tuple(zip(kind.variables, rows, strict=True))
        true = [self.truth[variable][row] for variable, row in ends]
        if name.startswith("between"):
            z = self._noisy(self._value(inverse(matrix_of(true[0])) @ matrix_of(true[1])))
        elif name.startswith("prior") and kind.variables[0].is_pose:
            z = self._noisy(true[0])
        else:
            nothing = np.zeros(kind.measurement)
            z = RESIDUALS[name](*true, nothing)
            z = z + SIGMA * self.rng.standard_normal(len(z))
        information = self._information(kind.size, singular=not whole and self._chance(0.2))
        self.factors.append((name, ends, z, information))

    def _add_all(self):
        rng, s = self.rng, self.suffix
        count, points = len(self.truth[self.pose]), len(self.truth.get(self.point, ()))
        for k in range(count - 1):
            if self._chance(0.9):
                self._add("between" + s, k, k + 1, whole=True)
        for _ in range(int(rng.integers(0, 3))):
            a, b = rng.choice(count, 2, replace=False)
            self._add("between" + s, int(a), int(b))
        ways = ["seen_3d"] if s == "_3d" else ["seen_2d", "range_bearing", "bearing", "range"]
        for m in range(points):
            for k in rng.choice(count, int(rng.integers(1, count + 1)), replace=False).tolist():
                self._add(str(rng.choice(ways)), k, m)
            self._add(ways[0], int(rng.integers(0, count)), m, whole=True)
            if self._chance(0.2):
                self._add("prior_point" + s, m)
        for k in range(count):
            if self._chance(0.15):
                self._add("position" + s, k)
            if self._chance(0.1):
                self._add("prior" + s, k)

    def _fix(self):
        """Fix some variables, a little beside where they are."""
        self.fixed_places, self.given = set(), {}
        for kind, each in self.truth.items():
            self.given[kind] = each.copy()
            for row in range(len(each)):
                value = self._noisy(each[row])
                if self._chance(0.25):
                    self.fixed_places.add((kind, row))
                else:
                    value = self._noisy(self._noisy(value))
                self.given[kind][row] = value

    def _build(self):
        builder = GraphBuilder()
        offset = {self.pose: 0, self.point: 100}
        for kind, each in self.given.items():
            builder.variables(kind, offset[kind] + np.arange(len(each)), each)
        for name, ends, z, information in self.factors:
            ids = np.array([[offset[kind] + row for kind, row in ends]])
            builder.factors(FACTORS[name], ids, z[None], information[None])
        self.graph, self.values, self.known = builder.build()
        first = self.graph.first
        self.fixed = np.array(sorted(first(k) + row for k, row in self.fixed_places), np.int64)

    def at_truth(self):
        """Return the truth, with fixed variables where the file has them."""
        result = {kind: each.copy() for kind, each in self.truth.items()}
        for kind, row in self.fixed_places:
            result[kind][row] = self.given[kind][row]
        return result
