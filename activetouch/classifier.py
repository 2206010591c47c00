"""The network that reads a tactile image: ConvNeXt, its checkpoint format, and batched inference.

A checkpoint is one safetensors file: weights in half precision, and in its header everything needed to use them
honestly: shape and pose labels, what the images were, the MuJoCo version they came from, how training ended.
Loading runs no code from the file.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from activetouch.atomic import atomic_path
from activetouch.errors import CorruptFile, LabelMismatch

_FORMAT = "activetouch-classifier-1"
# Mean and standard deviation of a touch image in [0, 1]; they only centre the input, so round values do.
_PIXEL_MEAN, _PIXEL_STD = 0.03, 0.1


@dataclass(frozen=True)
class Backbone:
    """Stage depths and widths of a ConvNeXt (Liu et al. 2022; Woo et al. 2023 for the sizes below Tiny)."""

    depths: tuple[int, int, int, int]
    widths: tuple[int, int, int, int]


BACKBONES = {
    "atto": Backbone((2, 2, 6, 2), (40, 80, 160, 320)),
    "femto": Backbone((2, 2, 6, 2), (48, 96, 192, 384)),
    "pico": Backbone((2, 2, 6, 2), (64, 128, 256, 512)),
    "nano": Backbone((2, 2, 8, 2), (80, 160, 320, 640)),
    "tiny": Backbone((3, 3, 9, 3), (96, 192, 384, 768)),
}


@dataclass(frozen=True)
class ClassifierCard:
    """What a classifier is and what it was trained for; the checkpoint's header.

    Attributes:
        backbone: a key of :data:`BACKBONES`.
        input_size: edge the image is averaged down, or repeated up, to before the network sees it [pixels].
        shape_labels, pose_labels: of the scene it was trained on.
        channels: of the images: 1, or 3 in colour.
        images: description of the scene the training images came from.
        mujoco_version: MuJoCo that pressed them.
        training: summary of how training went (epochs, images, losses).
    """

    backbone: str
    input_size: int
    shape_labels: tuple[str, ...]
    pose_labels: tuple[str, ...]
    channels: int = 1
    images: str = ""
    mujoco_version: str = ""
    training: str = ""


class TouchNetwork(nn.Module):
    """ConvNeXt on tactile images, grey or in colour, with a linear head over the shapes."""

    def __init__(self, backbone: Backbone, num_shapes: int, input_size: int, channels: int = 1) -> None:
        from transformers import ConvNextConfig, ConvNextModel  # slow to import, so only here

        super().__init__()
        self.input_size, self.channels = input_size, channels
        self.backbone = ConvNextModel(
            ConvNextConfig(num_channels=channels, depths=list(backbone.depths), hidden_sizes=list(backbone.widths))
        )
        self.head = nn.Linear(backbone.widths[-1], num_shapes)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Logits ``(B, K)`` and features ``(B, D)`` of uint8 images ``(B, H, W)`` or ``(B, H, W, channels)``."""
        if images.ndim == 3:
            images = images.unsqueeze(-1)
        if images.shape[-1] != self.channels:
            raise ValueError(f"the network reads images of {self.channels} channels, got {images.shape[-1]}")
        pixels = images.permute(0, 3, 1, 2).float() / 255.0
        found, wanted = pixels.shape[-1], self.input_size
        if found % wanted == 0:
            pixels = nn.functional.avg_pool2d(pixels, found // wanted) if found > wanted else pixels
        elif wanted % found == 0:
            pixels = nn.functional.interpolate(pixels, scale_factor=wanted // found, mode="nearest")
        else:
            raise ValueError(
                f"input_size {wanted} is no multiple of the images' {found} pixels, nor the other way round"
            )
        pixels = ((pixels - _PIXEL_MEAN) / _PIXEL_STD).contiguous(memory_format=torch.channels_last)
        features = self.backbone(pixels).pooler_output
        return self.head(features), features


class TouchClassifier:
    """A trained network, ready to read touches.

    Attributes:
        card: what it was trained for.
        network: the torch module, in evaluation mode.
    """

    def __init__(self, card: ClassifierCard, network: TouchNetwork) -> None:
        self.card = card
        self.network = network.eval().to(memory_format=torch.channels_last)

    @torch.inference_mode()
    def read(self, images: NDArray[np.uint8], batch_size: int = 64) -> tuple[NDArray, NDArray]:
        """Logits ``(N, K)`` float64, features ``(N, D)`` float32, of uint8 images ``(N, H, W)`` or ``(N, H, W, 3)``."""
        if images.ndim not in (3, 4) or images.dtype != np.uint8:
            raise ValueError(
                f"images must be uint8 of shape (N, H, W) or (N, H, W, 3), got {images.dtype} {images.shape}"
            )
        parts = [
            self.network(torch.from_numpy(images[first : first + batch_size]))
            for first in range(0, len(images), batch_size)
        ]
        if not parts:
            raise ValueError("images is empty: there is nothing to read")
        logits, features = (torch.cat(column).float().numpy() for column in zip(*parts, strict=True))
        return logits.astype(np.float64), features

    def save(self, path: Path) -> None:
        """Write the checkpoint, atomically."""
        tensors = {name: value.half().contiguous() for name, value in self.network.state_dict().items()}
        with atomic_path(path) as temporary:
            # One entry: several would be written in random order, and the same classifier would not be the same file.
            save_file(tensors, temporary, metadata={_FORMAT: json.dumps(asdict(self.card))})

    @classmethod
    def load(cls, path: Path) -> TouchClassifier:
        """Read a checkpoint.

        Raises:
            CorruptFile: the file is truncated, tampered with or not one of ours.
        """
        try:
            with safe_open(path, framework="pt") as file:
                header = file.metadata() or {}
                tensors = {name: file.get_tensor(name).float() for name in file.keys()}  # noqa: SIM118
        except (SafetensorError, OSError) as error:
            raise CorruptFile(f"{path} is no readable safetensors checkpoint: {error}") from error
        if _FORMAT not in header:
            raise CorruptFile(f"{path} is no {_FORMAT} checkpoint; its header has {sorted(header) or 'nothing'}")
        try:
            fields = json.loads(header[_FORMAT])
            for name in ("shape_labels", "pose_labels"):
                fields[name] = tuple(fields[name])
            card = ClassifierCard(**fields)
            network = TouchNetwork(BACKBONES[card.backbone], len(card.shape_labels), card.input_size, card.channels)
            network.load_state_dict(tensors)
        except (KeyError, TypeError, ValueError, RuntimeError) as error:
            raise CorruptFile(f"{path} does not describe a classifier: {error}") from error
        return cls(card, network)

    def require_labels(self, shape_labels: tuple[str, ...], pose_labels: tuple[str, ...]) -> None:
        """Check that the classifier was trained for these shapes and poses.

        Raises:
            LabelMismatch: it was not; the message names both lists.
        """
        for what, mine, wanted in (
            ("shapes", self.card.shape_labels, shape_labels),
            ("poses", self.card.pose_labels, pose_labels),
        ):
            if mine != wanted:
                raise LabelMismatch(
                    f"the classifier knows the {what} {list(mine)}, the scene has {list(wanted)}. Train one for "
                    "this scene (activetouch collect, then activetouch train)."
                )
