"""Built-in solids of other proportions than a scene describes, by a reader of any object."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.perception.contacts.hypotheses import ContactHypotheses
from activetouch.perception.imaging import Floats32
from activetouch.perception.reader import TactileReader
from activetouch.scene import Scene
from activetouch.solids.family import Proportions
from belief.errors import InvalidArgument
from belief.observation_model.model import ArrayModel
from belief.observation_model.outcome_mixture import log_means
from belief.observation_model.rigid_body import RigidBodyModel
from belief.observation_model.varied_bodies import VariedBodyModel
from belief.problem import Touch

_HYPOTHESES, _IN_ALL = 512, 2048  # of other proportions of each shape, and of all: half a second for each pose
_TEMPERATURE = 0.8  # of the scores of bodies that are not far from the nominal ones, which the reader reads well
_USUAL = 128  # of each shape with nominal proportions, for what a touch is like of a usual object


@dataclass(frozen=True, eq=False)
class ReadsAnyObject:
    """The reader of any object in a file, for a scene.

    Attributes:
        path: of the reader.
        scene: describes the sensor, the poses and the nominal solids.
    """

    path: Path
    scene: Scene

    @cached_property
    def reader(self) -> TactileReader:
        """The reader of any object."""
        return TactileReader.load(self.path).bound_to(self.scene)

    @cached_property
    def _hypotheses(self) -> ContactHypotheses:
        found = self.reader.hypotheses
        assert isinstance(found, ContactHypotheses)
        return found

    def __getstate__(self) -> dict[str, Any]:
        """The state for another process, without what can be computed anew."""
        return {one.name: vars(self)[one.name] for one in fields(self)}


@dataclass(frozen=True, eq=False)
class OtherProportions(ReadsAnyObject):
    """Hypotheses of other proportions; see :class:`belief.observation_model.varied_bodies.VariedHypotheses`."""

    @cached_property
    def shapes(self) -> NDArray[np.int64]:
        """See :class:`belief.observation_model.varied_bodies.VariedHypotheses`."""
        solids = self.scene.shapes.values()
        return np.array([index for index, solid in enumerate(solids) if Proportions.has(solid)], np.int64)

    def log_ratios(self, touch: Touch) -> Floats32 | None:
        """See :class:`belief.observation_model.varied_bodies.VariedHypotheses`."""
        if touch.image is None:
            return None
        embedding = self.reader.run(touch.image[None])[0] / np.float32(_TEMPERATURE)
        place = int(touch.pose) if touch.elsewhere is None else touch.elsewhere.place
        table, usual = self.embedded(place)
        found = (table.reshape(-1, table.shape[-1]) @ embedding[0]).reshape(table.shape[:2])
        return np.asarray(found - np.float32(log_means((usual @ embedding[0])[None])[0]))

    def embedded(self, place: int | tuple[float, ...]) -> tuple[Floats32, Floats32]:
        """Embedded hypotheses in a pose or another place, ``(V, N, D)``, and usual objects there, ``(U, D)``; kept."""
        if place not in self._kept:
            pairs = (self.bodies, self.number), (self.scene, _USUAL)
            varied, usual = (self._embedded(*of, place) for of in pairs)
            self._kept[place] = varied, usual.reshape(-1, usual.shape[-1])
        return self._kept[place]

    def _embedded(self, scene: Scene, number: int, place: int | tuple[float, ...]) -> Floats32:
        """Embedded hypotheses of the shapes of a scene, ``(K, N, D)``."""
        if isinstance(place, int):
            return self._hypotheses.embedded(scene, scene.hypotheses(number), place)
        there = scene.with_pose(np.array(place[:4]), np.array(place[4:]))
        return self._hypotheses.embedded(there, scene.hypotheses(number), len(scene.poses))

    @cached_property
    def _kept(self) -> dict[int | tuple[float, ...], tuple[Floats32, Floats32]]:
        return {}

    @property
    def number(self) -> int:
        """N: hypotheses of other proportions of each shape."""
        return min(_HYPOTHESES, _IN_ALL // len(self.shapes))

    @cached_property
    def bodies(self) -> Scene:
        """The scene with solids of other proportions: those shapes alone that have them, in their order."""
        labels = [self.scene.shape_labels[index] for index in self.shapes]
        return replace(self.scene, shapes={label: Proportions(self.scene.solids[label]) for label in labels})


def with_other_proportions(model: ArrayModel, path: Path, scene: Scene) -> VariedBodyModel:
    """The model of a sensor for which solids may have other proportions, by the reader of any object in a file.

    Raises:
        InvalidArgument: the model is not that of one rigid body, or no solid has proportions.
    """
    varied = OtherProportions(path, scene)
    if not isinstance(model, RigidBodyModel):
        raise InvalidArgument(f"only the joint model of one rigid body weighs other proportions, not {model!r:.80}")
    if not len(varied.shapes):
        raise InvalidArgument(
            f"of {', '.join(scene.shape_labels)}, none is a solid with two lengths or more: leave out other_proportions"
        )
    return VariedBodyModel(model, varied)
