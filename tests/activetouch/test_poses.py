"""Sets of poses and aims."""

import numpy as np
import pytest

from activetouch import Quasistatic, Scene
from activetouch.poses import POSE_SETS, POSES, aimed, to_matrix
from belief.errors import InvalidArgument, UnknownName


def test_every_pose_of_directions26_turns_its_side_to_the_pad():
    poses = POSE_SETS["directions26"]
    assert len(poses) == 26
    for label, quaternion in poses.items():
        side = np.array([{"+": 1.0, "-": -1.0}[label[label.index(a) - 1]] if a in label else 0.0 for a in "xyz"])
        np.testing.assert_allclose(to_matrix(quaternion) @ side, [-np.linalg.norm(side), 0, 0], atol=1e-5)
        assert np.linalg.norm(quaternion) == pytest.approx(1.0)


def test_a_scene_takes_the_name_of_a_set_and_aims_move_the_object(rng):
    assert Scene(poses="mix").pose_labels == tuple(POSES)
    poses, aims = aimed(POSE_SETS["directions26"], [(0.0, 0.0), (0.006, 0.0), (0.0, -0.006), (0.006, 0.006)])
    scene = Scene(poses=poses, aims=aims, press_model=Quasistatic())
    assert len(scene.pose_labels) == 104
    assert scene.aim_offsets[:4].tolist() == [[0.0, 0.0], [0.006, 0.0], [0.0, -0.006], [0.006, 0.006]]
    thing = scene.sample_object("cube", rng)
    centred, aside = (scene.place(thing, pose, np.random.default_rng(3)) for pose in (0, 3))
    np.testing.assert_allclose(aside.offset - centred.offset, [0.006, 0.006])
    np.testing.assert_array_equal(aside.orientation, centred.orientation)


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"poses": "directions27"}, UnknownName),
        ({"aims": {"nowhere": (0.0, 0.0)}}, UnknownName),
        ({"aims": {"front": (0.0, np.nan)}}, InvalidArgument),
        ({"aims": {"front": (0.0,)}}, InvalidArgument),
        ({"aims": {"front": (5.0, 0.0)}}, InvalidArgument),
    ],
)
def test_a_scene_refuses_poses_and_aims_that_it_cannot_use(changes, error):
    with pytest.raises(error):
        Scene(**changes)
