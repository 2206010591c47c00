"""Reading of observation models from JSON text."""

from __future__ import annotations

from typing import Any

from belief.files import unsealed_json
from belief.naming import checked_names
from belief.observation_model.model import ArrayModel
from belief.observation_model.registry import class_named


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
