"""Named scenes of different difficulty, for comparisons of deciders.

* ``paper``: the paper's world and its images, a force vector drawn as a patch (paper §5).
* ``coarse``: a cheap sensor with 4 × 4 noisy taxels, two of them dead.
* ``gel``: the default, 128 × 128 taxels.
* ``hard``: eight objects with independent shapes out of twelve similar ones, very different sizes, half the pad.
* ``many``: twelve objects of twelve shapes with the default pad.
* ``keyed``: four of eight shapes that differ in one place each, touched from 26 directions: where to touch matters.

    >>> SCENES["coarse"].scene.renderer
    PressureRenderer(binning=8)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from activetouch.distributions import Uniform
from activetouch.poses import POSE_SETS
from activetouch.pressing.contact import Pad, Quasistatic
from activetouch.pressing.dynamic import GuardedMove
from activetouch.rendering import DeadTaxels, ForcePatchRenderer, Gain, Noise, PressureRenderer
from activetouch.scene import Scene, Variation
from activetouch.shapes import EXTENDED_SHAPES, KEYED_SHAPES
from belief.composition import Composition, Counts

_LARGEST_INPUT = 64  # image edge of a classifier for a user's scene [pixels]


@dataclass(frozen=True)
class NamedScene:
    """A scene, the objects of its searches, and the network of its classifier.

    Attributes:
        scene: determines the touches.
        num_objects: number of objects of a search.
        composition: prior of their shapes.
        touches_per_object: touch limit of a search, per object.
        backbone: a key of :data:`activetouch.perception.backbones.BACKBONES`.
        input_size: edge of the classifier's images [pixels].
    """

    scene: Scene = field(default_factory=Scene)
    num_objects: int = 4
    composition: Composition | Counts = Composition.DISTINCT
    touches_per_object: int = 12
    backbone: str = "cnn"
    input_size: int = 32


SCENES: Mapping[str, NamedScene] = MappingProxyType(
    {
        "paper": NamedScene(
            Scene(
                press_model=GuardedMove(),
                renderer=ForcePatchRenderer(),
                faults=(),
                variation=Variation(force=Uniform(0.5, 2.0)),  # the paper's "small threshold"
            ),
            backbone="atto",
            input_size=32,
        ),
        "coarse": NamedScene(
            Scene(
                pad=Pad(num_taxels=32),
                renderer=PressureRenderer(binning=8),
                faults=(Gain(0.10), Noise(0.05), DeadTaxels(2 / 16, seed=1)),
            ),
            input_size=16,
        ),
        "gel": NamedScene(),
        "hard": NamedScene(
            Scene(shapes=EXTENDED_SHAPES, pad=Pad(half_width=0.0075), variation=Variation(size=Uniform(0.75, 1.25))),
            num_objects=8,
            composition=Composition.INDEPENDENT,
        ),
        "many": NamedScene(Scene(shapes=EXTENDED_SHAPES), num_objects=12),
        "keyed": NamedScene(
            Scene(
                shapes=KEYED_SHAPES,
                poses=POSE_SETS["directions26"],
                pad=Pad(num_taxels=32),
                press_model=Quasistatic(),
                renderer=PressureRenderer(binning=2),
            ),
            touches_per_object=26,
            input_size=16,
        ),
    }
)
"""The named scenes."""


def as_named(scene: Scene) -> NamedScene:
    """A scene with the default search: up to four different objects, classifier images of at most 64 pixels.

    Images that cannot be averaged to so few pixels keep their size.
    """
    edge = scene.image_shape[0]
    divisor = max(n for n in range(1, _LARGEST_INPUT + 1) if edge % n == 0)
    size = divisor * max(1, 16 // divisor)
    if edge % size and size % edge:  # as of 67 pixels
        size = edge
    return NamedScene(scene, num_objects=min(4, len(scene.shapes)), input_size=size)
