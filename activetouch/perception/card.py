"""What a classifier is and what it was trained for: the header of its checkpoint, read without its weights."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from activetouch.errors import LabelMismatch, WrongScene
from belief.errors import CorruptFile

FORMAT = "activetouch-classifier-3"
_LONGEST_HEADER = 100_000_000  # bytes, as safetensors has it


@dataclass(frozen=True)
class ClassifierCard:
    """What a classifier is and what it was trained for.

    Attributes:
        backbone: a key of :data:`BACKBONES`.
        input_size: edge the image is averaged down, or repeated up, to before the network sees it [pixels].
        shape_labels, pose_labels: of the scene it was trained on.
        channels: of the images: 1, or 3 in colour.
        pixel_mean, pixel_std: of the images it was trained on, in [0, 1]; they centre and scale the input.
        scene: fields of the scene its images came from (:func:`activetouch.scene_description.scene_fields`); None if
            nobody said.
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
    scene: Mapping[str, Any] | None = None
    mujoco_version: str = ""
    training: str = ""

    def require_labels(self, shape_labels: tuple[str, ...], pose_labels: tuple[str, ...]) -> None:
        """Check that the classifier was trained for these shapes and poses.

        Raises:
            LabelMismatch: it was not; the message names both lists.
        """
        for what, mine, wanted in (
            ("shapes", self.shape_labels, shape_labels),
            ("poses", self.pose_labels, pose_labels),
        ):
            if mine != wanted:
                raise LabelMismatch(
                    f"the classifier knows the {what} {list(mine)}, the scene has {list(wanted)}; this scene needs a "
                    "classifier of its own"
                )

    def require_images(self, image_shape: tuple[int, ...]) -> None:
        """Check that the network can read images of this shape at all.

        Raises:
            WrongScene: it reads others.
        """
        channels = image_shape[2] if len(image_shape) == 3 else 1
        if channels != self.channels:
            raise WrongScene(
                f"the classifier reads images of {self.channels} channels, those of the scene have {channels}"
            )
        found, wanted = image_shape[0], self.input_size
        if found % wanted and wanted % found:
            raise WrongScene(
                f"the classifier's input_size {wanted} is no multiple of the images' {found} pixels, nor the other way "
                "round"
            )


def parse_card(metadata: Mapping[str, str], path: Path) -> tuple[str, str]:
    """The text of a card and the digest beside it, from a checkpoint's metadata.

    Raises:
        CorruptFile: there is no card in them.
    """
    if FORMAT not in metadata:
        raise CorruptFile(f"{path} is no {FORMAT} checkpoint; its header has {sorted(metadata) or 'nothing'}")
    try:
        header = json.loads(metadata[FORMAT])
        card, digest = header["card"], header["sha256"]
        if not isinstance(card, str) or not isinstance(digest, str):
            raise TypeError("card and sha256 must be text")
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise CorruptFile(f"{path} does not describe a classifier: {error!r}") from error
    return card, digest


def card_from(text: str, path: Path) -> ClassifierCard:
    """The card from its text.

    Raises:
        CorruptFile: it does not describe a classifier.
    """
    try:
        fields = json.loads(text)
        for name in ("shape_labels", "pose_labels"):
            fields[name] = tuple(fields[name])
        card = ClassifierCard(**fields)
        if not (card.scene is None or isinstance(card.scene, dict)):
            raise TypeError(f"scene is {card.scene!r}")
        if not (isinstance(card.input_size, int) and card.input_size > 0):
            raise TypeError(f"input_size is {card.input_size!r}")
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise CorruptFile(f"{path} does not describe a classifier: {error!r}") from error
    return card


def read_card(path: Path) -> ClassifierCard:
    """The card of a checkpoint; its digest, which is over card and weights, is checked when the weights are loaded.

    Raises:
        CorruptFile: the file is missing, truncated, or not one of ours.
    """
    try:
        with path.open("rb") as file:
            size = int.from_bytes(file.read(8), "little")
            text = file.read(size) if size <= _LONGEST_HEADER else b""
        metadata = json.loads(text)["__metadata__"]
        if not isinstance(metadata, dict):
            raise TypeError("its metadata are no object")
    except OSError as error:
        raise CorruptFile(f"{path} cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise CorruptFile(f"{path} is truncated, or no safetensors checkpoint: {error!r}") from error
    return card_from(parse_card(metadata, path)[0], path)
