"""Belief about objects that lie in a tray: which there are, where, and how, from touches and from misses.

A *row* of a :class:`PlaceTable` is one way in which a shape may lie: a stable face and a turn about the vertical. A
hypothesis about an object is a row and a place. A touch at a place comes down until it meets the highest thing below
it. So every object that would have been met above is excluded, and a contact is of exactly one object:

    p(touch | objects) = Σ_i own(object i) · ∏_{j ≠ i} lower(object j),     p(miss | objects) = ∏_j lower(object j).

Sums over all objects therefore fall apart into sums over each object, once it is said which touch is of which object.
Such an assignment is a *world*; worlds are weighed and the improbable ones are dropped, as in tracking of several
targets (Poisson multi-Bernoulli mixtures; Williams 2015, doi:10.1109/TAES.2015.130550). Objects that no touch has met
share one intensity over rows and places.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Annotated, Any, NamedTuple, Protocol, TypeAlias

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import ArrayLike, NDArray

from belief.constraints import Checked, Count, NotNegative, Positive, Probability, Within, check
from belief.errors import ImpossibleObservation, InvalidArgument
from belief.naming import shown
from belief.validation import Floats, are_finite, require_index, require_number

Floats32 = NDArray[np.floating]
Ints = NDArray[np.int64]

_Metres: TypeAlias = Annotated[float, Within(1e-6, 1.0, unit=" m")]
_IRRELEVANT = 1e-6  # weight of a hypothesis, relative to the largest of its object
_STRAY = 1e-4  # probability that an object is not met although it is hit, or met although it is not
_ODD, _TALL = 0.02, 0.05  # share of heights that are odd, and the range of heights [m]
_MEETS = 0.7  # probability that a touch near an object of none of the shapes meets it
_DEAD = 1e-3  # weight of a world, relative to the largest, below which it is dropped
_CHECKED = 0.9  # probability of being the target from which it is asked whether an object is only like it
_ALIKE = 0.1  # prior odds of that


@dataclass(frozen=True, eq=False)
class PlaceTable:
    """What presses beside the middle of K shapes would meet, for R rows and G × G offsets of the press from the middle.

    Attributes:
        labels: of the shapes.
        shape_of: shape of each row, ``(R,)``.
        prior: probability of each row given its shape, ``(R,)``.
        extents: half the extent of each row along x and y [m], ``(R, 2)``.
        inner: radius of the largest disc about the middle that each row covers [m], ``(R,)``.
        hit: probability that a press at an offset meets the body, ``(R, G, G)``; the middle is at ``G // 2``.
        height, spread: height above the floor at which it meets it [m], and its standard deviation, ``(R, G, G)``.
        embeddings: of the contacts at the n offsets with ``hit > 0``, in the order of the array, ``(n, D)``; the
            product with that of an image is log p(image | contact) up to a constant of the image.
        pitch: distance of neighbouring offsets [m].
        half_width: half the edge of the pad [m].
    """

    labels: tuple[str, ...]
    shape_of: Ints
    prior: Floats
    extents: Floats
    inner: Floats
    hit: Floats32
    height: Floats32
    spread: Floats32
    embeddings: Floats32
    pitch: float
    half_width: float = 0.0

    @property
    def reach(self) -> int:
        """Largest offset, in cells."""
        return self.hit.shape[1] // 2

    @cached_property
    def contacts(self) -> Contacts:
        """The offsets of each row at which a press may meet the body."""
        return Contacts.of(self)


@dataclass(frozen=True, eq=False)
class Contacts:
    """The n offsets at which a press may meet a body, of a :class:`PlaceTable`, and the place of each among them.

    ``row``, ``i`` and ``j`` are ``(n,)``, ``hit``, ``height`` and ``spread`` as well, and ``embeddings (n, D)``;
    ``number (R, G, G)`` is the place of each offset of each row in these, −1 for none.
    """

    row: Ints
    i: Ints
    j: Ints
    hit: Floats32
    height: Floats32
    spread: Floats32
    embeddings: Floats32
    number: NDArray[np.int32]

    @classmethod
    def of(cls, table: PlaceTable) -> Contacts:
        """Those of a table."""
        row, i, j = np.nonzero(table.hit > 0.0)
        number = np.full(table.hit.shape, -1, np.int32)
        number[row, i, j] = np.arange(len(row), dtype=np.int32)
        hit, height, spread = (part[row, i, j] for part in (table.hit, table.height, table.spread))
        return cls(row, i, j, hit, height, spread, table.embeddings, number)


class Grid(NamedTuple):
    """The cells of a tray: its size along x and y [m], and the distance of neighbouring cells [m]."""

    size: tuple[float, float]
    pitch: float

    @property
    def cells(self) -> tuple[int, int]:
        """Cells of the tray along x and y."""
        along, across = (int(edge / self.pitch + 1e-9) for edge in self.size)
        return along, across

    def centre(self, cell: Sequence[float]) -> tuple[float, float]:
        """The middle of a cell in the tray [m]."""
        x, y = ((place + 0.5) * self.pitch + 0.5 * self._rest(axis) for axis, place in enumerate(cell))
        return x, y

    def cell_at(self, x: float, y: float) -> tuple[int, int]:
        """The cell of a place in the tray [m]; the nearest one for a place at its edge."""
        found = [int((v - 0.5 * self._rest(axis)) // self.pitch) for axis, v in enumerate((x, y))]
        return min(max(found[0], 0), self.cells[0] - 1), min(max(found[1], 0), self.cells[1] - 1)

    @property
    def middles(self) -> tuple[Floats, Floats]:
        """The middles of all cells along x and along y [m]."""
        along, across = (np.asarray((np.arange(number) + 0.5) * self.pitch, float) for number in self.cells)
        return along + 0.5 * self._rest(0), across + 0.5 * self._rest(1)

    def _rest(self, axis: int) -> float:
        return self.size[axis] - self.cells[axis] * self.pitch


class PlaceTouch(NamedTuple):
    """A touch in a tray.

    Attributes:
        cell: where it was, along x and y, in cells.
        height: at which it ended, above the floor [m]; 0 for a miss.
        embedding: of its image, ``(D,)``; None for a miss.
        level: log p(image | some body), up to the constant of the image that the products of embeddings have, times
            the scale of the noise; by default that of the bodies which the touch may have met.
        image: that the embedding is of, where a :class:`Lookalikes` compares it.
        place: of the touch [m]; by default the middle of the cell.
    """

    cell: tuple[int, int]
    height: float = 0.0
    embedding: NDArray[np.floating] | None = None
    level: float | None = None
    image: NDArray[np.uint8] | None = None
    place: tuple[float, float] | None = None


@dataclass(frozen=True)
class TouchNoise(Checked):
    """How far touches are from what the table predicts.

    Attributes:
        height: standard deviation of the measured height beside the spread of a cell [m].
        scale: by which log likelihood ratios of images are multiplied.
        outliers: share of touches whose height or image has nothing to do with the hypothesis, such as those of a body
            that does not lie as any row says.
        push: largest distance along x and y by which a touch moves the object that it meets [m], at most the pitch.
        drift: share by which errors about one object come again: n touches count as n / (1 + drift · (n − 1)).
        repeat: share by which the error of a touch comes again at the same place of an object; it falls with the
            distance of the places as a normal density does.
        near: standard deviation of that density [m].
    """

    height: _Metres = 0.001
    scale: Positive = 0.9
    drift: NotNegative = 0.03
    repeat: Probability = 0.8
    near: _Metres = 0.005
    outliers: Probability = 0.02
    push: Annotated[float, Within(0.0, 1.0, unit=" m")] = 0.0

    def robust(self, scores: Floats32) -> Floats32:
        """Log likelihood ratios of images, of which some are outliers that say nothing, before the scale."""
        if not self.outliers:
            return scores
        least = float(np.log(self.outliers)) / self.scale
        return np.asarray(np.logaddexp(self.scale * (scores - least), 0.0) / self.scale + least)


@dataclass(frozen=True, eq=False)
class Found:
    """An object that touches have met, with its hypotheses.

    Attributes:
        first: number of the touch that met it first.
        met: the touches that met it.
        row, x, y: of each hypothesis, ``(n,)``.
        base: log of prior times likelihood of heights, ``(n,)``.
        sums: log likelihood ratios of its images, ``(n,)``.
        noise: of the touches.
        num_shapes: K.
        log_unlisted: log likelihood of its touches given an object of none of the shapes.
        shape: of each hypothesis, ``(n,)``.
    """

    first: int
    met: tuple[PlaceTouch, ...]
    row: Ints
    x: Ints
    y: Ints
    base: Floats
    sums: Floats
    noise: TouchNoise
    num_shapes: int
    shape: Ints
    log_unlisted: float = -np.inf

    @property
    def touches(self) -> int:
        """Number of touches that met it."""
        return len(self.met)

    @property
    def cells(self) -> list[tuple[int, int]]:
        """Of the touches that met it."""
        return [touch.cell for touch in self.met]

    def news(self, cells: ArrayLike, pitch: float) -> Floats:
        """Share of a touch in each of these cells ``(c, 2)`` that does not repeat the touches before it, ``(c,)``."""
        apart = (np.asarray(cells)[:, None] - np.array(self.cells)) * pitch / self.noise.near  # (c, touches, 2)
        return np.asarray(np.prod(1.0 - self.noise.repeat * np.exp(-0.5 * (apart**2).sum(axis=2)), axis=1))

    @cached_property
    def log_weight(self) -> Floats:
        """Log of prior times likelihood of every hypothesis, ``(n,)``."""
        factor = self.noise.scale / (1.0 + self.noise.drift * (self.touches - 1))
        return np.asarray(self.base + factor * self.sums)

    @cached_property
    def evidence(self) -> Floats:
        """Log likelihood of all touches given each shape of the object, ``(K,)``."""
        highest = self.log_weight.max(initial=-np.inf)
        if highest == -np.inf:
            return np.full(self.num_shapes, -np.inf)
        sums = np.bincount(self.shape, np.exp(self.log_weight - highest), self.num_shapes)
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(sums) + highest)

    @cached_property
    def box(self) -> tuple[int, int, int, int]:
        """Least and largest place along x and y."""
        return int(self.x.min()), int(self.x.max()), int(self.y.min()), int(self.y.max())

    def pruned(self) -> Found:
        """Without irrelevant hypotheses."""
        kept = self.log_weight > self.log_weight.max() + np.log(_IRRELEVANT)
        parts = {name: getattr(self, name)[kept] for name in ("row", "x", "y", "base", "sums", "shape")}
        return replace(self, **parts)

    def probs(self, log_shapes: Floats) -> Floats:
        """Probability of every hypothesis ``(n,)`` for log weights of the shapes ``(K,)``."""
        logs = self.log_weight + log_shapes[self.shape]
        weights = np.exp(logs - logs.max())
        return np.asarray(weights / weights.sum())


class _Felt(NamedTuple):
    """A touch, and what it says of each of the table's contacts ``(n,)``.

    ``log_lower`` is the log probability that it is not met above the touch; ``log_own`` the log density of the height
    at which it is met, and ``scores`` the log likelihood ratios of the image; None for a miss.
    """

    touch: PlaceTouch
    log_lower: Floats32
    log_own: Floats32 | None
    scores: Floats32 | None


@dataclass(frozen=True, eq=False)
class World:
    """An assignment of touches to objects: the objects that were met, and the weight of the assignment.

    ``log_odd`` is the log density of touches that are of no object, such as those of an object that lies as no row
    says. ``log_answers (n + 2,)`` are the log probabilities of :meth:`TrayBelief.answers`, once they are known.
    """

    found: tuple[Found, ...]
    log_weight: float = 0.0
    log_odd: float = 0.0
    log_answers: Floats | None = None


class Answers(NamedTuple):
    """Where the target is, in one world: at each found object ``(n,)``, among those not found yet, or absent."""

    found: Floats
    unfound: float
    absent: float


class Lookalikes(Protocol):
    """Weighs whether a found object is of a shape, or only like it."""

    def log_factor(self, belief: TrayBelief, one: Found, shape: int) -> float:
        """Log Bayes factor of "it is only like it" of a found object that is taken for a shape."""


@dataclass(frozen=True, eq=False)
class TrayBelief:
    """The belief about N objects in a tray of which at most one has the target's shape.

    Attributes:
        table: what presses would meet.
        size: of the tray along x and y [m].
        target: index of the shape sought.
        num_objects: N.
        present: prior probability that the target is there.
        noise: of touches.
        most_worlds: assignments that are kept.
        separate: whether objects do not overlap.
        unlisted: probability that an object which is not the target has none of the shapes.
        lookalikes: is asked about objects that are probably the target; None for no such question.
        intensity: prior of row and place of an object that no touch has met, given its shape, times the probability of
            all touches so far, ``(R, X, Y)``.
        worlds: assignments, the likeliest first.
        pressed: cells of all touches so far.
        doubts: what ``lookalikes`` said of objects, by the cells of their touches.
    """

    table: PlaceTable
    size: tuple[float, float]
    target: int
    num_objects: Count
    present: Probability
    noise: TouchNoise = field(default_factory=TouchNoise)
    most_worlds: Count = 6
    separate: bool = True
    unlisted: Probability = 0.0
    lookalikes: Lookalikes | None = field(default=None, repr=False)
    intensity: Floats32 = field(default=None, repr=False)  # type: ignore[arg-type]
    worlds: tuple[World, ...] = (World(()),)
    pressed: tuple[tuple[int, int], ...] = ()
    doubts: Mapping[tuple[tuple[int, int], ...], float] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        if self.intensity is not None:
            return  # an update of one that was checked
        check(self)
        require_index("target", self.target, len(self.table.labels))
        if not are_finite(*self.size) or min(self.cells) < 1:
            raise InvalidArgument(f"a tray has cells of {self.table.pitch:g} m: size {shown(self.size)} m holds none")
        object.__setattr__(self, "intensity", self._prior())
        self._require_room()

    def _require_room(self) -> None:
        """Raise InvalidArgument where no objects as said can lie in the tray: the target, and others beside it."""
        is_target = self.table.shape_of == self.target
        needs = (self.present > 0.0, is_target, "the target"), (self._has_others, ~is_target, "another shape")
        for is_needed, rows, what in needs:
            if is_needed and not rows.any():
                raise InvalidArgument(
                    f"{self.num_objects} objects, and the target with a probability of {self.present:g}: others have "
                    f"other shapes, and {self.table.labels[self.target]} is the only one; give more shapes, or one "
                    "object and present=1"
                )
            if is_needed and not self.intensity[rows].any():
                raise InvalidArgument(
                    f"the tray of {self.size[0]:g} x {self.size[1]:g} m is too small for {what}: is its size in m?"
                )

    @property
    def _has_others(self) -> bool:
        return self.num_objects > 1 or self.present < 1.0

    def require(self, touch: PlaceTouch) -> None:
        """Raise InvalidArgument for a touch that does not fit the tray and its table, or is not finite."""
        if len(touch.cell) != len(self.cells):
            raise InvalidArgument(f"cell of a touch must be two indices, got {shown(touch.cell)}")
        for axis, (place, number) in enumerate(zip(touch.cell, self.cells, strict=True)):
            require_index(f"cell[{axis}] of a touch", place, number)
        require_number("height of a touch", touch.height, 0.0, 1.0)
        if (touch.embedding is None) != (touch.height == 0.0):
            raise InvalidArgument(
                f"a contact has an embedding and a height above 0, and a miss neither; got a height of {touch.height}"
                f"{'' if touch.embedding is None else ' with an embedding'}"
            )
        if touch.embedding is not None:
            found, wanted = np.asarray(touch.embedding), self.table.embeddings.shape[1:]
            if found.shape != wanted or not np.isfinite(found).all():
                raise InvalidArgument(f"an embedding must be {wanted[0]} finite numbers, got {shown(touch.embedding)}")
        if touch.level is not None and not are_finite(touch.level):
            raise InvalidArgument(f"the level of a touch must be finite, got {shown(touch.level)}")

    @property
    def num_touches(self) -> int:
        """Touches so far, misses as well."""
        return len(self.pressed)

    @cached_property
    def grid(self) -> Grid:
        """Cells of the tray."""
        return Grid(self.size, self.table.pitch)

    @cached_property
    def cells(self) -> tuple[int, int]:
        """Cells of the tray along x and y."""
        return self.grid.cells

    def centre(self, cell: Sequence[float]) -> tuple[float, float]:
        """The middle of a cell in the tray [m]."""
        return self.grid.centre(cell)

    def cell_at(self, x: float, y: float) -> tuple[int, int]:
        """The cell of a place in the tray [m]; the nearest one for a place at its edge."""
        return self.grid.cell_at(x, y)

    def _prior(self) -> Floats32:
        inside = []
        for axis, along in enumerate(self.grid.middles):
            extent = self.table.extents[:, axis, None]
            inside.append((along >= extent) & (along <= self.size[axis] - extent))
        fits = (inside[0][:, :, None] & inside[1][:, None, :]).astype(self.table.hit.dtype)
        numbers = np.maximum(fits.sum(axis=(1, 2)), 1.0)
        return np.asarray(fits * (self.table.prior / numbers)[:, None, None].astype(self.table.hit.dtype))

    # --- update

    def update(self, touch: PlaceTouch) -> TrayBelief:
        """The belief after one more touch or miss; see :meth:`require`."""
        self.require(touch)
        contacts, noise, reach = self.table.contacts, self.noise, self.table.reach
        x, y = touch.cell[0] + reach - contacts.i, touch.cell[1] + reach - contacts.j
        inside = np.flatnonzero((x >= 0) & (x < self.cells[0]) & (y >= 0) & (y < self.cells[1]))
        hit, mean = contacts.hit, contacts.height
        deviation = np.sqrt(contacts.spread**2 + noise.height**2)
        below = scipy.special.ndtr((float(touch.height) - mean) / deviation) if touch.height > 0.0 else 0.0
        lower = _STRAY + (1.0 - _STRAY) * (1.0 - hit * (1.0 - below))
        where = (contacts.row[inside] * self.cells[0] + x[inside]) * self.cells[1] + y[inside]
        before = self.intensity.ravel()[where]
        intensity = self.intensity.copy()
        intensity.ravel()[where] = before * lower[inside]
        where = (self.table.shape_of[contacts.row[inside]] * self.cells[0] + x[inside]) * self.cells[1] + y[inside]
        gone = np.bincount(where, before - before * lower[inside], self.by_shape.size).reshape(self.by_shape.shape)
        own = scores = None
        of_any = 0.0
        if touch.embedding is not None:
            scores = contacts.embeddings @ np.asarray(touch.embedding, contacts.embeddings.dtype)
            weights = before * hit[inside]
            level = _log_mean(noise.scale * scores[inside], weights) if touch.level is None else touch.level
            of_any = float(weights.sum()) / len(self.table.labels)
            scores = noise.robust(scores - level / noise.scale)  # 0: as good as just any object here
            density = np.exp(-0.5 * ((float(touch.height) - mean) / deviation) ** 2) / deviation
            own = np.log(hit * (density * ((1.0 - _ODD) / math.sqrt(2.0 * math.pi)) + _ODD / _TALL))
        felt = _Felt(touch, np.log(lower), own, scores)
        fresh = None
        if own is not None and scores is not None:
            with np.errstate(divide="ignore"):
                base = np.log(before) + own[inside]
            kept = base + noise.scale * scores[inside]
            kept = inside[kept > kept.max(initial=-np.inf) + math.log(_IRRELEVANT)]
            if len(kept):
                row = contacts.row[kept]
                base = np.log(self.intensity[row, x[kept], y[kept]]).astype(float) + own[kept]
                parts = row, x[kept], y[kept], base, scores[kept].astype(float)
                unlisted = math.log(max(of_any, 1e-300)) - math.log(_TALL)
                shape = self.table.shape_of[row]
                fresh = Found(self.num_touches, (touch,), *parts, noise, len(self.table.labels), shape, unlisted)
                fresh = self._pushed(fresh)
        cache: dict[tuple[int, bool], Found | None] = {}
        worlds: list[World] = []
        for world in self.worlds:
            others = tuple(self._after(one, felt, False, cache) for one in world.found)
            if own is None:
                worlds.append(replace(world, found=others))
                continue
            worlds.append(replace(world, found=others, log_odd=world.log_odd + np.log(_STRAY / _TALL)))
            for number, one in enumerate(world.found):
                if (met := self._after(one, felt, True, cache)) is not None:
                    worlds.append(replace(world, found=(*others[:number], met, *others[number + 1 :])))
            has_room = fresh is not None and len(world.found) < self.num_objects
            if fresh is not None and has_room and (new := self._kept_apart(fresh, world)) is not None:
                worlds.append(replace(world, found=(*others, new)))
        after = replace(self, intensity=intensity, pressed=(*self.pressed, touch.cell))
        vars(after)["by_shape"] = np.maximum(self.by_shape - gone, 0.0)  # a sum over all rows takes longer
        likely = after._likeliest(worlds)
        if self.lookalikes is not None:
            doubts = dict(self.doubts)
            likely = tuple(after._doubted(self.lookalikes, world, doubts) for world in likely)
            object.__setattr__(after, "doubts", doubts)
        object.__setattr__(after, "worlds", likely)
        return after

    def _doubted(self, lookalikes: Lookalikes, world: World, doubts: dict[tuple[tuple[int, int], ...], float]) -> World:
        """A world in which objects that are probably the target may be only like it; adds to :attr:`doubts`.

        What is only like it fits its touches as well as the target does, however many they are.
        """
        assert world.log_answers is not None, "of a likely world"
        logs, asked = world.log_answers, set[int]()
        while (place := int(logs.argmax())) < len(world.found) and place not in asked:
            rest = np.delete(logs, place)
            prob, others = float(np.exp(logs[place])), float(np.logaddexp.reduce(rest))
            if prob < _CHECKED or others == -np.inf:  # or it must be the target
                break
            asked.add(place)
            cells = tuple(world.found[place].cells)
            recent = [n for n in range(1, len(cells) + 1) if n + max(1, n // 4) > len(cells) and cells[:n] in doubts]
            if not recent:  # the more touches, the more of them it takes to ask again
                doubts[cells] = lookalikes.log_factor(self, world.found[place], self.target)
            odds = math.log(_ALIKE) + doubts[cells[: recent[-1]] if recent else cells]  # of being only like it
            freed = logs[place] - np.logaddexp(0.0, -odds)
            rest += np.logaddexp(others, freed) - others
            logs = np.insert(rest, place, logs[place] - np.logaddexp(0.0, odds))
        return replace(world, log_answers=logs)

    def _kept_apart(self, new: Found, world: World) -> Found | None:
        """A new object, not where a found one is."""
        if not self.separate or not world.found:
            return new
        outside = self.outside(world)[new.shape, new.x, new.y]
        if not (outside > 0.0).any():
            return None
        with np.errstate(divide="ignore"):
            return replace(new, base=new.base + np.log(outside)).pruned()

    def _after(self, one: Found, felt: _Felt, is_met: bool, cache: dict[tuple[int, bool], Found | None]) -> Any:
        """A found object after a touch that met it, or another thing; None if it cannot have met it."""
        key = id(one), is_met
        if key in cache:
            return cache[key]
        reach, cell, (low_x, high_x, low_y, high_y) = self.table.reach, felt.touch.cell, one.box
        found: Found | None = None if is_met else one
        if low_x - reach <= cell[0] <= high_x + reach and low_y - reach <= cell[1] <= high_y + reach:
            i, j = cell[0] - one.x + reach, cell[1] - one.y + reach
            within = (np.minimum(i, j) >= 0) & (np.maximum(i, j) <= 2 * reach)
            number = self.table.contacts.number[one.row, np.where(within, i, 0), np.where(within, j, 0)]
            hits = np.flatnonzero(within & (number >= 0))
            if not is_met and len(hits):
                base = one.base.copy()
                base[hits] += felt.log_lower[number[hits]]
                found = replace(one, base=base).pruned()
            elif is_met and len(hits) and felt.log_own is not None and felt.scores is not None:
                number = number[hits]
                parts = {name: getattr(one, name)[hits] for name in ("row", "x", "y", "shape")}
                parts |= {"log_unlisted": one.log_unlisted + math.log(_MEETS / _TALL)}
                new, at_any_height = (
                    one.news([cell], self.table.pitch)[0],
                    np.log(self.table.contacts.hit[number] / _TALL),
                )
                heights = new * (felt.log_own[number] - at_any_height)
                parts |= {"base": one.base[hits] + at_any_height + heights}
                parts |= {"sums": one.sums[hits] + new * felt.scores[number]}
                found = self._pushed(replace(one, **parts, met=(*one.met, felt.touch)).pruned())
        cache[key] = found
        return found

    def _pushed(self, one: Found) -> Found:
        """A found object after a touch moved it: its places are spread over the neighbouring cells."""
        if not self.noise.push:
            return one
        aside = min(self.noise.push / (4.0 * self.table.pitch), 1.0 / 3.0)  # of a uniform push from anywhere in a cell
        shares = np.log([aside, 1.0 - 2.0 * aside, aside])
        steps = np.arange(3) - 1
        x, y = np.broadcast_arrays(one.x[:, None, None] + steps[:, None], one.y[:, None, None] + steps)
        logs = one.log_weight[:, None, None] + shares[:, None] + shares
        row = np.broadcast_to(one.row[:, None, None], logs.shape)
        inside = (x >= 0) & (x < self.cells[0]) & (y >= 0) & (y < self.cells[1])
        places = ((row * self.cells[0] + x) * self.cells[1] + y)[inside]
        cells, owner = np.unique(places, return_inverse=True)
        highest = float(logs.max())
        base = np.log(np.bincount(owner.ravel(), np.exp(logs[inside] - highest))) + highest
        row, rest = np.divmod(cells, self.cells[0] * self.cells[1])
        x, y = np.divmod(rest, self.cells[1])
        shape = self.table.shape_of[row]
        return replace(one, row=row, x=x, y=y, base=base, sums=np.zeros(len(row)), shape=shape).pruned()

    # --- weights of worlds and answers

    def _likeliest(self, worlds: Sequence[World]) -> tuple[World, ...]:
        """The likeliest of these worlds, in the order of their weights."""
        anywhere = self.by_shape.sum(axis=(1, 2), dtype=float)
        bounds = np.array([self._log_answers(world, anywhere)[1] for world in worlds])  # as if objects could overlap
        best: list[tuple[float, int, Floats]] = []
        for number in np.argsort(-bounds, kind="stable").tolist():
            if best and bounds[number] <= best[0][0] + np.log(_DEAD):
                break
            if len(best) == self.most_worlds and bounds[number] <= best[-1][0]:
                break
            answers, total = self._log_answers(worlds[number], self.masses(worlds[number]))
            best = sorted([*best, (total, number, answers)], key=lambda one: (-one[0], one[1]))[: self.most_worlds]
        highest = best[0][0]
        if not highest > -np.inf:
            raise ImpossibleObservation("the touches are impossible for every arrangement of the objects in the tray")
        return tuple(
            replace(worlds[number], log_weight=total - highest, log_answers=answers)
            for total, number, answers in best
            if total > highest + np.log(_DEAD)
        )

    def _log_answers(self, world: World, masses: Floats) -> tuple[Floats, float]:
        """Log weights of the answers: each found object, one not found, absent ``(n + 2,)``; and of their sum.

        ``masses`` are those of :meth:`masses`.
        """
        target, number, num_shapes = self.target, self.num_objects, len(self.table.labels)
        left, others = number - len(world.found), max(num_shapes - 1, 1)
        evidence = np.array([one.evidence for one in world.found]).reshape(-1, num_shapes)
        with np.errstate(divide="ignore"):
            masses = np.log(masses)
            of_others = np.full(len(evidence) + 1, -np.inf)  # each found object, and all that are not found
            if num_shapes > 1:
                rest = np.delete(np.vstack([evidence, masses]), target, axis=1)
                of_others = np.logaddexp.reduce(rest, axis=1) - np.log(others)
            if self.unlisted:
                strange = [one.log_unlisted for one in world.found] + [of_others[-1]]
                of_others = np.logaddexp(of_others + np.log1p(-self.unlisted), strange + np.log(self.unlisted))
            share, absent = np.log(self.present / number), np.log1p(-self.present)
            unfound = left * of_others[-1] if left else 0.0
            logs = np.append(evidence[:, target] + share, [-np.inf, absent + unfound + of_others[:-1].sum()])
            for place in range(len(evidence)):
                logs[place] += np.delete(of_others[:-1], place).sum() + unfound
            if left:
                rest_unfound = (left - 1) * of_others[-1] if left > 1 else 0.0
                logs[-2] = np.log(left) + share + masses[target] + rest_unfound + of_others[:-1].sum()
        logs += np.log(np.arange(left + 1, number + 1, dtype=float)).sum() + world.log_odd
        total = float(np.logaddexp.reduce(logs))
        return (logs - total if total > -np.inf else logs), total

    def answers(self, world: World) -> Answers:
        """Where the target is, in one world."""
        probs = np.exp(
            self._log_answers(world, self.masses(world))[0] if world.log_answers is None else world.log_answers
        )
        return Answers(probs[:-2], float(probs[-2]), float(probs[-1]))

    @property
    def weights(self) -> Floats:
        """Probability of each world, ``(W,)``."""
        weights = np.exp([world.log_weight for world in self.worlds])
        return np.asarray(weights / weights.sum())

    def place_of_target(self, one: Found) -> tuple[float, float]:
        """Mean place of a found object if it is the target [m]; of all its hypotheses if it cannot be."""
        shapes = np.where(np.arange(one.num_shapes) == self.target, 0.0, -np.inf)
        if not np.isfinite(one.evidence[self.target]):
            shapes = np.zeros(one.num_shapes)
        probs = one.probs(shapes)
        return self.centre((float(probs @ one.x), float(probs @ one.y)))

    def masses(self, world: World) -> Floats:
        """Probability of all touches so far given that an object of each shape was not met, ``(K,)``."""
        shapes = self.by_shape
        if not (self.separate and world.found):
            return np.asarray(shapes.sum(axis=(1, 2)), float)
        return np.einsum("kxy,kxy->k", shapes, self.outside(world), dtype=float)

    @cached_property
    def by_shape(self) -> Floats:
        """The intensity of each shape, whatever the row, ``(K, X, Y)``."""
        first = np.flatnonzero(np.diff(self.table.shape_of, prepend=-1))
        return np.add.reduceat(self.intensity, first, axis=0, dtype=float)

    def outside(self, world: World) -> Floats32:
        """Probability that an object of each shape with its middle in a cell overlaps with no found one, ``(K, X, Y)``.

        Two objects overlap for sure where the discs that they cover do.
        """
        margins, number = np.unique(self._margins, return_inverse=True)
        found = np.ones((len(margins), *self.cells), np.float32)
        for one in world.found:
            found *= 1.0 - _kept(self, one, tuple(margins.tolist()))
        return np.clip(found, 0.0, 1.0)[number]

    @cached_property
    def _margins(self) -> Floats:
        """Radius of the disc that a shape covers however it lies, in half cells [m], ``(K,)``."""
        first = np.flatnonzero(np.diff(self.table.shape_of, prepend=-1))
        step = self.table.pitch / 2.0
        return np.asarray(np.floor(np.minimum.reduceat(self.table.inner, first) / step) * step)

    def unmet(self, world: World) -> Floats32:
        """Probability that a press in each cell meets no found object, ``(X, Y)``."""
        found = np.ones(self.cells, np.float32)
        for one in world.found:
            found *= 1.0 - _kept(self, one, None)
        return np.clip(found, 0.0, 1.0)

    def discs(self, one: Found, margins: tuple[float, ...]) -> Floats32:
        """Probability that the disc which a found object covers is within each margin [m] of a cell, ``(M, X, Y)``."""
        probs, (low_x, high_x, low_y, high_y) = one.probs(np.zeros(one.num_shapes)), one.box
        widest = int((self.table.inner.max() + max(margins)) / self.table.pitch) + 2
        shape = high_x - low_x + 1 + 2 * widest, high_y - low_y + 1 + 2 * widest  # all that the discs can reach
        size = tuple(scipy.fft.next_fast_len(number, True) for number in shape)
        places = (one.x - low_x + widest) * size[1] + one.y - low_y + widest
        radii = np.rint((self.table.inner[:, None] + margins) / self.table.pitch).astype(int)
        radii, of_disc = np.unique(radii, axis=0, return_inverse=True)
        sums = np.zeros((len(margins), size[0], size[1] // 2 + 1), np.complex64)
        disc = of_disc.ravel()[one.row]
        for number in np.flatnonzero(np.bincount(disc)).tolist():
            some = disc == number
            masses = np.bincount(places[some], probs[some], size[0] * size[1]).astype(np.float32)
            spectrum = scipy.fft.rfft2(masses.reshape(size))
            for place, radius in enumerate(radii[number].tolist()):
                sums[place] += spectrum * _disc(radius, size)
        along, across = self.cells
        found = np.zeros((len(margins), along + 2 * widest, across + 2 * widest), np.float32)
        discs = scipy.fft.irfft2(sums, size)[:, : shape[0], : shape[1]]
        found[:, low_x : low_x + shape[0], low_y : low_y + shape[1]] = np.clip(discs, 0.0, 1.0)
        return found[:, widest:-widest, widest:-widest]

    def hits(self, one: Found) -> Floats32:
        """Probability that a press in each cell meets a found object, by hypotheses that stand for all, ``(X, Y)``."""
        probs, reach = one.probs(np.zeros(one.num_shapes)), self.table.reach
        places = np.searchsorted(np.cumsum(probs), (np.arange(_STAND_FOR) + 0.5) / _STAND_FOR * (1.0 - 1e-9))
        chosen, counts = np.unique(np.minimum(places, len(probs) - 1), return_counts=True)
        found = np.zeros((self.cells[0] + 2 * reach, self.cells[1] + 2 * reach), np.float32)
        for place, count in zip(chosen.tolist(), counts.tolist(), strict=True):
            x, y = int(one.x[place]), int(one.y[place])
            found[x : x + 2 * reach + 1, y : y + 2 * reach + 1] += self.table.hit[one.row[place]] * (count / _STAND_FOR)
        return np.minimum(found[reach:-reach, reach:-reach], 1.0)


_STAND_FOR = 64  # hypotheses
_KEPT: dict[tuple[int, tuple[float, ...] | None], tuple[Found, Floats32]] = {}
_MOST_KEPT, _KEEPING = 256, threading.Lock()


def _kept(belief: TrayBelief, one: Found, margins: tuple[float, ...] | None) -> Floats32:
    """:meth:`TrayBelief.discs`, or :meth:`TrayBelief.hits` without margins, computed once for each found object."""
    key = id(one), margins
    kept = _KEPT.get(key)
    if kept is None or kept[0] is not one:
        kept = one, belief.hits(one) if margins is None else belief.discs(one, margins)
        with _KEEPING:
            while len(_KEPT) >= _MOST_KEPT:
                del _KEPT[next(iter(_KEPT))]
            _KEPT[key] = kept
    return kept[1]


@lru_cache(maxsize=256)
def _disc(radius: int, size: tuple[int, int]) -> NDArray[np.complexfloating]:
    """Spectrum of a disc about the origin of a periodic grid [cells]."""
    along, across = (np.minimum(np.arange(edge), edge - np.arange(edge)) for edge in size)
    return np.asarray(scipy.fft.rfft2(((along[:, None] ** 2 + across**2) < radius**2).astype(np.float32)))


def convolved(places: Floats32, mask: Floats32) -> Floats32:
    """Sum over places of their weight and of a mask ``(2 n + 1, 2 n + 1)`` about each, ``(X, Y)``, at least zero."""
    fft = scipy.fft
    size = [fft.next_fast_len(number + len(mask) - 1, True) for number in places.shape]
    found = fft.irfft2(fft.rfft2(places, size) * fft.rfft2(mask, size), size)
    reach = len(mask) // 2
    return np.maximum(found[reach : reach + places.shape[0], reach : reach + places.shape[1]], 0.0)


def _log_mean(logs: Floats32, weights: Floats32) -> float:
    """Log of the weighted mean of exponentials."""
    highest = float(logs.max(initial=-np.inf, where=weights > 0.0))
    if highest == -np.inf:
        return 0.0
    return float(np.log(weights @ np.exp(np.minimum(logs - highest, 0.0)) / weights.sum())) + highest
