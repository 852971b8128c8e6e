"""Several lidars, each with its mount and time, as one view."""

import numpy as np
import pytest

from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.estimation.ranging.merging import ScanMerger
from robotctl.estimation.slam.front_end.agreement import agreement, view_of
from robotctl.estimation.slam.front_end.surface import Surface, surface_of
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan

MS = 1_000_000
HALF = np.radians(np.arange(-90.0, 90.5))


def scan(name, stamp_ms, x_m=0.0, heading_rad=0.0, range_m=2.0):
    """Return a half circle of echoes."""
    angles = heading_rad + HALF
    return RangeScan(
        stamp_ms * MS, angles, np.full(len(angles), range_m), 10.0, x_m, 0.0, name=name
    )


def echo(point):
    """Return a single echo, of which nobody knows which way its surface faces."""
    points, unknown = point[None], np.zeros((1, 2))
    return Surface(points, unknown, np.ones(1), points, unknown)


def test_one_lidar_makes_a_view_at_each_scan():
    merger = ScanMerger()
    scans = [scan("", stamp) for stamp in (0, 100, 200)]
    assert [merger.add(each, SE2()) for each in scans] == scans


def test_another_lidar_is_moved_to_the_time_of_the_first_by_odometry():
    merger = ScanMerger()
    merger.add(scan("front", 0), SE2())
    rear = scan("rear", 60, -0.3, np.pi)
    assert merger.add(rear, SE2(1.0, 2.0, 0.3)) is None
    view = merger.add(scan("front", 100), SE2(1.1, 2.0, 0.4))
    assert view is not None
    # What lies somewhere in `odom` lies there in the view, too.
    (other,) = view.others
    seen = other.points_base()
    expected = [SE2(1.0, 2.0, 0.3).apply(*point) for point in rear.points_base()]
    assert np.allclose([SE2(1.1, 2.0, 0.4).apply(*point) for point in seen], expected, atol=1e-9)
    assert len(view.points_base()) == 2 * len(HALF)


def test_what_is_old_has_no_part_and_another_lidar_follows_one_that_is_silent():
    merger = ScanMerger()
    merger.add(scan("front", 0), SE2())
    assert merger.add(scan("rear", 10), SE2()) is None
    view = merger.add(scan("front", 400), SE2())
    assert view is not None
    assert len(view.others) == 1
    late = merger.add(scan("front", 800), SE2())
    assert late is not None
    assert late.others == ()
    assert merger.add(scan("rear", 1200), SE2()) is None
    follows = merger.add(scan("rear", 1400), SE2())
    assert follows is not None
    assert follows.name == "rear"
    assert follows.others == ()


@pytest.fixture
def view():
    """Return a front lidar that sees a wall at 2 m, and a rear one 1 m behind it, one at 4 m."""
    front = scan("front", 0, 0.5)
    rear = scan("rear", 0, -0.5, np.pi, range_m=4.0)
    return RangeScan(
        0, front.angles_rad, front.ranges_m, 10.0, 0.5, 0.0, name="front", others=(rear,)
    )


def test_normals_look_to_the_lidar_that_saw_the_wall(view):
    surface = surface_of(view)
    assert len(surface.points) == 2 * len(HALF)
    ahead = surface.points[:, 0] > 0.6
    behind = surface.points[:, 0] < -0.6
    has_normal = np.hypot(*surface.normals.T) > 0.0
    to_front = [0.5, 0.0] - surface.points
    to_rear = [-0.5, 0.0] - surface.points
    assert np.all((surface.normals * to_front).sum(axis=1)[ahead & has_normal] > 0.0)
    assert np.all((surface.normals * to_rear).sum(axis=1)[behind & has_normal] > 0.0)


def test_each_lidar_looks_through_what_stands_before_its_own_echoes(view):
    seen = view_of(view)
    points = np.array([[1.5, 0.0], [2.5, 0.0], [-1.5, 0.0], [-4.5, 0.0]])
    verdicts = [agreement(seen, echo(each), SE2()) for each in points]
    assert [each.agrees for each in verdicts] == [0.0, 1.0, 0.0, 1.0]
    assert [each.contradicts for each in verdicts] == [1.0, 0.0, 1.0, 0.0]


def test_the_map_is_free_along_each_beam_from_its_own_origin(view):
    grid = OccupancyGrid()
    grid.update_scan(SE2(), view)
    alone = OccupancyGrid()
    for each in view.parts:
        alone.update_scan(SE2(), each)
    both = grid.to_map()
    assert np.array_equal(both.cells, alone.to_map().cells)


def test_a_view_moves_as_a_whole(view):
    pose = SE2(1.0, -2.0, 0.7)
    expected = [pose.apply(*point) for point in view.points_base()]
    assert np.allclose(view.moved(pose).points_base(), expected, atol=1e-9)
