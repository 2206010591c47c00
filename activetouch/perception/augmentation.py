"""Changes of training images: those that do not change what they are images of, and the wear of a pad.

Each is allowed by a symmetry of the scene (:class:`activetouch.scene.Symmetry`), and left out where the scene lacks it:

* *quarter turns*: where orientation is uniform over SO(3) and the sensor treats all directions alike, a turned image is
  exactly as likely as the original, and taxels fall on taxels;
* *mirror image*: where moreover every shape is its own mirror image, so is the image of its touch;
* *small rotations* (paper §5.7): allowed for the same reason as quarter turns, but taxels fall between taxels, and what
  a corner shows after the turn was never felt; it is filled with the nearest edge. Hence only small ones.

Scaling, shifting, or changing brightness would not do: size, force and offset mean something.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import affine_grid, grid_sample

from activetouch.scene import Symmetry


def augment(images: Tensor, symmetry: Symmetry, rotation: float, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Images under random symmetries, and the angle of each about the approach axis [rad], ``(B,)``.

    A batch, uint8 ``(B, H, W)`` or ``(B, H, W, channels)``, is turned by one quarter turn and mirrored or not; each
    image is turned by up to ``rotation`` degrees either way. The angle is the turn of the object that would give the
    image, without the mirroring. What is drawn from the generator does not depend on ``symmetry``.
    """
    turns, flip = int(torch.randint(4, (), generator=generator)), bool(torch.rand((), generator=generator) < 0.5)
    angles = torch.zeros(len(images))
    if symmetry is Symmetry.NONE:
        return images, angles
    if rotation:
        angles = torch.deg2rad((2 * torch.rand(len(images), generator=generator) - 1) * rotation)
        images = _rotated(images, angles)
    images = torch.rot90(images, turns, dims=(1, 2))
    images = images.flip(2) if flip and symmetry is Symmetry.ROTATIONS_AND_MIRROR else images
    return images, -(turns * (torch.pi / 2) + angles)


def _rotated(images: Tensor, angles: Tensor) -> Tensor:
    """Every image turned by its own angle [rad] about the centre, interpolated linearly."""
    pixels = (images.unsqueeze(-1) if images.ndim == 3 else images).permute(0, 3, 1, 2).float()
    cosine, sine, zero = torch.cos(angles), torch.sin(angles), torch.zeros_like(angles)
    turn = torch.stack([torch.stack([cosine, -sine, zero], 1), torch.stack([sine, cosine, zero], 1)], 1)  # (B, 2, 3)
    grid = affine_grid(turn, list(pixels.shape), align_corners=False)
    turned = grid_sample(pixels, grid, padding_mode="border", align_corners=False)
    return turned.round().to(torch.uint8).permute(0, 2, 3, 1).reshape(images.shape)


def worn(images: Tensor, gain: float, noise: float, dead: float, taxels: int, chance: torch.Generator) -> Tensor:
    """Images, uint8 ``(B, H, W)`` or ``(B, H, W, channels)``, half of them changed as by a worn pad.

    A pixel is the mean of ``taxels`` taxels, which are all taken to read the pixel's value times a gain, uniform in
    1 ± ``gain``. Noise with a standard deviation of up to ``noise``, relative to full scale, is added to each taxel,
    the readings are clipped, and a share of up to ``dead`` reads zero. Each changed image has its own gain, noise and
    share. A reader that learns from such images loses little on a pad in its original state, and far less than others
    on a pad that is worn or of another stiffness (decision 0063).
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
