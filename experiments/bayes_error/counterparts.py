"""Search for counterparts: presses of another shape that a sensor cannot tell from a given touch.

A counterpart is a press of *another* shape, within the scene's ranges of size, offset and force and in any orientation,
whose noise-free image differs from the touch's by less than the noise. With Gaussian noise σ on every taxel, only the
distance

    d = min over the gain g in its range of  ‖image - g · counterpart‖ / σ

matters: a reader that knows both presses, both equally likely, errs with probability at least Φ(-d/2) (Neyman and
Pearson; saturation and rounding only increase it). A counterpart shows that such a press *exists*, not how likely the
scene is to produce it, so shares of touches with counterparts are not error rates.

A search starts from the presses of the other shape in a bank whose coarse images are nearest to the touch, rotated and
mirrored where that is equally likely. It refines them by Gauss-Newton steps with finite differences, first on a coarse
pad, where a press costs a fifth, then on the pad itself. The search can fail: applied to the touch's *own* shape, for
which a press always exists, it measures how often it does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from activetouch.errors import UnknownLikelihood
from activetouch.placement import Placement
from activetouch.poses import Quaternion, multiply
from activetouch.pressing.press import Quasistatic
from activetouch.rendering.faults import gain_and_noise, rescaled_noise
from activetouch.scene import Scene, Symmetry, Variation
from belief.seeding import keyed_rng
from experiments.bayes_error.held_out import Stream
from experiments.bayes_error.image_bank import symmetric_views

Floats = NDArray[np.float64]

BANK_EDGE = 16
"""Edge of the averaged images that are compared first."""
SKETCH_EDGE = 32
"""Number of taxels along an edge of the coarse pad."""
_TOLERANCE, _MOST_STEPS = 1e-4, 40
# Steps of the finite differences: turn [rad], size, offset [m], force [N], stiffness.
_STEPS = np.array([1e-3, 1e-3, 1e-3, 1e-3, 1e-5, 1e-5, 2e-3, 1e-3])


@dataclass(frozen=True, eq=False)
class Pressing:
    """A placed object and the force that it is pressed with [N]."""

    placement: Placement
    force: float

    def image(self, scene: Scene) -> Floats:
        """The ideal image of the press."""
        return scene.renderer(Quasistatic().press(scene.setup, self.placement, self.force))


@dataclass(frozen=True, eq=False)
class Target:
    """The image that counterparts are compared with.

    Attributes:
        image: noise-free and amplified, at full resolution.
        sketch: the same, from the coarse pad.
    """

    image: Floats
    sketch: Floats

    @classmethod
    def of(cls, scene: Scene, pressing: Pressing, gain: float) -> Target:
        """The target for a press that was read with a gain."""
        return cls(gain * pressing.image(scene), gain * pressing.image(sketched(scene, SKETCH_EDGE)))

    def views(self, symmetry: Symmetry) -> list[Target]:
        """All equally likely targets, this one first."""
        both = (symmetric_views(image[None], symmetry)[0] for image in (self.image, self.sketch))
        return [Target(image, sketch) for image, sketch in zip(*both, strict=True)]


@dataclass(frozen=True, eq=False)
class Counterpart:
    """The nearest press that a search found.

    Attributes:
        distance: d, in units of the noise.
        pressing: the object and the force.
        image: its image, noise-free and amplified.
        touch: the image that it was compared with, in the view that it was compared in.
    """

    distance: float
    pressing: Pressing
    image: Floats
    touch: Floats


@dataclass(frozen=True)
class Sensing:
    """Parameters of the sensor that hide differences: amplification within ``1 ± gain``, then noise ``std``."""

    gain: float
    std: float

    @classmethod
    def of(cls, scene: Scene) -> Sensing:
        """The parameters of a scene's sensor.

        Raises:
            UnknownLikelihood: there is no noise, or another fault than a gain before it.
        """
        try:
            gain, std, _ = gain_and_noise(scene.faults)
        except UnknownLikelihood as error:
            hint = "Use --learned-from, or for force-patch images python benchmarks/force_patch_limit.py"
            raise UnknownLikelihood(f"{error}. {hint}") from error
        return cls(gain, std)

    def fit_gain(self, image: Floats, ideal: Floats) -> float:
        """The gain in its range for which an ideal image is nearest to ``image``."""
        square = float(np.vdot(ideal, ideal))
        return float(np.clip(np.vdot(image, ideal) / square if square else 1.0, 1.0 - self.gain, 1.0 + self.gain))

    def distance(self, image: Floats, ideal: Floats) -> float:
        """Distance of an amplified image from an ideal one in units of the noise, with the best gain."""
        return float(np.linalg.norm(image - self.fit_gain(image, ideal) * ideal) / self.std)


def sketched(scene: Scene, edge: int) -> Scene:
    """The scene with a coarse pad of ``edge`` taxels along an edge, and noise that gives the same distances."""
    found = scene.image_shape[0]
    finer = scene.pad.num_taxels // found
    faults = rescaled_noise(scene.faults, edge / found)
    return replace(scene, pad=replace(scene.pad, num_taxels=edge * finer), faults=faults)


def block_means(images: Floats, edge: int) -> Floats:
    """Images ``(..., n, n)`` averaged down to ``edge`` along an edge."""
    block = images.shape[-1] // edge
    return images.reshape(*images.shape[:-2], edge, block, edge, block).mean(axis=(-3, -1))


def bank_slice(
    scene: Scene, shape: int, number: int, count: int, seed: int
) -> tuple[int, int, list[Pressing], NDArray[np.float32]]:
    """Random presses of a shape on a coarse pad.

    Args:
        scene: the world.
        shape: index of the shape.
        number: of the slice, which keys its generator.
        count: number of presses.
        seed: of the bank.

    Returns:
        Shape, number, presses and their coarse images.
    """
    rng = keyed_rng([seed, Stream.BANK, shape, number], is_fixed_length=True)
    coarse, pressings, images = sketched(scene, SKETCH_EDGE), [], []
    for index in range(count):
        placement = scene.place(scene.sample_object(shape, rng), index % len(scene.poses), rng)
        pressings.append(Pressing(placement, scene.variation.force.sample(rng)))
        images.append(coarse_means(pressings[-1].image(coarse)))
    return shape, number, pressings, np.stack(images).astype(np.float32)


def coarse_means(image: Floats) -> Floats:
    """An image of one or three channels as one row of averages over blocks, :data:`BANK_EDGE` along an edge."""
    return block_means(np.moveaxis(np.atleast_3d(image), 2, 0), BANK_EDGE).ravel()


@dataclass(frozen=True, eq=False)
class Start:
    """Starting point of a search: a press, and the target in the view that it resembles."""

    target: Target
    pressing: Pressing


def nearest_starts(
    targets: Sequence[Target], pressings: Sequence[Pressing], images: NDArray[np.float32], sensing: Sensing, count: int
) -> list[Start]:
    """The ``count`` pairs of a view and a press whose coarse images are nearest, with the best gain.

    Args:
        targets: equally likely views of the touch.
        pressings: presses of the bank.
        images: their coarse images, ``(B, D)``.
        sensing: with the range of the gain.
        count: number of pairs.
    """
    rows = np.stack([coarse_means(target.sketch) for target in targets]).astype(np.float32)  # (V, D)
    product, square = rows @ images.T, np.einsum("ij,ij->i", images, images)  # (V, B), (B,)
    gain = np.clip(product / np.maximum(square, np.finfo(np.float32).tiny), 1.0 - sensing.gain, 1.0 + sensing.gain)
    differences = (square * gain - 2 * product) * gain
    views, presses = np.unravel_index(np.argsort(differences, axis=None, kind="stable")[:count], differences.shape)
    return [Start(targets[v], pressings[b]) for v, b in zip(views, presses, strict=True)]


def find_counterpart(scene: Scene, starts: Sequence[Start], num_polished: int = 2) -> Counterpart:
    """The nearest press that refinement reaches from several starting points.

    Args:
        scene: gives ranges, pad, renderer and noise.
        starts: presses of the other shape.
        num_polished: number of the best on the coarse pad that are refined on the pad itself.
    """
    coarse = sketched(scene, SKETCH_EDGE)
    drafts = []
    for start in starts:
        rough = refine(coarse, start.target.sketch, start.pressing, stride=10.0)
        drafts.append((refine(coarse, start.target.sketch, rough.pressing), start.target))
    drafts.sort(key=lambda draft: draft[0].distance)
    polished = [refine(scene, target.image, draft.pressing) for draft, target in drafts[:num_polished]]
    return min(polished, key=lambda found: found.distance)


def refine(scene: Scene, image: Floats, start: Pressing, stride: float = 1.0) -> Counterpart:
    """Change a press within the scene's ranges until its image is locally nearest to ``image``.

    Args:
        scene: gives ranges, pad, renderer and noise.
        image: the target, noise-free and amplified.
        start: within the ranges.
        stride: factor on the steps of the finite differences; longer steps average over taxels.
    """
    sensing, around = Sensing.of(scene), start.placement
    low, high = _ranges(scene.variation)
    origin = np.array([0.0, 0.0, 0.0, around.scale, *around.offset, start.force, around.stiffness])
    free, steps = high > low, stride * _STEPS
    low, high, steps = low[free], high[free], steps[free]

    def pressing(values: Floats) -> Pressing:
        x = origin.copy()
        x[free] = values
        turned = multiply(_turn(x[:3]), around.orientation)
        placement = replace(around, orientation=turned, scale=float(x[3]), offset=x[4:6], stiffness=float(x[7]))
        return Pressing(placement, float(x[6]))

    def difference(values: Floats) -> Floats:
        ideal = pressing(values).image(scene)
        return (sensing.fit_gain(image, ideal) * ideal - image).ravel() / sensing.std

    def slopes(values: Floats) -> Floats:
        here = difference(values)
        moves = np.diag(np.where(values + steps <= high, steps, -steps))
        return np.stack([(difference(values + move) - here) / move.sum() for move in moves], axis=1)

    def counterpart(found: Pressing) -> Counterpart:
        ideal = found.image(scene)
        return Counterpart(sensing.distance(image, ideal), found, sensing.fit_gain(image, ideal) * ideal, image)

    inside = 1e-6 * (high - low)
    solution = least_squares(
        difference,
        np.clip(origin[free], low + inside, high - inside),
        jac=slopes,
        bounds=(low, high),
        x_scale=100 * _STEPS[free],
        ftol=_TOLERANCE,
        xtol=1e-9,
        max_nfev=_MOST_STEPS,
    )
    return min(counterpart(start), counterpart(pressing(solution.x)), key=lambda candidate: candidate.distance)


def _ranges(variation: Variation) -> tuple[Floats, Floats]:
    drawn = (variation.size, variation.offset, variation.offset, variation.force, variation.stiffness)
    low, high = np.array([distribution.support for distribution in drawn]).T
    return np.concatenate([[-np.pi] * 3, low]), np.concatenate([[np.pi] * 3, high])


def _turn(vector: Floats) -> Quaternion:
    """The rotation about ``vector`` by its length [rad]."""
    angle = np.linalg.norm(vector)
    return np.array([np.cos(angle / 2), *(0.5 * np.sinc(angle / (2 * np.pi)) * vector)])
