"""A model of outcomes from a table of cases with known classes, by expectation and maximisation over hidden contexts.

Most outcomes look alike in most classes and contexts. Distributions of one action that the counts do not tell apart are
therefore made one, as long as this raises the marginal likelihood of the counts (Heller and Ghahramani 2005, with
Dirichlet distributions). This leaves few numbers to learn, and keeps noise out of what is stated.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence, Sized
from dataclasses import dataclass, field
from numbers import Integral, Real
from typing import Any

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import ArrayLike, NDArray

from belief.errors import InvalidArgument
from belief.files import decimal_mark, plain_number
from belief.frozen import FrozenArrays
from belief.naming import checked_names, few
from belief.observation_model.context_model import MISSING, ContextModel, log_products
from belief.seeding import checked_key
from belief.validation import LARGEST_VALUE, Floats, as_real, at, checked_indices, require_count, unmasked

_PRIOR = 0.5  # pseudo-counts of each outcome (Jeffreys), and of each context of a class
_ROUNDS, _TIED_ROUNDS = 40, 4  # of the fit, without and with equal distributions made one
_SEEDS = 2  # actions whose outcomes begin as contexts, beside contexts at random
_HELD = 4  # one case of four is held out to choose the number of contexts
_SHARPNESS = np.array([1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3])
_BINS = 0.65  # times the cube root of the number of cases
_MOST_JOINT = 32  # outcomes of an action with several columns
_MOST_WORDS = 64  # different ones in a column
_MOST_CONTEXTS, _MOST_PAIRS = 100, 10**8  # of a class, and of distributions that are compared
_EDGE = 0.01  # share of the smallest and of the largest values that do not stretch the bins


@dataclass(frozen=True, eq=False)
class OutcomeCode(FrozenArrays):
    """How values of columns become outcomes of actions.

    Attributes:
        columns: the columns of each action, ``(P,)`` tuples of indices.
        edges: for each column the values between its bins, increasing.
        joint: for each action with several columns the combinations of bins that are outcomes of their own; all others
            are one more outcome. Empty for an action with one column.
        most: M, the largest number of outcomes of an action.
        words: for each column of words, these in their order, whose places are its values; empty for one of numbers.
        names: of the columns, where they were those of a data frame: others are read by them.
        seen: smallest and largest value of each column, ``(C, 2)``; a value that lies farther out than these are apart
            warns, because it is probably in another unit.
    """

    columns: tuple[tuple[int, ...], ...]
    edges: tuple[Floats, ...]
    joint: tuple[NDArray[np.int64], ...]
    most: int
    words: tuple[tuple[str, ...], ...] = ()
    names: tuple[str, ...] = ()
    seen: Floats = field(default_factory=lambda: np.empty((0, 2)))

    def outcomes(self, values: ArrayLike) -> NDArray[np.int64]:
        """Outcomes ``(n, P)`` of cases ``(n, C)``, -1 where a column of the action is missing (NaN).

        Raises:
            InvalidArgument: another number of columns than was fitted, or another name, or a word that no case had.
        """
        table = as_table(in_order(values, self.names), self.words, self.names)
        if table.shape[1] != len(self.edges):
            raise InvalidArgument(f"a case has {len(self.edges)} columns, got {table.shape[1]}")
        return np.stack([self.outcome(action, table[:, list(own)]) for action, own in enumerate(self.columns)], axis=1)

    def outcome(self, action: int, values: Floats) -> NDArray[np.int64]:
        """Outcomes of one action ``(n,)`` from values of its columns ``(n, c)``."""
        for column, given in zip(self.columns[action], values.T, strict=True):
            low, high = self.seen[column].tolist() if len(self.seen) else (np.nan, np.nan)
            if high > low and (is_far := np.abs(given - (low + high) / 2.0) > 1.5 * (high - low)).any():
                apart = f"{given[is_far][0]:g}, and cases that the model was fitted to had {low:g} to {high:g}"
                warnings.warn(f"{_called(column, self.names)} is {apart}: is it in another unit?", stacklevel=4)
        bins = [np.searchsorted(self.edges[c], v, "right") for c, v in zip(self.columns[action], values.T, strict=True)]
        found = bins[0]
        if len(bins) > 1:
            codes, place = _joined(bins, [len(self.edges[c]) + 1 for c in self.columns[action]]), self.joint[action]
            at = np.minimum(np.searchsorted(place, codes), len(place) - 1)
            found = np.where(place[at] == codes, at, len(place))
        return np.where(np.isnan(values).any(axis=1), MISSING, found)

    def told(self, action: int, values: Any) -> int:
        """The outcome of one action from a value, a number or a word, or from the values of its columns."""
        words = [self.words[c] for c in self.columns[action]] if self.words else []
        names = [self.names[c] for c in self.columns[action]] if self.names else []
        cells = np.atleast_1d(np.asarray(values, object))[None]
        if cells.shape != (1, len(own := self.columns[action])):
            parts = ", ".join(_called(column, self.names) for column in own)
            raise InvalidArgument(f"an outcome has {len(own)} values, of {parts}; got {values!r:.60}")
        return int(self.outcome(action, as_table(cells, words, names))[0])

    @classmethod
    def of(
        cls, values: ArrayLike, groups: Sequence[Sequence[Any] | str] | None = None, num_bins: int | None = None
    ) -> OutcomeCode:
        """A code for columns ``(n, C)``: each value or word its own outcome, or bins where there are many values.

        Args:
            values: of cases, numbers, also as text, or words; NaN, None or an empty word where missing. A list of
                dictionaries, as of :class:`csv.DictReader`, is read as a data frame.
            groups: columns of each action, by name or index; by default each column is an action.
            num_bins: most outcomes of a column; by default 4 to 16, by the number of cases. The columns of an action
                with several have two each.

        >>> code = OutcomeCode.of([[0.0, 1.5], [1.0, 2.5], [1.0, np.nan]])
        >>> code.outcomes([[1.0, 2.4], [0.0, np.nan]]).tolist()
        [[1, 1], [0, -1]]
        >>> OutcomeCode.of([["yes", 7], ["no", 9], ["", 9]]).outcomes([["yes", 9]]).tolist()
        [[1, 1]]
        """
        values = as_rows(values)
        words = _words(values)
        table = as_table(values, words, _names(values))
        places = {name: place for place, name in enumerate(_names(values))}
        columns: tuple[tuple[Any, ...], ...] = tuple((c,) for c in range(table.shape[1]))
        if groups is not None:
            each = ((own,) if isinstance(own, str) else own for own in groups)
            columns = tuple(tuple(places.get(column, column) for column in own) for own in each)
        indices = {column for own in columns for column in own}
        is_known = indices <= set(range(table.shape[1])) and all(isinstance(one, Integral) for one in indices)
        if not columns or not all(columns) or not is_known or any(len(set(own)) < len(own) for own in columns):
            raise InvalidArgument(
                f"groups must be different columns of each action, {few(list(places)) or f'below {table.shape[1]}'}, "
                f"got {groups!r:.80}"
            )
        most = int(np.clip(round(_BINS * len(table) ** (1 / 3)), 4, 16)) if num_bins is None else num_bins
        require_count("num_bins", most)
        size = {c: most if len(own) == 1 else 2 for own in columns for c in own}
        edges = tuple(
            np.arange(0.5, len(own_words) - 1) if own_words else _edges(table[:, c], size.get(c, most))
            for c, own_words in enumerate(words or [()] * table.shape[1])
        )
        joint, largest = [], 1
        for own in columns:
            codes = np.empty(0, np.int64)
            if len(own) > 1:
                whole = table[~np.isnan(table[:, list(own)]).any(axis=1)][:, list(own)]
                bins = [np.searchsorted(edges[c], v, "right") for c, v in zip(own, whole.T, strict=True)]
                found, counts = np.unique(_joined(bins, [len(edges[c]) + 1 for c in own]), return_counts=True)
                codes = np.sort(found[np.argsort(-counts, kind="stable")[: _MOST_JOINT - 1]])
            joint.append(codes)
            largest = max(largest, len(codes) + 1 if len(own) > 1 else len(edges[own[0]]) + 1)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # of columns without a value
            seen = np.stack([np.nanmin(table, axis=0), np.nanmax(table, axis=0)], axis=1)
        return cls(columns, edges, tuple(joint), largest, words, _names(values), seen)

    def words_of(self) -> list[tuple[str, tuple[str, ...]]]:
        """The columns of words, as in messages, and these."""
        return [(_called(column, self.names), words) for column, words in enumerate(self.words) if words]

    def sizes(self) -> NDArray[np.int64]:
        """Number of outcomes of each action, ``(P,)``."""
        return np.array(
            [
                len(codes) + 1 if len(own) > 1 else len(self.edges[own[0]]) + 1
                for own, codes in zip(self.columns, self.joint, strict=True)
            ]
        )


class _Rows(list[list[Any]]):
    """Rows with names of columns, as of a data frame."""

    columns: tuple[str, ...] = ()


def as_rows(values: Any) -> Any:
    """Cases as they are, but dictionaries, as of :class:`csv.DictReader`, as rows with names of columns.

    Raises:
        InvalidArgument: rows of unequal length, or dictionaries with other keys than the first one.
    """
    if not isinstance(values, list | tuple) or not values:
        return values
    if not isinstance(values[0], Mapping):
        lengths = [len(row) if isinstance(row, Sized) and not isinstance(row, str) else 0 for row in values]
        if number := next((row for row, length in enumerate(lengths) if length != lengths[0]), 0):
            raise InvalidArgument(
                f"cases must be rows of equal length, the first one has {lengths[0]} cells, got {lengths[number]}, "
                f"{values[number]!r:.60}{at((number,))}"
            )
        return values
    found = _Rows()
    found.columns = tuple(values[0])
    for number, row in enumerate(values):
        if not isinstance(row, Mapping) or set(row) != set(found.columns):
            known = few(found.columns)
            raise InvalidArgument(f"cases must all have the columns {known}, got {row!r:.60}{at((number,))}")
        found.append([row[name] for name in found.columns])
    return found


def in_order(values: Any, names: Sequence[str]) -> Any:
    """Cases with the columns of these names in their order, if both have names.

    Raises:
        InvalidArgument: a name is missing.
    """
    values = as_rows(values)
    if not names or not (given := _names(values)):
        return values
    if missing := [name for name in names if name not in given]:
        raise InvalidArgument(f"the cases have no column {few(missing)}; their columns are {few(given)}")
    return np.asarray(values)[:, [given.index(name) for name in names]]


def _names(values: Any) -> tuple[str, ...]:
    """Names of the columns of a data frame; empty for an array."""
    return tuple(map(str, getattr(values, "columns", ())))


def fit_contexts(
    outcomes: ArrayLike,
    classes: ArrayLike,
    shape_labels: Sequence[str],
    num_contexts: int | Sequence[int] = (1, 2, 3, 4, 5, 6),
    sizes: ArrayLike | None = None,
    seed: int = 0,
) -> ContextModel:
    """A :class:`ContextModel` of cases with known classes.

    The number of contexts is the one with the largest likelihood of held-out cases. The sharpness is that with which
    held-out cases, of which random outcomes are shown, state the smallest loss.

    Args:
        outcomes: of each action, ``(n, P)``, integers from 0, or -1 where missing.
        classes: index of the class of each case, ``(n,)``.
        shape_labels: names of the K classes.
        num_contexts: H, or the numbers to choose from.
        sizes: number of outcomes of each action, ``(P,)``; by default as many as were seen.
        seed: of the split and of contexts at random.

    Raises:
        ValueError: arrays that do not fit each other, or a class without a case.

    >>> rng = np.random.default_rng(0)
    >>> true = ContextModel(("ill", "well"), np.array([[[0.9, 0.1], [0.2, 0.8]], [[0.6, 0.4], [0.5, 0.5]]]))
    >>> classes = rng.integers(2, size=600)
    >>> rows = [[int(t.features[0]) for t in true.sample(k, [0, 1], rng)] for k in classes]
    >>> fitted = fit_contexts(rows, classes, ("ill", "well"), num_contexts=1)
    >>> fitted.probs[0, :, 0].round(1).tolist()
    [[0.9, 0.1], [0.2, 0.8]]
    """
    labels = checked_names("shape_labels", shape_labels)
    table, y = np.asarray(outcomes), checked_indices("classes", classes, len(labels))
    if (
        table.ndim != 2
        or table.dtype.kind not in "iu"
        or table.shape[0] != len(y)
        or not table.size
        or table.min() < -1
    ):
        raise InvalidArgument(f"outcomes must be integers (n, P) ≥ -1, one row for each of {len(y)} classes")
    if absent := [label for k, label in enumerate(labels) if not (y == k).any()]:
        raise InvalidArgument(f"there is no case of the class {absent[0]!r}")
    table = table.astype(np.int64)
    numbers = table.max(axis=0) + 1 if sizes is None else np.asarray(sizes, np.int64)
    choices = list(num_contexts) if isinstance(num_contexts, Sequence) else [num_contexts]
    for number in choices or [0]:
        require_count("num_contexts", number, most=_MOST_CONTEXTS)
        if (pairs := table.shape[1] * (len(labels) * number) ** 2) > _MOST_PAIRS:
            raise InvalidArgument(
                f"{table.shape[1]} actions, {len(labels)} classes and {number} contexts of each have {pairs} pairs of "
                f"distributions to compare, and at most {_MOST_PAIRS} are: join classes, or lower num_contexts"
            )
    fit = _Fit(len(labels), np.maximum(numbers, 1))
    rng = np.random.default_rng(checked_key(seed))
    held = rng.permutation(len(y)) % _HELD == 0
    held &= np.isin(y, y[~held])
    best, sharpness = choices[0], 1.0
    if held.any():
        models = {h: fit.fitted(table[~held], y[~held], h, rng) for h in choices}
        scores = {h: _log_likelihood(*models[h], table[held], y[held]) for h in choices}
        best = max(choices, key=lambda h: scores[h])
        sharpness = _sharpness(*models[best], table[held], y[held], rng)
    weights, probs = fit.fitted(table, y, best, rng)
    return ContextModel(labels, probs, weights, sharpness)


class _Fit:
    """Fits weights ``(K, H)`` and probs ``(P, K, H, M)`` to cases, for K classes and actions of some sizes ``(P,)``."""

    def __init__(self, num_classes: int, sizes: NDArray[np.int64]) -> None:
        self.num_classes = num_classes
        self.prior = np.where(np.arange(sizes.max()) < sizes[:, None], _PRIOR, 0.0)  # (P, M)

    def fitted(
        self, table: NDArray[np.int64], y: NDArray[np.int64], number: int, rng: np.random.Generator
    ) -> tuple[Floats, Floats]:
        """The best of several fits with ``number`` contexts, by its marginal likelihood."""
        begins = [np.ones((len(y), 1))] if number == 1 else self._begins(table, y, number, rng)
        found = [self._rounds(table, y, shares) for shares in begins]
        return max(found, key=lambda one: one[2])[:2]

    def _begins(
        self, table: NDArray[np.int64], y: NDArray[np.int64], number: int, rng: np.random.Generator
    ) -> list[Floats]:
        """Probabilities of contexts of each case, ``(n, H)``, by the actions that explain most others, and random."""
        alone = np.ones((len(y), 1))
        least = _log_marginal(self.counts(table, y, alone), self.prior[:, None, None]).sum(axis=(1, 2))
        gains, begins = np.full(table.shape[1], -np.inf), []
        for action in range(table.shape[1]):
            begins.append(_groups(table[:, action], number))
            own = _log_marginal(self.counts(table, y, begins[-1]), self.prior[:, None, None]).sum(axis=(1, 2))
            gains[action] = np.delete(own - least, action).sum()
        best = np.argsort(-gains, kind="stable")[:_SEEDS]
        drawn = rng.dirichlet(np.full(number, 0.3), len(y))
        return [*(0.9 * begins[action] + 0.1 / number for action in best), drawn]

    def _rounds(self, table: NDArray[np.int64], y: NDArray[np.int64], shares: Floats) -> tuple[Floats, Floats, float]:
        """Weights, probabilities and score after all rounds, from probabilities of contexts ``(n, H)``."""
        score = -np.inf
        for number in range(_ROUNDS + _TIED_ROUNDS if shares.shape[1] > 1 else 1):
            is_tied = shares.shape[1] == 1 or number >= _ROUNDS
            counts = self.counts(table, y, shares)
            sums = np.stack([shares[y == k].sum(axis=0) for k in range(self.num_classes)]) + _PRIOR
            weights = sums / sums.sum(axis=1, keepdims=True)
            probs = self._tied(counts) if is_tied else self._smooth(counts)
            with np.errstate(divide="ignore"):
                logs = np.log(np.concatenate([probs, np.ones((*probs.shape[:3], 1))], axis=3))
            joint = sum((logs[a][y, :, own] for a, own in enumerate(table.T)), start=np.log(weights)[y])
            total = np.logaddexp.reduce(joint, axis=1)
            shares, score = np.exp(joint - total[:, None]), float(total.sum())
        return weights, probs, score

    def counts(self, table: NDArray[np.int64], y: NDArray[np.int64], shares: Floats) -> Floats:
        """Expected numbers of outcomes, ``(P, K, H, M)``."""
        most, number = self.prior.shape[1], shares.shape[1]
        found = np.empty((table.shape[1], number, self.num_classes * (most + 1)))
        for action, outcomes in enumerate(table.T):
            place = y * (most + 1) + np.where(outcomes < 0, most, outcomes)
            for context in range(number):
                found[action, context] = np.bincount(place, shares[:, context], self.num_classes * (most + 1))
        split = found.reshape(len(found), number, self.num_classes, most + 1)[..., :most]
        return np.ascontiguousarray(split.swapaxes(1, 2))

    def _smooth(self, counts: Floats) -> Floats:
        total = counts + self.prior[:, None, None]
        return np.asarray(total / total.sum(axis=3, keepdims=True))

    def _tied(self, counts: Floats) -> Floats:
        """Probabilities in which distributions of an action that the counts do not tell apart are one."""
        cells = counts.reshape(len(counts), -1, counts.shape[3])  # (P, C, M)
        owners = merged_cells(cells, self.prior)
        together = np.zeros(cells.shape)
        np.add.at(together, (np.arange(len(cells))[:, None], owners), cells)
        found = np.take_along_axis(together, owners[..., None], axis=1).reshape(counts.shape)
        return self._smooth(found)


def merged_cells(cells: Floats, prior: Floats) -> NDArray[np.int64]:
    """Which cells have one distribution: index of the first of each group ``(P, C)``, and the log marginal likelihood.

    ``cells (P, C, M)`` are counts, ``prior (P, M)`` the Dirichlet parameters. The pair whose union raises the marginal
    likelihood most is joined first.
    """
    number = cells.shape[1]
    rows, prior = np.arange(len(cells)), prior[:, None]
    counts, owners = cells.copy(), np.tile(np.arange(number), (len(cells), 1))
    own = _log_marginal(counts, prior)  # (P, C)
    gains = np.stack([_log_marginal(counts[:, [i]] + counts, prior) - own[:, [i]] - own for i in range(number)], axis=1)
    gains[:, np.arange(number), np.arange(number)] = -np.inf
    for _ in range(number - 1):
        best = gains.reshape(len(cells), -1).argmax(axis=1)
        first, second = np.sort(np.stack(np.divmod(best, number)), axis=0)
        joins = np.flatnonzero(gains[rows, first, second] > 0.0)
        if not joins.size:
            break
        one, two = first[joins], second[joins]
        counts[joins, one] += counts[joins, two]
        owners[joins] = np.where(owners[joins] == two[:, None], one[:, None], owners[joins])
        own[joins, one] = _log_marginal(counts[joins, one], prior[joins, 0])
        with_one = _log_marginal(counts[joins] + counts[joins, one][:, None], prior[joins])
        new = with_one - own[joins] - own[joins, one][:, None]
        is_gone = gains[joins, one] == -np.inf  # itself, and those that were joined before
        new = np.where(is_gone, -np.inf, new)
        gains[joins, one], gains[joins, :, one] = new, new
        gains[joins, two], gains[joins, :, two] = -np.inf, -np.inf
        own[joins, two] = 0.0
    return owners


def _log_marginal(counts: Floats, prior: Floats) -> Floats:
    """Log probability of a sequence with these counts ``(..., M)``, over all distributions of a Dirichlet prior."""
    total = prior.sum(axis=-1)
    alphas, gammaln = np.where(prior > 0.0, prior, 1.0), scipy.special.gammaln
    parts = np.where(prior > 0.0, gammaln(alphas + counts) - gammaln(alphas), 0.0)
    return np.asarray(parts.sum(axis=-1) - gammaln(total + counts.sum(axis=-1)) + gammaln(total))


def _groups(outcomes: NDArray[np.int64], number: int) -> Floats:
    """Contexts ``(n, H)`` by one action: its most frequent outcomes, or neighbouring ones; equal where missing."""
    most = int(outcomes.max()) + 1
    found = np.full((len(outcomes), number), 1.0 / number)
    seen = outcomes >= 0
    if most <= 0:
        return found
    counts = np.bincount(outcomes[seen], minlength=most)
    if np.sort(counts)[::-1][:number].sum() >= 0.9 * counts.sum():
        place = np.full(most, -1)
        place[np.argsort(-counts, kind="stable")[:number]] = np.arange(min(number, most))
    else:
        place = np.minimum((np.cumsum(counts) - counts / 2) / counts.sum() * number, number - 1).astype(int)
    group = place[outcomes[seen]]
    found[np.flatnonzero(seen)[group >= 0]] = np.eye(number)[group[group >= 0]]
    return found


def _log_likelihood(weights: Floats, probs: Floats, table: NDArray[np.int64], y: NDArray[np.int64]) -> float:
    """Mean log p(outcomes | class) of cases."""
    logs = _log_joint(weights, probs, table, 1.0)
    return float(np.logaddexp.reduce(logs[np.arange(len(y)), y], axis=1).mean())


def _log_joint(weights: Floats, probs: Floats, table: NDArray[np.int64], sharpness: float) -> Floats:
    with np.errstate(divide="ignore"):
        logs = sharpness * np.log(np.concatenate([probs, np.ones((*probs.shape[:3], 1))], axis=3))
    return log_products(logs, table) + np.log(weights)


def _sharpness(
    weights: Floats, probs: Floats, table: NDArray[np.int64], y: NDArray[np.int64], rng: np.random.Generator
) -> float:
    """The factor of log-likelihoods with the smallest loss of the class, where random outcomes of cases are shown."""
    shown = rng.random(table.shape) < rng.random((len(table), 1))
    cases = np.where(shown, table, MISSING)
    prior = np.log(np.bincount(y, minlength=len(weights)) + 1.0)
    losses = []
    for factor in _SHARPNESS.tolist():
        scores = np.logaddexp.reduce(_log_joint(weights, probs, cases, factor), axis=2) + prior
        losses.append(float((np.logaddexp.reduce(scores, axis=1) - scores[np.arange(len(y)), y]).mean()))
    return float(_SHARPNESS[int(np.argmin(losses))])


def as_table(values: ArrayLike, words: Sequence[Sequence[str]] = (), names: Sequence[str] = ()) -> Floats:
    """Cases ``(n, C)`` as floats, words by their place among those of their column; NaN, None and "" are missing.

    ``names`` are those of the columns in messages.
    """
    cells = unmasked(values, "cases")
    if cells.dtype.kind in "OSU" and cells.ndim != 2:
        raise InvalidArgument(
            "cases must be rows of equal length, or dictionaries, such as list() of a csv.DictReader, got "
            f"{type(values).__name__} of shape {cells.shape}"
        )
    if cells.dtype.kind in "OSU":  # of a spreadsheet
        cells, found = np.asarray(values, object), np.full(cells.shape, np.nan)
        places = [{word: place for place, word in enumerate(known)} for known in words] or [{}] * cells.shape[1]
        for (i, column), cell in np.ndenumerate(cells):
            if _is_missing(cell):
                continue
            known, number = places[column] if column < len(places) else {}, _number(cell)
            if known and str(cell).strip() not in known:
                raise InvalidArgument(
                    f"{_called(column, names)} is {cell!r:.40}{at((i,))}, which no case had: {few(list(known))}"
                )
            if not known and number is None:
                hint = "missing values are NaN, None or empty, and a column of words has no numbers"
                hint = "decimals have a point" if decimal_mark(str(cell)) == "," else hint
                raise InvalidArgument(f"{_called(column, names)} is {cell!r:.40}{at((i,))}, no number; {hint}")
            found[i, column] = known[str(cell).strip()] if known else number
        cells = found
    cells = cells.astype(np.float64) if cells.dtype.kind == "b" else cells
    table = np.asarray(as_real(cells, "cases"), np.float64)
    if table.ndim != 2 or not table.size or (is_large := np.abs(table) > LARGEST_VALUE).any():
        got = f"shape {table.shape}"
        if table.ndim == 2 and table.size:
            row, column = np.argwhere(is_large)[0].tolist()
            got = f"{table[row, column]:g}{at((row,))}"
        raise InvalidArgument(
            f"cases must be finite numbers (n, C), n ≥ 1, within ±{LARGEST_VALUE:g}, NaN where missing, got {got}"
        )
    return table


def _words(values: ArrayLike) -> tuple[tuple[str, ...], ...]:
    """The words of each column that has any, in their order; empty for columns of numbers, or where all are these."""
    cells = unmasked(values, "cases")
    if cells.dtype.kind not in "OSU" or cells.ndim != 2:
        return ()
    found = []
    for index, column in enumerate(np.asarray(values, object).T):
        known = [cell for cell in column.tolist() if not _is_missing(cell)]
        is_words = bool(known) and all(isinstance(cell, str) and _number(cell) is None for cell in known)
        is_words = is_words and not all(decimal_mark(cell) == "," for cell in known)
        words = sorted({cell.strip() for cell in known}) if is_words else []
        if len(words) > _MOST_WORDS:
            raise InvalidArgument(
                f"{_called(index, _names(values))} has {len(words)} different words, such as {few(words)}; more than "
                f"{_MOST_WORDS} tell nothing in common: leave the column out, or join some"
            )
        found.append(tuple(words))
    return tuple(found)


def _called(column: int, names: Sequence[str]) -> str:
    """A column in a message."""
    return repr(names[column]) if names else f"column {column} of cases"


def _is_missing(cell: Any) -> bool:
    return cell is None or (isinstance(cell, float) and cell != cell) or str(cell).strip() in ("", "<NA>", "NaT")


def _number(cell: Any) -> float | None:
    """A cell as a number; None for a word, and for what is neither."""
    try:
        return plain_number(cell) if isinstance(cell, str) else float(cell) if isinstance(cell, Real) else None
    except ValueError:
        return None
    except OverflowError:
        return math.inf


def _joined(bins: Sequence[NDArray[np.int64]], sizes: Sequence[int]) -> NDArray[np.int64]:
    """One number for the bins of several columns."""
    if math.prod(sizes) > np.iinfo(np.int64).max:
        raise InvalidArgument(
            f"the {len(sizes)} columns of an action have {math.prod(sizes):.1e} combinations of values, and at most "
            "2^63 are told apart: make several actions of them"
        )
    codes = np.zeros(len(bins[0]), np.int64)
    for one, size in zip(bins, sizes, strict=True):
        codes = codes * size + one
    return codes


def _edges(values: Floats, number: int) -> Floats:
    """Edges between single values, or, of more than ``number`` values, between their clusters on the line."""
    known = values[~np.isnan(values)]
    centres = np.unique(known)
    if len(centres) > number:
        inside = np.clip(known, *np.quantile(known, [_EDGE, 1.0 - _EDGE]))
        centres = np.unique(np.linspace(inside.min(), inside.max(), 2 * number + 1)[1::2])
        for _ in range(30):
            own = np.searchsorted((centres[1:] + centres[:-1]) / 2.0, inside, "right")
            sizes = np.bincount(own, minlength=len(centres))
            sums = np.bincount(own, inside, len(centres))
            centres = np.where(sizes > 0, sums / np.maximum(sizes, 1), centres)
    return np.asarray((centres[1:] + centres[:-1]) / 2.0)
