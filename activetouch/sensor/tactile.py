"""A tactile sensor: a scene, the reader of its images, and the observation model of what is read."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

from activetouch.distributions import Constant, Uniform
from activetouch.errors import SceneShift
from activetouch.named_scenes import SCENES, as_named
from activetouch.orientations import ANEW, Inexact
from activetouch.perception.cached_arrays import announced
from activetouch.perception.reader import HypothesisTable, TactileReader
from activetouch.scene import Scene
from activetouch.scene_description import in_words, scene_fields
from activetouch.sensor.searching import Searching
from activetouch.sensor_files import (
    MODELS,
    RECORDED_FILE,
    FittedModel,
    any_object_file,
    doubting_file,
    files_for,
    is_farther_off,
    is_of_objects,
    other_reader,
    require_model,
    scene_of,
)
from activetouch.world import TouchWorld
from belief.errors import InvalidArgument, UnknownName
from belief.naming import Name, few, index_of, one_line
from belief.observation_model.model import ArrayModel, GivesLogits
from belief.observation_model.rigid_body import FittedRigidBody
from belief.problem import SearchProblem, Touch
from planners import Decider, make_decider
from planners.fingerprint import digest_of, fingerprint

if TYPE_CHECKING:
    from activetouch.perception.many_bodies import NestedPlan
    from activetouch.pose_belief import PoseBelief
    from activetouch.sensor.recorded import RecordedSensor
    from activetouch.sensor.session_reader import SensorReader
    from activetouch.shapes import Shape
    from planners.certified import Certificate

_FEW_CONTACTS = 256  # shapes times poses for which a table of hypotheses is always made


def _as_far_as_moved(scene: Scene) -> Scene:
    """The scene at rest whose presses are as far beside the middle as objects move: another model is fitted to that.

    It is of a sensor without a reader of any object, as ``keyed``; those with one are right about moved objects.
    """
    still = replace(scene, moves=None)
    if scene.moves is None or scene.hand is not None:
        return still
    shift = scene.moves.shift
    if shift <= max(np.abs(scene.variation.offset.support)):
        return still
    return replace(still, variation=replace(scene.variation, offset=Uniform(-shift, shift)))


def _guards(folder: Path, path: Path, scene: Scene, independent: bool) -> tuple[bool | None, bool]:
    """The ``unknown_state`` and ``other_proportions`` of :meth:`TactileSensor.load` with which all is doubted."""
    if any_object_file(folder, scene, independent) is None:
        return False, False
    from activetouch.perception.proportions import OtherProportions  # other sensors do not need it

    other = other_reader(folder, path, scene, independent)
    return None, other is not None and bool(len(OtherProportions(other, scene).shapes))


@dataclass(frozen=True, eq=False)
class TactileSensor(Searching):
    """A scene with the reader trained for it and the observation model fitted to both.

    Attributes:
        scene: where presses come from.
        reader: reads their images.
        model: turns these readings into evidence.
        shift: how the scene differs from the one that reader and model were made for, in words; empty where it is
            the same.
        with_logits: whether touches for a joint model have logits too. The model reads their features alone; deciders
            that judge single touches, environments and the records of searches read logits. A reader that embeds
            hypotheses takes 0.2 to 0.4 ms for the logits of a touch.
        folder: where its files lie; None if it was put together from parts.

    Raises:
        LabelMismatch: reader or observation model were made for other shapes or poses.
    """

    scene: Scene
    reader: TactileReader
    model: ArrayModel
    shift: tuple[str, ...] = ()
    with_logits: bool = True
    folder: Path | None = None

    def __post_init__(self) -> None:
        self.reader.card.require_labels(self.scene.shape_labels, self.scene.pose_labels)
        require_model(self.model, self.scene)

    @overload
    @classmethod
    def load(cls, folder: str | Path, scene: None = None) -> RecordedSensor: ...

    @overload
    @classmethod
    def load(
        cls,
        folder: str | Path,
        scene: Scene,
        anyway: bool = False,
        independent: bool = False,
        unknown_state: bool | None = False,
        nested: bool | NestedPlan | None = None,
        other_proportions: bool = False,
        doubting: bool = False,
    ) -> TactileSensor: ...

    @classmethod
    def load(
        cls,
        folder: str | Path,
        scene: Scene | None = None,
        anyway: bool = False,
        independent: bool = False,
        unknown_state: bool | None = False,
        nested: bool | NestedPlan | None = None,
        other_proportions: bool = False,
        doubting: bool = False,
    ) -> TactileSensor | RecordedSensor:
        """The sensor whose reader and observation model lie in a folder.

        A scene that differs from theirs by another press, other faults, sizes, forces or orientations is a known shift:
        a warning and :attr:`shift` tell it.

        Args:
            folder: of the two.
            scene: in which to use it; none for a :class:`RecordedSensor`, which no scene simulates.
            anyway: whether to use it, without a warning, in a scene that it was not made for.
            independent: whether to use its model that takes touches as independent given the shape.
            unknown_state: whether the state of the sensor is inferred from its touches: forces, stiffness, noise,
                broken taxels, a shifted or blurred image, hysteresis. Its reader of any object then reads all scenes.
                A reader of a described pad always infers where the pad lies in the ranges of its description, and
                doubts that it lies there at all.
                None: only where touches are odd for the sensor as described, which then reads with its own reader; it
                needs both readers (:mod:`belief.observation_model.doubted_sensor`).
            nested: whether the belief is about nested cells of orientations, for hundreds of shapes, or how closely
                (:class:`activetouch.perception.many_bodies.NestedPlan`). By default where a table of all
                hypotheses would take more than ten minutes.
            other_proportions: whether built-in solids may have other proportions than the scene says: with a
                probability of 0.04, from half to double (:mod:`belief.observation_model.varied_bodies`). It needs both
                readers.
            doubting: for the pad of a robot, as ``activetouch live``: whether all that can be doubted is, in place of
                ``unknown_state`` and ``other_proportions``.

        Raises:
            CorruptFile: one of the files is damaged or missing.
            NoIndependentModel: the sensor has only a joint model.
            LabelMismatch: they were made for other shapes or poses than the scene's.
            WrongScene: they were made for a scene that differs by more than a known shift, or for recorded touches.
            InvalidArgument: ``scene`` is not a scene.
        """
        folder = Path(folder)
        if scene is None and (folder / RECORDED_FILE).exists():
            from activetouch.sensor.recorded import RecordedSensor

            return RecordedSensor.read_folder(folder)
        if not isinstance(scene, Scene):
            without = f"; only recorded touches need none, and {folder} holds no {RECORDED_FILE}" * (scene is None)
            raise InvalidArgument(
                f"the scene must be a Scene, such as SCENES['coarse'].scene; got {scene!r:.80}{without}"
            )
        full, scene = scene, replace(scene, moves=None)  # readers and fits are those of objects that stay
        plan = cls.nested_plan(scene, independent, nested)
        asks = (bool(unknown_state) and not doubting) or plan is not None
        path, fitted, shift = files_for(folder, scene, anyway, independent, asks)
        if doubting:
            is_joint = plan is None and (fitted is None or isinstance(fitted.model, FittedRigidBody))
            unknown_state, other_proportions = _guards(folder, path, scene, independent or not is_joint)
        other = None if unknown_state or plan is not None else other_reader(folder, path, scene, independent)
        if other_proportions and other is None:
            raise InvalidArgument(
                "other proportions are weighed by a sensor that has a reader of its own objects and one of any object, "
                f"as gel, coarse and hard, without an unknown state and nested cells; {folder} is none here: say the "
                "proportions in the scene (--family), or leave out other_proportions"
            )
        reader = TactileReader.load(path).bound_to(scene)
        is_of_pad = plan is None and reader.card.described is not None
        unknown_state = True if is_of_pad else unknown_state
        if plan is not None:
            from activetouch.perception.many_bodies import nested_model

            if unknown_state:
                raise InvalidArgument(
                    "the state of the sensor is not inferred with a belief about nested cells, as of "
                    f"{len(scene.shapes)} shapes; use fewer shapes, or leave out unknown_state"
                )
            model: ArrayModel = nested_model(reader, scene, plan)
        else:
            with announced("preparing the sensor: up to two minutes the first time, then kept in the cache"):
                knows_others = any_object_file(folder, scene, independent) is not None
                fitted_in = scene if knows_others else _as_far_as_moved(full)
                model = cls._model(reader, fitted_in, fitted, bool(unknown_state))
            if other_proportions and other is not None:
                from activetouch.perception.proportions import with_other_proportions  # other sensors do not need it

                model = with_other_proportions(model, other, scene)
            if unknown_state is None or is_of_pad:
                from activetouch.perception.sensor_doubts import doubted  # other sensors do not need it

                model = doubted(model, path if is_of_pad else doubting_file(folder, scene, independent), scene)
        if full.moves is not None or isinstance(full.presentation, (Inexact, *ANEW)):
            from activetouch.perception.moving import moving_model  # other sensors do not need it

            model = moving_model(model, full)
        if shift and not anyway:
            warnings.warn(
                f"the sensor in {folder} is used outside the scene it was made for: {in_words(shift)}",
                SceneShift,
                stacklevel=2,
            )
        return cls(full, reader, model, shift=shift, folder=folder)

    @staticmethod
    def nested_plan(scene: Scene, independent: bool, nested: bool | NestedPlan | None) -> NestedPlan | None:
        """How closely nested cells are examined; None for a table of hypotheses."""
        few = len(scene.shapes) * len(scene.poses) < _FEW_CONTACTS
        if nested is False or independent or (nested is None and few):
            return None
        from activetouch.perception.many_bodies import NestedPlan, are_many, require_nested

        if nested is None:
            return NestedPlan() if are_many(scene) else None
        require_nested(scene)
        return NestedPlan() if nested is True else nested

    @staticmethod
    def _model(reader: TactileReader, scene: Scene, fitted: FittedModel | None, unknown_state: bool) -> ArrayModel:
        """The observation model of a reader in a scene; one that is not in a file is made, and kept in the cache."""
        is_other = fitted is not None and reader.card.imaging is not None and not is_of_objects(fitted.scene, scene)
        is_joint = fitted is not None and fitted.model.reads == "embeddings"
        if fitted is None or is_other or (is_joint and is_farther_off(fitted.scene, scene)):
            from activetouch.perception.preparation import prepared  # sensors of known objects do not need it

            model: ArrayModel = prepared(reader, scene)
        else:
            model = fitted.model
        if reader.hypotheses is not None:
            model = model.with_hypotheses(HypothesisTable(reader, scene))
        if unknown_state:
            from activetouch.perception.sensor_worlds import sensor_health  # other sensors do not need it

            model = sensor_health(model, reader, scene)
        return model

    @classmethod
    def shipped(
        cls,
        name: str = "gel",
        scene: Scene | None = None,
        anyway: bool = False,
        *,
        unknown_state: bool | None = False,
        nested: bool | NestedPlan | None = None,
        other_proportions: bool = False,
        doubting: bool = False,
    ) -> TactileSensor:
        """A sensor that comes with the package, in the scene that it was made for or in another. See :meth:`load`.

        Args:
            name: of a scene, for the sensor whose belief is about one rigid body; ``gel-convnext``, whose reader is a
                small ConvNeXt; or ``paper-independent``, for the sensor that reads shapes only and takes touches as
                independent given the shape.
            scene: in which to use it.
            anyway: as in :meth:`load`.
            unknown_state: as in :meth:`load`.
            nested: as in :meth:`load`.
            other_proportions: as in :meth:`load`.
            doubting: as in :meth:`load`.

        Raises:
            UnknownName: there is no such sensor.
        """
        known = sorted(folder.name for folder in MODELS.iterdir() if folder.is_dir())
        if name not in known:
            raise UnknownName("sensor", name, known)
        scene = SCENES[scene_of(name)].scene if scene is None else scene
        options: dict[str, Any] = {"unknown_state": unknown_state, "other_proportions": other_proportions}
        return cls.load(MODELS / name, scene, anyway, nested=nested, doubting=doubting, **options)

    def with_objects(self, objects: Mapping[str, Shape | Path | str] | Sequence[Path | str] | Path) -> TactileSensor:
        """The sensor among other objects, whose contacts its reader of any object predicts; nothing is trained.

        Args:
            objects: solids or meshes, or mesh files ``path[@scale]``, by label; or what
                :func:`~activetouch.mesh_source.read_meshes` takes. Their sizes do not vary.

        Raises:
            InvalidArgument: fewer than two objects, or the sensor is not from a folder.
            LabelMismatch, WrongScene: its folder has no reader of any object.
            BadMesh, FileNotFoundError: see :func:`~activetouch.mesh_source.read_meshes`.
        """
        if self.folder is None:
            raise InvalidArgument("a sensor that was put together from parts has no reader of other objects: load one")
        from activetouch.mesh_source import read_objects
        from belief.observation_model.doubted_sensor import DoubtedSensorModel
        from belief.observation_model.sensor_health import SensorHealthModel

        variation = replace(self.scene.variation, size=Constant(1.0))
        scene = replace(self.scene, shapes=read_objects(objects), variation=variation)
        is_inferred, is_doubted = (isinstance(self.model, kind) for kind in (SensorHealthModel, DoubtedSensorModel))
        found = self.load(self.folder, scene, unknown_state=is_inferred, doubting=is_doubted)
        return replace(found, with_logits=self.with_logits)

    @property
    def shape_labels(self) -> tuple[str, ...]:
        """The labels of the shapes that it tells apart."""
        return tuple(self.model.shape_labels)

    @property
    def pose_labels(self) -> tuple[str, ...]:
        """The labels of the poses in which it can touch."""
        return self.scene.pose_labels

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
        keeps = isinstance(images, np.ndarray) and images.dtype == np.uint8 and self._keeps_images
        kept = list(images) if keeps else [None] * len(indices)
        if not self.with_logits:
            each = zip(indices, read, kept, strict=True)
            return [Touch(pose, None, row, image=image) for pose, row, image in each]
        own = self.model.logits if isinstance(self.model, GivesLogits) else None
        # The logits of one image at a time, as their last bits depend on those they are computed with.
        logits = [
            hypotheses.shape_logits(row[None])[0] if own is None else own(pose, row)
            for pose, row in zip(indices, read, strict=True)
        ]
        each_read = zip(indices, logits, read, kept, strict=True)
        return [Touch(pose, own_logits, row, image=image) for pose, own_logits, row, image in each_read]

    def pose(self, shape: Name, images: NDArray[np.uint8], poses: Sequence[Name]) -> PoseBelief:
        """How an object lies, from the images of its touches and the poses that they were felt in.

        Args:
            shape: its label or index.
            images: uint8, ``(N, H, W)``, of one object.
            poses: labels or indices, ``(N,)``.

        Raises:
            InvalidArgument: the sensor's belief knows nothing of how objects lie.
            UnknownName: there is no such shape or pose.
        """
        evidence: Any = self.model.start()
        touches = self.read(images, poses)
        for touch in touches:
            evidence = evidence.update(touch)
        index = index_of("shape", self.shape_labels, shape)
        return self.image_reader.pose(evidence, index, [touch.pose for touch in touches], list(images))

    @property
    def _keeps_images(self) -> bool:
        """Whether touches keep their images: for a model that may read them again, or compare them with presses."""
        read_again = any(hasattr(self.model, part) for part in ("doubts", "varied"))
        return read_again or getattr(self.model, "strangers", None) is not None

    @property
    def digest(self) -> str:
        """SHA-256 of all that it reads with."""
        written = getattr(self.model, "to_json", None)
        model = fingerprint(self.model) if written is None else written({})
        return digest_of([self.reader.digest, self.reader.card.fields(), model])

    def _usual(self) -> tuple[SearchProblem, int]:
        hand = self.scene.hand
        known = [one for one in SCENES.values() if self.scene in (one.scene, hand and one.scene.with_hand(hand))]
        named = known[0] if known else as_named(self.scene)
        usual = SearchProblem(self.shape_labels, self.pose_labels, named.num_objects, named.composition)
        return usual, named.touches_per_object

    def _world(self, problem: SearchProblem, key: tuple[int, ...], target: int) -> TouchWorld:
        return TouchWorld.of_search(self, problem, key, target)

    @property
    def image_reader(self) -> SensorReader:
        """The reader of the images that a session receives."""
        from activetouch.sensor.session_reader import SensorReader

        return SensorReader(self.scene, self.reader, self.model, self.read)

    def certified_world(
        self,
        problem: SearchProblem,
        targets: Sequence[str],
        name: str,
        decider: Decider,
        known: Mapping[str, object],
    ) -> dict[str, Any]:
        """What a certificate of searches with the sensor holds for, as JSON types.

        Args:
            problem: rules of the searches.
            targets: labels of the shapes that are searched for.
            name: of the decider, as on the command line.
            decider: the decider.
            known: objects by name that deciders hold and that the sensor determines.
        """
        targets = [label for label in problem.shape_labels if label in targets]
        world = {
            "scene": scene_fields(self.scene),
            "objects and rules": repr(problem),
            "targets": targets,
            "decider": name,
            "settings, code or policies of the decider": digest_of([fingerprint(decider, t, known) for t in targets]),
            "sensor (SHA-256)": self.digest,
        }
        return dict(json.loads(json.dumps(world)))

    def _certified(
        self, problem: SearchProblem, target: int, decider: str | Decider, certificate: Certificate
    ) -> Decider:
        """The decider of a certificate, which stops by it."""
        from planners.certified import NotCertified

        label, targets = problem.shape_labels[target], certificate.made_for["targets"]
        if decider != certificate.decider:
            raise NotCertified(f"the certificate is for the decider {certificate.decider!r}, not {decider!r:.80}")
        if label not in targets:
            raise NotCertified(f"the certificate is for the targets {', '.join(targets)}, not {label}")
        table = self.model.outcome_table()
        made = make_decider(certificate.decider, table, self.model)
        known = {"observation model": self.model, "outcome table": table}
        return certificate.wrap(made, self.certified_world(problem, targets, certificate.decider, made, known))
