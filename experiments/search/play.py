"""Live searches: what determines them, how they are played, and what a certificate of their stops holds for.

The seed alone determines the objects of an episode.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import astuple, dataclass
from functools import cached_property, lru_cache
from typing import Any, TypeAlias

from activetouch import Scene, TactileSensor, TouchWorld
from activetouch.scene_description import scene_fields
from activetouch.world import TouchTime, touch_many
from belief.problem import SearchProblem, Touch
from belief.scene_belief import SceneBelief
from belief.seeding import touch_rng
from planners import Decider, Episode, InformationState, search_lockstep
from planners.fingerprint import digest_of, fingerprint, versions
from planners.probing import HYPOTHESES, OUTCOMES
from planners.search import TouchRequest

EPISODES_PER_BATCH = 25
"""Fixed, because the last bits of the network's output depend on which images are read together."""
Seed: TypeAlias = tuple[int, ...]


@dataclass(frozen=True)
class Seconds:
    """Seconds that a set of episodes took, by part; its number of touches, and of presses repeated until settled."""

    physics: float = 0.0
    network: float = 0.0
    decision: float = 0.0
    num_touches: int = 0
    pressed_again: int = 0

    def __add__(self, other: Seconds) -> Seconds:
        """Sum of two sets of episodes."""
        return Seconds(*(mine + theirs for mine, theirs in zip(astuple(self), astuple(other), strict=True)))

    def ms_per_touch(self) -> dict[str, float]:
        """Milliseconds per touch by part; zero without touches."""
        per = 1e3 / self.num_touches if self.num_touches else 0.0
        return {"physics": self.physics * per, "network": self.network * per, "decision": self.decision * per}


@dataclass(frozen=True, eq=False)
class Searches:
    """Everything that determines the searches of a comparison, apart from the decider; the sensor has the scene."""

    sensor: TactileSensor
    problem: SearchProblem
    seed: int
    scene_name: str
    sensor_sha256: str

    @cached_property
    def identity(self) -> dict[str, Any]:
        """These fields as JSON types, which are the same for all searches of one folder."""
        rules = identity_of(self.sensor.scene, self.problem, self.seed)
        return rules | {"sensor_sha256": self.sensor_sha256}

    @cached_property
    def code(self) -> str:
        """Digest of the code of the scene, of the observation model and of the search itself."""
        return digest_of([fingerprint(part) for part in (self.sensor.scene, type(self.sensor.model), play_episodes)])


def identity_of(scene: Scene, problem: SearchProblem, seed: int) -> dict[str, Any]:
    """All that determines searches apart from the sensor, as JSON types."""
    return {"seed": seed, "problem": repr(problem), "scene": scene_fields(scene), "versions": versions()}


def prepare(searches: Searches, decider: Decider, target: int) -> None:
    """Let a decider with a method ``prepare`` load what it needs, or raise what keeps it from playing."""
    if callable(ready := getattr(getattr(decider, "decider", decider), "prepare", None)):
        problem = searches.problem.seeking(target)
        ready(InformationState.of(problem, target, SceneBelief(problem, searches.sensor.model), 0))


@lru_cache(maxsize=1)
def _warm_up(searches: Searches) -> None:
    """Touch once and predict a next touch, so that the loading at the first touch of a process is not timed."""
    sensor, problem, seed = searches.sensor, searches.problem.seeking(0), (searches.seed, 0, 0)
    request = TouchRequest(TouchWorld.of_search(sensor, problem, seed), 0, touch_rng(seed, 0, 0, 0))
    scene = SceneBelief(problem, sensor.model)
    scene.update(0, touch_many(sensor, [request])[0])
    scene.view().evidence(0).outcome_mixture(OUTCOMES, HYPOTHESES)


def play_episodes(
    searches: Searches, decider: Decider, target: int, numbers: Sequence[int]
) -> tuple[list[Episode], Seconds]:
    """Play the episodes of a target with these numbers in lockstep; return them and the time that they took.

    The same arguments give the same episodes, bit for bit, in any process: a copy of the decider plays.
    """
    sensor, problem, spent = searches.sensor, searches.problem.seeking(target), [TouchTime()]
    seeds: list[Seed] = [(searches.seed, target, number) for number in numbers]
    worlds = [TouchWorld.of_search(sensor, problem, seed) for seed in seeds]
    waited = 0.0

    def touch_and_time(requests: Sequence[TouchRequest[TouchWorld]]) -> list[Touch]:
        nonlocal waited
        asked = time.perf_counter()
        touches, seconds = touch_many(sensor, requests)
        spent.append(seconds)
        waited += time.perf_counter() - asked
        return touches

    player = deepcopy(decider, {id(sensor.model): sensor.model})  # which no decider changes
    _warm_up(searches)
    prepare(searches, player, target)
    targets, started = [target] * len(worlds), time.perf_counter()
    episodes = search_lockstep(worlds, player, problem, targets, sensor.model, seeds, touch_and_time)
    thinking = time.perf_counter() - started - waited
    touches = sum(episode.num_touches for episode in episodes)
    seconds = sum(spent, TouchTime())
    return episodes, Seconds(seconds.physics, seconds.network, thinking, touches, seconds.pressed_again)
