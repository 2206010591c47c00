"""Arguments of commands that describe a search: its scene, its sensor and its rules."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

import tyro

from activetouch import Scene, TactileSensor
from activetouch.named_scenes import NamedScene
from activetouch.sensor_files import ANY_OBJECT_FILE, observation_file, reader_file
from belief.codec import from_fields, to_fields
from belief.composition import Composition
from belief.constraints import Fraction, NotNegative
from belief.errors import CorruptFile, InvalidArgument
from belief.problem import SearchProblem
from experiments.command_line.arguments import BadArgument, Count, check_arguments
from experiments.command_line.trust import Trust
from experiments.scene_choice import SceneChoice
from experiments.sensor_choice import open_sensor, sensor_folder

CompositionName: TypeAlias = Literal["distinct", "independent", "at_most_one"]
"""Name of a :class:`belief.Composition`."""


@dataclass(frozen=True)
class Setting:
    """Sensor and rules of all searches."""

    choice: tyro.conf.OmitArgPrefixes[SceneChoice] = field(default_factory=SceneChoice)
    """The scene."""
    sensor: Path | None = None
    """Folder of a sensor, or name of a shipped one; that of the scene by default."""
    num_objects: Count | None = None
    """Objects in a search; that of the scene by default."""
    composition: CompositionName | None = None
    """distinct: all objects differ. independent: each can have any shape. at_most_one: one has the target's shape, or
    none, each place as probable as none; for many shapes. That of the scene by default."""
    observation_model: Literal["independent", "nested"] | None = None
    """independent: touches of an object are independent given its shape, not of one rigid body. nested: orientations
    are weighed coarse to fine, for hundreds of meshes; the default where a table of them all would be too large."""
    unknown_state: bool = False
    """Infer from the touches what is the matter with the sensor: forces, stiffness, noise, broken taxels, a shifted
    image. Needs a reader of any object."""
    touch_cost: NotNegative = 0.02
    """Cost λ of one touch, in units of a success."""
    abstain: Fraction | None = None
    """False-alarm rate of the conflict test, such as 0.02: deciders can answer "I do not know"."""
    anyway: bool = False
    """Accept a sensor that was made for another scene; the report lists the differences."""

    def to_dict(self) -> dict[str, Any]:
        """The setting as plain values."""
        return to_fields(self)

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any] | None, trust: Trust) -> Setting:
        """The setting from :meth:`to_dict`, in a file."""
        if fields is None:
            raise CorruptFile(
                f"{trust.source} has searches with a scene or a sensor that a program made; only that program can "
                "continue or replay them"
            )
        try:
            choice = SceneChoice.from_dict(fields["choice"], trust)
            found = from_fields(cls, {**fields, "choice": choice})
        except (TypeError, KeyError, AttributeError, InvalidArgument) as error:
            raise CorruptFile(f"{trust.source} does not describe a search: {error}") from error
        check_arguments(found)
        return found

    @property
    def scene(self) -> Scene:
        """The scene of the searches."""
        return self.choice.named.scene

    @property
    def sensor_folder(self) -> Path:
        """Folder of the sensor."""
        return sensor_folder(self.sensor, self.choice.scene)

    def sensor_files(self, scene: Scene) -> list[Path]:
        """The files that determine what the sensor reads in a scene; for a reader of any object, its file alone."""
        independent, nested = (self.observation_model == name for name in ("independent", "nested"))
        reader = reader_file(self.sensor_folder, scene, independent, self.unknown_state or nested)
        return [
            reader,
            *([] if reader.name == ANY_OBJECT_FILE else [observation_file(self.sensor_folder, independent)]),
        ]

    def open_sensor(self, named: NamedScene | None = None, jobs: int | None = None) -> TactileSensor:
        """The sensor, after a check that it fits the scene, or ``named`` in place of the setting's scene."""
        scene = self.choice if named is None else named
        model = self.observation_model
        nested = True if model == "nested" else None
        return open_sensor(self.sensor, scene, self.anyway, model == "independent", self.unknown_state, jobs, nested)

    @property
    def problem(self) -> SearchProblem:
        """The rules of the search; raises as :meth:`problem_in`."""
        return self.problem_in(self.choice.named)

    def problem_in(self, named: NamedScene) -> SearchProblem:
        """The rules of the search in a scene."""
        number = named.num_objects if self.num_objects is None else self.num_objects
        shapes = named.scene.shape_labels
        composition = named.composition if self.composition is None else Composition(self.composition)
        if self.num_objects is not None and number > len(shapes) and composition == Composition.DISTINCT:
            raise BadArgument(
                f"--num-objects {number}: the scene has only {len(shapes)} shapes ({', '.join(shapes)}), and all "
                "objects must differ; --composition independent allows several of one shape"
            )
        try:
            return SearchProblem(
                shapes,
                named.scene.pose_labels,
                num_objects=number,
                composition=composition,
                touch_cost=self.touch_cost,
                touch_limit=named.touches_per_object * number,
                unsure_reward=None if self.abstain is None else 0.0,
            )
        except ValueError as error:
            raise BadArgument(str(error)) from error
