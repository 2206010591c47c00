"""``activetouch reproduce``: the paper's tables and its Figure 3 beside our results."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from activetouch.extras import require_extra
from activetouch.named_scenes import SCENES
from belief.constraints import NotEmpty
from belief.files import claim_folder, ends_claims, sealed_json
from experiments.command_line.arguments import Cluster, Count, Jobs, OnCluster, Pixels, Seed, check_arguments
from experiments.command_line.console import plain_console
from experiments.paper import table1, table2
from experiments.paper.table1 import record_windows
from experiments.parallel import default_jobs
from experiments.report import Report, Reported, Section
from experiments.sensor.train import require_input_size, require_weights
from experiments.sensor_choice import independent_sensor

Part = Literal["table1", "table2"]

_RANDOM = "The paper starts from ImageNet weights, we from random weights."
DEVIATIONS = (
    "The paper gives no numbers for its force patches, windows, batch size or rotations. Ours are in "
    "activetouch/rendering/renderer.py, experiments/paper/table1.py and activetouch/perception/recipe.py.",
    _RANDOM,
    "Objects differ in size by ±10 %, so that a split by object is possible. Each press has a new orientation.",
    "Table 2 does not use the classifier of Table 1 but the scene's own, trained on six poses of tumbled objects and "
    "split by object.",
    "We chose the thresholds of the manual rule and its action at the maximum of contacts, and PPO's settings and the "
    "meaning of its β (decision 0031).",
    "All four shapes are targets. The paper names three in one place and four in another.",
    "Figure 3(a) is the classifier of Table 1 that was split by image.",
)


@dataclass(frozen=True)
class Reproduce:
    """Reproduce the paper's tables and its Figure 3; after an interruption, the same command continues.

    Table 1 is made twice with the same images and the paper's recipe: split by image and split by object. Table 2 plays
    the manual rule and PPO on images like the paper's (scene paper). It uses the shipped sensor and policies, or
    those in a folder of your own. Figure 3 shows what was made: success by target, and the confusions of Table 1.

    For example:

        activetouch reproduce                         everything; takes hours, mostly for Table 1
        activetouch reproduce --parts table2
        activetouch reproduce --parts table1 --weights imagenet
    """

    parts: Annotated[tuple[Part, ...], NotEmpty()] = ("table1", "table2")
    """Tables to make."""
    weights: str | None = None
    """Table 1: weights that the network starts from, as in activetouch train: imagenet, as the paper's, or a folder."""
    input_size: Pixels = 128
    """Table 1: edge of the network's input [pixels]; the paper's by default."""
    episodes: Count = 100
    """Table 2: searches per target; the paper uses 100."""
    sensor: Path | None = None
    """Table 2: folder of a sensor with policies, from activetouch calibrate and train-ppo; a shipped one by default."""
    seed: Seed = 0
    """Seed of splits, intervals and searches."""
    out: Path = Path("runs/reproduce")
    """Folder for trainings and searches, report.html, reproduce.md with all tables, figure3.svg, and the numbers."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes, and of threads for training."""
    cluster: OnCluster = field(default_factory=Cluster)
    """Workers of other machines."""

    @ends_claims
    def run(self) -> None:
        """Make what is missing, write and print it."""
        check_arguments(self)
        if "table1" in self.parts:
            require_extra("train")
        settings = table1.Settings(input_size=self.input_size, weights=self.weights)
        require_input_size(settings.input_size, SCENES["paper"].scene.image_shape[0], settings.backbone)
        if "table1" in self.parts:
            require_weights(settings.weights, settings.backbone)
        claim_folder(self.out)
        found = reproduce(self.parts, self.out, settings, self.sensor, self.episodes, self.seed, self.jobs)
        page = found.save(self.out)
        from rich.markdown import Markdown

        plain_console().print(Markdown(str(found)))
        print(f"wrote {page}, and reproduce.md, tables, numbers and figure beside it")


@dataclass(frozen=True, eq=False)
class Reproduction(Reported):
    """Results of Table 1 by split and set of images, and columns of Table 2; None for what was not asked for."""

    splits: dict[str, dict[str, table1.Result]] | None
    columns: Sequence[table2.Column] | None
    arguments: dict[str, Any]

    @property
    def _deviations(self) -> list[str]:
        """Where this differs from the paper."""
        return [line for line in DEVIATIONS if line != _RANDOM or self.arguments.get("weights") is None]

    def report(self) -> Report:
        """The tables beside the paper's and Figure 3, with the numbers in ``table1.json`` and ``table2.json``."""
        sections, files, labels = list[Section](), dict[str, str](), SCENES["paper"].scene.shape_labels
        if self.splits is not None:
            title = "Table 1: the classifier, split by image and by object"
            sections.append(Section(title, (), [table1.table(self.splits, labels)]))
            splits = {n: {what: r.to_dict(labels) for what, r in row.items()} for n, row in self.splits.items()}
            numbers = {"arguments": self.arguments, "splits": splits, "deviations": self._deviations}
            files["table1.json"] = sealed_json(numbers) + "\n"
        if self.columns is not None:
            origin = f"Sensor and policies of the searches: {self.arguments['sensor']}."
            confusion = None if self.splits is None else self.splits["by image"]["held out"].confusion
            own = [table2.table(self.columns)], [table2.figure3(confusion, self.columns)]
            sections.append(Section("Table 2: success of searches", [origin], *own))
            files["table2.json"] = json.dumps([asdict(one) for one in self.columns], indent=1, default=dict) + "\n"
        sections.append(Section("Deviations from the paper", self._deviations))
        return Report("The paper's tables and Figure 3, reproduced", sections, markdown="reproduce.md", files=files)


def reproduce(
    parts: Collection[Part],
    folder: Path,
    settings: table1.Settings,
    sensor: Path | None = None,
    episodes: int = 100,
    seed: int = 0,
    jobs: int = 1,
) -> Reproduction:
    """Make tables of the paper; trainings and searches are kept in a folder and continued.

    ``settings`` are the number of images and the training of Table 1; other arguments are those of :class:`Reproduce`.
    """
    scene = SCENES["paper"].scene
    first, second = None, None
    if "table1" in parts:
        import torch

        torch.set_num_threads(jobs)
        images, others = (record_windows(scene, settings.images, stream, jobs) for stream in (0, 1))
        first = table1.both_splits(settings, scene, images, others, seed, folder / "table1")
    if "table2" in parts:
        chosen = sensor if sensor is not None else independent_sensor("paper")
        second = table2.search_columns(chosen, episodes, seed, folder / "searches" / "paper", jobs)
    played = {"sensor": "shipped" if sensor is None else str(sensor), "episodes": episodes, "seed": seed}
    return Reproduction(first, second, {**asdict(settings), **played})
