"""``activetouch overprobing``: probes made after the posterior was certain of an object (paper §7.2)."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from belief.errors import ActiveTouchError
from belief.files import write_text
from belief.problem import Confirm, Reject
from belief.statistics import wilson_interval
from experiments.command_line.arguments import Within, check_arguments
from experiments.command_line.console import plain_console
from experiments.command_line.trust import Trust
from experiments.reporting.tables import Table, interval
from experiments.search.run_folder import RunFolder, read_episode
from experiments.search.setting import Setting
from planners import Episode

_FractionAndInterval = tuple[float, float, float]  # 95 % Wilson interval


@dataclass(frozen=True)
class Overprobing:
    """Touches and errors of a decider after the posterior was certain whether an object is the target.

    Attributes:
        decider: name of the decider.
        objects: number of objects for which the posterior became certain.
        late_touches: mean number of touches after the first touch with a certain posterior.
        went_on: fraction of these objects that were touched again.
        doubted: fraction for which a later touch made the posterior uncertain again.
        first_wrong: fraction for which the first certain decision would have been wrong.
        wrong: fraction for which the final decision was wrong; no decision counts as wrong.
    """

    decider: str
    objects: int
    late_touches: float
    went_on: _FractionAndInterval
    doubted: _FractionAndInterval
    first_wrong: _FractionAndInterval
    wrong: _FractionAndInterval


def overprobing(decider: str, episodes: Iterable[Episode], confidence: float) -> Overprobing | None:
    """Count touches and errors after certainty, over all objects of all episodes.

    Args:
        decider: name of the decider.
        episodes: searches of the decider.
        confidence: smallest posterior that counts as certain.

    Returns:
        None if the posterior never became certain.
    """
    late, doubted, first_wrong, wrong = [], [], [], []
    for episode in episodes:
        for index, shape in enumerate(episode.arrangement):
            steps = [step for step in episode.steps if step.object_index == index]
            if not steps:
                continue
            is_target = shape == episode.target
            probs = np.array([step.belief.probs[episode.target] for step in steps])
            sure = np.maximum(probs, 1.0 - probs) >= confidence
            sure[0] = False  # before the first touch
            if not sure.any():
                continue
            first, last = int(sure.argmax()), steps[-1].decision.action
            late.append(sum(step.touch is not None for step in steps[first:]))
            doubted.append(not bool(sure[first:].all()))
            first_wrong.append(bool(probs[first] >= 0.5) != is_target)
            right = isinstance(last, Confirm) if is_target else isinstance(last, Reject)
            wrong.append(not right)
    if not late:
        return None
    fractions = [_fraction(some) for some in ([n > 0 for n in late], doubted, first_wrong, wrong)]
    return Overprobing(decider, len(late), float(np.mean(late)), *fractions)


def _fraction(hits: Sequence[bool]) -> _FractionAndInterval:
    low, high = wilson_interval(sum(hits), len(hits))
    return sum(hits) / len(hits), float(low), float(high)


class NothingToCount(ActiveTouchError, ValueError):
    """The posterior never became certain of an object."""


@dataclass(frozen=True)
class OverprobingCommand:
    """Count the touches after certainty in a finished comparison, and how often they change the decision.

    For example:

        activetouch compare --scene paper --sensor paper-independent --deciders threshold ppo ppo_posterior
        activetouch overprobing --folder runs/compare-paper
    """

    folder: Path = Path("runs/compare")
    """Folder of a finished comparison; overprobing.json is written there."""
    confidence: Annotated[float, Within(0.5, 1.0, open_low=True)] = 0.95
    """Smallest posterior probability that counts as certain."""
    trust: bool = False
    """Run code of your own that the folder names, such as a scene module:attribute."""

    def run(self) -> None:
        """Read the episodes, count and print.

        Raises:
            NothingToCount: The posterior never became certain of an object.
            FileNamesCode: The folder names code, and ``trust`` is not set.
        """
        check_arguments(self)
        run = RunFolder(self.folder)
        setting = Setting.from_dict(
            run.read_run()["arguments"].get("setting"), Trust(self.folder, everything=self.trust)
        )
        labels = tuple(setting.problem.shape_labels)
        episodes: dict[str, list[Episode]] = {}
        keys = [key for key in run.complete_keys() if key.is_played]
        for key in keys:
            episodes.setdefault(key.decider, []).extend(read_episode(line, labels) for line in run.lines(key))
        found = [one for name, some in episodes.items() if (one := overprobing(name, some, self.confidence))]
        if not found:
            num, most = sum(map(len, episodes.values())), max((key.episodes(key.most).stop for key in keys), default=0)
            raise NothingToCount(
                f"no posterior in {self.folder} reached --confidence {self.confidence} in {num} episodes. Use a lower "
                f"value, or run more searches with:\n{run.again(episodes=most + 1000)}"
            )
        write_text(self.folder / "overprobing.json", json.dumps([asdict(one) for one in found], indent=1) + "\n")
        shares = ("probed again", "revised", "first wrong", "wrong")
        columns = ["decider", ("objects", "d"), ("touches after", ".2f"), *shares]
        rows: list[tuple[Any, ...]] = [
            (
                *(one.decider, one.objects, one.late_touches),
                *(interval(*share) for share in (one.went_on, one.doubted, one.first_wrong, one.wrong)),
            )
            for one in found
        ]
        note = f"Objects whose posterior reached {self.confidence} at some touch; 95 % Wilson intervals"
        plain_console(width=140).print(Table("", columns, rows, note).rich())
