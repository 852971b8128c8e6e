"""Each kind of factor: its Jacobians are those of its residual, which means what it says.

A factor added to the registry is tested here by itself.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from robotctl.estimation.slam.factors.registry import FACTORS
from robotctl.estimation.slam.graph.factor import FactorBlock, Linearised, numerical_jacobians
from robotctl.estimation.slam.graph.variables import KINDS, POINT2, SE2, SE3
from robotctl.model.geometry import se2

SEEDS = st.integers(0, 2**32 - 1)


def random_values(kind, n, rng):
    values = rng.normal(0.0, 3.0, (n, kind.size))
    if kind is SE3:
        values[:, 3:] /= np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
    return values


def random_block(kind, n, rng):
    rows = tuple(np.arange(n) for _ in kind.variables)
    z = rng.normal(0.0, 2.0, (n, kind.measurement))
    if kind.measurement >= SE3.size:
        z[:, -4:] /= np.linalg.norm(z[:, -4:], axis=1, keepdims=True)
    return FactorBlock(kind, rows, z, np.tile(np.eye(kind.size), (n, 1, 1)))


@pytest.mark.parametrize("name", FACTORS)
@given(seed=SEEDS)
def test_the_jacobians_of_a_factor_are_those_of_its_residual(name, seed):
    rng = np.random.default_rng(seed)
    kind = FACTORS[name]
    block = random_block(kind, 20, rng)
    values = tuple(random_values(each, 20, rng) for each in kind.variables)
    found = Linearised.empty(block)
    found.fill(block, values)
    residuals = kind.residual(*values, block.measurements)
    wanted = Linearised.empty(block)
    numerical_jacobians(block, values, wanted.jacobians)
    np.testing.assert_allclose(found.residuals, residuals, atol=1e-12)
    for ours, theirs in zip(found.jacobians, wanted.jacobians, strict=True):
        # A difference over a jump of the wrapped angle, or near a pole, says nothing.
        size = np.abs(theirs).max(axis=(1, 2))
        smooth = (size < 30.0) & (np.abs(residuals).max(axis=1) < 3.1 if "bear" in name else True)
        if name == "ground_point":  # at the horizon it changes without bounds
            smooth &= np.abs(residuals).max(axis=1) < 10.0
        np.testing.assert_allclose(ours[smooth], theirs[smooth], atol=2e-6)


def test_between_in_the_plane_is_the_pose_that_is_left_when_the_measured_one_is_taken_off():
    a, b, z = se2.SE2(1.0, 2.0, 2.5), se2.SE2(-1.0, 0.5, -3.0), se2.SE2(0.3, -0.7, 1.2)
    left = z.inverse() @ (a.inverse() @ b)
    rows = [np.array([[each.x_m, each.y_m, each.theta_rad]]) for each in (a, b, z)]
    np.testing.assert_allclose(
        FACTORS["between_2d"].residual(*rows)[0], (left.x_m, left.y_m, left.theta_rad), atol=1e-12
    )


def test_a_wheel_arc_of_more_than_half_a_circle_fits_itself():
    driven = se2.SE2.exp(2.0, 0.0, 4.0)
    rows = [np.array([each]) for each in ((0.0, 0.0, 0.0), (driven.x_m, driven.y_m, 4.0))]
    residual = FACTORS["odometry_arc"].residual(*rows, np.array([[2.0, 4.0]]))
    np.testing.assert_allclose(residual, 0.0, atol=1e-12)


def test_a_floor_point_on_the_optical_axis_is_at_the_middle_of_the_picture():
    # 1 m high, 45 degrees down: the axis meets the floor 1 m ahead.
    r = np.sqrt(0.5)
    down = Rotation.from_matrix([[0.0, -r, r], [-1.0, 0.0, 0.0], [0.0, -r, -r]])
    mount = [0.0, 0.0, 1.0, *down.as_quat()]
    pose, point = np.array([[2.0, 1.0, np.pi / 2]]), np.array([[2.0, 2.0]])
    residual = FACTORS["ground_point"].residual(pose, point, np.array([[0.0, 0.0, *mount]]))
    np.testing.assert_allclose(residual, 0.0, atol=1e-12)
    right = FACTORS["ground_point"].residual(
        pose, point + np.array([0.1, 0.0]), np.array([[0, 0, *mount]])
    )
    np.testing.assert_allclose(right, [[0.1 / np.sqrt(2.0), 0.0]], atol=1e-12)


@given(SEEDS)
def test_an_increment_of_nothing_changes_nothing_and_small_ones_add_up(seed):
    rng = np.random.default_rng(seed)
    for kind in KINDS:
        values = random_values(kind, 5, rng)
        if kind is SE2:
            values[:, 2] = np.arctan2(np.sin(values[:, 2]), np.cos(values[:, 2]))
        nothing = np.zeros((5, kind.dof))
        np.testing.assert_allclose(kind.retract(values, nothing), values, atol=1e-12)
        step = rng.normal(0.0, 1e-4, (5, kind.dof))
        back = kind.retract(kind.retract(values, step), -step)
        np.testing.assert_allclose(back, values, atol=1e-6)
    assert POINT2.dof == 2
