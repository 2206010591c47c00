"""``activetouch recorded``: searches among recorded objects, and what they say about a belief on real touches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from activetouch.extras import require_extra
from activetouch.recorded import TaskTouches, check_recorded, read_recorded, without_incomplete
from activetouch.recorded.formats import Format
from activetouch.recorded.reader import num_tried
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
from experiments.recorded.finding import FIXED, find_all
from experiments.recorded.fold import Fold, main_splits, prepare
from experiments.recorded.identifying import after_touches, fewest_touches, identify_all
from experiments.recorded.leaks import controls, num_steps, random_splits
from experiments.recorded.results import Measured, Part
from planners.registry import find_decider, trained_state

DECIDERS = (
    "point_based",
    "value_of_information",
    "information_gain(max_touches={max_touches})",
    FIXED,
    "random_poses(max_touches={max_touches})",
)
_WIDTH = 136  # of the tables [characters]


@dataclass(frozen=True)
class Recorded:
    """Play searches on recorded touches of real objects, with several deciders; report.

    The set is split by time or by object, a classifier is trained and calibrated, correlations between touches are
    fitted, and objects are then identified, and searched for, by their held-out recordings. Needs the extra
    "recorded".
    docs/real_touch.md describes the formats; "csv" and "npz" are for touches of your own.

    For example:

        activetouch recorded --data my_touches --format csv
        activetouch recorded --data cy101 --format cy101 --task categories
        activetouch recorded --data sdh2 --format sdh2 --task shapes --objects 3
    """

    data: Path
    """Folder of the recordings; for npz also the file."""
    format: Format
    """Format of the recordings."""
    task: Literal["objects", "categories", "shapes"] = "objects"
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
    random_splits: Count = 3
    """Random splits for the leak control."""
    rounds: Count = 5
    """Identifications of each object by each decider, each with another order of its recordings."""
    leave_out_incomplete: bool = False
    """Leave out objects with too few sessions of an action, instead of refusing the set."""
    max_touches: Annotated[int, Within(1, 100)] = 12
    """Most touches of an object."""
    seed: Seed = 0
    """Seed of splits, orders, scenes and intervals."""
    out: Path | None = None
    """Folder for the results; runs/recorded-FORMAT-TASK by default."""

    @ends_claims
    def run(self) -> None:
        """Read, split, search, print and write."""
        check_arguments(self)
        require_extra("recorded")
        for name in self.deciders:
            if name != FIXED:
                given = name.replace("{max_touches}", str(self.max_touches))
                find_decider(given)  # raises UnknownName
                if trained_state(given) is not None or name == "best_order":
                    raise BadArgument(
                        f"--deciders {name} needs a file of a sensor's folder, and recorded touches have no sensor; "
                        f'the order that is ranked on them is "{FIXED}"'
                    )
        out = self.out if self.out is not None else Path(f"runs/recorded-{self.format}-{self.task}")
        claim_folder(out)
        touches, notes = read_recorded(self.data, self.format)
        if self.leave_out_incomplete:
            touches, left_out = without_incomplete(touches, self.task)
            notes = (*notes, *left_out)
        remarks = check_recorded(touches, self.task)
        chosen = touches.for_task(self.task)
        if self.threshold <= (guess := 1.0 / len(chosen.label_names)):
            raise BadArgument(
                f"--threshold must be above {guess:.3g}, the probability of each of the {len(chosen.label_names)} "
                f"{self.task} before the first touch, got {self.threshold:g}"
            )
        console = plain_console()
        console.print(
            f"{len(chosen.rows)} touches, {len(chosen.label_names)} {self.task}, actions: "
            f"{', '.join(touches.action_names)}"
        )
        for note in (*notes, *remarks):
            console.print(f"- {note}")
        measured = measure(chosen, self)
        if self.scenes and (remark := self._too_few(measured.main)):
            console.print(f"- {remark}")
            remarks = (*remarks, remark)
        from experiments.recorded.report import write_report  # loads matplotlib

        tables, verdict = write_report(out, measured, self._facts(chosen, (*notes, *remarks)))
        wide = plain_console(width=max(_WIDTH, console.width))  # rich leaves out columns for which there is no room
        for table in tables:
            wide.print(table.rich())
        for sentence in verdict:
            console.print(f"- {sentence}")
        print(f"wrote report.html, recorded.md, results.json, episodes.jsonl and figures into {out}")

    def _too_few(self, part: Part) -> str:
        """What to say if a split tests too few labels for searches; empty if each tests enough."""
        numbers = [len(np.unique(fold.bank.labels)) for fold in part.folds]
        able, most = sum(number >= self.objects for number in numbers), max(numbers)
        if able == len(numbers):
            return ""
        if able:
            return (
                f"there are searches among {self.objects} objects in {able} of {len(numbers)} splits only; the others "
                f"test fewer different {self.task}"
            )
        return (
            f"there are no searches among {self.objects} objects: those that a split tests have at most {most} "
            f"different {self.task}; give " + (f"--objects {most}" if most > 1 else "fewer --folds")
        )

    def _facts(self, chosen: TaskTouches, notes: tuple[str, ...]) -> dict[str, Any]:
        source = chosen.source
        return {
            "format": self.format,
            "task": self.task,
            "provenance": source.provenance,
            "licence": source.licence,
            "touches": len(chosen.rows),
            "labels": len(chosen.label_names),
            "things": len(set(chosen.objects.tolist())),
            "actions": list(source.action_names),
            "threshold": self.threshold,
            "objects": self.objects,
            "scenes": self.scenes,
            "deciders": list(self.deciders),
            "folds": self.folds,
            "random_splits": self.random_splits,
            "rounds": self.rounds,
            "max_touches": self.max_touches,
            "leave_out_incomplete": self.leave_out_incomplete,
            "seed": self.seed,
            "notes": list(notes),
        }


def measure(chosen: TaskTouches, command: Recorded) -> Measured:
    """Everything that the command reports.

    Args:
        chosen: touches of a task.
        command: its settings.
    """
    main, splits = main_splits(chosen, command.folds)
    choice = command.seed, command.random_splits
    drawn = random_splits(chosen, *choice) if chosen.task == "objects" else []
    total = num_steps(chosen, splits, *choice) + sum(num_tried(chosen, split) for split in drawn)
    with progress_bar() as bar:
        advance = partial(bar.advance, bar.add_task("reading touches", total=total))
        folds = [prepare(chosen, split, command.threshold, advance=advance) for split in splits]
        known = [prepare(chosen, split, command.threshold, ("kernel",), advance) for split in drawn]
        found = controls(chosen, splits, [fold.reading for fold in folds], main, *choice, advance)
        played = partial(bar.advance, bar.add_task("naming and searching", total=len(folds) + len(known)))
        others = [_part("random sessions", known, command, played, False)] if drawn else []
        return Measured(_part(main, folds, command, played), others, found)


def _part(name: str, folds: list[Fold], command: Recorded, advance: Callable[[], object], is_main: bool = True) -> Part:
    named, after, losses, fewest, found, oracle = [], [], [], [], [], []
    for number, fold in enumerate(folds):
        seed = [command.seed, number]
        limits = command.threshold, command.max_touches, command.rounds
        named += identify_all(fold, seed, *limits, tuple(fold.models))
        beliefs, by_law = after_touches(fold, command.seed)
        after += beliefs
        losses.append(by_law)
        fewest.append(fewest_touches(fold, command.threshold, command.max_touches))
        if is_main and command.scenes:
            searches, known = find_all(
                fold, command.deciders, seed, command.objects, command.scenes, command.max_touches
            )
            found += searches
            oracle += known
        advance()
    return Part(name, folds, named, after, losses, fewest, found, oracle)
