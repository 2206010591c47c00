"""The rules of a search with a sensor, and its decider."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from belief.arrangement import num_states
from belief.composition import Composition, Counts
from belief.errors import InvalidArgument
from belief.naming import Name, index_of
from belief.observation_model.model import ArrayModel
from belief.problem import SearchProblem
from belief.seeding import checked_key
from planners import Decider, make_decider
from planners.session import Session, SessionSettings

if TYPE_CHECKING:
    from activetouch.sensor.protocol import Sensor


def problem_of(
    usual: SearchProblem,
    touches_per_object: int,
    num_objects: int | None,
    composition: Composition | Counts | str | None,
    touch_cost: float,
    unlisted: float,
    opinion: ArrayLike | None,
) -> SearchProblem:
    """The usual search with changed rules; objects are independent, with a warning, if the exact sum is too large."""
    if num_objects is None:
        most = composition.total if isinstance(composition, Counts) else usual.num_objects
        num_objects = min(usual.num_objects, most)
    problem = replace(
        usual,
        num_objects=num_objects,
        composition=Composition(composition) if isinstance(composition, str) else composition or usual.composition,
        touch_cost=touch_cost,
        unlisted=unlisted,
        opinion=opinion,
        touch_limit=touches_per_object * num_objects,
    )
    try:
        if composition is None and problem.counts is not None:
            num_states(problem.counts, num_objects)
    except InvalidArgument as error:
        warnings.warn(f"the objects are taken to be independent, so that two may be alike: {error}", stacklevel=4)
        problem = replace(problem, composition=Composition.INDEPENDENT)
    return problem


def player_of(
    problem: SearchProblem, model: ArrayModel, target: Name, decider: str | Decider, seed: int | Sequence[int]
) -> tuple[int, tuple[int, ...], Decider]:
    """Index of the target, key of the search, and the decider."""
    shape, words = index_of("target", problem.shape_labels, target), checked_key(seed)
    key = (*words, shape, 0) if len(words) == 1 else words
    return shape, key, make_decider(decider, model.outcome_table(), model) if isinstance(decider, str) else decider


def with_misses(settings: SessionSettings) -> SessionSettings:
    """Settings of a session in which, if it may abstain, an image that could be one of no contact is a miss."""
    is_abstaining = settings.get("abstain")
    is_abstaining = settings.get("arrangement") is None if is_abstaining is None else is_abstaining
    if is_abstaining and settings.get("least_area") is None:
        return {**settings, "least_area": 0.0}
    return settings


def naming_of(
    sensor: Sensor, decider: str | Decider, seed: int | Sequence[int], log: str | Path | None, rules: Mapping[str, Any]
) -> Session:
    """A session with a sensor that names one object (:func:`planners.search.naming_session`)."""
    from planners.search import naming_session  # searches do not need it

    model = sensor.model
    made = make_decider(decider, model.outcome_table(), model) if isinstance(decider, str) else decider
    rules = {"least_area": 0.0, "reader": sensor.image_reader, **rules}
    return naming_session(made, model, sensor.pose_labels, seed, **rules).begun(log)
