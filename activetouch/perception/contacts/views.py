"""Bodies as a reader of any object knows them: their contacts in evenly spread views, embedded once, on disk.

A touch shows a body in one orientation, whatever the pose and however it lies. So a body needs no hypotheses for each
pose: it is embedded in V views (:func:`activetouch.rotation_cells.views`), and a hypothesis about how it lies is read
in a pose as the view that is nearest. Each mesh has its own file in the cache: sets of bodies may change at will.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from activetouch.perception.cached_arrays import cached_array, is_cached
from activetouch.perception.contacts.hypotheses import ContactHypotheses
from activetouch.perception.imaging import Floats32
from activetouch.poses import turned
from activetouch.pressing.height_maps import predicted_contacts
from activetouch.rotation_cells import centres, nearest, nested, views
from activetouch.scene import Scene
from activetouch.scene_description import described
from activetouch.solids.solid import Shape
from belief.coarse_to_fine import CoarseToFine, Ints
from belief.constraints import Checked, Probability
from belief.files import array_digest
from belief.validation import Floats

_AT_ONCE = 128  # contacts
_DECIMALS = 7
_IN_SINGLE = 1 << 28  # numbers; larger tables stay in half precision


@dataclass(frozen=True)
class ViewPlan(Checked):
    """The views in which bodies are embedded: accuracy against the time for a new body.

    Attributes:
        directions: number of sides from which a body is seen.
        rolls: number of rolls about the approach axis, a multiple of 4.
        width: standard deviation, about each axis, of the orientations that a view stands for, an input of the network
            of contacts [rad].
    """

    directions: int = 88
    rolls: int = 12
    width: Probability = 0.25

    @property
    def orientations(self) -> Floats:
        """Orientations of the views, unit quaternions ``wxyz``, ``(V, 4)``."""
        return views(self.directions, self.rolls)


def embedded_views(reader: ContactHypotheses, scene: Scene, solid: Shape, plan: ViewPlan) -> Floats32:
    """Embeddings of a body in all views, ``(V, D)``, from the cache or new."""
    code = reader.code(scene)

    def make() -> Floats32:
        quarter = plan.orientations.reshape(plan.directions, plan.rolls, 4)[:, : plan.rolls // 4].reshape(-1, 4)
        window, found = reader.imaging.wide_window, []
        step = max(1, _AT_ONCE // plan.rolls) * (plan.rolls // 4)  # whole directions
        for first in range(0, len(quarter), step):
            maps = predicted_contacts(solid, quarter[first : first + step], (0.0, 0.0), window, 1.0, np.float32)
            each = maps.reshape(-1, plan.rolls // 4, *maps.shape[1:])
            rolled = np.stack([np.rot90(each, -turns, axes=(2, 3)) for turns in range(4)], axis=1)
            found.append(reader.embed(np.ascontiguousarray(rolled.reshape(-1, *maps.shape[1:])), plan.width, code)[0])
        return np.concatenate(found)

    return cached_array(_key(reader, scene, solid, plan), make)


def are_embedded(reader: ContactHypotheses, scene: Scene, solid: Shape, plan: ViewPlan) -> bool:
    """Whether :func:`embedded_views` finds a body in the cache."""
    return is_cached(_key(reader, scene, solid, plan))


def to_embed(reader: Any, scene: Scene, plan: ViewPlan) -> list[Shape]:
    """The solids of a scene that are not in the cache."""
    return [solid for solid in scene.solids.values() if not are_embedded(reader, scene, solid, plan)]


def _key(reader: ContactHypotheses, scene: Scene, solid: Shape, plan: ViewPlan) -> dict[str, Any]:
    return {
        "reader": reader.digest,
        "state": (np.round(reader.code(scene), _DECIMALS) + 0.0).tolist(),
        "views": [plan.directions, plan.rolls, plan.width],
        "body": described(solid),
    }


@dataclass(eq=False)
class Felt:
    """A touch with the embedding of its image, ``(D,)``, and what is kept of its log likelihoods.

    ``views`` has those of all views, by body, and ``exact`` those of exactly predicted contacts, by hypothesis.
    """

    pose: int
    embedding: Floats32
    views: dict[int, Floats32] = field(default_factory=dict, repr=False)
    exact: dict[tuple[Any, ...], float] = field(default_factory=dict, repr=False)


@dataclass(frozen=True, eq=False)
class BodySet:
    """K bodies, embedded in all views (:class:`belief.observation_model.nested_bodies.BodyLikelihood`).

    ``table (V, K, D)`` has the embeddings, ``poses (P, 4)`` the rotations of the poses, ``levels`` the levels of the
    cells, coarse first.
    """

    labels: tuple[str, ...]
    table: NDArray[np.floating]
    plan: ViewPlan
    poses: Floats
    levels: tuple[int, ...] = (0, 1, 2)

    @classmethod
    def of(
        cls, reader: ContactHypotheses, scene: Scene, solids: Mapping[str, Shape], plan: ViewPlan, /, **others: Any
    ) -> Self:
        """Bodies embedded for the sensor of a scene; those in the cache take no time."""
        first = embedded_views(reader, scene, next(iter(solids.values())), plan)
        is_large = len(solids) * first.size > _IN_SINGLE
        table = np.empty((len(first), len(solids), first.shape[1]), np.float16 if is_large else np.float32)
        for body, solid in enumerate(solids.values()):
            table[:, body] = embedded_views(reader, scene, solid, plan)
        return cls(tuple(solids), table, plan, np.array(list(scene.rotations.values())), **others)

    @property
    def num_poses(self) -> int:
        """P."""
        return len(self.poses)

    def looked(self, belief: CoarseToFine) -> CoarseToFine:
        """The belief; see :class:`activetouch.perception.contacts.close_look.CloseContacts`."""
        return belief

    def fields(self) -> dict[str, Any]:
        """See :class:`belief.observation_model.nested_bodies.BodyLikelihood`."""
        return {"views": array_digest({"table": self.table, "poses": self.poses}), "levels": list(self.levels)}

    def felt(self, pose: int, embedding: NDArray[np.floating]) -> Felt:
        """A touch for :meth:`CoarseToFine.update`."""
        return Felt(pose, np.asarray(embedding, np.float32))

    def coarsest(self, touch: Felt) -> Floats32:
        """See :class:`belief.coarse_to_fine.CellLikelihood`."""
        shown, places = np.unique(self.shown(self.levels[0], touch.pose), return_inverse=True)
        found = np.stack([self.table[view].astype(np.float32, copy=False) @ touch.embedding for view in shown.tolist()])
        return np.ascontiguousarray(found.T[:, places])

    def parts(self, touches: Sequence[Felt], level: int, bodies: Ints, parents: Ints) -> Floats32:
        """See :class:`belief.coarse_to_fine.CellLikelihood`."""
        cells = nested(self.levels).parts(level, parents)
        total = np.zeros(cells.shape, np.float32)
        for touch in touches:
            shown = self.shown(self.levels[level], touch.pose)[cells]
            total += self.table[shown, bodies[:, None]].astype(np.float32, copy=False) @ touch.embedding
        return total

    def view_scores(self, body: int, touch: Felt) -> Floats32:
        """Log likelihoods of a touch given each view of a body, ``(V,)``."""
        if body not in touch.views:
            touch.views[body] = self.views_of(body) @ touch.embedding
        return touch.views[body]

    def views_of(self, body: int) -> Floats32:
        """The embeddings of a body in all views, ``(V, D)``."""
        return self.table[:, body].astype(np.float32, copy=False)

    def log_ratios(
        self, level: Ints, bodies: Ints, cells: Ints, references: Floats32, poses: Sequence[int] | None = None
    ) -> Floats32:
        """Log ratios of reference touches in every pose, or some, for n hypotheses, ``(P, n, M)``.

        ``level (n,)`` is the place of each cell's level in this set; ``bodies`` and ``cells`` are ``(n,)``.
        ``references (M, D)`` are embeddings of touches that stand for all.
        """
        some_poses = range(len(self.poses)) if poses is None else poses
        shown = np.empty((len(some_poses), len(bodies)), np.int64)
        for place in np.unique(level).tolist():
            some = level == place
            for row, pose in enumerate(some_poses):
                shown[row, some] = self.shown(self.levels[place], pose)[cells[some]]
        found = self.table[shown, bodies].astype(np.float32, copy=False)
        return found @ references.T

    def shown(self, level: int, pose: int) -> NDArray[np.int32]:
        """The view that each cell of :func:`activetouch.rotation_cells.centres` shows in a pose, ``(N,)``."""
        if (level, pose) not in self._kept:
            shown = turned(self.poses[pose], centres(level))
            self._kept[level, pose] = nearest(shown, self.plan.orientations).astype(np.int32)
        return self._kept[level, pose]

    @cached_property
    def _kept(self) -> dict[tuple[int, int], NDArray[np.int32]]:
        return {}
