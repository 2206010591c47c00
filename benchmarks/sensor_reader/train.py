"""Training of a reader that knows the sensor, on random bodies; it resumes from its state file.

python -m benchmarks.sensor_reader.train gel runs/reader-gel --steps 8000
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, IterableDataset

from activetouch.named_scenes import SCENES
from activetouch.perception.sealed_tensors import read_tensors, write_tensors
from activetouch.rendering import DeadTaxels, Gain, Noise, PressureRenderer
from activetouch.rendering.faults import faults_of
from activetouch.scene import Scene
from benchmarks.sensor_reader.network import ContactReader, losses
from benchmarks.sensor_reader.touches import Batches, Imaging

_HELD_OUT = 200  # bodies of the lowest numbers, which no training sees
_SMALLEST_IN_HALF = 16  # edge of an image; in smaller ones, half precision gives NaN
_CHECKS = 4  # batches of held-out bodies for a report


@dataclass(frozen=True)
class ContactRecipe:
    """How a reader is trained.

    Attributes:
        steps: batches in all.
        bodies: random bodies to learn from.
        widths: channels of the convolutions.
        dense: width of the layers after them.
        embedding: numbers of an embedding.
        learning_rate: highest.
        warmup: steps until it is reached.
        groups, touches: bodies of a batch, and touches of each.
        worlds: of a batch.
        bf16: whether the networks compute in half precision.
        seed: of all that is drawn.
    """

    steps: int = 8000
    bodies: int = 6000
    widths: tuple[int, ...] = (16, 32, 32, 64, 64)
    dense: int = 320
    embedding: int = 64
    learning_rate: float = 1.5e-3
    warmup: int = 200
    groups: int = 16
    touches: int = 32
    worlds: int = 4
    bf16: bool = True
    seed: int = 0

    def rate(self, step: int) -> float:
        """Learning rate of a step: linear rise, then a cosine to almost zero."""
        along = min(1.0, step / self.steps)
        return self.learning_rate * min(1.0, (step + 1) / self.warmup) * (0.5 * (1 + math.cos(math.pi * along)) + 0.003)


def imaging_of(scene: Scene, pixels: int, samples: int, coarser: float = 0.0) -> Imaging:
    """What the images of a scene are made of.

    Args:
        scene: with a pressure renderer.
        pixels: along an edge of what the network reads.
        samples, coarser: see :class:`Imaging`.
    """
    renderer = scene.renderer
    assert isinstance(renderer, PressureRenderer), "images of pressure only"
    taxels = scene.pad.num_taxels // renderer.binning
    rng = np.random.default_rng(0)
    dead = [fault(np.ones((taxels, taxels)), rng) == 0.0 for fault in faults_of(DeadTaxels, scene.faults)]
    gains, noises = faults_of(Gain, scene.faults), faults_of(Noise, scene.faults)
    return Imaging(
        scene.pad,
        taxels,
        pixels,
        scene.variation.force.support,
        gains[0].half_range if gains else 0.0,
        noises[0].std if noises else 0.0,
        scene.variation.offset.support[1],
        dead=np.any(dead, axis=0) if dead else None,
        samples=samples,
        coarser=coarser,
    )


SENSORS = {
    "gel": lambda: imaging_of(SCENES["gel"].scene, 32, 32, 0.3),
    "coarse": lambda: imaging_of(SCENES["coarse"].scene, 4, 32),
    "hard": lambda: imaging_of(SCENES["hard"].scene, 32, 32),
}
"""Kinds of pads that a reader is trained for; ``many`` has that of ``gel``, ``keyed`` too, with wider taxels."""


class _Stream(IterableDataset[dict[str, Tensor]]):
    """The batches of a training from a step on, made in other processes."""

    def __init__(self, batches: Batches, first: int) -> None:
        self.batches, self.first = batches, first

    def __iter__(self) -> Iterator[dict[str, Tensor]]:
        worker = torch.utils.data.get_worker_info()
        number, every = (0, 1) if worker is None else (worker.id, worker.num_workers)
        step = self.first + number
        while True:
            yield as_tensors(self.batches, step)
            step += every


def as_tensors(batches: Batches, number: int) -> dict[str, Tensor]:
    """A batch as tensors by name."""
    return {name: torch.from_numpy(np.ascontiguousarray(part)) for name, part in batches(number)._asdict().items()}


def train(
    imaging: Imaging, recipe: ContactRecipe, folder: Path, device: str = "cpu", workers: int = 1
) -> ContactReader:
    """Train a reader, or go on from the state in a folder.

    Args:
        imaging: of the sensor.
        recipe: of the training.
        folder: of ``state.safetensors`` and ``log.jsonl``.
        device: cpu or cuda.
        workers: processes that make batches.
    """
    torch.manual_seed(recipe.seed)
    network = ContactReader(recipe.widths, recipe.dense, recipe.embedding, imaging.pixels)
    network = network.to(device, memory_format=torch.channels_last)
    optimizer = torch.optim.AdamW(network.parameters(), lr=recipe.learning_rate, weight_decay=1e-3)
    state, first = folder / "state.safetensors", 0
    folder.mkdir(parents=True, exist_ok=True)
    if state.exists():
        first = _restore(state, network, optimizer)
    bodies = range(_HELD_OUT, _HELD_OUT + recipe.bodies)
    batches = Batches(imaging, bodies, recipe.groups, recipe.touches, recipe.worlds, seed=recipe.seed)
    held_out = Batches(imaging, range(_HELD_OUT), recipe.groups, recipe.touches, recipe.worlds, seed=recipe.seed + 1)
    checks = [as_tensors(held_out, number) for number in range(_CHECKS)]
    stream = iter(
        DataLoader(
            _Stream(batches, first), batch_size=None, num_workers=workers, prefetch_factor=4 if workers else None
        )
    )
    started, sums = time.monotonic(), torch.zeros(3)
    bf16 = recipe.bf16 and imaging.pixels >= _SMALLEST_IN_HALF
    for step in range(first, recipe.steps):
        for group in optimizer.param_groups:
            group["lr"] = recipe.rate(step)
        batch = {name: part.to(device) for name, part in next(stream).items()}
        contrast, entropy, accuracy = losses(network, batch, bf16)
        optimizer.zero_grad(set_to_none=True)
        (contrast + entropy).backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        sums += torch.stack([contrast.detach(), entropy.detach(), accuracy]).cpu()
        if (step + 1) % 100 == 0 or step + 1 == recipe.steps:
            with torch.inference_mode():
                parts = [
                    torch.stack(losses(network, {n: p.to(device) for n, p in check.items()}, bf16)) for check in checks
                ]
            names = ("contrast", "cross-entropy", "accuracy")
            report = {"step": step + 1, "seconds": round(time.monotonic() - started, 1)}
            report |= {f"training {n}": round(float(v), 4) for n, v in zip(names, sums / (step % 100 + 1), strict=True)}
            report |= {f"held-out {n}": round(float(v), 4) for n, v in zip(names, sum(parts) / _CHECKS, strict=True)}
            sums.zero_()
            with (folder / "log.jsonl").open("a") as log:
                log.write(json.dumps(report) + "\n")
            print(report, flush=True)
        if (step + 1) % 500 == 0 or step + 1 == recipe.steps:
            _save(state, network, optimizer, step + 1, recipe)
    return network


def _save(
    path: Path, network: ContactReader, optimizer: torch.optim.Optimizer, step: int, recipe: ContactRecipe
) -> None:
    tensors = {f"model.{name}": value for name, value in network.state_dict().items()}
    for name, parameter in network.named_parameters():
        for moment in ("exp_avg", "exp_avg_sq"):
            tensors[f"{moment}.{name}"] = optimizer.state[parameter][moment]
    arrays = {name: value.detach().cpu().contiguous().numpy() for name, value in tensors.items()}
    write_tensors(path, arrays, {"step": step, "recipe": asdict(recipe)})


def _restore(path: Path, network: ContactReader, optimizer: torch.optim.Optimizer) -> int:
    arrays, fields = read_tensors(path)
    tensors = {name: torch.from_numpy(array) for name, array in arrays.items()}
    network.load_state_dict({n.removeprefix("model."): v for n, v in tensors.items() if n.startswith("model.")})
    for name, parameter in network.named_parameters():
        moments = {moment: tensors[f"{moment}.{name}"].to(parameter.device) for moment in ("exp_avg", "exp_avg_sq")}
        optimizer.state[parameter] = {"step": torch.tensor(float(fields["step"])), **moments}
    return int(fields["step"])


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("sensor", choices=list(SENSORS))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--steps", type=int, default=8000)
    parser.add_argument("--widths", type=int, nargs="+", default=ContactRecipe.widths)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--threads", type=int, default=1)
    given = parser.parse_args()
    torch.set_num_threads(given.threads)
    train(
        SENSORS[given.sensor](),
        ContactRecipe(steps=given.steps, widths=tuple(given.widths)),
        given.folder,
        given.device,
        given.workers,
    )
