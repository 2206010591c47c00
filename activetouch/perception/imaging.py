"""The imaging of a pressure sensor, its state, and the contact that a hypothesis predicts, as its network reads it.

A :class:`SensorState` is the state of the sensor and of the press. Height maps
(:func:`activetouch.predicted_contacts`) become images in :mod:`activetouch.perception.contacts.images`. A scene of the
same pad may have other forces, another stiffness, more noise, broken taxels, an image that is shifted or blurred,
hysteresis, or wider taxels. The reader was trained with all of them, and :func:`sensor_state` says which hold.

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
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from activetouch.distributions import Constant, Distribution, Uniform, sizes
from activetouch.errors import WrongScene
from activetouch.pressing.contact import Pad, Quasistatic
from activetouch.pressing.dynamic import Dynamic
from activetouch.rendering import Blur, DeadTaxels, Gain, Hysteresis, Noise, PressureRenderer, Shift, StuckTaxels
from activetouch.rendering.faults import faults_of
from activetouch.scene import Scene
from activetouch.scene_description import OBJECTS
from belief.codec import from_fields
from belief.constraints import Count, NotNegative, check

if TYPE_CHECKING:
    from activetouch.pad_file import PadDescription
    from activetouch.pressing.height_maps import Window

Floats32 = NDArray[np.float32]

BROKEN = 4
"""Cells along the edge of the map of broken taxels in the description of a world."""
STATE_SIZE = 9 + 2 * BROKEN**2
"""Numbers that describe a state of the sensor to the network of contacts; all are 0 in the nominal state."""
LIMITS = {
    "stiffness": (2**-1.5, 2.0),
    "force": (2**-2.4, 2.0),
    "noise": (2**-0.5, 4.0),
    "gain": (2**-0.4, 2**0.4),
    "blur": (0.0, 0.08),
    "shift": (-0.1, 0.1),
    "hysteresis": (0.0, 0.1),
}
"""Least and largest of the numbers of a :class:`SensorState` that a reader is trained with, unless its
:class:`Imaging` goes further."""
FEW_PIXELS = 8
"""Pixels along the edge of an image that needs no convolutions, and whose noise does not average away."""
SAMPLES = 32
"""Least number of points along the edge of a pad at which a surface is computed, and largest number of pixels."""
_PAD_CONTACT, _PAD_WINDOW = 24, 32  # pixels of a described pad's edge in a predicted contact, and of the contact's


class SensorState(NamedTuple):
    """The state of the sensor and of the press, relative to the sensor's description; arrays are ``(n,)``.

    Attributes:
        stiffness, force, noise, gain: factors.
        blur: standard deviation of a Gaussian filter, in parts of the image's edge.
        shift: displacement of the image along rows and columns, in parts of its edge, ``(n, 2)``.
        hysteresis: amount by which all readings are too low, relative to full scale.
        dead, stuck: share of dead taxels, and of taxels at full scale, in each cell, ``(n, BROKEN, BROKEN)``.
        wide: 0 for the taxels of the sensor; k > 0 for taxels that are 2^k of the reader's pixels wide.
        law, threshold, crosstalk: of the taxels of a described pad (:class:`activetouch.Response`).
    """

    stiffness: Floats32
    force: Floats32
    noise: Floats32
    gain: Floats32
    blur: Floats32
    shift: Floats32
    hysteresis: Floats32
    dead: Floats32
    stuck: Floats32
    wide: Floats32
    law: Floats32
    threshold: Floats32
    crosstalk: Floats32

    @classmethod
    def nominal(cls, number: int) -> SensorState:
        """The nominal state of the sensor, ``number`` times."""
        ones, zeros = np.ones(number, np.float32), np.zeros(number, np.float32)
        cells = np.zeros((number, BROKEN, BROKEN), np.float32)
        shift = np.zeros((number, 2), np.float32)
        parts = {"blur": zeros, "shift": shift, "hysteresis": zeros, "dead": cells, "stuck": cells, "wide": zeros}
        return cls(ones, ones, ones, ones, **parts, law=ones, threshold=zeros, crosstalk=zeros)

    def code(self) -> Floats32:
        """As the network of contacts of a square pad reads it, ``(n, STATE_SIZE)``."""
        numbers = (np.log2(self.stiffness), np.log2(self.force), np.log2(self.noise), 4 * np.log2(self.gain))
        others = (20 * self.blur, *(10 * self.shift.T), 20 * self.hysteresis)
        cells = [cells.reshape(len(cells), -1) for cells in (self.dead, self.stuck)]
        parts = [np.stack([*numbers, *others], axis=1), *cells, self.wide[:, None]]
        return np.concatenate(parts, axis=1).astype(np.float32)


@dataclass(frozen=True)
class Imaging:
    """How a sensor makes images.

    Attributes:
        taxels, pixels: along an edge of the image, and of what the network reads; of a square pad, one divides the
            other.
        force: smallest and largest force [N].
        gain: half range of the gain of each touch.
        noise: standard deviation of each taxel, relative to full scale; ``noisier`` is the largest factor in training.
        offset: largest displacement along y and z [m].
        dead: which taxels never read anything, ``(taxels, taxels)``; None for none.
        samples: points along the edge of the pad at which the surface is computed; a multiple of ``pixels``.
        coarser: share of worlds whose sensor may have taxels two pixels wide.
        displaced: largest blur and largest shift of the image in training, in parts of the edge.
        described: entries of the description of a pad (:mod:`activetouch.pad_file`), which then says what its sensor
            may be like; ``pad`` is the square about it.
    """

    pad: Pad
    taxels: Count
    pixels: Count
    force: tuple[NotNegative, NotNegative] = (1.5, 3.0)
    gain: NotNegative = 0.10
    noise: NotNegative = 0.02
    offset: NotNegative = 0.002
    sizes: tuple[NotNegative, NotNegative] = (0.75, 1.25)
    dead: NDArray[np.bool_] | None = None
    samples: Count = SAMPLES
    coarser: NotNegative = 0.0
    noisier: NotNegative = LIMITS["noise"][1]
    displaced: tuple[NotNegative, NotNegative] = (LIMITS["blur"][1], LIMITS["shift"][1])
    described: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        check(self)
        does_divide = 0 in (self.taxels % self.pixels, self.pixels % self.taxels) and self.samples % self.pixels == 0
        if not (
            (does_divide or self.described is not None)
            and self.force[1] > 0.0
            and {2} == set(map(len, (self.force, self.sizes, self.displaced)))
        ):
            raise ValueError(f"numbers out of range, or taxels, pixels and samples that do not divide: {self}")
        if self.dead is not None and self.dead.shape != (self.taxels, self.taxels):
            raise ValueError(f"dead must have the shape {(self.taxels, self.taxels)}, got {self.dead.shape}")

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Least and largest of the numbers of a :class:`SensorState` that the reader is trained with."""
        if self.described is not None:
            from activetouch.perception.described_pads import limits_of

            return LIMITS | {"shift": (0.0, 0.0)} | limits_of(self.description)
        blur, shift = self.displaced
        return LIMITS | {"noise": (LIMITS["noise"][0], self.noisier), "blur": (0.0, blur), "shift": (-shift, shift)}

    @property
    def window(self) -> Window:
        """The window of the images."""
        from activetouch.pressing.height_maps import Window

        return Window(2 * self.pad.half_width, self.samples)

    @property
    def wide_window(self) -> Window:
        """The window of the predicted contacts: the pad and, around it, the largest offset and shift of the image.

        Around a described pad it is a sixth of the pad's edge, so that one network reads all of them.
        """
        from activetouch.pressing.height_maps import Window

        if self.described is not None:
            return Window(2 * self.pad.half_width * _PAD_WINDOW / _PAD_CONTACT, _PAD_WINDOW)
        return Window.of(self.pad, self.offset + self.displaced[1] * 2 * self.pad.half_width, self.contact_pixels)

    @property
    def contact_pixels(self) -> int:
        """Pixels along the edge of the pad in a predicted contact."""
        return max(self.pixels, _FEWEST) if self.described is None else _PAD_CONTACT

    @cached_property
    def description(self) -> PadDescription:
        """The description of a described pad."""
        from activetouch.perception.described_pads import description_of

        assert self.described is not None, "asked before"
        return description_of(self.described)

    @property
    def state_size(self) -> int:
        """Numbers that describe a state of the sensor to the network of contacts."""
        return self.code(SensorState.nominal(1)).shape[1]

    def code(self, states: SensorState) -> Floats32:
        """States as the network of contacts reads them, ``(n, state_size)``; of a described pad, with its numbers."""
        if self.described is None:
            return states.code()
        from activetouch.perception.described_pads import code

        return code(self.description, states)

    @cached_property
    def face(self) -> Floats32 | None:
        """What a predicted contact meets of a described pad, ``(2, W, W)``; None for the square.

        First how far the pad reaches [m], ``-inf`` beside it; then the part of a pressure along the approach axis that
        its taxels feel, 0 beside it.
        """
        if self.described is None:
            return None
        inner, taxels = self.contact_pixels, self.description.taxels
        margin = (self.wide_window.num_pixels - inner) // 2
        parts = (taxels.face(inner), -np.inf), (taxels.shown(taxels.normals[:, 0], inner), 0.0)
        return np.stack([np.pad(part, margin, constant_values=beside) for part, beside in parts]).astype(np.float32)

    @cached_property
    def layout(self) -> Floats32 | None:
        """What the network of images is told about a described pad, ``(pixels² + 9,)``; None for the square."""
        if self.described is None:
            return None
        from activetouch.perception.described_pads import numbers_of

        taxels = self.description.taxels
        there = regridded(taxels.shown(taxels.normals[:, 0])[None].astype(np.float32), self.pixels)
        return np.concatenate([there.ravel(), numbers_of(self.description)])

    def fields(self) -> dict[str, Any]:
        """Its fields as JSON types."""
        found = asdict(self) | {"dead": None if self.dead is None else self.dead.astype(int).tolist()}
        del found["pad"]["layout"]
        if self.described is None:
            del found["described"]
        return found

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> Imaging:
        """The description from :meth:`fields`."""
        return from_fields(cls, fields)


def encoded(reached: Floats32, inner: int, face: Floats32 | None = None) -> Floats32:
    """Predicted contacts as the network reads them: gaps behind the first contact, near and far, ``(n, 2, W, W)``.

    ``reached (n, W, W)`` are height maps [m], with ``inner`` pixels along the edge of the pad in their middle. With the
    :attr:`Imaging.face` of a described pad, a third map shows what its taxels feel of a pressure, ``(n, 3, W, W)``.
    """
    margin = (reached.shape[-1] - inner) // 2
    middle = slice(margin, margin + inner)
    met = reached
    if face is not None:  # only what the pad itself may meet
        reach = face[0]
        met, reached = reached + reach, reached + np.where(np.isfinite(reach), reach, reach[np.isfinite(reach)].min())
    first = met[:, middle, middle].max(axis=(1, 2))
    first = np.where(np.isfinite(first), first, reached.max(axis=(1, 2)))
    first = np.where(np.isfinite(first), first, 0.0)[:, None, None]
    gap = np.clip(np.where(np.isfinite(reached), first - reached, 0.02), -0.006, 0.008).astype(np.float32)
    maps = [gap / 0.004, np.exp(-np.maximum(gap, -0.001) / 0.0006) / 2]
    if face is not None:
        maps.append(np.broadcast_to(face[1], gap.shape))
    return np.stack(maps, axis=1)


def regridded(shares: Floats32, edge: int) -> Floats32:
    """Shares of the cells of one grid, ``(n, m, m)``, in those of another on the same square, ``(n, edge, edge)``."""
    old = shares.shape[-1]
    first, others = np.arange(edge)[:, None] * old, np.arange(old) * edge
    overlap = np.minimum(first + old, others + edge) - np.maximum(first, others)
    part = (np.maximum(overlap, 0) / old).astype(np.float32)
    return part @ shares @ part.T


_FEWEST = 16  # pixels along the edge of the pad in a predicted contact
_KNOWN = (Blur, DeadTaxels, Gain, Hysteresis, Noise, Shift, StuckTaxels)
_OF_FAULTS = {"noise", "blur", "shift", "hysteresis"}
_QUANTILES = 64
_ROUNDED = 1e-6  # amount by which a limit may be exceeded
_DIFFERENT = 0.02  # smallest difference of a number of the code that counts
_COARSER = 0.3  # share of worlds with wider taxels, of a sensor that has more than the reader sees
_NOISIER = 8.0  # factor by which the noise of a sensor of few pixels may exceed the description
_TAXEL, _PART = 1.1, 0.3  # largest blur and shift of an image, in taxels; and their limit in parts of its edge


def imaging_of(scene: Scene) -> Imaging:
    """The imaging of a scene's sensor, whose pad is the square."""
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


def imaging_of_pad(pad: PadDescription) -> Imaging:
    """The imaging of a described pad."""
    from activetouch.perception.described_pads import largest_noise

    square = replace(pad.pad, layout=None)
    return Imaging(
        square,
        pad.taxels.raster,
        SAMPLES,
        pad.force,
        0.0,
        largest_noise(pad),
        pad.offset,
        samples=square.num_taxels,
        displaced=(LIMITS["blur"][1], 0.0),
        described=pad.entries(),
    )


def states_with(parts: Mapping[str, NDArray[np.floating]]) -> SensorState:
    """States with some parts, each ``(n,)``, and otherwise nominal ones."""
    found = {name: np.asarray(part, np.float32) for name, part in parts.items()}
    return SensorState.nominal(len(next(iter(found.values()))))._replace(**found)


def sensor_state(imaging: Imaging, scene: Scene) -> SensorState:
    """The state that a scene describes, clipped to the training of the reader, as arrays ``(1, ...)``."""
    found = _state(imaging, scene)
    found |= {name: np.clip(found[name], *limits) for name, limits in imaging.limits.items()}
    shapes = {name: part.shape for name, part in SensorState.nominal(1)._asdict().items()}
    return SensorState(**{name: np.broadcast_to(part, shapes[name]).astype(np.float32) for name, part in found.items()})


def _state(imaging: Imaging, scene: Scene) -> dict[str, Any]:
    """The state that a scene describes, not clipped."""
    if imaging.described is not None:
        from activetouch.perception.described_pads import state_in

        return SensorState.nominal(1)._asdict() | state_in(imaging.description, scene)
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
        "law": 1.0,
        "threshold": 0.0,
        "crosstalk": 0.0,
    }


def differs_from_training(imaging: Mapping[str, Any] | None, scene: Scene) -> bool:
    """Whether the sensor of a scene differs from that in the training of a reader of any object, or aims worse."""
    if imaging is None or "described" in imaging or not isinstance(scene.renderer, PressureRenderer):
        return False
    own = Imaging.from_fields(imaging)
    is_farther = max(np.abs(scene.variation.offset.support)) > own.offset * (1 + 1e-9)
    return bool(is_farther or np.abs(sensor_state(own, scene).code()).max() > _DIFFERENT)


def fields_read(imaging: Imaging, own: Mapping[str, Any], scene: Scene, here: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of the reader's own scene, with those of another scene that a state within the limits can express.

    Less noise than in the training is within the limits.
    """
    if imaging.described is not None:
        return _described_read(imaging.description, own, scene, here)
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


def _described_read(
    pad: PadDescription, own: Mapping[str, Any], scene: Scene, here: Mapping[str, Any]
) -> dict[str, Any]:
    """:func:`fields_read` of a described pad."""
    from activetouch.perception.described_pads import has_pad

    parts = ("press_model", "pad", "renderer", "faults") if has_pad(pad, scene) else ()
    found = {**own, **{name: here[name] for name in (*OBJECTS, *parts) if name in here}}
    for name in {"aims", "families"} - here.keys():
        found.pop(name, None)
    free = {name: here["variation"][name] for name in ("size", "offset", "force", "stiffness")}
    return found | {"variation": {**own["variation"], **free}}


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
