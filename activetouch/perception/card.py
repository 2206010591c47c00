"""The card of a reader, what it is and was trained for: the fields of its file, read without its weights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from activetouch.errors import LabelMismatch, WrongScene
from activetouch.perception.imaging import Imaging
from activetouch.scene_description import OBJECTS
from belief.codec import from_fields
from belief.errors import CorruptFile
from belief.sealed_tensors import read_fields
from belief.validation import require_count

READER = "activetouch-reader-1"
"""The kind of file that a sensor has, with a network for ONNX Runtime."""
PRODUCTS = np.triu_indices(9)
"""The pairs of entries of a rotation matrix whose products a network of hypotheses reads, two arrays."""


@dataclass(frozen=True)
class ClassifierCard:
    """What a reader is and what it was trained for.

    Attributes:
        input_size: edge to which an image is averaged down, or repeated up, for the network [pixels].
        pixel_mean, pixel_std: of the training images, in [0, 1]; they centre and scale the input.
        scene: fields of the training's scene (:func:`activetouch.scene_description.scene_fields`); None if unknown.
        image_shape: ``(H, W)`` or ``(H, W, 3)`` of the images for an exported network; empty before the export.
        embedding: length of the embeddings of images and hypotheses; 0 for a network that gives logits of the shapes.
        log_size_mean, log_size_std: they standardise the logarithm of a hypothesis's size.
        imaging: fields of :class:`activetouch.perception.imaging.Imaging`, of a reader of any object, which
            knows no shapes until it is bound to a scene.
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
    image_shape: tuple[int, ...] = ()
    embedding: int = 0
    log_size_mean: float = 0.0
    log_size_std: float = 1.0
    imaging: Mapping[str, Any] | None = None

    @property
    def num_inputs(self) -> int:
        """How many numbers describe a hypothesis: shape, rotation matrix, products of two of its entries, and size."""
        return len(self.shape_labels) + 10 + len(PRODUCTS[0])

    @property
    def described(self) -> Mapping[str, Any] | None:
        """Entries of the description of the pad that it reads; None for the square pad of a scene."""
        return None if self.imaging is None else self.imaging.get("described")

    @property
    def knows_orientations(self) -> bool:
        """Whether it embeds hypotheses about the orientation in front of the pad, so that it works with any poses."""
        return self.embedding > 0

    def in_poses_of(self, scene: Mapping[str, Any]) -> Mapping[str, Any] | None:
        """The fields of its scene, with the poses and the quasistatic hand of another scene if it knows orientations.

        A reader of any object also takes the shapes, aims and presentation of the other scene.
        """
        if self.scene is None or not self.knows_orientations or "poses" not in scene:
            return self.scene
        if self.imaging is None:
            taken = ["poses", *({"hand"} & scene.keys())]
            is_as_closing = self.scene.get("press_model", {}).get("class") == "Dynamic"  # its imprints are quasistatic
            taken += ["press_model"] if "hand" in scene and is_as_closing else []
            return {**self.scene, **{name: scene[name] for name in taken}}
        own = {name: value for name, value in self.scene.items() if name not in OBJECTS}
        return own | {name: scene[name] for name in OBJECTS if name in scene}

    def require_labels(self, shape_labels: tuple[str, ...], pose_labels: tuple[str, ...]) -> None:
        """Check that the reader was trained for these shapes and poses; for any poses if it knows orientations."""
        for what, mine, wanted in (
            ("shapes", self.shape_labels, shape_labels),
            ("poses", self.pose_labels, pose_labels),
        ):
            any_will_do = self.imaging is not None or (what == "poses" and self.knows_orientations)
            if mine != wanted and not any_will_do:
                raise LabelMismatch(
                    f"the reader knows the {what} {list(mine)}, the scene has {list(wanted)}; this scene needs a "
                    "reader of its own"
                )

    def require_images(self, image_shape: tuple[int, ...]) -> None:
        """Check that the network can read images of this shape at all."""
        channels = image_shape[2] if len(image_shape) == 3 else 1
        if channels != self.channels:
            raise WrongScene(f"the reader takes images of {self.channels} channels, those of the scene have {channels}")
        found, wanted = image_shape[0], self.image_shape[0] if self.image_shape else self.input_size
        if self.described is not None:
            return  # the network is told the layout of the pad, whose scene is required elsewhere
        if found % wanted and wanted % found:
            raise WrongScene(
                f"the {wanted} pixels that the reader takes are no multiple of the images' {found}, nor the other way "
                "round"
            )

    def fields(self) -> dict[str, Any]:
        """Its fields, as a file has them; a card that knows orientations names its network of hypotheses too."""
        found = {name: value for name, value in asdict(self).items() if name != "imaging" or value is not None}
        return found | ({"hypothesis_network": self._hypothesis_network} if self.knows_orientations else {})

    @property
    def _hypothesis_network(self) -> str:
        """The kind of its hypothesis network in files, where earlier versions have another (decision 0063)."""
        return "residual" if self.imaging is None else "contacts"


def card_from(fields: Mapping[str, Any], path: Path) -> ClassifierCard:
    """The card from the fields of a file."""
    try:
        own = {name: value for name, value in fields.items() if name != "hypothesis_network"}
        card = from_fields(ClassifierCard, own)
        if card.imaging is not None:
            Imaging.from_fields(card.imaging)
        for name, least in (("input_size", 1), ("channels", 1), ("embedding", 0)):
            require_count(name, getattr(card, name), least)
    except ValueError as error:
        raise CorruptFile(f"{path} does not describe a classifier: {error}") from error
    network, wanted = fields.get("hypothesis_network"), card._hypothesis_network
    if card.knows_orientations and network != wanted:
        raise CorruptFile(
            f"the network of hypotheses in {path} is {network!r}, and only {wanted!r} can be read (readers of earlier "
            "versions have another); train it again"
        )
    return card


def read_card(path: Path) -> ClassifierCard:
    """The card of a reader; the digest of its network is checked when that is loaded."""
    return card_from(read_fields(path, READER), path)
