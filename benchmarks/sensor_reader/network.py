"""The two networks of a reader that knows the sensor: f of images, h of predicted contacts in a world.

Their product is log p(image | contact, world) / p(image), up to a constant of the image.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from benchmarks.sensor_reader.touches import WORLD

_CELLS = 4  # along the edge, over which the last convolution is averaged
_FEW_PIXELS = 8  # along the edge of an image


class ContactReader(nn.Module):
    """f and h, trained together.

    Args:
        widths: channels after each convolution; every other one halves the image. Images of few pixels are read by the
            layers after the convolutions alone.
        dense: width of the layers after them.
        embedding: numbers of an embedding.
        pixels: along the edge of an image.
    """

    def __init__(self, widths: tuple[int, ...], dense: int, embedding: int, pixels: int = 32) -> None:
        super().__init__()
        is_small = pixels <= _FEW_PIXELS
        self.images = nn.Flatten() if is_small else _convolutions(1, widths)
        self.contacts = _convolutions(2, widths)
        features = widths[-1] * _CELLS**2
        self.of_image = _Head(pixels**2 if is_small else features, dense, embedding)
        self.of_contact = _Head(features, dense, embedding)
        self.of_world = nn.Linear(WORLD + 1, dense)
        nn.init.zeros_(self.of_world.weight)
        self._scale = 4 / math.sqrt(embedding)

    def f(self, images: Tensor) -> Tensor:
        """Embeddings ``(B, D)`` of images in [0, 1], ``(B, n, n)``."""
        seen = (images[:, None] * 4 - 0.3).contiguous(memory_format=torch.channels_last)
        return self.of_image.out(self.of_image.first(self.images(seen))).float() * self._scale

    def h(self, contacts: Tensor, cells: Tensor, codes: Tensor) -> Tensor:
        """Embeddings ``(W, H, D)`` of contacts ``(H, 2, m, m)`` for cells ``(H,)``, in worlds ``(W, WORLD)``."""
        shown = self.of_contact.first(self.contacts(contacts.contiguous(memory_format=torch.channels_last)))
        width = torch.log(cells / 0.1)[:, None]
        told = nn.functional.linear(codes, self.of_world.weight[:, 1:], self.of_world.bias)
        shown = shown + width * self.of_world.weight[:, 0]
        return self.of_contact.out(shown + told[:, None]).float()


class _Head(nn.Module):
    """Dense layers with shortcuts; the first is linear, so that what is known of a world can be added to it."""

    def __init__(self, features: int, dense: int, embedding: int) -> None:
        super().__init__()
        self.first = nn.Linear(features, dense)
        self.layers = nn.ModuleList([nn.Linear(dense, dense) for _ in range(2)])
        self.norms = nn.ModuleList([nn.LayerNorm(dense) for _ in range(2)])
        self.last = nn.Linear(dense, embedding)

    def out(self, first: Tensor) -> Tensor:
        x = nn.functional.gelu(first)
        for layer, norm in zip(self.layers, self.norms, strict=True):
            x = x + nn.functional.gelu(layer(norm(x)))
        return self.last(x)


def _convolutions(channels: int, widths: tuple[int, ...]) -> nn.Sequential:
    layers: list[nn.Module] = []
    for number, (width_in, width_out) in enumerate(zip((channels, *widths), widths, strict=False)):
        layers += [nn.Conv2d(width_in, width_out, 3, stride=2 if number % 2 == 0 else 1, padding=1), nn.GELU()]
    return nn.Sequential(*layers, nn.AdaptiveAvgPool2d(_CELLS), nn.Flatten())


def losses(network: ContactReader, batch: dict[str, Tensor], bf16: bool) -> tuple[Tensor, Tensor, Tensor]:
    """Contrast and cross-entropy of the body [nats], and the accuracy of the body, means over the touches that hit.

    Args:
        network: f and h.
        batch: the arrays of a :class:`Batch` by name.
        bf16: whether the networks compute in half precision.
    """
    images, world, bodies, hit = batch["images"], batch["world"], batch["bodies"], batch["hit"]
    number, groups = len(images), int(bodies[-1]) + 1
    with torch.autocast(images.device.type, torch.bfloat16, enabled=bf16):
        seen = network.f(images)
        hypotheses = network.h(batch["contacts"], batch["cells"], batch["codes"])
    scores = torch.einsum("bd,whd->bwh", seen, hypotheses)
    rows = torch.arange(number, device=images.device)
    own = scores[rows, world]  # (B, H), the hypotheses in the touch's own world
    true = own.diagonal()
    contrast = torch.logsumexp(scores.flatten(1), 1) - true - math.log(scores[0].numel())
    others = own.masked_fill(torch.eye(number, dtype=torch.bool, device=own.device), -torch.inf)
    logits = torch.logsumexp(others.reshape(number, groups, -1), 2)
    entropy = nn.functional.cross_entropy(logits[hit], bodies[hit])
    return contrast[hit].mean(), entropy, (logits.argmax(1) == bodies)[hit].float().mean()
