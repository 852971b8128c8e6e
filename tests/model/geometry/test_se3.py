"""SE(3): group laws, scipy's expm and logm as oracles, numerical Jacobians, singular points."""

import math

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.model.geometry import se3, so3
from robotctl.model.geometry.se3 import SE3

lengths = st.floats(-5.0, 5.0)
magnitudes = (
    st.floats(0.0, 3.1)
    | st.floats(0.0, 1e-4)
    | st.sampled_from([0.0, 1e-12, 1e-8, 0.9999, 1.0001, math.pi - 1e-4, math.pi - 1e-9])
)


@st.composite
def tangents(draw):
    axis = np.array(draw(st.tuples(*[st.floats(-1.0, 1.0)] * 3)))
    axis[np.abs(axis) < 1e-6] = 0.0  # subnormal numbers overflow in scipy's logm
    norm = np.linalg.norm(axis)
    axis = axis / norm if norm > 1e-3 else np.array([0.0, 0.6, -0.8])
    return np.concatenate([draw(st.tuples(lengths, lengths, lengths)), draw(magnitudes) * axis])


poses = tangents().map(SE3.exp)


def algebra(xi: np.ndarray) -> np.ndarray:
    M = np.zeros((4, 4))
    M[:3, :3] = [[0, -xi[5], xi[4]], [xi[5], 0, -xi[3]], [-xi[4], xi[3], 0]]
    M[:3, 3] = xi[:3]
    return M


def ad(xi: np.ndarray) -> np.ndarray:
    M = np.zeros((6, 6))
    M[:3, :3] = M[3:, 3:] = algebra(xi)[:3, :3]
    M[:3, 3:] = algebra(np.concatenate([np.zeros(3), xi[:3]]))[:3, :3]
    return M


def assert_same(A: SE3, B: SE3, tolerance: float = 1e-8) -> None:
    np.testing.assert_allclose(A.matrix(), B.matrix(), atol=tolerance)


def numerical(function, h: float = 1e-6) -> np.ndarray:
    columns = []
    for i in range(6):
        delta = np.zeros(6)
        delta[i] = h
        columns.append((function(delta) - function(-delta)) / (2 * h))
    return np.stack(columns, axis=1)


@given(tangents())
def test_exp_is_the_matrix_exponential(xi):
    np.testing.assert_allclose(SE3.exp(xi).matrix(), scipy.linalg.expm(algebra(xi)), atol=1e-9)


@given(tangents())
def test_log_undoes_exp_up_to_nearly_pi(xi):
    np.testing.assert_allclose(SE3.exp(xi).log(), xi, atol=1e-6)


@settings(max_examples=40)
@given(tangents().filter(lambda xi: 1e-3 < np.linalg.norm(xi[3:]) < 3.0))
def test_log_is_the_matrix_logarithm(xi):
    T = SE3.exp(xi)
    logarithm = np.real(scipy.linalg.logm(T.matrix()))
    np.testing.assert_allclose(algebra(T.log()), logarithm, atol=1e-7)


@pytest.mark.parametrize("gap", [0.0, 1e-15, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3])
def test_log_is_good_next_to_half_a_turn(gap):
    axis = np.array([0.48, -0.6, 0.64])
    T = SE3.exp(np.concatenate([[1.0, 2.0, 3.0], (math.pi - gap) * axis]))
    phi = T.log()[3:]
    assert np.linalg.norm(phi) == pytest.approx(math.pi - gap, abs=1e-14)
    np.testing.assert_allclose(np.abs(phi / np.linalg.norm(phi) @ axis), 1.0, atol=1e-14)
    assert_same(SE3.exp(T.log()), T, 1e-13)


@pytest.mark.parametrize("axis", np.eye(3), ids=["x", "y", "z"])
def test_an_exact_half_turn_about_each_axis_survives_the_matrix_form(axis):
    R = 2 * np.outer(axis, axis) - np.eye(3)
    T = np.eye(4)
    T[:3, :3] = R
    np.testing.assert_allclose(np.abs(SE3.from_matrix(T).log()[3:]), math.pi * axis, atol=1e-12)


@given(poses, poses, poses)
def test_composition_is_the_matrix_product_and_associative(A, B, C):
    np.testing.assert_allclose((A @ B).matrix(), A.matrix() @ B.matrix(), atol=1e-9)
    assert_same((A @ B) @ C, A @ (B @ C))


@given(poses)
def test_a_motion_and_its_inverse_cancel(T):
    assert_same(T @ T.inverse(), SE3())
    assert_same(SE3.from_matrix(T.matrix()), T)


def test_a_long_chain_of_compositions_stays_a_rotation():
    step = SE3.exp(np.array([0.01, 0.0, 0.0, 0.3, -0.2, 0.1]))
    T = SE3()
    for _ in range(5000):
        T = T @ step
    np.testing.assert_allclose(T.rotation() @ T.rotation().T, np.eye(3), atol=1e-14)


@given(poses, tangents())
def test_the_adjoint_moves_a_tangent_to_the_other_side(T, xi):
    assert_same(T @ SE3.exp(xi), SE3.exp(T.adjoint() @ xi) @ T, 1e-6)


@given(tangents())
def test_the_left_jacobian_is_its_power_series(xi):
    J, term = np.eye(6), np.eye(6)
    for k in range(1, 60):
        term = term @ ad(xi) / (k + 1)
        J = J + term
    np.testing.assert_allclose(se3.left_jacobian(xi), J, atol=1e-10)


@given(tangents())
def test_jacobians_of_exp_agree_with_differences(xi):
    E = SE3.exp(xi)
    left = numerical(lambda d: (SE3.exp(xi + d) @ E.inverse()).log())
    right = numerical(lambda d: (E.inverse() @ SE3.exp(xi + d)).log())
    np.testing.assert_allclose(se3.left_jacobian(xi), left, atol=1e-6)
    np.testing.assert_allclose(se3.right_jacobian(xi), right, atol=1e-6)


@given(tangents())
def test_inverse_jacobians_are_inverses(xi):
    for J, J_inverse in (
        (se3.left_jacobian, se3.left_jacobian_inverse),
        (se3.right_jacobian, se3.right_jacobian_inverse),
    ):
        np.testing.assert_allclose(J(xi) @ J_inverse(xi), np.eye(6), atol=1e-8)


@given(poses, poses)
def test_jacobians_of_compose_and_inverse_agree_with_differences(A, B):
    by_A, by_B = A.compose_jacobians(B)
    AB_inverse = (A @ B).inverse()
    np.testing.assert_allclose(
        by_A, numerical(lambda d: (AB_inverse @ (A @ SE3.exp(d) @ B)).log()), atol=1e-6
    )
    np.testing.assert_allclose(
        by_B, numerical(lambda d: (AB_inverse @ (A @ B @ SE3.exp(d))).log()), atol=1e-6
    )
    np.testing.assert_allclose(
        A.inverse_jacobian(),
        numerical(lambda d: (A @ (A @ SE3.exp(d)).inverse()).log()),
        atol=1e-6,
    )


@given(poses, st.tuples(lengths, lengths, lengths))
def test_jacobians_of_apply_agree_with_differences(T, point):
    p = np.array(point)
    by_T, by_point = T.apply_jacobians(p)
    np.testing.assert_allclose(by_T, numerical(lambda d: (T @ SE3.exp(d)).apply(p)), atol=1e-6)
    np.testing.assert_allclose(by_point, numerical(lambda d: T.apply(p + d[:3]))[:, :3], atol=1e-6)


@given(poses)
def test_many_points_map_as_one(T):
    points = np.arange(12.0).reshape(4, 3)
    expected = np.stack([(T.matrix() @ [*point, 1.0])[:3] for point in points])
    np.testing.assert_allclose(T.apply(points), expected, atol=1e-9)


@pytest.mark.parametrize("angle", [0.5, 0.9999999, 1.0000001, 2.0])
def test_the_coefficients_are_the_same_from_series_and_closed_form(angle):
    t = angle
    k = so3.coefficients(angle)
    assert k.b == pytest.approx((1 - math.cos(t)) / t**2, rel=1e-13)
    assert k.c == pytest.approx((t - math.sin(t)) / t**3, rel=1e-13)
    assert k.d == pytest.approx((t * t + 2 * math.cos(t) - 2) / (2 * t**4), rel=1e-12)
    assert k.e == pytest.approx((2 * t + t * math.cos(t) - 3 * math.sin(t)) / (2 * t**5), rel=1e-10)


@pytest.mark.parametrize(
    "q", [(0.0, 0.0, 0.0, 0.0), (math.nan, 0.0, 0.0, 1.0), (math.inf, 0.0, 0.0, 0.0)]
)
def test_a_quaternion_without_direction_is_refused(q):
    with pytest.raises(ValueError, match="not a rotation"):
        SE3((0.0, 0.0, 0.0), q)


def test_matrices_that_are_no_motion_are_refused():
    with pytest.raises(ValueError, match="reflection"):
        SE3.from_matrix(np.diag([1.0, 1.0, -1.0, 1.0]))
    with pytest.raises(ValueError, match="orthogonal"):
        SE3.from_matrix(np.diag([1.0, 1.0, 2.0, 1.0]))
    with pytest.raises(ValueError, match="homogeneous"):
        SE3.from_matrix(np.full((4, 4), 1.0))
