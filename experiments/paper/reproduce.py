"""``activetouch reproduce``: the paper's tables and figures and our results."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from rich.markdown import Markdown

from activetouch.extras import require_extra
from activetouch.named_scenes import SCENES
from activetouch.perception.recipe import RECIPES
from belief.claims import claim_folder, ends_claims
from belief.errors import CorruptFile
from belief.files import require_regular_file, sealed_json, unsealed_json, write_text
from experiments.command_line.arguments import BadArgument, Count, Jobs, NotEmpty, Pixels, Seed, check_arguments
from experiments.command_line.console import plain_console
from experiments.paper.pipeline import Effort, sensor_from_nothing
from experiments.paper.sliding_windows import WindowPlan, kept_windows
from experiments.parallel import default_jobs
from experiments.scene_choice import in_file_names, named_scene
from experiments.sensor.train import BackboneName, Changes, require_input_size
from planners.registry import find_decider

if TYPE_CHECKING:
    from activetouch.data.dataset import TouchSet

Part = Literal["table1", "table2", "figure2", "figure3"]

DEVIATIONS = (
    "The paper gives no numbers for its force patches, windows, batch size or rotations. Ours are in "
    "activetouch/rendering/force_patch.py, experiments/paper/sliding_windows.py and activetouch/perception/recipe.py.",
    "The paper starts from ImageNet weights. Without --weights we start from random weights.",
    "Objects differ in size by ±10 %, so that a split by object is possible. Each press has a new orientation.",
    "Table 2 does not use the classifier of Table 1 but the scene's own, trained on six poses of tumbled objects and "
    "split by object.",
    "We chose the thresholds of the manual rule and its action at the maximum of contacts (decision 0005), and PPO's "
    "settings and the meaning of its β (decision 0031).",
    "All four shapes are targets. The paper names three in one place and four in another.",
    "Figure 2 shows our renderer; Figure 3(a) is the classifier of Table 1 that was split by image.",
)

_MIN_OBJECTS = 3  # of a shape; with two, both might be held out


@dataclass(frozen=True)
class Reproduce:
    """Reproduce the paper's tables and figures; after an interruption, the same command continues.

    Table 1 is made twice with the same images and the paper's recipe: split by image and split by object. Table 2 plays
    the manual rule and PPO on images like the paper's (scene paper). It uses the shipped sensor and policies;
    --from-nothing trains new ones.

    For example:

        activetouch reproduce                         everything; takes hours, mostly for Table 1
        activetouch reproduce --table 1
        activetouch reproduce --parts table2 figure3
        activetouch reproduce --from-nothing
        activetouch reproduce --parts table1 --weights facebook/convnext-tiny-224 --input-size 128
        activetouch reproduce --parts table1 --backbone cnn --change.epochs 5     (a quick look)
    """

    parts: Annotated[tuple[Part, ...], NotEmpty()] = ("table1", "table2", "figure2", "figure3")
    """Tables and figures to make."""
    table: Literal[1, 2] | None = None
    """Make only this table."""
    backbone: BackboneName = "tiny"
    """Table 1: backbone of the network; the paper uses tiny."""
    input_size: Pixels = 128
    """Table 1: edge of the network's input [pixels]; the paper uses 128."""
    weights: str | None = None
    """Table 1: initial weights of the backbone, as in activetouch train; random weights by default."""
    images: WindowPlan = field(default_factory=WindowPlan)
    """Table 1 and Figure 2: number of images."""
    change: Changes = field(default_factory=Changes)
    """Table 1: changes to the paper's recipe."""
    scenes: Annotated[tuple[str, ...], NotEmpty()] = ("paper",)
    """Table 2: scenes to search in."""
    deciders: Annotated[tuple[str, ...], NotEmpty()] = (
        "threshold",
        "ppo",
        "ppo_confident",
        "ppo_posterior",
        "point_based",
    )
    """Table 2: deciders. The paper's are threshold (its manual rule), ppo, and ppo_confident (its recommendation)."""
    episodes: Count = 100
    """Table 2: searches per target; the paper uses 100."""
    from_nothing: bool = False
    """Table 2: train new sensors and policies instead of using the shipped ones."""
    effort: Effort = field(default_factory=Effort)
    """Size of their data sets and length of their training."""
    seed: Seed = 0
    """Seed of splits, intervals and searches."""
    out: Path = Path("runs/reproduce")
    """Folder for intermediate files, tables, figures, numbers, and reproduce.md with all tables and figures."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes for presses and searches, and of threads for training."""

    @ends_claims
    def run(self) -> None:
        """Make what is missing, write and print it.

        Raises:
            BadArgument: a number is out of its range.
            UnknownName: there is no such scene or decider.
            CannotWrite: there is no room, or no permission.
        """
        from experiments.paper.figures import draw_figure2, draw_figure3
        from experiments.paper.table2 import search_columns, table

        claim_folder(self.out)
        parts = self.parts if self.table is None else (f"table{self.table}",)
        self._check(parts)
        columns = None
        if "figure2" in parts:
            draw_figure2(self._windows(0), SCENES["paper"].scene.shape_labels, self.out / "figure2.svg")
        if {"table2", "figure3"} & {*parts}:
            sensors = {scene: self._sensor(scene) for scene in self.scenes}
            columns = search_columns(sensors, self.deciders, self.episodes, self.seed, self.out / "searches", self.jobs)
            write_text(self.out / "table2.md", f"{self._origin}\n\n{table(columns).markdown()}\n")
            numbers = json.dumps([asdict(column) for column in columns], indent=1, default=dict)
            write_text(self.out / "table2.json", numbers + "\n")
        if "table1" in parts:
            self._table1()
        if "figure3" in parts and columns is not None:
            confusion = self._confusion()
            if confusion is not None or not all(column.missing for column in columns):
                draw_figure3(confusion, columns, self.out / "figure3.svg")
        self._write()

    def _check(self, parts: Sequence[str]) -> None:
        """Check all arguments before any work."""
        from experiments.paper.table2 import PAPER

        check_arguments(self)
        for extra in ("train", "rl") if self.from_nothing else ("train",) if "table1" in parts else ():
            require_extra(extra)
        if self.table is not None and self.parts != type(self).parts:
            raise BadArgument(f"give either --table {self.table} or --parts {' '.join(self.parts)}")
        for scene in self.scenes:
            shapes = named_scene(scene).scene.shape_labels
            if missing := [shape for shape in PAPER["PPO"] if shape not in shapes]:
                raise BadArgument(f"--scenes must have the paper's shapes; {scene} has no {', '.join(missing)}")
        for decider in self.deciders:
            find_decider(decider)
        if "table1" in parts:
            if self.change.of(RECIPES["paper"]).patience is not None:
                raise BadArgument(
                    f"--change.patience {self.change.patience} would choose an epoch by the images that Table 1 tests "
                    "on; leave it out"
                )
            require_input_size(self.input_size, SCENES["paper"].scene.image_shape[0], self.backbone)
            if self.images.objects < _MIN_OBJECTS:
                raise BadArgument(
                    f"--images.objects must be at least {_MIN_OBJECTS} for Table 1, which holds out a fifth of the "
                    f"objects of each shape and trains on the others; got {self.images.objects}"
                )

    def _windows(self, stream: int) -> TouchSet:
        """Images of a stream, recorded once and then read from a file."""
        return kept_windows(SCENES["paper"].scene, self.images, stream, self.jobs, self.out / "table1")

    def _sensor(self, scene: str) -> Path | None:
        if not self.from_nothing:
            return None
        return sensor_from_nothing(scene, self.effort, self.out / "from-nothing" / in_file_names(scene), self.jobs)

    def _table1(self) -> None:
        import torch

        from experiments.paper.figures import draw_confusions
        from experiments.paper.table1 import PAPER, Training, both_splits, table

        torch.set_num_threads(self.jobs)
        scene, recipe = SCENES["paper"].scene, self.change.of(RECIPES["paper"])
        images, others = self._windows(0), self._windows(1)
        training = Training(scene, self.backbone, self.input_size, recipe, self.weights, self.out / "table1")
        results = both_splits(training, images, others, self.seed)
        labels = scene.shape_labels
        arguments = json.loads(json.dumps(asdict(self), default=str))
        numbers = {
            "arguments": {name: value for name, value in arguments.items() if name != "out"},  # no number depends on it
            "recipe": asdict(recipe),
            "num_images": len(images.images),
            "paper": {label: asdict(score) for label, score in PAPER.items()},
            "splits": {n: {what: r.to_dict(labels) for what, r in row.items()} for n, row in results.items()},
            "deviations": DEVIATIONS,
        }
        write_text(self.out / "table1.md", table(results, labels).markdown() + "\n")
        draw_confusions(results, labels, self.out / "table1.svg")
        write_text(self.out / "table1.json", sealed_json(numbers) + "\n")

    def _confusion(self) -> list[list[int]] | None:
        """Confusion counts of the classifier split by image on its held-out images; None without Table 1."""
        file = self.out / "table1.json"
        if not file.exists():
            return None
        try:
            splits = unsealed_json(require_regular_file(file).read_text(encoding="utf-8"))["splits"]
            confusion: list[list[int]] = splits["by image"]["held out"]["confusion"]
        except (ValueError, KeyError, TypeError) as error:
            raise CorruptFile(
                f"{file} is damaged ({error}); delete it and make it again with: activetouch reproduce --table 1 "
                f"--out {self.out}"
            ) from error
        return confusion

    @property
    def _origin(self) -> str:
        """Where the sensors of Table 2 come from."""
        made = f"were trained from nothing in {self.out / 'from-nothing'}"
        shipped = "are the shipped ones; --from-nothing trains new ones"
        return f"Sensors and policies of the searches {made if self.from_nothing else shipped}."

    def _write(self) -> None:
        """Write reproduce.md with all tables and figures in the folder, and print the tables."""
        titles = {
            "table1": "Table 1: the classifier, split by image and by object",
            "table2": "Table 2: success of searches",
        }
        tables = {name: self.out / f"{name}.md" for name in titles}
        pieces = [f"**{titles[name]}**\n\n{file.read_text()}" for name, file in tables.items() if file.exists()]
        captions = {
            "figure2": "Figure 2: images of every shape",
            "figure3": "Figure 3: confusion matrix, and success by shape",
        }
        drawn = [name for name in captions if (self.out / f"{name}.svg").exists()]
        figures = [f"**{captions[name]}**\n\n![{captions[name]}]({name}.svg)" for name in drawn]
        deviations = "**Deviations from the paper**\n\n" + "\n".join(f"- {line}" for line in DEVIATIONS)
        text = "\n\n".join([*pieces, *figures, deviations]) + "\n"
        write_text(self.out / "reproduce.md", text)
        plain_console().print(Markdown("\n\n".join(pieces)))
        print(f"wrote {self.out}/reproduce.md, and tables and figures beside it")
