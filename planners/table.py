"""The deciders a comparison can name. To add one, write it in its own file and add a line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from belief.errors import UnknownName
from belief.observation_model import OutcomeTable
from planners.decider import Decider, SequentialDecider
from planners.probing import FixedOrder, TargetInformationGain
from planners.random_confirm import RandomConfirm
from planners.stopping import ConsecutiveFrames, PosteriorThresholds

DECIDERS: Mapping[str, Callable[[OutcomeTable], Decider]] = MappingProxyType(
    {
        "random_confirm": lambda table: RandomConfirm(),
        "threshold": lambda table: SequentialDecider(ConsecutiveFrames(), FixedOrder()),
        "information_gain": lambda table: SequentialDecider(PosteriorThresholds(), TargetInformationGain(table)),
    }
)
"""Builds a decider by name from the outcome table of the scene's observation model."""


def make_decider(name: str, table: OutcomeTable) -> Decider:
    """The named decider.

    Raises:
        UnknownName: there is none of that name; the message suggests the nearest.
    """
    if name not in DECIDERS:
        raise UnknownName("decider", name, list(DECIDERS))
    return DECIDERS[name](table)
