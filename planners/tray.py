"""Searches in a tray: where to press next, which object to confirm, and when to say that the target is absent.

A decider sees a :class:`belief.tray.TrayBelief` and where the pad is, and answers :class:`Press`, :class:`ConfirmAt`,
``Reject`` or ``Unsure``. :class:`TraySession` asks and is told; a robot plays it, or a sensor with a simulated tray.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from numbers import Integral, Real
from typing import Annotated, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from belief.constraints import Checked, Count, NotNegative, Probability, Share, Within
from belief.problem import Reject, Unsure
from belief.tray import Found, PlaceTable, TrayBelief, World, convolved
from belief.validation import Floats
from planners.decider import BadDecision, with_plain_scores

_FEW = 32  # hypotheses of an object that outcomes are drawn from
_LEAST = 0.002  # probability of being the target above which an object is examined
_NEGLIGIBLE = 1e-6  # probability of an object that is not listed
_WEIGHED = 0.02  # probability of a world above which its information counts
_EXAMINED = 4  # objects that are examined at most


SAME_PLACE = 0.015
"""Distance of places that are one [m]."""


class Press(NamedTuple):
    """Come down on a cell of the tray."""

    cell: tuple[int, int]


class ConfirmAt(NamedTuple):
    """The target is the object at a place (x, y) [m]."""

    place: tuple[float, float]


@dataclass(frozen=True)
class TrayDecision:
    """An action, and named scores that explain it."""

    action: Press | ConfirmAt | Reject | Unsure
    scores: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class TrayRules(Checked):
    """Costs and stops of a search in a tray.

    Attributes:
        travel: cost of a metre of travel, in touches.
        sure: stated probability from which the target is confirmed.
        sure_absent: that from which it is said to be absent; ``sure`` by default.
        most_touches: after which the answer is "I do not know".
        least_gain: expected information about the answer [nats] below which no press is worth a touch, so that the
            answer is "I do not know"; asked by ``information_per_cost``.
    """

    travel: NotNegative = 20.0
    sure: Share = 0.95
    sure_absent: Share | None = None
    most_touches: Count = 150
    least_gain: NotNegative = 0.005


class TrayDecider(Protocol):
    """Chooses where to press next."""

    def choose(self, belief: TrayBelief, at: tuple[float, float], rng: np.random.Generator) -> TrayDecision:
        """A press, from where the pad is (x, y) [m]."""


_WORKS = "a decider of a tray returns TrayDecision(Press(cell)), ConfirmAt(place), Reject() or Unsure() as its action"


def checked_decision(decision: Any, decider: object, belief: TrayBelief) -> TrayDecision:
    """The decision with Python numbers in place of numpy's; raises BadDecision if it is not one of this tray.

    >>> checked_decision(None, None, None)
    Traceback (most recent call last):
    ...
    planners.decider.BadDecision: the decider NoneType answered None; a decider of a tray returns \
TrayDecision(Press(cell)), ConfirmAt(place), Reject() or Unsure() as its action
    """
    who = f"the decider {type(decider).__name__} answered"
    action = decision.action if isinstance(decision, TrayDecision) else None
    if isinstance(action, Press):
        wanted = f"{who} {action!r:.80}; a cell is two integers, in [0, {belief.cells[0]}) and [0, {belief.cells[1]})"
        action = Press(_pair(action.cell, Integral, belief.cells, wanted))
    elif isinstance(action, ConfirmAt):
        wanted = f"{who} {action!r:.80}; a place is (x, y), in the tray of {belief.size[0]} x {belief.size[1]} m"
        action = ConfirmAt(_pair(action.place, Real, belief.size, wanted))
    elif not isinstance(action, Reject | Unsure):
        raise BadDecision(f"{who} {decision!r:.80}; {_WORKS}")
    return with_plain_scores(replace(decision, action=action), who)


def _pair(given: Any, kind: Any, limits: tuple[float, float], wanted: str) -> Any:
    """Two numbers from 0 to limits, of which integers stay below; raises BadDecision with the words for others."""
    pair = tuple(given) if isinstance(given, Iterable) else ()
    if len(pair) != 2 or not all(isinstance(one, kind) and not isinstance(one, bool) for one in pair):
        raise BadDecision(wanted)
    whole = kind is Integral
    plain = [int(one) if whole else float(one) for one in pair]
    if not all(0 <= one <= limit - whole for one, limit in zip(plain, limits, strict=True)):  # NaN fails too
        raise BadDecision(wanted)
    return tuple(plain)


class Standing(NamedTuple):
    """What a belief says about the target over all worlds: where it may be, that it is absent, or not found yet.

    ``places`` are pairs of a place (x, y) [m] and the probability that the target is the object there, the likeliest
    first.
    """

    places: list[tuple[tuple[float, float], float]]
    absent: float
    unfound: float

    @property
    def target(self) -> float:
        """Probability of the likeliest place; 0 without one."""
        return self.places[0][1] if self.places else 0.0


def stop(standing: Standing, num_touches: int, rules: TrayRules) -> ConfirmAt | Reject | Unsure | None:
    """The answer, if one is probable enough; None as long as none is."""
    if standing.target >= rules.sure:
        return ConfirmAt(standing.places[0][0])
    if standing.absent >= (rules.sure if rules.sure_absent is None else rules.sure_absent):
        return Reject()
    return Unsure() if num_touches >= rules.most_touches else None


def stated(standing: Standing, action: ConfirmAt | Reject | Unsure) -> float:
    """Probability of an answer; of the likeliest one for Unsure."""
    if isinstance(action, ConfirmAt):
        return sum(prob for at, prob in standing.places if math.dist(at, action.place) < SAME_PLACE)
    return standing.absent if isinstance(action, Reject) else max(standing.target, standing.absent)


def standing_of(belief: TrayBelief) -> Standing:
    """Where the target may be. Objects that different worlds have at one place are one."""
    absent = unfound = 0.0
    listed: list[tuple[float, tuple[float, float]]] = []
    for weight, world in zip(belief.weights.tolist(), belief.worlds, strict=True):
        answers = belief.answers(world)
        absent += weight * answers.absent
        unfound += weight * answers.unfound
        for one, prob in zip(world.found, answers.found.tolist(), strict=True):
            if weight * prob > _NEGLIGIBLE:
                listed.append((weight * prob, belief.place_of_target(one)))
    places: list[tuple[tuple[float, float], float]] = []
    for prob, place in sorted(listed, reverse=True):
        number = next(
            (k for k, (at, _) in enumerate(places) if np.hypot(at[0] - place[0], at[1] - place[1]) < SAME_PLACE), None
        )
        if number is None:
            places.append((place, prob))
        else:
            places[number] = places[number][0], places[number][1] + prob
    places.sort(key=lambda one: -one[1])
    return Standing(places, absent, unfound)


@dataclass(frozen=True, eq=False)
class PlaceOutcomes:
    """Touches that stand for all, ``(M, D)``, as outcomes of the next touch that meets something."""

    table: PlaceTable
    references: NDArray[np.floating]
    scale: float

    @cached_property
    def log_probs(self) -> NDArray[np.floating]:
        """Log p(reference | contact) of every contact of the table, ``(n, M)``."""
        scores = self.scale * (self.table.contacts.embeddings @ self.references.T)
        scores -= self._level.astype(scores.dtype)
        scores -= scores.max(axis=1, keepdims=True)
        scores -= np.log(np.exp(scores).sum(axis=1, keepdims=True))
        return scores

    @cached_property
    def _level(self) -> Floats:
        """Log mean ratio of each reference over all contacts, ``(M,)``."""
        contacts = self.table.contacts
        some = slice(None, None, max(1, len(contacts.row) // 4000))
        weights = (contacts.hit * self.table.prior[contacts.row])[some]
        scores = self.scale * (contacts.embeddings[some] @ self.references.T)
        highest = scores.max(axis=0)
        return np.asarray(np.log(weights @ np.exp(scores - highest) / weights.sum()) + highest)


@dataclass(frozen=True, eq=False)
class InformationPerCost(Checked):
    """Presses where the expected information about the answer, divided by the cost of the press, is largest.

    The answer is which object is the target, or that it was not found yet, or that it is absent. Two kinds of presses
    are weighed: of a found object, and of a place where nothing was found yet.

    Attributes:
        rules: of the search, with the cost of travel.
        outcomes: of touches.
        first_share: part of the uncertainty about one object that its first touch removes.
    """

    rules: TrayRules
    outcomes: PlaceOutcomes
    first_share: Probability = 0.4

    def choose(self, belief: TrayBelief, at: tuple[float, float], rng: np.random.Generator) -> TrayDecision:
        """See :class:`TrayDecider`."""
        gains = _of_worlds(belief)
        for weight, world in zip(belief.weights.tolist(), belief.worlds, strict=True):
            if weight > _WEIGHED:
                gains += weight * self._in(belief, world, rng)
        allowed = _allowed(belief)
        cost = 1.0 + self.rules.travel * _distances(belief, at)
        index = np.where(allowed, gains / cost, -1.0)
        best = int(index.argmax())
        if gains[allowed].max() < self.rules.least_gain:
            return TrayDecision(Unsure())
        return TrayDecision(_press(np.array(np.unravel_index(best, index.shape))), {"gain": float(gains.ravel()[best])})

    def _in(self, belief: TrayBelief, world: World, rng: np.random.Generator) -> Floats:
        """Expected information of a press of each cell if a world is true, ``(X, Y)`` [nats]."""
        answers = belief.answers(world)
        gains = self._of_new(belief, world, answers.unfound)
        for number in np.argsort(-answers.found)[:_EXAMINED].tolist():
            if answers.found[number] * (1.0 - answers.found[number]) > _LEAST:
                cells, gain = self.of_found(belief, world.found[number], float(answers.found[number]), rng)
                gains[tuple(cells.T)] = np.maximum(gains[tuple(cells.T)], gain)
        return gains

    def _of_new(self, belief: TrayBelief, world: World, unfound: float) -> Floats:
        """Expected information of a press of a place where nothing was found, ``(X, Y)`` [nats]."""
        of_target, of_others = cover(belief, world)
        left = belief.num_objects - len(world.found)
        if left == 0:
            return np.zeros(belief.cells)
        here, elsewhere = unfound * of_target, unfound * (1.0 - of_target)  # the target that was not found
        if_elsewhere = 1.0 - (1.0 - of_others) ** np.maximum(left - 1, 0)
        if_not = 1.0 - (1.0 - of_others) ** left
        hit = here + elsewhere * if_elsewhere + (1.0 - unfound) * if_not
        told = _entropy(hit) - elsewhere * _entropy(if_elsewhere) - (1.0 - unfound) * _entropy(if_not)
        share = here / np.maximum(hit, 1e-12)
        return np.asarray(told + self.first_share * hit * _entropy(np.clip(share, 0.0, 1.0)))

    def of_found(self, belief: TrayBelief, one: Found, prob: float, rng: np.random.Generator) -> tuple[Any, Floats]:
        """Cells beside a found object, ``(c, 2)``, and the expected information of a press there ``(c,)`` [nats]."""
        table, target = belief.table, belief.target
        total = one.evidence[target]
        others = np.delete(one.evidence, target)
        common = np.logaddexp.reduce(others)
        logs = one.log_weight - np.where(one.shape == target, total, common)
        halves = []
        for is_target in (True, False):
            some = np.flatnonzero((one.shape == target) == is_target)
            weights = np.exp(logs[some])
            if not weights.sum() > 0.0:
                return np.zeros((0, 2), int), np.zeros(0)
            halves.append(some[_systematic(weights / weights.sum(), _FEW // 2, rng)])
        chosen = np.concatenate(halves)
        of_target = np.repeat([True, False], _FEW // 2)
        x, y, row = one.x[chosen], one.y[chosen], one.row[chosen]
        reach = table.reach
        xs = np.arange(max(x.min() - 6, 0), min(x.max() + 7, belief.cells[0]))
        ys = np.arange(max(y.min() - 6, 0), min(y.max() + 7, belief.cells[1]))
        cells = np.stack(np.meshgrid(xs, ys, indexing="ij"), axis=-1).reshape(-1, 2)
        if len(cells) > 72:
            cells = cells[(cells.sum(axis=1) + cells[:, 0] // 2) % (len(cells) // 72 + 1) == 0]
        i, j = cells[:, :1] - x + reach, cells[:, 1:] - y + reach
        within = (np.minimum(i, j) >= 0) & (np.maximum(i, j) <= 2 * reach)
        i, j = np.clip(i, 0, 2 * reach), np.clip(j, 0, 2 * reach)
        hit = np.where(within, table.hit[row, i, j], 0.0)  # (c, h)
        height, spread = table.height[row, i, j], table.spread[row, i, j]
        deviation = np.sqrt(spread**2 + belief.noise.height**2)
        image = self.outcomes.log_probs[np.maximum(table.contacts.number[row, i, j], 0)]  # (c, h, M)
        drawn_hit = rng.random(hit.shape, np.float32) < hit
        drawn_height = height + deviation * rng.standard_normal(hit.shape, np.float32)
        drawn = (np.exp(image).cumsum(axis=2) < rng.random((*hit.shape, 1), np.float32)).sum(axis=2)  # (c, h)
        drawn = np.minimum(drawn, image.shape[2] - 1)
        scores = np.take_along_axis(image, drawn[:, None, :], axis=2)  # (c, h, outcome)
        scores *= one.news(cells, table.pitch)[:, None, None].astype(scores.dtype)
        z = (drawn_height[:, None, :] - height[:, :, None]) / deviation[:, :, None]
        met = np.log(np.maximum(hit, 1e-4))[:, :, None] - 0.5 * z**2 - np.log(deviation)[:, :, None] + scores
        missed = np.log(np.maximum(1.0 - hit, 1e-4))[:, :, None]
        likelihood = np.where(drawn_hit[:, None, :], met, missed)  # (c, hypothesis, outcome)
        top = likelihood.max(axis=1)
        likelihood = np.exp(likelihood - top[:, None])
        given = np.stack(
            [likelihood[:, some].mean(axis=1, dtype=float) for some in (of_target, ~of_target)]
        )  # (2, c, o)
        posterior = prob * given[0] / np.maximum(prob * given[0] + (1.0 - prob) * given[1], 1e-300)
        weight = np.where(of_target, prob, 1.0 - prob) / (_FEW // 2)
        expected = (_entropy(posterior) * weight).sum(axis=1)
        return cells, np.maximum(_entropy(np.array(prob)) - expected, 0.0)


@dataclass(frozen=True, eq=False)
class RasterThenIdentify(Checked):
    """Presses on rows of a raster, and touches every new object until its shape is named: the usual way.

    Attributes:
        rules: of the search.
        outcomes: of touches.
        named: probability of its shape from which an object is named.
        spacing: distance of the rows, and of the presses along them [m].
        most_touches: of one object, after which the raster goes on.
    """

    rules: TrayRules
    outcomes: PlaceOutcomes
    named: Share = 0.95
    spacing: Annotated[float, Within(1e-3, 10.0, unit=" m")] = 0.036
    most_touches: Count = 20

    def choose(self, belief: TrayBelief, at: tuple[float, float], rng: np.random.Generator) -> TrayDecision:
        """See :class:`TrayDecider`."""
        for one in belief.worlds[0].found:
            named = float(np.exp(one.evidence.max() - np.logaddexp.reduce(one.evidence)))
            if named < self.named and one.touches < self.most_touches:
                likeliest = int(one.evidence.argmax())
                look = InformationPerCost(self.rules, self.outcomes)
                cells, gain = look.of_found(replace(belief, target=likeliest), one, named, rng)
                if len(cells):
                    cost = 1.0 + self.rules.travel * _distances(belief, at)[tuple(cells.T)]
                    best = np.where(_allowed(belief)[tuple(cells.T)], gain / cost, -1.0).argmax()
                    return TrayDecision(_press(cells[best]), {"named": named})
        cells_of_rows = [belief.cell_at(*place) for place in raster(belief.size, self.spacing)]
        left = [cell for cell in cells_of_rows if cell not in belief.pressed]
        if not left:
            return RandomPlaces().choose(belief, at, rng)
        return TrayDecision(Press(left[0]), {"left": float(len(left))})


@dataclass(frozen=True, eq=False)
class RandomPlaces:
    """Presses anywhere."""

    def choose(self, belief: TrayBelief, at: tuple[float, float], rng: np.random.Generator) -> TrayDecision:
        """See :class:`TrayDecider`."""
        cells = np.argwhere(_allowed(belief))
        return TrayDecision(_press(cells[rng.integers(len(cells))]))


def raster(size: tuple[float, float], spacing: float) -> list[tuple[float, float]]:
    """Places on rows, to and fro, that cover a tray [m].

    >>> raster((0.08, 0.08), 0.04)
    [(0.02, 0.02), (0.06, 0.02), (0.06, 0.06), (0.02, 0.06)]
    """
    along, across = (max(1, round(edge / spacing)) for edge in size)
    xs, ys = ((np.arange(n) + 0.5) / n * edge for n, edge in ((along, size[0]), (across, size[1])))
    rows = [(xs if row % 2 == 0 else xs[::-1], y) for row, y in enumerate(ys)]
    return [(float(round(x, 9)), float(round(y, 9))) for row, y in rows for x in row]


def _of_worlds(belief: TrayBelief) -> Floats:
    """Expected information about the likeliest answer from whether a press meets a found object, ``(X, Y)`` [nats].

    It is that by which the worlds differ.
    """
    if len(belief.worlds) == 1:
        return np.zeros(belief.cells)
    standing, true = standing_of(belief), []
    for world in belief.worlds:
        answers = belief.answers(world)
        prob = answers.absent
        if standing.target > standing.absent:
            places = np.array([belief.place_of_target(one) for one in world.found]).reshape(-1, 2)
            prob = answers.found[np.hypot(*(places - standing.places[0][0]).T) < SAME_PLACE].sum()
        true.append(prob)
    met = 1.0 - np.array([belief.unmet(world) for world in belief.worlds])  # (W, X, Y)
    probs = np.stack([true, 1.0 - np.array(true)]) * belief.weights  # (answer, W)
    given = np.tensordot(probs, met, 1) / np.maximum(probs.sum(axis=1), 1e-12)[:, None, None]
    conditional = np.tensordot(probs.sum(axis=1), _entropy(given), 1)
    return np.asarray(_entropy(np.tensordot(belief.weights, met, 1)) - conditional)


def cover(belief: TrayBelief, world: World) -> tuple[Floats, Floats]:
    """Probability that a press in each cell meets an object not found yet: the target, and just any other; ``(X, Y)``.

    Rows of a shape are averaged, which is exact where no touch has told them apart.
    """
    table, kinds = belief.table, []
    shapes = belief.by_shape
    if belief.separate and world.found:
        shapes = shapes * belief.outside(world)
    shown = belief.unmet(world)
    for is_target in (True, False):
        rows = np.flatnonzero((table.shape_of == belief.target) == is_target)
        kind = np.arange(len(table.labels)) == belief.target
        places = shapes[kind == is_target].sum(axis=0)
        hit = np.tensordot(table.prior[rows], table.hit[rows], 1) / max(float(table.prior[rows].sum()), 1e-300)
        kinds.append(shown * convolved(places / max(float(places.sum()), 1e-300), hit))
    return kinds[0], kinds[1]


def maps_of(belief: TrayBelief, standing: Standing, at: tuple[float, float]) -> NDArray[np.float32]:
    """What learners see of a belief, from where the pad is (x, y) [m], ``(5, X, Y)`` in [0, 1].

    The chance that a press meets the target, or another object, that was not found yet; that it meets a found object,
    each in the likeliest world; the probability that the target is the object found within 15 mm; and the distance from
    the pad, as a share of the diagonal of the tray.
    """
    world = belief.worlds[0]
    here = np.zeros(belief.cells)
    for place, prob in standing.places:
        near = _distances(belief, place) < SAME_PLACE
        here[near] = np.maximum(here[near], prob)
    way = _distances(belief, at) / np.hypot(*belief.size)
    maps = np.stack([*cover(belief, world), 1.0 - belief.unmet(world), here, way])
    return np.clip(maps, 0.0, 1.0).astype(np.float32)


def _press(cell: NDArray[np.int64]) -> Press:
    return Press((int(cell[0]), int(cell[1])))


def _allowed(belief: TrayBelief) -> NDArray[np.bool_]:
    """Cells on which the pad may come down: its face stays within the walls, and no touch was there; ``(X, Y)``."""
    margin = belief.table.half_width - 1e-9
    sides = [
        (middles >= margin) & (middles <= size - margin)
        for middles, size in zip(belief.grid.middles, belief.size, strict=True)
    ]
    allowed = np.asarray(sides[0][:, None] & sides[1])
    if belief.pressed:
        allowed[tuple(np.array(belief.pressed).T)] = False
    return allowed if allowed.any() else np.ones(belief.cells, bool)


def _distances(belief: TrayBelief, at: tuple[float, float]) -> Floats:
    """Of all cells from a place [m], ``(X, Y)``."""
    along, across = belief.grid.middles
    return np.hypot((along - at[0])[:, None], across - at[1])


def _entropy(probs: Any) -> Floats:
    """Of binary variables [nats]."""
    p = np.clip(probs, 1e-12, 1.0 - 1e-12)
    return np.asarray(-p * np.log(p) - (1.0 - p) * np.log1p(-p))


def _systematic(probs: Floats, number: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """So many draws, evenly spaced in the cumulative probability."""
    places = (np.arange(number) + rng.uniform()) / number
    return np.minimum(np.searchsorted(np.cumsum(probs), places), len(probs) - 1)
