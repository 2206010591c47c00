"""The deciders a comparison can name. To add one, write it in its own file and add a line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path
from types import MappingProxyType, ModuleType

from belief.errors import ActiveTouchError, UnknownName
from belief.observation_model import ObservationModel, OutcomeTable
from planners.decider import Decider, SequentialDecider
from planners.point_based import PointBased
from planners.ppo import PPODecider
from planners.probing import FixedOrder, RandomOrder, ShapeInformationGain, TargetInformationGain
from planners.random_confirm import RandomConfirm
from planners.repeats import repeat_discount
from planners.stop_override import StopOverride
from planners.stopping import PosteriorThresholds, SequentialTest
from planners.threshold_rule import ThresholdRule
from planners.value_of_information import ValueOfInformation


@dataclass(frozen=True, eq=False)
class Knowledge:
    """What a decider can be made from, before any touch.

    Attributes:
        table: p(outcome | pose, shape) of single touches, which most deciders plan on.
        model: the observation model itself, for those that plan on touches as they are.
        policies: folder of trained policies, for those that follow one.
        simulations: of each decision, for those that search a tree.
    """

    table: OutcomeTable
    model: ObservationModel | None = None
    policies: Path | None = None
    simulations: int = 1000


class WrongType(ActiveTouchError, TypeError):
    """A decider was to be made from something else than it takes."""


class MissingPackage(ActiveTouchError, ImportError):
    """A decider needs a package that is not installed; the message says how to get it."""


def _tree_search() -> ModuleType:
    try:
        from planners import pomdp_py_adapter
    except ImportError as error:
        raise MissingPackage(
            "the deciders 'pouct' and 'pomcp' need pomdp-py: pip install 'activetouch[pomdp]' (wheels exist for Linux "
            "and Python 3.11 and 3.12; elsewhere it is built from source)"
        ) from error
    return pomdp_py_adapter


def confident_ppo(policies: Path | None) -> Decider:
    """The poses of the paper's policies, and a stop when the posterior is sure."""
    ppo = PPODecider(policies)
    return StopOverride(PosteriorThresholds(), ppo, fallback=ppo)


DECIDERS: Mapping[str, Callable[[Knowledge], Decider]] = MappingProxyType(
    {
        "random_confirm": lambda known: RandomConfirm(),
        "threshold": lambda known: SequentialDecider(ThresholdRule(), FixedOrder()),
        "random_poses": lambda known: SequentialDecider(PosteriorThresholds(), RandomOrder()),
        "fixed_poses": lambda known: SequentialDecider(PosteriorThresholds(), FixedOrder()),
        "information_gain": lambda known: SequentialDecider(PosteriorThresholds(), TargetInformationGain(known.table)),
        "shape_information_gain": lambda known: SequentialDecider(
            PosteriorThresholds(), ShapeInformationGain(known.table)
        ),
        "repeat_aware": lambda known: SequentialDecider(
            PosteriorThresholds(), TargetInformationGain(known.table, repeat_discount(known.model))
        ),
        "value_of_one_touch": lambda known: ValueOfInformation(known.table, 1, repeat_discount(known.model)),
        "value_of_information": lambda known: ValueOfInformation(known.table, 2, repeat_discount(known.model)),
        "sequential_test": lambda known: SequentialDecider(SequentialTest(), TargetInformationGain(known.table)),
        "ppo": lambda known: PPODecider(known.policies),
        "ppo_posterior": lambda known: PPODecider(known.policies, "posterior"),
        "ppo_confident": lambda known: confident_ppo(known.policies),
        "pouct": lambda known: _tree_search().Pouct(known.table, known.simulations),
        "pomcp": lambda known: _tree_search().Pomcp(known.table, known.simulations),
        "point_based": lambda known: PointBased(known.table, repeat_discount(known.model)),
    }
)
"""Builds a decider by name from what is known of the scene's touches."""

TRAINED = frozenset(("ppo", "ppo_posterior", "ppo_confident"))
"""Those that follow trained policies, and cannot be made of a bare model."""


def make_decider(
    name: str,
    table: OutcomeTable,
    model: ObservationModel | None = None,
    policies: Path | None = None,
    simulations: int = 1000,
) -> Decider:
    """The named decider.

    Args:
        name: a key of :data:`DECIDERS`.
        table: p(outcome | pose, shape) of single touches.
        model: the observation model itself; some deciders need it.
        policies: folder of trained policies; some deciders need it.
        simulations: of each decision, for deciders that search a tree.

    Raises:
        UnknownName: there is none of that name; the message suggests the nearest.
        MissingPackage: it needs a package that is not installed.
        WrongType: an argument is something else than it should be, such as a model in place of its table.
    """
    for argument, value, kind, works in (
        ("name", name, str, f"one of {', '.join(DECIDERS)}"),
        ("table", table, OutcomeTable, "an observation model's: model.outcome_table()"),
        ("policies", policies, Path | None, "a pathlib.Path"),
        ("simulations", simulations, Integral, "an integer"),
    ):
        if not isinstance(value, kind) or isinstance(value, bool):
            raise WrongType(f"{argument} must be {works}; got {_what(value)}")
    if model is not None and not callable(getattr(model, "log_likelihood", None)):
        raise WrongType(
            f"model must be an observation model, such as TactileSensor.shipped('gel').model; got {_what(model)}"
        )
    if name not in DECIDERS:
        raise UnknownName("decider", name, list(DECIDERS))
    return DECIDERS[name](Knowledge(table, model, policies, simulations))


def _what(value: object) -> str:
    """A value that was given, in few words."""
    return f"{value!r}" if isinstance(value, str | int | float | None) else f"an object of class {type(value).__name__}"
