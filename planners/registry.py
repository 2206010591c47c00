"""The registry of deciders.

To add a decider, write it in its own file and add a line to :data:`DECIDERS`. A user's own decider is named
``module:attribute``, or offered by an installed package as an entry point of the group ``activetouch.deciders``.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from importlib import import_module
from numbers import Integral
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from belief.errors import ActiveTouchError, BrokenContract, MissingPackage, install_command
from belief.observation_model.model import ObservationModel
from belief.observation_model.outcome_table import OutcomeTable
from belief.references import BadReference, Reference, build, find
from planners.decider import Decider, Decision, InformationState, ProbeSelector, SequentialDecider, StoppingRule
from planners.probing import (
    FixedOrder,
    GivenOrder,
    PoseInformationGain,
    RandomOrder,
    ShapeInformationGain,
    TargetInformationGain,
    read_order,
    repeat_discount,
)
from planners.stopping import PosteriorThresholds, RandomConfirm, StopOverride, ThresholdRule

PREFIX = "sb3:"
"""Prefix of the names of deciders that follow a saved policy of Stable-Baselines3."""
POLICY = "policy:"
"""Prefix of the names of deciders that call a function from an observation to an action."""
PROCESS = "process:"
"""Prefix of the names of deciders that ask another program, by lines of JSON."""
ENTRY_POINTS = "activetouch.deciders"
"""Entry-point group of deciders in installed packages."""

Builder = Callable[..., Decider]
"""Returns a decider. It gets ``table``, ``model`` and ``policies`` of :func:`make_decider` if it has parameters with
these names; its other parameters are settings with defaults."""


class WrongType(ActiveTouchError, TypeError):
    """An argument of :func:`make_decider` has the wrong type."""


def _loaded(reference: str) -> Any:
    """A class that is imported only when a decider needs it."""
    module, _, name = reference.partition(":")
    return getattr(import_module(module), name)


def _sequential(
    summary: str, probing: Callable[..., ProbeSelector], stopping: Callable[..., StoppingRule] = PosteriorThresholds
) -> Builder:
    """A builder of a sequential decider with the settings of its two parts; ``summary`` is its docstring.

    The discount of repeats is no setting: probe selectors that use it have a default.
    """
    rule, selector = inspect.signature(stopping).parameters, inspect.signature(probing).parameters

    def sequential(**arguments: Any) -> Decider:
        return SequentialDecider(
            stopping(**{name: value for name, value in arguments.items() if name in rule}),
            probing(**{name: value for name, value in arguments.items() if name in selector}),
        )

    every = (*selector.values(), *rule.values())
    parameters = [p.replace(kind=p.KEYWORD_ONLY) for p in every if p.name != "repeats"]
    sequential.__doc__ = summary
    sequential.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return sequential


def _pouct(table: OutcomeTable, simulations: int = 1000) -> Decider:
    """Tree search by POUCT of pomdp-py, from the belief as a histogram."""
    try:
        decider: Decider = _loaded("planners.pomdp_py_adapter:Pouct")(table, simulations)
    except ImportError as error:
        raise MissingPackage(
            f"the decider 'pouct' needs pomdp-py: {install_command('pomdp')} (wheels exist for Linux and Python 3.11 "
            "and 3.12; elsewhere it is built from source)"
        ) from error
    return decider


def _point_based(
    table: OutcomeTable,
    model: ObservationModel | None,
    rounds: Sequence[int] = (200, 200, 400, 400),
    given: Literal["body", "shape"] = "shape",
) -> Decider:
    """Point-based value iteration on the whole search: plans ahead, weighs what touches cost."""
    decider: Decider = _loaded("planners.point_based:PointBased")(table, repeat_discount(model), rounds, given)
    return decider


def _value_of_information(
    table: OutcomeTable, model: ObservationModel | None, depth: int = 2, max_touches: int | None = None
) -> Decider:
    """Value of information, looking two touches ahead, or one with ``depth=1``."""
    decider: Decider = _loaded("planners.value_of_information:ValueOfInformation")(
        table, depth, repeat_discount(model), max_touches
    )
    return decider


def _ppo(summary: str, state: str) -> Builder:
    """A builder of a decider that follows policies on this state; ``summary`` is its docstring."""

    def ppo(policies: Path | None) -> Decider:
        decider: Decider = _loaded("planners.ppo:PPODecider")(policies, state)
        return decider

    ppo.__doc__ = summary
    return ppo


def confident_ppo(policies: Path | None, confirm: float = 0.99, reject: float = 0.01, max_touches: int = 12) -> Decider:
    """Posterior thresholds, with the poses of the PPO policies."""
    ppo = _loaded("planners.ppo:PPODecider")(policies)
    return StopOverride(PosteriorThresholds(confirm, reject, max_touches), ppo, fallback=ppo)


def _best_order(policies: Path | None, confirm: float = 0.99, reject: float = 0.01, max_touches: int = 12) -> Decider:
    """Posterior thresholds, with the poses in the order that was best on other objects."""
    order = read_order(None if policies is None else policies.parent)
    return SequentialDecider(PosteriorThresholds(confirm, reject, max_touches), GivenOrder(order))


DECIDERS: Mapping[str, Builder] = MappingProxyType(
    {
        "random_confirm": RandomConfirm,
        "threshold": _sequential(
            "The threshold rule of the paper: two confident touches in a row.", FixedOrder, ThresholdRule
        ),
        "random_poses": _sequential("Posterior thresholds, with poses in random order.", RandomOrder),
        "fixed_poses": _sequential("Posterior thresholds, with poses in a fixed order.", FixedOrder),
        "information_gain": _sequential(
            "Posterior thresholds, with the pose that tells most about the target.", TargetInformationGain
        ),
        "best_order": _best_order,
        "shape_information_gain": _sequential(
            "Posterior thresholds, with the pose that tells most about the shape.", ShapeInformationGain
        ),
        "pose_information_gain": _sequential(
            "Posterior thresholds, with the pose that tells most about how the object lies.", PoseInformationGain
        ),
        "value_of_information": _value_of_information,
        "ppo": _ppo("PPO policies on the state of the paper, one per target.", "paper"),
        "ppo_posterior": _ppo("PPO policies on the posterior, one per target.", "posterior"),
        "ppo_gains": _ppo("PPO policies on the joint belief and the gain of each pose, one per target.", "gains"),
        "ppo_goal": _ppo("One PPO policy for all targets, on the joint belief and the gain of each pose.", "goal"),
        "ppo_confident": confident_ppo,
        "pouct": _pouct,
        "point_based": _point_based,
    }
)
"""Builders of deciders by name."""

TRAINED: Mapping[str, str] = MappingProxyType(
    {"ppo": "paper", "ppo_posterior": "posterior", "ppo_gains": "gains", "ppo_goal": "goal", "ppo_confident": "paper"}
)
"""Deciders that follow trained policies, with the state of these (a key of :data:`belief.policy_state.ENCODINGS`)."""

NEED_FILES: frozenset[str] = frozenset({*TRAINED, "best_order"})
"""Deciders that are made from files in a sensor's folder."""

_GIVEN = ("table", "model", "policies")


def summary_of(name: str) -> str:
    """The one-line description of a decider in the registry."""
    return (DECIDERS[name].__doc__ or "").strip().partition("\n")[0]


def find_decider(name: str) -> tuple[Any, Reference]:
    """The builder or object of a decider, not yet called, and its parsed name."""
    if name.startswith(PREFIX):
        path, settings = name.removeprefix(PREFIX), {}
        if path.endswith(")"):  # and no file's name ends so
            path, _, rest = path.rpartition("(")
            settings = dict(Reference.parse(f"sb3({rest}").settings)
        return _loaded("planners.other_agents:SB3Policy"), Reference(name, {"path": path, **settings}, True)
    if name.startswith(POLICY):
        named = Reference.parse(name.removeprefix(POLICY))
        return _loaded("planners.other_agents:FunctionPolicy"), Reference(
            name, {"act": named.name, **named.settings}, True
        )
    if name.startswith(PROCESS):
        command = name.removeprefix(PROCESS)
        return _loaded("planners.process_agent:ProcessAgent"), Reference(name, {"command": command}, True)
    if name.partition("(")[0].endswith(".zip"):
        raise BadReference(f"{name} looks like a policy that Stable-Baselines3 saved: name it {PREFIX}{name}")
    found, reference = find("decider", name, DECIDERS, ENTRY_POINTS)
    if given := [setting for setting in reference.settings if setting in _GIVEN]:
        raise BadReference(f"{name}: {given[0]} is no setting; it is passed to every decider")
    return found, reference


def trained_state(name: str) -> str | None:
    """Key of the state of the policies that a decider follows; None if it follows none."""
    if name.startswith((PREFIX, POLICY, PROCESS)):
        return None
    return TRAINED.get(Reference.parse(name).name)


def make_decider(
    name: str,
    table: OutcomeTable,
    model: ObservationModel | None = None,
    policies: Path | None = None,
    simulations: int | None = None,
) -> Decider:
    """Make a decider from its name.

    Args:
        name: a key of :data:`DECIDERS`, an entry point, or ``module:attribute``; optionally with settings in brackets,
            such as ``information_gain(confirm=0.97)``; ``sb3:PATH``, a policy that Stable-Baselines3 saved;
            ``policy:module:attribute``, a function from an observation to an action; or ``process:COMMAND``, another
            program (:mod:`planners.process_agent`).
        table: p(outcome | pose, shape) of single touches.
        model: the observation model, which some deciders need.
        policies: folder of trained policies, which some deciders need.
        simulations: number per decision of tree-search deciders; the name may also set it.

    Raises:
        UnknownName: there is no such name; the message suggests the nearest.
        BadReference: the name is malformed, its settings do not fit, or it refers to something that is not a decider.
        MissingPackage: it needs a package that is not installed.
        WrongType: an argument has the wrong type, such as a model in place of its table.

    >>> import numpy as np
    >>> table = OutcomeTable(np.full((2, 3, 4), 0.25))
    >>> make_decider("fixed_poses(confirm=0.9)", table)
    SequentialDecider(stopping=PosteriorThresholds(confirm=0.9, reject=0.01, max_touches=12), probing=FixedOrder())
    """
    for argument, value, kind, works in (
        ("name", name, str, f"one of {', '.join(DECIDERS)}, or module:attribute"),
        ("table", table, OutcomeTable, "an observation model's: model.outcome_table()"),
        ("policies", policies, Path | None, "a pathlib.Path"),
        ("simulations", simulations, Integral | None, "an integer"),
    ):
        if not isinstance(value, kind) or isinstance(value, bool):
            raise WrongType(f"{argument} must be {works}; got {_what(value)}")
    if model is not None and not callable(getattr(model, "log_likelihood", None)):
        raise WrongType(
            f"model must be an observation model, such as TactileSensor.shipped('gel').model; got {_what(model)}"
        )
    found, reference = find_decider(name)
    offered: dict[str, Any] = {"table": table, "model": model, "policies": policies}
    if simulations is not None:
        offered["simulations"] = simulations
    try:
        made = build(reference.name, found, reference.settings, offered, reference.is_called)
    except ActiveTouchError:
        raise
    except Exception as error:
        if not (reference.settings or reference.is_users):
            raise
        raise BadReference(f"{name} cannot be made: {error!r}") from error
    if not callable(getattr(made, "decide", None)):
        raise BadReference(f"{name} is no decider: it is {_what(made)}, and has no method decide(info, rng)")
    return made


@dataclass(frozen=True)
class MadeAnew:
    """A decider that holds what cannot be copied, such as a connection; its copies are made again from its name."""

    decider: Decider
    arguments: tuple[Any, ...]  # of :func:`make_decider`

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`."""
        return self.decider.decide(info, rng)

    def __reduce__(self) -> tuple[Any, ...]:
        return copyable, self.arguments


def copyable(player: str | Decider, *arguments: Any, name: str = "") -> Decider:
    """A decider whose copies can play, itself or by its name with further arguments of :func:`make_decider`."""
    decider = make_decider(player, *arguments) if isinstance(player, str) else player
    try:
        deepcopy(decider, {id(one): one for one in arguments})  # which no decider changes
    except Exception as error:
        found = find_decider(player)[0] if isinstance(player, str) else None
        if isinstance(player, str) and (inspect.isclass(found) or inspect.isroutine(found)):
            return MadeAnew(decider, (player, *arguments))
        raise BrokenContract(
            f"the decider {name or player} cannot be copied ({error}), and each batch of searches is played by a copy: "
            "name a class or a function that makes one, as in --deciders module:Class"
        ) from error
    return decider


def _what(value: object) -> str:
    """A short description of a value."""
    return f"{value!r}" if isinstance(value, str | int | float | None) else f"an object of class {type(value).__name__}"
