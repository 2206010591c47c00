"""The response of a pad, from at most sixty presses of one ball by hand.

What is read depends on the place of each press, the force, and the response. With the forces known, the area of contact
tells the stiffness, how readings fall off within it the law, and how they end the blur. Places and response are fitted
together by least squares, in which a taxel below the threshold only says that it should be; 90 % intervals follow from
the curvature and the ranges of the description.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from activetouch.pad_file import PadDescription, require_usual
from activetouch.pressing.contact import Pad
from activetouch.rendering.response import Response, respond
from activetouch.solids.triangles import Floats, grid_centres
from belief.columns import read_columns
from belief.errors import ActiveTouchError, InvalidArgument
from belief.frozen import FrozenArrays

MOST_PRESSES = 60
_ARRAYS = ("readings", "forces", "depths")
_FEWEST = 4
_FITTED = ("stiffness", "law", "blur", "crosstalk", "gain")
_STARTS, _REFINED = 12, 3  # responses that a fit starts from, and of these the best that it ends with
_STEPS, _FIRST_STEPS = 40, 6
_PASSES = 3  # of a fit, each with the noise that the one before found, and without taxels that it found dead or odd
_TRIES, _CLOSE = 8, 1e-6  # of a step, and the relative change of the loss that ends a fit
_PRIOR = 12.0  # inverse variance of a share of a range, before anything is known
_SMALL = 1e-2  # change of a parameter for a derivative, in parts of its range
_QUANTILE = 1.645  # of a 90 % interval
_DEPENDENT = 2.0  # factor on standard errors, because the readings of one press share their errors
_FLOORS = {"stiffness": 0.02, "law": 0.01}  # least standard errors: of the logarithm of the stiffness, and of the law
_ODD, _SURE = 0.25, 4.0  # difference of a taxel's gain from 1 that counts, and in its standard errors
_SILENT = -12.0  # log probability of reading nothing in all presses below which a taxel is dead
_SEEN = 3  # presses that a taxel must have felt to be judged
_LEAST_NOISE = 0.002  # of full scale: half a step of 8 bits
_UNMODELLED = 0.02  # part of a reading by which points, triangles and the elastic law may be off
_OUTLIER = 4.0  # standard deviations beyond which a reading counts less
_TOGETHER = 0.9  # correlation beyond which two numbers are not told apart
_WIDE = 0.6  # part of the range that an interval keeps, where nothing was learned


class BadPresses(ActiveTouchError, ValueError):
    """A file holds no presses of a ball."""


@dataclass(frozen=True, eq=False)
class BallPresses(FrozenArrays):
    """Presses of one ball on a pad.

    Attributes:
        radius: of the ball [m].
        readings: of the N taxels ``(n, N)``: parts of full scale, or of any unit for a pad that is relative.
        forces: of each press ``(n,)`` [N]; None where depths are known instead.
        depths: to which the ball was pressed in after the first contact ``(n,)`` [m].

    Raises:
        InvalidArgument: shapes that do not fit, numbers out of range, or neither forces nor depths.
    """

    radius: float
    readings: Floats
    forces: Floats | None = None
    depths: Floats | None = None

    def __post_init__(self) -> None:
        given = [name for name in ("readings", "forces", "depths") if getattr(self, name) is not None]
        try:
            self.to_floats(*given)
        except ValueError as error:
            raise InvalidArgument(f"presses: {error}") from error
        number = len(self.readings)
        if self.readings.ndim != 2 or not _FEWEST <= number <= MOST_PRESSES or not 0.0 < self.radius < 1.0:
            raise InvalidArgument(
                f"a pad is fitted to {_FEWEST} to {MOST_PRESSES} presses of a ball, readings (n, N), got "
                f"{self.readings.shape} of a ball with a radius of {self.radius} m"
            )
        known = [part for part in (self.forces, self.depths) if part is not None]
        if not known or any(part.shape != (number,) or not (part > 0.0).all() for part in known):
            raise InvalidArgument(f"each of the {number} presses needs a force or a depth above 0")
        require_usual("radius_mm", 1e3 * self.radius)
        if self.forces is not None:
            require_usual("force", float(self.forces.max()))
        if self.depths is not None:
            require_usual("depth_mm", float(1e3 * self.depths.max()))
        if (self.readings < 0.0).any() or not self.readings.any(axis=1).all():
            raise InvalidArgument("readings must not be negative, and each press must be felt")
        self.freeze()


def read_presses(path: str | Path, radius: float) -> BallPresses:
    """The presses of a ball of a radius [m] in a file.

    It is CSV, a line of names and a line for each press: ``force`` [N] or ``depth_mm`` or both, then the readings of
    the taxels in their order; or NPZ with the arrays ``readings``, and ``forces`` [N] or ``depths`` [m].

    Raises:
        FileNotFoundError: there is no such file.
        BadPresses: it holds something else.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"there is no file {path}; relative paths start from {Path.cwd()}")
    is_text = path.suffix != ".npz"
    needed = [] if is_text else ["readings"]
    table = read_columns([path], () if is_text else _ARRAYS, BadPresses, needed=needed, is_numeric=is_text)
    found: dict[str, Any] = {}
    if is_text:
        named = dict(zip(table.headings, table.numbers.T, strict=True))
        found = {"forces": named.pop("force", None), "depths": named.pop("depth_mm", None)}
        found["depths"] = None if found["depths"] is None else found["depths"] / 1e3
        found["readings"] = np.stack([*named.values()], axis=1) if named else np.empty((len(table.numbers), 0))
    else:
        found = {name: table.arrays.get(name) for name in _ARRAYS}
    try:
        return BallPresses(radius, **found)
    except InvalidArgument as error:
        raise BadPresses(f"{path} holds no presses of a ball: {error}") from error


@dataclass(frozen=True)
class Interval:
    """What was found of a number of the response: the estimate, and the ends of the 90 % interval."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.value:.3g} [{self.low:.3g}, {self.high:.3g}]"


@dataclass(frozen=True, eq=False)
class PadFit(FrozenArrays):
    """What presses of a ball say of a pad.

    Attributes:
        before: the description that was given.
        numbers: intervals of stiffness, law, blur, crosstalk, gain (unless readings are relative), threshold and noise.
        dead: taxels that read nothing where they should.
        odd: factors on the pressure of taxels that read otherwise than the others, by their number.
        unclear: sentences on what cannot be told apart, or not at all.
        expected: readings of the fit ``(n, N)``, beside the ``read`` ones ``(n, N)``.
        places: where the ball was, along y and z ``(n, 2)`` [m].
    """

    before: PadDescription
    numbers: dict[str, Interval]
    dead: tuple[int, ...]
    odd: dict[int, float]
    unclear: tuple[str, ...]
    expected: Floats
    read: Floats
    places: Floats

    @property
    def description(self) -> PadDescription:
        """The description with the ranges that are left, and the dead and odd taxels as dead."""
        ranges: dict[str, object] = dict(self.before.response.ranges())
        for name, found in self.numbers.items():
            ranges[name] = found.low if found.low == found.high else [found.low, found.high]
        dead = tuple(sorted({*self.before.dead, *self.dead, *self.odd}))
        return replace(self.before, response=Response.of(ranges), dead=dead)

    def _repr_html_(self) -> str:
        """What was found, for a notebook."""
        lines = "\n".join(self.sentences())
        return f"<pre>{escape(lines)}</pre>"

    def sentences(self) -> list[str]:
        """What was found, in words."""
        number, taxels = self.read.shape
        lines = [f"{number} presses on {taxels} taxels; 90 % intervals:"]
        units = {"stiffness": " N/m³", "blur": " pitches"}
        lines += [f"  {name:<10} {found}{units.get(name, '')}" for name, found in self.numbers.items()]
        if self.dead:
            lines.append(f"dead taxels: {', '.join(map(str, self.dead))}")
        if self.odd:
            told = ", ".join(f"{taxel} (× {factor:.2f})" for taxel, factor in self.odd.items())
            lines.append(f"odd taxels, left out like dead ones: {told}")
        return [*lines, *self.unclear]


def fit_pad(pad: PadDescription, presses: BallPresses) -> PadFit:
    """The response of a pad from presses of a ball.

    Args:
        pad: its description, whose ranges have the truth inside.
        presses: of the ball, at different places and with different forces, each with the ball alone on the pad.

    Raises:
        InvalidArgument: the presses have another number of taxels, or readings above full scale.
    """
    if presses.readings.shape[1] != len(pad.taxels):
        raise InvalidArgument(f"the pad has {len(pad.taxels)} taxels, the presses have {presses.readings.shape[1]}")
    largest = presses.readings.max(axis=1, keepdims=True)
    if not pad.is_relative and largest.max() > 1.0:
        raise InvalidArgument(f"readings must be at most 1, full scale, got {largest.max():g}")
    low, high = pad.response.noise.support
    read = presses.readings / largest if pad.is_relative else presses.readings
    problem = _Problem(pad, presses, read, max((low + high) / 2, _LEAST_NOISE))
    is_used = ~np.isin(np.arange(len(pad.taxels)), pad.dead)
    found, dead = problem.solved(is_used), tuple[int, ...]()
    odd: dict[int, float] = {}
    for _ in range(_PASSES):
        dead, odd = problem.judged(found)
        is_now = is_used & ~np.isin(np.arange(len(is_used)), [*dead, *odd])
        if is_now.sum() < _SEEN:
            break
        problem = replace(problem, noise=found.noise)
        found = problem.descended(found.numbers, found.local, is_now, _STEPS)
    return problem.fit(found, tuple(dead), odd)


@dataclass(frozen=True, eq=False)
class _Solution:
    """Shares of the ranges ``(m,)``, local parameters ``(n, l)``, noise, and the covariance of the shares."""

    numbers: Floats
    local: Floats
    noise: float
    loss: float
    covariance: Floats
    is_used: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class _Problem:
    """Least squares over shares of the ranges, and for each press its place [pitches] and, if relative, its scale."""

    pad: PadDescription
    presses: BallPresses
    read: Floats
    noise: float

    @property
    def names(self) -> list[str]:
        """Numbers that are fitted."""
        ranges = self.pad.response.ranges()
        known = [name for name in _FITTED if ranges[name][0] < ranges[name][1]]
        return [name for name in known if not (name == "gain" and self.pad.is_relative)]

    @property
    def threshold(self) -> float:
        """The least reading, within its range."""
        low, high = self.pad.response.threshold.support
        felt = self.read[self.read > 0.0]
        return float(np.clip(felt.min(), low, high))

    def expected(self, shares: Floats, local: Floats) -> Floats:
        """Readings before noise and threshold, ``(n, N)``."""
        pad, taxels = self.pad, self.pad.taxels
        at = np.full((1, 7), 0.5)
        at[0, [list(pad.response.ranges()).index(name) for name in self.names]] = np.clip(shares, 0.0, 1.0)
        numbers = pad.response.at(at)
        square = replace(pad.pad, stiffness=float(numbers["stiffness"][0]))
        pressure = _ball_pressures(square, self.presses, local[:, :2] * taxels.pitch)
        felt = taxels.mean(pressure) * taxels.normals[:, 0] / pad.full_scale
        given = {name: np.full(len(felt), numbers[name][0]) for name in ("law", "blur", "crosstalk", "gain")}
        still = given | {"threshold": np.zeros(len(felt)), "noise": np.zeros(len(felt))}
        found = respond(taxels, felt, still, np.random.default_rng(0), pad.is_relative)
        return np.asarray(found * np.exp(local[:, 2:]) if pad.is_relative else found)

    def residuals(self, expected: Floats, is_used: NDArray[np.bool_]) -> Floats:
        """Differences of readings ``(n, N)``; their squares are log probabilities, also of reading nothing."""
        below = log_ndtr((self.threshold - expected) / self.noise)
        differs = np.where(self.read > 0.0, self.read - expected, -self.noise * np.sqrt(-2.0 * below))
        full = self.read >= 1.0 - 1e-9
        if not self.pad.is_relative:
            differs = np.where(full, np.maximum(differs, 0.0), differs)
        return np.asarray(differs * is_used)

    def start(self) -> Floats:
        """Places at the centroids of the readings, ``(n, l)``."""
        weights = self.read / self.read.sum(axis=1, keepdims=True)
        places = weights @ self.pad.taxels.centres[:, 1:] / self.pad.taxels.pitch
        return np.hstack([places, np.zeros((len(places), 1))]) if self.pad.is_relative else places

    def solved(self, is_used: NDArray[np.bool_]) -> _Solution:
        """The best of several starts."""
        if not self.names:
            return self.descended(np.zeros(0), self.start(), is_used, _STEPS)
        spread = self.pad.response.spread(_STARTS)
        shares = np.stack([self._share(name, spread[name]) for name in self.names], axis=1)
        first = [self.descended(one, self.start(), is_used, _FIRST_STEPS) for one in shares]
        best = sorted(first, key=lambda one: one.loss)[:_REFINED]
        return min((self.descended(one.numbers, one.local, is_used, _STEPS) for one in best), key=lambda one: one.loss)

    def _share(self, name: str, values: Floats) -> Floats:
        low, high = self.pad.response.ranges()[name]
        if name in ("stiffness", "gain"):
            return np.asarray(np.log(values / low) / math.log(high / low))
        return np.asarray((values - low) / (high - low))

    def descended(self, shares: Floats, local: Floats, is_used: NDArray[np.bool_], steps: int) -> _Solution:
        """Levenberg-Marquardt, in which the presses share only the numbers of the response."""
        damping, differs = 1e-2, self.residuals(self.expected(shares, local), is_used)
        loss = self._loss(differs, shares)
        for _ in range(steps):
            a, b, c, right, own = self._normal(shares, local, differs, is_used, self.noise)
            for _ in range(_TRIES):
                inverse = np.linalg.inv(c * (1.0 + damping * np.eye(local.shape[1])))
                schur = a * (1.0 + damping * np.eye(len(shares))) - np.einsum("npl,nlk,nqk->pq", b, inverse, b)
                step = np.linalg.solve(schur, right - np.einsum("npl,nlk,nk->p", b, inverse, own))
                moved = np.einsum("nlk,nk->nl", inverse, own - np.einsum("npl,p->nl", b, step))
                if not (np.isfinite(step).all() and np.isfinite(moved).all()):
                    damping *= 4.0
                    continue
                to, there = np.clip(shares + step, 0.0, 1.0), local + np.clip(moved, -1.0, 1.0)
                other = self.residuals(self.expected(to, there), is_used)
                if (reached := self._loss(other, to)) < loss:
                    break
                damping *= 4.0
            else:
                break
            is_done = loss - reached < _CLOSE * loss
            shares, local, differs, loss, damping = to, there, other, reached, max(damping / 6.0, 1e-9)
            if is_done:
                break
        sigma = self._noise(differs)
        a, b, c, *_ = self._normal(shares, local, differs, is_used, max(sigma, self.noise))
        covariance = np.linalg.inv(a - np.einsum("npl,nlk,nqk->pq", b, np.linalg.inv(c), b))
        return _Solution(shares, local, sigma, loss, covariance, is_used)

    def _normal(
        self, shares: Floats, local: Floats, differs: Floats, is_used: NDArray[np.bool_], sigma: float
    ) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Of the normal equations: the blocks of the shares, of both, and of each press, and both right-hand sides."""
        of_shares, of_local = self._derivatives(shares, local, is_used)
        spread = self._spread(sigma)
        weights = 1.0 / (1.0 + (differs / (_OUTLIER * spread)) ** 2) / spread**2
        a = np.einsum("ntp,nt,ntq->pq", of_shares, weights, of_shares) + _PRIOR * np.eye(len(shares))
        b = np.einsum("ntp,nt,ntl->npl", of_shares, weights, of_local)
        c = np.einsum("ntk,nt,ntl->nkl", of_local, weights, of_local) + 1e-2 * np.eye(local.shape[1])
        right = np.einsum("ntp,nt,nt->p", of_shares, weights, -differs) - _PRIOR * (shares - 0.5)
        return a, b, c, right, np.einsum("ntl,nt,nt->nl", of_local, weights, -differs)

    def _loss(self, differs: Floats, shares: Floats) -> float:
        """Robust squares, in which outliers count less; the same noise for all, so that losses compare."""
        robust = _OUTLIER**2 * np.log1p((differs / (_OUTLIER * self._spread(self.noise))) ** 2)
        return float(robust.sum() + _PRIOR * ((shares - 0.5) ** 2).sum())

    def _spread(self, sigma: float) -> Floats:
        """Standard deviations of the differences ``(n, N)``."""
        return np.asarray(np.hypot(sigma, _UNMODELLED * self.read))

    def _noise(self, differs: Floats) -> float:
        """Standard deviation of the readings, from those that count, robustly."""
        counted = np.abs(differs[(self.read > 0.0) & (differs != 0.0)])
        if not counted.size:
            return _LEAST_NOISE
        spent = 1.0 - min(0.5, (len(self.names) + self.start().size) / counted.size)
        return max(float(np.quantile(counted, 0.683)) / math.sqrt(spent), _LEAST_NOISE)

    def _derivatives(self, shares: Floats, local: Floats, is_used: NDArray[np.bool_]) -> tuple[Floats, Floats]:
        """Of the residuals by the shares ``(n, N, m)`` and by the local parameters ``(n, N, l)``."""

        def derivative(change: Callable[[float], Floats]) -> Floats:
            return (change(_SMALL) - change(-_SMALL)) / (2 * _SMALL)

        def at(change: Floats, moved: Floats) -> Floats:
            return self.residuals(self.expected(shares + change, local + moved), is_used)

        still, zero = np.zeros_like(local), np.zeros_like(shares)
        of_shares = [derivative(lambda d, one=one: at(d * one, still)) for one in np.eye(len(shares))]  # type: ignore[misc]
        of_local = [derivative(lambda d, one=one: at(zero, still + d * one)) for one in np.eye(local.shape[1])]  # type: ignore[misc]
        empty = np.zeros((*self.read.shape, 0))
        return np.stack(of_shares, axis=2) if of_shares else empty, np.stack(of_local, axis=2)

    def judged(self, found: _Solution) -> tuple[tuple[int, ...], dict[int, float]]:
        """Taxels that read nothing where they should, and factors of those that read otherwise than the others."""
        expected, law = self.expected(found.numbers, found.local), 1.0
        if "law" in self.names:
            low, high = self.pad.response.law.support
            law = low + (high - low) * found.numbers[self.names.index("law")]
        dead, odd = [], {}
        silent = log_ndtr((self.threshold - expected) / np.hypot(found.noise, _UNMODELLED * expected)).sum(axis=0)
        for taxel in np.flatnonzero(~np.isin(np.arange(expected.shape[1]), self.pad.dead)).tolist():
            rows = expected[:, taxel] > self.threshold + _SURE * found.noise
            should, reads = expected[rows, taxel], self.read[rows, taxel]
            if not self.read[:, taxel].any():
                if silent[taxel] < _SILENT:
                    dead.append(taxel)
                continue
            if rows.sum() < _SEEN:
                continue
            factor = float((should @ reads) / (should @ should))
            error = float(max(np.std(reads - factor * should), found.noise) / math.sqrt(should @ should))
            if abs(factor ** (1.0 / law) - 1.0) > _ODD and abs(factor - 1.0) > _SURE * error:
                odd[taxel] = round(factor ** (1.0 / law), 3)
        return tuple(dead), odd

    def _floor(self, name: str) -> float:
        """Least standard error of a number, as a share of its range."""
        low, high = self.pad.response.ranges()[name]
        return _FLOORS.get(name, 0.0) / (math.log(high / low) if name == "stiffness" else high - low)

    def fit(self, found: _Solution, dead: tuple[int, ...], odd: dict[int, float]) -> PadFit:
        """The result in the units of the description."""
        numbers, unclear, ranges = {}, [], self.pad.response.ranges()
        plain = np.sqrt(np.diag(found.covariance))
        errors = np.hypot(_DEPENDENT * plain, [self._floor(name) for name in self.names])
        for place, (name, share, error) in enumerate(zip(self.names, found.numbers, errors, strict=True)):
            ends = np.clip([share, share - _QUANTILE * error, share + _QUANTILE * error], 0.0, 1.0)
            at = np.full((3, 7), 0.5)
            at[:, list(ranges).index(name)] = ends
            numbers[name] = Interval(*self.pad.response.at(at)[name].tolist())
            if ends[2] - ends[1] > _WIDE:
                unclear.append(f"{name}: these presses say almost nothing of it")
            for other in range(place):
                both = found.covariance[place, other] / (plain[place] * plain[other])
                if abs(both) > _TOGETHER:
                    unclear.append(
                        f"{self.names[other]} and {name} are not told apart (correlation {both:+.2f}): presses with "
                        "more different forces, or a smaller ball, help"
                    )
        low, high = ranges["threshold"]
        if low < high:
            numbers["threshold"] = Interval(self.threshold, max(low, self.threshold - 4 * found.noise), self.threshold)
        low, high = ranges["noise"]
        if low < high:
            value, wide = float(np.clip(found.noise, low, high)), (0.7 * found.noise, 1.4 * found.noise)
            numbers["noise"] = Interval(value, *np.clip(wide, low, high).tolist())
        if self.presses.forces is None:
            unclear.append("stiffness: without forces, depths tell it only together with the gain")
        expected = self.expected(found.numbers, found.local)
        places = found.local[:, :2] * self.pad.taxels.pitch
        shown = np.where(expected > self.threshold, expected, 0.0)
        return PadFit(self.pad, numbers, dead, odd, tuple(unclear), shown, self.read, places)


def _ball_pressures(pad: Pad, presses: BallPresses, places: Floats) -> Floats:
    """Pressures at the points of a pad under a ball at places ``(n, 2)`` [m], ``(n, m, m)`` [Pa]."""
    points, radius = grid_centres(pad.num_taxels, pad.num_taxels, 2 * pad.half_width / pad.num_taxels), presses.radius
    away = ((points[1:, None] - places.T[:, :, None]) ** 2).sum(axis=0)
    gap = np.where(away < radius**2, radius - np.sqrt(np.maximum(radius**2 - away, 0.0)), np.inf)
    if pad.face is not None:
        gap = gap - pad.face.ravel()
    gap -= np.where(np.isfinite(least := gap.min(axis=1, keepdims=True)), least, 0.0)
    if presses.forces is not None:
        depths = np.array([pad.indentation(*one) for one in zip(gap, presses.forces.tolist(), strict=True)])
    else:
        assert presses.depths is not None, "checked in the constructor"
        depths = np.minimum(presses.depths, pad.max_depth)
    found = pad.stiffness * np.maximum(depths[:, None] - gap, 0.0)
    return np.asarray(found.reshape(len(places), pad.num_taxels, pad.num_taxels))
