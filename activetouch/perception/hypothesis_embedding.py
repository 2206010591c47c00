"""The embedding g(shape, rotation, size) of hypotheses, in numpy: a residual network."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.distributions import Bodies
from activetouch.perception.card import PRODUCTS, ClassifierCard
from activetouch.poses import to_matrices, turned
from activetouch.scene import Scene

Floats32 = NDArray[np.float32]
_AT_ONCE = 4096  # hypotheses
_CACHED = 1 << 15  # numbers of an array that stay in the cache
_ERFC = tuple(np.float32(c) for c in (1.061405429, -1.453152027, 1.421413741, -0.284496736, 0.254829592))
_IMAGES = 64  # images whose logits are computed at a time
_LAYER, _ROTATIONS, _SIZES = "hypothesis", "hypotheses.rotations", "hypotheses.sizes"
_PARTS = ("weight", "bias")


@dataclass(frozen=True, eq=False)
class HypothesisEmbedding:
    """The network g, and the fixed hypotheses over which shape logits are averaged.

    ``layers`` are weights ``(out, in)`` and biases ``(out,)``. The first reads the one-hot shape, the nine entries of
    the rotation matrix row by row, the standardised log size, and the products of two entries of the matrix. GELU
    follows every layer but the last. Hidden layers but the first read normalised numbers, and add to them. The fixed
    hypotheses, the same for every shape, have ``rotations (M, 3, 3)`` and ``sizes (M,)``.
    """

    card: ClassifierCard
    layers: tuple[tuple[Floats32, Floats32], ...]
    rotations: Floats32
    sizes: Floats32

    def __post_init__(self) -> None:
        card, number = self.card, len(self.sizes)
        shapes = [weight.shape for weight, _ in self.layers]
        widths = [card.num_inputs, *(len(bias) for _, bias in self.layers)]
        fits = shapes == [(width, before) for before, width in pairwise(widths)] and widths[-1] == card.embedding
        fits = fits and len(set(widths[1:-1])) == 1  # hidden layers add to each other
        fits = fits and self.rotations.shape == (number, 3, 3) and number > 0 and bool((self.sizes > 0).all())
        if not fits:
            raise ValueError(
                f"the network of hypotheses must lead from {card.num_inputs} to {card.embedding} numbers by hidden "
                f"layers of one width, and the fixed hypotheses have positive sizes (M,) and rotations (M, 3, 3); "
                f"got layers {shapes}, {number} sizes and rotations {self.rotations.shape}"
            )

    def embed(self, shapes: NDArray[np.int64], rotations: NDArray[Any], sizes: NDArray[Any]) -> Floats32:
        """Embeddings ``(H, D)`` of shapes ``(H,)``, rotations from object to pad ``(H, 3, 3)`` and sizes ``(H,)``."""
        number, num_shapes = len(shapes), len(self.card.shape_labels)
        standard = ((np.log(sizes) - self.card.log_size_mean) / self.card.log_size_std)[:, None]
        found = np.empty((number, self.card.embedding), np.float32)
        for first in range(0, number, _AT_ONCE):
            some = slice(first, first + _AT_ONCE)
            kind = np.eye(num_shapes, dtype=np.float32)[shapes[some]]
            turns = rotations[some].reshape(-1, 9).astype(np.float32)
            products = turns[:, PRODUCTS[0]] * turns[:, PRODUCTS[1]]
            hidden = np.concatenate([kind, turns, standard[some], products], axis=1, dtype=np.float32)
            (weight, bias), *middle = self.layers[:-1]
            hidden = _gelu(hidden @ weight.T + bias)
            for weight, bias in middle:
                hidden += _gelu(_normalised(hidden) @ weight.T + bias)
            weight, bias = self.layers[-1]
            found[some] = hidden @ weight.T + bias
        return found

    def bound_to(self, scene: Scene) -> HypothesisEmbedding:
        """Itself: it knows the shapes of its training, whatever the scene."""
        return self

    def embedded(self, scene: Scene, bodies: Bodies, pose: int) -> Floats32:
        """See :class:`activetouch.perception.contacts.hypotheses.Hypotheses`."""
        rotation = scene.rotations[scene.pose_labels[pose]]
        found = self._of_every_shape(to_matrices(turned(rotation, bodies.rests)), bodies.sizes)
        return found.reshape(len(scene.shapes), len(bodies.rests), -1)

    def _of_every_shape(self, rotations: NDArray[Any], sizes: NDArray[Any]) -> Floats32:
        """Embeddings of N orientations and sizes, shape after shape, ``(K · N, D)``."""
        num_shapes, number = len(self.card.shape_labels), len(sizes)
        shapes = np.repeat(np.arange(num_shapes), number)
        return self.embed(shapes, np.tile(rotations, (num_shapes, 1, 1)), np.tile(sizes, num_shapes))

    @cached_property
    def _fixed(self) -> Floats32:
        return self._of_every_shape(self.rotations, self.sizes)

    def shape_logits(self, embeddings: Floats32) -> NDArray[np.float64]:
        """See :class:`activetouch.perception.contacts.hypotheses.Hypotheses`; the mean is over the fixed hypotheses."""
        fixed, num_shapes, number = self._fixed.T, len(self.card.shape_labels), len(self.sizes)
        logits = np.empty((len(embeddings), num_shapes))
        for first in range(0, len(embeddings), _IMAGES):
            some = slice(first, first + _IMAGES)
            logits[some] = _logsumexp((embeddings[some] @ fixed).reshape(-1, num_shapes, number))
        logits -= np.log(number)
        return logits

    def tensors(self) -> dict[str, NDArray[Any]]:
        """The arrays by name, as a file has them: layers in half precision."""
        found: dict[str, NDArray[Any]] = {_ROTATIONS: self.rotations, _SIZES: self.sizes}
        for number, layer in enumerate(self.layers):
            found |= {f"{_LAYER}.{number}.{name}": p.astype(np.float16) for name, p in zip(_PARTS, layer, strict=True)}
        return found

    @classmethod
    def from_tensors(cls, card: ClassifierCard, tensors: Mapping[str, NDArray[Any]]) -> HypothesisEmbedding:
        """The network from :meth:`tensors`."""
        number = sum(name.startswith(f"{_LAYER}.") for name in tensors) // 2
        parts = [[tensors[f"{_LAYER}.{n}.{part}"].astype(np.float32) for n in range(number)] for part in _PARTS]
        return cls(card, tuple(zip(*parts, strict=True)), tensors[_ROTATIONS], tensors[_SIZES])


def _normalised(x: Floats32) -> Floats32:
    """Rows with mean 0 and variance 1, as torch's layer normalisation makes them."""
    centred = x - x.mean(axis=1, keepdims=True)
    variances = np.einsum("ij,ij->i", centred, centred) / np.float32(x.shape[1])
    centred /= np.sqrt(variances + np.float32(1e-5))[:, None]
    return centred


def _logsumexp(scores: Floats32) -> Floats32:
    """Log of the sum of exponentials along the last axis of finite scores ``(N, K, M)``, which are overwritten."""
    highest = scores.max(axis=2)
    scores -= highest[:, :, None]
    np.exp(scores, out=scores)
    return np.log(scores.sum(axis=2)) + highest


def _gelu(x: Floats32) -> Floats32:
    """GELU, x Φ(x), to 2e-7 |x| (Abramowitz & Stegun 1964, 7.1.26), three times faster than by scipy's ``erf``."""
    found, blocks = np.empty_like(x), -(-x.size // _CACHED)
    for rows, out in zip(np.array_split(x, blocks), np.array_split(found, blocks), strict=True):
        t = np.abs(rows)
        t *= np.float32(0.3275911 * np.sqrt(0.5))
        t += np.float32(1.0)
        np.reciprocal(t, out=t)
        np.multiply(t, _ERFC[0], out=out)
        for coefficient in _ERFC[1:]:
            out += coefficient
            out *= t
        with np.errstate(over="ignore"):
            out *= np.exp(np.square(rows) * np.float32(-0.5))  # twice the probability beyond |x|
        out *= rows * np.float32(0.5)
        np.copysign(out, np.float32(-1.0), out=out)
        out += np.maximum(rows, np.float32(0.0))
    return found
