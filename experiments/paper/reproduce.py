"""``activetouch reproduce``: the paper's tables and figures and our results."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from activetouch.extras import require_extra
from activetouch.named_scenes import SCENES
from activetouch.perception.recipe import RECIPES
from belief.claims import claim_folder, ends_claims
from belief.errors import CorruptFile
from belief.files import require_regular_file, sealed_json, unsealed_json, write_text
from experiments.command_line.arguments import Count, Jobs, NotEmpty, Pixels, Seed, check_arguments
from experiments.command_line.console import plain_console
from experiments.paper import table1, table2
from experiments.paper.sliding_windows import WindowPlan, kept_windows
from experiments.parallel import default_jobs
from experiments.sensor.train import require_input_size
from experiments.sensor_choice import independent_sensor

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
_TITLES = {
    "table1": "Table 1: the classifier, split by image and by object",
    "table2": "Table 2: success of searches",
    "figure2": "Figure 2: images of every shape",
    "figure3": "Figure 3: confusion matrix, and success by shape",
}

QUICK = table1.Settings(
    WindowPlan(objects=20, presses=2, images=5), "cnn", 32, replace(RECIPES["paper"], epochs=10, learning_rate=1e-3)
)
"""Settings of Table 1 for a look within minutes."""


@dataclass(frozen=True)
class Reproduce:
    """Reproduce the paper's tables and figures; after an interruption, the same command continues.

    Table 1 is made twice with the same images and the paper's recipe: split by image and split by object. Table 2 plays
    the manual rule and PPO on images like the paper's (scene paper). It uses the shipped sensor and policies, or
    those in a folder of your own.

    For example:

        activetouch reproduce                         everything; takes hours, mostly for Table 1
        activetouch reproduce --parts table2 figure3
        activetouch reproduce --parts table1 --weights facebook/convnext-tiny-224
        activetouch reproduce --quick
    """

    parts: Annotated[tuple[Part, ...], NotEmpty()] = ("table1", "table2", "figure2", "figure3")
    """Tables and figures to make."""
    weights: str | None = None
    """Table 1: initial weights of the backbone, as in activetouch train; random weights by default."""
    input_size: Pixels | None = None
    """Table 1: edge of the network's input [pixels]; 128 by default, as in the paper."""
    quick: bool = False
    """Table 1: few images and a small network, for a look within minutes."""
    episodes: Count = 100
    """Table 2: searches per target; the paper uses 100."""
    sensor: Path | None = None
    """Table 2: folder of a sensor with policies, from activetouch calibrate and train-ppo; a shipped one by default."""
    seed: Seed = 0
    """Seed of splits, intervals and searches."""
    out: Path = Path("runs/reproduce")
    """Folder for intermediate files, tables, figures, numbers, and reproduce.md with all tables and figures."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes, and of threads for training."""

    @ends_claims
    def run(self) -> None:
        """Make what is missing, write and print it."""
        check_arguments(self)
        if "table1" in self.parts:
            require_extra("train")
        settings = QUICK if self.quick else table1.Settings(weights=self.weights)
        if self.input_size is not None:
            settings = replace(settings, input_size=self.input_size)
        require_input_size(settings.input_size, SCENES["paper"].scene.image_shape[0], settings.backbone)
        claim_folder(self.out)
        found = reproduce(self.parts, self.out, settings, self.sensor, self.episodes, self.seed, self.jobs)
        found.save(self.out)
        from rich.markdown import Markdown

        plain_console().print(Markdown(str(found)))
        print(f"wrote {self.out}/reproduce.md, and tables and figures beside it")


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Tables and figures of the paper; what was not asked for is None.

    Attributes:
        splits: results of Table 1 by split and set of images.
        columns: results of Table 2.
        images: images that Figure 2 shows.
        confusion: counts that Figure 3(a) shows, if Table 1 was made.
        draws_figure3: whether Figure 3 is drawn.
        arguments: what the results depend on, for the record.
    """

    splits: dict[str, dict[str, table1.Result]] | None
    columns: Sequence[table2.Column] | None
    images: TouchSet | None
    confusion: Sequence[Sequence[int]] | None
    draws_figure3: bool
    arguments: dict[str, Any]

    def __str__(self) -> str:
        return "\n\n".join(f"**{_TITLES[name]}**\n\n{text}" for name, text in self._tables().items())

    def save(self, folder: Path) -> None:
        """Write tables, numbers and figures, and ``reproduce.md`` with all that the folder holds.

        Raises:
            CannotWrite: The disk is full, or the folder is not writable.
        """
        from experiments.paper.figures import draw_figure2, draw_figure3  # loads matplotlib

        labels = SCENES["paper"].scene.shape_labels
        for name, text in self._tables().items():
            write_text(folder / f"{name}.md", text + "\n")
        if self.images is not None:
            draw_figure2(self.images, labels, folder / "figure2.svg")
        if self.splits is not None:
            splits = {n: {what: r.to_dict(labels) for what, r in row.items()} for n, row in self.splits.items()}
            numbers = {"arguments": self.arguments, "splits": splits, "deviations": DEVIATIONS}
            write_text(folder / "table1.json", sealed_json(numbers) + "\n")
        if self.columns is not None:
            columns = json.dumps([asdict(column) for column in self.columns], indent=1, default=dict)
            write_text(folder / "table2.json", columns + "\n")
            if self.draws_figure3:
                draw_figure3(self.confusion, self.columns, folder / "figure3.svg")
        pieces = [
            f"**{title}**\n\n" + (file.read_text() if file.suffix == ".md" else f"![{title}]({file.name})")
            for name, title in _TITLES.items()
            if (file := folder / f"{name}.{'md' if name.startswith('table') else 'svg'}").exists()
        ]
        deviations = "**Deviations from the paper**\n\n" + "\n".join(f"- {line}" for line in DEVIATIONS)
        write_text(folder / "reproduce.md", "\n\n".join([*pieces, deviations]) + "\n")

    def _tables(self) -> dict[str, str]:
        """The tables that were made, in Markdown, by name."""
        found = {}
        if self.splits is not None:
            found["table1"] = table1.table(self.splits, SCENES["paper"].scene.shape_labels).markdown()
        if self.columns is not None:
            origin = f"Sensor and policies of the searches: {self.arguments['sensor']}."
            found["table2"] = f"{origin}\n\n{table2.table(self.columns).markdown()}"
        return found


def reproduce(
    parts: Collection[Part],
    folder: Path,
    settings: table1.Settings,
    sensor: Path | None = None,
    episodes: int = 100,
    seed: int = 0,
    jobs: int = 1,
) -> Reproduction:
    """Make tables and figures of the paper; finished pieces are kept in a folder.

    Args:
        parts: tables and figures to make.
        folder: folder of images, trainings and searches, and of ``table1.json``, which Figure 3(a) shows.
        settings: number of images, and how Table 1 is trained.
        sensor: folder of Table 2's sensor with its policies; the shipped one by default.
        episodes: searches per target of Table 2.
        seed: seed of splits, intervals and searches.
        jobs: number of processes, and of threads for training.

    Raises:
        CorruptFile: A file of an earlier run is damaged.
    """
    scene, kept = SCENES["paper"].scene, folder / "table1"
    images = kept_windows(scene, settings.images, 0, jobs, kept) if {"table1", "figure2"} & {*parts} else None
    first, second = None, None
    if "table1" in parts and images is not None:
        import torch

        torch.set_num_threads(jobs)
        others = kept_windows(scene, settings.images, 1, jobs, kept)
        first = table1.both_splits(settings, scene, images, others, seed, kept)
    if {"table2", "figure3"} & {*parts}:
        chosen = sensor if sensor is not None else independent_sensor("paper")
        second = table2.search_columns(chosen, episodes, seed, folder / "searches" / "paper", jobs)
    arguments = {
        **asdict(settings),
        "sensor": "shipped" if sensor is None else str(sensor),
        "episodes": episodes,
        "seed": seed,
    }
    confusion = first["by image"]["held out"].confusion if first is not None else kept_confusion(folder)
    figure2 = images if "figure2" in parts else None
    return Reproduction(first, second, figure2, confusion, "figure3" in parts, arguments)


def kept_confusion(folder: Path) -> list[list[int]] | None:
    """Confusion counts on held-out images of the classifier split by image, of an earlier run; None without Table 1.

    Raises:
        CorruptFile: ``table1.json`` is damaged.
    """
    file = folder / "table1.json"
    if not file.exists():
        return None
    try:
        splits = unsealed_json(require_regular_file(file).read_text(encoding="utf-8"))["splits"]
        confusion: list[list[int]] = splits["by image"]["held out"]["confusion"]
    except (ValueError, KeyError, TypeError) as error:
        raise CorruptFile(
            f"{file} is damaged ({error}); delete it and make it again with: activetouch reproduce --parts table1 "
            f"--out {folder}"
        ) from error
    return confusion
