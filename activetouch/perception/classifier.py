"""The network that reads a tactile image, its checkpoint format, and batched inference.

A checkpoint is one safetensors file: weights in half precision, and in its header everything needed to use them
honestly (:mod:`activetouch.perception.card`) and a SHA-256 of it all. Loading runs no code from the file.
"""

from __future__ import annotations

import copy
import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from activetouch.perception.backbones import BACKBONES
from activetouch.perception.card import FORMAT, ClassifierCard, card_from, parse_card
from belief.errors import CorruptFile
from belief.files import atomic_path


class TouchNetwork(nn.Module):
    """A backbone on tactile images, grey or in colour, with a linear head over the shapes.

    Args:
        card: which backbone, for which images and shapes.
        features: the backbone's network; one with random weights by default.
    """

    def __init__(self, card: ClassifierCard, features: nn.Module | None = None) -> None:
        super().__init__()
        kind = BACKBONES[card.backbone]
        self.card = card
        self.backbone = features if features is not None else kind.build(card.channels)
        self.head = nn.Linear(kind.num_features, len(card.shape_labels))

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Logits ``(B, K)`` and features ``(B, D)`` of uint8 images ``(B, H, W)`` or ``(B, H, W, channels)``."""
        if images.ndim == 3:
            images = images.unsqueeze(-1)
        if images.shape[-1] != self.card.channels:
            raise ValueError(f"the network reads images of {self.card.channels} channels, got {images.shape[-1]}")
        pixels = images.permute(0, 3, 1, 2).float() / 255.0
        found, wanted = pixels.shape[-1], self.card.input_size
        if found % wanted == 0:
            pixels = nn.functional.avg_pool2d(pixels, found // wanted) if found > wanted else pixels
        elif wanted % found == 0:
            pixels = nn.functional.interpolate(pixels, scale_factor=wanted // found, mode="nearest")
        else:
            raise ValueError(
                f"input_size {wanted} is no multiple of the images' {found} pixels, nor the other way round"
            )
        pixels = (pixels - self.card.pixel_mean) / self.card.pixel_std
        pixels = pixels.to(next(self.backbone.parameters()).dtype, memory_format=torch.channels_last)
        features = self.backbone(pixels).float()
        return self.head(features), features


class Reading(NamedTuple):
    """What the network says of N images, from one pass.

    Attributes:
        logits: ``(N, K)`` float64.
        features: the backbone's, before the head, ``(N, D)`` float32; D is 768 for Tiny.
    """

    logits: NDArray[np.float64]
    features: NDArray[np.float32]

    @property
    def labels(self) -> NDArray[np.int64]:
        """Index of the likeliest shape, ``(N,)``."""
        return self.logits.argmax(axis=1)


class TouchClassifier:
    """A trained network, ready to read touches.

    Attributes:
        card: what it was trained for.
        network: the torch module, in evaluation mode.
    """

    def __init__(self, card: ClassifierCard, network: TouchNetwork) -> None:
        self.card = card
        self.network = network.eval().to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch lacks it

    @torch.inference_mode()
    def read(self, images: NDArray[np.uint8], batch_size: int = 64) -> Reading:
        """Logits, features and labels of uint8 images ``(N, H, W)`` or ``(N, H, W, 3)``."""
        if images.ndim not in (3, 4) or images.dtype != np.uint8:
            raise ValueError(
                f"images must be uint8 of shape (N, H, W) or (N, H, W, 3), got {images.dtype} {images.shape}"
            )
        if not len(images):
            raise ValueError("images is empty: there is nothing to read")
        parts = [
            self.network(torch.from_numpy(images[first : first + batch_size]))
            for first in range(0, len(images), batch_size)
        ]
        logits, features = (torch.cat(column).float().numpy() for column in zip(*parts, strict=True))
        return Reading(logits.astype(np.float64), features)

    def to_bfloat16(self) -> TouchClassifier:
        """The same classifier with a backbone that computes in bfloat16: faster where the processor has it."""
        network = copy.deepcopy(self.network)
        network.backbone.to(torch.bfloat16)
        return TouchClassifier(self.card, network)

    def save(self, path: Path) -> None:
        """Write the checkpoint, atomically.

        Raises:
            ValueError: a weight is too large for half precision, or not finite.
        """
        tensors = {name: value.half().contiguous() for name, value in self.network.state_dict().items()}
        for name, value in tensors.items():
            if not bool(torch.isfinite(value).all()):
                raise ValueError(f"the weights {name} are not finite in half precision; did the training diverge?")
        card = json.dumps(asdict(self.card))
        # One entry: several would be written in random order, and the same classifier would not be the same file.
        header = json.dumps({"card": card, "sha256": _digest(card, tensors)})
        with atomic_path(path) as temporary:
            save_file(tensors, temporary, metadata={FORMAT: header})

    @classmethod
    def load(cls, path: Path) -> TouchClassifier:
        """Read a checkpoint.

        Raises:
            CorruptFile: the file is truncated, was changed after it was written, or is not one of ours.
        """
        try:
            with safe_open(path, framework="pt") as file:
                metadata = file.metadata() or {}
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        except (SafetensorError, OSError) as error:
            raise CorruptFile(f"{path} is missing, truncated, or no safetensors checkpoint: {error}") from error
        text, digest = parse_card(metadata, path)
        if digest != _digest(text, tensors):
            raise CorruptFile(f"{path} was changed after it was written: its weights do not match their SHA-256")
        card = card_from(text, path)
        try:
            network = TouchNetwork(card)
            network.load_state_dict(tensors)  # copies half into single precision
        except (KeyError, TypeError, RuntimeError) as error:
            raise CorruptFile(f"{path} does not describe a classifier: {error}") from error
        return cls(card, network)


def _digest(card: str, tensors: Mapping[str, Tensor]) -> str:
    """SHA-256 of a card and of all weights, by name."""
    digest = hashlib.sha256(card.encode())
    for name in sorted(tensors):
        digest.update(name.encode())
        digest.update(tensors[name].numpy().tobytes())
    return digest.hexdigest()
