"""Images as a worn pad would give them: more dead taxels and more noise than the collection had."""

from __future__ import annotations

import torch
from torch import Tensor


def worn(images: Tensor, dead: float, noise: float, taxels: int, chance: torch.Generator) -> Tensor:
    """Images, half of them changed: each of these with its own share of dead taxels and its own strength of noise.

    A pixel is the mean of some taxels, of which the dead ones read zero. A reader that learns from such images loses
    little where the pad is as it was, and far less than others where it is worn (decision 0069).

    Args:
        images: uint8 ``(B, H, W)`` or ``(B, H, W, channels)``.
        dead: largest share of dead taxels, in [0, 1]; shares are uniform up to it.
        noise: largest standard deviation of a pixel's noise, relative to full scale; uniform up to it, too.
        taxels: of which a pixel is the mean.
        chance: source of chance.
    """
    chosen = torch.nonzero(torch.rand(len(images), generator=chance) < 0.5)[:, 0]
    pixels = images[chosen].float()
    each = (len(chosen), *[1] * (pixels.ndim - 1))
    if dead:
        working = 1.0 - dead * torch.rand(each, generator=chance)
        grid = torch.ones(pixels.shape[:3]).reshape(*pixels.shape[:3], *each[3:])
        pixels = pixels * (torch.binomial(taxels * grid, working * grid, generator=chance) / taxels)
    if noise:
        std = 255.0 * noise * torch.rand(each, generator=chance)
        pixels = pixels + std * torch.randn(pixels.shape, generator=chance)
    images = images.clone()
    images[chosen] = pixels.round().clamp(0, 255).to(torch.uint8)
    return images
