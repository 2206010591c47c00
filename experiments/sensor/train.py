"""``activetouch train``: from recorded touches to a classifier, or from random bodies to a reader of any object."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from activetouch.data.dataset import TouchSet, read_split
from activetouch.data.manifest import read_manifest
from activetouch.extras import require_extra
from activetouch.pad_file import PadDescription, read_pad
from activetouch.perception.backbones import BACKBONES
from activetouch.perception.reader import TactileReader, resized
from activetouch.perception.recipe import RECIPES, TrainingRecipe
from activetouch.scene import Scene
from activetouch.sensor_files import ANY_OBJECT_FILE, PAD_FILE, READER_FILE
from belief.constraints import NotNegative, Positive
from belief.files import claim_folder, ends_claims
from experiments.command_line.arguments import BadArgument, Count, Jobs, Pixels, Seed, check_arguments
from experiments.parallel import default_jobs, progress_bar
from experiments.scene_choice import collection_folder, named_scene, training_folder
from experiments.sensor_choice import open_collection, require_collection

if TYPE_CHECKING:
    from torch import nn

    from activetouch.perception.card import ClassifierCard
    from activetouch.perception.classifier import TouchClassifier
    from activetouch.perception.training import Trainer

STATE_FILE = "state.safetensors"
BackboneName: TypeAlias = Literal[tuple(BACKBONES)]  # type: ignore[valid-type]


@dataclass(frozen=True)
class Changes:
    """Changes to a named recipe."""

    epochs: Count | None = None
    """Passes over the training split."""
    batch_size: Count | None = None
    """Images per step."""
    learning_rate: Positive | None = None
    """Peak of the cosine schedule."""
    patience: Count | None = None
    """Stop after so many epochs without a lower loss on the calibration split, and keep the best epoch."""
    cell: NotNegative | None = None
    """Standard deviation of a random rotation of the true hypothesis [degrees]; recipes contrast and worn only."""
    focus: tuple[str, ...] | None = None
    """Shapes that are hard to tell apart and are drawn four times as often; recipes contrast and worn only."""
    seed: Seed | None = None
    """Seed of initialisation, shuffling and augmentation."""

    def of(self, recipe: TrainingRecipe) -> TrainingRecipe:
        """The recipe with these changes."""
        return replace(recipe, **{name: value for name, value in asdict(self).items() if value is not None})


ANY_PAD = "any_pad"
"""Name of the shipped reader of any pad, in place of a file of weights."""


@dataclass(frozen=True)
class Train:
    """Train a reader: of any object, on random bodies; or of the shapes of a collection.

    A reader of any object (--recipe contacts) learns the sensor, needs no collection, and reads shapes that it never
    saw; --recipe pads learns all pads that a description may be of, and --pad goes on from there to one. The others
    learn the shapes of a collection: contrast and worn with their orientations and sizes (worn is for pads that wear),
    large and paper without.

    The state is saved regularly; after an interruption, the same command continues.

    For example:

        activetouch train --scene coarse
        activetouch train --scene gel --recipe contacts --steps 2000 --device cuda
        activetouch train --scene hard --recipe worn --change.focus cube cuboid wedge
        activetouch train --pad mine.toml --out sensors/mine
        activetouch train --recipe paper --backbone tiny --weights imagenet
        activetouch train --data data/mug --out runs/train-mug --input-size 32 --recipe large --change.epochs 5
    """

    scene: str = "gel"
    """Name of the scene, which gives the defaults of the next four."""
    pad: Path | None = None
    """TOML description of your own pad, for which the reader of any pad is trained further; docs/your_own_pad.md."""
    data: Path | None = None
    """Folder of the collection; data/SCENE by default."""
    out: Path | None = None
    """Folder for the reader and the training state; runs/train-SCENE by default."""
    input_size: Pixels | None = None
    """Edge the images are averaged down, or repeated up, to before the network [pixels]; the scene's by default."""
    backbone: BackboneName | None = None
    """The network: a plain small CNN, or a ConvNeXt by size; the scene's by default."""
    weights: str | None = None
    """Weights that a ConvNeXt starts from: imagenet (facebook/convnext-tiny-224 on the Hugging Face hub, for the
    backbone tiny), or a folder with config.json and model.safetensors; or any_pad, the shipped reader, from which
    --recipe pads goes on; random weights by default."""
    recipe: Literal["contacts", "pads", "contrast", "worn", "large", "paper"] = "contrast"
    """What to learn, and how."""
    steps: Count | None = None
    """Steps, each of many touches of random bodies, for a reader of any object; 7500, of any pad 13000, from there on
    8000, or to one described pad 1500."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Where a reader of any object is trained."""
    change: Changes = field(default_factory=Changes)
    """Settings that differ from the recipe's."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of threads."""

    @ends_claims
    def run(self) -> None:
        """Train to the end of the recipe and write the reader."""
        check_arguments(self)
        require_extra("train")
        goes_on = self.weights == ANY_PAD and self.recipe == "pads" and self.pad is None
        if self.weights is not None and not goes_on and (self.pad is not None or self.recipe in ("pads", "contacts")):
            raise BadArgument(
                "--weights are of a ConvNeXt, and a reader of any object is none; leave them out, or say --recipe pads "
                f"--weights {ANY_PAD}"
            )
        if self.pad is not None or self.recipe == "pads":
            from activetouch.perception.described_pads import EXAMPLE  # other readers do not need it

            pad = EXAMPLE if self.pad is None else read_pad(self.pad)
            out = self.out or training_folder("any-pad" if self.pad is None else f"pad-{self.pad.stem}")
            claim_folder(out)
            any_pad = self.pad is None
            given = pad.scene(), out, self.steps, self.change.seed, self.device, self.jobs, pad, any_pad, goes_on
            train_any_object(*given)
            return
        named = named_scene(self.scene)
        if self.recipe == "contacts":
            out = self.out if self.out is not None else training_folder(f"{self.scene}-contacts")
            claim_folder(out)
            train_any_object(named.scene, out, self.steps, self.change.seed, self.device, self.jobs)
            return
        data = self.data if self.data is not None else collection_folder(self.scene)
        out = self.out if self.out is not None else training_folder(self.scene)
        claim_folder(out)
        manifest = open_collection(data, self.scene, repeats=False)
        require_collection(data, manifest, None, self.scene if self.out is None else None)
        size = self.input_size if self.input_size is not None else named.input_size
        backbone = self.backbone if self.backbone is not None else named.backbone
        require_weights(self.weights, backbone)
        train_reader(data, out, self.change.of(RECIPES[self.recipe]), backbone, size, self.jobs, self.weights)


def train_reader(
    data: Path,
    out: Path,
    recipe: TrainingRecipe,
    backbone: str,
    input_size: int,
    jobs: int = 1,
    weights: str | None = None,
) -> TactileReader:
    """Train a network on a collection, or continue; ``input_size`` is the edge that images are brought to [pixels].

    ``weights`` are those of :class:`Train`.
    """
    import torch

    from activetouch.perception.export import export_reader, fixed_hypotheses
    from activetouch.perception.training import Trainer

    manifest = read_manifest(data)
    require_input_size(input_size, manifest.image_shape[0], backbone)
    if recipe.embedding and "aims" in manifest.scene:
        raise BadArgument("poses with aims are read by a reader of any object: train --recipe contacts")
    recipe = in_safe_precision(recipe, input_size)
    torch.set_num_threads(jobs)
    train, calibration = (_split(data, name, input_size) for name in ("train", "calibration"))
    card = card_for(train, backbone, input_size, manifest.shape_labels, manifest.pose_labels, recipe.embedding)
    words = f"{recipe.words}; {len(train.images)} images"
    card = replace(card, scene=manifest.scene, mujoco_version=manifest.versions["mujoco"], training=words)
    classifier = new_classifier(card, recipe.seed, weights)
    print(f"{backbone} at {input_size} pixels, {classifier.card.training}")
    taxels = (manifest.image_shape[0] // train.images.shape[1]) ** 2
    trainer = Trainer(classifier, recipe, train, calibration, out / STATE_FILE, manifest.symmetry, taxels)
    run_to_the_end(trainer)
    classifier = trainer.finish()
    hypotheses = fixed_hypotheses(classifier, train) if recipe.embedding else None
    reader = export_reader(classifier, manifest.image_shape, hypotheses)
    reader.save(out / READER_FILE)
    kept = trainer.best_epoch if recipe.patience is not None else trainer.epochs_done
    print(f"kept epoch {kept}, wrote {out / READER_FILE}")
    return reader


def in_safe_precision(recipe: TrainingRecipe, input_size: int) -> TrainingRecipe:
    """The recipe, in single precision for images for which bfloat16 is too coarse."""
    return replace(recipe, bf16=recipe.bf16 and input_size > 8)


def train_any_object(
    scene: Scene,
    out: Path,
    steps: int | None = None,
    seed: int | None = None,
    device: str = "cpu",
    jobs: int = 1,
    pad: PadDescription | None = None,
    any_pad: bool = False,
    goes_on: bool = False,
) -> TactileReader:
    """Train a reader of any object on random bodies, or continue; ``out`` gets it and the state of the training.

    It reads the sensor of the scene; or all pads that a description allows, where it begins as the shipped reader of
    ``any_pad``, which is trained with random pads, and ``goes_on`` with them if asked.
    """
    import torch

    from activetouch.perception.contact_training import ContactRecipe, ContactTrainer, export
    from activetouch.perception.imaging import imaging_of, imaging_of_pad
    from activetouch.sensor.any_pad import reader_of_pad

    if device == "cuda" and not torch.cuda.is_available():
        raise BadArgument(f"--device cuda: torch {torch.__version__} finds no GPU; leave it out to train on the CPU")
    torch.set_num_threads(max(1, jobs - 1))
    imaging, changes = imaging_of(scene) if pad is None else imaging_of_pad(pad), {"steps": steps, "seed": seed}
    given = {name: value for name, value in changes.items() if value is not None}
    recipe = ContactRecipe.of(imaging, goes_on, any_pad=any_pad, **given)
    start = None if pad is None or (any_pad and not goes_on) else reader_of_pad(pad)
    trainer = ContactTrainer(imaging, recipe, out, device, 1 if jobs > 1 else 0, start)
    with progress_bar() as progress:
        bar = progress.add_task("touching random bodies", total=recipe.steps, completed=trainer.step)
        for report in trainer.run(lambda step: progress.update(bar, completed=step)):
            words = ", ".join(f"{name} {value:g}" for name, value in report.items())
            progress.console.print(words, highlight=False)
    words = f"{trainer.step} steps of {recipe.groups * recipe.touches}"
    reader = export(trainer.network, imaging, scene, words if start is None else f"{start.card.training}, then {words}")
    reader.save(out / ANY_OBJECT_FILE)
    if pad is not None:
        pad.save(out / PAD_FILE)
    use = f"compare --sensor {out}" if pad is None else f"compare --pad FILE.toml --sensor {out}"
    print(f"wrote {out / ANY_OBJECT_FILE}; {out} is a sensor for any objects: {use}")
    return reader


def _split(data: Path, name: str, size: int) -> TouchSet:
    """A split of a collection, its images averaged down to what the network sees where they are larger."""
    touches = read_split(data, name)
    edge = min(size, touches.images.shape[1])
    return replace(touches, images=resized(touches.images, (edge, edge, *touches.images.shape[3:])))


def require_input_size(size: int, edge: int, backbone: str) -> None:
    """Check that images with an ``edge`` can be brought to the ``size`` that a network is to see [pixels]."""
    smallest = BACKBONES[backbone].smallest_image
    if size < smallest:
        raise BadArgument(f"--input-size must be at least {smallest} for the backbone {backbone!r}, got {size}")
    if size % edge and edge % size:
        fitting = [str(n) for n in range(smallest, edge + 1) if edge % n == 0]
        raise BadArgument(
            f"--input-size must divide the {edge} pixels of the images, or be a multiple of them, got {size}; "
            f"{', '.join(fitting) or f'{edge} and its multiples'} do"
        )


def card_for(
    train: TouchSet,
    backbone: str,
    input_size: int,
    shape_labels: tuple[str, ...],
    pose_labels: tuple[str, ...],
    embedding: int = 0,
) -> ClassifierCard:
    """The card of a network to be trained on these touches: channels, mean and spread of images, spread of sizes."""
    from activetouch.perception.card import ClassifierCard

    log_sizes = np.log(train.sizes)
    sample = train.images[:: max(1, len(train.images) // 1000)] / 255.0
    return ClassifierCard(
        backbone=backbone,
        input_size=input_size,
        shape_labels=shape_labels,
        pose_labels=pose_labels,
        channels=train.images.shape[3] if train.images.ndim == 4 else 1,
        pixel_mean=round(float(sample.mean()), 4),
        pixel_std=round(max(float(sample.std()), 1e-3), 4),
        embedding=embedding,
        log_size_mean=round(float(log_sizes.mean()), 4) if embedding else 0.0,
        log_size_std=round(max(float(log_sizes.std()), 1e-3), 4) if embedding else 1.0,
    )


def new_classifier(card: ClassifierCard, seed: int, weights: str | None = None) -> TouchClassifier:
    """A classifier with random weights from a seed, or with published ones of :class:`Train`, as its card then says."""
    import torch

    from activetouch.perception.classifier import TouchClassifier, TouchNetwork

    with torch.random.fork_rng():  # torch draws initial weights from its global generator only
        torch.manual_seed(seed)
        network = TouchNetwork(card)
    start = "random weights" if weights is None else load_weights(network.backbone, card.backbone, weights)
    network.card = replace(card, training=f"{card.training}, from {start}".removeprefix(", "))
    return TouchClassifier(network.card, network)


def load_weights(network: nn.Module, backbone: str, weights: str) -> str:
    """Let a backbone start from published weights; what they are, in words."""
    from activetouch.perception.convnext import ConvNeXtFeatures

    if not isinstance(network, ConvNeXtFeatures):
        raise BadArgument(f"--weights are of a ConvNeXt, and the backbone {backbone!r} is none; add --backbone tiny")
    return network.load_published(weights)


def require_weights(weights: str | None, backbone: str) -> None:
    """Check, before any work, that a network can start from the weights that it is to start from."""
    if weights is not None:
        load_weights(BACKBONES[backbone].build(3), backbone, weights)


def run_to_the_end(trainer: Trainer) -> None:
    """Run the epochs that are left, with a progress bar over all of them, which patience may end early."""
    epochs, images = trainer.recipe.epochs, len(trainer.train.images)
    with progress_bar() as progress:
        bar = progress.add_task("", total=epochs * images, completed=trainer.epochs_done * images)
        while not trainer.is_finished:
            done = trainer.epochs_done
            progress.update(bar, description=f"epoch {done + 1} of {epochs}", completed=done * images)
            report = trainer.run_epoch(partial(progress.advance, bar))
            progress.console.print(report.words, highlight=False)
        progress.remove_task(bar)  # the reports take its place
