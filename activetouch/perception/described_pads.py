"""What a described pad may be like, in the numbers of :class:`activetouch.perception.imaging.SensorState`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.pad_file import PadDescription, pad_from
from activetouch.pressing.contact import Quasistatic
from activetouch.pressing.taxels import Taxels
from activetouch.rendering.response import Response, TaxelRenderer, TaxelResponse, respond
from activetouch.scene import Scene
from activetouch.solids.triangles import Floats

PADS = 23
"""Pads, besides the middle one, that stand for all that a description allows."""
RANGES = Response.of(
    {
        "stiffness": [4e6, 3e9],
        "law": [0.4, 2.6],
        "threshold": [0.0, 0.3],
        "blur": [0.0, 1.0],
        "crosstalk": [0.0, 0.3],
        "gain": [0.35, 2.8],
        "noise": [0.0, 0.05],
    }
)
"""Of the responses that the reader of any pad is trained with."""
EXAMPLE = PadDescription(Taxels.grid(8, 8, 0.004), RANGES)
"""The pad that the file of this reader is about."""
_LEAST_NOISE = 1e-6
_QUIET = 1 / 16  # least noise, in parts of the largest, of which the network reads the logarithm
_SLACK = 1e-6
_MIDDLE = np.full((1, 7), 0.5)


def description_of(entries: Mapping[str, Any]) -> PadDescription:
    """The description of a pad with these entries of its file."""
    return _read(json.dumps(entries))


@lru_cache(maxsize=16)
def _read(text: str) -> PadDescription:
    return pad_from(json.loads(text))


def largest_noise(pad: PadDescription) -> float:
    """Standard deviation of which the noise of a state is a part, relative to full scale."""
    return max(pad.response.noise.support[1], _LEAST_NOISE)


def to_state(pad: PadDescription, numbers: Mapping[str, Floats]) -> dict[str, Floats]:
    """Parts of states for numbers of the response, each ``(n,)`` (:meth:`activetouch.Response.at`)."""
    square = pad.pad
    return {
        **numbers,
        "stiffness": numbers["stiffness"] / square.stiffness,
        "noise": np.maximum(numbers["noise"] / largest_noise(pad), _QUIET),
        "blur": numbers["blur"] * pad.taxels.pitch / (2 * square.half_width),
    }


def from_state(pad: PadDescription, state: Any) -> dict[str, Any]:
    """Numbers of the response without the stiffness, each ``(n,)``, of the parts of states."""
    found = {name: getattr(state, name) for name in ("law", "threshold", "crosstalk", "gain")}
    blur = state.blur * np.float32(2 * pad.taxels.half_width / pad.taxels.pitch)
    return found | {"blur": blur, "noise": state.noise * np.float32(largest_noise(pad))}


def images_of_taxels(
    pad: PadDescription, pressure: NDArray[np.floating], numbers: Mapping[str, Any], rng: np.random.Generator
) -> NDArray[np.floating]:
    """Images ``(n, m, m)`` of pressures over the square ``(n, s, s)``, relative to full scale; m is the raster.

    ``numbers`` are those of the response (:func:`from_state`), each ``(n,)``.
    """
    felt = pad.taxels.mean(pressure) * pad.taxels.normals[:, 0]
    return pad.taxels.shown(respond(pad.taxels, felt.astype(np.float32), numbers, rng, pad.is_relative, pad.dead))


def numbers_of(pad: PadDescription) -> NDArray[np.float32]:
    """What a network is told about a pad beside where its taxels are, ``(9,)``: lengths and forces are logarithms."""
    edge, (least, most) = 2 * pad.taxels.half_width, pad.force
    logs = [
        edge / 0.024,
        pad.taxels.pitch / 0.003,
        np.sqrt(pad.taxels.area) / 0.003,
        least / 2.0,
        most / 2.0,
        pad.max_depth / 0.003,
        1.0 if pad.is_relative else pad.full_scale / 1e5,
    ]
    return np.array([*np.log2(logs) / 2, 8.0 * pad.offset / edge, pad.is_relative], np.float32)


def code(pad: PadDescription, states: Any) -> NDArray[np.float32]:
    """States of a pad as the network of contacts reads them, ``(n, 16)``: the response in units of any pad, the pad."""
    felt, stiffness = from_state(pad, states), states.stiffness * np.float32(pad.pad.stiffness / 1e8)
    response = [
        np.log2(stiffness) / 2,
        2 * np.log2(felt["law"]),
        8 * felt["threshold"],
        2 * felt["blur"],
        8 * felt["crosstalk"],
        np.zeros_like(stiffness) if pad.is_relative else np.log2(felt["gain"]),
        40 * felt["noise"],
    ]
    whole = np.tile(numbers_of(pad), (len(stiffness), 1))
    return np.concatenate([np.stack(response, axis=1), whole], axis=1).astype(np.float32)


def limits_of(pad: PadDescription) -> dict[str, tuple[float, float]]:
    """Least and largest parts of a state."""
    ends = to_state(pad, pad.response.at(np.array([[0.0] * 7, [1.0] * 7])))
    return {name: (float(low), float(high)) for name, (low, high) in ends.items()}


def state_in(pad: PadDescription, scene: Scene) -> dict[str, Floats]:
    """Parts of the state of a pad in a scene, each ``(1,)``; the middle where the scene has another pad."""
    answers = [fault for fault in scene.faults if isinstance(fault, TaxelResponse)]
    if not answers:
        return to_state(pad, pad.response.at(_MIDDLE))
    factor = float(np.mean(scene.variation.stiffness.support))
    numbers = {name: np.array([getattr(answers[0], name)]) for name in pad.response.ranges() if name != "stiffness"}
    return to_state(pad, numbers | {"stiffness": np.array([factor * scene.pad.stiffness])})


def has_pad(pad: PadDescription, scene: Scene) -> bool:
    """Whether a scene has the pad of a description, with a response within its ranges."""
    if scene.hand is not None or len(scene.faults) != 1:
        return False
    [felt], own, here, shown = scene.faults, pad.pad, scene.pad, scene.renderer
    if not (isinstance(felt, TaxelResponse) and isinstance(shown, TaxelRenderer)):
        return False
    if scene.press_model != Quasistatic() or not pad.taxels == here.layout == felt.taxels:
        return False
    if (felt.is_relative, felt.dead, here.num_taxels) != (pad.is_relative, pad.dead, own.num_taxels):
        return False
    wanted = (own.half_width, own.max_depth, pad.full_scale)
    if not np.allclose((here.half_width, here.max_depth, shown.full_scale), wanted, rtol=_SLACK, atol=0.0):
        return False
    for name, (low, high) in pad.response.ranges().items():
        given = [getattr(felt, name, 0.0)]
        if name == "stiffness":
            given = [factor * scene.pad.stiffness for factor in scene.variation.stiffness.support]
        if not low * (1 - _SLACK) - _SLACK <= min(given) <= max(given) <= high * (1 + _SLACK) + _SLACK:
            return False
    return True


def responses_beyond(pad: PadDescription) -> str:
    """In words, what a description allows of the response that the reader was not trained with; empty if nothing."""
    known = RANGES.ranges()
    return ", ".join(
        f"{name} {low:g} to {high:g} (trained: {known[name][0]:g} to {known[name][1]:g})"
        for name, (low, high) in pad.response.ranges().items()
        if not known[name][0] * (1 - 1e-9) <= low <= high <= known[name][1] * (1 + 1e-9)
        and not (name == "gain" and pad.is_relative)
    )


def is_known(pad: PadDescription) -> bool:
    """Whether a description leaves nothing open."""
    return all(low == high for low, high in pad.response.ranges().values())


def possible_pads(pad: PadDescription) -> tuple[tuple[str, ...], dict[str, Floats]]:
    """Pads that a description allows, beside the middle one: in words, and parts of states, each ``(n,)``.

    There are :data:`PADS` of them, and none where the description leaves nothing open.
    """
    number = 0 if is_known(pad) else PADS
    rest = {name: values[1:] for name, values in pad.response.spread(1 + number).items()}
    labels = tuple(
        f"pad {i + 1}: stiffness {rest['stiffness'][i]:.1e} N/m³, law ^{rest['law'][i]:.2f}, "
        f"threshold {rest['threshold'][i]:.2f}, blur {rest['blur'][i]:.2f}"
        for i in range(number)
    )
    return labels, to_state(pad, rest)
