"""A sensor of recorded touches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import LabelMismatch
from activetouch.sensor.searching import Searching
from activetouch.sensor.session_reader import RecordedRowReader
from activetouch.sensor_files import NOT_SIMULATED, OBSERVATION_FILE, READER_FILE, RECORDED_FILE, fitted_model
from belief.errors import CannotWrite, CorruptFile
from belief.files import write_text
from belief.naming import Name, few, index_of, one_line
from belief.observation_model.action_kernel import ActionKernelModel
from belief.problem import SearchProblem, Touch
from belief.seeding import arrangement_rng
from belief.synthetic import SyntheticWorld, sample_arrangement
from planners import Decider, World
from planners.certified import Certificate, NotCertified

if TYPE_CHECKING:
    from activetouch.recorded.reader import RecordedReader
    from activetouch.recorded.touches import RecordedTouches

_TOUCHES_PER_OBJECT = 12


@dataclass(frozen=True, eq=False, repr=False)
class RecordedSensor(Searching):
    """A sensor whose reader was trained on recorded touches: its images are rows of features, its poses are actions.

    No scene simulates it; what needs one raises :class:`~activetouch.errors.WrongScene`.

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

    def __post_init__(self) -> None:
        reader, model = self.recorded_reader, self.model
        unknown = [label for label in model.shape_labels if label not in reader.label_names]
        if unknown:
            raise LabelMismatch(f"the reader does not know {few(unknown)} of the observation model; save both again")
        if model.num_poses != len(actions := reader.action_names):
            raise LabelMismatch(f"the reader knows {len(actions)} actions, the observation model {model.num_poses}")
        object.__setattr__(self, "origin", dict(self.origin))

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
        return cls(reading.reader, reading.model(touches), origin_of(touches))

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
        """The labels of its actions."""
        return self.recorded_reader.action_names

    @property
    def shape_labels(self) -> tuple[str, ...]:
        """The labels that it tells apart."""
        return tuple(self.model.shape_labels)

    def _usual(self) -> tuple[SearchProblem, int]:
        """Of up to four different objects."""
        return SearchProblem(self.shape_labels, self.pose_labels, min(4, len(self.shape_labels))), _TOUCHES_PER_OBJECT

    def _world(self, problem: SearchProblem, key: tuple[int, ...], target: int) -> World:
        """Objects whose touches are drawn from the observation model; ``activetouch recorded`` has recordings."""
        return SyntheticWorld(self.model, sample_arrangement(problem, arrangement_rng(key), target))

    def _certified(
        self, problem: SearchProblem, target: int, decider: str | Decider, certificate: Certificate
    ) -> NoReturn:
        raise NotCertified(f"certificates are for sensors with a scene; {NOT_SIMULATED}")

    @property
    def image_reader(self) -> RecordedRowReader:
        """The reader of the rows that a session receives."""
        return RecordedRowReader(self.recorded_reader, self.read)

    def __repr__(self) -> str:
        actions = f"by {few(self.pose_labels)}"
        return one_line(
            RecordedSensor, few(self.shape_labels), actions, f"{self.recorded_reader.num_features} features"
        )


def origin_of(touches: RecordedTouches) -> dict[str, Any]:
    """What a sensor of these touches is trained on, see :class:`RecordedSensor`."""
    counts = {"touches": touches.num_touches, "objects": len(np.unique(touches.objects))}
    return {"provenance": touches.provenance, "licence": touches.licence, "task": touches.task, **counts}
