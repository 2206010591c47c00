"""Built-in solids of other proportions than the scene's, as hypotheses of a shipped sensor."""

from dataclasses import replace
from functools import reduce

import numpy as np
import pytest

from activetouch import TactileSensor
from activetouch.perception.proportions import with_other_proportions
from activetouch.solids.family import Proportions
from activetouch.solids.primitives import Box, Cylinder, Sphere
from belief.errors import InvalidArgument

pytestmark = pytest.mark.mujoco


def test_long_cylinders_are_named_that_are_taken_for_other_shapes_without():
    nominal = TactileSensor.shipped("coarse")
    varied = TactileSensor.shipped("coarse", other_proportions=True)
    label = nominal.shape_labels.index("cylinder")
    solid = nominal.scene.solids["cylinder"]
    long = replace(nominal.scene, shapes={"cylinder": replace(solid, half_length=2 * solid.half_length)})
    rng, stated = np.random.default_rng(0), {nominal: [], varied: []}
    for _ in range(12):
        obj, poses = long.sample_object(0, rng), rng.permutation(len(nominal.pose_labels))[:5].tolist()
        images = np.stack([long.press(obj, pose, rng).image for pose in poses])
        for sensor, found in stated.items():
            touches = sensor.read(images, poses)
            likelihood = reduce(lambda after, touch: after.update(touch), touches, sensor.model.start()).log_likelihood
            found.append(likelihood[label] - np.logaddexp.reduce(likelihood))
    before, after = (np.array(found) for found in stated.values())
    assert (before < np.log(0.1)).any()
    assert np.median(after[before < np.log(0.5)] - before[before < np.log(0.5)]) > 1.0
    assert after.min() > np.log(0.01)


@pytest.mark.parametrize(("name", "options"), [("keyed", {}), ("coarse", {"unknown_state": True})])
def test_what_cannot_weigh_other_proportions_says_so(name, options):
    with pytest.raises(InvalidArgument, match=r"other proportions are weighed by.*\(--family\)"):
        TactileSensor.shipped(name, other_proportions=True, **options)


def test_solids_of_one_length_have_no_proportions_to_weigh():
    sensor = TactileSensor.shipped("coarse")
    spheres = replace(sensor.scene, shapes={"marble": Sphere(0.01), "ball": Sphere(0.02)})
    with pytest.raises(InvalidArgument, match=r"of marble, ball, none is a solid with two lengths"):
        with_other_proportions(sensor.model, sensor.folder / "any_object.safetensors", spheres)


def test_one_factor_multiplies_the_last_length_or_all_but_the_first():
    box = Box((0.01, 0.02, 0.04))
    found = np.array([member.half_extents for member in Proportions(box).members(400)]) / box.half_extents
    assert (found[:, 0] == 1.0).all()
    both = found[:, 1] == found[:, 2]
    assert 0.4 < both.mean() < 0.6
    assert (found[~both, 1] == 1.0).all()
    assert (found[:, 2].min(), found[:, 2].max()) == pytest.approx((0.4, 2.5), rel=0.02)
    assert [Proportions.has(solid) for solid in (box, Cylinder(0.01, 0.02), Sphere(0.01))] == [True, True, False]
    with pytest.raises(InvalidArgument, match="has no proportions"):
        Proportions(Sphere(0.01))
