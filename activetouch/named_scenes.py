"""A ladder of named scenes, from one where a touch says little to one with many objects.

With fine images of different shapes one press nearly decides. Planning earns its keep where touch is poor or shapes are
alike, so a comparison of deciders means little on one scene alone:

* ``paper``: the paper's world and its images, a force vector drawn as a patch (paper §5).
* ``coarse``: a real, cheap array: 4 × 4 taxels, noisy, two of them dead.
* ``gel``: the default, 128 × 128 taxels.
* ``hard``: twelve shapes that share faces, edges and curvatures, very different sizes, half the pad; any mixture.
* ``many``: twelve objects of twelve shapes under the default pad.

    >>> SCENES["coarse"].scene.renderer
    PressureRenderer(binning=8)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from activetouch.distributions import Uniform
from activetouch.pressing.guarded_move import GuardedMove
from activetouch.pressing.pad import Pad
from activetouch.rendering import DeadTaxels, ForcePatchRenderer, Gain, Noise, PressureRenderer
from activetouch.scene import Scene, Variation
from activetouch.shapes import EXTENDED_SHAPES
from belief import Composition


@dataclass(frozen=True)
class NamedScene:
    """A scene and the search that is played in it.

    Attributes:
        scene: what touches look like.
        num_objects: on the table.
        composition: what is known about which shapes they have.
        backbone: of the scene's classifier, a key of :data:`activetouch.perception.backbones.BACKBONES`.
        input_size: edge of the images it sees [pixels].
    """

    scene: Scene = field(default_factory=Scene)
    num_objects: int = 4
    composition: Composition = Composition.DISTINCT
    backbone: str = "cnn"
    input_size: int = 64


SCENES: Mapping[str, NamedScene] = MappingProxyType(
    {
        "paper": NamedScene(
            Scene(
                press_model=GuardedMove(),
                renderer=ForcePatchRenderer(),
                faults=(),
                variation=Variation(force=Uniform(0.5, 2.0)),  # the paper's "small threshold"
                height=0.07,
                finger=True,
                parking=True,
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
    }
)
"""The named scenes."""
