"""A tactile sensor: a scene, the reader of its images, and the observation model of what is read."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import SceneShift
from activetouch.named_scenes import SCENES
from activetouch.own_packages import require_own_packages
from activetouch.perception.hypothesis_table import HypothesisTable
from activetouch.perception.reader import TactileReader
from activetouch.scene import Scene
from activetouch.scene_description import in_words
from activetouch.sensor_files import (
    INDEPENDENT_SUFFIX,
    MODELS,
    files_for,
    is_of_objects,
    require_model,
)
from belief.errors import InvalidArgument, UnknownName
from belief.naming import Name, few, index_of, one_line
from belief.observation_model.model import ArrayModel
from belief.problem import Touch


@dataclass(frozen=True, eq=False)
class TactileSensor:
    """A scene with the reader trained for it and the observation model fitted to both.

    Attributes:
        scene: where presses come from.
        reader: reads their images.
        model: turns what it reads into evidence.
        shift: how the scene differs from the one that reader and model were made for, in words; empty where it is
            the same.
        with_logits: whether touches for a joint model have logits too. The model reads their features alone; deciders
            that judge single touches, environments and the records of searches read logits. A reader that embeds
            hypotheses takes 0.2 to 0.4 ms for the logits of a touch.

    Raises:
        LabelMismatch: reader or observation model were made for other shapes or poses.
    """

    scene: Scene
    reader: TactileReader
    model: ArrayModel
    shift: tuple[str, ...] = ()
    with_logits: bool = True

    def __post_init__(self) -> None:
        self.reader.card.require_labels(self.scene.shape_labels, self.scene.pose_labels)
        require_model(self.model, self.scene)

    @classmethod
    def load(cls, folder: str | Path, scene: Scene, anyway: bool = False, independent: bool = False) -> TactileSensor:
        """The sensor whose reader and observation model lie in a folder.

        A scene that differs from theirs by another press, other faults, sizes, forces or orientations is a known shift:
        a warning and :attr:`shift` tell it.

        Args:
            folder: of the two.
            scene: in which to use it.
            anyway: whether to use it, without a warning, in a scene that it was not made for.
            independent: whether to use its model that takes touches as independent given the shape.

        Raises:
            CorruptFile: one of the files is damaged or missing.
            NoIndependentModel: the sensor has only a joint model.
            LabelMismatch: they were made for other shapes or poses than the scene's.
            WrongScene: they were made for a scene that differs by more than a known shift.
            InvalidArgument: ``scene`` is no scene.
        """
        folder = Path(folder)
        if not isinstance(scene, Scene):
            raise InvalidArgument(f"the scene must be a Scene, such as SCENES['coarse'].scene; got {scene!r:.80}")
        path, fitted, shift = files_for(folder, scene, anyway, independent)
        reader = TactileReader.load(path).bound_to(scene)
        if fitted is None or (reader.card.imaging is not None and not is_of_objects(fitted.scene, scene)):
            from activetouch.perception.preparation import prepared  # which sensors of known objects do not need

            model: ArrayModel = prepared(reader, scene)
        else:
            model = fitted.model
        if shift and not anyway:
            warnings.warn(
                f"the sensor in {folder} is used outside the scene it was made for: {in_words(shift)}",
                SceneShift,
                stacklevel=2,
            )
        if reader.hypotheses is not None:
            model = model.with_hypotheses(HypothesisTable(reader, scene))
        return cls(scene, reader, model, shift=shift)

    @classmethod
    def shipped(cls, name: str = "gel", scene: Scene | None = None, anyway: bool = False) -> TactileSensor:
        """A sensor that comes with the package, in the scene that it was made for or in another. See :meth:`load`.

        Args:
            name: of a scene, for the sensor whose belief is about one rigid body; or ``paper-independent``, for the
                sensor that reads shapes only and takes touches as independent given the shape.
            scene: in which to use it.
            anyway: as in :meth:`load`.

        Raises:
            UnknownName: there is no such sensor.
        """
        known = sorted(folder.name for folder in MODELS.iterdir() if folder.is_dir())
        if name not in known:
            raise UnknownName("sensor", name, known)
        of_scene = name.removesuffix(INDEPENDENT_SUFFIX)
        return cls.load(MODELS / name, scene if scene is not None else SCENES[of_scene].scene, anyway)

    def __repr__(self) -> str:
        name = self.reader.card.backbone
        return one_line(TactileSensor, few(self.scene.shape_labels), f"network {name}", type(self.model).__name__)

    def read(self, images: NDArray[np.uint8], poses: Sequence[Name]) -> list[Touch]:
        """Touches from images ``(N, H, W)`` and the poses they were felt in."""
        labels = self.scene.pose_labels
        indices = [index_of("pose", labels, pose) for pose in poses]
        read, features = self.reader.run(images)
        if (hypotheses := self.reader.hypotheses) is None:
            return [Touch(*touch) for touch in zip(indices, read, features, strict=True)]
        # The logits of one image at a time, as their last bits depend on those they are computed with.
        logits = [hypotheses.shape_logits(row[None])[0] if self.with_logits else None for row in read]
        return [Touch(*touch) for touch in zip(indices, logits, read, strict=True)]

    def search(
        self,
        target: Name,
        decider: Any = "information_gain",
        seed: int | Sequence[int] = 0,
        *,
        num_objects: int | None = None,
        composition: Any = None,
        touch_cost: float = 0.02,
    ) -> Any:
        """Search for an object of the target's shape among simulated objects of the scene.

        The same seed gives the same objects and touches. ``seed=7`` is the first search for this target in
        ``activetouch compare --seed 7``; the key ``(7, 3, 12)`` is search number 12 for the target with index 3.

        The sensor does not know the deciders: this package and ``planners`` do not import each other. The method loads
        :mod:`experiments.search.one_search`, which knows both, when it is called.

        Args:
            target: label or index of the shape.
            decider: its name, as ``compare --deciders`` takes it, or an object with ``decide(info, rng)``.
            seed: of the search, or its key.
            num_objects: number of objects; that of the named scene by default, or up to four.
            composition: "distinct", "independent", or a :class:`belief.Composition` or :class:`belief.Counts`; that of
                the named scene by default, or "distinct".
            touch_cost: cost λ of one touch, in units of a success.

        Returns:
            The :class:`planners.Episode`, which prints as its steps.

        Raises:
            UnknownName: no shape or no decider has this name.
            InvalidArgument: a number is out of its range, or a seed is none.
        """
        require_own_packages("planners", "experiments")
        search_with = import_module("experiments.search.one_search").search_with
        return search_with(self, target, decider, seed, num_objects, composition, touch_cost)
