"""Exact marginals over all arrangements of shapes, for objects drawn from a bag with known counts.

An arrangement assigns a shape to each of N objects. Its weight is the product of the objects' likelihoods, times the
number of ways to draw it from the bag. There are up to K^N arrangements. The sum over them needs only the multiset of
shapes that the first i objects use up (forward-backward algorithm):

    forward[i][u]  = total weight of the first i objects using exactly the multiset u,
    backward[i][u] = total weight of objects i..N-1 when the first i have used u.

There are at most ∏ (c_k + 1) multisets for counts c_k: 2^K if all shapes differ.

Few arrangements (up to six objects of as many shapes) are listed in a table, and summed in plain numbers unless some
underflow. Otherwise the weights are logarithms, relative to the best arrangement: the dual of the assignment problem
has prices u_i, v_k with w_ik - u_i - v_k ≤ 0, and equality in the best arrangement. Sums therefore neither overflow nor
lose the terms that matter. Of many objects, those whose likelihood is the same for all shapes have equal marginals,
which are computed once.

    >>> import numpy as np
    >>> likelihoods = np.array([[0.9, 0.1], [0.5, 0.5]])      # the second object was not touched
    >>> arrangement_marginals(np.log(likelihoods)).round(3)   # it probably has the other shape
    array([[0.9, 0.1],
           [0.1, 0.9]])
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import ArrayLike, NDArray

from belief.bayes import update
from belief.constraints import MOST_COUNT
from belief.errors import ImpossibleObservation, InvalidArgument
from belief.naming import shown
from belief.validation import Floats, as_real, at, log_sum, require_index

MAX_STATES = 2**20
"""Largest number of multisets in an exact sum, reached by 20 distinct shapes."""

_LARGEST = np.finfo(np.float64).max
_RELIABLE = 1e-200  # smallest weight that is told apart from an underflow
_LARGEST_TABLE = 2**17  # entries (object, shape, arrangement) of a table of all arrangements
_LARGEST_LAYERS = 2**27  # entries (shape, multiset) of the layers of a sum
_LARGEST_ROUNDED = 1e8  # weight of which sums in floats are exact to 1e-7
_ROUNDS = 50  # of exact prices: numbers have 2098 bits, of which each round takes fifty or so


def arrangement_marginals(log_weights: ArrayLike, counts: Sequence[int] | None = None) -> Floats:
    """Probability that each object has each shape.

    Args:
        log_weights: log-likelihood of every shape for every object, up to a constant per row, ``(N, K)``; finite or
            -inf.
        counts: objects of each shape in the bag, ``(K,)``, at least N in all; one of each by default.

    Returns:
        ``(N, K)``; rows sum to one, column k to at most ``counts[k]``.

    Raises:
        ValueError: NaN or +inf, an empty array, more objects than the bag holds, or more than :data:`MAX_STATES`
            multisets to sum over.
        ImpossibleObservation: every arrangement has weight zero.

    >>> touched_a_cube = np.log([[0.9, 0.1], [0.5, 0.5], [0.5, 0.5]])
    >>> arrangement_marginals(touched_a_cube, counts=[2, 1]).round(3)      # two cubes, one cone
    array([[0.947, 0.053],
           [0.526, 0.474],
           [0.526, 0.474]])
    """
    return np.exp(log_arrangement_marginals(log_weights, counts))


def log_arrangement_marginals(log_weights: ArrayLike, counts: Sequence[int] | None = None) -> Floats:
    """Logarithm of :func:`arrangement_marginals`, exact also where a probability underflows.

    >>> log_arrangement_marginals([[0.0, -1e4], [0.0, 0.0]]).tolist()
    [[0.0, -10000.0], [-10000.0, 0.0]]
    """
    return _log_marginals(*_checked(log_weights, counts))


def _log_marginals(weights: Floats, bag: tuple[int, ...]) -> Floats:
    table = _every_arrangement(bag, len(weights))
    if table is None:
        blank = blank_objects(weights, bag)
        if np.count_nonzero(blank) > 1:
            first = int(blank.argmax())
            kept = ~blank
            kept[first] = True
            rows = np.where(blank, kept[:first].sum(), kept.cumsum() - 1)
            return _log_marginals(weights[kept], bag)[rows]
        if len(weights) == 1 and weights.max() > -np.inf:
            with np.errstate(divide="ignore"):
                return update(np.log(np.array(bag) / sum(bag)), weights)[0]
    elif (listed := _listed_marginals(weights, *table)) is not None:
        with np.errstate(divide="ignore"):
            return np.log(listed)
    return _sum_over_arrangements(weights, bag)


def prob_shape_absent(
    log_weights: ArrayLike, counts: Sequence[int] | None, shape: int, log_strangers: ArrayLike | None = None
) -> float:
    """Probability that no object has a shape.

    Args:
        log_weights: as for :func:`arrangement_marginals`.
        counts: as for :func:`arrangement_marginals`.
        shape: index of the shape.
        log_strangers: log probability, given that each object is in a place of this shape in the bag, that a stranger
            has replaced it (:attr:`belief.SearchProblem.unlisted`), ``(N,)``; -inf by default.

    Raises:
        ValueError: a shape out of range, or as :func:`arrangement_marginals`.
        ImpossibleObservation: as :func:`arrangement_marginals`.

    >>> round(prob_shape_absent(np.zeros((2, 4)), None, shape=0), 12)
    0.5
    """
    checked, bag = _checked(log_weights, counts)
    require_index("shape", shape, len(bag))
    relative, end, table = _relative(checked, bag)
    without = relative.copy()
    without[:, shape] = -np.inf if log_strangers is None else relative[:, shape] + np.asarray(log_strangers)
    with np.errstate(divide="ignore"):
        log_total, log_total_without = (
            log_sum(_forward(weights, table)[-1] + end, axis=0) for weights in (relative, without)
        )
    return min(float(np.exp(log_total_without - log_total)), 1.0)


def log_at_most_one_marginals(log_weights: ArrayLike, target: int) -> Floats:
    """Log marginals of N objects of which at most one has the target's shape, ``(N, K)`` (:class:`belief.AtMostOne`).

    The target is as probable at each place as it is to be absent; the other shapes are equally probable for each other
    object.

    Args:
        log_weights: log p(touches of each object | shape), ``(N, K)``, each row up to a constant.
        target: index of its shape.

    Raises:
        ImpossibleObservation: no arrangement has a positive weight.

    Two objects and three shapes; all touches of the first fit the target ten times as well as another shape:

    >>> np.exp(log_at_most_one_marginals(np.log([[10.0, 1.0, 1.0], [1.0, 1.0, 1.0]]), target=0)).round(3).tolist()
    [[0.833, 0.083, 0.083], [0.083, 0.458, 0.458]]
    """
    shape = np.shape(log_weights)
    weights, _ = _checked(log_weights, (shape[0],) * shape[1] if len(shape) == 2 and all(shape) else None)
    number, num_shapes = weights.shape
    weights = weights - np.maximum(weights.max(axis=1, keepdims=True), -_LARGEST)
    rest = np.where(np.arange(num_shapes) == target, -np.inf, weights)
    with np.errstate(divide="ignore"):  # log of an empty sum is -inf
        total = log_sum(rest, axis=1)
    others = total - np.log(num_shapes - 1)
    placed = np.where(np.eye(number + 1, number, dtype=bool), weights[:, target], others)  # place of the target, object
    shift = 2 + number.bit_length()  # so that no sum overflows
    sums = np.ldexp(placed, -shift).sum(axis=1)
    if not sums.max() > -np.inf:
        raise ImpossibleObservation("no place of the target, and none of it, has a positive weight for all objects")
    with np.errstate(divide="ignore", over="ignore"):
        logs = np.ldexp(sums - sums.max(), shift)
        logs -= log_sum(logs, axis=0)
        elsewhere = log_sum(np.where(np.eye(number, number + 1, dtype=bool), -np.inf, logs), axis=1)
        found = elsewhere[:, None] + rest - np.where(np.isfinite(total), total, 0.0)[:, None]
    found[:, target] = logs[:-1]
    return np.asarray(found)


def prob_at_most_one_present(marginals: Floats, target: int, shape: int) -> float:
    """Probability that an object has a shape, from the marginals ``(N, K)`` of :func:`log_at_most_one_marginals`.

    The column of the target has the probabilities of its place, the one of another shape may be lower by strangers.

    >>> marginals = np.exp(log_at_most_one_marginals(np.zeros((2, 3)), target=0))
    >>> [round(prob_at_most_one_present(marginals, 0, shape), 3) for shape in range(3)]
    [0.667, 0.583, 0.583]
    """
    here = marginals[:, target]
    if shape == target:
        return min(float(here.sum()), 1.0)
    other = 1.0 - here
    missing = 1.0 - np.divide(marginals[:, shape], other, out=np.zeros_like(other), where=other > 0.0)
    without = [np.delete(missing, place).prod() for place in range(len(here))]
    absent = here @ without + max(1.0 - here.sum(), 0.0) * missing.prod()
    return float(np.clip(1.0 - absent, 0.0, 1.0))


def blank_objects(log_weights: Floats, counts: Sequence[int]) -> NDArray[np.bool_]:
    """Mask of the objects whose weight is positive and equal for all shapes in the bag, ``(N,)``.

    >>> blank_objects(np.array([[0.0, 0.0, -3.0], [0.0, 1.0, 0.0]]), (1, 2, 0)).tolist()
    [True, False]
    """
    inside = log_weights[:, np.array(counts) > 0]
    return np.asarray(((inside == inside[:, :1]) & (inside > -np.inf)).all(axis=1))


def num_states(counts: Sequence[int], num_objects: int) -> int:
    """Number of multisets of shapes in an exact sum over this number of objects.

    Raises:
        ValueError: more than :data:`MAX_STATES`.

    >>> num_states([1] * 12, 12), num_states([2, 1, 1], 4)
    (4096, 12)
    """
    most = min(MAX_STATES, _LARGEST_LAYERS // len(counts))
    number = 1 + max(int(np.count_nonzero(counts)), min(max(counts), num_objects))  # at least: of no object, of one …
    if number <= most:
        number = num_multisets(tuple(counts), num_objects, most)
    if number > most:
        raise InvalidArgument(
            f"an exact sum over {num_objects} objects from a bag of {sum(counts)} in {np.count_nonzero(counts)} shapes "
            f"has more than {most} multisets of {len(counts)} shapes (at most {MAX_STATES}, as of 20 distinct shapes, "
            f"and {_LARGEST_LAYERS} numbers). Use fewer objects or shapes, or the composition 'independent'"
        )
    return number


def _checked(log_weights: ArrayLike, counts: Sequence[int] | None) -> tuple[Floats, tuple[int, ...]]:
    """Weights ``(N, K)``, -inf for shapes that are not in the bag, and the counts."""
    weights = np.asarray(as_real(log_weights, "log_weights"), np.float64)
    if weights.ndim != 2 or weights.size == 0:
        raise ValueError(f"log_weights must be (N, K) with at least one object and shape, got {weights.shape}")
    num_objects, num_shapes = weights.shape
    bag = (1,) * num_shapes if counts is None else tuple(operator.index(count) for count in counts)
    if len(bag) != num_shapes or min(bag) < 0 or max(bag) > MOST_COUNT:
        raise ValueError(
            f"counts must be {num_shapes} numbers of at least zero and at most 2^53, got {shown(list(bag))}"
        )
    if counts is None and num_objects > num_shapes:
        raise ValueError(f"{num_objects} objects cannot all differ in shape when there are {num_shapes} shapes")
    if num_objects > sum(bag):
        raise ValueError(f"{num_objects} objects cannot come from a bag of {sum(bag)}, counts {list(bag)}")
    if not weights.max() < np.inf:  # NaN is not less than anything
        row = int(np.argwhere(~(weights < np.inf))[0][0])
        raise ValueError(f"log_weights{at((row,))} hold NaN or +inf: {weights[row].tolist()}")
    return (weights if min(bag) > 0 else np.where(np.array(bag) > 0, weights, -np.inf)), bag


@lru_cache(maxsize=64)
def _every_arrangement(counts: tuple[int, ...], num_objects: int) -> tuple[NDArray[np.intp], Floats] | None:
    """All A arrangements of objects from a bag with these counts; None if they are too many for a table.

    Returns:
        The index of the weight of each object in each arrangement, in the flat matrix of weights, ``(N, A)``; and for
        every object and shape, the number of ways to draw each arrangement in which the object has the shape, relative
        to the largest, zero for the other arrangements, ``(N * K, A)``.
    """
    num_shapes, capacity = len(counts), np.array(counts, np.float64)
    if num_objects * num_shapes * np.count_nonzero(counts) > _LARGEST_TABLE:  # of the first object
        return None
    shapes, used, draws = np.zeros((0, 1), np.intp), np.zeros((num_shapes, 1)), np.ones(1)
    for _ in range(num_objects):
        if num_objects * num_shapes * shapes.shape[1] > _LARGEST_TABLE:  # further objects only increase the number
            return None
        shape, before = np.nonzero(used < capacity[:, None])
        draws = draws[before] * (capacity[shape] - used[shape, before])
        draws /= draws.max()
        used = used[:, before]
        used[shape, np.arange(len(shape))] += 1
        shapes = np.concatenate([shapes[:, before], shape[None]])
    if num_objects * num_shapes * shapes.shape[1] > _LARGEST_TABLE:
        return None
    has = shapes[:, None] == np.arange(num_shapes)[:, None]  # (N, K, A)
    places = shapes + num_shapes * np.arange(num_objects)[:, None]
    return places, np.where(has, draws, 0.0).reshape(num_objects * num_shapes, -1)


def _listed_marginals(log_weights: Floats, places: NDArray[np.intp], draws: Floats) -> Floats | None:
    """Marginals by a sum over all arrangements, ``(N, K)``; None if some underflow, or no arrangement is possible."""
    tops = log_weights.max(axis=1, keepdims=True)
    if not tops.min() > -np.inf:
        return None
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        factors = np.exp(log_weights - tops).ravel()[places]
        products = factors[0]
        for row in factors[1:]:  # faster than prod
            products *= row
        totals = (draws @ products).reshape(log_weights.shape)
        total = totals[0].sum()
        if totals.min() < _RELIABLE and not (totals[log_weights > -np.inf] >= _RELIABLE).all():
            return None
        return np.asarray(totals / total) if total < np.inf else None


def _relative(weights: Floats, bag: tuple[int, ...]) -> tuple[Floats, Floats, list[Layer]]:
    """Weights less the prices, ``(N, K)``, the term for what all objects use up, ``(S,)``, and the multisets."""
    num_objects = len(weights)
    num_states(bag, num_objects)  # raises if the sum is too large
    table = layers(bag, num_objects)
    capacity = np.minimum(bag, num_objects)
    shift = 4 + num_objects.bit_length()
    scaled = np.ldexp(weights, -shift)  # so that no sum over objects overflows
    try:
        price, rent = _prices(scaled, capacity)
    except ValueError as error:
        raise ImpossibleObservation(_why_impossible(weights, bag)) from error
    differences = (scaled - price) - rent[:, None]
    possible = weights > -np.inf
    if np.abs(weights[possible]).max() > _LARGEST_ROUNDED:
        differences, price = _exact_differences(np.where(possible, scaled, 0.0), possible, capacity)
    left = capacity[:, None] - table[-1].used.astype(np.float64)
    # Differences are limited so that no sum over objects overflows; only an exact -inf stays -inf.
    least = -_LARGEST / (8 * (num_objects + 1))
    with np.errstate(over="ignore"):
        relative = np.where(possible, np.maximum(np.ldexp(differences, shift), least), -np.inf)
        end = table[-1].log_draws + np.maximum(np.ldexp(-(price @ left), shift), least)
    return relative, end, table


def _prices(scaled: Floats, capacity: NDArray[np.integer]) -> tuple[Floats, Floats]:
    """Prices of the shapes, ``(K,)``, and what each object is worth in the best arrangement less its price, ``(N,)``.

    The prices are longest paths of at most N exchanges of shapes between objects (Bellman-Ford algorithm).
    """
    places = np.repeat(np.arange(scaled.shape[1]), capacity)
    match = places[scipy.optimize.linear_sum_assignment(scaled[:, places], maximize=True)[1]]
    taken = scaled[np.arange(len(scaled)), match]
    moves = scaled - taken[:, None]
    price = np.zeros(scaled.shape[1])
    for _ in range(len(scaled)):
        raised = np.maximum(price, (moves + price[match][:, None]).max(axis=0))
        if (raised == price).all():
            break
        price = raised
    return price, taken - price[match]


def _exact_differences(scaled: Floats, possible: NDArray[np.bool_], capacity: NDArray[np.integer]) -> tuple[Any, Any]:
    """Weights ``(N, K)`` less prices and rents, and the prices, for numbers whose rounding errors are large.

    In fractions: each round finds the prices of what the round before left, which is smaller by 15 digits. Objects of
    equal weights take what is left of the bag, so that a round may also lower a price.
    """
    fractions, spare = np.vectorize(Fraction, [object]), int(capacity.sum()) - len(scaled)
    exact = fractions(np.pad(scaled, [(0, spare), (0, 0)]))
    possible = np.pad(possible, [(0, spare), (0, 0)], constant_values=True)
    for _ in range(_ROUNDS):
        price, rent = _prices(np.where(possible, exact.astype(np.float64), -np.inf), capacity)
        if not (price.any() or rent.any()):
            break
        exact = exact - fractions(price) - fractions(rent)[:, None]
    exact = exact.astype(np.float64)
    return exact[: len(scaled)], -exact[-1] * bool(spare)


def _why_impossible(weights: Floats, bag: tuple[int, ...]) -> str:
    hopeless = np.flatnonzero((weights == -np.inf).all(axis=1))
    if hopeless.size:
        return f"object {hopeless[0]} has zero likelihood for every shape in the bag"
    what = (
        "the touches force two objects to have the same shape, and all shapes differ"
        if max(bag) == 1
        else f"the touches require more objects of a shape than the bag holds, counts {list(bag)}"
    )
    return f"every arrangement has weight zero: {what}. Log weights: {weights.tolist()}"


def _sum_over_arrangements(weights: Floats, bag: tuple[int, ...]) -> Floats:
    """Log marginals, ``(N, K)``."""
    relative, backward, table = _relative(weights, bag)
    marginals = np.empty_like(weights)
    with np.errstate(divide="ignore"):  # log of an empty sum is -inf
        forward = _forward(relative, table)
        for i in reversed(range(len(weights))):
            # Entry (k, u): the first i objects used u, and object i has shape k; (K, S).
            from_here = _look_up(backward, table[i].bigger)
            from_here += relative[i][:, None]
            backward = log_sum(from_here, axis=0)
            from_here += forward[i]
            marginals[i] = log_sum(from_here, axis=1)
        return np.asarray(marginals - log_sum(marginals, axis=1)[:, None])


def _forward(weights: Floats, table: list[Layer]) -> list[Floats]:
    """Log total weight of the first 0, 1, … N objects for each multiset that they use up, each ``(S,)``."""
    forward = [np.zeros(1)]
    for row, layer in zip(weights, table[1:], strict=True):
        forward.append(log_sum(_look_up(forward[-1], layer.smaller) + row[:, None], axis=0))
    return forward


def _look_up(log_totals: Floats, index: NDArray[np.int32]) -> Floats:
    """Values by index; an index one past the end stands for no multiset and gives -inf."""
    return np.concatenate([log_totals, [-np.inf]])[index]


@dataclass(frozen=True, eq=False)
class Layer:
    """The S multisets of one size, each the number of objects of each shape that were drawn from a bag.

    Attributes:
        used: objects of each shape, ``(K, S)``.
        last: largest shape in each, ``(S,)``.
        smaller: index of the multiset with one object of the shape less, ``(K, S)``; one past the end if it has none.
        bigger: index of the multiset with one object of the shape more, ``(K, S)``; one past the end if the bag has no
            more of them.
        num_bigger: number of multisets in the next layer.
        log_draws: log of the number of ordered draws of distinguishable objects, ``(S,)``: c (c - 1) … (c - u + 1) for
            u objects out of c, multiplied over shapes.
    """

    used: NDArray[np.integer]
    last: NDArray[np.int32]
    smaller: NDArray[np.int32]
    bigger: NDArray[np.int32]
    num_bigger: int
    log_draws: Floats


def layers(counts: tuple[int, ...], num_objects: int) -> list[Layer]:
    """The multisets of 0, 1, … ``num_objects`` objects from a bag with these counts.

    >>> [layer.used.T.tolist() for layer in layers((1, 2), 2)]
    [[[0, 0]], [[1, 0], [0, 1]], [[1, 1], [0, 2]]]
    """
    return [_layer(counts, size) for size in range(num_objects + 1)]  # ascending, as each uses the cached one before


@lru_cache(maxsize=64)
def num_multisets(counts: tuple[int, ...], num_objects: int, limit: int) -> int:
    """Number of multisets of at most ``num_objects`` objects; any number above ``limit`` if there are more.

    >>> num_multisets((1, 2), 2, limit=100)
    5
    """
    by_size = np.ones(1, np.int64)
    for count in counts:
        kinds = np.convolve(by_size, np.ones(min(count, num_objects) + 1, np.int64))
        by_size = np.minimum(kinds[: num_objects + 1], limit + 1)  # further shapes only increase the number
    return int(by_size.sum())


@lru_cache(maxsize=64)
def _layer(counts: tuple[int, ...], size: int) -> Layer:
    shapes, capacity = np.arange(len(counts), dtype=np.int32)[:, None], np.array(counts)[:, None]
    if size == 0:
        used = np.zeros((len(counts), 1), np.min_scalar_type(max(counts)))
        last, parent = np.zeros(1, np.int32), np.zeros(1, np.intp)
        smaller = np.zeros((len(counts), 1), np.int32)
        log_draws = np.zeros(1)
    else:
        before = _layer(counts, size - 1)
        # Each multiset is made once, from the one without its largest shape.
        last_shape, parent = np.nonzero((shapes >= before.last) & (before.used < capacity))
        last = last_shape.astype(np.int32)
        used = before.used[:, parent]
        log_draws = before.log_draws[parent] + np.log(capacity[last, 0] - used[last, np.arange(len(last))])
        used[last, np.arange(len(last))] += 1
        smaller = np.full(used.shape, before.used.shape[1], np.int32)
        shape, old = np.nonzero(before.bigger < before.num_bigger)
        smaller[shape, before.bigger[shape, old]] = old
    canonical = (shapes >= last) & (used < capacity)
    num_bigger = int(canonical.sum())
    bigger = np.full(used.shape, num_bigger, np.int32)
    bigger[canonical] = np.arange(num_bigger)
    if size > 0:
        # Add a shape below the largest: remove the largest, add the shape, add the largest again.
        other = before.bigger[:, parent]
        shape, here = np.nonzero((shapes < last) & (other < len(last)))
        bigger[shape, here] = bigger[last[here], other[shape, here]]
    return Layer(used, last, smaller, bigger, num_bigger, log_draws)
