"""``activetouch collect``: record touches, continue after an interruption, or check them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import tyro
from numpy.typing import NDArray

from activetouch import Scene
from activetouch.data.dataset import TouchSet, read_shard, touches_of, write_shard
from activetouch.data.images import image_path, images_of, write_images
from activetouch.data.manifest import CollectionPlan, Manifest, shard_path, write_manifest
from activetouch.scene import require_no_hand
from belief.constraints import Within
from belief.files import claim_folder, ends_claims
from experiments.command_line.arguments import BadArgument, Cluster, Count, Jobs, OnCluster, Seed, check_arguments
from experiments.parallel import Shared, Task, run_tasks
from experiments.scene_choice import SceneChoice, choice_name, collection_folder

_TEMPORARY = ("*/.?????.npz.*.npz", "*/*/.??????-???.png.*.png", ".manifest.json.*.json")  # of atomic_path
_World: TypeAlias = Shared[tuple[Scene, CollectionPlan]]
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
    cluster: OnCluster = field(default_factory=Cluster)
    """Workers of other machines."""
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


@ends_claims
def record(
    scene: Scene, plan: CollectionPlan, folder: Path, jobs: int | None, choice: Mapping[str, Any] | None = None
) -> Manifest:
    """Record what a folder lacks of a collection, and check the rest; the bytes do not depend on ``jobs``."""
    manifest = _begun(folder, scene, plan, choice)
    shared, tasks = Shared((scene, manifest.plan)), list[Task[tuple[TouchSet, str, Path]]]()
    for split, shard, objects in manifest.shards():
        if (path := shard_path(folder, split, shard)).exists():
            read_shard(folder, manifest, split, shard, objects)
        else:
            tasks.append(partial(_record, shared, split, objects, path))
    for recorded in run_tasks(tasks, jobs, f"touching objects → {folder}"):
        write_shard(*recorded)
    return manifest


@ends_claims
def collect_images(choice: SceneChoice, plan: CollectionPlan, folder: Path, jobs: int | None) -> int:
    """Write the images of a plan that a folder lacks (:mod:`activetouch.data.images`); the number of those there."""
    scene = choice.named.scene
    manifest, shared = _begun(folder, scene, plan, choice.to_dict()), Shared((scene, plan))
    objects = [(split, number) for split, _, numbers in manifest.shards() for number in numbers]
    tasks = [partial(_taken, shared, *one) for one in objects if not image_path(folder, scene, *one).exists()]
    for images, split, number in run_tasks(tasks, jobs, f"images of touches → {folder}"):
        write_images(images, folder, scene, split, number)
    return len(list(folder.glob("*/*/*.png")))


def _begun(folder: Path, scene: Scene, plan: CollectionPlan, choice: Mapping[str, Any] | None) -> Manifest:
    """Claim the folder of a collection for this process, and begin or continue it without what a killed run left."""
    require_no_hand(scene.hand, "a collection")
    claim_folder(folder)
    for path in chain.from_iterable(map(folder.glob, _TEMPORARY)):
        path.unlink(missing_ok=True)
    return write_manifest(folder, scene, plan, choice)


def _record(shared: _World, split: str, objects: range, path: Path) -> tuple[TouchSet, str, Path]:
    return touches_of(*shared.value, split, objects), split, path


def _taken(shared: _World, split: str, number: int) -> tuple[list[NDArray[np.uint8]], str, int]:
    return images_of(*shared.value, split, number), split, number
