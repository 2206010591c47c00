"""``activetouch adapt``: fit a sensor to a changed world by touches of a few objects there."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from activetouch.adaptation import StiffnessPosterior, adapted, require_adaptable
from activetouch.scene import Scene
from activetouch.scene_description import scene_fields
from activetouch.sensor import TactileSensor
from activetouch.sensor_files import READER_FILE, write_observation_model
from belief.claims import claim_folder, ends_claims
from belief.errors import UnknownName
from belief.metrics import negative_log_likelihood
from belief.observation_model.selection import log_posteriors
from belief.statistics import wilson_interval
from belief.touch_batch import TouchBatch
from experiments.command_line.arguments import BadArgument, Count, CountOrNone, Jobs, NotEmpty, Seed, check_arguments
from experiments.command_line.console import plain_console
from experiments.parallel import default_jobs
from experiments.reporting.tables import Table, interval
from experiments.robustness.conditions import CONDITIONS, DoesNotApply
from experiments.robustness.searches import search_scores
from experiments.robustness.shifted_touches import ClassifierOutputs, ShiftedScene, measure_touches
from experiments.scene_choice import SceneChoice, in_file_names
from experiments.sensor_choice import open_sensor

_BEFORE, _KNOWN, _UNKNOWN = "before", "known shapes", "unknown shapes"


@dataclass(frozen=True)
class Adapt:
    """Fit a sensor to a changed world: same reader, touches of a few objects, less than a minute.

    From touches of some objects it finds the stiffness of the set-up, if the reader knows stiffness (coarse-robust,
    for example), and, where their shapes are known, how far to trust touches. The table compares the numbers of
    objects, with known and with unknown shapes, on other objects of the same world. Writes the sensor that was fitted
    to the largest number, with known shapes, into a folder.

    For example:

        activetouch adapt --scene coarse --sensor coarse-robust --condition "stiffness × 0.7"
        activetouch adapt --scene coarse --condition "noise × 2" --searches 25
        activetouch adapt --scene my_lab:scene --sensor coarse --objects 10 --out runs/sensor-my-lab
        activetouch compare --scene my_lab:scene --sensor runs/sensor-my-lab
    """

    choice: Annotated[SceneChoice, tyro.conf.arg(name="")] = field(default_factory=SceneChoice)
    """The world that the sensor is in."""
    sensor: Path | None = None
    """Folder from activetouch calibrate, or name of a shipped sensor; that of the scene by default."""
    condition: str | None = None
    """Change of the scene, by its name in activetouch robustness, such as "stiffness × 0.7"; none by default."""
    objects: Annotated[tuple[Count, ...], NotEmpty()] = (2, 5, 10)
    """Numbers of objects of every shape to adapt to; each object is touched once in every pose."""
    test: Count = 100
    """Objects of every shape to test on."""
    searches: CountOrNone = 0
    """Live searches for every target, before and after, by information gain."""
    seed: Seed = 0
    """Seed of objects and touches."""
    out: Path | None = None
    """Folder of the adapted sensor; runs/sensor-SCENE-adapted by default."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes that press; the results do not depend on it."""
    anyway: bool = False
    """Use a sensor that was made for another scene."""

    @ends_claims
    def run(self) -> None:
        """Touch, adapt, test, print and write."""
        check_arguments(self)
        scene = self._scene()
        out = self.out if self.out is not None else Path(f"runs/sensor-{in_file_names(self.choice.scene)}-adapted")
        claim_folder(out)
        sensor = open_sensor(self.sensor, self.choice, self.anyway)
        require_adaptable(sensor)
        most = max(self.objects)
        shifted = {"adapt": ShiftedScene(scene, most, stream=1), "test": ShiftedScene(scene, self.test)}
        touched = measure_touches(sensor, shifted, self.seed, self.jobs)
        rows = [_row(_BEFORE, 0, None, sensor, touched["test"])]
        for number in sorted(self.objects):
            first = np.flatnonzero(touched["adapt"].numbers < number * len(scene.shapes))
            batch, shapes = _in_all_poses(touched["adapt"]).sequences(first), touched["adapt"].shapes[first]
            ways = [(_UNKNOWN, None)] if sensor.reader.card.knows_stiffness else []
            for what, known in (*ways, (_KNOWN, shapes)):
                started = time.perf_counter()
                fitted, stiffness = adapted(sensor, batch, known)
                seconds = time.perf_counter() - started
                rows.append(_row(what, number, stiffness, fitted, touched["test"], seconds))
        headings = ("adapted to", "objects", "stiffness", "accuracy", "stated", ("NLL", ".3f"), ("time [s]", ".1f"))
        console = plain_console()
        title = f"{self.choice.scene}: adapted to objects of every shape; all touches of each of {self.test} others"
        console.print(Table(title, headings, rows).rich())
        if self.searches:
            models = {_BEFORE: sensor.model, f"{most} objects a shape": fitted.model}
            played = search_scores(sensor, models, {"": scene}, self.choice.named, self.searches, self.seed, self.jobs)
            console.print(_searches_table({model: scores for (_, model), scores in played.items()}).rich())
        sensor.reader.save(out / READER_FILE)
        found = None if stiffness is None else stiffness.interval
        write_observation_model(out, fitted.model, scene_fields(scene), stiffness=found)
        print(f"wrote {out}")

    def _scene(self) -> Scene:
        """The world.

        Raises:
            UnknownName: there is no such condition.
            BadArgument: it does not apply to the scene.
        """
        if self.condition is None:
            return self.choice.named.scene
        if self.condition not in CONDITIONS:
            raise UnknownName("condition", self.condition, list(CONDITIONS))
        try:
            return CONDITIONS[self.condition](self.choice.named.scene)
        except DoesNotApply as reason:
            raise BadArgument(
                f"--condition {self.condition!r} does not apply to {self.choice.scene}: {reason}"
            ) from None


def _in_all_poses(touched: ClassifierOutputs) -> TouchBatch:
    """One sequence of each object: its touch in every pose."""
    num_objects, num_poses, _ = touched.logits.shape
    return touched.sequences(np.tile(np.arange(num_poses), (num_objects, 1)))


def _row(
    what: str,
    number: int,
    stiffness: StiffnessPosterior | None,
    sensor: TactileSensor,
    tested: ClassifierOutputs,
    seconds: float | None = None,
) -> tuple[Any, ...]:
    """One row of the table: how good the belief of a sensor is after all touches of unseen objects."""
    num_objects, probs = len(tested.shapes), np.exp(log_posteriors(sensor.model, _in_all_poses(tested)))
    right = int((probs.argmax(axis=1) == tested.shapes).sum())
    low, high = (1.0, 1.0) if stiffness is None else stiffness.interval
    return (
        what,
        number,
        "" if stiffness is None else f"{low:.2f} to {high:.2f}",
        interval(right / num_objects, *wilson_interval(right, num_objects)),
        f"{probs.max(axis=1).mean():.3f}",
        negative_log_likelihood(probs, tested.shapes),
        seconds,
    )


def _searches_table(scores: Mapping[str, Mapping[str, Any]]) -> Table:
    rows = [
        (model, interval(some["success"], *some["interval"]), some["touches"], some["stated"], some["achieved"])
        for model, some in scores.items()
    ]
    headings = ("adapted to", "success", ("touches", ".2f"), ("stated", ".3f"), ("achieved", ".3f"))
    return Table("live searches by information gain", headings, rows)
