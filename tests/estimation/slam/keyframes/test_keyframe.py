"""A keyframe is small, and has what matching needs of its scan whenever it is asked."""

import dataclasses

import numpy as np

from robotctl.estimation.slam.front_end.point_to_line import binned
from robotctl.estimation.slam.front_end.surface import surface_of
from robotctl.estimation.slam.keyframes.keyframe import Keyframe
from robotctl.model.geometry.se2 import SE2
from tests.estimation.slam.keyframes.test_mapper import OFFICE
from tests.estimation.slam.lidar_world import scan_of


def bytes_of(value):
    """Return the bytes of all arrays in a value and its fields."""
    if isinstance(value, np.ndarray):
        return value.nbytes
    if dataclasses.is_dataclass(value):
        return sum(bytes_of(getattr(value, each.name)) for each in dataclasses.fields(value))
    return 0


def keyframes(count):
    rng = np.random.default_rng(4)
    poses = [SE2(1.0 + 0.05 * row, 1.0, 0.0) for row in range(count)]
    return [Keyframe(scan_of(OFFICE, pose, rng), 0.05 * row) for row, pose in enumerate(poses)]


def test_a_keyframe_keeps_an_angle_and_a_range_for_each_beam_and_no_more():
    for each in keyframes(3):
        assert each.surface.outline.nbytes > 0
        assert bytes_of(each) == 16 * len(each.scan.ranges_m)


def test_after_many_others_a_keyframe_has_the_same_echoes_again():
    kept = keyframes(200)
    before = [(each.surface, each.bins, each.view) for each in kept[:2]]
    for each in kept:
        assert len(each.bins.points) == len(each.surface.outline)
        assert each.view.farthest.max() > 0.0
    for each, (surface, bins, view) in zip(kept, before, strict=False):
        assert each.surface is not surface
        assert np.array_equal(each.surface.points, surface.points)
        assert np.array_equal(each.bins.begins, bins.begins)
        assert np.array_equal(each.view.nearest, view.nearest)
        assert np.array_equal(each.bins.points, binned(surface_of(each.scan)).points)
