"""Tasks among objects in a tray: an action is the number of a cell that is pressed, or an answer in words."""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from activetouch.tray.sensor import TraySensor
from belief.constraints import Checked, NotNegative
from belief.search_progress import Outcome
from belief.tray import Grid, TrayBelief
from experiments.scene_choice import SceneChoice
from experiments.search.benchmark.submission import DIGITS, HEX, Played, PlayedBatch
from experiments.search.drawer.searches import Searches
from experiments.search.play import Seconds, Setting
from planners.episode import ACTION_NAMES
from planners.tray import ConfirmAt, Press, TrayDecision, stated
from planners.tray_session import OUTCOMES, PLACELESS, Lies, TrayAction, ended, is_right

_CONFIRM = "confirm "  # with the number of the cell in which the target is said to be


@dataclass(frozen=True)
class TrayTask(Checked):
    """The searches of a task: scene with its settings, sensor, and cost of a touch."""

    scene: str
    sensor: str
    touch_cost: NotNegative

    @property
    def made(self) -> TraySensor:
        """The sensor, the same one at the next call."""
        return Searches.of(Setting(SceneChoice(self.scene), Path(self.sensor))).made()

    def batch(
        self, seed: int, target: str, numbers: Sequence[int], decider: Any, record: Sequence[Played] = ()
    ) -> PlayedBatch:
        """Searches for a target by a decider, or by the actions of a record where there is one."""
        found, seconds = list[Played](), Seconds()
        for place, number in enumerate(numbers):
            player = _Following(self.made.grid, record[place].actions) if record else decider
            played, spent = self._played((seed, number), target, player)
            found.append(played)
            seconds += spent
        return PlayedBatch(target, numbers[0], seconds, tuple(found))

    def _played(self, key: tuple[int, int], target: str, decider: Any) -> tuple[Played, Seconds]:
        sensor = self.made
        grid = sensor.grid
        session = sensor.session(target, decider, key)
        touched, felt = sensor.touched(target, key), hashlib.sha256()
        actions, probs, seconds, clock = list[int | str](), list[float](), Seconds(), time.perf_counter
        start = clock()
        while (action := session.ask()) is not None:
            decided = clock()
            if isinstance(action, Press):
                met = touched.press(*session.place())
                pressed = clock()
                actions.append(_number(action.cell, grid))
                probs.append(session.standing.target)
                session.tell_met(met)
                seconds += Seconds(pressed - decided, clock() - pressed, decided - start, 1)
                felt.update(b"" if met.image is None else np.float64(met.height).tobytes() + met.image.tobytes())
            else:
                probs.append(stated(session.standing, action))
                at = _number(grid.cell_at(*action.place), grid) if isinstance(action, ConfirmAt) else 0
                actions.append(f"{_CONFIRM}{at}" if isinstance(action, ConfirmAt) else ACTION_NAMES[type(action)])
                session.tell()
                seconds += Seconds(decision=decided - start)
            start = clock()
        rounded = tuple(round(min(prob, 1.0), DIGITS) for prob in probs)
        played = Played(tuple(actions), rounded, felt.hexdigest()[:HEX], str(session.outcome), False)
        judged = self.judged(key, target, played)
        assert not isinstance(judged, str), judged
        return replace(played, success=judged[1]), seconds

    def judged(self, key: tuple[int, int], target: str, search: Played) -> tuple[Outcome, bool, int, float] | str:
        """How actions end a search, whether that is right, its touches and its return; or what is wrong with them."""
        sensor = self.made
        grid = sensor.grid
        try:
            *presses, answer = [_action(one, grid) for one in search.actions]
        except (ValueError, KeyError) as error:
            return f"there is no such action: {error}"
        if not all(isinstance(one, Press) for one in presses) or isinstance(answer, Press):
            return "it has no end, or goes on after its end"
        if len(presses) > sensor.rules.most_touches:
            return f"it has more than {sensor.rules.most_touches} touches"
        way = [(0.0, 0.0), *(grid.centre(one.cell) for one in presses if isinstance(one, Press))]
        success = is_right(*ended(answer), _lay(self, target, key), target)
        cost = len(presses) + sensor.rules.travel * sum(map(math.dist, way, way[1:]))
        outcome = OUTCOMES[type(answer)]
        reward = 0.0 if outcome is Outcome.UNSURE else 1.0 if success else -1.0
        return outcome, success, len(presses), reward - self.touch_cost * cost


@lru_cache(maxsize=1024)
def _lay(task: TrayTask, target: str, key: tuple[int, int]) -> tuple[Lies, ...]:
    """How the objects of a search lie, drawn once for all files of a task."""
    return task.made.world(target, key).lay


@dataclass(frozen=True)
class _Following:
    """Follows the recorded actions of a search."""

    grid: Grid
    actions: Sequence[int | str]

    def choose(self, belief: TrayBelief, at: tuple[float, float], rng: np.random.Generator) -> TrayDecision:
        return TrayDecision(_action(self.actions[belief.num_touches], self.grid))


def _action(action: int | str, grid: Grid) -> TrayAction:
    """What an action of a record means; raises ValueError or KeyError for none."""
    is_here = isinstance(action, str) and action.startswith(_CONFIRM)
    if isinstance(action, str) and not is_here:
        return PLACELESS[action]
    along, across = divmod(int(str(action).removeprefix(_CONFIRM)), grid.cells[1])
    if not 0 <= along < grid.cells[0]:
        raise ValueError(f"the tray has {grid.cells[0] * grid.cells[1]} cells, got {action!r:.40}")
    return ConfirmAt(grid.centre((along, across))) if is_here else Press((along, across))


def _number(cell: tuple[int, int], grid: Grid) -> int:
    return cell[0] * grid.cells[1] + cell[1]
