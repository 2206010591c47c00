"""Deciders, which choose when to stop and where to probe, and the search loop that runs them."""

from pathlib import Path

import belief

if Path(belief.__file__ or "").resolve().parent.parent != Path(__file__).resolve().parent.parent:
    raise ImportError(f"{belief.__file__ or belief.__path__} hides the package 'belief' of activetouch: rename it")

from belief.search_progress import Outcome
from planners.check import check_decider
from planners.decider import Decider, Decision, InformationState, SequentialDecider
from planners.episode import Episode, Step
from planners.registry import DECIDERS, make_decider
from planners.search import World, search, search_lockstep
from planners.session import Session

__all__ = [
    "DECIDERS",
    "Decider",
    "Decision",
    "Episode",
    "InformationState",
    "Outcome",
    "SequentialDecider",
    "Session",
    "Step",
    "World",
    "check_decider",
    "make_decider",
    "search",
    "search_lockstep",
]
