"""``activetouch reproduce``: what the paper printed, beside what its system does here."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

from rich.console import Console
from rich.markdown import Markdown

from activetouch.atomic import write_text
from activetouch.recipe import RECIPES
from activetouch.scenes import SCENES
from experiments.parallel import default_jobs
from experiments.sliding_windows import WindowPlan, record_windows
from experiments.train import BackboneName, Changes

DEVIATIONS = (
    "The paper gives no numbers for its force patches, its windows, its batch size or its rotations; ours are in "
    "activetouch/rendering/force_patch.py, experiments/sliding_windows.py and activetouch/recipe.py.",
    "The paper starts from ImageNet weights. Without --weights we start from random ones.",
    "Objects differ in size by ±10 %, so that there are objects to split by; each press has a new orientation.",
)


@dataclass(frozen=True)
class Reproduce:
    """Make one of the paper's tables, from nothing; started again, it goes on after the last finished epoch.

    Table 1 is made twice, with the same images and the paper's recipe: once split by image, once by object.

    For example:

        activetouch reproduce --table 1
        activetouch reproduce --table 1 --weights facebook/convnext-tiny-224 --input-size 128
        activetouch reproduce --table 1 --backbone cnn --change.epochs 5     (a quick look)
    """

    table: Literal[1] = 1
    """Which table."""
    backbone: BackboneName = "tiny"
    """The network; the paper's is tiny."""
    input_size: int = 128
    """Edge the images are averaged down to before the network [pixels]; the paper's is 128."""
    weights: str | None = None
    """Where the backbone starts from, as in ``activetouch train``; random weights without."""
    images: WindowPlan = field(default_factory=WindowPlan)
    """How many images."""
    change: Changes = field(default_factory=Changes)
    """What to change about the paper's recipe."""
    seed: int = 0
    """Of the splits and intervals."""
    out: Path = Path("runs/reproduce")
    """Folder for states of the trainings, numbers, table and figure."""
    jobs: int = field(default_factory=default_jobs)
    """Processes that press, threads that train."""

    def run(self) -> None:
        """Press, train twice, read, write and print."""
        import torch

        from experiments.classifier_figures import draw_confusions
        from experiments.table1 import PAPER, Training, both_splits, to_markdown

        torch.set_num_threads(self.jobs)
        scene, recipe = SCENES["paper"].scene, self.change.of(RECIPES["paper"])
        images, fresh = (record_windows(scene, self.images, stream, self.jobs) for stream in (0, 1))
        training = Training(scene, self.backbone, self.input_size, recipe, self.weights, self.out / "table1")
        results = both_splits(training, images, fresh, self.seed)
        labels = scene.shape_labels
        numbers = {
            "arguments": {**asdict(self), "out": str(self.out)},
            "recipe": asdict(recipe),
            "num_images": len(images.images),
            "paper": {label: asdict(score) for label, score in PAPER.items()},
            "splits": {n: {what: r.to_dict(labels) for what, r in row.items()} for n, row in results.items()},
            "deviations": DEVIATIONS,
        }
        table = to_markdown(results, labels)
        for name, text in (("table1.json", json.dumps(numbers, indent=1) + "\n"), ("table1.md", table)):
            write_text(self.out / name, text)
        draw_confusions(results, labels, self.out / "table1.svg")
        Console().print(Markdown(table))
        print(f"wrote {self.out}/table1.md, .json and .svg")
