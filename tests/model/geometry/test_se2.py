"""SE(2): group laws, scipy's matrix exponential as oracle."""

import math

import numpy as np
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st

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


def test_half_a_turn_has_a_positive_angle():
    assert SE2(0.0, 0.0, -math.pi).log().theta_rad == math.pi
    assert wrap_angle(SE2.exp(1.0, 0.0, -math.pi).theta_rad) == math.pi
