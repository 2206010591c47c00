"""A tactile sensor: a scene, the reader of its images, and the observation model of what is read."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from activetouch.distributions import Constant
from activetouch.errors import LabelMismatch, SceneShift, WrongScene
from activetouch.mesh_source import read_objects
from activetouch.named_scenes import SCENES
from activetouch.own_packages import require_own_packages
from activetouch.perception.cached_arrays import announced
from activetouch.perception.hypothesis_table import HypothesisTable
from activetouch.perception.reader import TactileReader
from activetouch.scene import Scene
from activetouch.scene_description import in_words
from activetouch.sensor_files import (
    INDEPENDENT_SUFFIX,
    MODELS,
    NOT_SIMULATED,
    OBSERVATION_FILE,
    READER_FILE,
    RECORDED_FILE,
    FittedModel,
    files_for,
    fitted_model,
    is_of_objects,
    require_model,
)
from belief.errors import CannotWrite, CorruptFile, InvalidArgument, UnknownName
from belief.files import write_text
from belief.naming import Name, few, index_of, one_line
from belief.observation_model.action_kernel import ActionKernelModel
from belief.observation_model.model import ArrayModel
from belief.observation_model.sensor_health import SensorHealthModel
from belief.problem import Touch

if TYPE_CHECKING:
    from activetouch.recorded.reader import RecordedReader
    from activetouch.recorded.touches import RecordedTouches
    from activetouch.shapes import Shape


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

    @classmethod
    def load(
        cls,
        folder: str | Path,
        scene: Scene | None = None,
        anyway: bool = False,
        independent: bool = False,
        unknown_state: bool = False,
    ) -> TactileSensor:
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

        Raises:
            CorruptFile: one of the files is damaged or missing.
            NoIndependentModel: the sensor has only a joint model.
            LabelMismatch: they were made for other shapes or poses than the scene's.
            WrongScene: they were made for a scene that differs by more than a known shift, or for recorded touches.
            InvalidArgument: ``scene`` is no scene.
        """
        folder = Path(folder)
        if scene is None and (folder / RECORDED_FILE).exists():
            return RecordedSensor.read_folder(folder)
        if not isinstance(scene, Scene):
            raise InvalidArgument(f"the scene must be a Scene, such as SCENES['coarse'].scene; got {scene!r:.80}")
        path, fitted, shift = files_for(folder, scene, anyway, independent, unknown_state)
        reader = TactileReader.load(path).bound_to(scene)
        with announced("preparing the sensor: up to two minutes the first time, then kept in the cache"):
            model = cls._model(reader, scene, fitted, unknown_state)
        if shift and not anyway:
            warnings.warn(
                f"the sensor in {folder} is used outside the scene it was made for: {in_words(shift)}",
                SceneShift,
                stacklevel=2,
            )
        return cls(scene, reader, model, shift=shift, folder=folder)

    @staticmethod
    def _model(reader: TactileReader, scene: Scene, fitted: FittedModel | None, unknown_state: bool) -> ArrayModel:
        """The observation model of a reader in a scene; one that is not in a file is made, and kept in the cache."""
        if fitted is None or (reader.card.imaging is not None and not is_of_objects(fitted.scene, scene)):
            from activetouch.perception.preparation import prepared  # which sensors of known objects do not need

            model: ArrayModel = prepared(reader, scene)
        else:
            model = fitted.model
        if reader.hypotheses is not None:
            model = model.with_hypotheses(HypothesisTable(reader, scene))
        if unknown_state:
            from activetouch.perception.sensor_worlds import sensor_health  # which others do not need

            model = sensor_health(model, reader, scene)
        return model

    @classmethod
    def shipped(
        cls, name: str = "gel", scene: Scene | None = None, anyway: bool = False, *, unknown_state: bool = False
    ) -> TactileSensor:
        """A sensor that comes with the package, in the scene that it was made for or in another. See :meth:`load`.

        Args:
            name: of a scene, for the sensor whose belief is about one rigid body; or ``paper-independent``, for the
                sensor that reads shapes only and takes touches as independent given the shape.
            scene: in which to use it.
            anyway: as in :meth:`load`.
            unknown_state: as in :meth:`load`.

        Raises:
            UnknownName: there is no such sensor.
        """
        known = sorted(folder.name for folder in MODELS.iterdir() if folder.is_dir())
        if name not in known:
            raise UnknownName("sensor", name, known)
        of_scene = name.removesuffix(INDEPENDENT_SUFFIX)
        scene = SCENES[of_scene].scene if scene is None else scene
        return cls.load(MODELS / name, scene, anyway, unknown_state=unknown_state)

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
        variation = replace(self.scene.variation, size=Constant(1.0))
        scene = replace(self.scene, shapes=read_objects(objects), variation=variation)
        is_inferred = isinstance(self.model, SensorHealthModel)
        return replace(self.load(self.folder, scene, unknown_state=is_inferred), with_logits=self.with_logits)

    @property
    def shape_labels(self) -> tuple[str, ...]:
        """What it can tell apart."""
        return tuple(self.model.shape_labels)

    @property
    def pose_labels(self) -> tuple[str, ...]:
        """How it can touch."""
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

    def session(
        self,
        target: Name,
        decider: Any = "information_gain",
        seed: int | Sequence[int] = 0,
        *,
        num_objects: int | None = None,
        composition: Any = None,
        touch_cost: float = 0.02,
        log: str | Path | None = None,
        **settings: Any,
    ) -> Any:
        """A search whose touches somebody else makes, such as a robot; it reads the images that it is told.

        It asks for what :meth:`search` with the same seed would do, given the same touches, if ``abstain`` is False.

        Args:
            target: label or index of the shape.
            decider: as of :meth:`search`.
            seed: of the decider.
            num_objects: as of :meth:`search`.
            composition: as of :meth:`search`.
            touch_cost: as of :meth:`search`.
            log: file for all that is told, each on disk before the next question; if it exists, its search goes on.
            settings: of :class:`planners.Session`: ``arrangement``, ``abstain``, ``log_bets``, ``least_force`` and
                ``least_area``; a log goes on with its own alone. Where it may abstain, an image that could be one of no
                contact is a miss. ``certificate`` of :func:`activetouch.certify`, or its file, says where an object is
                confirmed, without such misses; NotCertified if it was made for another search.

        Returns:
            The :class:`planners.Session`.

        Raises:
            UnknownName: no shape or no decider has this name.
            InvalidArgument: a number is out of its range, or the log is of another search, decider or limit.
            CorruptFile, CannotWrite: the log cannot be read or written.
        """
        require_own_packages("planners", "experiments")
        session_with = import_module("experiments.search.one_search").session_with
        return session_with(self, target, decider, seed, num_objects, composition, touch_cost, log, **settings)


class RecordedSensor(TactileSensor):
    """A sensor whose reader was trained on recorded touches: its images are rows of features, its poses are actions.

    No scene simulates it. What needs one, as :attr:`scene` or :attr:`reader` do, raises :class:`WrongScene`.

    Attributes:
        recorded_reader: turns features into log likelihood ratios.
        model: weights these by the correlations of the actions.
        origin: what it was trained on, of JSON types: ``provenance``, ``licence``, ``task``, ``touches``, ``objects``.

    Raises:
        LabelMismatch: the model has labels that the reader does not know, or another number of actions.
    """

    recorded_reader: RecordedReader
    model: ActionKernelModel
    origin: Mapping[str, Any]

    def __init__(self, reader: RecordedReader, model: ActionKernelModel, origin: Mapping[str, Any]) -> None:
        unknown = [label for label in model.shape_labels if label not in reader.label_names]
        if unknown:
            raise LabelMismatch(f"the reader does not know {few(unknown)} of the observation model; save both again")
        if model.num_poses != len(actions := reader.action_names):
            raise LabelMismatch(f"the reader knows {len(actions)} actions, the observation model {model.num_poses}")
        for name, value in (("recorded_reader", reader), ("model", model), ("origin", dict(origin))):
            object.__setattr__(self, name, value)

    @classmethod
    def fit(cls, touches: RecordedTouches, classifier: Any = None, is_logits: bool = False) -> RecordedSensor:
        """Train and calibrate a reader on all touches of a set, and fit the correlations of its actions.

        Nothing is held out. ``activetouch recorded`` tests readers that are made in the same way.

        Args:
            touches: the set, whose objects are the shapes of the sensor, or :meth:`RecordedTouches.for_task` of it.
            classifier: one of your own, with ``fit`` and ``predict_proba`` or ``predict_log_proba``, in place of ours;
                it is copied for each action. Such a sensor cannot be saved.
            is_logits: whether the features are logits, named as the labels, in place of a classifier.

        Raises:
            BadRecording: there are too few labels, objects or touches.
        """
        from activetouch.recorded import check_recorded
        from activetouch.recorded.reader import kinds_of, read
        from activetouch.recorded.touches import for_use

        check_recorded(touches)
        reading = read(touches, for_use(touches), kinds_of(touches, classifier, is_logits))
        counts = {"touches": touches.num_touches, "objects": len(np.unique(touches.objects))}
        origin = {"provenance": touches.provenance, "licence": touches.licence, "task": touches.task, **counts}
        return cls(reading.reader, reading.model(touches), origin)

    @classmethod
    def read_folder(cls, folder: Path) -> RecordedSensor:
        """The sensor from :meth:`save`; raises CorruptFile and LabelMismatch as :meth:`TactileSensor.load` does."""
        from activetouch.recorded.reader_file import read_recorded_reader

        reader, fitted = read_recorded_reader(folder / RECORDED_FILE), fitted_model(folder)
        if not isinstance(fitted.model, ActionKernelModel) or fitted.recorded is None:
            raise CorruptFile(f"{folder / OBSERVATION_FILE} is no observation model of recorded touches")
        return cls(reader, fitted.model, fitted.recorded)

    def save(self, folder: str | Path) -> None:
        """Write the sensor: the reader's arrays as safetensors, the observation model with its kernel as JSON.

        Raises:
            CannotWrite: there is no room, no permission, or a sensor of a scene in the folder.
        """
        from activetouch.recorded.reader_file import write_recorded_reader

        folder = Path(folder)
        if (folder / READER_FILE).exists():
            raise CannotWrite(f"{folder} holds a sensor of a scene; save this one in another folder")
        write_text(folder / OBSERVATION_FILE, self.model.to_json({"recorded": dict(self.origin)}) + "\n")
        write_recorded_reader(folder / RECORDED_FILE, self.recorded_reader)

    def among(self, labels: Sequence[str]) -> RecordedSensor:
        """The sensor for objects that are known to be of some of its shapes.

        Raises:
            ValueError: a label that it does not know.
        """
        return RecordedSensor(self.recorded_reader, self.model.among(labels), self.origin)

    def read(self, images: NDArray[Any], poses: Sequence[Name]) -> list[Touch]:
        """Touches from features ``(N, F)``, in the units of the recordings, and the actions that they were felt with.

        Raises:
            InvalidArgument: another number of features or actions, or features that are not finite.
            UnknownName: there is no such action.
        """
        reader = self.recorded_reader
        actions = np.array([index_of("action", reader.action_names, pose) for pose in poses], np.int64)
        columns = [reader.label_names.index(label) for label in self.model.shape_labels]
        rows = reader.checked(images, len(actions))
        ratios = reader.ratios(rows, actions)[:, columns]
        is_tested = self.model.conflict is not None and len(rows)
        seen = reader.novelties(rows, actions)[:, None] if is_tested else [None] * len(rows)
        return [Touch(*touch) for touch in zip(actions.tolist(), ratios, seen, strict=True)]

    @property
    def pose_labels(self) -> tuple[str, ...]:
        """Its actions."""
        return self.recorded_reader.action_names

    @property
    def scene(self) -> Scene:
        """There is none: raises WrongScene."""
        raise WrongScene(f"{self} is not of a scene: {NOT_SIMULATED}")

    @property
    def reader(self) -> TactileReader:
        """There is no network for images: raises WrongScene."""
        raise WrongScene(f"{self} reads features, not images: {NOT_SIMULATED}")

    def __repr__(self) -> str:
        actions = f"by {few(self.pose_labels)}"
        return one_line(
            RecordedSensor, few(self.shape_labels), actions, f"{self.recorded_reader.num_features} features"
        )
