"""What all trainings share: AdamW or Muon, the rate along a cosine, and a state that a file can hold by name."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.optim import AdamW, Muon, Optimizer


class Learner:
    """A network and its optimizers: AdamW (Loshchilov & Hutter 2019), or Muon (Jordan et al. 2024) for matrices.

    Muon's steps are scaled as by Liu et al. (2025), so that both take the same learning rate. Vectors do not decay.
    """

    def __init__(self, network: nn.Module, weight_decay: float, muon: bool = False) -> None:
        self.network = network
        named = dict(network.named_parameters())
        vectors, matrices, kernels = (
            [p for p in named.values() if low <= p.ndim <= high] for low, high in ((0, 1), (2, 2), (3, math.inf))
        )
        decayed = kernels if muon else matrices + kernels
        groups = [{"params": decayed, "weight_decay": weight_decay}, {"params": vectors, "weight_decay": 0.0}]
        self._optimizers: list[Optimizer] = [AdamW(groups)]
        if muon:
            self._optimizers.append(SingleMuon(matrices, weight_decay=weight_decay))
        with_muon = {id(matrix) for matrix in matrices} if muon else set()
        self._moments = [
            (f"{moment}.{name}", self._optimizers[id(parameter) in with_muon], parameter, moment)
            for name, parameter in named.items()
            for moment in (("momentum_buffer",) if id(parameter) in with_muon else ("exp_avg", "exp_avg_sq"))
        ]

    def gradient(self, loss: Tensor) -> Tensor:
        """Compute the gradient of a loss, cut to length 1, and return its length before."""
        self.network.zero_grad(set_to_none=True)
        torch.autograd.backward(loss)
        return nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)

    def step(self, learning_rate: float) -> None:
        """Change the parameters by their gradients."""
        for optimizer in self._optimizers:
            for group in optimizer.param_groups:
                group["lr"] = learning_rate
            optimizer.step()

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The network as ``model.NAME``, and the optimizers' moments as ``MOMENT.NAME``."""
        tensors = {f"model.{name}": value for name, value in self.network.state_dict().items()}
        tensors |= {key: optimizer.state[parameter][moment] for key, optimizer, parameter, moment in self._moments}
        return {name: value.detach().cpu().contiguous().numpy() for name, value in tensors.items()}

    def restore(self, tensors: Mapping[str, Tensor], steps: int) -> None:
        """Set the state after so many steps from :meth:`arrays`; ``tensors`` may hold others."""
        self.network.load_state_dict(with_prefix(tensors, "model."))
        for key, optimizer, parameter, moment in self._moments:
            optimizer.state[parameter][moment] = tensors[key].to(parameter.device)
            optimizer.state[parameter]["step"] = torch.tensor(float(steps))


class SingleMuon(Muon):
    """Muon in single precision.

    That of torch orthogonalises in bfloat16, whatever the parameters are. Without instructions for it, that takes most
    of the time of a training.
    """

    @torch.no_grad()
    def step(self, closure: Any = None) -> None:  # type: ignore[override]
        """Change the matrices by their gradients, as torch's Muon with Nesterov's momentum."""
        for group in self.param_groups:
            for matrix in group["params"]:
                if matrix.grad is None:
                    continue
                momentum = self.state[matrix].setdefault("momentum_buffer", torch.zeros_like(matrix))
                momentum.lerp_(matrix.grad, 1.0 - group["momentum"])
                update = matrix.grad.lerp(momentum, group["momentum"])
                rate = group["lr"] * 0.2 * math.sqrt(max(matrix.shape))  # as long as a step of AdamW
                matrix.mul_(1.0 - group["lr"] * group["weight_decay"])
                matrix.add_(orthogonalised(update, group["ns_coefficients"], group["ns_steps"]), alpha=-rate)


def orthogonalised(matrix: Tensor, coefficients: tuple[float, float, float], steps: int) -> Tensor:
    """A matrix with the same singular vectors, whose singular values are near 1: iterations of Newton and Schulz."""
    a, b, c = coefficients
    wide = matrix.T if matrix.shape[0] > matrix.shape[1] else matrix
    wide = wide / wide.norm().clamp(min=1e-7)
    for _ in range(steps):
        gram = wide @ wide.T
        wide = torch.addmm(wide, torch.addmm(gram, gram, gram, beta=b, alpha=c), wide, beta=a)
    return wide.T if matrix.shape[0] > matrix.shape[1] else wide


@cache
def has_bfloat16(device: str) -> bool:
    """Whether a device has instructions for bfloat16; processors without them take much longer with it than without.

    Older versions of torch do not say what a processor has: then it is False.
    """
    if device != "cpu":
        return True
    known: Mapping[str, Any] = getattr(torch.cpu, "get_capabilities", dict)()
    return any(known.get(name, False) for name in ("avx512_bf16", "amx_bf16", "bf16"))


def mixed_precision(is_asked: bool, device: str = "cpu") -> torch.autocast:
    """A context in which networks compute in bfloat16, if that is asked and the device can."""
    return torch.autocast(device, torch.bfloat16, enabled=is_asked and has_bfloat16(device))


def falling(along: float) -> float:
    """Share of the highest learning rate after a share of the training: a cosine from 1 to 0."""
    return 0.5 * (1 + math.cos(math.pi * along))


def with_prefix(tensors: Mapping[str, Tensor], prefix: str) -> dict[str, Tensor]:
    """The tensors whose names begin with a prefix, without it."""
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
