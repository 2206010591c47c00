"""``activetouch recorded``: searches among recorded objects, and what they say about a belief on real touches."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from activetouch.recorded import RecordedTouches, check_recorded, read_recorded
from activetouch.recorded.checking import Leaks, without_incomplete
from activetouch.recorded.formats import Format
from activetouch.recorded.reader import kinds_of
from activetouch.recorded.touches import splits_of
from activetouch.sensor import RecordedSensor
from activetouch.sensor.recorded import origin_of
from activetouch.sensor_files import RECORDED_FILE
from belief.constraints import NotEmpty, Share, Within
from belief.files import claim_folder, ends_claims, require_regular_file
from belief.naming import few
from belief.references import build, find
from experiments.command_line.arguments import BadArgument, Count, CountOrNone, Seed, check_arguments
from experiments.command_line.console import plain_console
from experiments.recorded.play import FIXED, Found, Named, find_all, identify_all, prepare
from experiments.recorded.report import RESULTS, RecordedReport
from experiments.search.run import RunMismatch, differing
from planners.registry import find_decider, trained_state

_OBJECTS = 4
# The value of information is first: it knows how little a repeat tells, which a point-based plan does not
# (docs/real_touch.md#searches-among-objects-of-known-labels).
DECIDERS = (
    "value_of_information",
    "point_based",
    "information_gain(max_touches={max_touches})",
    FIXED,
    "random_poses(max_touches={max_touches})",
)


def recorded(
    touches: RecordedTouches,
    task: str = "objects",
    *,
    name: str = "own",
    threshold: float = 0.9,
    objects: int = _OBJECTS,
    scenes: int = 10,
    deciders: Sequence[str] = DECIDERS,
    folds: int = 5,
    rounds: int = 5,
    max_touches: int = 12,
    seed: int = 0,
    classifier: Any = None,
    logits: bool = False,
    drop: bool = False,
    shuffle: bool = False,
    notes: Sequence[str] = (),
    save: str | Path | None = None,
    out: str | Path | None = None,
) -> RecordedReport:
    """Identify and search for recorded objects by recordings that were not learned from, with several deciders.

    ``name`` is the name of the set, ``notes`` say how it was read, and ``classifier`` is one of your own, as in
    :meth:`activetouch.sensor.RecordedSensor.fit`. All other arguments are the settings of :class:`Recorded`; nothing is
    written without ``save`` and ``out``.

    Raises:
        RunMismatch: a folder holds the results, or the sensor, of other recordings or settings.
    """
    for decider in deciders:
        _require_plain(decider, max_touches)
    touches = touches.for_task(task)
    touches, dropped = without_incomplete(touches) if drop else (touches, ())
    touches = touches.in_random_order(seed) if shuffle else touches
    remarks, number, kinds = check_recorded(touches), len(touches.label_names), kinds_of(touches, classifier, logits)
    if deciders == DECIDERS and touches.num_actions == 1:
        deciders = DECIDERS[:3]
    if threshold <= 1.0 / number:
        raise BadArgument(
            f"--threshold must be above {1.0 / number:.3g}, the probability of each of the {number} {task} before the "
            f"first touch, got {threshold:g}"
        )
    splits = splits_of(touches, folds)
    most = max(len(np.unique(touches.labels[split.test])) for split in splits)
    if objects == _OBJECTS and 1 < most < objects:
        remark = f"searches are among {most} {task} instead of {objects}: that is how many are kept for testing"
        objects, remarks = most, (*remarks, remark)
    if scenes and objects > most:
        raise BadArgument(f"--objects {objects}: there are {most} to search among; give fewer, or --scenes 0")
    facts = {
        "name": name,
        "task": task,
        "provenance": touches.provenance,
        "licence": touches.licence,
        "touches": touches.num_touches,
        "labels": number,
        "num_objects": len(np.unique(touches.objects)),
        "actions": list(touches.action_names),
        "threshold": threshold,
        "objects": objects,
        "scenes": scenes,
        "deciders": list(deciders),
        "folds": len(splits),
        "rounds": rounds,
        "max_touches": max_touches,
        "seed": seed,
        "classifier": None if classifier is None else f"{classifier!r:.80}",
        "logits": logits,
        "drop": drop,
        "shuffle": shuffle,
        "notes": [*notes, *dropped, *remarks],
    }
    if out is not None and (Path(out) / RESULTS).exists():
        held = json.loads(require_regular_file(Path(out) / RESULTS, BadArgument).read_text(encoding="utf-8"))
        _require_same(out, held, {name: value for name, value in facts.items() if name != "notes"})
    if save is not None:
        if (Path(save) / RECORDED_FILE).exists():
            _require_same(save, RecordedSensor.read_folder(Path(save)).origin, origin_of(touches))
        RecordedSensor.fit(touches, classifier, logits).save(save)
    leaks = Leaks.of(touches, splits)
    made = [prepare(touches, split, threshold, kinds) for split in splits]
    named, found = list[Named](), list[Found]()
    for place, fold in enumerate(made):
        named += identify_all(fold, [seed, place], threshold, max_touches, rounds)
        found += find_all(fold, deciders, [seed, place], objects, scenes, max_touches)
    report = RecordedReport(made, named, found, facts, leaks)
    if out is not None:
        report.save(out)
    return report


def _require_same(folder: str | Path, held: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Refuse to write over the results, or the sensor, of other recordings or settings."""
    if other := differing(held, wanted):
        raise RunMismatch(f"{folder} holds another run: {other}. Choose another folder, such as {folder}-2")


@dataclass(frozen=True)
class Recorded:
    """Play searches on recorded touches of real objects, with several deciders; report.

    The set is split in order of recording, or by object, a classifier is trained and calibrated, correlations between
    touches are fitted, and objects are then identified, and searched for, by recordings that were not learned from.
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
    task: Literal["objects", "categories", "shapes"] = "objects"
    """Labels: objects are tested on later recordings, categories and shapes on objects that were not learned from."""
    threshold: Share = 0.9
    """Probability of a label at which an object is named."""
    objects: Annotated[int, Within(2, 12)] = _OBJECTS
    """Number of objects of a search, all with different labels; by default fewer where there are no four."""
    scenes: CountOrNone = 10
    """Scenes per split, each with a search for each object; 0 for no searches."""
    deciders: Annotated[tuple[str, ...], NotEmpty()] = DECIDERS
    """Deciders of searches; "best fixed order" has posterior thresholds and the order ranked on calibration touches.
    {max_touches} stands for --max-touches, or the number of different touches of an object if it is smaller. With one
    action, the default leaves out those that then differ in nothing."""
    folds: Annotated[int, Within(2, 100)] = 5
    """Folds of objects for categories and shapes."""
    rounds: Count = 5
    """Identifications of each object by each decider, each with another order of its recordings."""
    max_touches: Annotated[int, Within(1, 100)] = 12
    """Most touches of an object."""
    seed: Seed = 0
    """Seed of orders, scenes and intervals."""
    classifier: str | None = None
    """A classifier of your own in place of ours: module:attribute of an object or class with fit and predict_proba."""
    logits: bool = False
    """Take the features as logits of a classifier of your own, each named as its label."""
    action: tuple[str, ...] = ()
    """Columns that together name the action, such as motion force, in place of the column action."""
    drop: bool = False
    """Leave out objects and labels that have too few touches, by name."""
    shuffle: bool = False
    """Take the sessions in random order: for sets without an order of recording. Recordings of one time leak."""
    save: Path | None = None
    """Folder for a sensor that is trained in the same way on all touches: TactileSensor.load reads it, and its session
    finds objects that you touch."""
    out: Path | None = None
    """Folder for the results; runs/recorded-FORMAT by default, with the task behind it if it is not objects."""

    @ends_claims
    def run(self) -> None:
        """Read, split, search, print and write."""
        check_arguments(self)
        for decider in self.deciders:
            _require_plain(decider, self.max_touches)
        suffix = f"-{self.task}" * (self.task != "objects")
        out = self.out if self.out is not None else Path(f"runs/recorded-{self.format}{suffix}")
        claim_folder(out)
        if self.save is not None:
            claim_folder(self.save)
        classifier = None
        if self.classifier is not None:
            made, reference = find("classifier", self.classifier, {}, "activetouch.classifiers")
            classifier = build(reference.name, made, reference.settings, {}, reference.is_called)
        touches, notes = read_recorded(self.data, self.format, self.action)
        console = plain_console()
        console.print(f"{touches.num_touches} touches, actions: {few(touches.action_names, 20)}")
        for note in notes:
            console.print(f"- {note}")
        names = "threshold", "objects", "scenes", "deciders", "folds", "rounds", "max_touches", "seed"
        settings = {name: getattr(self, name) for name in (*names, "logits", "drop", "shuffle")}
        settings |= {"notes": notes, "save": self.save, "classifier": classifier, "out": out}
        report = recorded(touches, self.task, name=self.format, **settings)
        for note in report.facts["notes"][len(notes) :]:
            console.print(f"- {note}")
        for table in report.tables():
            print(table, end="\n\n")
        for sentence in report.verdict():
            console.print(f"- {sentence}")
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
