"""Distances against scipy's transform, to the cell."""

import numpy as np
import pytest
from scipy import ndimage

from robotctl.estimation.ranging.distance_field import FAR, SQUARES, distance_bytes


@pytest.mark.parametrize(("shape", "share"), [((40, 57), 0.02), ((300, 700), 2e-5), ((1, 30), 0.1)])
def test_distances_are_exact_up_to_20_cells_and_near_it_up_to_255(shape, share):
    occupied = np.random.default_rng(3).random(shape) < share
    occupied[0, -1] = True
    exact = ndimage.distance_transform_edt(~occupied)
    found = distance_bytes(occupied)[1:-1, 1:-1]
    near, far = exact <= 20.0, exact >= 255.0
    assert np.array_equal(SQUARES[found][near], np.rint(exact[near] ** 2))
    np.testing.assert_allclose(np.sqrt(SQUARES[found][~far]), exact[~far], rtol=0.015)
    assert np.array_equal(found == FAR, far)


def test_a_map_takes_a_byte_a_cell_and_its_outside_is_far():
    occupied = np.zeros((50, 60), np.bool_)
    occupied[10, 20] = True
    found = distance_bytes(occupied)
    assert found.nbytes == 52 * 62
    assert np.all(found[[0, -1]] == FAR)
    assert np.all(found[:, [0, -1]] == FAR)
