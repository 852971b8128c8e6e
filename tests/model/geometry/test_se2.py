"""SE(2): group laws, scipy's matrix exponential as oracle, numerical Jacobians."""

import math

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st

from robotctl.model.geometry import se2_jacobians as jacobians
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2

lengths = st.floats(-5.0, 5.0)
thetas = (
    st.floats(-3.1, 3.1)
    | st.floats(-1e-3, 1e-3)
    | st.sampled_from([0.0, 0.2499, 0.2501, math.pi, 1e-9, -1e-5])
)
poses = st.builds(SE2, lengths, lengths, thetas)
tangents = st.tuples(lengths, lengths, thetas)


def matrix(T: SE2) -> np.ndarray:
    c, s = math.cos(T.theta_rad), math.sin(T.theta_rad)
    return np.array([[c, -s, T.x_m], [s, c, T.y_m], [0, 0, 1]])


def algebra(xi: tuple[float, float, float]) -> np.ndarray:
    return np.array([[0, -xi[2], xi[0]], [xi[2], 0, xi[1]], [0, 0, 0]])


def assert_same(A: SE2, B: SE2, tolerance: float = 1e-9) -> None:
    np.testing.assert_allclose(matrix(A), matrix(B), atol=tolerance)


def numerical(function, n_out: int, h: float = 1e-6) -> np.ndarray:
    """Central differences of `function(delta)` at 0."""
    J = np.zeros((n_out, 3))
    for i in range(3):
        delta = np.zeros(3)
        delta[i] = h
        J[:, i] = (np.array(function(delta)) - np.array(function(-delta))) / (2 * h)
    return J


@given(tangents)
def test_exp_is_the_matrix_exponential(xi):
    np.testing.assert_allclose(matrix(SE2.exp(*xi)), scipy.linalg.expm(algebra(xi)), atol=1e-9)


@given(tangents)
def test_log_undoes_exp(xi):
    np.testing.assert_allclose(SE2.exp(*xi).log(), xi, atol=1e-9)


@given(poses)
def test_exp_undoes_log(T):
    assert_same(SE2.exp(*T.log()), T)


@given(poses, poses, poses)
def test_composition_is_the_matrix_product_and_associative(A, B, C):
    np.testing.assert_allclose(matrix(A @ B), matrix(A) @ matrix(B), atol=1e-9)
    assert_same((A @ B) @ C, A @ (B @ C))


@given(poses)
def test_a_motion_and_its_inverse_cancel(T):
    assert_same(T @ T.inverse(), SE2())
    assert_same(T.inverse() @ T, SE2())


@given(poses, poses)
def test_every_operation_wraps_the_heading(A, B):
    for T in (A @ B, A.inverse(), SE2.exp(1.0, 2.0, 9.0)):
        assert -math.pi < T.theta_rad <= math.pi


@given(poses, lengths, lengths)
def test_apply_maps_points_as_the_matrix_does(T, x, y):
    np.testing.assert_allclose(T.apply(x, y), (matrix(T) @ [x, y, 1])[:2], atol=1e-9)


@given(poses, tangents)
def test_the_adjoint_moves_a_tangent_to_the_other_side(T, xi):
    moved = jacobians.adjoint(T) @ xi
    assert_same(T @ SE2.exp(*xi), SE2.exp(*moved) @ T, 1e-7)


@given(tangents)
def test_jacobians_of_exp_agree_with_differences(xi):
    xi_array = np.array(xi)
    E = SE2.exp(*xi)
    left = numerical(lambda d: (SE2.exp(*(xi_array + d)) @ E.inverse()).log(), 3)
    right = numerical(lambda d: (E.inverse() @ SE2.exp(*(xi_array + d))).log(), 3)
    np.testing.assert_allclose(jacobians.left_jacobian(*xi), left, atol=1e-7)
    np.testing.assert_allclose(jacobians.right_jacobian(*xi), right, atol=1e-7)


@given(tangents)
def test_inverse_jacobians_are_inverses(xi):
    for J, J_inverse in (
        (jacobians.left_jacobian, jacobians.left_jacobian_inverse),
        (jacobians.right_jacobian, jacobians.right_jacobian_inverse),
    ):
        np.testing.assert_allclose(J(*xi) @ J_inverse(*xi), np.eye(3), atol=1e-9)


@given(tangents)
def test_left_and_right_jacobian_differ_by_the_adjoint(xi):
    np.testing.assert_allclose(
        jacobians.left_jacobian(*xi),
        jacobians.adjoint(SE2.exp(*xi)) @ jacobians.right_jacobian(*xi),
        atol=1e-9,
    )


@pytest.mark.parametrize("theta", [1e-12, 1e-8, 1e-5, 1e-3, 0.1, 0.2499999, 0.2500001])
def test_the_left_jacobian_near_zero_is_its_power_series(theta):
    """J_l = sum ad^k / (k + 1)!, summed in exact order without any division by theta."""
    xi = (1.3, -0.7, theta)
    ad = np.array([[0, -theta, xi[1]], [theta, 0, -xi[0]], [0, 0, 0]])
    J, term = np.eye(3), np.eye(3)
    for k in range(1, 20):
        term = term @ ad / (k + 1)
        J = J + term
    np.testing.assert_allclose(jacobians.left_jacobian(*xi), J, rtol=1e-12, atol=1e-15)


@given(poses, poses)
def test_jacobians_of_compose_and_inverse_agree_with_differences(A, B):
    by_A, by_B = jacobians.compose_jacobians(B)
    AB_inverse = (A @ B).inverse()
    np.testing.assert_allclose(
        by_A, numerical(lambda d: (AB_inverse @ (A @ SE2.exp(*d) @ B)).log(), 3), atol=1e-7
    )
    np.testing.assert_allclose(
        by_B, numerical(lambda d: (AB_inverse @ (A @ B @ SE2.exp(*d))).log(), 3), atol=1e-7
    )
    np.testing.assert_allclose(
        jacobians.inverse_jacobian(A),
        numerical(lambda d: (A @ (A @ SE2.exp(*d)).inverse()).log(), 3),
        atol=1e-7,
    )


@given(poses, lengths, lengths)
def test_jacobians_of_apply_agree_with_differences(T, x, y):
    by_T, by_point = jacobians.apply_jacobians(T, x, y)
    np.testing.assert_allclose(
        by_T, numerical(lambda d: (T @ SE2.exp(*d)).apply(x, y), 2), atol=1e-7
    )
    np.testing.assert_allclose(
        by_point, numerical(lambda d: T.apply(x + d[0], y + d[1]), 2)[:, :2], atol=1e-7
    )


def test_half_a_turn_has_a_positive_angle():
    assert SE2(0.0, 0.0, -math.pi).log().theta_rad == math.pi
    assert wrap_angle(SE2.exp(1.0, 0.0, -math.pi).theta_rad) == math.pi
