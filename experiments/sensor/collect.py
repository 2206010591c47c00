"""``activetouch collect``: record touches, continue after an interruption, or check them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import tyro

from activetouch import Scene
from activetouch.data.dataset import read_shard, record_shard
from activetouch.data.images import write_object
from activetouch.data.manifest import CollectionPlan, Manifest, shard_path, write_manifest
from activetouch.scene import require_no_hand
from belief.constraints import Within
from experiments.command_line.arguments import BadArgument, Count, Jobs, Seed, check_arguments
from experiments.parallel import run_tasks
from experiments.scene_choice import SceneChoice, choice_name, collection_folder

_TEMPORARY = ("*/.?????.npz.*.npz", "*/*/.??????-???.png.*.png", ".manifest.json.*.json")  # of atomic_path
ObjectCount: TypeAlias = Annotated[int, Within(0, 2**32 - 1)]


@dataclass(frozen=True)
class PlanArguments:
    """Number of objects of each shape per split, and rounds of touches per object."""

    train: ObjectCount = CollectionPlan.train
    """Objects of each shape for training."""
    calibration: ObjectCount = CollectionPlan.calibration
    """Objects of each shape for calibration."""
    test: ObjectCount = CollectionPlan.test
    """Objects of each shape for testing."""
    seed: Seed = CollectionPlan.seed
    """Seed of the collection."""
    repeats: Count = CollectionPlan.repeats
    """Rounds of all poses per object. 1 is best for training a classifier; 6 measures how strongly repeated touches of
    one object are correlated."""

    @property
    def plan(self) -> CollectionPlan:
        """The arguments as a plan."""
        return CollectionPlan(**asdict(self))


@dataclass(frozen=True)
class Collect:
    """Touch thousands of objects and record the images, split by object into train, calibration and test.

    Finished shards are kept, and checked: an interrupted run, or a killed one, goes on where it stopped when started
    again.

    With --images, the touches of the same objects are PNG files, in folders by split and shape as torchvision's
    ImageFolder reads them. Where presses simulate time and images are force patches (scene paper), each press gives
    ten, from a window that slides over the time of contact.

    For example:

        activetouch collect --scene gel --plan.train 2700
        activetouch collect --scene paper --presentation resampled --images data/paper-images --plan.train 10
            --plan.calibration 0 --plan.test 2       about 700 images of each shape, as in the paper
        activetouch collect --meshes mug.stl --out data/mug
    """

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=SceneChoice)
    """The world."""
    out: Path | None = None
    """Folder of the collection; data/SCENE by default, with the names of meshes."""
    plan: PlanArguments = field(default_factory=PlanArguments)
    """Objects per shape and split, and rounds of poses that each is touched in."""
    jobs: Jobs | None = None
    """Processes; as many as processors by default. The bytes do not depend on it."""
    images: Path | None = None
    """Folder for images as PNG, in place of a collection."""

    def run(self) -> None:
        """Record all missing shards, and check all."""
        check_arguments(self)
        if self.images is not None:
            if self.out is not None:
                raise BadArgument("--images and --out are different outputs; give one of them")
            number = collect_images(self.choice, self.plan.plan, self.images, self.jobs)
            print(f"{self.images} is complete: {number} images")
            return
        name = choice_name(self.choice) if self.choice.meshes or self.choice.family else self.choice.scene
        folder = self.out if self.out is not None else collection_folder(name)
        manifest = collect(self.choice, self.plan.plan, folder, self.jobs)
        print(f"{folder} is complete: {len(list(manifest.shards()))} shards")


def collect(choice: SceneChoice, plan: CollectionPlan, folder: Path, jobs: int | None) -> Manifest:
    """Record what a folder lacks of a collection of a scene that the command line names; see :func:`record`."""
    return record(choice.named.scene, plan, folder, jobs, choice.to_dict())


def record(
    scene: Scene, plan: CollectionPlan, folder: Path, jobs: int | None, choice: Mapping[str, Any] | None = None
) -> Manifest:
    """Record what a folder lacks of a collection, and check the rest; the bytes do not depend on ``jobs``."""
    require_no_hand(scene.hand, "a collection")
    litter = _litter(folder)
    manifest = write_manifest(folder, scene, plan, choice)
    tasks = [partial(_record, folder, scene, manifest, *shard) for shard in manifest.shards()]
    list(run_tasks(tasks, jobs, f"touching objects → {folder}"))
    for path in litter:
        path.unlink(missing_ok=True)
    return manifest


def _litter(folder: Path) -> list[Path]:
    """Temporary files that a killed run left; those that appear later are another process's."""
    return [path for pattern in _TEMPORARY for path in folder.glob(pattern)]


def collect_images(choice: SceneChoice, plan: CollectionPlan, folder: Path, jobs: int | None) -> int:
    """Write the images of a plan that a folder lacks (:mod:`activetouch.data.images`); the number of those there."""
    scene = choice.named.scene
    require_no_hand(scene.hand, "a collection")
    litter, manifest = _litter(folder), write_manifest(folder, scene, plan, choice.to_dict())
    objects = [(split, number) for split, _, numbers in manifest.shards() for number in numbers]
    tasks = [partial(write_object, scene, plan, split, number, folder) for split, number in objects]
    list(run_tasks(tasks, jobs, f"images of touches → {folder}"))
    for path in litter:
        path.unlink(missing_ok=True)
    return len(list(folder.glob("*/*/*.png")))


def _record(folder: Path, scene: Scene, manifest: Manifest, split: str, shard: int, objects: range) -> None:
    """Check a shard, or record it where it is missing."""
    if (path := shard_path(folder, split, shard)).exists():
        read_shard(folder, manifest, split, shard, objects)
    else:
        record_shard(scene, manifest.plan, split, objects, path)
