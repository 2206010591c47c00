"""Log evidence of touched objects for one shape, from a bank of simulated bodies of the shape.

The probability of a touch given a body is the mean over offsets, forces and gains, which are drawn anew for each touch,
of the closed form in :mod:`benchmarks.bayes_error.noise`. Bodies are drawn as the scene draws objects.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from activetouch.errors import UnstablePress
from activetouch.scene import Scene
from belief.seeding import keyed_rng
from benchmarks.bayes_error.evidence import Evidence, joint_log_likelihoods
from benchmarks.bayes_error.noise import SensorNoise, UnknownLikelihood
from benchmarks.bayes_error.press_draws import PressSampler, ideal_presses
from benchmarks.bayes_error.touched_objects import TouchedObjects
from benchmarks.held_out import Stream

Floats = NDArray[np.float64]

BODIES_PER_SLICE = 256
FORCES_PER_OFFSET = 4
_TRIAL_PRESSES = 50


@dataclass(frozen=True, eq=False)
class BodyBank:
    """A bank of bodies of every shape, in slices; a smaller bank is the beginning of a larger one.

    Attributes:
        scene: the world; objects must keep their orientation.
        draws: offsets of each body in each pose; at every one of them four forces, and a gain for each image.
        force_ratios: force in the pause over target force, of each shape.
        seed: of the bank.
        slice_size: bodies in one slice.
    """

    scene: Scene
    draws: int
    force_ratios: tuple[float, ...]
    seed: int
    slice_size: int = BODIES_PER_SLICE

    @classmethod
    def of(cls, scene: Scene, draws: int, seed: int, slice_size: int = BODIES_PER_SLICE) -> BodyBank:
        """A bank with the force ratios of the scene's presses.

        Raises:
            UnknownLikelihood: the sensor's faults have no closed-form likelihood, the renderer cannot show many presses
                at once, or the orientation in a touch does not follow from the pose.
        """
        SensorNoise.of(scene.faults, scene.image_shape[0])
        if getattr(scene.renderer, "mean_pressure", None) is None:
            raise UnknownLikelihood(f"a bank of bodies needs a renderer with mean_pressure, not {scene.renderer!r}")
        rng = keyed_rng([seed, Stream.BODY], is_fixed_length=True)
        thing, pose = scene.sample_object(0, rng), 0
        first, second = (scene.place(thing, pose, rng).orientation for _ in range(2))
        if not np.array_equal(first, second):
            raise UnknownLikelihood(
                f"with {scene.presentation!r} the orientation in a touch does not follow from the pose, which a bank "
                "of bodies does not model"
            )
        ratios = (force_ratio(scene, shape, rng) for shape in range(len(scene.shapes)))
        return cls(scene, draws, tuple(ratios), seed, slice_size)

    def evidence(self, touched: TouchedObjects, shape: int, number: int) -> tuple[int, int, Evidence]:
        """Evidence for a shape from one slice of the bank.

        Args:
            touched: the objects.
            shape: index of the shape.
            number: of the slice, which keys its generator.

        Returns:
            Shape, number, and the evidence, with K = 1.
        """
        scene, noise = self.scene, SensorNoise.of(self.scene.faults, self.scene.image_shape[0])
        rng = keyed_rng([self.seed, Stream.BODY, shape, number], is_fixed_length=True)
        sampler = PressSampler(scene.variation, self.draws, FORCES_PER_OFFSET)
        bodies = [scene.sample_object(shape, rng) for _ in range(self.slice_size)]
        found = np.empty((*touched.readings.shape[:2], 1, len(bodies)))
        for pose in range(len(scene.poses)):
            images = []
            for body in bodies:
                draws = sampler.sample(rng)
                draws = replace(draws, forces=self.force_ratios[shape] * draws.forces)
                images.append(ideal_presses(scene, scene.place(body, pose, rng), draws))
            means = noise.sample_means(np.concatenate(images), rng)
            groups = means.reshape(len(bodies), -1, means.shape[1])
            found[:, pose, 0] = noise.log_mean_likelihoods(touched.readings[:, pose], groups)
        return shape, number, joint_log_likelihoods(found, touched.orders)


def force_ratio(scene: Scene, shape: int, rng: np.random.Generator) -> float:
    """Median ratio of the force in the pause to the target force; a moving press stops a few per cent above it."""
    ratios, press, vary = [], scene.press_model, scene.variation
    for number in range(_TRIAL_PRESSES):
        placement = scene.place(scene.sample_object(shape, rng), number % len(scene.poses), rng)
        target = vary.force.sample(rng)
        try:
            ratios.append(press.press(scene.pad, placement, target).force / target)
        except UnstablePress:
            continue
    return float(np.median(ratios)) if ratios else 1.0
