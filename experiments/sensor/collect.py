"""``activetouch collect``: record touches, continue after an interruption, or check them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import tyro

from activetouch import Scene
from activetouch.data.dataset import CollectionPlan, num_redrawn, read_shard, record_shard, shard_path
from activetouch.data.manifest import Manifest, seal, write_manifest
from activetouch.hand import require_no_hand
from belief.errors import ActiveTouchError
from experiments.command_line.arguments import Jobs, check_arguments
from experiments.command_line.collection_arguments import PlanArguments
from experiments.parallel import run_tasks
from experiments.scene_choice import SceneChoice, collection_folder
from experiments.sensor_commands import choice_name

_TEMPORARY = ("*/.?????.npz.*.npz", ".manifest.json.*.json")  # of atomic_path


class NotReproduced(ActiveTouchError):
    """Lost shards of a collection came out with other bytes."""


@dataclass(frozen=True)
class Collect:
    """Touch thousands of objects and record the images, split by object into train, calibration and test.

    Finished shards are kept: an interrupted run, or a killed one, goes on where it stopped when started again. Once all
    are there, the manifest gets their SHA-256; started again then, the command checks the shards against it.

    For example:

        activetouch collect --scene gel --plan.train 2700
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

    def run(self) -> None:
        """Record all missing shards, and check all."""
        check_arguments(self)
        name = choice_name(self.choice) if self.choice.meshes else self.choice.scene
        folder = self.out if self.out is not None else collection_folder(name)
        manifest = collect(self.choice, self.plan.plan, folder, self.jobs)
        print(f"{folder} is complete: {len(manifest.sha256 or ())} shards, each with the SHA-256 in its manifest")
        if manifest.redrawn:
            print(f"{manifest.redrawn} objects were drawn anew, because a press of the first did not settle")


def collect(choice: SceneChoice, plan: CollectionPlan, folder: Path, jobs: int | None) -> Manifest:
    """Record what a folder lacks of a collection of a scene that the command line names; see :func:`record`."""
    return record(choice.named.scene, plan, folder, jobs, choice.to_dict())


def record(
    scene: Scene, plan: CollectionPlan, folder: Path, jobs: int | None, choice: Mapping[str, Any] | None = None
) -> Manifest:
    """Record what a folder lacks of a collection, check what it had, and return its manifest, digests and all.

    Args:
        scene: whose touches to record.
        plan: how many.
        folder: of the collection.
        jobs: processes; as many as processors if None. The bytes do not depend on it.
        choice: the command line's words for the scene, if there are any.

    Raises:
        LabelMismatch: the folder holds another collection, or a shard names what the collection does not have.
        CorruptFile: a shard is damaged, foreign, or was changed after it was recorded.
        UnstablePress: no object of a shape can be pressed in all poses.
        WrongScene: the scene has a hand.
        NotReproduced: a lost shard of a complete collection came out with other bytes than it had.
    """
    require_no_hand(scene.hand, "a collection")
    # A killed run leaves temporary files of atomic_path behind; those that appear later are another process's.
    litter = [path for pattern in _TEMPORARY for path in folder.glob(pattern)]
    manifest = write_manifest(folder, scene, plan, choice)
    here = {shard: shard_path(folder, *shard[:2]).exists() for shard in manifest.shards()}
    missing = [partial(_record, folder, scene, manifest, *shard) for shard, is_here in here.items() if not is_here]
    checks = [partial(_check, folder, manifest, *shard) for shard, is_here in here.items() if is_here]
    new = list(run_tasks(missing, jobs, f"touching objects → {folder}")) if missing else []
    old = list(run_tasks(checks, jobs, f"checking shards in {folder}")) if checks else []
    sha256 = {name: digest for name, digest, _ in new + old}
    if manifest.sha256 is None:
        manifest = seal(folder, manifest, sha256, sum(redrawn for *_, redrawn in new + old))
    else:
        _require_recorded(folder, manifest, Manifest.of(scene, plan), sha256)
    for path in litter:
        path.unlink(missing_ok=True)
    return manifest


def _record(
    folder: Path, scene: Scene, manifest: Manifest, split: str, shard: int, objects: range
) -> tuple[str, str, int]:
    """What :func:`_check` says of a shard that is recorded now."""
    digest, redrawn = record_shard(scene, manifest.plan, split, objects, shard_path(folder, split, shard))
    return shard_path(Path(), split, shard).as_posix(), digest, redrawn


def _check(folder: Path, manifest: Manifest, split: str, shard: int, objects: range) -> tuple[str, str, int]:
    """Path in the folder, SHA-256, and number of redrawn objects of a sound shard."""
    _, digest = read_shard(folder, manifest, split, shard, objects)
    return shard_path(Path(), split, shard).as_posix(), digest, num_redrawn(shard_path(folder, split, shard))


def _require_recorded(folder: Path, manifest: Manifest, here: Manifest, sha256: Mapping[str, str]) -> None:
    """Refuse shards that were just recorded and are not what the manifest says."""
    differing = {name for name, digest in (manifest.sha256 or {}).items() if sha256[name] != digest}
    if differing:
        raise NotReproduced(
            f"{len(differing)} lost shards of {folder} came out with other bytes than they had: "
            f"{_first_names(sorted(differing))}. {_sentence(manifest.differences(here))}. Restore them from a copy, or "
            "record all in another folder."
        )


def _first_names(names: list[str]) -> str:
    """Names in a row, the first ten at most."""
    return ", ".join(names[:10]) + (f" and {len(names) - 10} more" if len(names) > 10 else "")


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:]
