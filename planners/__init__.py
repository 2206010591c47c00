"""Deciders, which choose when to stop and where to probe, and the search loop that runs them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import belief

if Path(belief.__file__ or "").resolve().parent.parent != Path(__file__).resolve().parent.parent:
    raise ImportError(f"{belief.__file__ or belief.__path__} hides the package 'belief' of activetouch: rename it")

from belief.naming import later
from belief.search_progress import Outcome
from planners.decider import Decider, Decision, InformationState, SequentialDecider
from planners.episode import Episode, Step
from planners.registry import DECIDERS, make_decider
from planners.search import World, search, search_lockstep
from planners.session import Session

if TYPE_CHECKING:
    from planners.check import check_decider
    from planners.classification import ActiveClassification

__all__ = [
    "DECIDERS",
    "ActiveClassification",
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

__getattr__, __dir__ = later(__name__)
