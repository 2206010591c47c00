"""The registry of observation models. To add one, derive from :class:`ArrayModel` and add a line here.

A user's own model needs no line: the commands that fit models take its class as ``module:attribute``. To read its
files, an installed package must offer the class as an entry point of the group ``activetouch.observation_models``,
under the class's ``name``. Reading a file never imports a module that the file names.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Any

from belief.observation_model.action_kernel import ActionKernelModel
from belief.observation_model.baselines.confusion import ConfusionModel
from belief.observation_model.baselines.gaussian import GaussianModel
from belief.observation_model.baselines.plda import PLDAModel
from belief.observation_model.baselines.signature import SignatureModel
from belief.observation_model.likelihood_ratio import RatioModel
from belief.observation_model.model import ArrayModel
from belief.observation_model.rigid_body import RigidBodyModel
from belief.references import BadReference, Reference, entry_point_names, find

Fit = Callable[..., ArrayModel]
"""Fits a model to touches, shapes and object ids; also takes ``shape_labels`` and ``num_poses``."""

ENTRY_POINTS = "activetouch.observation_models"
"""Entry-point group of observation models in installed packages."""

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
"""The observation models that need no more than touches, by name, as the function that fits them."""

JOINT_MODELS: Mapping[str, Fit] = MappingProxyType({"rigid body": RigidBodyModel.fit})
"""Those that need a reader that embeds hypotheses too: they take the argument ``embed``."""

KERNEL_MODELS: Mapping[str, Fit] = MappingProxyType({"action kernel": ActionKernelModel.fit})
"""Those whose touches have log likelihood ratios of a calibrated reader as logits."""


def kinds(fits: Mapping[str, Fit] | None = None) -> dict[str, type[ArrayModel]]:
    """The classes of a registry, by default all of this package, by the names that their files bear.

    >>> kinds()["ratio"].__name__
    'RatioModel'
    """
    all_fits = ({**OBSERVATION_MODELS, **JOINT_MODELS, **KERNEL_MODELS} if fits is None else fits).values()
    found = [getattr(fit.func if isinstance(fit, partial) else fit, "__self__", None) for fit in all_fits]
    return {kind.name: kind for kind in found if inspect.isclass(kind) and issubclass(kind, ArrayModel)}


def class_named(kind: str) -> type[ArrayModel]:
    """The class of observation models with a name in files; raises ValueError if there is none.

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
        raise ValueError(f"the kind {kind!r} is {offered[kind]}, which is not a class derived from ArrayModel")
    return found


def require_readable(model: ArrayModel) -> None:
    """Raise BadReference unless the registry or an installed package has the class of a model.

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
    """The function that fits an observation model.

    Args:
        name: a key of :data:`OBSERVATION_MODELS`, an entry point, or ``module:attribute`` of a class derived from
            ``ArrayModel`` with a class method ``fit``, or of a function like ``fit``; optionally with settings in
            brackets.

    Raises:
        UnknownName: there is no such name.
        BadReference: the name is malformed, or its settings do not fit.

    >>> fit_named("gaussian") == GaussianModel.fit
    True
    """
    found, reference = find("observation model", name, {**OBSERVATION_MODELS, **JOINT_MODELS}, ENTRY_POINTS)
    fit: Any = found.fit if inspect.isclass(found) and hasattr(found, "fit") else found
    if not callable(fit):
        raise BadReference(f"{name} is not an observation model: it has no function fit")
    try:
        inspect.signature(fit).bind_partial(**reference.settings)
    except TypeError as error:
        raise BadReference(f"{name}: {error}") from error
    return partial(fit, **reference.settings) if reference.settings else fit
