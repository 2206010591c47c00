"""``activetouch recorded``: searches among recorded objects, and what they say about a belief on real touches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from activetouch.recorded import RecordedTouches, check_recorded, read_recorded, without_incomplete
from activetouch.recorded.formats import Format
from activetouch.sensor import RecordedSensor
from belief.claims import claim_folder, ends_claims
from experiments.command_line.arguments import (
    BadArgument,
    Count,
    CountOrNone,
    NotEmpty,
    Seed,
    Share,
    Within,
    check_arguments,
)
from experiments.command_line.console import plain_console
from experiments.parallel import progress_bar
from experiments.recorded.play import FIXED, Fold, find_all, identify_all, main_splits, prepare
from experiments.recorded.report import RecordedReport
from planners.registry import find_decider, trained_state

DECIDERS = (
    "point_based",
    "value_of_information",
    "information_gain(max_touches={max_touches})",
    FIXED,
    "random_poses(max_touches={max_touches})",
)
Task = Literal["objects", "categories", "shapes"]


def recorded(
    touches: RecordedTouches,
    task: Task = "objects",
    *,
    name: str = "own",
    threshold: float = 0.9,
    objects: int = 4,
    scenes: int = 10,
    deciders: Sequence[str] = DECIDERS,
    folds: int = 5,
    rounds: int = 5,
    max_touches: int = 12,
    seed: int = 0,
    notes: Sequence[str] = (),
    save: str | Path | None = None,
) -> RecordedReport:
    """Identify and search for recorded objects by their held-out recordings, with several deciders.

    Args:
        touches: the set.
        task: labels: objects are tested on later recordings, categories and shapes on objects that were not learned
            from.
        name: of the set.
        threshold: probability of a label at which an object is named.
        objects: of a search, all with different labels.
        scenes: per split, each with a search for each object; 0 for no searches.
        deciders: of searches; "best fixed order" has posterior thresholds and the order ranked on calibration touches.
            {max_touches} stands for ``max_touches``, or the number of different touches of an object if it is smaller.
        folds: of objects for categories and shapes.
        rounds: identifications of each object by each decider, each with another order of its recordings.
        max_touches: of an object.
        seed: of splits, orders, scenes and intervals.
        notes: sentences about how the set was read, for the report.
        save: folder for the sensor that :meth:`activetouch.sensor.RecordedSensor.fit` makes from all touches.

    Raises:
        BadRecording: the task has too few labels, objects or touches.
        CannotWrite: ``save`` cannot be written, or holds a sensor of a scene.
        BadArgument: a threshold that a guess reaches, or a decider that needs a file of a sensor's folder.
        UnknownName: there is no such decider.
    """
    for decider in deciders:
        _require_plain(decider, max_touches)
    remarks = check_recorded(touches, task)
    chosen = touches.for_task(task)
    if threshold <= (guess := 1.0 / len(chosen.label_names)):
        raise BadArgument(
            f"--threshold must be above {guess:.3g}, the probability of each of the {len(chosen.label_names)} "
            f"{task} before the first touch, got {threshold:g}"
        )
    if save is not None:
        RecordedSensor.fit(touches, task).save(save)
    split_name, splits = main_splits(chosen, folds)
    with progress_bar() as bar:
        steps = bar.add_task("reading, naming and searching", total=2 * len(splits))
        made, named, found = [], [], []
        for split in splits:
            made.append(prepare(chosen, split, threshold))
            bar.advance(steps)
        for number, fold in enumerate(made):
            named += identify_all(fold, [seed, number], threshold, max_touches, rounds)
            if scenes:
                found += find_all(fold, deciders, [seed, number], objects, scenes, max_touches)
            bar.advance(steps)
    missing = _missing_searches(made, objects, task) if scenes else []
    facts = {
        "name": name,
        "task": task,
        "split": split_name,
        "provenance": touches.provenance,
        "licence": touches.licence,
        "touches": len(chosen.rows),
        "labels": len(chosen.label_names),
        "num_objects": len(set(chosen.objects.tolist())),
        "actions": list(touches.action_names),
        "threshold": threshold,
        "objects": objects,
        "scenes": scenes,
        "deciders": list(deciders),
        "folds": folds,
        "rounds": rounds,
        "max_touches": max_touches,
        "seed": seed,
        "notes": [*notes, *remarks, *missing],
    }
    return RecordedReport(made, named, found, facts)


@dataclass(frozen=True)
class Recorded:
    """Play searches on recorded touches of real objects, with several deciders; report.

    The set is split by time or by object, a classifier is trained and calibrated, correlations between touches are
    fitted, and objects are then identified, and searched for, by their held-out recordings.
    docs/real_touch.md describes the formats; "csv" and "npz" are for touches of your own, "bts3" is a public set.

    For example:

        activetouch recorded --data my_touches --format csv
        activetouch recorded --data my_touches.npz --format npz --task categories
        activetouch recorded --data tests/fixtures/bts3 --format bts3 --save sensors/biotac
    """

    data: Path
    """Folder of the recordings; for npz also the file."""
    format: Format
    """Format of the recordings."""
    task: Task = "objects"
    """Labels: objects are tested on later recordings, categories and shapes on objects that were not learned from."""
    threshold: Share = 0.9
    """Probability of a label at which an object is named."""
    objects: Annotated[int, Within(2, 12)] = 4
    """Number of objects of a search, all with different labels."""
    scenes: CountOrNone = 10
    """Scenes per split, each with a search for each object; 0 for no searches."""
    deciders: Annotated[tuple[str, ...], NotEmpty()] = DECIDERS
    """Deciders of searches; "best fixed order" has posterior thresholds and the order ranked on calibration touches.
    {max_touches} stands for --max-touches, or the number of different touches of an object if it is smaller."""
    folds: Annotated[int, Within(2, 100)] = 5
    """Folds of objects for categories and shapes."""
    rounds: Count = 5
    """Identifications of each object by each decider, each with another order of its recordings."""
    leave_out_incomplete: bool = False
    """Leave out objects with too few sessions of an action, instead of refusing the set."""
    max_touches: Annotated[int, Within(1, 100)] = 12
    """Most touches of an object."""
    seed: Seed = 0
    """Seed of splits, orders, scenes and intervals."""
    save: Path | None = None
    """Folder for a sensor that is trained in the same way on all touches: TactileSensor.load reads it, and its session
    finds objects that you touch."""
    out: Path | None = None
    """Folder for the results; runs/recorded-FORMAT-TASK by default."""

    @ends_claims
    def run(self) -> None:
        """Read, split, search, print and write."""
        check_arguments(self)
        for decider in self.deciders:
            _require_plain(decider, self.max_touches)
        out = self.out if self.out is not None else Path(f"runs/recorded-{self.format}-{self.task}")
        claim_folder(out)
        if self.save is not None:
            claim_folder(self.save)
        touches, notes = read_recorded(self.data, self.format)
        if self.leave_out_incomplete:
            touches, left_out = without_incomplete(touches, self.task)
            notes = (*notes, *left_out)
        console, known = plain_console(), (*notes, *check_recorded(touches, self.task))
        console.print(f"{touches.num_touches} touches, actions: {', '.join(touches.action_names)}")
        for note in known:
            console.print(f"- {note}")
        names = "threshold", "objects", "scenes", "deciders", "folds", "rounds", "max_touches", "seed"
        settings = {name: getattr(self, name) for name in names}
        report = recorded(touches, self.task, name=self.format, notes=notes, save=self.save, **settings)
        for note in report.facts["notes"][len(known) :]:
            console.print(f"- {note}")
        for table in report.tables():
            print(table, end="\n\n")
        for sentence in report.verdict():
            console.print(f"- {sentence}")
        report.save(out)
        if self.save is not None:
            print(f"wrote a sensor, trained on all {report.facts['touches']} touches, into {self.save}")
        print(f"wrote report.html, recorded.md, results.json, episodes.jsonl and tables into {out}")


def _require_plain(decider: str, max_touches: int) -> None:
    """Refuse a decider that does not exist, or needs a file of a sensor's folder."""
    if decider == FIXED:
        return
    given = decider.replace("{max_touches}", str(max_touches))
    find_decider(given)  # raises UnknownName
    if trained_state(given) is not None or decider == "best_order":
        raise BadArgument(
            f"--deciders {decider} needs a file of a sensor's folder, and recorded touches have no sensor; the order "
            f'that is ranked on them is "{FIXED}"'
        )


def _missing_searches(folds: Sequence[Fold], objects: int, task: str) -> list[str]:
    """A sentence if splits test too few labels for searches."""
    numbers = [len(np.unique(fold.bank.labels)) for fold in folds]
    able, most = sum(number >= objects for number in numbers), max(numbers)
    if able == len(numbers):
        return []
    if able:
        where = f"there are searches among {objects} objects in {able} of {len(numbers)} splits only"
        return [f"{where}; the others test fewer different {task}"]
    cure = f"--objects {most}" if most > 1 else "fewer --folds"
    return [
        f"there are no searches among {objects} objects: those that a split tests have at most {most} different "
        f"{task}; give {cure}"
    ]
