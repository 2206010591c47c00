"""Conditions of ``robustness``: changes to the world that a sensor was trained in.

To add a condition, write a line in :data:`CONDITIONS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from operator import mul
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np

from activetouch.distributions import Constant, Distribution, LogUniform, Uniform
from activetouch.orientations import Inexact
from activetouch.rendering import Blur, DeadTaxels, Fault, Gain, Hysteresis, Noise, Quantisation, Shift, StuckTaxels
from activetouch.rendering.faults import change_faults, faults_of
from activetouch.scene import Scene
from activetouch.scene_description import scene_fields
from belief.errors import UnknownName
from experiments.scene_choice import FIDELITIES, PRESENTATIONS

AS_TRAINED = "as trained"
"""Name of the unchanged scene among the conditions."""
Change: TypeAlias = Callable[[Scene], Scene]
_MANY_TAXELS = 64  # along the edge of an image whose changes may be given in pixels


class DoesNotApply(Exception):
    """A condition does not apply to a scene; the message says why."""


def _where(applies: Callable[[Scene], object], otherwise: str, change: Change) -> Change:
    """A change that applies to some scenes only; for others, ``otherwise`` says why not."""

    def changed(scene: Scene) -> Scene:
        if not applies(scene):
            raise DoesNotApply(otherwise)
        return change(scene)

    return changed


def _faulty(change: Callable[[tuple[Fault, ...]], tuple[Fault, ...]]) -> Change:
    return _where(
        lambda scene: getattr(scene.renderer, "reads_taxels", True),
        "its images are drawings of one force, not readings of taxels",
        lambda scene: replace(scene, faults=change(scene.faults)),
    )


def _every(kind: type[Fault], change: Callable[..., Fault]) -> Change:
    return _where(
        lambda scene: faults_of(kind, scene.faults),
        f"its sensor has no {kind.__name__.lower()}",
        lambda scene: replace(scene, faults=change_faults(kind, scene.faults, change)),
    )


def _dead(share: float) -> Change:
    """More dead taxels, in addition to those of the sensor."""

    def changed(scene: Scene) -> Scene:
        number, old = scene.image_shape[0] ** 2, faults_of(DeadTaxels, scene.faults) or [DeadTaxels(0.0)]
        more = replace(old[0], share=min(old[0].share + share, 1.0))
        added = round(more.share * number) - round(old[0].share * number)
        _require_taxels(added, f"{100 * share:g} % of its {number} taxels")
        return _faulty(lambda faults: (*(fault for fault in faults if fault not in old), more))(scene)

    return changed


def _stuck(share: float) -> Change:
    """Taxels that read full scale, in addition to the faults of the sensor."""

    def changed(scene: Scene) -> Scene:
        _require_taxels(share * scene.image_shape[0] ** 2, f"{100 * share:g} % of its taxels")
        return _faulty(lambda faults: (*faults, StuckTaxels(share)))(scene)

    return changed


def _shifted(taxels: int = 0, share: float = 0.0) -> Change:
    """An image that is displaced by some taxels and by a share of its edge."""

    def changed(scene: Scene) -> Scene:
        by = taxels + share * scene.image_shape[0]
        _require_taxels(by, f"{100 * share:g} % of its edge")
        return _faulty(lambda faults: (Shift(columns=round(by)), *faults))(scene)

    return changed


def _blurred(taxels: float) -> Change:
    return _faulty(lambda faults: (Blur(taxels), *faults))


def _require_taxels(number: float, what: str) -> None:
    """Check that a number of taxels is at least one when rounded."""
    if round(number) < 1:
        raise DoesNotApply(f"{what} is less than one taxel")


def _in_pixels(change: Change) -> Change:
    """A change in pixels, which applies only to images of many pixels."""
    many = f"it is for images of at least {_MANY_TAXELS} taxels along an edge"
    return _where(lambda scene: scene.image_shape[0] >= _MANY_TAXELS, many, change)


def _proportions(label: str, **factors: Any) -> Change:
    """A solid of other proportions, by factors on its numbers, with the name of the one that the sensor knows."""

    def changed(scene: Scene) -> Scene:
        known: Any = scene.shapes[label]
        olds = ((name, getattr(known, name), factor) for name, factor in factors.items())
        new = {name: tuple(map(mul, old, by)) if isinstance(by, tuple) else by * old for name, old, by in olds}
        return replace(scene, shapes={**scene.shapes, label: replace(known, **new)})

    return _where(
        lambda scene: all(hasattr(scene.shapes.get(label), n) for n in factors),
        f"it has no {label} of one kind",
        changed,
    )


def _varied(**changes: Distribution) -> Change:
    return lambda scene: replace(scene, variation=replace(scene.variation, **changes))


def _slippery(friction: Distribution) -> Change:
    moves, otherwise = (lambda scene: scene.press_model.moves), "nothing slides in a quasistatic press"
    return _where(moves, otherwise, _varied(friction=friction))


def _sized(low: float, high: float) -> Change:
    """Sizes outside the training range: ``low`` and ``high`` are added to its lower, or to its upper, end."""

    def changed(scene: Scene) -> Scene:
        end = scene.variation.size.support[high > 0.0]
        return _varied(size=Uniform(end + low, end + high))(scene)

    return _where(lambda scene: len({*scene.variation.size.support}) > 1, "its sizes have no range", changed)


def _together(*changes: Change) -> Change:
    """Several changes in one, of which those that do not apply are left out."""

    def changed(scene: Scene) -> Scene:
        reasons = []
        for change in changes:
            try:
                scene = change(scene)
            except DoesNotApply as reason:
                reasons.append(reason)
        if len(reasons) == len(changes):
            raise reasons[0]
        return scene

    return changed


def _pressed(scene: Scene) -> Scene:
    """A range of forces that is wider on both sides by 0.3 of its ends."""
    lowest, highest = scene.variation.force.support
    return _varied(force=Uniform(lowest * (1.0 - 0.3), highest * (1.0 + 0.3)))(scene)


def _noisier(factor: float) -> Change:
    return _every(Noise, lambda noise: replace(noise, std=factor * noise.std))


def _with(name: str, part: Any) -> Change:
    """Another kind of press or presentation; a scene that has this kind, with any settings, stays as it is."""
    return lambda scene: scene if type(getattr(scene, name)) is type(part) else replace(scene, **{name: part})


CONDITIONS: Mapping[str, Change] = MappingProxyType(
    {
        **{f"noise × {factor:g}": _noisier(factor) for factor in (1.5, 2, 3, 4, 6)},
        "gain ± 30 %": _every(Gain, lambda gain: replace(gain, half_range=0.3)),
        **{f"{share:g} % more dead": _dead(share / 100) for share in (1, 5)},
        "19 % more dead": _dead(3 / 16),
        **{f"{share:g} % stuck": _stuck(share / 100) for share in (1, 5)},
        "6 % stuck at full scale": _stuck(1 / 16),
        "shifted by 1 taxel": _shifted(taxels=1),
        "shifted by 3 % of the edge": _shifted(share=1 / 32),
        **{f"shifted by {pixels} pixels": _in_pixels(_shifted(taxels=pixels)) for pixels in (2, 4, 10)},
        "blurred by half a taxel": _blurred(0.5),
        "blurred by 1 taxel": _blurred(1.0),
        **{f"blurred by {pixels} pixels": _in_pixels(_blurred(float(pixels))) for pixels in (2, 5)},
        "4 bits": _faulty(lambda faults: (*faults, Quantisation(4))),
        "hysteresis 5 %": _faulty(lambda faults: (Hysteresis(0.05), *faults)),
        "hysteresis 10 %": _faulty(lambda faults: (Hysteresis(0.1), *faults)),
        "size ± 25 %": _varied(size=Uniform(0.75, 1.25)),
        "smaller by ≤ 15 %": _sized(-0.15, 0.0),
        "larger by ≤ 15 %": _sized(0.0, 0.15),
        "cylinder twice as long": _proportions("cylinder", half_length=2.0),
        "cylinder × 0.5": _proportions("cylinder", half_length=0.5),
        "cylinder × 1.25": _proportions("cylinder", half_length=1.25),
        "cone × 0.6": _proportions("cone", height=0.6),
        "cone × 1.5": _proportions("cone", height=1.5),
        "cube 1 : 1 : 1.5": _proportions("cube", half_extents=(1.0, 1.0, 1.5)),
        "cube 1 : 1.5 : 1.5": _proportions("cube", half_extents=(1.0, 1.5, 1.5)),
        "cube 1 : 1 : 1.25": _proportions("cube", half_extents=(1.0, 1.0, 1.25)),
        "friction 0.3 to 1": _slippery(Uniform(0.3, 1.0)),
        "friction 0.05": _slippery(Constant(0.05)),
        **{f"stiffness × {factor:g}": _varied(stiffness=Constant(factor)) for factor in (0.4, 0.7, 1.5)},
        "stiffness × 0.5 to 2": _varied(stiffness=LogUniform(0.5, 2.0)),
        "offset ± 4 mm": _varied(offset=Uniform(-0.004, 0.004)),
        **{
            f"force {low:g} to {high:g} N": _varied(force=Uniform(low, high))
            for low, high in ((0.3, 1.0), (0.5, 1.5), (1.0, 4.0), (3.0, 6.0))
        },
        **{f"press {name}": _with("press_model", press) for name, press in FIDELITIES.items()},
        **{f"pose error {angle}°": _with("presentation", Inexact(np.deg2rad(angle))) for angle in (5, 10, 20)},
        **{f"objects {name}": _with("presentation", presentation) for name, presentation in PRESENTATIONS.items()},
        "all of these": _together(
            _noisier(1.5), _dead(3 / 16), _varied(stiffness=Constant(0.7), size=Uniform(0.75, 1.25)), _pressed
        ),
        "all taxels dead": _dead(1.0),
    }
)
"""Change of a scene by name. Sizes are relative to the nominal size. "All of these" are noise × 1.5, 19 % more dead,
stiffness × 0.7, size ± 25 % and forces from 0.7 times the least to 1.3 times the largest, as far as they apply. The
last condition is the lower bound: a sensor without information."""


def applicable_conditions(
    scene: Scene, asked: Sequence[str] | Mapping[str, Change] = ()
) -> tuple[dict[str, Scene], dict[str, str]]:
    """The scenes of conditions that apply, the unchanged one first, and why others do not.

    ``asked`` are names of :data:`CONDITIONS`, of which all are meant by none, or conditions by name.
    """
    known = asked if isinstance(asked, Mapping) else CONDITIONS
    for name in asked:
        if name not in known:
            raise UnknownName("condition", name, list(known))
    scenes, left_out = {AS_TRAINED: scene}, {}
    for name in (name for name in known if name in asked or not asked):
        try:
            changed = known[name](scene)
        except DoesNotApply as reason:
            left_out[name] = str(reason)
            continue
        if scene_fields(changed) == scene_fields(scene):
            left_out[name] = "the sensor was trained under this condition"
        else:
            scenes[name] = changed
    return scenes, left_out
