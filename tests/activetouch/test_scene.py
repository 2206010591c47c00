"""Scenes: presentations, distributions, what they promise about images, and the named ones."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from activetouch import SCENES, SHAPES, Quasistatic, Scene
from activetouch.distributions import Constant, LogUniform, Uniform
from activetouch.errors import BadMesh
from activetouch.mesh_source import read_objects
from activetouch.orientations import Held, Inexact, Resampled, Tumbled, Upright
from activetouch.poses import aimed, to_matrices, to_matrix, turn
from activetouch.rendering import DeadTaxels, GelSightRenderer
from activetouch.scene import Symmetry, Variation
from activetouch.shapes import Box, Cut, Mesh, Sphere, Union
from belief.errors import InvalidArgument

STILL = Scene(press_model=Quasistatic())


@pytest.mark.parametrize("name", list(SCENES))
@pytest.mark.mujoco
def test_every_named_scene_presses_all_its_shapes_in_all_its_poses(name, rng):
    scene = SCENES[name].scene
    for shape in range(len(scene.shapes)):
        thing = scene.sample_object(shape, rng)
        for pose in range(len(scene.poses)):
            contact, image, *_ = scene.press(thing, pose, rng)
            assert contact.force > 0.0
            assert image.dtype == np.uint8
            assert SCENES[name].input_size % image.shape[0] == 0 or image.shape[0] % SCENES[name].input_size == 0


@pytest.mark.parametrize("name", list(SCENES))
def test_a_scene_can_be_sent_to_another_process(name):
    scene = SCENES[name].scene
    assert repr(pickle.loads(pickle.dumps(scene))) == repr(scene)
    assert pickle.loads(pickle.dumps(scene)) == scene


def test_scenes_are_equal_if_all_their_parts_are_and_in_the_same_order():
    assert replace(STILL, poses={"a": turn("z", 0.0)}) == replace(STILL, poses={"a": turn("z", 0.0)})
    assert replace(STILL, poses={"a": turn("z", 0.0)}) != replace(STILL, poses={"a": turn("z", 0.1)})
    assert replace(STILL, shapes=dict(reversed(SHAPES.items()))) != STILL  # the index of a shape is its place
    assert replace(STILL, aims={}) == STILL
    assert STILL != "scene"


def test_a_tumbled_object_keeps_its_orientation_and_a_resampled_one_does_not(rng):
    for presentation, same in ((Tumbled(), True), (Resampled(), False)):
        scene = replace(STILL, presentation=presentation)
        thing = scene.sample_object(1, rng)
        shown = [scene.place(thing, 3, np.random.default_rng(seed)).orientation for seed in range(2)]
        assert np.allclose(*shown) == same


def test_inexact_poses_are_missed_by_the_stated_error_about_every_axis(rng):
    scene = replace(STILL, presentation=Inexact(error=0.1))
    thing = scene.sample_object(1, rng)
    exact = to_matrix(replace(scene, presentation=Tumbled()).place(thing, 3, rng).orientation)
    missed = [to_matrix(scene.place(thing, 3, rng).orientation) @ exact.T for _ in range(2000)]
    about = np.array([(turn[2, 1], turn[0, 2], turn[1, 0]) for turn in missed])  # small rotations: their vectors
    assert np.abs(about.mean(axis=0)).max() < 0.01
    assert about.std(axis=0) == pytest.approx([0.1] * 3, rel=0.06)
    assert scene.symmetry is replace(scene, presentation=Tumbled()).symmetry
    with pytest.raises(ValueError, match=r"error must be a number in \[0, 3.14159\] rad, got nan"):
        Inexact(error=np.nan)


def test_an_upright_object_stands_within_its_tilt(rng):
    scene = replace(STILL, presentation=Upright(tilt=0.1))
    turns = np.array([to_matrix(scene.sample_object(2, rng).orientation) for _ in range(300)])
    axes = turns[:, :, 2]
    assert np.abs(turns[:, :2, 0].mean(axis=0)).max() < 0.2  # a mean of 300 unit vectors, four deviations of it
    standing = Upright(tilt=0.0).rests(20)
    np.testing.assert_array_equal(standing[:, 1:3], 0.0)
    tilts = np.arccos(np.clip(axes[:, 2], -1.0, 1.0))
    assert tilts.max() <= 0.1 + 1e-9
    assert tilts.max() > 0.08
    assert np.abs(axes[:, :2].mean(axis=0)).max() < 0.02  # leaning in no direction in particular


def test_a_held_object_shows_the_pad_a_side_in_every_touch(rng):
    exact = replace(STILL, presentation=Held(error=0.0))
    thing = exact.sample_object("cube", rng)
    for _ in range(3):
        depth = exact.press(thing, "front", rng).contact.pressure
        assert np.ptp(depth[depth > 0.0]) < 1e-3 * depth.max()
    axes = to_matrices(Held(error=0.1).rests(3000))[:, 0]
    sides = np.column_stack([axes, -axes]).argmax(axis=1)
    assert np.bincount(sides, minlength=6).tolist() == [500] * 6
    missed = np.arccos(np.abs(axes).max(axis=1))
    assert np.sqrt(np.square(missed).mean() / 2.0) == pytest.approx(0.1, rel=0.05)
    shown = [exact.place(thing, 0, rng).orientation for _ in range(200)]
    assert len({tuple(one.round(6)) for one in shown}) == 200
    assert exact.symmetry is Symmetry.ROTATIONS_AND_MIRROR
    with pytest.raises(ValueError, match=r"error must be a number in \[0, 3.14159\] rad, got -1"):
        Held(error=-1)


def test_turned_images_are_as_likely_only_where_nothing_has_a_direction():
    assert STILL.symmetry is Symmetry.ROTATIONS_AND_MIRROR
    assert replace(STILL, renderer=GelSightRenderer()).symmetry is Symmetry.NONE
    assert replace(STILL, faults=(DeadTaxels(0.1),)).symmetry is Symmetry.NONE
    assert replace(STILL, presentation=Upright()).symmetry is Symmetry.NONE
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) * 0.02
    mesh = Mesh("corner", vertices - 0.005, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    assert replace(STILL, shapes={"corner": mesh}).symmetry is Symmetry.ROTATIONS
    beside = replace(STILL.variation, offset=Uniform(0.0, 0.004))
    assert replace(STILL, variation=beside).symmetry is Symmetry.NONE
    poses, aims = aimed(STILL.poses, [(0.0, 0.0), (0.005, 0.0)])
    assert replace(STILL, poses=poses, aims=aims).symmetry is Symmetry.NONE


class _OwnBox(Box):
    """A shape of a class that nothing is known of."""


@pytest.mark.parametrize(
    ("shape", "is_mirrored"),
    [
        (Cut(Box((0.016,) * 3), ((1.0, 1.0, 1.0, 0.022),)), True),
        (Cut(Box((0.016,) * 3), ((1.0, 2.0, 3.0, 0.02),)), False),
        (Union((Box((0.016,) * 3), Cut(Box((0.02,) * 3), ((1.0, 2.0, 3.0, 0.02),)))), False),
        (_OwnBox((0.016,) * 3), True),
    ],
)
def test_images_are_mirrored_only_where_every_shape_is_its_own_mirror_image(shape, is_mirrored):
    wanted = Symmetry.ROTATIONS_AND_MIRROR if is_mirrored else Symmetry.ROTATIONS
    assert replace(STILL, shapes={**SHAPES, "own": shape}).symmetry is wanted


@pytest.mark.parametrize("pose", [(1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (np.nan, 0.0, 0.0, 0.0)])
def test_a_pose_that_would_stretch_objects_is_refused(pose):
    with pytest.raises(InvalidArgument, match="the pose 'own' must be a unit quaternion"):
        replace(STILL, poses={"own": np.array(pose)})
    assert replace(STILL, poses={"own": np.array([0.707, 0.0, 0.0, 0.707])}).pose_labels == ("own",)


def test_an_object_keeps_its_friction_and_stiffness_through_the_episode(rng):
    scene = replace(STILL, variation=Variation(friction=Uniform(0.2, 1.0), stiffness=LogUniform(0.5, 2.0)))
    thing = scene.sample_object(0, rng)
    placements = [scene.place(thing, pose, rng) for pose in range(6)]
    assert {p.friction for p in placements} == {thing.friction}
    assert {p.stiffness for p in placements} == {thing.stiffness}
    assert thing.friction != scene.sample_object(0, rng).friction


def test_a_path_stands_for_the_mesh_in_the_file(tmp_path):
    path = tmp_path / "wedge.obj"
    path.write_text("v 0 0 0\nv .03 0 0\nv 0 .03 0\nv 0 0 .03\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    scene = replace(STILL, shapes={**SHAPES, "mine": path})
    assert scene.shape_labels == (*SHAPES, "mine")
    assert isinstance(scene.shapes["mine"], Mesh)
    with pytest.raises(FileNotFoundError):
        Scene(shapes={"mug": Path("no such file.stl")})
    path.write_text("v 0 0 0\nv .03 0 0\nv 0 .03 0\nf 1 3 2\n")
    with pytest.raises(BadMesh, match="it is flat"):
        Scene(shapes={"mine": path})


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        *[("press_model", Quasistatic), ("press_model", "dynamic")],
        *[("presentation", Upright), ("presentation", "upright"), ("pad", 8), ("variation", 1)],
    ],
)
def test_a_part_of_a_wrong_type_is_refused_when_the_scene_is_made(name, wrong):
    with pytest.raises(InvalidArgument, match=f"{name} must be"):
        Scene(**{name: wrong})


@pytest.mark.parametrize("given", [2.0, Uniform])
@pytest.mark.parametrize("name", ["size", "offset", "force", "friction", "stiffness"])
def test_a_variation_that_is_no_distribution_is_refused(name, given):
    with pytest.raises(InvalidArgument, match=f"{name} must be a distribution such as Uniform"):
        Variation(**{name: given})


@pytest.mark.parametrize(
    "wrong",
    [
        {"size": Constant(0.0)},
        {"offset": Uniform(-2.0, 2.0)},
        {"force": Uniform(1500.0, 3000.0)},
        {"force": Constant(-1.0)},
        {"friction": Constant(-1.0)},
        {"stiffness": Constant(0.0)},
    ],
)
def test_a_variation_that_makes_no_sense_is_refused(wrong):
    with pytest.raises(InvalidArgument, match=f"{next(iter(wrong))} must lie in "):
        Variation(**wrong)


@pytest.mark.parametrize("radius", [20.0, 1e-9, 1e9])
def test_a_solid_in_another_unit_is_refused_where_it_is_touched(radius, rng):
    scene = replace(STILL, shapes={"ball": Sphere(radius), "other": Sphere(0.02)})
    with pytest.raises(InvalidArgument, match=r"'ball': its farthest point is .* allowed are 0.0005 m to 0.3 m"):
        scene.sample_object("ball", rng)
    with pytest.raises(InvalidArgument, match="'ball': its farthest point is"):
        read_objects(scene.shapes)


@pytest.mark.parametrize("radius", [1e-300, 1e308])
def test_a_solid_of_lengths_without_arithmetic_is_refused(radius):
    with pytest.raises(ValueError, match=r"lengths above zero, in \[1e-9, 1e9\] m"):
        Sphere(radius)


def test_a_shape_without_triangles_is_refused_by_what_it_lacks():
    class Ball:
        bounding_radius, geom = 0.02, SHAPES["sphere"].geom

    with pytest.raises(BadMesh, match=r"'ball' is .*, without surface; a shape is"):
        Scene(shapes={"ball": Ball()})


def test_a_shape_without_a_hash_is_refused_at_once():
    class Ball:
        bounding_radius, geom = 0.02, SHAPES["sphere"].geom
        surface = SHAPES["sphere"].surface
        __hash__ = None

    with pytest.raises(BadMesh, match=r"'ball' has no hash.*make Ball a frozen dataclass"):
        Scene(shapes={"ball": Ball()})
    assert replace(STILL, shapes={"ball": Ball()}).shape_labels == ("ball",)  # no MuJoCo, no hash
