"""Learning from several touches of one object: the posterior of its body after all of them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from activetouch.data.dataset import TouchSet
from activetouch.perception.classifier import TouchNetwork
from activetouch.perception.hypothesis_network import Hypotheses, compose
from activetouch.perception.objective import drawn, embeddings, every_shape, hypotheses_of, jittered, turned
from activetouch.perception.recipe import TrainingRecipe

_TABLE = 2048
"""Random bodies of each shape, among which those are found that touches can be confused with."""
_CONFUSED = 24
"""Bodies drawn from the posterior of every sequence of touches, for each number of touches."""
_SHARPNESS = 0.7
"""Power of the posterior that they are drawn from: below 1, so that unlikely ones are learned from, too."""
_REFRESH = 25
"""Steps after which the table is drawn and embedded anew."""
_AT_ONCE = 8192  # hypotheses


class FusedPosterior:
    r"""The negative log posterior of an object's body after 1 to T touches in different poses.

    The log ratios f · g of the touches of one body add up, and the mean of their exponential over the prior normalises
    the posterior. It is estimated from random bodies and from bodies drawn from the posterior itself, which a table of
    random bodies gives. Every body has the weight of the balance heuristic (Veach & Guibas 1995), so that the estimate
    is consistent. Random bodies alone are hardly ever among those that a sequence of touches can be confused with.

    The true body is turned by one small random rotation for all its touches if the recipe has cells. The sum of the log
    ratios then learns the average over a cell of the product over the touches. Cells in single touches
    (:class:`~activetouch.perception.objective.Contrast`) give the product of averages: the posterior where every touch
    is turned by another small rotation (:class:`activetouch.orientations.Inexact`), which is sharper.

    Args:
        train: what is learned from: objects with known orientations and sizes, each touched in every pose.
        num_shapes: how many shapes there are.
        recipe: of the training; ``batch_size`` counts touches.

    Raises:
        ValueError: an orientation or size is not known, an object lacks a pose, poses are not the same rotations for
            all objects, or there are fewer poses than touches of a sequence.
    """

    def __init__(self, train: TouchSet, num_shapes: int, recipe: TrainingRecipe) -> None:
        self._objects, self._num_shapes, self._recipe = _Objects.of(train), num_shapes, recipe
        if recipe.touches > self._objects.num_poses:
            raise ValueError(
                f"sequences of {recipe.touches} touches need as many poses, there are {self._objects.num_poses}"
            )
        self._steps = 0

    def batches(self, chance: torch.Generator) -> list[Tensor]:
        """Rows of the training split for each step of an epoch: T touches of an object, then those of the next.

        All objects of a step are touched in the same poses. An epoch has about as many touches as the split.
        """
        touches, rows = self._recipe.touches, self._objects.rows
        size = max(1, self._recipe.batch_size // touches)
        found = []
        for _ in range(max(1, self._objects.num_poses // touches)):
            for objects in torch.randperm(len(rows), generator=chance).split(size):
                poses = torch.randperm(self._objects.num_poses, generator=chance)[:touches]
                found.append(rows[objects][:, poses].flatten())
        self._steps = 0  # an epoch that is run again after an interruption must draw the same tables
        return found

    def loss(
        self, network: TouchNetwork, images: Tensor, rows: Tensor, turns: Tensor, chance: torch.Generator
    ) -> Tensor:
        """See :class:`~activetouch.perception.objective.Objective`."""
        touches, recipe = self._recipe.touches, self._recipe
        known = self._objects
        poses, objects = known.poses[rows[:touches]], known.of_row[rows[::touches]]
        if self._steps % _REFRESH == 0:
            self._table = self._random(known.bodies, chance)
            self._embedded = embedded(network, self._table, known.turns, known.aims)
        self._steps += 1
        picked, chances = self._confused(network, images, turns, poses, chance)  # (T, B, C), (T, B, M)
        own = known.bodies.select(objects)
        if recipe.cell:
            own = own._replace(orientations=jittered(own.orientations, math.radians(recipe.cell), chance))
        random = torch.randint(len(self._table.shapes), (recipe.negatives,), generator=chance)
        bodies = own.join(self._table.select(random), self._table.select(picked.flatten()))
        with torch.autocast("cpu", torch.bfloat16, enabled=recipe.bf16):
            found, _ = network(images)
        found = found.float().unflatten(0, (-1, touches)).swapaxes(0, 1)  # (T, B, D)
        angles = turns[:1].expand(len(bodies.shapes))
        first, *views = (turned(in_pose(bodies, known.turns[pose], known.aims[pose]), angles) for pose in poses)
        hypotheses = network.hypotheses(first.join(*views)).unflatten(0, (touches, -1))  # (T, bodies, D)
        true, others, confused = hypotheses.split([len(objects), len(random), picked.numel()], dim=1)
        confused = confused.unflatten(1, picked.shape)  # (T, T, B, C, D)
        scores = (found * true).sum(dim=2).cumsum(0)  # after 1 to T touches, (T, B)
        of_others = torch.einsum("tbd,tmd->tbm", found, others).cumsum(0)
        of_confused = torch.einsum("tbd,tnbcd->ntbc", found, confused).cumsum(1)
        loss = torch.zeros(())
        for n in range(touches):
            compared = torch.cat([of_others[n], of_confused[n, n]], dim=1)
            share = torch.cat([chances[n][:, random], chances[n].gather(1, picked[n])], dim=1)
            weights = -torch.log(len(random) + _CONFUSED * len(self._table.shapes) * share)
            loss = loss + (torch.logsumexp(compared + weights, dim=1) - scores[n]).mean() / touches
        return loss

    def _random(self, known: Hypotheses, chance: torch.Generator) -> Hypotheses:
        """A table of random bodies, as many of each shape."""
        return drawn(known, every_shape(_TABLE * self._num_shapes, self._num_shapes), chance)

    @torch.no_grad()
    def _confused(
        self, network: TouchNetwork, images: Tensor, turns: Tensor, poses: Tensor, chance: torch.Generator
    ) -> tuple[Tensor, Tensor]:
        """Bodies of the table after 1 to T touches: those drawn ``(T, B, C)``, and the chance of all ``(T, B, M)``."""
        quarters = round(float(turns[0]) / (torch.pi / 2))  # what is left of a small rotation matters little here
        with torch.autocast("cpu", torch.bfloat16, enabled=self._recipe.bf16):
            found, _ = network(torch.rot90(images, quarters, dims=(1, 2)))
        found = found.float().unflatten(0, (-1, len(poses))).swapaxes(0, 1)
        scores = torch.einsum("tbd,tmd->tbm", found, self._embedded[poses]).cumsum(0)
        chances = torch.softmax(_SHARPNESS * scores, dim=2)
        picked = [torch.multinomial(some, _CONFUSED, replacement=True, generator=chance) for some in chances]
        return torch.stack(picked), chances

    def evaluate(self, network: TouchNetwork, touches: TouchSet, bf16: bool) -> tuple[float, float]:
        """See :class:`~activetouch.perception.objective.Objective`: after T touches, in the first T poses."""
        number, known = self._recipe.touches, _Objects.of(touches)
        table = self._random(known.bodies, torch.Generator().manual_seed(0))
        found = embeddings(network, touches, bf16)[known.rows[:, :number]]  # (objects, T, D)
        network.eval()
        with torch.no_grad():
            views = known.turns[:number], known.aims[:number]
            hypotheses, true = (embedded(network, bodies, *views) for bodies in (table, known.bodies))
            loss = correct = 0.0
            for some in torch.arange(len(found)).split(64):
                scores = torch.einsum("btd,tmd->bm", found[some], hypotheses)
                of_shape = torch.logsumexp(scores.unflatten(1, (-1, self._num_shapes)), dim=1)
                own = torch.einsum("btd,tbd->b", found[some], true[:, some])
                total = torch.logsumexp(torch.cat([scores, own[:, None]], dim=1), dim=1) - math.log(scores.shape[1] + 1)
                loss += (total - own).sum().item()
                correct += (of_shape.argmax(1) == known.bodies.shapes[some]).sum().item()
        return loss / len(found), correct / len(found)


class _Objects(NamedTuple):
    """Objects that were touched in every pose.

    Attributes:
        bodies: of the M objects, in the orientations at rest.
        rows: of their touches, by pose, ``(M, P)``.
        of_row: which object each touch is of, ``(N,)``.
        poses: of each touch, ``(N,)``.
        turns: by which each pose turns an object, unit quaternions ``wxyz``, ``(P, 4)``.
        aims: of each pose, ``(P, 2)`` [m].
    """

    bodies: Hypotheses
    rows: Tensor
    of_row: Tensor
    poses: Tensor
    turns: Tensor
    aims: Tensor

    @property
    def num_poses(self) -> int:
        """P."""
        return len(self.turns)

    @classmethod
    def of(cls, touches: TouchSet) -> _Objects:
        """The objects of a split; of several touches in one pose, the first counts."""
        known = hypotheses_of(touches)
        objects, of_row = np.unique(touches.object_ids, return_inverse=True)
        num_poses = int(touches.poses.max()) + 1
        rows = np.full((len(objects), num_poses), -1)
        backwards = np.arange(len(of_row))[::-1]
        rows[of_row[backwards], touches.poses[backwards]] = backwards
        if (rows < 0).any():
            raise ValueError("learning from several touches of an object needs one of every object in every pose")
        first = torch.from_numpy(rows[:, 0])
        rests = torch.from_numpy(touches.rests).float()
        back = rests * torch.tensor([1.0, -1.0, -1.0, -1.0])
        turns = compose(known.orientations, back)
        of_pose = turns[torch.from_numpy(rows)]  # (M, P, 4)
        apart = 1.0 - (of_pose * of_pose[:1]).sum(dim=2).abs()
        if not float(apart.max()) < 1e-5:  # NaN where orientations at rest are not known
            raise ValueError("learning from several touches of an object needs poses that turn all objects alike")
        bodies = known._replace(orientations=rests).select(first)
        aims = known.aims[torch.from_numpy(rows[0])]
        return cls(
            bodies, torch.from_numpy(rows), torch.from_numpy(of_row), torch.from_numpy(touches.poses), of_pose[0], aims
        )


def embedded(network: TouchNetwork, bodies: Hypotheses, turns: Tensor, aims: Tensor) -> Tensor:
    """Embeddings of bodies in P poses, ``(P, M, D)``, without gradients."""
    found = []
    with torch.no_grad():
        for turn, aim in zip(turns, aims, strict=True):
            rows = torch.arange(len(bodies.shapes)).split(_AT_ONCE)
            found.append(torch.cat([network.hypotheses(in_pose(bodies.select(some), turn, aim)) for some in rows]))
    return torch.stack(found)


def in_pose(bodies: Hypotheses, turn: Tensor, aim: Tensor) -> Hypotheses:
    """Bodies at rest as the pad meets them in a pose, which turns them and brings them to an aim."""
    orientations = compose(turn.expand_as(bodies.orientations), bodies.orientations)
    return bodies._replace(orientations=orientations, aims=aim.expand(len(orientations), 2))
