r"""A belief over many bodies and their orientations, coarse to fine: wide cells for all, narrow ones where it matters.

Orientations (or places, or anything else that is hidden) lie in nested cells: each cell of a level is divided into
equally many cells of the next. The belief holds the coarsest cells of all bodies. A cell with much of the posterior is
*split*: its parts are weighed by all touches so far, and take its place. Parts that have lost the posterior are *set
aside*: their cell takes their place again, with their weight, and may be split again when touches speak for it. What is
in memory is bounded, whatever the number of bodies.

The likelihood is a callback, and this module knows nothing of geometry. One body, of which one cell in two levels fits:

>>> class Fits:
...     def coarsest(self, touch):
...         return np.array([[0.0, 1.0], [0.0, 0.0]])
...     def parts(self, touches, level, bodies, parents):
...         return np.where(parents[:, None] * 2 + np.arange(2) == 3, 5.0, -5.0) - bodies[:, None]
>>> nested = NestedCells((np.full(2, 1 / 2), np.full(4, 1 / 4)))
>>> belief = CoarseToFine.start(np.zeros(2), nested, Fits(), Effort(tolerance=0.0)).update("a touch")
>>> belief.probs.round(2).tolist(), belief.num_split, belief.unresolved
([0.73, 0.27], 4, 0.0)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from belief.cell_kernel import CellKernel
from belief.errors import ImpossibleObservation
from belief.frozen import FrozenArrays
from belief.validation import Floats, log_sum, require_count, require_number

Ints = NDArray[np.int64]
_MOST = 1.0 - 1e-12  # probability of a move
_LEAST = np.finfo(np.float64).min


@dataclass(frozen=True, eq=False)
class NestedCells(FrozenArrays):
    """Prior probabilities ``(N_l,)`` of nested cells by level, coarse to fine; parts share that of their cell."""

    shares: tuple[Floats, ...]

    def __post_init__(self) -> None:
        for coarse, fine in pairwise(self.shares):
            if len(coarse) == 0 or len(fine) % len(coarse):
                raise ValueError(f"{len(fine)} cells are no division of {len(coarse)} cells")
            if not np.allclose(fine.reshape(len(coarse), -1).sum(axis=1), coarse, atol=1e-9):
                raise ValueError("the parts of a cell must share its probability")
        if not self.shares or not np.isclose(self.shares[0].sum(), 1.0) or min(map(np.min, self.shares)) <= 0.0:
            raise ValueError("the cells of a level must have positive probabilities that sum to 1")
        self.freeze()

    @cached_property
    def log_shares(self) -> tuple[Floats, ...]:
        """Logarithms of the shares."""
        return tuple(np.log(each) for each in self.shares)

    def parts(self, level: int, parents: Ints) -> Ints:
        """The parts of cells of level - 1, ``(m, F)``."""
        number = len(self.shares[level]) // len(self.shares[level - 1])
        return parents[:, None] * number + np.arange(number)


class CellLikelihood(Protocol):
    """Log likelihoods of touches given a body and a cell; each touch up to a constant of its own."""

    def coarsest(self, touch: Any) -> NDArray[np.floating]:
        """Log likelihoods of one touch, for all bodies and all cells of the coarsest level, ``(K, N_0)``."""

    def parts(self, touches: Sequence[Any], level: int, bodies: Ints, parents: Ints) -> NDArray[np.floating]:
        """Log likelihoods of all touches together for the parts of some cells, ``(m, F)``.

        ``parents (m,)`` are the divided cells of level - 1, of ``bodies (m,)``; cell c has parts c F to (c + 1) F - 1.
        """


@dataclass(frozen=True)
class Effort:
    """Limits on the refinement of a belief, which trade speed for accuracy.

    Attributes:
        tolerance: share of the posterior that may stay in cells that are not of the finest level.
        splits: largest number of cells that are split after one touch.
        at_once: number of cells that are split at a time.
        kept: largest number of split cells in memory.
        floor: posterior below which the parts of a cell are set aside.
    """

    tolerance: float = 0.02
    splits: int = 1024
    at_once: int = 256
    kept: int = 4096
    floor: float = 1e-6

    def __post_init__(self) -> None:
        require_number("tolerance", self.tolerance, 0.0, 1.0)
        require_number("floor", self.floor, 0.0, 1.0)
        for name in ("splits", "at_once", "kept"):
            require_count(name, getattr(self, name))


class Leaves(NamedTuple):
    """Unsplit cells, ``(n,)``, which cover all bodies in all orientations; a weight is prior times likelihood."""

    level: Ints
    body: Ints
    cell: Ints
    log_weight: Floats


class _Families(NamedTuple):
    """F parts of each of m split cells, ``(m, F)``; coarsest cells are the parts of a cell 0 of each body."""

    body: Ints
    parent: Ints
    sums: Floats
    offsets: Floats

    def take(self, rows: NDArray[Any]) -> _Families:
        return _Families(*(part[rows] for part in self))

    def joined(self, others: _Families) -> _Families:
        return _Families(*(np.concatenate(both) for both in zip(self, others, strict=True)))

    def places(self, rows: Ints) -> tuple[Ints, Ints]:
        """Body and cell of entries, by their places in the flattened array."""
        family, part = np.divmod(rows, self.sums.shape[1])
        return self.body[family], self.parent[family] * self.sums.shape[1] + part


@dataclass(frozen=True, eq=False)
class CoarseToFine:
    """Posterior over K bodies and their cells after some touches; :meth:`start` and :meth:`update` make it.

    After n touches that are no repeats (``num_new``), sums of log likelihoods are multiplied by
    scale / (1 + drift (n - 1)). ``log_prior (K,)`` is of the bodies; ``correction (K,)`` holds log factors on their
    evidence, from a closer look at some of them.

    Where ``moves`` is a kernel of the coarsest cells and a probability, the hidden place may change so between two
    touches; within its coarsest cell, it is then anywhere. ``arrived`` has, for each touch, the log weight that has
    moved to each coarsest cell just before it, ``(K, N_0)``, ``-inf`` before the first; ``moved (K,)`` is the
    probability of a move just before the last touch given each body, by the cells in memory at that time.
    """

    log_prior: Floats
    cells: NestedCells
    likelihood: CellLikelihood
    effort: Effort
    scale: float
    drift: float
    touches: tuple[Any, ...]
    num_new: float
    correction: Floats
    _families: tuple[_Families, ...] = field(repr=False)  # of each level
    moves: tuple[CellKernel, float] | None = None
    arrived: tuple[Floats, ...] = ()
    moved: Floats | None = None

    @classmethod
    def start(
        cls,
        log_prior: ArrayLike,
        cells: NestedCells,
        likelihood: CellLikelihood,
        effort: Effort | None = None,
        scale: float = 1.0,
        drift: float = 0.0,
        moves: tuple[CellKernel, float] | None = None,
    ) -> CoarseToFine:
        """The belief before the first touch."""
        prior = np.array(log_prior, float, ndmin=1)
        if prior.ndim != 1 or not len(prior) or np.isnan(prior).any() or not np.isfinite(prior.max()):
            raise ValueError(
                f"log_prior must be (K,), finite for one body at least and nowhere NaN, got {prior!r:.200}"
            )
        require_number("scale", scale, 0.0, 1e6)
        require_number("drift", drift, 0.0, 1.0)
        if moves is not None:
            require_number("the probability of a move", moves[1], 0.0, 1.0)
            if drift or moves[0].num_cells != len(cells.shares[0]):
                raise ValueError("moves must be a kernel of the coarsest cells, and the drift 0")
        prior = prior - log_sum(prior)
        bodies = np.arange(len(prior))
        coarsest = _Families(bodies, 0 * bodies, *np.zeros((2, len(prior), len(cells.shares[0]))))
        finer = (
            _Families(*np.zeros((2, 0), np.int64), *np.zeros((2, 0, len(fine) // len(coarse))))
            for coarse, fine in pairwise(cells.shares)
        )
        effort = Effort() if effort is None else effort
        given = (prior, cells, likelihood, effort, scale, drift, (), 0.0, np.zeros(len(prior)), (coarsest, *finer))
        return cls(*given, moves)

    def update(self, touch: Any, num_new: float | None = None) -> CoarseToFine:
        """The belief after one more touch, refined as far as the effort says.

        ``num_new`` is the effective number of all touches with this one; one more than before by default.
        """
        coarsest, *finer = self._families
        found = [_checked(self.likelihood.coarsest(touch), coarsest.sums.shape)]
        found += [self._parts((touch,), level, each.body, each.parent) for level, each in enumerate(finer, 1)]
        number = self.num_new + 1.0 if num_new is None else num_new
        belief = self if self.moves is None else self._moved_on()
        families = [each._replace(sums=each.sums + new) for each, new in zip(belief._families, found, strict=True)]
        belief = replace(belief, touches=(*self.touches, touch), num_new=number, _families=tuple(families))
        if self.moves is not None and self.touches:
            stayed = [own._replace(sums=each.sums) for own, each in zip(self._families, families, strict=True)]
            rested = replace(self, _families=tuple(stayed))._log_bodies + np.log1p(-min(self.moves[1], _MOST))
            belief = replace(belief, moved=np.clip(-np.expm1(rested - belief._log_bodies), 0.0, 1.0))
        if not np.isfinite(belief._log_total):
            raise ImpossibleObservation(
                f"no body explains touch number {len(self.touches) + 1} together with those before it"
            )
        return belief._less()._refined()

    def corrected(self, bodies: Ints, log_evidence: Floats) -> CoarseToFine:
        """The belief after a closer look at ``bodies (n,)``, which decides between them and keeps their sum.

        ``log_evidence (n,)`` is of all touches, up to a constant. The correction stays until the next one.
        """
        looked = self.log_prior[bodies] + np.asarray(log_evidence, float)
        if not np.isfinite(looked.max(initial=-np.inf)):
            raise ValueError(f"evidence must be finite for one body and nowhere NaN, got {log_evidence!r:.200}")
        correction, now = self.correction.copy(), self._log_bodies[bodies]
        correction[bodies] += looked - log_sum(looked) + log_sum(now) - now
        return replace(self, correction=correction)

    @property
    def log_evidence(self) -> Floats:
        """Log likelihood of all touches given each body, summed over its cells, ``(K,)``."""
        return self._log_bodies - np.where(np.isfinite(self.log_prior), self.log_prior, 0.0)

    @property
    def log_probs(self) -> Floats:
        """Log posterior of the bodies, ``(K,)``."""
        return self._log_bodies - self._log_total

    @property
    def probs(self) -> Floats:
        """Posterior of the bodies, ``(K,)``."""
        return np.exp(self.log_probs)

    @property
    def unresolved(self) -> float:
        """Share of the posterior in cells that are not of the finest level."""
        return float(sum(np.exp(weights - self._log_total).sum() for weights in self._leaf_weights[:-1]))

    @property
    def num_split(self) -> int:
        """Number of cells whose parts are in memory."""
        return sum(len(each.body) for each in self._families[1:])

    def leaves(self, least: float = 0.0) -> Leaves:
        """All cells that are not split, or those with a posterior of ``least`` or more."""
        found = []
        for level, weights in enumerate(self._leaf_weights):
            rows = np.flatnonzero(weights >= self._log_total + np.log(least) if least else weights > -np.inf)
            found.append((np.full(len(rows), level), *self._families[level].places(rows), weights.ravel()[rows]))
        return Leaves(*(np.concatenate(part) for part in zip(*found, strict=True)))

    def leaves_of(self, bodies: Ints) -> Leaves:
        """The unsplit cells of some bodies."""
        found = []
        for level, (family, weights) in enumerate(zip(self._families, self._leaf_weights, strict=True)):
            mine = np.flatnonzero(np.isin(family.body, bodies)) if level else bodies
            rows = (mine[:, None] * weights.shape[1] + np.arange(weights.shape[1])).ravel()
            rows = rows[weights.ravel()[rows] > -np.inf]
            found.append((np.full(len(rows), level), *family.places(rows), weights.ravel()[rows]))
        return Leaves(*(np.concatenate(part) for part in zip(*found, strict=True)))

    def _moved_on(self) -> CoarseToFine:
        """The belief just before the next touch, where the hidden place may have moved."""
        assert self.moves is not None, "asked before"
        kernel, prob = self.moves
        if not self.touches or not prob:
            return replace(self, arrived=(*self.arrived, np.full(self._coarsest_weights.shape, -np.inf)))
        held = self._leaf_weights[0].copy()
        if self._rows:
            held.ravel()[self._rows[0]] = self._masses[0]
        arrived = kernel.moved(held, 1.0) + np.log(prob)
        families = []
        for level, (each, weights) in enumerate(zip(self._families, self._weights, strict=True)):
            mixed, more = self._mixed(weights, arrived, level, each.body, each.parent), each.offsets.copy()
            np.add(more, mixed - np.maximum(weights, _LEAST), out=more, where=np.isfinite(weights))
            families.append(each._replace(offsets=more))
        return replace(self, arrived=(*self.arrived, arrived), _families=tuple(families))

    def _mixed(self, weights: Floats, arrived: Floats, level: int, bodies: Ints, parents: Ints) -> Floats:
        """Log weights of the parts of some cells, ``(m, F)``, after a move to the coarsest cells."""
        assert self.moves is not None, "asked before"
        cells = np.arange(weights.shape[1]) + parents[:, None] * weights.shape[1]
        coarse = cells // (len(self.cells.shares[level]) // len(self.cells.shares[0]))
        parts = self.cells.log_shares[level][cells] - self.cells.log_shares[0][coarse]
        stayed = weights + np.log1p(-min(self.moves[1], _MOST))
        return np.asarray(np.logaddexp(stayed, arrived[bodies[:, None], coarse] + parts))

    @property
    def log_of_bodies(self) -> Floats:
        """Log of prior times evidence of each body, ``(K,)``: the log of the sum of its cells' weights."""
        return self._log_bodies

    @cached_property
    def _weights(self) -> list[Floats]:
        """Log weights of all cells in memory, split or not, of each level: ``(K, N_0)``, ``(m_1, F)`` and so on."""
        return [self._coarsest_weights, *(self._weights_of(level) for level in range(1, len(self._families)))]

    @cached_property
    def _coarsest_weights(self) -> Floats:
        return self._weights_of(0)

    def _weights_of(self, level: int) -> Floats:
        each, prior = self._families[level], self.log_prior + self.correction
        of_parts = self.cells.log_shares[level].reshape(-1, each.sums.shape[1])
        found = each.sums * (self.scale / (1.0 + self.drift * max(self.num_new - 1.0, 0.0)))
        found += each.offsets
        found += of_parts[each.parent] if level else of_parts
        found += prior[each.body][:, None]
        return found

    @cached_property
    def _rows(self) -> list[Ints]:
        """For each level but the coarsest, where its parents are in the flattened array of the level above."""
        found = []
        for level, (above, each) in enumerate(pairwise(self._families)):
            number = len(self.cells.shares[level])
            rows = each.body * number + each.parent  # where all cells of all bodies are in order, as in the coarsest
            if level:
                body, cell = above.places(np.arange(above.sums.size))
                keys = body * number + cell
                order = np.argsort(keys)
                rows = order[np.searchsorted(keys, rows, sorter=order)]
            found.append(rows)
        return found

    @cached_property
    def _leaf_weights(self) -> list[Floats]:
        """Log weights, ``-inf`` for cells that are split."""
        found = [weights.copy() for weights in self._weights]
        for weights, rows in zip(found, self._rows, strict=False):
            weights.ravel()[rows] = -np.inf
        return found

    @cached_property
    def _log_bodies(self) -> Floats:
        """Log of prior times evidence of each body, ``(K,)``."""
        found = self._coarsest_sums.copy()
        if self._rows:
            split = np.unique(self._rows[0] // self._families[0].sums.shape[1])
            found[split] = log_sum(self._leaf_weights[0][split], axis=1)
        for family, weights in zip(self._families[1:], self._leaf_weights[1:], strict=True):
            np.logaddexp.at(found, family.body, log_sum(weights, axis=1))
        return found

    @cached_property
    def _coarsest_sums(self) -> Floats:
        """Log of the sum of all coarsest cells of each body, split or not, ``(K,)``."""
        return np.asarray(log_sum(self._coarsest_weights, axis=1))

    @cached_property
    def _log_total(self) -> float:
        return float(log_sum(self._log_bodies))

    @cached_property
    def _masses(self) -> list[Floats]:
        """Log weight of each family: of its leaves and of all parts of its split cells, ``(m,)`` for each level."""
        masses: list[Floats] = []
        for level in range(len(self._rows), 0, -1):
            weights = self._leaf_weights[level]
            if masses:
                weights = weights.copy()
                weights.ravel()[self._rows[level]] = masses[0]
            masses.insert(0, log_sum(weights, axis=1))
        return masses

    def _less(self) -> CoarseToFine:
        """The belief with the parts that have lost the posterior set aside: their cells take their weights."""
        masses = np.concatenate([np.empty(0), *self._masses])
        least = self._log_total + np.log(self.effort.floor) if self.effort.floor else -np.inf
        if len(masses) > self.effort.kept:
            least = max(least, np.partition(masses, -self.effort.kept)[-self.effort.kept])
        if not (masses < least).any():
            return self
        families = [each._replace(offsets=each.offsets.copy()) for each in self._families]
        for each, weights, mass, rows in zip(families, self._weights, self._masses, self._rows, strict=False):
            gone = mass < least
            correction = mass[gone] - weights.ravel()[rows[gone]]
            each.offsets.ravel()[rows[gone]] += np.where(np.isfinite(correction), correction, 0.0)
        finer = (each.take(mass >= least) for each, mass in zip(families[1:], self._masses, strict=True))
        return replace(self, _families=(families[0], *finer))

    def _refined(self) -> CoarseToFine:
        """The belief with cells split, the most probable first, until little is left or the effort is spent."""
        belief, left = self, self.effort.splits
        while left > 0:
            chosen = belief._to_split(min(left, self.effort.at_once))
            if not any(map(len, chosen)):
                break
            left -= sum(map(len, chosen))
            belief = belief._split(chosen)
        return belief

    def _to_split(self, number: int) -> list[Ints]:
        """Which entries of each level but the finest to split, by their places in its flattened array."""
        weights = [each.ravel() for each in self._leaf_weights[:-1]]
        starts = np.cumsum([0, *map(len, weights)])
        least = -np.inf
        if self.effort.tolerance and starts[-1]:  # what is below this is less than the tolerance, all together
            least = self._log_total + np.log(self.effort.tolerance / starts[-1])
        rows = [np.flatnonzero(each > least) + start for each, start in zip(weights, starts, strict=False)]
        places, logs = np.concatenate([[], *rows]).astype(np.int64), np.concatenate([[], *weights])
        resolved = np.exp(self._leaf_weights[-1] - self._log_total).sum()
        left = max(1.0 - resolved, np.exp(logs[places] - self._log_total).sum())
        if len(places) > number:
            places = places[np.argpartition(-logs[places], number)[:number]]
        few = places[np.argsort(-logs[places], kind="stable")]
        open_ = np.exp(logs[few] - self._log_total)
        before = left - np.cumsum(open_) + open_  # each split
        few = few[before > self.effort.tolerance]
        return [few[(few >= a) & (few < b)] - a for a, b in pairwise(starts)]

    def _split(self, chosen: Sequence[Ints]) -> CoarseToFine:
        families = list(self._families)
        for level, rows in enumerate(chosen, 1):
            if len(rows):
                body, parent = self._families[level - 1].places(rows)
                sums, offsets = self._weighed(level, body, parent)
                families[level] = families[level].joined(_Families(body, parent, sums, offsets))
        found = replace(self, _families=tuple(families))
        vars(found).update(_coarsest_weights=self._coarsest_weights, _coarsest_sums=self._coarsest_sums)
        return found

    def _weighed(self, level: int, body: Ints, parent: Ints) -> tuple[Floats, Floats]:
        """Sums and offsets of the parts of some cells after all touches, ``(m, F)`` each."""
        if self.moves is None:
            sums = self._parts(self.touches, level, body, parent)
            return sums, np.zeros(sums.shape)
        start = self.cells.log_shares[level][self.cells.parts(level, parent)] + self.log_prior[body][:, None]
        weights = start
        for number, (touch, arrived) in enumerate(zip(self.touches, self.arrived, strict=True)):
            weights = self._mixed(weights, arrived, level, body, parent) if number else weights
            weights = weights + self.scale * self._parts((touch,), level, body, parent)
        found = np.where(np.isfinite(weights), weights - start, -np.inf)
        return np.zeros(found.shape), found

    def _parts(self, touches: Sequence[Any], level: int, bodies: Ints, parents: Ints) -> Floats:
        shape = len(bodies), len(self.cells.shares[level]) // len(self.cells.shares[level - 1])
        if len(bodies) == 0:
            return np.zeros(shape)
        return _checked(self.likelihood.parts(touches, level, bodies, parents), shape)


def _checked(found: NDArray[np.floating], shape: tuple[int, ...]) -> Floats:
    """Log likelihoods in double precision."""
    if found.shape != shape:
        raise ValueError(f"the likelihood of cells must have the shape {shape}, got {found.shape}")
    if not found.max() < np.inf:  # False for NaN
        raise ValueError("the likelihood of a cell is NaN or infinite")
    return np.asarray(found, float)
