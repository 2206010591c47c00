"""Domain randomisation: a scene whose nuisances vary more than the scene itself says, to train readers in.

    reader trained in randomised(SCENES["coarse"].scene)  →  keeps its promise where the world is not quite that scene

Half of all forces, noises and broken taxels are those of the scene, so that a reader loses little there (Tobin et al.
2017).

>>> from activetouch.named_scenes import SCENES
>>> wide = randomised(SCENES["coarse"].scene)
>>> wide.variation.stiffness
LogUniform(low=0.5, high=2.0)
"""

from __future__ import annotations

from dataclasses import replace

from activetouch.distributions import Constant, Distribution, LogUniform, Mixture, Uniform
from activetouch.rendering.faults import DrawnDeadTaxels, DrawnNoise, Fault, Gain, Noise
from activetouch.scene import Scene, Variation
from belief.errors import InvalidArgument

STIFFNESS = LogUniform(0.5, 2.0)
"""Factor on the scene's own stiffness, where that is constant."""
_AS_SAID = 0.6  # share of hypotheses for which the world is as the scene says
_SIZE = 0.15  # beyond the smallest and the largest size
_FORCE = (1 / 1.5, 2.0)  # factors on the smallest and the largest force
_NOISE = LogUniform(1.0, 3.0)
_GAIN = 0.2  # half range, at least
_DEAD = 0.2  # share of taxels, at most


def randomised(scene: Scene) -> Scene:
    """The scene with wider distributions of size, force, friction, stiffness, noise, gain and broken taxels.

    Images that are drawings, such as the force patch, have no faults, and get none.

    Raises:
        InvalidArgument: the smallest force of the scene is zero, so that no factor makes it smaller.
    """
    vary = scene.variation
    lightest, heaviest = vary.force.support
    if lightest <= 0.0:
        raise InvalidArgument(f"a scene to be randomised needs forces above zero, got {vary.force}")
    wider = replace(
        vary,
        size=_wider_sizes(vary.size),
        force=Mixture(vary.force, LogUniform(lightest * _FORCE[0], heaviest * _FORCE[1])),
        friction=_wider_friction(vary.friction),
        stiffness=_wider_stiffness(vary.stiffness),
    )
    faults = tuple(_drawn(fault) for fault in scene.faults)
    if scene.faults:
        faults += (DrawnDeadTaxels(Mixture(Constant(0.0), Uniform(0.0, _DEAD))),)
    return replace(scene, variation=wider, faults=faults)


def assumed(variation: Variation, stiffness: Distribution | None = None) -> Variation:
    """What the belief of a sensor takes for possible, whose reader was trained on a randomised scene.

    Most of the prior is for what the scene says, the rest for other sizes and stiffnesses.

    Args:
        variation: of the scene.
        stiffness: where it is known better, as after ``activetouch adapt``.
    """
    return replace(
        variation,
        size=Mixture(variation.size, _wider_sizes(variation.size), _AS_SAID),
        stiffness=stiffness or Mixture(variation.stiffness, STIFFNESS, _AS_SAID),
    )


def _wider_sizes(own: Distribution) -> Distribution:
    smallest, largest = own.support
    return Uniform(max(0.5 * smallest, smallest - _SIZE), largest + _SIZE)


def _wider_friction(own: Distribution) -> Distribution:
    """What the scene says, unless that is one number; else a range that holds it."""
    low, high = own.support
    return own if low < high else Uniform(min(0.3, low), max(1.0, high))


def _wider_stiffness(own: Distribution) -> Distribution:
    """What the scene says, unless that is one number; else a range about it."""
    low, high = own.support
    return own if low < high else LogUniform(low * STIFFNESS.low, high * STIFFNESS.high)


def _drawn(fault: Fault) -> Fault:
    match fault:
        case Noise(std=std):
            return DrawnNoise(std, Mixture(Constant(1.0), _NOISE))
        case Gain(half_range=half_range):
            return Gain(max(half_range, _GAIN))
    return fault
