"""AdamW, and where it is asked for Muon for the matrices, with moments that a state file can hold by name."""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from torch import Tensor, nn
from torch.optim import AdamW, Muon, Optimizer


class Optimizers:
    """AdamW (Loshchilov & Hutter 2019) for all parameters, or Muon (Jordan et al. 2024) for matrices, AdamW for others.

    Muon's steps are scaled as Liu et al. (2025) do, so that both take the same learning rate. Vectors do not decay.

    Args:
        network: in training.
        weight_decay: of matrices and kernels.
        muon: whether matrices have Muon.
    """

    def __init__(self, network: nn.Module, weight_decay: float, muon: bool = False) -> None:
        named = dict(network.named_parameters())
        vectors, matrices, kernels = (
            [p for p in named.values() if low <= p.ndim <= high] for low, high in ((0, 1), (2, 2), (3, math.inf))
        )
        decayed = kernels if muon else matrices + kernels
        groups = [{"params": decayed, "weight_decay": weight_decay}, {"params": vectors, "weight_decay": 0.0}]
        self._optimizers: list[Optimizer] = [AdamW(groups)]
        if muon:
            self._optimizers.append(Muon(matrices, weight_decay=weight_decay, adjust_lr_fn="match_rms_adamw"))
        with_muon = {id(matrix) for matrix in matrices} if muon else set()
        self._moments = [
            (f"{moment}.{name}", self._optimizers[id(parameter) in with_muon], parameter, moment)
            for name, parameter in named.items()
            for moment in (("momentum_buffer",) if id(parameter) in with_muon else ("exp_avg", "exp_avg_sq"))
        ]

    def step(self, learning_rate: float) -> None:
        """Change the parameters by their gradients."""
        for optimizer in self._optimizers:
            for group in optimizer.param_groups:
                group["lr"] = learning_rate
            optimizer.step()

    def moments(self) -> dict[str, Tensor]:
        """What the optimizers remember of earlier steps, but for their number: by ``MOMENT.PARAMETER``."""
        return {key: optimizer.state[parameter][moment] for key, optimizer, parameter, moment in self._moments}

    def restore(self, tensors: Mapping[str, Tensor], steps: int) -> None:
        """Go on as after so many steps with these moments; ``tensors`` may hold others."""
        for key, optimizer, parameter, moment in self._moments:
            optimizer.state[parameter][moment] = tensors[key].to(parameter.device)
            optimizer.state[parameter]["step"] = torch.tensor(float(steps))


def with_prefix(tensors: Mapping[str, Tensor], prefix: str) -> dict[str, Tensor]:
    """The tensors whose names begin with a prefix, without it."""
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
