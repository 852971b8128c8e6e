"""Normals of the surfaces in a grid."""

from __future__ import annotations

import math

import numpy as np

from robotctl.estimation.ranging.grid_echoes import surface_normals


def test_normals_stand_on_straight_walls_and_corners_have_none():
    angle = math.radians(30)
    y, x = np.mgrid[0:120, 0:120] - 60.0
    along = np.abs(-math.sin(angle) * x + math.cos(angle) * y) < 1.0
    normals = surface_normals(along)[60, 60]
    assert abs(-math.sin(angle) * normals[0] + math.cos(angle) * normals[1]) > math.cos(0.05)
    cross = along | (np.abs(math.cos(angle) * x + math.sin(angle) * y) < 1.0)
    assert np.array_equal(surface_normals(cross)[60, 60], [0.0, 0.0])
