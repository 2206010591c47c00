"""Conditions of ``robustness``: changes to the world that a sensor was trained in.

To add a condition, write a line in :data:`CONDITIONS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np

from activetouch.distributions import Constant, Distribution, LogUniform, Uniform
from activetouch.orientations import Inexact
from activetouch.pressing.dynamic import Dynamic
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


def _faulty(change: Callable[[tuple[Fault, ...]], tuple[Fault, ...]]) -> Change:
    def changed(scene: Scene) -> Scene:
        if not getattr(scene.renderer, "reads_taxels", True):
            raise DoesNotApply("its images are drawings of one force, not readings of taxels")
        return replace(scene, faults=change(scene.faults))

    return changed


def _every(kind: type[Fault], change: Callable[..., Fault]) -> Change:
    def changed(scene: Scene) -> Scene:
        if not faults_of(kind, scene.faults):
            raise DoesNotApply(f"its sensor has no {kind.__name__.lower()}")
        return replace(scene, faults=change_faults(kind, scene.faults, change))

    return changed


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
    """A change that is given in pixels of an image of many."""

    def changed(scene: Scene) -> Scene:
        if scene.image_shape[0] < _MANY_TAXELS:
            raise DoesNotApply(f"it is for images of at least {_MANY_TAXELS} taxels along an edge")
        return change(scene)

    return changed


def _proportions(label: str, **changes: Callable[[Any], Any]) -> Change:
    """A solid of other proportions, with the name of the one that the sensor knows."""

    def changed(scene: Scene) -> Scene:
        known: Any = scene.shapes.get(label)
        if known is None or not all(hasattr(known, name) for name in changes):
            raise DoesNotApply(f"it has no {label} of one kind")
        new = replace(known, **{name: change(getattr(known, name)) for name, change in changes.items()})
        return replace(scene, shapes={**scene.shapes, label: new})

    return changed


def _slippery(scene: Scene) -> Scene:
    return replace(_varied(friction=Constant(0.05))(scene), press_model=Dynamic())


def _varied(**changes: Distribution) -> Change:
    return lambda scene: replace(scene, variation=replace(scene.variation, **changes))


def _sized(low: float, high: float) -> Change:
    """Sizes outside the training range: ``low`` and ``high`` are added to its lower, or to its upper, end."""

    def changed(scene: Scene) -> Scene:
        smallest, largest = scene.variation.size.support
        if smallest == largest:
            raise DoesNotApply("its sizes have no range")
        end = largest if high > 0.0 else smallest
        return _varied(size=Uniform(end + low, end + high))(scene)

    return changed


def _together(*changes: Change) -> Change:
    """All of several changes that apply."""

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


def _pressed(share: float) -> Change:
    """A range of forces that is wider on both sides by a share of its ends."""

    def changed(scene: Scene) -> Scene:
        lowest, highest = scene.variation.force.support
        return _varied(force=Uniform(lowest * (1.0 - share), highest * (1.0 + share)))(scene)

    return changed


def _noisier(factor: float) -> Change:
    return _every(Noise, lambda noise: replace(noise, std=factor * noise.std))


def _rubbing(scene: Scene) -> Scene:
    if not scene.press_model.moves:
        raise DoesNotApply("nothing slides in a quasistatic press")
    return _varied(friction=Uniform(0.3, 1.0))(scene)


def _with(name: str, part: Any) -> Change:
    """Another kind of press or presentation; a scene that has this kind, with any settings, stays as it is."""
    return lambda scene: scene if type(getattr(scene, name)) is type(part) else replace(scene, **{name: part})


CONDITIONS: Mapping[str, Change] = MappingProxyType(
    {
        **{f"noise × {factor:g}": _noisier(factor) for factor in (1.5, 2, 3, 4, 6)},
        "gain ± 30 %": _every(Gain, lambda gain: replace(gain, half_range=0.3)),
        "1 % more dead": _dead(0.01),
        "5 % more dead": _dead(0.05),
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
        "cylinder twice as long": _proportions("cylinder", half_length=lambda length: 2.0 * length),
        "cylinder × 0.5": _proportions("cylinder", half_length=lambda length: 0.5 * length),
        "cylinder × 1.25": _proportions("cylinder", half_length=lambda length: 1.25 * length),
        "cone × 0.6": _proportions("cone", height=lambda height: 0.6 * height),
        "cone × 1.5": _proportions("cone", height=lambda height: 1.5 * height),
        "cube 1 : 1 : 1.25": _proportions("cube", half_extents=lambda edges: (*edges[:2], 1.25 * edges[2])),
        "friction 0.3 to 1": _rubbing,
        "friction 0.05": _slippery,
        "stiffness × 0.4": _varied(stiffness=Constant(0.4)),
        "stiffness × 0.7": _varied(stiffness=Constant(0.7)),
        "stiffness × 1.5": _varied(stiffness=Constant(1.5)),
        "stiffness × 0.5 to 2": _varied(stiffness=LogUniform(0.5, 2.0)),
        "offset ± 4 mm": _varied(offset=Uniform(-0.004, 0.004)),
        "force 0.3 to 1 N": _varied(force=Uniform(0.3, 1.0)),
        "force 0.5 to 1.5 N": _varied(force=Uniform(0.5, 1.5)),
        "force 1 to 4 N": _varied(force=Uniform(1.0, 4.0)),
        "force 3 to 6 N": _varied(force=Uniform(3.0, 6.0)),
        **{f"press {name}": _with("press_model", press) for name, press in FIDELITIES.items()},
        **{f"pose error {angle}°": _with("presentation", Inexact(np.deg2rad(angle))) for angle in (5, 10, 20)},
        **{f"objects {name}": _with("presentation", presentation) for name, presentation in PRESENTATIONS.items()},
        "all of these": _together(
            _noisier(1.5),
            _dead(3 / 16),
            _varied(stiffness=Constant(0.7), size=Uniform(0.75, 1.25)),
            _pressed(0.3),
        ),
        "all taxels dead": _dead(1.0),
    }
)
"""Change of a scene by name. Sizes are relative to the nominal size. "All of these" are noise × 1.5, 19 % more dead,
stiffness × 0.7, size ± 25 % and forces from 0.7 times the least to 1.3 times the largest, as far as they apply. The
last condition is the lower bound: a sensor without information."""


def applicable_conditions(scene: Scene, names: Sequence[str] = ()) -> tuple[dict[str, Scene], dict[str, str]]:
    """The scenes of the conditions that apply, the unchanged scene first, and why the others do not apply.

    Args:
        scene: in which the sensor was trained.
        names: of the conditions to choose from; all by default.

    Raises:
        UnknownName: there is no such condition.
    """
    for name in names:
        if name not in CONDITIONS:
            raise UnknownName("condition", name, list(CONDITIONS))
    scenes, left_out = {AS_TRAINED: scene}, {}
    for name in (name for name in CONDITIONS if name in names or not names):
        try:
            changed = CONDITIONS[name](scene)
        except DoesNotApply as reason:
            left_out[name] = str(reason)
            continue
        if scene_fields(changed) == scene_fields(scene):
            left_out[name] = "the sensor was trained under this condition"
        else:
            scenes[name] = changed
    return scenes, left_out
