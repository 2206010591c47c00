"""Many presses at once are the presses one by one."""

from dataclasses import replace

import numpy as np
import pytest

from activetouch.named_scenes import SCENES
from activetouch.pressing.press import Quasistatic
from benchmarks.bayes_error.press_draws import PressSampler, ideal_presses

SCENE = SCENES["coarse"].scene


@pytest.mark.parametrize("shape", range(4))
def test_images_are_those_of_quasistatic_presses(shape, rng):
    sampler = PressSampler(SCENE.variation, 5, 3)
    for pose in range(3):
        placement = SCENE.place(replace(SCENE.sample_object(shape, rng), stiffness=0.7), pose, rng)
        draws = sampler.sample(rng)
        found = ideal_presses(SCENE, placement, draws).reshape(5, 3, 4, 4)
        for j, f in np.ndindex(5, 3):
            placed = replace(placement, offset=draws.offsets[j])
            contact = Quasistatic().press(SCENE.pad, placed, draws.forces[j, f])
            np.testing.assert_allclose(found[j, f], SCENE.image(contact), atol=1e-12)
