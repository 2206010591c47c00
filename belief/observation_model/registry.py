"""The registry of observation models. To add one, derive from :class:`ArrayModel` and add a line here.

In Python, a user's own model needs no line: functions that fit models take it among their candidates. Commands and
files of models know only the registry. Reading a file never imports a module that the file names.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from typing import Any

from belief.errors import UnknownName
from belief.files import unsealed_json
from belief.observation_model.model import ArrayModel, Reads

Fit = Callable[..., ArrayModel]
"""Fits a model to touches, shapes and object ids; also takes ``shape_labels`` and ``num_poses``."""


class _Classes(Mapping[str, type[ArrayModel]]):
    """Classes by name, each imported from its module here when it is asked for."""

    def __init__(self, places: Mapping[str, str]) -> None:
        self._places = places

    def __getitem__(self, name: str) -> type[ArrayModel]:
        module, kind = self._places[name].split(".")
        found: type[ArrayModel] = getattr(import_module(f"belief.observation_model.{module}"), kind)
        return found

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


OBSERVATION_MODELS: Mapping[str, type[ArrayModel]] = _Classes(
    {
        "confusion": "confusion.ConfusionModel",
        "gaussian": "plda.GaussianModel",
        "plda": "plda.PLDAModel",
        "heavy tails": "heavy_tails.HeavyTailsModel",
        "ratio": "likelihood_ratio.RatioModel",
        "rigid body": "rigid_body.RigidBodyModel",
        "action kernel": "action_kernel.ActionKernelModel",
    }
)
"""Classes of observation models that are fitted to touches, by the names that their files bear."""
_OTHERS: Mapping[str, type[ArrayModel]] = _Classes({"context": "context_model.ContextModel"})


def fits(reads: Reads = "logits") -> dict[str, Fit]:
    """The functions that fit the models which read these of a touch, by name."""
    return {name: kind.fit for name, kind in OBSERVATION_MODELS.items() if kind.reads == reads}


def class_named(kind: str) -> type[ArrayModel]:
    """The class of observation models with a name in files; raises ValueError if there is none."""
    for known in (OBSERVATION_MODELS, _OTHERS):
        if kind in known:
            return known[kind]
    raise ValueError(f"unknown kind {kind!r}, known are {', '.join(sorted([*OBSERVATION_MODELS, *_OTHERS]))}")


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
        return class_named(fields["model"]).from_fields(fields)
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


def fit_named(name: str) -> Fit:
    """The function that fits the observation model of this name; raises UnknownName if there is none."""
    if name not in OBSERVATION_MODELS:
        raise UnknownName("observation model", name, list(OBSERVATION_MODELS))
    return OBSERVATION_MODELS[name].fit
