"""Training of a reader that knows the sensor, on random bodies; it goes on from its state file."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from torch.utils.data import DataLoader

from activetouch.errors import ImpossibleRecipe
from activetouch.perception.card import ClassifierCard
from activetouch.perception.contacts.hypotheses import CONTACTS, EMBEDDING, ContactHypotheses
from activetouch.perception.contacts.network import ContactNetwork, ContactReader, ImageNetwork, losses
from activetouch.perception.contacts.touches import Batches
from activetouch.perception.export import exported
from activetouch.perception.imaging import FEW_PIXELS, Imaging
from activetouch.perception.learner import Learner, falling
from activetouch.perception.reader import INPUT, LAYOUT, OUTPUTS, TactileReader
from activetouch.scene import Scene
from activetouch.scene_description import scene_fields
from belief.sealed_tensors import read_tensors, write_tensors

HELD_OUT = 200
"""Bodies of the lowest numbers, which no training sees."""
CHECKS = 4
"""Batches of held-out bodies for a report."""
_SMALLEST_IN_HALF = 16  # edge of an image; in smaller ones, half precision gives NaN
_REPORTED, _SAVED = 100, 100  # steps between reports, and between states on disk
_NAMES = ("contrast", "cross-entropy", "accuracy")
_STATE = "state.safetensors"


@dataclass(frozen=True)
class ContactRecipe:
    """The settings of the training of a reader, in batches of ``groups`` bodies with ``touches`` each.

    ``widths`` and ``image_widths`` are channels of the convolutions of h, computed for every hypothesis, and of f;
    ``dense`` is the width of the layers after them. ``learning_rate`` is the highest, after ``warmup`` steps. After a
    share ``late`` of the steps, batches are late, see :class:`~activetouch.perception.contacts.touches.Batches`. With
    ``any_pad``, every batch has another random pad.
    """

    steps: int = 7500
    bodies: int = 16_000
    widths: tuple[int, ...] = (16, 32, 32, 64, 96)
    image_widths: tuple[int, ...] = (32, 32, 64, 64, 96)
    dense: int = 384
    embedding: int = 96
    learning_rate: float = 1.5e-3
    warmup: int = 200
    groups: int = 32
    touches: int = 32
    worlds: int = 8
    late: float = 0.8
    others: int = 96
    bf16: bool = True
    seed: int = 0
    any_pad: bool = False

    @classmethod
    def of(cls, imaging: Imaging, goes_on: bool = False, **changes: Any) -> ContactRecipe:
        """The recipe for a sensor: images of few pixels need fewer convolutions, and more bodies in a batch.

        ``goes_on``: from a reader of any pad to a better one.
        """
        few: dict[str, Any] = {"widths": (16, 32, 64), "groups": 64} if imaging.pixels <= FEW_PIXELS else {}
        if imaging.described is not None:  # its image network is a ConvNeXt of these widths
            few = {"widths": (16, 32, 64), "image_widths": (24, 48, 96), "groups": 16, "touches": 16, "others": 32}
            further = {"steps": 1500, "learning_rate": 5e-4, "warmup": 100}  # from the reader of any pad to one
            any_pad = {"steps": 8_000, "learning_rate": 8e-4, "seed": 1} if goes_on else {"steps": 13_000}
            few |= any_pad if changes.get("any_pad") else further
        return cls(**few | changes)

    def network(self, imaging: Imaging) -> ContactReader:
        """An untrained network for a sensor."""
        numbers = 0 if imaging.layout is None else len(imaging.layout) - imaging.pixels**2
        parts = self.widths, self.image_widths, self.dense, self.embedding
        return ContactReader(*parts, imaging.pixels, imaging.state_size, numbers)

    def rate(self, step: int) -> float:
        """Learning rate of a step: linear rise, then a cosine to almost zero."""
        rise = min(1.0, (step + 1) / self.warmup)
        return self.learning_rate * rise * (falling(min(1.0, step / self.steps)) + 0.003)


class ContactTrainer:
    """A training that resumes from its folder; ``workers`` processes make the batches, or this one on ``device``.

    Its network begins with the weights of a reader, ``start``, of the same recipe; by default with random ones.
    """

    def __init__(
        self,
        imaging: Imaging,
        recipe: ContactRecipe,
        folder: Path,
        device: str = "cpu",
        workers: int = 1,
        start: TactileReader | None = None,
    ) -> None:
        self.imaging, self.recipe, self.folder, self.device = imaging, recipe, folder, device
        torch.manual_seed(recipe.seed)
        network = recipe.network(imaging)
        if start is not None:
            network.load_state_dict(weights_of(start))
        self.network = network.to(device)
        self._learner = Learner(network, weight_decay=1e-3)
        folder.mkdir(parents=True, exist_ok=True)
        self.step, self._state = 0, folder / _STATE
        if self._state.exists():
            self._resume()
        shown, parts = None if recipe.any_pad else imaging, (recipe.groups, recipe.touches, recipe.worlds)
        drawn = partial(Batches, shown, groups=parts[0], touches=parts[1], worlds=parts[2], device=device)
        bodies, late = range(HELD_OUT, HELD_OUT + recipe.bodies), recipe.late * recipe.steps
        batches = drawn(bodies, seed=recipe.seed, late=late, others=recipe.others)
        workers, steps = workers if device == "cpu" else 0, range(self.step, recipe.steps)
        ahead = 4 if workers else None
        self._batches = iter(DataLoader(batches, None, sampler=steps, num_workers=workers, prefetch_factor=ahead))
        held_out = drawn(range(HELD_OUT), seed=recipe.seed + 1)
        self._checks = [held_out[number] for number in range(CHECKS)]
        self._bf16 = recipe.bf16 and imaging.pixels >= _SMALLEST_IN_HALF
        self._started, self._sums = time.monotonic(), torch.zeros(3, device=device)

    def run(self, learned: Callable[[int], None] = lambda step: None) -> Iterator[dict[str, float]]:
        """Train to the end of the recipe; yield a report every hundred steps, and call ``learned(step)`` at each."""
        recipe = self.recipe
        while self.step < recipe.steps:
            self._learn()
            learned(self.step)
            if self.step % _REPORTED == 0 or self.step == recipe.steps:
                report = self._report()
                with (self.folder / "log.jsonl").open("a", encoding="utf-8", newline="\n") as log:
                    log.write(json.dumps(report) + "\n")
                yield report
            if self.step % _SAVED == 0 or self.step == recipe.steps:
                self._save()

    def _learn(self) -> None:
        contrast, entropy, accuracy = losses(self.network, next(self._batches), self.recipe.groups, self._bf16)
        self._learner.gradient(contrast + entropy)
        self._learner.step(self.recipe.rate(self.step))
        self._sums += torch.stack([contrast.detach(), entropy.detach(), accuracy])
        self.step += 1

    def _report(self) -> dict[str, float]:
        with torch.inference_mode():
            groups = self.recipe.groups
            found = [torch.stack(losses(self.network, check, groups, self._bf16)) for check in self._checks]
        number = self.step % _REPORTED or _REPORTED
        report = {"step": self.step, "seconds": round(time.monotonic() - self._started, 1)}
        for what, means in (("training", self._sums / number), ("held-out", torch.stack(found).mean(dim=0))):
            report |= {f"{what} {name}": round(float(mean), 4) for name, mean in zip(_NAMES, means, strict=True)}
        self._sums.zero_()
        return report

    def _save(self) -> None:
        write_tensors(self._state, self._learner.arrays(), {"step": self.step, "recipe": asdict(self.recipe)})

    def _resume(self) -> None:
        arrays, fields = read_tensors(self._state)
        own, theirs = json.loads(json.dumps(asdict(self.recipe))), dict(fields["recipe"])
        theirs["steps"] = own["steps"]  # more or fewer may follow
        if differing := [
            f"{name} {theirs.get(name)} (not {own[name]})" for name in own if theirs.get(name) != own[name]
        ]:
            raise ImpossibleRecipe(
                f"{self._state} is of a training with {', '.join(differing)}; give its numbers, or another folder"
            )
        self.step = int(fields["step"])
        self._learner.restore({name: torch.from_numpy(array) for name, array in arrays.items()}, self.step)


def weights_of(reader: TactileReader) -> dict[str, torch.Tensor]:
    """The weights of the two networks in the file of a reader, in single precision, by their names in training."""
    assert isinstance(reader.hypotheses, ContactHypotheses), "it reads any object"
    found = {}
    for graph in (reader.network, reader.hypotheses.network):
        for tensor in onnx.load_from_string(graph).graph.initializer:
            if tensor.name.startswith("network."):
                name = tensor.name.removeprefix("network.").removesuffix(".half")
                found[name] = torch.from_numpy(onnx.numpy_helper.to_array(tensor).astype(np.float32))
    return found


def export(network: ContactReader, imaging: Imaging, scene: Scene, training: str) -> TactileReader:
    """The reader of a network, which needs no torch; the objects of the sensor's scene do not matter."""
    network = network.cpu().float().eval()
    pixels, wide, layout = imaging.pixels, imaging.wide_window.num_pixels, imaging.layout
    images: tuple[torch.Tensor, ...] = (torch.zeros((2, pixels, pixels), dtype=torch.uint8),)
    images += () if layout is None else (torch.from_numpy(layout),)
    maps = 2 if layout is None else 3
    contacts = (torch.zeros(2, maps, wide, wide), torch.full((2,), 0.1), torch.zeros(2, imaging.state_size))
    free = ({0: "batch"}, {})[: len(images)]
    graph = exported(ImageNetwork(network), images, free, (INPUT, LAYOUT)[: len(images)], OUTPUTS)
    others = exported(
        ContactNetwork(network), contacts, ({0: "number"}, {0: "number"}, {0: "worlds"}), CONTACTS, (EMBEDDING,)
    )
    card = ClassifierCard(
        "contacts",
        pixels,
        (),
        (),
        scene=scene_fields(scene),
        training=training,
        image_shape=(pixels, pixels),
        embedding=network.embedding,
        imaging=imaging.fields(),
    )
    return TactileReader(card, graph, ContactHypotheses(imaging, others))
