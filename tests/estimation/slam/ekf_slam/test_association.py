"""Association against a search of all pairings, and the kinds of features."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.estimation.kalman.chi_squared import chi2_quantile
from robotctl.estimation.slam.ekf_slam.association import (
    NONE,
    Gates,
    joint_compatibility,
    nearest_neighbour,
    pair_nis,
)
from robotctl.estimation.slam.ekf_slam.features import POINT
from robotctl.estimation.slam.ekf_slam.filter import NEW, EkfSlam
from tests.estimation.slam.ekf_slam.textbook import best_pairs

NOISE = np.diag([0.02, 0.02])


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 3), st.integers(1, 4))
def test_joint_compatibility_finds_what_a_search_of_all_pairings_finds(seed, m, k):
    rng = np.random.default_rng(seed)
    features, seen = rng.uniform(-1.0, 1.0, (k, 2)), rng.uniform(-1.0, 1.0, (m, 2))
    near = min(m, k)
    seen[:near] = features[:near] + rng.uniform(-0.5, 0.5, 2) + 0.1 * rng.standard_normal((near, 2))
    root = rng.standard_normal((2 * k, 2 * k)) * 0.1
    G = root @ root.T + 0.1 * np.kron(np.ones((k, k)), np.eye(2))
    off = seen[:, np.newaxis] - features
    R = np.tile(NOISE, (m, 1, 1))
    blocks = np.array([G[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] for i in range(k)])
    found = joint_compatibility(off, G, R, pair_nis(off, blocks, R), 0.95)
    assert found.tolist() == best_pairs(off, G, NOISE, lambda d: chi2_quantile(0.95, d)).tolist()


def test_nearest_neighbour_takes_each_once_and_the_nearest_first():
    nis = np.array([[1.0, 3.0], [0.5, 9.0], [7.0, 8.0]])
    assert nearest_neighbour(nis, 6.0).tolist() == [1, 0, NONE]
    assert nearest_neighbour(nis, 2.0).tolist() == [NONE, 0, NONE]


def two_features():
    """A robot unsure of its heading, and two features side by side."""
    slam = EkfSlam(np.zeros(3), np.diag([1e-4, 1e-4, 0.04]))
    tight = np.diag([1e-4, 1e-6])
    for name, bearing in ((1, -0.1), (2, 0.1)):
        slam.add(POINT, name, np.array([5.0, bearing]), tight)
    # the robot has turned a little since, nobody knows how much
    slam.predict(slam.x_v.copy(), np.eye(3), np.diag([0.0, 0.0, 0.02]))
    return slam, np.tile(tight, (2, 1, 1))


def test_a_common_turn_misleads_the_nearest_neighbour_and_not_joint_compatibility():
    slam, R = two_features()
    z = np.array([[5.0, 0.03], [5.0, 0.23]])  # both 0.13 rad to the left
    assert slam.associate(POINT, z, R).tolist() == [0, 1]
    assert slam.associate(POINT, z, R, "nearest")[0] == 1


def test_what_is_far_from_all_is_new_and_what_is_between_is_neither():
    slam, R = two_features()
    z = np.array([[9.0, 2.0], [5.0, 0.1 + 3.2 * np.sqrt(0.02)]])
    assert slam.associate(POINT, z, R).tolist() == [NEW, NONE]
    empty = EkfSlam(np.zeros(3), np.eye(3))
    assert empty.associate(POINT, z, R).tolist() == [NEW, NEW]


def test_what_may_as_well_be_of_a_neighbour_is_left_out():
    slam, R = two_features()
    between, near = np.array([[5.0, 0.02]]), np.array([[5.0, -0.1]])
    assert slam.associate(POINT, between, R[:1]).tolist() == [NONE]
    assert slam.associate(POINT, between, R[:1], "nearest")[0] in (0, 1)
    slam.update(POINT, np.array([0, 1]), np.array([[5.0, -0.1], [5.0, 0.1]]), R)  # no doubt now
    assert slam.associate(POINT, near, R[:1]).tolist() == [0]


@pytest.mark.parametrize("gates", [(0.0, 0.5), (0.99, 0.9), (0.9, 1.0)])
def test_gates_are_probabilities_in_order(gates):
    with pytest.raises(ValueError, match="gates must be"):
        Gates(*gates)


@settings(max_examples=40)
@given(
    st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3),
    st.floats(0.5, 8.0),
    st.floats(-3.0, 3.0),
)
@pytest.mark.parametrize("kind", [POINT])
def test_jacobians_are_those_of_differences_and_a_new_feature_is_where_it_is_seen(
    kind, pose, first, second
):
    x_v, z = np.array(pose), np.array([first, second])
    y = kind.initial(x_v, z)
    expected, by_robot, by_feature = kind.expected(x_v, y[np.newaxis])
    assert kind.residual(z[np.newaxis], expected) == pytest.approx(np.zeros((1, 2)), abs=1e-9)
    step = 1e-6
    for column in range(3):
        off = np.zeros(3)
        off[column] = step
        ahead, back = (kind.expected(x_v + s * off, y[np.newaxis])[0] for s in (1, -1))
        slope = kind.residual(ahead, back)[0] / (2.0 * step)
        assert by_robot[0][:, column] == pytest.approx(slope, rel=1e-5, abs=1e-6)
    for column in range(2):
        off = np.zeros(2)
        off[column] = step
        ahead, back = (kind.expected(x_v, (y + s * off)[np.newaxis])[0] for s in (1, -1))
        slope = kind.residual(ahead, back)[0] / (2.0 * step)
        assert by_feature[0][:, column] == pytest.approx(slope, rel=1e-5, abs=1e-6)
