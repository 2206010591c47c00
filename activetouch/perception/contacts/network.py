"""The two networks of a reader that knows the sensor: f of images, h of predicted contacts in a world.

Their product is log p(image | contact, world) / p(image), up to a constant of the image.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from activetouch.perception.imaging import FEW_PIXELS, STATE_SIZE
from activetouch.perception.learner import mixed_precision
from activetouch.perception.small_convnext import CELLS, Averages, SmallConvNeXt

if TYPE_CHECKING:
    from activetouch.perception.contacts.touches import Batch


class ContactReader(nn.Module):
    """The networks f and h, trained together; ``widths`` are channels of the convolutions of h, ``image_widths`` of f.

    Every other convolution halves the image. Images of few pixels have no convolutions, only the layers after them.
    Those of described pads are read by a ConvNeXt, which also sees the pad's layout
    (:attr:`activetouch.perception.imaging.Imaging.layout`), in which ``layout`` numbers follow on the map of taxels.
    """

    def __init__(
        self,
        widths: tuple[int, ...],
        image_widths: tuple[int, ...],
        dense: int,
        embedding: int,
        pixels: int = 32,
        state_size: int = STATE_SIZE,
        layout: int = 0,
    ) -> None:
        super().__init__()
        is_small = pixels <= FEW_PIXELS and not layout
        self.images: nn.Module = nn.Flatten() if is_small else _convolutions(1, image_widths)
        if layout:
            self.images = SmallConvNeXt(2, image_widths)
            self.of_layout = nn.Linear(layout, dense)
        self.contacts = _convolutions(3 if layout else 2, widths)
        self.of_image = _Head(pixels**2 if is_small else image_widths[-1] * CELLS**2, dense, embedding)
        self.of_contact = _Head(widths[-1] * CELLS**2, dense, embedding)
        self.of_world, self.of_cell = nn.Linear(state_size, dense), nn.Linear(1, dense, bias=False)
        for given in (self.of_world, self.of_cell):
            nn.init.zeros_(given.weight)
        self.embedding, self._scale = embedding, 4 / math.sqrt(embedding)

    def f(self, images: Tensor, layout: Tensor | None = None) -> Tensor:
        """Embeddings ``(B, D)`` of images in [0, 1], ``(B, n, n)``, of a described pad with its layout."""
        return self.embedded(self.first(images, layout))

    def first(self, images: Tensor, layout: Tensor | None = None) -> Tensor:
        """The input of the dense layers of :meth:`f`, ``(B, F)``."""
        seen, pixels = (images * 4 - 0.3)[:, None], images.shape[-1] ** 2
        if layout is not None:
            seen = torch.cat([seen, layout[:pixels].view(1, 1, *images.shape[1:]).expand_as(seen)], dim=1)
        found: Tensor = self.of_image.first(self.images(seen.contiguous(memory_format=torch.channels_last)))
        return found if layout is None else found + self.of_layout(layout[None, pixels:])

    def embedded(self, first: Tensor) -> Tensor:
        """Embeddings ``(B, D)`` of the output of :meth:`first`."""
        return self.of_image.out(first).float() * self._scale

    def h(self, contacts: Tensor, cells: Tensor, codes: Tensor) -> Tensor:
        """Embeddings ``(W, H, D)`` of contacts ``(H, 2 or 3, m, m)``, cells ``(H,)`` and worlds ``(W, state_size)``."""
        shown = self.of_contact.first(self.contacts(contacts.contiguous(memory_format=torch.channels_last)))
        shown = shown + self.of_cell(torch.log(cells / 0.1)[:, None])
        in_worlds = shown + self.of_world(codes)[:, None]
        found: Tensor = self.of_contact.out(in_worlds.flatten(0, 1)).float()
        return found.unflatten(0, in_worlds.shape[:2])


class ImageNetwork(nn.Module):
    """The network of images in a reader: from bytes to the embedding and the features."""

    def __init__(self, network: ContactReader) -> None:
        super().__init__()
        self.network = network

    def forward(self, images: Tensor, layout: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Embeddings ``(B, D)`` and features ``(B, F)`` of images ``(B, n, n)`` in uint8, of a pad with a layout."""
        features = self.network.first(images.float() / 255.0, layout)
        return self.network.embedded(features), features


class ContactNetwork(nn.Module):
    """The network of contacts in several worlds."""

    def __init__(self, network: ContactReader) -> None:
        super().__init__()
        self.network = network

    def forward(self, contacts: Tensor, cells: Tensor, code: Tensor) -> Tensor:
        """See :meth:`ContactReader.h`."""
        return self.network.h(contacts, cells, code)


class _Head(nn.Module):
    """Dense layers with shortcuts; the first is linear, so that the input of a world can be added to it."""

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
    return nn.Sequential(*layers, Averages(), nn.Flatten())


def losses(network: ContactReader, batch: Batch, groups: int, bf16: bool) -> tuple[Tensor, Tensor, Tensor]:
    """Contrast and cross-entropy of the body [nats], and the accuracy of the body, means over the touches that hit."""
    number = len(batch.images)
    with mixed_precision(bf16, batch.images.device.type):
        seen = network.f(batch.images, batch.layout)
        hypotheses = network.h(batch.contacts, batch.cells, batch.codes)
    scores = torch.einsum("bd,whd->bwh", seen, hypotheses)
    own = scores[torch.arange(number, device=scores.device), batch.world]  # (B, H), in the touch's own world
    contrast = torch.logsumexp(scores.flatten(1), 1) - own.diagonal() - math.log(scores[0].numel())
    others = own.masked_fill(torch.eye(*own.shape, dtype=torch.bool, device=own.device), -torch.inf)
    of_body = [part.reshape(number, groups, -1) for part in (others[:, :number], others[:, number:])]
    logits = torch.logsumexp(torch.cat(of_body, dim=2), 2)
    entropy = nn.functional.cross_entropy(logits, batch.bodies, reduction="none")
    accurate = (logits.argmax(1) == batch.bodies).float()
    share = batch.hit / batch.hit.sum()
    return (contrast * share).sum(), (entropy * share).sum(), (accurate * share).sum()
