"""The state of a sensor, from the scene that it is used in, as the network of contacts reads it.

A scene of the same pad may have other forces, another stiffness, more noise, broken taxels, an image that is shifted or
blurred, hysteresis, or wider taxels. The reader was trained with all of them, and the state says which hold.

>>> from dataclasses import replace
>>> from activetouch import SCENES
>>> from activetouch.distributions import Uniform
>>> gel = SCENES["gel"].scene
>>> imaging = imaging_of(gel)
>>> gentle = replace(gel, variation=replace(gel.variation, force=Uniform(0.75, 1.5)))
>>> float(sensor_state(imaging, gentle).force[0])
0.5
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from activetouch.distributions import Constant, Distribution, Uniform
from activetouch.errors import WrongScene
from activetouch.hypotheses import sizes
from activetouch.perception.contacts.imaging import BROKEN, FEW_PIXELS, LIMITS, SAMPLES, Imaging, SensorState, regridded
from activetouch.pressing.dynamic import Dynamic
from activetouch.pressing.press import Quasistatic
from activetouch.rendering import Blur, DeadTaxels, Gain, Hysteresis, Noise, PressureRenderer, Shift, StuckTaxels
from activetouch.rendering.faults import faults_of
from activetouch.scene import Scene
from activetouch.scene_description import OBJECTS

_KNOWN = (Blur, DeadTaxels, Gain, Hysteresis, Noise, Shift, StuckTaxels)
_OF_FAULTS = {"noise", "blur", "shift", "hysteresis"}
_QUANTILES = 64
_ROUNDED = 1e-6  # amount by which a limit may be exceeded
_DIFFERENT = 0.02  # smallest difference of a number of the code that counts
_COARSER = 0.3  # share of worlds with wider taxels, of a sensor that has more than the reader sees
_NOISIER = 8.0  # factor by which the noise of a sensor of few pixels may exceed the description
_TAXEL, _PART = 1.1, 0.3  # largest blur and shift of an image, in taxels; and their limit in parts of its edge


def imaging_of(scene: Scene) -> Imaging:
    """The imaging of a scene's sensor."""
    if not isinstance(scene.renderer, PressureRenderer):
        raise WrongScene(f"a reader of any object reads images of pressure, not those of {scene.renderer!r}")
    taxels = scene.pad.num_taxels // scene.renderer.binning
    pixels = max(number for number in range(1, SAMPLES + 1) if taxels % number == 0)
    gains = faults_of(Gain, scene.faults)
    blur, shift = (max(LIMITS[name][1], min(_TAXEL / taxels, _PART)) for name in ("blur", "shift"))
    return Imaging(
        scene.pad,
        taxels,
        pixels,
        scene.variation.force.support,
        gains[0].half_range if gains else 0.0,
        _noise(scene),
        float(np.abs(scene.variation.offset.support).max()),
        dead=_broken(scene, DeadTaxels, taxels) if faults_of(DeadTaxels, scene.faults) else None,
        samples=-(-SAMPLES // pixels) * pixels,
        coarser=_COARSER if taxels > pixels and pixels % 2 == 0 else 0.0,
        noisier=_NOISIER if pixels <= FEW_PIXELS else LIMITS["noise"][1],
        displaced=(blur, shift),
    )


def sensor_state(imaging: Imaging, scene: Scene) -> SensorState:
    """The state that a scene describes, clipped to the training of the reader, as arrays ``(1, ...)``."""
    found = _state(imaging, scene)
    found |= {name: np.clip(found[name], *limits) for name, limits in imaging.limits.items()}
    shapes = {name: part.shape for name, part in SensorState.nominal(1)._asdict().items()}
    return SensorState(**{name: np.broadcast_to(part, shapes[name]).astype(np.float32) for name, part in found.items()})


def _state(imaging: Imaging, scene: Scene) -> dict[str, Any]:
    """The state that a scene describes, not clipped."""
    taxels, vary = scene.image_shape[0], scene.variation
    finer = imaging.taxels / taxels if imaging.pixels <= taxels else 1.0  # taxels are averaged in a pixel
    dead = _broken(scene, DeadTaxels, taxels)
    if imaging.dead is not None and imaging.dead.shape == dead.shape:
        dead = dead & ~imaging.dead
    shifts = np.array([(fault.rows, fault.columns) for fault in faults_of(Shift, scene.faults)]).reshape(-1, 2)
    return {
        "stiffness": _mean(vary.stiffness) * scene.pad.stiffness / imaging.pad.stiffness,
        "force": _mean(vary.force) / (imaging.force[0] / 2 + imaging.force[1] / 2),
        "noise": _ratio(_noise(scene) * finer, imaging.noise),
        "gain": 1.0,
        "blur": sum(fault.std for fault in faults_of(Blur, scene.faults)) / taxels,
        "shift": shifts.sum(axis=0)[None] / taxels,
        "hysteresis": sum(fault.width for fault in faults_of(Hysteresis, scene.faults)),
        "dead": regridded(dead[None].astype(np.float32), BROKEN),
        "stuck": regridded(_broken(scene, StuckTaxels, taxels)[None].astype(np.float32), BROKEN),
        "wide": np.log2(max(imaging.pixels / taxels, 1.0)),
    }


def differs_from_training(imaging: Mapping[str, Any] | None, scene: Scene) -> bool:
    """Whether the sensor of a scene differs from that in the training of a reader of any object."""
    if imaging is None or not isinstance(scene.renderer, PressureRenderer):
        return False
    return bool(np.abs(sensor_state(Imaging.from_fields(imaging), scene).code()).max() > _DIFFERENT)


def fields_read(imaging: Imaging, own: Mapping[str, Any], scene: Scene, here: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of the reader's own scene, with those of another scene that a state within the limits can express.

    Less noise than in the training is within the limits.
    """
    same, state = list(OBJECTS), _state(imaging, scene)
    limits = imaging.limits.items()
    beyond = {name for name, (_, high) in limits if np.max(state[name]) > high + _ROUNDED}
    beyond |= {name for name, (low, _) in limits if name != "noise" and np.min(state[name]) < low - _ROUNDED}
    if isinstance(scene.press_model, Dynamic | Quasistatic):
        same.append("press_model")
    are_known = all(isinstance(fault, _KNOWN) for fault in scene.faults)
    are_full = all(fault.level == 1.0 for fault in faults_of(StuckTaxels, scene.faults))
    if are_known and are_full and _is_as_broken(imaging, scene) and not beyond & _OF_FAULTS:
        same.append("faults")
    taxels = scene.image_shape[0]
    widest = imaging.pixels // 2 if imaging.coarser else imaging.taxels
    stiffness = scene.pad.stiffness if "stiffness" in beyond else imaging.pad.stiffness
    pad = replace(scene.pad, num_taxels=imaging.pad.num_taxels, stiffness=stiffness)
    fits = taxels % imaging.pixels in (0, widest) if imaging.dead is None else taxels == imaging.taxels
    if pad == imaging.pad and fits and isinstance(scene.renderer, PressureRenderer):
        same += ["pad", "renderer"]
    found = {**own, **{name: here[name] for name in same if name in here}}
    for name in {"aims", "families"} - here.keys():
        found.pop(name, None)
    free = ["size", *({"force", "stiffness"} - beyond)]
    is_latent = scene.hand is not None and scene.hand.offset != "averaged"
    if is_latent or max(np.abs(scene.variation.offset.support)) <= imaging.offset * (1 + 1e-9):
        free.append("offset")
    return found | {"variation": {**own["variation"], **{name: here["variation"][name] for name in free}}}


def _is_as_broken(imaging: Imaging, scene: Scene) -> bool:
    """Whether no taxel works that never did in training, and no touch is amplified more than in training."""
    if sum(fault.half_range for fault in faults_of(Gain, scene.faults)) > imaging.gain + _ROUNDED:
        return False
    dead = _broken(scene, DeadTaxels, scene.image_shape[0])
    return imaging.dead is None or imaging.dead.shape != dead.shape or not (imaging.dead & ~dead).any()


def _ratio(value: float, usual: float) -> float:
    if usual == 0.0:
        return 1.0 if value == 0.0 else np.inf
    return value / usual


def _noise(scene: Scene) -> float:
    return math.hypot(*(fault.std for fault in faults_of(Noise, scene.faults)))


def _broken(scene: Scene, kind: type[DeadTaxels] | type[StuckTaxels], taxels: int) -> np.ndarray:
    """Which taxels of an image have a fault, ``(taxels, taxels)``."""
    rng, start = np.random.default_rng(0), 1.0 if kind is DeadTaxels else 0.0
    found = np.zeros((taxels, taxels), bool)
    for fault in faults_of(kind, scene.faults):
        found |= fault(np.full(found.shape, start), rng) != start
    return found


def _mean(distribution: Distribution) -> float:
    if isinstance(distribution, Constant | Uniform):
        return sum(end / 2 for end in distribution.support)
    return float(sizes(distribution, _QUANTILES).mean())
