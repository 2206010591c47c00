"""A closer look at the few bodies that are still possible: their evidence from contacts that are predicted exactly.

Views are coarse: up to 12° from what a hypothesis shows. Of few bodies it takes seconds to predict the contact of every
touch itself. The likeliest cells of each body (by its views, the best of each wide cell) are weighed so, and the best
of these are divided twice, down to 3°, and into sizes. Bodies that have fallen far behind are not looked at further.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy  # whose parts load at first use
from scipy.special import logsumexp

from activetouch.perception.contacts.hypotheses import ContactHypotheses
from activetouch.perception.contacts.views import BodySet, Felt, ViewPlan
from activetouch.perception.imaging import Floats32
from activetouch.poses import multiply, turned
from activetouch.pressing.height_maps import predicted_contacts
from activetouch.rotation_cells import centres, nested
from activetouch.scene import Scene
from activetouch.scene_description import described
from activetouch.solids.solid import Shape
from belief.coarse_to_fine import CoarseToFine, Ints
from belief.constraints import Checked, Count, CountOrNone, Probability
from belief.validation import Floats

_AT_ONCE = 256  # contacts
_PARTS = 8  # parts of a cell
_ALIKE = 3  # bodies: one that is about to be named, and those nearest to it
_FINEST = 4  # level of the smallest cells


@dataclass(frozen=True)
class CloseLook(Checked):
    """The accuracy against the seconds of a check: how closely the bodies that are still possible are examined.

    Attributes:
        bodies: largest number of examined bodies; 0 for no examination.
        least: posterior from which a body is examined.
        share: posterior that these bodies must have together; before that, a look is too early.
        touches: number of touches before the first look, as an object may lie in more ways than are weighed; earlier,
            only a body that is about to be named is looked at.
        named: posterior of a body that is about to be named: it is compared with those that feel most like it, too.
        enough: posterior of a body after a look above which there is no other look.
        proposed: number of cells of a body that are weighed.
        divided: number of best cells that are divided, at each of two levels.
        sizes: equally probable sizes of a body, relative to its mesh; the middle one first.
        behind: distance in log evidence behind the best body at which the examination of a body ends.
        widths: of the orientations that a cell of each of three levels stands for, an input of the network of contacts
            [rad].
        scale, drift: of log likelihoods, see :class:`belief.coarse_to_fine.CoarseToFine`.
    """

    bodies: CountOrNone = 6
    least: Probability = 0.002
    share: Probability = 0.8
    touches: int = 4
    named: Probability = 0.9
    enough: Probability = 0.995
    proposed: Count = 12
    divided: Count = 4
    sizes: tuple[float, ...] = (1.0, 0.98, 1.02)
    behind: float = 12.0
    widths: tuple[float, float, float] = (0.12, 0.06, 0.035)
    scale: float = 0.8
    drift: float = 0.02


@dataclass(frozen=True, eq=False, kw_only=True)
class CloseContacts(BodySet):
    """Bodies of which a few are weighed by exactly predicted contacts; ``code (1, STATE_SIZE)`` is of the sensor."""

    hypotheses: ContactHypotheses
    code: Floats32
    solids: tuple[Shape, ...]
    look: CloseLook

    @classmethod
    def of_scene(
        cls, reader: ContactHypotheses, scene: Scene, plan: ViewPlan, levels: tuple[int, ...], look: CloseLook
    ) -> CloseContacts:
        """The bodies of a scene, in the state of its sensor."""
        own: dict[str, Any] = {"hypotheses": reader, "code": reader.code(scene), "look": look}
        solids = scene.solids
        return cls.of(reader, scene, solids, plan, levels=levels, solids=tuple(solids.values()), **own)

    def fields(self) -> dict[str, Any]:
        """See :class:`BodySet`."""
        bodies = [described(solid) for solid in self.solids]
        views = {"plan": vars(self.plan), "poses": self.poses.tolist(), "levels": list(self.levels)}
        return {
            "reader": self.hypotheses.digest,
            "state": self.code.tolist(),
            **views,
            "look": vars(self.look),
            "of": bodies,
        }

    def looked(self, belief: CoarseToFine) -> CoarseToFine:
        """The belief with recomputed evidence of the bodies that are still possible; the others keep theirs."""
        look, probs = self.look, belief.probs
        few, best = np.argsort(-probs)[: look.bodies], int(probs.argmax())
        few = few[probs[few] >= look.least]
        is_named = look.bodies > 0 and probs[best] >= look.named
        is_early = not is_named and (len(belief.touches) < look.touches or probs[few].sum() < look.share)
        if is_early or (belief.correction.any() and probs[best] > look.enough):
            return belief
        if is_named:
            few = np.union1d(few, self._nearest[best])
        return belief if len(few) < 2 else belief.corrected(few, self.log_evidence(few, belief.touches))

    @cached_property
    def _nearest(self) -> Ints:
        """The bodies that feel most like each, by their mean embeddings: itself and the next, ``(K, 3)`` or fewer."""
        means = self.table.mean(axis=0, dtype=np.float32)
        number = min(_ALIKE, len(means))
        return np.asarray(scipy.spatial.cKDTree(means).query(means, number)[1]).reshape(len(means), number)

    def log_evidence(self, few: Ints, touches: Sequence[Felt]) -> Floats:
        """Log evidence of the bodies with indices ``few (n,)``, each in its most probable cells, ``(n,)``."""
        return self._examined(few, touches)[0]

    def fitted(self, body: int, touches: Sequence[Felt]) -> tuple[Floats, float]:
        """The orientation ``wxyz``, to about 3°, and the size in which a body explains all touches best."""
        cell, size = self._examined(np.array([body]), touches)[1][0]
        return centres(_FINEST)[cell], size

    def contacts(self, body: int, poses: Sequence[int], rest: Floats, size: float) -> Floats32:
        """Embeddings of the exactly predicted contacts of a body that lies so, in some poses, ``(n, D)``."""
        turns, window = multiply(self.poses[list(poses)].T, rest).T, self.hypotheses.imaging.wide_window
        maps = predicted_contacts(self.solids[body], turns, (0.0, 0.0), window, size, np.float32)
        return self.hypotheses.embed(maps, self.look.widths[-1], self.code)[0]

    def _examined(self, few: Ints, touches: Sequence[Felt]) -> tuple[Floats, list[tuple[int, float]]]:
        """Log evidence of some bodies, and the best of the finest cells and the size of each; cell 0 without any."""
        look = self.look
        share = look.scale / (1.0 + look.drift * (len(touches) - 1))
        shares = [np.log(nested((level,)).shares[0]) for level in range(2, _FINEST + 1)]
        leaves: list[list[float]] = [[] for _ in few]  # log weights of the cells that are not divided
        cells = [self.likely(body, touches)[0] for body in few.tolist()]
        sizes = [np.ones(len(each)) for each in cells]
        found, best_cells = np.full(len(few), -np.inf), [(0, 1.0)] * len(few)
        alive = list(range(len(few)))
        for step in range(3):
            for place in alive:
                body, mine, size = int(few[place]), cells[place], sizes[place]
                logs = shares[step][mine] + share * self._scores(body, step, mine, size, touches)
                if step == 2:
                    logs -= np.log(len(look.sizes))
                    best_cells[place] = int(mine[logs.argmax()]), float(size[logs.argmax()])
                elif step == 1:
                    best = np.argsort(-logs)[: look.divided]
                    others = np.array(look.sizes[1:]).repeat(len(best))
                    again = np.tile(mine[best], len(look.sizes) - 1)
                    resized = shares[1][again] + share * self._scores(body, 1, again, others, touches)
                    logs, mine = np.concatenate([logs, resized]) - np.log(len(look.sizes)), np.append(mine, again)
                    size = np.append(size, others)
                found[place] = logsumexp([*leaves[place], *logs])
                if step < 2:
                    best = np.argsort(-logs)[: look.divided]
                    leaves[place] += np.delete(logs, best).tolist()
                    cells[place] = (mine[best][:, None] * _PARTS + np.arange(_PARTS)).ravel()
                    sizes[place] = size[best].repeat(_PARTS)
            alive = [place for place in alive if found[place] > found.max() - look.behind]
        return found, best_cells

    def likely(self, body: int, touches: Sequence[Felt], number: int | None = None) -> tuple[Ints, Floats]:
        """The likeliest cells of level 2 by the views of a body, the best of each wide cell, and log likelihoods.

        There are ``number`` of them, by default as many as are examined closely.
        """
        total = sum(self.view_scores(body, touch)[self.shown(2, touch.pose)] for touch in touches)
        wide = np.reshape(total, (-1, _PARTS))
        best = np.argsort(-wide.max(axis=1))[: self.look.proposed if number is None else number]
        return best * _PARTS + wide[best].argmax(axis=1), wide[best].max(axis=1)

    def _scores(self, body: int, step: int, cells: Ints, sizes: Floats, touches: Sequence[Felt]) -> Floats:
        """Log likelihoods of all touches together in some cells, ``(n,)``; each touch keeps its own."""
        keys = [(body, step, *key) for key in zip(cells.tolist(), sizes.tolist(), strict=True)]
        wanted = [(touch, place) for touch in touches for place, key in enumerate(keys) if key not in touch.exact]
        rests, width = centres(2 + step), self.look.widths[step]
        for first in range(0, len(wanted), _AT_ONCE):
            some = wanted[first : first + _AT_ONCE]
            places = np.array([place for _, place in some])
            turns = np.concatenate([turned(self.poses[touch.pose], rests[cells[place]][None]) for touch, place in some])
            window = self.hypotheses.imaging.wide_window
            maps = predicted_contacts(self.solids[body], turns, (0.0, 0.0), window, sizes[places], np.float32)
            (embedded,) = self.hypotheses.embed(maps, width, self.code)
            for (touch, place), one in zip(some, embedded, strict=True):
                touch.exact[keys[place]] = float(one @ touch.embedding)
        return np.array([sum(touch.exact[key] for touch in touches) for key in keys])
