"""Objectives of the training: to tell shapes apart, or whole hypotheses by contrast."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor, nn

from activetouch.data.dataset import TouchSet
from activetouch.perception.classifier import Hypotheses, TouchNetwork, compose
from activetouch.perception.learner import mixed_precision
from activetouch.perception.recipe import TrainingRecipe
from belief.naming import index_of

_CHECKED = 4096
"""Number of hypotheses in the evaluation on the calibration split."""
_FOCUS = 4.0
"""Factor by which shapes in the recipe's focus are drawn more often than others."""


class ShapeObjective:
    """Cross-entropy of the shape, where the recipe may weight rare shapes up."""

    def __init__(self, train: TouchSet, labels: tuple[str, ...], recipe: TrainingRecipe) -> None:
        counts = np.bincount(train.shapes, minlength=len(labels))
        if (counts == 0).any():
            absent = [label for label, n in zip(labels, counts, strict=True) if n == 0]
            raise ValueError(f"there is no image of {', '.join(absent)} to learn from")
        weights = counts.sum() / (len(counts) * counts) if recipe.class_weights else np.ones(len(counts))
        self.class_weights = torch.tensor(weights, dtype=torch.float32)
        self._shapes = torch.from_numpy(train.shapes)
        self._bf16, self._batch_size = recipe.bf16, recipe.batch_size

    def batches(self, chance: torch.Generator) -> list[Tensor]:
        """Rows of the training split for each step of an epoch, in random order."""
        return sorted_batches(torch.randperm(len(self._shapes), generator=chance), self._batch_size)

    def loss(
        self, network: TouchNetwork, images: Tensor, rows: Tensor, turns: Tensor, chance: torch.Generator
    ) -> Tensor:
        """Mean loss [nats] of augmented images ``(B, H, W[, 3])`` of ``rows (B,)``, turned by ``turns (B,)`` [rad]."""
        with mixed_precision(self._bf16):
            logits, _ = network(images)
        return nn.functional.cross_entropy(logits.float(), self._shapes[rows], weight=self.class_weights)

    def evaluate(self, network: TouchNetwork, touches: TouchSet) -> tuple[float, float]:
        """Mean loss [nats] and accuracy on touches of other objects."""
        logits, labels = embeddings(network, touches, self._bf16), torch.from_numpy(touches.shapes)
        return nn.functional.cross_entropy(logits, labels).item(), (logits.argmax(1) == labels).float().mean().item()


class Contrast:
    """The negative log probability of a touch's own hypothesis among others, plus that of its shape.

    The first term is InfoNCE (van den Oord et al. 2018). The other hypotheses are those of the batch's other touches
    and draws from the prior: each shape equally often; orientation and size each from a random training touch. The
    minimiser over all functions is log p(o | k, R, s) / p(o) up to a constant of the image (Gutmann & Hyvärinen 2010;
    Durkan et al. 2020). The second term, the cross-entropy of the shape, whose likelihood is the mean over its draws,
    has the same minimiser, and spends the network's capacity on what the belief needs. Shapes in the recipe's focus are
    drawn more often, as touches and as hypotheses; this changes p(o) only.
    """

    def __init__(self, train: TouchSet, labels: tuple[str, ...], recipe: TrainingRecipe) -> None:
        self._known, self._num_shapes, self._recipe = hypotheses_of(train), len(labels), recipe
        in_focus = [index_of("shape", labels, label) for label in recipe.focus]
        self._frequencies = torch.ones(len(labels))
        self._frequencies[in_focus] = _FOCUS
        self._log_prior = torch.log(self._frequencies / self._frequencies.mean())
        self._drawn_shapes = self._in_proportion(recipe.negatives)

    def batches(self, chance: torch.Generator) -> list[Tensor]:
        """As of :class:`ShapeObjective`; touches are drawn anew for every epoch where the recipe has a focus."""
        shapes = self._known.shapes
        if self._recipe.focus:
            rows = torch.multinomial(self._frequencies[shapes], len(shapes), replacement=True, generator=chance)
        else:
            rows = torch.randperm(len(shapes), generator=chance)
        return sorted_batches(rows, self._recipe.batch_size)

    def _in_proportion(self, number: int) -> Tensor:
        """Shapes of hypotheses, each as often as it is drawn and at least once, ``(number,)``."""
        if not self._recipe.focus:
            return every_shape(number, self._num_shapes)
        bounds = self._frequencies.cumsum(0)
        number = max(number, math.ceil(float(bounds[-1])))
        return torch.bucketize((torch.arange(number) + 0.5) / number * bounds[-1], bounds)

    def loss(
        self, network: TouchNetwork, images: Tensor, rows: Tensor, turns: Tensor, chance: torch.Generator
    ) -> Tensor:
        """As of :class:`ShapeObjective`."""
        with mixed_precision(self._recipe.bf16):
            found, _ = network(images)
        own = turned(self._known.select(rows), turns)
        if self._recipe.cell:
            own = own._replace(orientations=jittered(own.orientations, math.radians(self._recipe.cell), chance))
        others = drawn(self._known, self._drawn_shapes, chance)
        scores = found.float() @ network.hypotheses(own.join(others)).T
        contrast = (torch.logsumexp(scores, dim=1) - scores.diagonal()).mean() - math.log(scores.shape[1])
        logits = shape_logits(scores[:, len(rows) :], others.shapes, self._num_shapes)
        return contrast + nn.functional.cross_entropy(logits + self._log_prior, own.shapes)

    def evaluate(self, network: TouchNetwork, touches: TouchSet) -> tuple[float, float]:
        """As of :class:`ShapeObjective`: among the touch's own hypothesis and 4 096 others, the same for all."""
        found, own = embeddings(network, touches, self._recipe.bf16), hypotheses_of(touches)
        others = drawn(self._known, every_shape(_CHECKED, self._num_shapes), torch.Generator().manual_seed(0))
        loss = correct = 0.0
        with torch.inference_mode():
            known, others_embedded = network.hypotheses(own), network.hypotheses(others)
            for some in torch.arange(len(found)).split(256):
                true = (found[some] * known[some]).sum(dim=1, keepdim=True)
                scores = found[some] @ others_embedded.T
                total = torch.logsumexp(torch.cat([scores, true], dim=1), dim=1, keepdim=True) - math.log(_CHECKED + 1)
                logits, shapes = shape_logits(scores, others.shapes, self._num_shapes), own.shapes[some]
                loss += (total - true).sum().item()
                loss += nn.functional.cross_entropy(logits, shapes, reduction="sum").item()
                correct += (logits.argmax(1) == shapes).sum().item()
        return loss / len(found), correct / len(found)


def sorted_batches(rows: Tensor, size: int) -> list[Tensor]:
    """Rows in batches, sorted in each, so that images are gathered faster."""
    return [some.sort().values for some in rows.split(size)]


def every_shape(number: int, num_shapes: int) -> Tensor:
    """Shapes of hypotheses, each in turn, ``(number,)``; every shape at least once."""
    return torch.arange(max(number, num_shapes)) % num_shapes


def drawn(known: Hypotheses, shapes: Tensor, chance: torch.Generator) -> Hypotheses:
    """Draws from the prior of these shapes; orientation and size are each those of a known one."""
    rows = torch.randint(len(known.shapes), (2, len(shapes)), generator=chance)
    return Hypotheses(shapes, known.orientations[rows[0]], known.sizes[rows[1]])


def shape_logits(scores: Tensor, shapes: Tensor, num_shapes: int) -> Tensor:
    """Log of the mean ratio over each shape's hypotheses, ``(B, K)``; scores ``(B, H)``; shapes ``(H,)``, all K."""
    of_shape = [scores[:, shapes == shape] for shape in range(num_shapes)]
    return torch.stack([torch.logsumexp(some, dim=1) - math.log(some.shape[1]) for some in of_shape], dim=1)


def embeddings(network: TouchNetwork, touches: TouchSet, bf16: bool) -> Tensor:
    """Embeddings of the images of touches, ``(N, D)``."""
    network.eval()
    with torch.inference_mode(), mixed_precision(bf16):
        parts = [network(torch.from_numpy(touches.images[i : i + 256]))[0] for i in range(0, len(touches.images), 256)]
    return torch.cat(parts).float()


def hypotheses_of(touches: TouchSet) -> Hypotheses:
    """The true hypothesis of every touch."""
    if not (np.isfinite(touches.orientations).all() and np.isfinite(touches.sizes).all()):
        raise ValueError("these touches do not say in which orientation and of which size the objects were")
    columns = (touches.orientations, touches.sizes)
    return Hypotheses(torch.from_numpy(touches.shapes), *(torch.from_numpy(column).float() for column in columns))


def turned(hypotheses: Hypotheses, angles: Tensor) -> Hypotheses:
    """Hypotheses after a turn of the object about the approach axis, x, by an angle each [rad]."""
    turn = torch.zeros(len(angles), 4)
    turn[:, 0], turn[:, 1] = torch.cos(angles / 2), torch.sin(angles / 2)
    return hypotheses._replace(orientations=compose(turn, hypotheses.orientations))


def jittered(orientations: Tensor, spread: float, chance: torch.Generator) -> Tensor:
    """Orientations ``(H, 4)`` after small random rotations, of standard deviation ``spread`` about each axis [rad]."""
    small = torch.randn(len(orientations), 3, generator=chance) * (spread / 2)
    step = torch.cat([torch.ones(len(small), 1), small], dim=1)
    return compose(step / step.norm(dim=1, keepdim=True), orientations)
