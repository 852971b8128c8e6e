"""SE(3): group laws, scipy's expm and logm as oracles, singular points."""

import math

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.model.geometry import so3
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


def assert_same(A: SE3, B: SE3, tolerance: float = 1e-8) -> None:
    np.testing.assert_allclose(A.matrix(), B.matrix(), atol=tolerance)


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


@given(poses, poses, poses)
def test_composition_is_the_matrix_product_and_associative(A, B, C):
    np.testing.assert_allclose((A @ B).matrix(), A.matrix() @ B.matrix(), atol=1e-9)
    assert_same((A @ B) @ C, A @ (B @ C))


@given(poses)
def test_a_motion_and_its_inverse_cancel(T):
    assert_same(T @ T.inverse(), SE3())


def test_a_long_chain_of_compositions_stays_a_rotation():
    step = SE3.exp(np.array([0.01, 0.0, 0.0, 0.3, -0.2, 0.1]))
    T = SE3()
    for _ in range(5000):
        T = T @ step
    np.testing.assert_allclose(T.rotation() @ T.rotation().T, np.eye(3), atol=1e-14)


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


@pytest.mark.parametrize(
    "q", [(0.0, 0.0, 0.0, 0.0), (math.nan, 0.0, 0.0, 1.0), (math.inf, 0.0, 0.0, 0.0)]
)
def test_a_quaternion_without_direction_is_refused(q):
    with pytest.raises(ValueError, match="not a rotation"):
        SE3((0.0, 0.0, 0.0), q)
