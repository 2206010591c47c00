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

from belief.files import unsealed_json
from belief.naming import checked_names
from belief.observation_model.action_kernel import ActionKernelModel
from belief.observation_model.confusion import ConfusionModel
from belief.observation_model.likelihood_ratio import RatioModel
from belief.observation_model.model import ArrayModel, Reads
from belief.observation_model.plda import GaussianModel, PLDAModel
from belief.observation_model.rigid_body import RigidBodyModel
from belief.references import BadReference, Reference, entry_point_names, find

Fit = Callable[..., ArrayModel]
"""Fits a model to touches, shapes and object ids; also takes ``shape_labels`` and ``num_poses``."""

ENTRY_POINTS = "activetouch.observation_models"
"""Entry-point group of observation models in installed packages."""

OBSERVATION_MODELS: Mapping[str, type[ArrayModel]] = MappingProxyType(
    {
        kind.name: kind
        for kind in (ConfusionModel, GaussianModel, PLDAModel, RatioModel, RigidBodyModel, ActionKernelModel)
    }
)
"""All classes of observation models, by the names that their files bear."""


def fits(reads: Reads = "logits") -> dict[str, Fit]:
    """The functions that fit the models which read these of a touch, by name."""
    return {name: kind.fit for name, kind in OBSERVATION_MODELS.items() if kind.reads == reads}


def class_named(kind: str) -> type[ArrayModel]:
    """The class of observation models with a name in files; raises ValueError if there is none."""
    if kind in OBSERVATION_MODELS:
        return OBSERVATION_MODELS[kind]
    offered = entry_point_names(ENTRY_POINTS)
    if kind not in offered:
        raise ValueError(f"unknown kind {kind!r}, known are {', '.join(sorted([*OBSERVATION_MODELS, *offered]))}")
    found = Reference.parse(offered[kind]).load()
    if not (inspect.isclass(found) and issubclass(found, ArrayModel)):
        raise ValueError(f"the kind {kind!r} is {offered[kind]}, which is not a class derived from ArrayModel")
    return found


def read_observation_model(text: str) -> ArrayModel:
    """The model from :meth:`ArrayModel.to_json`.

    Raises:
        ValueError: the text is not an observation model, or was changed; the message gives the cause.

    >>> from belief.files import sealed_json
    >>> read_observation_model(sealed_json({"model": "oracle"}))  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    ValueError: not an observation model: unknown kind 'oracle', known are action kernel, ...
    """
    try:
        fields = unsealed_json(text)
        kind = class_named(fields["model"])
        return kind.from_fields(checked_names("shape_labels", fields["shape_labels"]), fields)
    except ValueError as error:
        raise ValueError(f"not an observation model: {error}") from error
    except (KeyError, TypeError, AttributeError, OverflowError, IndexError, RecursionError) as error:
        raise ValueError(f"not an observation model: {error!r}") from error


def read_origin(text: str) -> dict[str, Any] | None:
    """The source of the calibration touches, as given to :meth:`ArrayModel.to_json`; None if there is none.

    Raises:
        ValueError: the text was changed after it was written.

    >>> from belief.files import sealed_json
    >>> read_origin(sealed_json({"model": "plda", "origin": {"objects": 300}}))
    {'objects': 300}
    """
    origin = unsealed_json(text).get("origin")
    if not (origin is None or isinstance(origin, dict)):
        raise ValueError(f"the origin of a model must be a JSON object, got {origin!r}")
    return origin


def require_readable(model: ArrayModel) -> None:
    """Raise BadReference unless the registry or an installed package has the class of a model."""
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
    """
    found, reference = find("observation model", name, OBSERVATION_MODELS, ENTRY_POINTS)
    fit: Any = found.fit if inspect.isclass(found) and hasattr(found, "fit") else found
    if not callable(fit):
        raise BadReference(f"{name} is not an observation model: it has no function fit")
    try:
        inspect.signature(fit).bind_partial(**reference.settings)
    except TypeError as error:
        raise BadReference(f"{name}: {error}") from error
    return partial(fit, **reference.settings) if reference.settings else fit
