"""``activetouch overprobing``: does a decider go on probing once it could be sure (paper §7.2), and to what end?"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from rich import box
from rich.table import Table

from belief import Confirm, Reject
from belief.errors import ActiveTouchError
from belief.files import write_text
from belief.statistics import wilson_interval
from experiments.command_line.arguments import Within, check_arguments
from experiments.command_line.console import plain_console
from experiments.search.run_folder import RunFolder, read_episode
from planners import Episode, Step

Share = tuple[float, float, float]
"""A share and its 95 % Wilson interval."""


@dataclass(frozen=True)
class Overprobing:
    """What a decider did after the posterior had been sure of an object, that it is the target or that it is not.

    Attributes:
        decider: who.
        objects: of which it became sure at some touch.
        late_touches: mean of the touches made after the first sure one.
        went_on: share of these objects that were touched again.
        doubted: share where a later touch took the certainty away.
        first_wrong: share where the decision that was certain first would have been wrong.
        wrong: share where the decision that was taken was wrong; no decision counts as wrong.
    """

    decider: str
    objects: int
    late_touches: float
    went_on: Share
    doubted: Share
    first_wrong: Share
    wrong: Share


def overprobing(decider: str, episodes: Iterable[Episode], confidence: float) -> Overprobing | None:
    """Counts over all objects of all episodes; None where it never became sure.

    Args:
        decider: whose episodes they are.
        episodes: searches.
        confidence: from which posterior on it is sure.
    """
    late, doubted, first_wrong, wrong = [], [], [], []
    for episode in episodes:
        for shape, steps in _objects(episode):
            is_target = shape == episode.target
            probs = np.array([step.belief.probs[episode.target] for step in steps])
            sure = np.maximum(probs, 1.0 - probs) >= confidence
            sure[0] = False  # nothing was touched yet: what others told is not the question
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
    shares = [_share(some) for some in ([n > 0 for n in late], doubted, first_wrong, wrong)]
    return Overprobing(decider, len(late), float(np.mean(late)), *shares)


def _share(hits: Sequence[bool]) -> Share:
    low, high = wilson_interval(sum(hits), len(hits))
    return sum(hits) / len(hits), float(low), float(high)


def _objects(episode: Episode) -> Iterator[tuple[int, list[Step]]]:
    """True shape and steps of every object that was decided about."""
    for index, shape in enumerate(episode.arrangement):
        steps = [step for step in episode.steps if step.object_index == index]
        if steps:
            yield shape, steps


class NothingToCount(ActiveTouchError, ValueError):
    """No decider was ever sure of an object."""


@dataclass(frozen=True)
class OverprobingCommand:
    """Measure touches after certainty in a finished comparison: how many, how often they take it away, at what price.

    For example:

        activetouch compare --scene coarse --deciders threshold ppo ppo_posterior ppo_confident
        activetouch overprobing --folder runs/compare-coarse
    """

    folder: Path = Path("runs/compare")
    """Folder of a finished comparison; overprobing.json is written there."""
    confidence: Annotated[float, Within(0.5, 1.0, open_low=True)] = 0.95
    """Posterior from which on an object counts as known to be, or not to be, the target."""

    def run(self) -> None:
        """Read, count, print.

        Raises:
            NothingToCount: no decider was ever sure of an object.
        """
        check_arguments(self)
        run = RunFolder(self.folder)
        labels = tuple(_shape_labels(run))
        episodes: dict[str, list[Episode]] = {}
        for key in (key for key in run.complete_keys() if key.is_played):
            episodes.setdefault(key.decider, []).extend(read_episode(line, labels) for line in run.lines(key))
        found = [one for name, some in episodes.items() if (one := overprobing(name, some, self.confidence))]
        if not found:
            num = sum(map(len, episodes.values()))
            raise NothingToCount(
                f"no decider in {self.folder} was ever sure of an object at --confidence {self.confidence} in "
                f"{num} episodes. Take a lower one, or play more with:\n{run.again(episodes=num + 1000)}"
            )
        write_text(self.folder / "overprobing.json", json.dumps([asdict(one) for one in found], indent=1) + "\n")
        table = Table(box=box.SIMPLE_HEAD, caption_justify="left")
        table.caption = f"of objects that the posterior was sure of at {self.confidence} at some touch; 95 % Wilson"
        for heading in ("decider", "objects", "touches after", "went on", "doubted", "first wrong", "wrong"):
            table.add_column(heading, justify="left" if heading == "decider" else "right")
        for one in found:
            shares = (one.went_on, one.doubted, one.first_wrong, one.wrong)
            cells = [f"{share:.3f} [{low:.3f}, {high:.3f}]" for share, low, high in shares]
            table.add_row(one.decider, str(one.objects), f"{one.late_touches:.2f}", *cells)
        plain_console(width=140).print(table)


def _shape_labels(run: RunFolder) -> Iterable[str]:
    from experiments.search.setting import Setting

    return Setting.from_dict(run.read_run()["arguments"]["setting"]).problem.shape_labels
