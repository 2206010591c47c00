"""Train the classifier: AdamW, cosine schedule, symmetry augmentation, a checkpoint after every epoch.

The only augmentations are symmetries of the square pad, and only those that the scene has exactly
(:class:`activetouch.scene.Symmetry`): where orientation is uniform over SO(3) and the sensor treats all directions
alike, a turned image is as likely as the original; where every shape is its own mirror image, so is a mirrored one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from activetouch.atomic import atomic_path
from activetouch.classifier import TouchClassifier, TouchNetwork
from activetouch.dataset import TouchSet
from activetouch.errors import CorruptFile, LabelMismatch
from activetouch.recipe import TrainingRecipe
from activetouch.scene import Symmetry


@dataclass(frozen=True)
class EpochReport:
    """How one epoch ended: mean training loss, and loss [nats] and accuracy on the calibration split."""

    epoch: int
    training_loss: float
    calibration_loss: float
    calibration_accuracy: float


def _augmented(images: Tensor, symmetry: Symmetry, generator: torch.Generator) -> Tensor:
    """All images of a batch under one of the symmetries, drawn at random."""
    turns, flip = torch.randint(4, (), generator=generator), torch.rand((), generator=generator) < 0.5
    if symmetry is not Symmetry.NONE:
        images = torch.rot90(images, int(turns), dims=(1, 2))
    return images.flip(2) if flip and symmetry is Symmetry.ROTATIONS_AND_MIRROR else images


def evaluate(network: TouchNetwork, touches: TouchSet, bf16: bool) -> tuple[float, float]:
    """Mean negative log-likelihood [nats] and accuracy of the raw softmax."""
    network.eval()
    loss = correct = 0.0
    with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=bf16):
        for first in range(0, len(touches.images), 256):
            logits, _ = network(torch.from_numpy(touches.images[first : first + 256]))
            labels = torch.from_numpy(touches.shapes[first : first + 256])
            loss += nn.functional.cross_entropy(logits.float(), labels, reduction="sum").item()
            correct += (logits.argmax(1) == labels).sum().item()
    return loss / len(touches.images), correct / len(touches.images)


class Trainer:
    """Trains a classifier's network epoch by epoch, resuming from its state file where there is one."""

    def __init__(
        self,
        classifier: TouchClassifier,
        recipe: TrainingRecipe,
        num_images: int,
        state: Path,
        symmetry: Symmetry = Symmetry.NONE,
    ) -> None:
        self.classifier, self.recipe, self.state, self.symmetry = classifier, recipe, state, symmetry
        self._task = json.dumps([asdict(recipe), asdict(classifier.card), num_images, symmetry])
        network = classifier.network
        decayed = [p for p in network.parameters() if p.ndim > 1]
        plain = [p for p in network.parameters() if p.ndim <= 1]
        self.optimizer = torch.optim.AdamW(
            [{"params": decayed, "weight_decay": recipe.weight_decay}, {"params": plain, "weight_decay": 0.0}],
            lr=recipe.learning_rate,
        )
        self.steps_per_epoch = -(-num_images // recipe.batch_size)
        self.epochs_done = 0
        if state.exists():
            self._resume()

    def learning_rate(self, epoch: float) -> float:
        """Learning rate after a (fractional) number of epochs: linear rise, then a cosine to zero."""
        peak, warmup, epochs = self.recipe.learning_rate, self.recipe.warmup, self.recipe.epochs
        if epoch < warmup:
            return peak * (epoch + 1 / self.steps_per_epoch) / warmup
        return peak * 0.5 * (1 + math.cos(math.pi * (epoch - warmup) / (epochs - warmup)))

    def run_epoch(self, train: TouchSet, calibration: TouchSet, tick: Callable[[int], None]) -> EpochReport:
        """One pass over the training split; ``tick`` is told how many images each step took."""
        recipe, network = self.recipe, self.classifier.network
        generator = torch.Generator().manual_seed(recipe.seed * 1000 + self.epochs_done)
        order = torch.randperm(len(train.images), generator=generator).numpy()
        network.train()
        total = 0.0
        for first in range(0, len(order), recipe.batch_size):
            index = np.sort(order[first : first + recipe.batch_size])
            images = _augmented(torch.from_numpy(train.images[index]), self.symmetry, generator)
            with torch.autocast("cpu", torch.bfloat16, enabled=recipe.bf16):
                logits, _ = network(images)
            loss = nn.functional.cross_entropy(logits.float(), torch.from_numpy(train.shapes[index]))
            self.optimizer.zero_grad(set_to_none=True)
            loss.backward()
            nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            for group in self.optimizer.param_groups:
                group["lr"] = self.learning_rate(self.epochs_done + first / len(order))
            self.optimizer.step()
            total += loss.item() * len(index)
            tick(len(index))
        self.epochs_done += 1
        report = EpochReport(self.epochs_done, total / len(order), *evaluate(network, calibration, recipe.bf16))
        self._save()
        return report

    def _moments(self) -> dict[str, Tensor]:
        return {
            f"{moment}.{name}": self.optimizer.state[parameter][moment]
            for name, parameter in self.classifier.network.named_parameters()
            for moment in ("exp_avg", "exp_avg_sq")
        }

    def _save(self) -> None:
        tensors = {f"model.{k}": v for k, v in self.classifier.network.state_dict().items()} | self._moments()
        header = {
            "task": self._task,
            "epochs_done": str(self.epochs_done),
        }
        with atomic_path(self.state) as temporary:
            save_file({name: value.contiguous() for name, value in tensors.items()}, temporary, metadata=header)

    def _resume(self) -> None:
        try:
            with safe_open(self.state, framework="pt") as file:
                header = file.metadata() or {}
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        except (SafetensorError, OSError) as error:
            raise CorruptFile(f"{self.state} is damaged ({error}); delete it to start anew") from error
        if header.get("task") != self._task:
            raise LabelMismatch(
                f"{self.state} belongs to another training (recipe, network, start or data): {header.get('task')}, not "
                f"{self._task}. Choose another folder, or delete this file to start anew."
            )
        network = self.classifier.network
        network.load_state_dict(
            {name.removeprefix("model."): v for name, v in tensors.items() if name.startswith("model.")}
        )
        self.epochs_done = int(header["epochs_done"])
        steps = torch.tensor(float(self.epochs_done * self.steps_per_epoch))
        for name, parameter in network.named_parameters():
            self.optimizer.state[parameter] = {
                "step": steps.clone(),
                "exp_avg": tensors[f"exp_avg.{name}"],
                "exp_avg_sq": tensors[f"exp_avg_sq.{name}"],
            }
