"""A Gaussian that grows and shrinks, against whole matrices as textbooks have them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.estimation.kalman.growing_gaussian import GrowingGaussian

seeds = st.integers(0, 2**32 - 1)


def covariance(rng, n):
    A = rng.standard_normal((n, n))
    return A @ A.T + 0.1 * np.eye(n)


class Dense:
    """The same with whole matrices."""

    def __init__(self, x, P):
        self.x, self.P = x.copy(), P.copy()

    def predict(self, x_v, F, Q):
        whole = np.eye(len(self.x))
        whole[: len(F), : len(F)] = F
        self.P = whole @ self.P @ whole.T
        self.P[: len(F), : len(F)] += Q
        self.x[: len(F)] = x_v

    def jacobian(self, columns, J):
        m, d, _ = J.shape
        H = np.zeros((m * d, len(self.x)))
        for a in range(m):
            for c, column in enumerate(columns[a]):
                H[d * a : d * (a + 1), column] += J[a, :, c]
        return H

    def update(self, columns, J, innovations, R):
        H, z = self.jacobian(columns, J), innovations.ravel()
        noise = np.zeros((len(z), len(z)))
        for a, own in enumerate(R):
            at = slice(len(own) * a, len(own) * (a + 1))
            noise[at, at] = own
        S = H @ self.P @ H.T + noise
        K = self.P @ H.T @ np.linalg.inv(S)
        self.x = self.x + K @ z
        left = np.eye(len(self.x)) - K @ H
        self.P = left @ self.P @ left.T + K @ noise @ K.T
        return z @ np.linalg.solve(S, z)

    def append(self, y, columns, J, noise):
        n = len(self.x)
        grown = np.vstack([np.eye(n), np.zeros((len(y), n))])
        grown[n:, columns] = J
        self.P = grown @ self.P @ grown.T
        self.P[n:, n:] += noise
        self.x = np.append(self.x, y)

    def remove(self, first, width):
        n = len(self.x)
        last = np.arange(n - width, n)
        kept = np.arange(n - width)
        if first < n - width:
            kept[first : first + width] = last
        self.x, self.P = self.x[kept], self.P[np.ix_(kept, kept)]


def measurement(rng, n):
    """Return measurements of some columns each, as `update` takes them."""
    m, d, k = rng.integers(1, 4, 3)
    columns = np.array([rng.permutation(n)[:k] for _ in range(m)])
    J = rng.standard_normal((m, d, k))
    return columns, J, rng.standard_normal((m, d)), np.array([covariance(rng, d)] * m)


@settings(max_examples=30)
@given(seeds)
def test_it_is_the_textbooks_filter_whatever_is_added_measured_and_forgotten(seed):
    rng = np.random.default_rng(seed)
    x, P = rng.standard_normal(3), covariance(rng, 3)
    own, dense = GrowingGaussian(x, P), Dense(x, P)
    for _ in range(12):
        n = own.n
        J = rng.standard_normal((2, 3))
        where = rng.permutation(n)[:3]
        for each in (own, dense):
            each.append(np.ones(2), where, J, 0.5 * np.eye(2))
        step = measurement(rng, n)
        assert own.update(*step) == pytest.approx(dense.update(*step), rel=1e-6)
        F = np.eye(3) + 0.1 * rng.standard_normal((3, 3))
        for each in (own, dense):
            each.predict(np.zeros(3), F, 0.01 * np.eye(3))
        if rng.uniform() < 0.4:
            first = 3 + 2 * int(rng.integers((own.n - 3) // 2))
            for each in (own, dense):
                each.remove(first, 2)
        scale = np.abs(dense.P).max()
        assert own.x == pytest.approx(dense.x, abs=1e-7 * (1.0 + np.abs(dense.x).max()))
        assert own.covariance() == pytest.approx(dense.P, abs=1e-8 * scale)


def test_the_covariances_of_innovations_are_parts_of_that_of_all():
    rng = np.random.default_rng(1)
    x, P = np.zeros(7), covariance(rng, 7)
    own, dense = GrowingGaussian(x, P), Dense(x, P)
    columns = np.array([[0, 2, 6], [5, 2, 1]])
    J = rng.standard_normal((2, 2, 3))
    H = dense.jacobian(columns, J)
    whole = own.joint_innovation_covariance(columns, J)
    assert whole == pytest.approx(H @ P @ H.T)
    each = own.innovation_covariances(columns, J)
    assert each[0] == pytest.approx(whole[:2, :2])
    assert each[1] == pytest.approx(whole[2:, 2:])


def test_a_block_can_be_read_and_replaced():
    rng = np.random.default_rng(2)
    P = covariance(rng, 5)
    own = GrowingGaussian(np.zeros(5), P)
    some, others = np.array([3, 1]), np.array([0, 4])
    assert own.block(some, others) == pytest.approx(P[np.ix_(some, others)])
    own.set_block(some, np.array([[4.0, 1.0], [1.0, 9.0]]))
    P[np.ix_(some, some)] = [[4.0, 1.0], [1.0, 9.0]]
    assert own.covariance() == pytest.approx(P)
    with pytest.raises(IndexError, match="columns 4 to 5: there are 5"):
        own.block(np.array([4, 5]))


def test_innovations_without_a_covariance_change_nothing():
    own = GrowingGaussian(np.ones(2), np.zeros((2, 2)))
    one = np.ones((1, 1, 1))
    with pytest.raises(ValueError, match="positive definite"):
        own.update(np.array([[0]]), one, np.ones((1, 1)), 0.0 * one)
    assert own.x.tolist() == [1.0, 1.0]
    assert own.covariance().tolist() == [[0.0, 0.0], [0.0, 0.0]]
