"""Gaps in the pool of a Bayes tree are closed in place, a part at a time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.estimation.slam.incremental.bayes_tree import Cliques, compact

pytestmark = pytest.mark.timeout(600)  # the first of them compiles
GONE = -2


def tree_of(rng, count):
    """Return cliques one after the other in the pool, of which some are gone."""
    columns = rng.integers(1, 4, count)
    rows = columns + rng.integers(1, 5, count)
    behind = rows - columns
    sizes = rows * columns + behind * (behind + 1) // 2
    begins, row_begins = (np.concatenate([[0], np.cumsum(each)]) for each in (sizes, rows))
    parents = np.array([rng.integers(c + 1, count) for c in range(count - 1)] + [-1])
    parents[: count - 1][rng.random(count - 1) < 0.4] = GONE
    # A clique whose parent is gone hangs from the root.
    orphans = (parents >= 0) & (parents[parents] == GONE)
    parents[orphans] = count - 1
    return Cliques(
        parents, columns, rows, row_begins[:-1].copy(), begins[:-1].copy(),
        begins[:-1] + rows * columns, rng.integers(0, 99, row_begins[-1]),
        rng.normal(size=begins[-1]), np.array([count, row_begins[-1], begins[-1], count]),
    )  # fmt: skip


def contents(cliques, numbers):
    """Return rows, columns, numbers and the clique above of some cliques, each by its own name."""
    names = {int(c): row for row, c in enumerate(numbers)}
    found = []
    for c in map(int, numbers):
        rows, columns = int(cliques.rows[c]), int(cliques.columns[c])
        begin, behind = int(cliques.panel_starts[c]), rows - columns
        end = begin + rows * columns + behind * (behind + 1) // 2
        assert cliques.update_starts[c] == begin + rows * columns
        own = cliques.row_pool[cliques.row_starts[c] : cliques.row_starts[c] + rows]
        up = names.get(int(cliques.parents[c]), -1)
        found.append((own.tolist(), columns, cliques.pool[begin:end].tolist(), up))
    return found


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(2, 30), st.integers(0, 400))
def test_closing_gaps_by_parts_keeps_every_clique_and_ends_without_a_gap(seed, count, most):
    rng = np.random.default_rng(seed)
    cliques = tree_of(rng, count)
    alive = np.flatnonzero(cliques.parents != GONE)
    before, needed = contents(cliques, alive), sum(len(c[2]) for c in contents(cliques, alive))
    clique_of, named = np.concatenate([alive, [-1]]), alive.copy()
    for _ in range(len(alive) + 1):
        room = cliques.pool.copy()
        compact(cliques, clique_of, named, most)
        assert named.tolist() == list(range(len(alive)))
        assert clique_of.tolist() == [*named, -1]
        assert contents(cliques, named) == before
        ends = cliques.panel_starts[: len(alive)]
        assert np.all(np.diff(ends) > 0)
        assert cliques.used[0] == cliques.used[3] == len(alive)
        # One clique more than `most` at most is moved.
        longest = max(len(c[2]) for c in before)
        assert np.count_nonzero(cliques.pool != room) <= most + longest
        most = max(most, 1)
    assert cliques.used[2] == needed
