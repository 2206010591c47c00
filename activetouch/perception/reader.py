"""Reads tactile images with a trained network, by ONNX Runtime and numpy alone.

A reader is one sealed file (:mod:`belief.sealed_tensors`): a card, a network as an ONNX graph from uint8 images to an
embedding and features, and, where the card has an embedding, the residual network of :class:`HypothesisEmbedding`.
Loading it runs no code from the file. :class:`HypothesisTable` holds the hypotheses of a scene's objects, embedded by a
reader, for the joint observation model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from activetouch.distributions import Bodies
from activetouch.errors import WrongScene
from activetouch.orientations import LyingAnyhow
from activetouch.perception.cached_arrays import session_of
from activetouch.perception.card import PRODUCTS, READER, ClassifierCard, card_from
from activetouch.perception.imaging import Floats32, Imaging, regridded
from activetouch.poses import multiply, to_matrices, turned
from activetouch.scene import Scene, require_no_hand
from belief.errors import CorruptFile, InvalidArgument
from belief.files import array_digest
from belief.frozen import frozen
from belief.observation_model.outcome_mixture import Views
from belief.sealed_tensors import read_tensors, write_tensors

if TYPE_CHECKING:
    from activetouch.perception.contacts.hypotheses import Hypotheses
    from activetouch.perception.grasps import GraspHypotheses

_AT_ONCE = 4096  # hypotheses
_CACHED = 1 << 15  # numbers of an array that stay in the cache
_ERFC = tuple(np.float32(c) for c in (1.061405429, -1.453152027, 1.421413741, -0.284496736, 0.254829592))
_IMAGES = 64  # images whose logits are computed at a time
_LAYER, _ROTATIONS, _SIZES = "hypothesis", "hypotheses.rotations", "hypotheses.sizes"
_PARTS = ("weight", "bias")


@dataclass(frozen=True, eq=False)
class HypothesisEmbedding:
    """The network g, and the fixed hypotheses over which shape logits are averaged.

    ``layers`` are weights ``(out, in)`` and biases ``(out,)``. The first reads the one-hot shape, the nine entries of
    the rotation matrix row by row, the standardised log size, and the products of two entries of the matrix. GELU
    follows every layer but the last. Hidden layers but the first read normalised numbers, and add to them. The fixed
    hypotheses, the same for every shape, have ``rotations (M, 3, 3)`` and ``sizes (M,)``.
    """

    card: ClassifierCard
    layers: tuple[tuple[Floats32, Floats32], ...]
    rotations: Floats32
    sizes: Floats32

    def __post_init__(self) -> None:
        card, number = self.card, len(self.sizes)
        shapes = [weight.shape for weight, _ in self.layers]
        widths = [card.num_inputs, *(len(bias) for _, bias in self.layers)]
        fits = shapes == [(width, before) for before, width in pairwise(widths)] and widths[-1] == card.embedding
        fits = fits and len(set(widths[1:-1])) == 1  # hidden layers add to each other
        fits = fits and self.rotations.shape == (number, 3, 3) and number > 0 and bool((self.sizes > 0).all())
        if not fits:
            raise ValueError(
                f"the network of hypotheses must lead from {card.num_inputs} to {card.embedding} numbers by hidden "
                f"layers of one width, and the fixed hypotheses have positive sizes (M,) and rotations (M, 3, 3); "
                f"got layers {shapes}, {number} sizes and rotations {self.rotations.shape}"
            )

    def embed(self, shapes: NDArray[np.int64], rotations: NDArray[Any], sizes: NDArray[Any]) -> Floats32:
        """Embeddings ``(H, D)`` of shapes ``(H,)``, rotations from object to pad ``(H, 3, 3)`` and sizes ``(H,)``."""
        number, num_shapes = len(shapes), len(self.card.shape_labels)
        standard = ((np.log(sizes) - self.card.log_size_mean) / self.card.log_size_std)[:, None]
        found = np.empty((number, self.card.embedding), np.float32)
        for first in range(0, number, _AT_ONCE):
            some = slice(first, first + _AT_ONCE)
            kind = np.eye(num_shapes, dtype=np.float32)[shapes[some]]
            turns = rotations[some].reshape(-1, 9).astype(np.float32)
            products = turns[:, PRODUCTS[0]] * turns[:, PRODUCTS[1]]
            hidden = np.concatenate([kind, turns, standard[some], products], axis=1, dtype=np.float32)
            (weight, bias), *middle = self.layers[:-1]
            hidden = _gelu(hidden @ weight.T + bias)
            for weight, bias in middle:
                hidden += _gelu(_normalised(hidden) @ weight.T + bias)
            weight, bias = self.layers[-1]
            found[some] = hidden @ weight.T + bias
        return found

    def bound_to(self, scene: Scene) -> HypothesisEmbedding:
        """Itself: it knows the shapes of its training, whatever the scene."""
        return self

    def embedded(self, scene: Scene, bodies: Bodies, pose: int) -> Floats32:
        """See :class:`activetouch.perception.contacts.hypotheses.Hypotheses`."""
        rotation = scene.rotations[scene.pose_labels[pose]]
        found = self._of_every_shape(to_matrices(turned(rotation, bodies.rests)), bodies.sizes)
        return found.reshape(len(scene.shapes), len(bodies.rests), -1)

    def _of_every_shape(self, rotations: NDArray[Any], sizes: NDArray[Any]) -> Floats32:
        """Embeddings of N orientations and sizes, shape after shape, ``(K · N, D)``."""
        num_shapes, number = len(self.card.shape_labels), len(sizes)
        shapes = np.repeat(np.arange(num_shapes), number)
        return self.embed(shapes, np.tile(rotations, (num_shapes, 1, 1)), np.tile(sizes, num_shapes))

    @cached_property
    def _fixed(self) -> Floats32:
        return self._of_every_shape(self.rotations, self.sizes)

    def shape_logits(self, embeddings: Floats32) -> NDArray[np.float64]:
        """See :class:`activetouch.perception.contacts.hypotheses.Hypotheses`; the mean is over the fixed hypotheses."""
        fixed, num_shapes, number = self._fixed.T, len(self.card.shape_labels), len(self.sizes)
        logits = np.empty((len(embeddings), num_shapes))
        for first in range(0, len(embeddings), _IMAGES):
            some = slice(first, first + _IMAGES)
            logits[some] = _logsumexp((embeddings[some] @ fixed).reshape(-1, num_shapes, number))
        logits -= np.log(number)
        return logits

    def tensors(self) -> dict[str, NDArray[Any]]:
        """The arrays by name, as a file has them: layers in half precision."""
        found: dict[str, NDArray[Any]] = {_ROTATIONS: self.rotations, _SIZES: self.sizes}
        for number, layer in enumerate(self.layers):
            found |= {f"{_LAYER}.{number}.{name}": p.astype(np.float16) for name, p in zip(_PARTS, layer, strict=True)}
        return found

    @classmethod
    def from_tensors(cls, card: ClassifierCard, tensors: Mapping[str, NDArray[Any]]) -> HypothesisEmbedding:
        """The network from :meth:`tensors`."""
        number = sum(name.startswith(f"{_LAYER}.") for name in tensors) // 2
        parts = [[tensors[f"{_LAYER}.{n}.{part}"].astype(np.float32) for n in range(number)] for part in _PARTS]
        return cls(card, tuple(zip(*parts, strict=True)), tensors[_ROTATIONS], tensors[_SIZES])


def _normalised(x: Floats32) -> Floats32:
    """Rows with mean 0 and variance 1, as torch's layer normalisation makes them."""
    centred = x - x.mean(axis=1, keepdims=True)
    variances = np.einsum("ij,ij->i", centred, centred) / np.float32(x.shape[1])
    centred /= np.sqrt(variances + np.float32(1e-5))[:, None]
    return centred


def _logsumexp(scores: Floats32) -> Floats32:
    """Log of the sum of exponentials along the last axis of finite scores ``(N, K, M)``, which are overwritten."""
    highest = scores.max(axis=2)
    scores -= highest[:, :, None]
    np.exp(scores, out=scores)
    return np.log(scores.sum(axis=2)) + highest


def _gelu(x: Floats32) -> Floats32:
    """GELU, x Φ(x), to 2e-7 |x| (Abramowitz & Stegun 1964, 7.1.26), three times faster than by scipy's ``erf``."""
    found, blocks = np.empty_like(x), -(-x.size // _CACHED)
    for rows, out in zip(np.array_split(x, blocks), np.array_split(found, blocks), strict=True):
        t = np.abs(rows)
        t *= np.float32(0.3275911 * np.sqrt(0.5))
        t += np.float32(1.0)
        np.reciprocal(t, out=t)
        np.multiply(t, _ERFC[0], out=out)
        for coefficient in _ERFC[1:]:
            out += coefficient
            out *= t
        with np.errstate(over="ignore"):
            out *= np.exp(np.square(rows) * np.float32(-0.5))  # twice the probability beyond |x|
        out *= rows * np.float32(0.5)
        np.copysign(out, np.float32(-1.0), out=out)
        out += np.maximum(rows, np.float32(0.0))
    return found


INPUT, LAYOUT, OUTPUTS = "images", "layout", ("embedding", "features")
"""Names of the inputs and the outputs of the graph of a reader; only one of described pads takes a layout."""
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
        told = {} if self._layout is None else {LAYOUT: self._layout}
        images = resized(images, self.card.image_shape, is_any_size=bool(told))
        parts = [
            session_of(self.network).run(OUTPUTS, {INPUT: np.ascontiguousarray(images[i : i + batch_size]), **told})
            for i in range(0, len(images), batch_size)
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
    def _layout(self) -> Floats32 | None:
        """Of the described pad that it reads."""
        if self.card.imaging is None or self.card.described is None:
            return None
        return Imaging.from_fields(self.card.imaging).layout

    @cached_property
    def digest(self) -> str:
        """Digest of all that determines what it reads."""
        tensors = {} if self.hypotheses is None else self.hypotheses.tensors()
        tensors |= {} if self._layout is None else {LAYOUT: self._layout}
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
        found = [(part.name, tuple(part.shape[1:])) for part in (*inputs[:1], *outputs[:1])]
        wanted = [(INPUT, self.card.image_shape), (OUTPUTS[0], (width,))]
        found += [(part.name, tuple(part.shape)) for part in inputs[1:]]
        wanted += [] if self._layout is None else [(LAYOUT, self._layout.shape)]
        if found != wanted or [part.name for part in outputs] != list(OUTPUTS):
            raise ValueError(f"its network is {found}, not {wanted}")


def of_grasps(hypotheses: Hypotheses | None) -> GraspHypotheses | None:
    """The hypotheses if they are of grasps, which alone have a hand."""
    return cast("GraspHypotheses", hypotheses) if hasattr(hypotheses, "hand") else None


def resized(images: NDArray[np.uint8], shape: tuple[int, ...], is_any_size: bool = False) -> NDArray[np.uint8]:
    """Images, uint8 ``(N, H, W)`` or ``(N, H, W, 3)``, averaged down, or repeated up, to images of a shape.

    With ``is_any_size``, squares ``(N, H, H)`` of any number of pixels are averaged over the pixels of the shape.
    """
    if images.shape[1:] == shape:
        return images
    if is_any_size and images.ndim == 3 and images.shape[1] == images.shape[2]:
        return regridded(images.astype(np.float32), shape[0]).round().astype(np.uint8)
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

    def _embed(self, num_hypotheses: int, pose: int) -> NDArray[np.float32]:
        if self.reader.hypotheses is None:
            raise InvalidArgument("this reader tells shapes only; one that knows orientations is trained with its own")
        if num_hypotheses not in self._bodies:
            self._bodies[num_hypotheses] = self.scene.hypotheses(num_hypotheses)
        return self.reader.hypotheses.embedded(self.scene, self._bodies[num_hypotheses], pose)

    @cached_property
    def _bodies(self) -> dict[int, Bodies]:
        return {}

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
