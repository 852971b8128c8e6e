"""The graph of SLAM that people see: whole, seldom, and only when it changes."""

import numpy as np

from robotctl.app.localisation.slam_graphs import SlamGraphs
from robotctl.estimation.slam.keyframes.back_end import BackEnd, KeyframeLink
from robotctl.model.geometry.se2 import SE2

S = 1_000_000_000
FRAME = SE2(10.0, 0.0, np.pi / 2)
"""The map lies turned by a quarter, 10 m east."""


def driven(count):
    """Return a graph of keyframes 1 m apart, each linked to the one before."""
    back_end = BackEnd()
    for number in range(count):
        back_end.add(SE2(float(number), 0.0, 0.0))
        if number:
            link(back_end, number - 1, number)
    return back_end


def link(back_end, first, second, *, is_loop=False):
    pose = SE2(float(second - first), 0.0, 0.0)
    back_end.link(KeyframeLink(first, second, pose, np.eye(3), is_loop))


def pairs(packed):
    return np.frombuffer(packed, "<i4").reshape(-1, 2).tolist()


def test_keyframes_are_told_in_the_world_with_links_and_loops_apart():
    back_end = driven(4)
    link(back_end, 0, np.int64(3), is_loop=True)  # as a saved map has them
    graph = SlamGraphs().due(back_end, FRAME, 5 * S)
    poses = np.frombuffer(graph.poses, "<f4").reshape(-1, 3)
    assert np.allclose(poses[:, 0], 10.0, atol=1e-5)
    assert np.allclose(poses[:, 1], [0.0, 1.0, 2.0, 3.0], atol=1e-5)
    assert np.allclose(poses[:, 2], np.pi / 2)
    assert pairs(graph.links) == [[0, 1], [1, 2], [2, 3]]
    assert pairs(graph.loops) == [[0, 3]]


def test_it_is_told_at_most_once_a_second_and_again_only_when_it_changes_or_after_ten():
    back_end, graphs = driven(3), SlamGraphs()
    assert graphs.due(BackEnd(), FRAME, 0) is None  # nothing yet
    assert graphs.due(back_end, FRAME, 1 * S)
    back_end.add(SE2(3.0, 0.0, 0.0))
    assert graphs.due(back_end, FRAME, 1 * S + S // 2) is None
    assert graphs.due(back_end, FRAME, 2 * S)
    assert graphs.due(back_end, FRAME, 4 * S) is None
    link(back_end, 0, 3, is_loop=True)
    assert pairs(graphs.due(back_end, FRAME, 5 * S).loops) == [[0, 3]]
    back_end.poses[2, 0] += 0.1
    assert graphs.due(back_end, FRAME, 7 * S)
    assert graphs.due(back_end, FRAME, 16 * S) is None
    assert graphs.due(back_end, FRAME, 17 * S)
