"""Images as a worn pad would give them: another gain, more noise and more dead taxels than the collection had."""

from __future__ import annotations

import torch
from torch import Tensor


def worn(images: Tensor, gain: float, noise: float, dead: float, taxels: int, chance: torch.Generator) -> Tensor:
    """Images, half of them changed: each of these with its own gain, strength of noise and share of dead taxels.

    A pixel is the mean of some taxels, all of which are taken to read what the pixel does, times the gain. Noise is
    added to each of them, their readings are cut to the range of the sensor, and the dead ones read zero. A reader that
    learns from such images loses little where the pad is as it was, and far less than others where it is worn or its
    stiffness is another (decision 0070).

    Args:
        images: uint8 ``(B, H, W)`` or ``(B, H, W, channels)``.
        gain: gains are uniform in 1 ± ``gain``, which is in [0, 1].
        noise: standard deviations of a taxel's noise are uniform in [0, ``noise``], relative to full scale.
        dead: shares of dead taxels are uniform in [0, ``dead``], which is in [0, 1].
        taxels: of which a pixel is the mean.
        chance: source of chance.
    """
    chosen = torch.nonzero(torch.rand(len(images), generator=chance) < 0.5)[:, 0]
    pixels = images[chosen].float()[..., None]
    readings = pixels.expand(*pixels.shape[:-1], taxels)
    each = (len(chosen), *[1] * (readings.ndim - 1))
    if gain:
        readings = readings * (1.0 + gain * (2.0 * torch.rand(each, generator=chance) - 1.0))
    if noise:
        std = 255.0 * noise * torch.rand(each, generator=chance)
        readings = readings + std * torch.randn(readings.shape, generator=chance)
    readings = readings.clamp(0.0, 255.0)
    if dead:
        grid = (*images.shape[1:3], *each[3:-1], taxels)  # the channels of a taxel die together
        share = dead * torch.rand(each, generator=chance)
        readings = readings * (torch.rand((len(chosen), *grid), generator=chance) >= share)
    images = images.clone()
    images[chosen] = readings.mean(-1).round().to(torch.uint8)
    return images
