"""Reads tactile images with a trained network, by ONNX Runtime and numpy alone.

A reader is one sealed file (:mod:`belief.sealed_tensors`): a card, a network as an ONNX graph from
uint8 images to an embedding and features, and, where the card has an embedding, the network of hypotheses
(:mod:`activetouch.perception.hypothesis_embedding`). Loading it runs no code from the file.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import WrongScene
from activetouch.orientations import LyingAnyhow
from activetouch.perception.cached_arrays import session_of
from activetouch.perception.card import READER, ClassifierCard, card_from
from activetouch.perception.hypothesis_embedding import Floats32, HypothesisEmbedding
from activetouch.poses import multiply, turned
from activetouch.scene import Scene, require_no_hand
from belief.errors import CorruptFile, InvalidArgument
from belief.files import array_digest
from belief.frozen import frozen
from belief.observation_model.outcome_mixture import Views
from belief.sealed_tensors import read_tensors, write_tensors

if TYPE_CHECKING:
    from activetouch.perception.contacts.hypotheses import Hypotheses
    from activetouch.perception.grasps import GraspHypotheses

INPUT, OUTPUTS = "images", ("embedding", "features")
"""Names of the input and the outputs of the graph of a reader."""
_NETWORK = "network"


class Reading(NamedTuple):
    """What a reader makes of N images in one pass: ``logits (N, K)`` float64, features and embeddings in float32.

    The logits are log p(image | shape) up to a constant of each image. ``features (N, F)`` are the backbone's, before
    the head. ``embeddings (N, D)`` are the features where the card has no embedding.
    """

    logits: NDArray[np.float64]
    features: NDArray[np.float32]
    embeddings: NDArray[np.float32]

    @property
    def labels(self) -> NDArray[np.int64]:
        """Index of the likeliest shape, ``(N,)``."""
        return self.logits.argmax(axis=1)


@dataclass(frozen=True, eq=False)
class TactileReader:
    """A trained network as an ONNX graph; ``hypotheses`` is None for a network that gives logits of the shapes.

    With :class:`activetouch.perception.grasps.GraspHypotheses` it reads the images of grasps, and what it gives for a
    grasp is that of its fingers, one after another.
    """

    card: ClassifierCard
    network: bytes
    hypotheses: Hypotheses | None = None

    def read(self, images: NDArray[np.uint8], batch_size: int = 64) -> Reading:
        """Logits, features and embeddings of uint8 images ``(N, H, W[, 3])``, which are resized to the card's size."""
        embeddings, features = self.run(images, batch_size)
        if self.hypotheses is None:
            return Reading(embeddings.astype(np.float64), features, features)
        return Reading(self.hypotheses.shape_logits(embeddings), features, embeddings)

    def run(self, images: NDArray[np.uint8], batch_size: int = 64) -> tuple[Floats32, Floats32]:
        """Embeddings or logits ``(N, D)``, and features ``(N, F)``, of images as in :meth:`read`."""
        require_stack(images)
        if (grasps := of_grasps(self.hypotheses)) is not None:
            single, stops = grasps.hand.apart(images)
            read = replace(self, hypotheses=grasps.single).run(np.concatenate(single), batch_size)
            embeddings, features = (np.concatenate(np.split(part, len(single)), axis=1) for part in read)
            return np.concatenate([embeddings, grasps.of_travel(stops)], axis=1), features
        images = resized(images, self.card.image_shape)
        parts = [
            session_of(self.network).run(OUTPUTS, {INPUT: np.ascontiguousarray(images[first : first + batch_size])})
            for first in range(0, len(images), batch_size)
        ]
        embeddings, features = map(np.concatenate, zip(*parts, strict=True)) if len(parts) > 1 else parts[0]
        return embeddings, features

    def bound_to(self, scene: Scene) -> TactileReader:
        """A reader of any object for the objects of a scene, or any reader for the hand of a scene."""
        if self.hypotheses is None:
            require_no_hand(scene.hand, "a reader that tells shapes only")
            return self
        single, card = self.hypotheses, self.card
        if (grasps := of_grasps(single)) is not None:  # of another hand
            single = grasps.single
        if card.imaging is not None:
            card = replace(card, shape_labels=scene.shape_labels, pose_labels=scene.pose_labels)
            single = single.bound_to(scene)
        elif scene.hand is not None and scene.hand.offset != "averaged":
            raise WrongScene("only a reader of any object knows positions of a body in the palm; leave offset averaged")
        if scene.hand is None:
            return self if single is self.hypotheses else replace(self, card=card, hypotheses=single)
        from activetouch.perception.grasps import GraspHypotheses

        reach = 0.0 if card.imaging is None else float(card.imaging["offset"])
        return replace(self, card=card, hypotheses=GraspHypotheses(single, scene, reach))

    @cached_property
    def digest(self) -> str:
        """Digest of all that determines what it reads."""
        tensors = {} if self.hypotheses is None else self.hypotheses.tensors()
        return array_digest({_NETWORK: np.frombuffer(self.network, np.uint8), **tensors})

    def save(self, path: Path) -> None:
        """Write the reader, atomically."""
        tensors: dict[str, NDArray[Any]] = {_NETWORK: np.frombuffer(self.network, np.uint8)}
        if self.hypotheses is not None:
            tensors |= self.hypotheses.tensors()
        card = self.card if self.card.imaging is None else replace(self.card, shape_labels=(), pose_labels=())
        write_tensors(path, tensors, card.fields(), READER)

    @classmethod
    def load(cls, path: Path) -> TactileReader:
        """Read a reader from its file."""
        tensors, fields = read_tensors(path, READER)
        card = card_from(fields, path)
        try:
            hypotheses: Hypotheses | None = None
            if card.imaging is not None:
                from activetouch.perception.contacts.hypotheses import ContactHypotheses

                hypotheses = ContactHypotheses.from_tensors(card.imaging, tensors)
            elif card.embedding:
                hypotheses = HypothesisEmbedding.from_tensors(card, tensors)
            reader = cls(card, tensors[_NETWORK].tobytes(), hypotheses)
            reader._require_graph()
        except (KeyError, ValueError) as error:
            raise CorruptFile(f"{path} does not describe a reader: {error}") from error
        return reader

    def _require_graph(self) -> None:
        """Check that the graph reads the card's images, and gives as many numbers as the card says."""
        try:
            inputs, outputs = session_of(self.network).get_inputs(), session_of(self.network).get_outputs()
        except ImportError:
            raise
        except Exception as error:  # the errors of ONNX Runtime have no class in common
            raise ValueError(f"its network is no ONNX graph: {error}") from error
        width = self.card.embedding or len(self.card.shape_labels)
        found = [(part.name, tuple(part.shape[1:])) for part in (*inputs, *outputs[:1])]
        wanted = [(INPUT, self.card.image_shape), (OUTPUTS[0], (width,))]
        if found != wanted or [part.name for part in outputs] != list(OUTPUTS):
            raise ValueError(f"its network is {found}, not {wanted}")


def of_grasps(hypotheses: Hypotheses | None) -> GraspHypotheses | None:
    """The hypotheses if they are of grasps, which alone have a hand."""
    return cast("GraspHypotheses", hypotheses) if hasattr(hypotheses, "hand") else None


def resized(images: NDArray[np.uint8], shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Images, uint8 ``(N, H, W)`` or ``(N, H, W, 3)``, averaged down, or repeated up, to images of a shape."""
    if images.shape[1:] == shape:
        return images
    found, wanted = images.shape[1], shape[0]
    is_stretched = images.shape[2] * wanted != found * shape[1]
    if images.shape[3:] != shape[2:] or is_stretched or (found % wanted and wanted % found):
        raise ValueError(f"the reader takes images of shape {shape}, got {images.shape[1:]}")
    if wanted > found:
        return images.repeat(wanted // found, axis=1).repeat(wanted // found, axis=2)
    blocks = images.reshape(len(images), wanted, found // wanted, wanted, found // wanted, *shape[2:])
    return blocks.mean(axis=(2, 4)).round().astype(np.uint8)


def require_stack(images: NDArray[np.uint8]) -> None:
    """Check that there are images, and that they are of bytes."""
    if images.ndim not in (3, 4) or images.dtype != np.uint8:
        raise ValueError(f"images must be uint8 of shape (N, H, W) or (N, H, W, 3), got {images.dtype} {images.shape}")
    if not len(images):
        raise ValueError("images is empty: there is nothing to read")


_FEW_POSES = 12
_MOST_IN_SINGLE = 1 << 25  # numbers in the tables of all poses


@dataclass(frozen=True, eq=False)
class HypothesisTable:
    """Embeds any number of hypotheses in every pose of a scene."""

    reader: TactileReader
    scene: Scene

    def __call__(self, num_hypotheses: int) -> NDArray[np.float32]:
        """Embedded hypotheses ``(P, K, N, D)``, N of each shape, the same orientations and sizes for all shapes."""
        return np.stack([self._embed(num_hypotheses, pose) for pose in range(len(self.scene.poses))])

    def in_pose(self, num_hypotheses: int, pose: int) -> NDArray[np.floating]:
        """Embedded hypotheses in one pose, ``(K, N, D)``, read-only; in half precision if all poses exceed 128 MB."""
        key = num_hypotheses, pose
        if key not in self._kept:
            found = self._embed(num_hypotheses, pose)
            is_large = len(self.scene.poses) * found.size > _MOST_IN_SINGLE
            self._kept[key] = frozen(found.astype(np.float16) if is_large else found)
        return self._kept[key]

    @cached_property
    def _kept(self) -> dict[tuple[int, int], NDArray[np.floating]]:
        return {}

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_kept"}

    def _embed(self, num_hypotheses: int, pose: int) -> NDArray[np.float32]:
        if self.reader.hypotheses is None:
            raise InvalidArgument("this reader tells shapes only; one that knows orientations is trained with its own")
        return self.reader.hypotheses.embedded(self.scene, self.scene.hypotheses(num_hypotheses), pose)

    @property
    def groups(self) -> tuple[int, ...]:
        """Group of each pose, by its aim; empty for few poses, and if objects do not lie in random orientations."""
        turns_with_body = self.scene.hand is not None and self.scene.hand.offset == "kept"
        few = len(self.scene.poses) <= _FEW_POSES or turns_with_body
        if few or not isinstance(self.scene.presentation, LyingAnyhow):
            return ()
        aims = list(map(tuple, self.scene.aim_offsets.tolist()))
        return tuple(list(dict.fromkeys(aims)).index(aim) for aim in aims)

    def views(self, num_hypotheses: int) -> Views:
        """The hypotheses that look alike in different poses, by orientation."""
        if not self.groups:
            raise WrongScene(
                f"this observation model takes poses as alike, which holds for more than {_FEW_POSES} poses of objects "
                f"that lie anyhow, not for {self.scene!r}. Fit one to touches of this scene (activetouch calibrate)"
            )
        from activetouch.rotation_cells import nearest

        groups, rotations = np.array(self.groups), list(self.scene.rotations.values())
        rests = self.scene.hypotheses(num_hypotheses).rests
        first = np.unique(groups, return_index=True)[1][groups]
        back = [
            multiply(rotations[begin] * (1.0, -1.0, -1.0, -1.0), each)
            for begin, each in zip(first, rotations, strict=True)
        ]
        return Views(groups, np.stack([nearest(turned(rotation, rests), rests) for rotation in back]))
