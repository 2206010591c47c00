"""Hypotheses of any object, embedded by the contacts that their geometry predicts."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from importlib.metadata import version
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from activetouch.distributions import Bodies
from activetouch.perception.cached_arrays import cached_array, session_of
from activetouch.perception.imaging import Floats32, Imaging, encoded, sensor_state
from activetouch.poses import turned
from activetouch.pressing.height_maps import predicted_contacts
from activetouch.scene import Scene
from activetouch.scene_description import scene_fields
from activetouch.solids.solid import Shape
from belief.files import array_digest

CONTACTS = ("contacts", "cells", "code")
"""Names of the inputs of the graph of contacts."""
EMBEDDING = "embedding"
"""Name of its output."""
_NETWORK = "contacts"
_AT_ONCE = 256  # contacts
_MOST_SCORES = 1 << 22  # of images and hypotheses at once, 32 MB
_DECIMALS = 7
FEWEST, MOST = 1024, 4096
"""Least and largest number of hypotheses of each shape in a model of new objects."""
CONTACTS_IN_ALL = 300_000
"""Largest number of predicted contacts of all shapes in all poses: two to three minutes of one core."""


class Hypotheses(Protocol):
    """Embeds hypotheses about an object: its shape, its orientation, and its size.

    The product of the embeddings of an image and of a hypothesis is log p(image | hypothesis) / p(image), up to a
    constant of the image.
    """

    def bound_to(self, scene: Scene) -> Hypotheses:
        """The embedder for the objects of a scene; one of fixed objects returns itself."""

    def embedded(self, scene: Scene, bodies: Bodies, pose: int) -> Floats32:
        """Embeddings of N hypotheses of each of the K shapes of a scene, in one of its poses, ``(K, N, D)``."""

    def shape_logits(self, embeddings: Floats32) -> NDArray[np.float64]:
        """Log p(image | shape) / p(image) of the embeddings of N images, ``(N, K)``: the mean ratio of each shape."""

    def tensors(self) -> dict[str, NDArray[Any]]:
        """The arrays by name, as a file has them."""


@dataclass(frozen=True, eq=False)
class ContactHypotheses:
    """Embeds hypotheses of any objects by an ONNX graph; ``scene`` has the objects, None until :meth:`bound_to`."""

    imaging: Imaging
    network: bytes
    scene: Scene | None = field(default=None, repr=False)

    def bound_to(self, scene: Scene) -> ContactHypotheses:
        """The same for the objects of a scene, in the state of the sensor that the scene describes."""
        return replace(self, scene=scene)

    def code(self, scene: Scene) -> Floats32:
        """The code of the state of the sensor that a scene describes, ``(1, state_size)``."""
        return self.imaging.code(sensor_state(self.imaging, scene))

    def embedded(self, scene: Scene, bodies: Bodies, pose: int) -> Floats32:
        """See :class:`activetouch.perception.contacts.hypotheses.Hypotheses`."""
        return self.embedded_in(scene, bodies, pose, self.code(scene))[0]

    def embedded_in(self, scene: Scene, bodies: Bodies, pose: int, codes: Floats32) -> Floats32:
        """Embeddings in one pose, for W states of the sensor with ``codes (W, state_size)``, ``(W, K, N, D)``."""
        rotation, cell = scene.rotations[scene.pose_labels[pose]], cell_of(len(bodies.rests))
        window, aim = self.imaging.wide_window, scene.aim_offsets[pose]

        def embed_solid(solid: Shape, chosen: Bodies) -> Floats32:
            found, turns = [], turned(rotation, chosen.rests)
            for first in range(0, len(turns), _AT_ONCE):
                some = slice(first, first + _AT_ONCE)
                maps = predicted_contacts(solid, turns[some], aim, window, chosen.sizes[some], np.float32)
                found.append(self.embed(maps, cell, codes))
            return np.concatenate(found, axis=1)

        def embed_shape(label: str) -> Floats32:
            solids, members = scene.bodies(label, bodies.shares)
            if len(solids) == 1:
                return embed_solid(solids[0], bodies)
            rows = [np.flatnonzero(members == member) for member in range(len(solids))]
            parts = [embed_solid(solid, bodies.take(some)) for solid, some in zip(solids, rows, strict=True)]
            return np.concatenate(parts, axis=1)[:, np.argsort(np.concatenate(rows))]

        state = [(np.round(part, _DECIMALS) + 0.0).tolist() for part in (cell, codes, aim, rotation)]
        places = array_digest({name: part.round(_DECIMALS) + 0.0 for name, part in bodies._asdict().items()})
        fields = scene_fields(scene)
        shapes, ranges = (dict(fields.get(name, {}).get("entries", ())) for name in ("shapes", "families"))
        families = {label: [part for part in ranges.items() if part[0].startswith(f"{label}.")] for label in shapes}
        key = {"reader": self.digest, "bodies": places, "state": state}
        found = [
            cached_array(key | {"shape": [shapes[label], families[label]]}, partial(embed_shape, label))
            for label in scene.shape_labels
        ]
        return np.stack(found, axis=1)

    def embed(self, maps: Floats32, cell: float, codes: Floats32) -> Floats32:
        """Embeddings of predicted contacts ``(H, n, n)`` [m] in W states of the sensor, ``(W, H, D)``.

        ``cell`` is the width of the orientations that a contact stands for [rad]; the codes are ``(W, state_size)``.
        """
        contacts = encoded(maps, self.imaging.contact_pixels, self.imaging.face)
        cells = np.full(len(maps), cell, np.float32)
        given = dict(zip(CONTACTS, (contacts, cells, codes.astype(np.float32)), strict=True))
        found: Floats32 = session_of(self.network).run([EMBEDDING], given)[0]
        return found

    def shape_logits(self, embeddings: Floats32) -> NDArray[np.float64]:
        """See :class:`activetouch.perception.contacts.hypotheses.Hypotheses`; the mean is over all poses."""
        return mean_ratios(embeddings, self._fixed)

    @cached_property
    def _fixed(self) -> Floats32:
        """Hypotheses of each shape that take turns in the poses, ``(K, M, D)``."""
        if self.scene is None:
            raise ValueError("this reader reads any object and is about none yet; bound_to(scene) says which there are")
        return taking_turns(self, self.scene, num_hypotheses(self.scene))

    @cached_property
    def digest(self) -> str:
        """Digest of all that determines its embeddings: files of the cache are of one version."""
        return f"{self.content} {version('activetouch')}"

    @cached_property
    def content(self) -> str:
        """Digest of its network and of the sensor that it knows."""
        return hashlib.sha256(self.network + repr(self.imaging.fields()).encode()).hexdigest()

    def tensors(self) -> dict[str, NDArray[Any]]:
        """The arrays by name, as a file has them."""
        return {_NETWORK: np.frombuffer(self.network, np.uint8)}

    @classmethod
    def from_tensors(cls, imaging: Mapping[str, Any], tensors: Mapping[str, NDArray[Any]]) -> ContactHypotheses:
        """From :meth:`tensors` and the fields of the imaging."""
        try:
            return cls(Imaging.from_fields(imaging), tensors[_NETWORK].tobytes())
        except TypeError as error:
            raise ValueError(f"its imaging is {imaging!r:.200}: {error}") from error


def taking_turns(hypotheses: Hypotheses, scene: Scene, number: int) -> Floats32:
    """Embedded hypotheses of each shape of a scene, N = ``number``, that take turns in its poses, ``(K, N, D)``."""
    bodies, num_poses = scene.hypotheses(number), len(scene.poses)
    parts = [hypotheses.embedded(scene, bodies, pose)[:, pose::num_poses] for pose in range(num_poses)]
    return np.concatenate(parts, axis=1)


def mean_ratios(embeddings: Floats32, hypotheses: Floats32) -> NDArray[np.float64]:
    """Log of the mean ratio, ``(n, K)``, of images ``(n, D)`` under embedded hypotheses of shapes, ``(K, N, D)``."""
    num_shapes, number, width = hypotheses.shape
    fixed = hypotheses.reshape(-1, width).T
    found = np.empty((len(embeddings), num_shapes))
    at_once = max(1, _MOST_SCORES // fixed.shape[1])
    for first in range(0, len(embeddings), at_once):
        some = slice(first, first + at_once)
        scores = (embeddings[some] @ fixed).astype(float)
        found[some] = logsumexp(scores.reshape(-1, num_shapes, number), axis=2)
    return found - np.log(number)


def num_hypotheses(scene: Scene, places: int = 1) -> int:
    """Number of hypotheses of each shape in a model of new objects, a power of two, for ``places`` in the palm.

    >>> from activetouch import SCENES
    >>> [num_hypotheses(SCENES[name].scene) for name in ("gel", "many", "keyed")]
    [4096, 4096, 1024]
    """
    fingers = 1 if scene.hand is None else len(scene.hand)
    fitting = CONTACTS_IN_ALL / (len(scene.shapes) * len(scene.poses) * fingers * places)
    fewest = FEWEST if places == 1 else FEWEST // 2
    return int(2 ** np.floor(np.log2(np.clip(fitting, fewest, MOST))))


def cell_of(num_hypotheses: int) -> float:
    """Width [rad] of the cell of one of ``num_hypotheses``: the standard deviation of orientations about each axis.

    >>> round(cell_of(1024), 3)
    0.123
    """
    return (8 * math.pi**2 / num_hypotheses) ** (1 / 3) / math.sqrt(12)
