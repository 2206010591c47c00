"""The settings of a training, apart from the training so that reading them loads no torch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from types import MappingProxyType
from typing import Annotated, Literal, TypeAlias

from activetouch.errors import ImpossibleRecipe
from belief.constraints import Count, CountOrNone, NotNegative, Positive, Probability, Within, check

Degrees: TypeAlias = Annotated[float, Within(0.0, 180.0)]


@dataclass(frozen=True)
class TrainingRecipe:
    """The settings of a training; the defaults are the paper's recipe (paper §5.7).

    The paper gives neither its batch size nor the range of its "small rotations"; those two are ours.

    Attributes:
        optimizer: ``"adamw"`` (Loshchilov & Hutter 2019), or ``"muon"`` (Jordan et al. 2024) for the matrices and AdamW
            for the rest: a step takes longer, and fewer are needed.
        learning_rate: peak of the cosine schedule, after ``warmup`` epochs of linear rise.
        weight_decay: on matrices and kernels only.
        class_weights: whether rare shapes count more in the loss, so that all shapes count alike together.
        rotation: largest turn of images either way [degrees], where the scene's symmetry allows it.
        patience: epochs without a lower loss on the calibration split after which training stops, and goes back to the
            best epoch; None to train to the end and keep the last.
        embedding: length of the embeddings of a reader that knows orientations, trained by contrast with ``negatives``
            hypotheses drawn from the prior for every step; 0 for a plain classifier of shapes.
        cell: standard deviation, about each axis, of a random rotation of the touch's own hypothesis [degrees]. The
            network then learns the average over a cell of that size. Sharp images need it, because a table of
            hypotheses has gaps: N orientations are (8 π² / N)^⅓ rad apart, the width of a cell of √12 deviations.
        focus: labels of similar shapes, which are drawn four times as often in training by contrast.
        gain, noise, dead: wear of half of the images, see :func:`activetouch.perception.augmentation.worn`.
    """

    epochs: Count = 30
    optimizer: Literal["adamw", "muon"] = "adamw"
    batch_size: Count = 32
    learning_rate: Positive = 1e-4
    weight_decay: NotNegative = 1e-4
    warmup: float = 0.0
    class_weights: bool = True
    rotation: Degrees = 10.0
    patience: Count | None = None
    embedding: CountOrNone = 0
    negatives: Count = 1536
    cell: Degrees = 0.0
    focus: tuple[str, ...] = ()
    gain: Probability = 0.0
    noise: NotNegative = 0.0
    dead: Probability = 0.0
    bf16: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        check(self, ImpossibleRecipe)
        if not 0.0 <= self.warmup < self.epochs:
            raise ImpossibleRecipe(f"warmup must end before the epochs do, got {self}")
        if self.focus and not self.embedding:
            raise ImpossibleRecipe(f"focus is for learning by contrast, got {self}")

    @property
    def words(self) -> str:
        """The settings that are on, in words."""
        chosen = {name: value for name, value in asdict(self).items() if value or name == "seed"}
        return ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in chosen.items())


_CONTRAST = TrainingRecipe(  # for a reader that knows orientations
    epochs=12,
    batch_size=128,
    learning_rate=2e-3,
    weight_decay=0.01,
    warmup=0.3,
    class_weights=False,
    rotation=0.0,
    patience=3,
    embedding=64,
    cell=5.6,  # that of 2 048 orientations
)

RECIPES: Mapping[str, TrainingRecipe] = MappingProxyType(
    {
        "paper": TrainingRecipe(),
        # For tens of thousands of images from scratch: a higher rate, and no small rotations, which the quarter turns
        # make needless.
        "large": TrainingRecipe(
            epochs=10,
            batch_size=64,
            learning_rate=1e-3,
            weight_decay=0.02,
            warmup=0.5,
            class_weights=False,
            rotation=0.0,
            patience=3,
        ),
        "contrast": _CONTRAST,
        # Half of the images look as those of a worn pad (decision 0063).
        "worn": replace(_CONTRAST, epochs=24, patience=24, optimizer="muon", gain=0.4, noise=0.04, dead=0.25),
    }
)
"""Recipes by name."""
