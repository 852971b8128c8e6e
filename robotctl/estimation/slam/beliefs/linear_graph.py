"""A factor graph about one linearisation, as links between pairs of variables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.beliefs.kernels import gather, product, tree_means
from robotctl.estimation.slam.equations import Linearisation, linearise
from robotctl.estimation.slam.graph.factor import FactorBlock, Ints, Linearised
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values
from robotctl.estimation.slam.graph.variables import Floats
from robotctl.estimation.slam.linear.assembly import inner
from robotctl.estimation.slam.start.spanning import incidence, walk

_SMALLEST: Final = 1e-9
"""Standard deviations that are nothing but rounding."""


class Means(NamedTuple):
    """Means of increments, with how good they are; all (n, D).

    Parameters
    ----------
    x
        The means.
    rest
        What is left of -g - H x.
    answer
        The exact means on the forest for the rest: what is missing in x, were there no loops.
    """

    x: Floats
    rest: Floats
    answer: Floats

    @property
    def left(self) -> float:
        """A bound of how far x is from the solution, in the norm of H.

        H is the forest's matrix plus the rest of the factors, so its inverse is the smaller one.
        """
        return float(np.sqrt(max(inner(self.rest, self.answer), 0.0)))


class Schedule(Protocol):
    """Order in which messages are sent."""

    most_rounds: int
    """About one linearisation."""

    def begin(self, graph: LinearGraph) -> None:
        """Begin on a graph with new numbers; its links and variables are those of before."""
        ...

    def round(self, graph: LinearGraph) -> Means:
        """Send each message about once; return the means that follow."""
        ...

    def shift(self, increments: Floats) -> None:
        """Be told that all variables moved by increments (n, D)."""
        ...


class Senders(NamedTuple):
    """The messages that each variable sends: `outgoing[starts[i] : starts[i + 1]]`."""

    outgoing: Ints
    starts: Ints


class _Forest:
    """A spanning forest of fewest steps, on which messages give the exact means.

    Parameters
    ----------
    ends
        Variables of each link, (m, 2).
    is_rooted
        Variables that know their place alone, (n,): trees begin there.
    size
        Numbers of a variable.
    """

    def __init__(self, ends: Ints, is_rooted: NDArray[np.bool_], size: int) -> None:
        n = len(is_rooted)
        first, second = (np.ascontiguousarray(each) for each in ends.T)
        roots = np.argsort(~is_rooted, kind="stable")
        taken, backward = walk(*incidence(first, second, n), first, second, roots, 0)
        self._links = 2 * taken + 1 - backward
        self._children = ends[taken, 1 - backward]
        self._parents = ends[taken, backward]
        self._roots = np.setdiff1d(np.arange(n), self._children)
        self._inverses, self._gains = np.zeros((n, size, size)), np.zeros((n, size, size))

    def gather(self, ends: Ints, H: Floats, precisions: Floats, scales: Floats) -> None:
        """Send the precisions from the leaves to the roots."""
        gather(
            self._children, self._links, self._roots, ends, H, precisions, scales, self._inverses,
            self._gains,
        )  # fmt: skip

    def means(self, vectors: Floats) -> Floats:
        """Return the exact means for vectors (n, D)."""
        return tree_means(
            self._children, self._parents, self._roots, self._inverses, self._gains, vectors
        )


class LinearGraph:
    """H d = -g for the increments d of all variables, solved by messages.

    It can stand for `NormalEquations`. Variables are padded to the D numbers of the largest; fixed
    ones have the increment 0, so a factor that is shared with one belongs to the other alone.
    Factors of the same two variables are one link.

    Parameters
    ----------
    graph
        What is to be solved.
    fixed
        Numbers of the variables that keep their values.
    schedule
        Of the messages.
    share
        Means count as settled when they are off by less than this share of the whole increment,
        both in the norm of H: an error of 1 there is at most one standard deviation of anything.
    """

    def __init__(self, graph: FactorGraph, fixed: Ints, schedule: Schedule, share: float) -> None:
        self.graph = graph
        self.rounds = 0
        """Number of rounds so far."""
        self.left = 0.0
        """How far the last means may be off at most: standard deviations."""
        self.is_settled = True
        self.schedule, self._share = schedule, share
        dof = graph.dof()
        self.D = int(dof.max(initial=1))
        self._is_free = np.ones(graph.size, np.bool_)
        self._is_free[fixed] = False
        self._moved = np.zeros((graph.size, self.D))
        self._find_links()
        self._forest = _Forest(self.ends, self._knows_alone(), self.D)
        n, m, D = graph.size, len(self.ends), self.D
        self.H, self.g = np.zeros((m, 2, 2, D, D)), np.zeros((m, 2, D))
        self.precisions, self.vectors = np.zeros((n, D, D)), np.zeros((n, D))
        self.undamped, self.scales = self.precisions, np.ones((n, D))

    def _find_links(self) -> None:
        """Find the links, and of each factor of two free variables its link; else -1."""
        n = self.graph.size
        codes = []
        for block in self.graph.blocks:
            a, b = self.graph.numbers(block)[0], self.graph.numbers(block)[-1]
            is_link = self._is_free[a] & self._is_free[b] & (a != b)
            codes.append(np.where(is_link, np.minimum(a, b) * n + np.maximum(a, b), -1))
        unique = np.unique(np.concatenate([np.empty(0, np.int64), *codes]))
        unique = unique[unique >= 0]
        self.ends = np.column_stack([unique // max(n, 1), unique % max(n, 1)])
        self._links = [np.where(each < 0, -1, np.searchsorted(unique, each)) for each in codes]
        senders = self.ends.ravel()
        outgoing = np.argsort(senders, kind="stable")
        starts = np.searchsorted(senders[outgoing], np.arange(n + 1))
        self.senders = Senders(outgoing, starts)

    def _knows_alone(self) -> NDArray[np.bool_]:
        """Return which free variables have a factor of their own, (n,)."""
        knows = np.zeros(self.graph.size, np.bool_)
        for block, links in zip(self.graph.blocks, self._links, strict=True):
            for each in self.graph.numbers(block):
                knows[each[links < 0]] = True
        return knows & self._is_free

    def linearise(self, values: Values, into: Linearisation | None = None) -> Linearisation:
        """Return all factors about `values`, in the space of an earlier linearisation if given."""
        return linearise(self.graph, values, into)

    def assemble(self, at: Linearisation, weights: Sequence[Floats] | None = None) -> None:
        """Fill links and variables; `weights` are factors on the information, (n,) a block."""
        self.schedule.shift(self._moved)
        self.H[:], self.g[:], self.vectors[:], self.undamped[:] = 0.0, 0.0, 0.0, 0.0
        self.precisions = self.undamped
        for index, block in enumerate(self.graph.blocks):
            W = block.information
            if weights is not None:
                W = W * weights[index][:, None, None]
            self._add(block, at.blocks[index], W, self._links[index])
        places = np.arange(self.D)
        is_padding = places >= self.graph.dof()[:, None]
        self.undamped[:, places, places] += is_padding | ~self._is_free[:, None]
        self.scales = self.undamped[:, places, places].copy()
        self._right = self.vectors.copy()
        for s in range(2):
            np.add.at(self.scales, self.ends[:, s], self.H[:, s, s, places, places])
            np.add.at(self._right, self.ends[:, s], self.g[:, s])

    @property
    def gradient(self) -> Floats:
        """The vector g of the equations, (n D,)."""
        return -self._right.ravel()

    def _add(self, block: FactorBlock, at: Linearised, W: Floats, links: Ints) -> None:
        """Add factors to their links, or to the only variable of them that is free."""
        numbers, joined = self.graph.numbers(block), links >= 0
        is_turned = (numbers[0] > numbers[-1]).astype(np.int64)
        for a, here in enumerate(numbers):
            J = at.jacobians[a]
            g = -np.einsum("nki,nkl,nl->ni", J, W, at.residuals, optimize=True)
            alone, width = ~joined & self._is_free[here], J.shape[2]
            own, side = links[joined], a ^ is_turned[joined]
            np.add.at(self.g[:, :, :width], (own, side), g[joined])
            np.add.at(self.vectors[:, :width], here[alone], g[alone])
            scaled = J.transpose(0, 2, 1) @ W
            for b, K in enumerate(at.jacobians):
                H, other = scaled @ K, b ^ is_turned[joined]
                np.add.at(self.H[..., :width, : K.shape[2]], (own, side, other), H[joined])
                if a == b:
                    np.add.at(self.undamped[:, :width, :width], here[alone], H[alone])

    @property
    def diagonal(self) -> Floats:
        """The diagonal of the matrix, (n D,)."""
        return self.scales.ravel()

    def factorise(self, damping: Floats | None = None) -> None:
        """Send the precisions on the forest, with `damping` (n D,) on the diagonal.

        What factors do not determine comes out as not settled.
        """
        self.precisions = self.undamped.copy()
        if damping is not None:
            places = np.arange(self.D)
            self.precisions[:, places, places] += damping.reshape(self.scales.shape)
        self._forest.gather(self.ends, self.H, self.precisions, self.scales)

    def solve(self) -> Floats:
        """Return the means of the increments, (n D,), as far as the rounds of the schedule go."""
        self.schedule.begin(self)
        self.is_settled = False
        for _ in range(self.schedule.most_rounds):
            means = self.schedule.round(self)
            self.rounds += 1
            length = np.sqrt(max(inner(means.x, self._right - means.rest), 0.0))
            self.left = means.left
            if self.left <= self._share * length + _SMALLEST:
                self.is_settled = True
                break
        self._moved = means.x
        return means.x.ravel()

    def judge(self, x: Floats) -> Means:
        """Return means x, with how good they are."""
        rest = self._right - product(self.ends, self.H, self.precisions, x)
        return Means(x, rest, self.answer(rest))

    def answer(self, vectors: Floats) -> Floats:
        """Return the exact means on the forest for vectors (n, D)."""
        return self._forest.means(vectors)

    def product(self, x: Floats) -> Floats:
        """Return the matrix times x, (n D,)."""
        rows = x.reshape(self.scales.shape)
        return product(self.ends, self.H, self.undamped, rows).ravel()

    def retract(self, values: Values, increments: Floats) -> Values:
        """Return values moved by increments, (n D,)."""
        rows = increments.reshape(self.scales.shape)
        result = {}
        for kind, ids in self.graph.ids.items():
            first = self.graph.first(kind)
            own = np.ascontiguousarray(rows[first : first + len(ids), : kind.dof])
            result[kind] = kind.retract(values[kind], own)
        return result
