"""Searches one after the other with one set-up, whose conflict test runs on from search to search.

A set-up is a robot with its sensor. If its world is not the one that the observation model was fitted to, it is so in
every search. One search makes few touches; the touches of several tell it. The false-alarm rate is for all searches of
a set-up together.
"""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from belief.naming import Name
from belief.observation_model.model import ObservationModel
from belief.problem import SearchProblem
from belief.scene_belief import SceneBelief
from belief.validation import Floats
from planners.decider import Decider
from planners.episode import Episode
from planners.search import TouchMany, WorldT, search_lockstep


def search_in_turn(
    worlds: Sequence[Sequence[WorldT]],
    decider: Decider,
    problem: SearchProblem,
    targets: Sequence[Sequence[Name]],
    model: ObservationModel,
    seeds: Sequence[Sequence[int | Sequence[int]]],
    touch_many: TouchMany[WorldT] | None = None,
) -> list[list[Episode]]:
    """The searches of several set-ups: all first searches at once, then all second ones, and so on.

    Args:
        worlds: of each search of each set-up; set-ups may have different numbers of searches.
        decider: chooses the actions.
        problem: each search.
        targets: label or index of each target.
        model: likelihood of touches.
        seeds: of each search.
        touch_many: see :func:`planners.search.search_lockstep`.

    Raises:
        ValueError: the lengths differ; or as :func:`planners.search.search`.
    """
    for given, what in ((targets, "targets"), (seeds, "seeds")):
        if [len(some) for some in given] != [len(some) for some in worlds]:
            raise ValueError(f"there must be as many {what} as worlds in each of the {len(worlds)} set-ups")
    log_bets: list[ArrayLike] = [0.0] * len(worlds)
    played: list[list[Episode]] = [[] for _ in worlds]
    for turn in range(max(map(len, worlds), default=0)):
        on = [place for place, some in enumerate(worlds) if turn < len(some)]
        episodes = search_lockstep(
            [worlds[place][turn] for place in on],
            decider,
            problem,
            [targets[place][turn] for place in on],
            model,
            [seeds[place][turn] for place in on],
            touch_many,
            [log_bets[place] for place in on],
        )
        for place, episode in zip(on, episodes, strict=True):
            played[place].append(episode)
            log_bets[place] = log_bets_after(episode, problem, model, log_bets[place])
    return played


def log_bets_after(
    episode: Episode, problem: SearchProblem, model: ObservationModel, log_bets: ArrayLike = 0.0
) -> Floats:
    """Log wealth of the conflict test after a search, with which the next search of the set-up begins, ``(J,)``.

    Args:
        episode: the search, with the features of its touches.
        problem: of the search.
        model: likelihood of touches.
        log_bets: with which the search began.
    """
    scene = SceneBelief(problem, model, log_bets=log_bets)
    for step in episode.steps:
        if step.touch is not None:
            scene.update(step.object_index, [step.touch])
    return scene.log_bets
