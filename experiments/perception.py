"""The commands that make the shipped sensor: ``collect`` touches, ``train`` the classifier."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import tyro

from activetouch.dataset import CollectionPlan, read_manifest, read_split, record_shard, shard_path, write_manifest
from activetouch.recipe import TrainingRecipe
from activetouch.scene import Symmetry
from activetouch.world import CLASSIFIER_FILE
from experiments.parallel import default_jobs, progress_bar, run_tasks
from experiments.scene_choice import SceneChoice, collection_folder, named_scene, training_folder


@dataclass(frozen=True)
class Collect:
    """Touch thousands of objects and record the images, split by object into train, calibration and test.

    Finished shards are kept: an interrupted run goes on where it stopped when started again.

    For example:

        activetouch collect --scene gel --plan.train 2700
        activetouch collect --meshes mug.stl --out data/mug
    """

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=SceneChoice)
    """The world."""
    out: Path | None = None
    """Folder of the collection; data/SCENE by default."""
    plan: CollectionPlan = field(default_factory=CollectionPlan)
    """Objects per shape and split; each is touched once in every pose."""
    jobs: int = field(default_factory=default_jobs)
    """Processes."""

    def run(self) -> None:
        """Record all missing shards."""
        scene = self.choice.named.scene
        folder = self.out if self.out is not None else collection_folder(self.choice.scene)
        write_manifest(folder, scene, self.plan)
        tasks = [
            partial(record_shard, scene, self.plan, split, objects, path)
            for split, shard, objects in self.plan.shards(len(scene.shapes))
            if not (path := shard_path(folder, split, shard)).exists()
        ]
        for _ in run_tasks(tasks, self.jobs, f"touching objects → {folder}"):
            pass


@dataclass(frozen=True)
class Train:
    """Train the ConvNeXt classifier on a collection; after every epoch the state is saved and can be resumed.

    For example:

        activetouch train --scene gel
        activetouch train --data data/mug --out runs/train-mug --input-size 32 --recipe.epochs 5
    """

    scene: str = "gel"
    """The scene it is for: decides the next three where they are not given."""
    data: Path | None = None
    """Folder of the collection; data/SCENE by default."""
    out: Path | None = None
    """Folder for the checkpoint and the training state; runs/train-SCENE by default."""
    input_size: int | None = None
    """Edge the images are averaged down, or repeated up, to before the network [pixels]; the scene's by default."""
    backbone: Literal["atto", "femto", "pico", "nano", "tiny"] = "atto"
    """ConvNeXt size."""
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
        named = named_scene(self.scene)
        data = self.data if self.data is not None else collection_folder(self.scene)
        out = self.out if self.out is not None else training_folder(self.scene)
        input_size = self.input_size if self.input_size is not None else named.input_size
        manifest = read_manifest(data)
        train, calibration = read_split(data, "train"), read_split(data, "calibration")
        card = ClassifierCard(
            backbone=self.backbone,
            input_size=input_size,
            shape_labels=tuple(manifest["shape_labels"]),
            pose_labels=tuple(manifest["pose_labels"]),
            channels=train.images.shape[3] if train.images.ndim == 4 else 1,
            images=manifest["scene"],
            mujoco_version=manifest["mujoco_version"],
            training=f"{self.recipe}, {len(train.images)} images, weights from {self.start_from or 'scratch'}",
        )
        with torch.random.fork_rng():  # torch draws initial weights from its global generator only
            torch.manual_seed(self.recipe.seed)
            network = TouchNetwork(BACKBONES[self.backbone], len(card.shape_labels), input_size, card.channels)
        if self.start_from is not None:
            network.load_state_dict(TouchClassifier.load(self.start_from).network.state_dict())
        print(f"{self.backbone} at {input_size} pixels: {card.training}")
        classifier = TouchClassifier(card, network)
        symmetry = Symmetry(manifest["symmetry"])
        trainer = Trainer(classifier, self.recipe, len(train.images), out / "state.safetensors", symmetry)
        with progress_bar() as progress:
            while trainer.epochs_done < self.recipe.epochs:
                bar = progress.add_task(f"epoch {trainer.epochs_done + 1}", total=len(train.images))
                report = trainer.run_epoch(train, calibration, lambda n, bar=bar: progress.advance(bar, n))
                progress.console.print(report)
        classifier.save(out / CLASSIFIER_FILE)
        print(f"wrote {out / CLASSIFIER_FILE}")
