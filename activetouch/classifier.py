"""The network that reads a tactile image, its checkpoint format, and batched inference.

A checkpoint is one safetensors file: weights in half precision, and in its header everything needed to use them
honestly: shape and pose labels, what the images were, the MuJoCo version they came from, how training ended, and a
SHA-256 of it all. Loading runs no code from the file.
"""

from __future__ import annotations

import copy
import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from activetouch.backbones import BACKBONES
from activetouch.errors import LabelMismatch
from belief.errors import CorruptFile
from belief.files import atomic_path

_FORMAT = "activetouch-classifier-2"


@dataclass(frozen=True)
class ClassifierCard:
    """What a classifier is and what it was trained for; the checkpoint's header.

    Attributes:
        backbone: a key of :data:`BACKBONES`.
        input_size: edge the image is averaged down, or repeated up, to before the network sees it [pixels].
        shape_labels, pose_labels: of the scene it was trained on.
        channels: of the images: 1, or 3 in colour.
        pixel_mean, pixel_std: of the images it was trained on, in [0, 1]; they centre and scale the input.
        images: description of the scene the training images came from.
        mujoco_version: MuJoCo that pressed them.
        training: summary of how training went (epochs, images, losses).
    """

    backbone: str
    input_size: int
    shape_labels: tuple[str, ...]
    pose_labels: tuple[str, ...]
    channels: int = 1
    pixel_mean: float = 0.03
    pixel_std: float = 0.1
    images: str = ""
    mujoco_version: str = ""
    training: str = ""


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
        self.network = network.eval().to(memory_format=torch.channels_last)

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
            save_file(tensors, temporary, metadata={_FORMAT: header})

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
        if _FORMAT not in metadata:
            raise CorruptFile(f"{path} is no {_FORMAT} checkpoint; its header has {sorted(metadata) or 'nothing'}")
        try:
            header = json.loads(metadata[_FORMAT])
            if header["sha256"] != _digest(header["card"], tensors):
                raise CorruptFile(f"{path} was changed after it was written: its weights do not match their SHA-256")
            fields = json.loads(header["card"])
            for name in ("shape_labels", "pose_labels"):
                fields[name] = tuple(fields[name])
            card = ClassifierCard(**fields)
            network = TouchNetwork(card)
            network.load_state_dict(tensors)  # copies half into single precision
        except (KeyError, TypeError, json.JSONDecodeError, RuntimeError) as error:
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


def _digest(card: str, tensors: Mapping[str, Tensor]) -> str:
    """SHA-256 of a card and of all weights, by name."""
    digest = hashlib.sha256(card.encode())
    for name in sorted(tensors):
        digest.update(name.encode())
        digest.update(tensors[name].numpy().tobytes())
    return digest.hexdigest()
