"""The commands that make the shipped sensor: ``collect`` touches, ``train`` the classifier."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal

from activetouch.dataset import CollectionPlan, read_manifest, read_split, record_shard, shard_path, write_manifest
from activetouch.recipe import TrainingRecipe
from activetouch.scene import Dynamic, Quasistatic, Scene
from experiments.parallel import default_jobs, progress_bar, run_tasks


@dataclass(frozen=True)
class Collect:
    """Touch thousands of objects and record the images, split by object into train, calibration and test.

    Finished shards are kept: an interrupted run goes on where it stopped when started again.

    For example:

        activetouch collect --out data/gel --plan.train 2700
    """

    out: Path = Path("data/gel")
    """Folder of the collection."""
    plan: CollectionPlan = field(default_factory=CollectionPlan)
    """Objects per shape and split; each is touched once in every pose."""
    quasistatic: bool = False
    """Skip time stepping: every press gets exactly its target force."""
    jobs: int = field(default_factory=default_jobs)
    """Processes."""

    def run(self) -> None:
        """Record all missing shards."""
        scene = Scene(press_model=Quasistatic() if self.quasistatic else Dynamic())
        write_manifest(self.out, scene, self.plan)
        tasks = [
            partial(record_shard, scene, self.plan, split, objects, path)
            for split, shard, objects in self.plan.shards(len(scene.shapes))
            if not (path := shard_path(self.out, split, shard)).exists()
        ]
        for _ in run_tasks(tasks, self.jobs, f"touching objects → {self.out}"):
            pass


@dataclass(frozen=True)
class Train:
    """Train the ConvNeXt classifier on a collection; after every epoch the state is saved and can be resumed.

    For example:

        activetouch train --data data/gel --out runs/train --backbone atto --input-size 64
    """

    data: Path = Path("data/gel")
    """Folder of the collection."""
    out: Path = Path("runs/train")
    """Folder for the checkpoint and the training state."""
    backbone: Literal["atto", "femto", "pico", "nano", "tiny"] = "atto"
    """ConvNeXt size."""
    input_size: int = 64
    """Edge the images are averaged down to before the network [pixels]."""
    start_from: Path | None = None
    """Checkpoint whose weights to start from; from scratch without."""
    recipe: TrainingRecipe = field(default_factory=TrainingRecipe)
    """Optimiser settings."""
    threads: int = field(default_factory=default_jobs)
    """Threads of the linear algebra."""

    def run(self) -> None:
        """Train to the end of the recipe and write ``classifier.safetensors``."""
        import torch

        from activetouch.classifier import BACKBONES, ClassifierCard, TouchClassifier, TouchNetwork
        from activetouch.training import Trainer

        torch.set_num_threads(self.threads)
        manifest = read_manifest(self.data)
        train, calibration = read_split(self.data, "train"), read_split(self.data, "calibration")
        card = ClassifierCard(
            backbone=self.backbone,
            input_size=self.input_size,
            shape_labels=tuple(manifest["shape_labels"]),
            pose_labels=tuple(manifest["pose_labels"]),
            images=manifest["scene"],
            mujoco_version=manifest["mujoco_version"],
            training=f"{self.recipe}, {len(train.images)} images, weights from {self.start_from or 'scratch'}",
        )
        with torch.random.fork_rng():  # torch draws initial weights from its global generator only
            torch.manual_seed(self.recipe.seed)
            network = TouchNetwork(BACKBONES[self.backbone], len(card.shape_labels), self.input_size)
        if self.start_from is not None:
            network.load_state_dict(TouchClassifier.load(self.start_from).network.state_dict())
        print(f"{self.backbone} at {self.input_size} pixels: {card.training}")
        classifier = TouchClassifier(card, network)
        trainer = Trainer(classifier, self.recipe, len(train.images), self.out / "state.safetensors")
        with progress_bar() as progress:
            while trainer.epochs_done < self.recipe.epochs:
                bar = progress.add_task(f"epoch {trainer.epochs_done + 1}", total=len(train.images))
                report = trainer.run_epoch(train, calibration, lambda n, bar=bar: progress.advance(bar, n))
                progress.console.print(report)
        classifier.save(self.out / "classifier.safetensors")
        print(f"wrote {self.out / 'classifier.safetensors'}")
