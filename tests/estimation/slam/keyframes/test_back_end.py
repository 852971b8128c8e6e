"""The graph of the keyframes ends at its own optimum, as a batch finds it."""

import math
import tracemalloc

import numpy as np

from robotctl.estimation.slam.keyframes.back_end import BackEnd, KeyframeLink, KeyframeLinks
from robotctl.estimation.slam.robust.robust_cost import OFF
from robotctl.estimation.slam.solvers.batch import levenberg_marquardt
from robotctl.estimation.slam.solvers.problem import Problem, gauge, nobody
from robotctl.model.geometry.se2 import SE2
from robotctl.workbench.slam.keyframe_graph import graph_of

INFORMATION = np.diag([400.0, 400.0, 2000.0])


def test_a_graph_with_a_wrong_loop_ends_where_a_batch_without_it_ends():
    rng = np.random.default_rng(5)
    step, count = SE2(1.0, 0.0, 2.0 * math.pi / 40.0), 81
    back_end = BackEnd()
    back_end.add(SE2())
    for number in range(1, count):
        dx, dy, turn = rng.normal(0.0, [0.03, 0.03, 0.01])
        measured = step @ SE2(dx, dy, turn)
        back_end.add(back_end.pose(number - 1) @ measured)
        back_end.link(KeyframeLink(number - 1, number, measured, INFORMATION))
        back_end.update()
    # The second round passes the places of the first; one loop is 1.2 m wrong.
    right = [KeyframeLink(k, k + 40, SE2(*rng.normal(0, 0.03, 2)), INFORMATION, is_loop=True)
             for k in range(0, 40, 4)]  # fmt: skip
    wrong = KeyframeLink(6, 60, SE2(1.2, 0.0, 0.0), INFORMATION, is_loop=True)
    back_end.close([*right, wrong])
    back_end.finish()
    assert back_end.weights[-1] < OFF
    file = graph_of(back_end)
    fixed = gauge(file.graph, file.fixed)
    chi2 = levenberg_marquardt(Problem(file.graph, file.values, fixed), nobody).chi2
    assert chi2[0] - chi2[-1] < 1e-6 * chi2[-1]


def test_links_are_what_was_put_in_and_take_little_memory():
    rng = np.random.default_rng(3)
    links = [
        KeyframeLink(
            k, k + 7, SE2(*rng.normal(0.0, 2.0, 3)), rng.normal(0.0, 9.0, (3, 3)),
            is_loop=bool(k % 3), is_given=bool(k % 2),
        )
        for k in range(1000)
    ]  # fmt: skip
    tracemalloc.start()
    kept = KeyframeLinks(links)
    used, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(kept) == len(links)
    for own, link in zip([*kept, kept[-1], *kept[5:9]], [*links, links[-1], *links[5:9]],
                         strict=True):  # fmt: skip
        assert (own.first, own.second, own.pose) == (link.first, link.second, link.pose)
        assert (own.is_loop, own.is_given) == (link.is_loop, link.is_given)
        assert np.array_equal(own.information, link.information)
    assert used < 2 * 110 * len(links)  # room for as many again
