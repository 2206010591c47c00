"""How an object lies: symmetry from geometry, weighed orientations, and the search for the true one."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from activetouch import SCENES, TactileSensor
from activetouch.pose_belief import PoseBelief, turned_slightly
from activetouch.poses import hamilton_product, random_orientation, turn
from activetouch.symmetry import RotationalSymmetry, symmetry_of
from belief.errors import InvalidArgument

IDENTITY = np.array([[1.0, 0.0, 0.0, 0.0]])
NONE = RotationalSymmetry(IDENTITY)


@pytest.mark.parametrize(
    ("shape", "number", "is_free"),
    [("cylinder", 2, True), ("cone", 1, True), ("hexagonal_prism", 12, False), ("ellipsoid", 4, False)],
)
def test_symmetries_are_those_of_the_geometry(shape: str, number: int, is_free: bool) -> None:
    found = symmetry_of(SCENES["hard"].scene.solids[shape])
    assert len(found.rotations) == number
    assert (found.axis is not None) == is_free
    if is_free:
        np.testing.assert_allclose(np.abs(found.axis), [0.0, 0.0, 1.0], atol=1e-6)


def test_a_sphere_lies_one_way_only() -> None:
    found = symmetry_of(SCENES["hard"].scene.solids["sphere"])
    assert found.is_ball
    assert found.angles(IDENTITY[0], np.eye(4)).tolist() == [0.0] * 4


def test_a_cube_has_24_orientations_that_look_the_same() -> None:
    found = symmetry_of(SCENES["hard"].scene.solids["cube"])
    assert len(found.rotations) == 24
    exact = np.roll(Rotation.create_group("O").as_quat(), 1, axis=1)
    assert np.rad2deg(2.0 * np.arccos(np.abs(found.rotations @ exact.T).max(axis=1).clip(0.0, 1.0))).max() < 1.0
    assert np.rad2deg(found.angles(IDENTITY[0], turn("z", np.pi / 2)[None])[0]) < 5.0
    assert 42.0 < np.rad2deg(found.angles(IDENTITY[0], turn("z", np.pi / 4)[None])[0]) < 48.0


@pytest.mark.parametrize("axis", [None, np.array([0.0, 0.0, 1.0])])
def test_the_nearest_orientation_that_looks_the_same_is_as_near_as_is_said(axis: np.ndarray | None) -> None:
    rng = np.random.default_rng(0)
    symmetry = RotationalSymmetry(np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]), axis)
    one, others = random_orientation(rng), np.stack([random_orientation(rng) for _ in range(40)])
    nearest = symmetry.nearest(one, others)
    np.testing.assert_allclose(NONE.angles(one, nearest), symmetry.angles(one, others), atol=1e-6)
    assert max(symmetry.angles(a, b[None])[0] for a, b in zip(others, nearest, strict=True)) < 1e-6


def test_a_set_holds_what_it_says() -> None:
    rng = np.random.default_rng(1)
    centre = random_orientation(rng)
    drawn = turned_slightly(centre, rng.normal(0.0, 0.05, (4000, 3)))
    belief = PoseBelief("mug", drawn, np.ones(4000), np.full(4000, 1 / 4000), NONE)
    found = belief.credible()
    others = turned_slightly(centre, rng.normal(0.0, 0.05, (1000, 3)))
    assert 0.87 < np.mean([found.contains(other) for other in others]) < 0.93
    assert belief.error(centre) < 0.3
    assert len(found.orientations) == 1
    assert "mug lies as" in str(belief)


def test_ways_that_look_the_same_are_one() -> None:
    rng = np.random.default_rng(2)
    half = RotationalSymmetry(np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]))
    centre = random_orientation(rng)
    other = np.stack(hamilton_product(centre, half.rotations[1]))
    both = np.stack([centre, other])
    assert len(PoseBelief("pen", both, np.ones(2), np.full(2, 0.5), half).ways()) == 1
    assert len(PoseBelief("pen", both, np.ones(2), np.full(2, 0.5), NONE).ways()) == 2


@pytest.mark.parametrize("probs", [[0.5, 0.6], [np.nan, 1.0], [-0.5, 1.5]])
def test_what_is_no_distribution_is_refused(probs: list[float]) -> None:
    with pytest.raises(ValueError, match="probabilities that sum to 1"):
        PoseBelief("mug", np.eye(4)[:2], np.ones(2), np.array(probs), NONE)


def test_a_sensor_says_how_an_object_lies() -> None:
    """Objects of the coarse pad: more touches, a nearer orientation; the true one is in most sets."""
    sensor = TactileSensor.shipped("coarse")
    scene, rng, errors, held = sensor.scene, np.random.default_rng(3), [], []
    for shape in ("cone", "cylinder", "cube"):
        obj = scene.sample_object(shape, rng)
        poses = list(scene.pose_labels)[:3]
        images = np.stack([scene.press(obj, pose, rng).image for pose in poses])
        found = sensor.pose(shape, images, poses)
        errors.append(found.error(obj.orientation))
        held.append(found.credible().contains(obj.orientation))
    assert np.median(errors) < 8.0
    assert sum(held) >= 2


@pytest.mark.nightly  # a sensor does
def test_a_session_says_how_an_object_lies() -> None:
    sensor = TactileSensor.shipped("coarse")
    session, rng = sensor.session("cone", num_objects=1), np.random.default_rng(4)
    obj = sensor.scene.sample_object("cone", rng)
    for pose in sensor.pose_labels[:3]:
        session.tell(image=sensor.scene.press(obj, pose, rng).image, pose=pose)
    found = session.pose("cone")
    images = np.stack([told.image for told in session._events])
    again = sensor.pose("cone", images, sensor.pose_labels[:3])
    assert found.error(again.orientation) < 5.0  # where the session starts from knows of misses, too
    assert session.pose().shape == sensor.shape_labels[int(session.belief.probs.argmax())]


def test_a_belief_without_orientations_says_so() -> None:
    sensor = TactileSensor.shipped("paper-independent")
    with pytest.raises(InvalidArgument, match="knows nothing of how objects lie"):
        sensor.pose(0, np.zeros((1, *sensor.scene.image_shape), np.uint8), [0])
