"""The registry of observation models. To add one, derive from :class:`ArrayModel` and add a line here.

A model of your own needs no line: name its class ``module:attribute`` where it is fitted. Its file can be read where an
installed package offers the class by an entry point of the group ``activetouch.observation_models``, under the class's
``name``. Reading a file never imports what the file itself names.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Any

from belief.observation_model.baselines.confusion import ConfusionModel
from belief.observation_model.baselines.gaussian import GaussianModel
from belief.observation_model.baselines.plda import PLDAModel
from belief.observation_model.baselines.signature import SignatureModel
from belief.observation_model.likelihood_ratio import RatioModel
from belief.observation_model.model import ArrayModel
from belief.references import BadReference, Reference, entry_point_names, find

Fit = Callable[..., ArrayModel]
"""Builds a model from touches, shapes and object ids; takes ``shape_labels`` and ``num_poses`` too."""

ENTRY_POINTS = "activetouch.observation_models"
"""Group of entry points by which installed packages offer observation models."""

_EDGES = (0.6, 0.9, 0.99)

OBSERVATION_MODELS: Mapping[str, Fit] = MappingProxyType(
    {
        "confusion": ConfusionModel.fit,
        "confusion × confidence": partial(ConfusionModel.fit, confidence_edges=_EDGES),
        "signature": partial(SignatureModel.fit, confidence_edges=_EDGES),
        "gaussian": GaussianModel.fit,
        "plda": PLDAModel.fit,
        "ratio": RatioModel.fit,
    }
)
"""Every observation model by name, as the function that fits it."""


def kinds(fits: Mapping[str, Fit] | None = None) -> dict[str, type[ArrayModel]]:
    """The classes of a registry, by default :data:`OBSERVATION_MODELS`, by the names that their files bear.

    >>> kinds()["ratio"].__name__
    'RatioModel'
    """
    all_fits = (OBSERVATION_MODELS if fits is None else fits).values()
    found = [getattr(fit.func if isinstance(fit, partial) else fit, "__self__", None) for fit in all_fits]
    return {kind.name: kind for kind in found if inspect.isclass(kind) and issubclass(kind, ArrayModel)}


def class_named(kind: str) -> type[ArrayModel]:
    """The class of the models whose files bear a name.

    Args:
        kind: from the file.

    Raises:
        ValueError: neither the registry nor an installed package has it.

    >>> class_named("ratio").__name__
    'RatioModel'
    """
    known = kinds()
    if kind in known:
        return known[kind]
    offered = entry_point_names(ENTRY_POINTS)
    if kind not in offered:
        raise ValueError(f"unknown kind {kind!r}, known are {', '.join(sorted([*known, *offered]))}")
    found = Reference.parse(offered[kind]).load()
    if not (inspect.isclass(found) and issubclass(found, ArrayModel)):
        raise ValueError(f"the kind {kind!r} is {offered[kind]}, which is no class derived from ArrayModel")
    return found


def require_readable(model: ArrayModel) -> None:
    """Check that a model can be read back once it is written.

    Raises:
        BadReference: nothing would know its class.

    >>> from belief.synthetic import random_model
    >>> import numpy as np
    >>> require_readable(random_model(np.random.default_rng(0)))
    """
    try:
        class_named(model.name)
    except ValueError as error:
        kind = type(model)
        raise BadReference(
            f"no command could read a file of the observation model {model.name!r}: offer its class from an installed "
            f'package, with these lines in its pyproject.toml: [project.entry-points."{ENTRY_POINTS}"] and '
            f'{model.name} = "{kind.__module__}:{kind.__qualname__}"'
        ) from error


def fit_named(name: str) -> Fit:
    """What fits the observation model of that name.

    Args:
        name: a key of :data:`OBSERVATION_MODELS`, a name that an installed package offers, or ``module:attribute`` of
            your own: a class derived from ``ArrayModel`` with a class method ``fit``, or a function like ``fit``;
            with settings in brackets where wanted.

    Raises:
        UnknownName: there is none of that name.
        BadReference: the name cannot be read, or its settings do not fit.

    >>> fit_named("gaussian") == GaussianModel.fit
    True
    """
    found, reference = find("observation model", name, OBSERVATION_MODELS, ENTRY_POINTS)
    fit: Any = found.fit if inspect.isclass(found) and hasattr(found, "fit") else found
    if not callable(fit):
        raise BadReference(f"{name} is no observation model: it has no function fit")
    try:
        inspect.signature(fit).bind_partial(**reference.settings)
    except TypeError as error:
        raise BadReference(f"{name}: {error}") from error
    return partial(fit, **reference.settings) if reference.settings else fit
