"""The optimizers of a training, each with its own parameters: AdamW, and where the recipe says so Muon."""

from __future__ import annotations

import math
from collections.abc import Iterator

import torch
from torch import Tensor, nn
from torch.optim import AdamW, Muon, Optimizer

from activetouch.perception.recipe import TrainingRecipe

_MOMENTS = {AdamW: ("exp_avg", "exp_avg_sq"), Muon: ("momentum_buffer",)}


class Optimizers:
    """AdamW (Loshchilov & Hutter 2019) for all parameters, or Muon (Jordan et al. 2024) for matrices, AdamW for others.

    Muon's steps are scaled as Liu et al. (2025) do, so that both take the same learning rate. Vectors do not decay.

    Args:
        network: in training.
        recipe: says which optimizer, and how strongly weights decay.
    """

    def __init__(self, network: nn.Module, recipe: TrainingRecipe) -> None:
        self._names = {parameter: name for name, parameter in network.named_parameters()}
        vectors, matrices, kernels = (
            [p for p in self._names if low <= p.ndim <= high] for low, high in ((0, 1), (2, 2), (3, math.inf))
        )
        rate, decay = recipe.learning_rate, recipe.weight_decay
        decayed = kernels if recipe.optimizer == "muon" else matrices + kernels
        groups = [{"params": decayed, "weight_decay": decay}, {"params": vectors, "weight_decay": 0.0}]
        self._optimizers: list[Optimizer] = [AdamW(groups, lr=rate)]
        if recipe.optimizer == "muon":
            self._optimizers.append(Muon(matrices, lr=rate, weight_decay=decay, adjust_lr_fn="match_rms_adamw"))

    def step(self, learning_rate: float) -> None:
        """Change the parameters by their gradients."""
        for optimizer in self._optimizers:
            for group in optimizer.param_groups:
                group["lr"] = learning_rate
            optimizer.step()

    def moments(self) -> dict[str, Tensor]:
        """What the optimizers remember of earlier steps, but for their number: by ``MOMENT.PARAMETER``."""
        return {
            f"{moment}.{self._names[parameter]}": optimizer.state[parameter][moment]
            for optimizer, parameter in self._owned()
            for moment in _MOMENTS[type(optimizer)]
        }

    def restore(self, tensors: dict[str, Tensor], steps: int) -> None:
        """Go on as after so many steps with these moments; ``tensors`` may hold others."""
        for optimizer, parameter in self._owned():
            name = self._names[parameter]
            saved = {moment: tensors[f"{moment}.{name}"] for moment in _MOMENTS[type(optimizer)]}
            optimizer.state[parameter] = {"step": torch.tensor(float(steps)), **saved}

    def _owned(self) -> Iterator[tuple[Optimizer, nn.Parameter]]:
        for optimizer in self._optimizers:
            for group in optimizer.param_groups:
                for parameter in group["params"]:
                    yield optimizer, parameter
