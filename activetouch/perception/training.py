"""Train a network: cosine schedule, augmentation by symmetry, a checkpoint after every epoch."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from activetouch.data.dataset import TouchSet
from activetouch.errors import LabelMismatch, TrainingDiverged
from activetouch.perception.augmentation import augment, worn
from activetouch.perception.classifier import TouchClassifier
from activetouch.perception.learner import Learner, falling, with_prefix
from activetouch.perception.objective import Contrast, ShapeObjective
from activetouch.perception.reader import require_stack
from activetouch.perception.recipe import TrainingRecipe
from activetouch.scene import Symmetry
from belief.errors import CorruptFile
from belief.files import array_digest
from belief.naming import few
from belief.sealed_tensors import read_fields, read_tensors, write_tensors

_ADVICE = "Train with a lower --change.learning-rate"


@dataclass(frozen=True)
class EpochReport:
    """Results of one epoch: mean training loss, and loss [nats] and accuracy on the calibration split."""

    epoch: int
    training_loss: float
    calibration_loss: float
    calibration_accuracy: float

    @property
    def words(self) -> str:
        """The report in words."""
        return (
            f"epoch {self.epoch}: training loss {self.training_loss:.4f}, on the calibration split loss "
            f"{self.calibration_loss:.4f} and accuracy {self.calibration_accuracy:.4f}"
        )


class Trainer:
    """Trains a classifier's network epoch by epoch; resumes from the file of its state, written after every epoch."""

    def __init__(
        self,
        classifier: TouchClassifier,
        recipe: TrainingRecipe,
        train: TouchSet,
        calibration: TouchSet,
        state: Path,
        symmetry: Symmetry = Symmetry.NONE,
        taxels: int = 1,
    ) -> None:
        self.classifier, self.recipe, self.state, self.symmetry = classifier, recipe, state, symmetry
        self.taxels = taxels
        self.train, self.calibration = train, calibration
        for touches in (train, calibration):
            require_stack(touches.images)
        task = {**asdict(recipe), **classifier.card.fields(), "symmetry": symmetry, "taxels": taxels}
        data = {"training touches": train, "calibration touches": calibration}
        task |= {name: array_digest(vars(touches)) for name, touches in data.items()}
        self._task: dict[str, Any] = json.loads(json.dumps(task))  # as the state file has it
        self.learner = Learner(classifier.network, recipe.weight_decay, recipe.optimizer == "muon")
        labels = classifier.card.shape_labels
        contrast = classifier.card.knows_orientations
        self.objective = (Contrast if contrast else ShapeObjective)(train, labels, recipe)
        if contrast and symmetry is Symmetry.ROTATIONS_AND_MIRROR:
            self.symmetry = Symmetry.ROTATIONS  # how a mirrored body lies depends on its shape
        self.steps_per_epoch = len(self.objective.batches(torch.Generator()))
        self.reports: list[EpochReport] = []
        self._best: dict[str, Tensor] = {}
        if state.exists():
            self._resume()

    @property
    def epochs_done(self) -> int:
        """Number of finished epochs, those of earlier runs included."""
        return len(self.reports)

    @property
    def best_epoch(self) -> int:
        """Number, from 1, of the epoch after which the loss on the calibration split was lowest."""
        return min(self.reports, key=lambda report: report.calibration_loss).epoch

    @property
    def is_finished(self) -> bool:
        """Whether all epochs are done, or patience is at its end."""
        if self.epochs_done == self.recipe.epochs:
            return True
        patience = self.recipe.patience
        return patience is not None and self.epochs_done > 0 and self.epochs_done - self.best_epoch >= patience

    def finish(self) -> TouchClassifier:
        """The trained classifier: that of the best epoch where the recipe is patient, else of the last."""
        if self.recipe.patience is not None:
            self.classifier.network.load_state_dict(self._best)
        self.classifier.network.eval()
        return self.classifier

    def learning_rate(self, epoch: float) -> float:
        """Learning rate after a (fractional) number of epochs: linear rise, then a cosine to zero."""
        peak, warmup, epochs = self.recipe.learning_rate, self.recipe.warmup, self.recipe.epochs
        if epoch < warmup:
            return peak * (epoch + 1 / self.steps_per_epoch) / warmup
        return peak * falling((epoch - warmup) / (epochs - warmup))

    def run_epoch(self, tick: Callable[[int], None] = lambda _: None) -> EpochReport:
        """One pass over the training split; ``tick`` is called with the number of images of each step."""
        recipe, network, train = self.recipe, self.classifier.network, self.train
        generator = torch.Generator().manual_seed(recipe.seed * 1000 + self.epochs_done)
        batches = self.objective.batches(generator)
        num_images, seen = sum(map(len, batches)), 0
        network.train()
        total = 0.0
        for rows in batches:
            images = torch.from_numpy(train.images[rows.numpy()])
            images, turns = augment(images, self.symmetry, recipe.rotation, generator)
            if recipe.gain or recipe.noise or recipe.dead:
                images = worn(images, recipe.gain, recipe.noise, recipe.dead, self.taxels, generator)
            loss = self.objective.loss(network, images, rows, turns, generator)
            norm = self.learner.gradient(loss)
            if not torch.isfinite(norm):
                raise TrainingDiverged(
                    f"epoch {self.epochs_done + 1}: after {seen} images the loss is {loss.item():g} and the gradient "
                    f"{norm.item():g}. {_ADVICE}"
                )
            self.learner.step(self.learning_rate(self.epochs_done + seen / num_images))
            total += loss.item() * len(rows)
            seen += len(rows)
            tick(len(rows))
        report = EpochReport(
            self.epochs_done + 1, total / num_images, *self.objective.evaluate(network, self.calibration)
        )
        if not math.isfinite(report.calibration_loss):
            raise TrainingDiverged(f"{report.words}. {_ADVICE}")
        self.reports.append(report)
        if recipe.patience is not None and self.best_epoch == self.epochs_done:
            self._best = {name: value.clone() for name, value in network.state_dict().items()}
        self._save()
        return report

    def _save(self) -> None:
        if self.state.exists():
            self._require_own(read_fields(self.state))
        best = {f"best.{name}": value.numpy() for name, value in self._best.items()}
        fields = {"task": self._task, "reports": [asdict(report) for report in self.reports]}
        write_tensors(self.state, self.learner.arrays() | best, fields)

    def _resume(self) -> None:
        try:
            arrays, header = read_tensors(self.state)
        except CorruptFile as error:
            raise CorruptFile(f"{error}; delete it to start anew") from error
        tensors = {name: torch.from_numpy(array) for name, array in arrays.items()}
        self._require_own(header)
        self._best = with_prefix(tensors, "best.")
        self.reports = [EpochReport(**report) for report in header["reports"]]
        self.learner.restore(tensors, self.epochs_done * self.steps_per_epoch)

    def _require_own(self, header: Mapping[str, Any]) -> None:
        theirs = dict(header.get("task") or {})
        if differing := [name for name in {**self._task, **theirs} if theirs.get(name) != self._task.get(name)]:
            raise LabelMismatch(
                f"{self.state} belongs to another training, with another {few(differing, 12)}. Choose another folder, "
                "or delete this file to start anew"
            )
