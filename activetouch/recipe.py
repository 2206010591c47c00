"""The settings of a training, apart from the training so that reading them loads no torch."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class TrainingRecipe:
    """How to train.

    Attributes:
        epochs: passes over the training split.
        batch_size: images a step.
        learning_rate: peak of the cosine schedule, after ``warmup`` epochs of linear rise.
        weight_decay: of AdamW, on matrices and kernels only.
        bf16: compute in bfloat16 where it is safe.
        seed: of shuffling, augmentation and initialisation.
    """

    epochs: int = 10
    batch_size: int = 64
    learning_rate: float = 1e-3
    weight_decay: float = 0.02
    warmup: float = 0.5
    bf16: bool = True
    seed: int = 0
