"""The lower bound by congruent contacts: cases that are known by hand, images that are the same, and the command."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from activetouch.data.dataset import CollectionPlan, TouchSet
from activetouch.distributions import Constant, LogUniform, Uniform
from activetouch.named_scenes import SCENES
from activetouch.orientations import Upright
from activetouch.placement import Placement
from activetouch.poses import random_orientation, to_matrix
from activetouch.pressing.contact import elastic_contact, surface_gap
from activetouch.pressing.pad import Pad
from activetouch.pressing.press import Quasistatic
from activetouch.scene import Variation
from activetouch.shapes import EXTENDED_SHAPES, Box, Cylinder, Family, Sphere
from benchmarks.bayes_error.congruent import CongruentContacts, Faces, alignments, see, two_directions
from benchmarks.bayes_error.congruent_bound import CongruentBound, _logs_of_interest
from benchmarks.bayes_error.noise import UnknownLikelihood
from benchmarks.limit import Limit
from experiments.scene_choice import SceneChoice
from experiments.sensor.collect import record

SCENE = replace(SCENES["hard"].scene, press_model=Quasistatic(), pad=Pad(half_width=0.0075, num_taxels=48))
CUBE, CUBOID = EXTENDED_SHAPES["cube"], EXTENDED_SHAPES["cuboid"]


def losses_of(scene, shape, seed, touches=4):
    rng = np.random.default_rng(seed)
    thing = scene.sample_object(shape, rng)
    poses = rng.permutation(len(scene.poses))[:touches]
    offsets = np.array([scene.variation.sample_offset(rng) for _ in poses])
    forces = rng.uniform(1.5, 3.0, touches)
    return losses(CongruentContacts(scene), thing.shape_index, thing.orientation, thing.scale, poses, offsets, forces)


def losses(contacts, shape, *touched):
    logs = contacts.log_posteriors(shape, *touched)
    np.testing.assert_allclose(np.exp(logs).sum(axis=1), 1.0)
    return -logs[:, list(contacts.shapes).index(shape)]


def test_equal_shapes_are_never_told_apart():
    scene = replace(SCENE, shapes={"one": CUBE, "other": Box(CUBE.half_extents)})
    for seed in range(3):
        np.testing.assert_allclose(losses_of(scene, "one", seed), np.log(2.0), rtol=1e-9)


def test_a_flat_face_tells_nothing_and_an_edge_only_which_two_sides_meet():
    """An edge above the middle: the two sides of a cuboid are alike in 8 of 24 rotations, those of a cube in all."""
    cuboid = {"cube": CUBE, "cuboid": CUBOID}
    contacts = CongruentContacts(replace(SCENE, shapes=cuboid, pad=Pad(half_width=0.001, num_taxels=8)))
    lying = np.array([1.0, 0.0, 0.0, 0.0])
    loss = losses(contacts, 0, lying, 1.0, np.array([0, 1]), np.zeros((2, 2)), np.array([2.0, 2.0]))
    np.testing.assert_allclose(loss, [np.log(2.0), np.log(4.0 / 3.0)], rtol=1e-9)


def test_touches_tell_a_wedge_from_a_cube():
    scene = replace(SCENE, shapes={"cube": CUBE, "wedge": EXTENDED_SHAPES["wedge"]})
    mean = np.mean([losses_of(scene, "wedge", seed, touches=3) for seed in range(12)], axis=0)
    assert mean[-1] < 0.2 < mean[0]


def corner_of(box):
    """A press on the corner (+, +, +) of a box with its diagonal along the approach axis, and the corner's place."""
    towards = np.array([-1.0, -1.0, -1.0]) / np.sqrt(3.0)
    axis = np.cross(towards, [1.0, 0.0, 0.0])
    axis /= np.linalg.norm(axis)
    angle = np.arccos(towards[0])
    turn = np.array([np.cos(angle / 2), *np.sin(angle / 2) * axis])
    return turn, to_matrix(turn) @ np.array(box.half_extents)


def test_a_corner_is_congruent_to_that_of_another_box_at_another_offset():
    turn, at_cube = corner_of(CUBE)
    _, at_cuboid = corner_of(CUBOID)
    pad, offset = SCENE.pad, np.array([0.001, -0.0005])
    moved = offset + (at_cube - at_cuboid)[1:]
    images = [
        elastic_contact(pad, surface_gap(pad, Placement(box, 1.0, turn, where)), 2.0).indentation
        for box, where in ((CUBE, offset), (CUBOID, moved))
    ]
    np.testing.assert_allclose(*images, atol=1e-12)
    seen = see(pad, Faces(CUBE.planes[0] @ to_matrix(turn).T, CUBE.planes[1]), offset, 2.0)
    assert len(seen.faces.distances) == 3
    body = Faces(CUBOID.planes[0] @ to_matrix(turn).T, CUBOID.planes[1])
    half = float(np.abs(moved).max())
    for limit, expected in ((half * 1.01, 1.0), (half * 0.99, 0.0)):
        scene = replace(SCENE, variation=replace(SCENE.variation, offset=Uniform(-limit, limit)))
        assert CongruentContacts(scene)._measure(body, np.array([1.0]), seen) == expected


def test_an_edge_leaves_a_line_of_offsets_and_a_face_an_area():
    """Of a cube that is larger than its true size, the offsets that give the same image of an edge are as long."""
    contacts, half = CongruentContacts(SCENE), np.deg2rad(45.0) / 2
    faces = Faces(CUBE.planes[0] @ to_matrix(np.array([np.cos(half), 0.0, 0.0, np.sin(half)])).T, CUBE.planes[1])
    seen = see(SCENE.pad, faces, np.zeros(2), 2.0)
    assert len(seen.faces.distances) == 2
    np.testing.assert_allclose(contacts._measure(faces, np.array([1.0, 1.05]), seen), 0.004, rtol=1e-6)
    flat = see(SCENE.pad, Faces(*CUBE.planes), np.zeros(2), 2.0)
    assert len(flat.faces.distances) == 1
    np.testing.assert_allclose(contacts._measure(Faces(*CUBE.planes), np.array([1.0, 1.2]), flat), 1.0)


@pytest.mark.parametrize(
    ("axis", "half_angle", "across"),
    [((0.0, 0.0, 1.0), 0.05, 0.0095), ((0.0, 0.6, 0.8), 0.05, 0.0095), ((0.0, 0.0, 1.0), 0.35, 0.013)],
)
def test_the_offsets_at_which_one_face_of_a_smaller_box_looks_the_same_are_those_of_equal_images(
    axis, half_angle, across, rng
):
    turn = np.array([np.cos(half_angle), *np.sin(half_angle) * np.array(axis)])
    wide, narrow, offset = Box((0.004, 0.03, 0.03)), Box((0.004, across, 0.0105)), np.array([0.001, -0.0005])
    placed = Faces(wide.planes[0] @ to_matrix(turn).T, wide.planes[1])
    seen = see(SCENE.pad, placed, offset, 2.0)
    assert len(seen.faces.distances) == 1
    sizes = np.array([0.8, 0.9, 1.0, 1.2])
    body = Faces(narrow.planes[0] @ to_matrix(turn).T, narrow.planes[1])
    found = CongruentContacts(SCENE)._measure(body, sizes, seen)

    def image(box, size, where):
        gap = surface_gap(SCENE.pad, Placement(box, size, turn, where))
        return elastic_contact(SCENE.pad, gap, 2.0).indentation

    felt, tried = image(wide, 1.0, offset), rng.uniform(-0.002, 0.002, (1600, 2))
    same = [[np.abs(image(narrow, size, where) - felt).max() < 1e-9 for where in tried] for size in sizes.tolist()]
    # 1 600 draws: four standard errors are 0.05. The measure is of a grid of offsets, which adds less than that.
    np.testing.assert_allclose(found, np.mean(same, axis=1), atol=0.1)
    assert len(set(found.tolist())) > 2


def test_what_is_seen_does_not_depend_on_faces_without_an_effect():
    rng = np.random.default_rng(3)
    for _ in range(10):
        turned = CUBOID.planes[0] @ to_matrix(random_orientation(rng)).T
        faces, offset = Faces(turned, CUBOID.planes[1]), rng.uniform(-0.002, 0.002, 2)
        seen = see(SCENE.pad, faces, offset, 2.0)
        matters = (turned @ seen.faces.normals.T > 1.0 - 1e-9).any(axis=1)
        again = see(SCENE.pad, faces.select(matters), offset, 2.0)
        np.testing.assert_allclose(again.surface, seen.surface, atol=1e-12)


def test_a_miss_tells_nothing():
    far = replace(SCENE, shapes={"cube": CUBE, "cuboid": CUBOID})
    beside = np.full((2, 2), 0.5)
    loss = losses(CongruentContacts(far), 0, np.array([1.0, 0, 0, 0]), 1.0, np.arange(2), beside, np.full(2, 2.0))
    np.testing.assert_allclose(loss, np.log(2.0))


@pytest.mark.parametrize(
    "scene",
    [
        replace(SCENE, shapes={"ball": Sphere(0.02), "cube": CUBE}),
        replace(SCENE, presentation=Upright()),
        replace(SCENE, variation=Variation(size=LogUniform(0.9, 1.1))),
        replace(SCENE, variation=Variation(size=Constant(1.0))),
        replace(SCENE, variation=Variation(stiffness=Uniform(0.9, 1.1))),
        replace(SCENE, shapes={**SCENE.shapes, "rod": Family(Cylinder(0.01, 0.03), half_length=Uniform(0.01, 0.04))}),
    ],
    ids=["round", "upright", "other sizes", "one size", "skins", "families"],
)
def test_scenes_of_another_kind_are_refused(scene):
    with pytest.raises(UnknownLikelihood, match="this bound"):
        CongruentContacts(scene)


def test_the_command_compares_the_sensor_with_the_bound(tmp_path, capsys):
    data = tmp_path / "touches"
    choice = SceneChoice("hard", fidelity="quasistatic")
    record(choice.named.scene, CollectionPlan(train=0, calibration=1, test=1, repeats=1), data, 1, choice.to_dict())
    Limit(choice, touches_per_object=(2, 1), data=data, congruent=CongruentBound(1), out=tmp_path, jobs=1).run()
    found = json.loads((tmp_path / "limit.json").read_text())
    assert found["objects"] == 12
    assert found["touches"] == [1, 2]
    assert found["flat_faced"] == ["cube", "cuboid", "wedge", "hexagonal_prism"]
    assert all(entry["value"] >= 0.0 for entry in found["bound"])
    of_one, of_two = ([found[name][n]["value"] for name in ("independent", "bound")] for n in (0, 1))
    assert of_one[0] == pytest.approx(of_one[1])
    assert of_two[0] > of_two[1]
    assert set(found["by_shape"]) == set(found["flat_faced"])
    for name in ("bound", "sensor"):
        assert all(len(entry[name]) == 2 for entry in found["by_shape"].values())
    # There is one object of each of 12 shapes, and the bound of those that are not flat-faced is 0.
    by_shape = np.array([entry["bound"] for entry in found["by_shape"].values()])
    np.testing.assert_allclose(by_shape.sum(axis=0) / 12, [entry["value"] for entry in found["bound"]])
    assert all(0.5 < entry["value"] <= 1.0 for entry in found["accuracy_bound"])
    assert "no reader below" in capsys.readouterr().out


def test_each_touch_has_the_offset_and_the_force_of_its_object_and_pose():
    """Offsets name object and pose, and the posterior is the share of each in their sum."""
    objects, poses = np.repeat(np.arange(3), 4), np.tile(np.arange(4), 3)
    named = np.stack([objects, poses], axis=1).astype(float)
    test = TouchSet(
        *(np.zeros((12, 1, 1), np.uint8), np.array([2, 5, 2])[objects], objects, poses, objects + poses / 10, objects),
        rests=np.eye(4)[objects], sizes=1.0 + objects, offsets=named,
    )  # fmt: skip

    class Named:
        scene, shapes = SimpleNamespace(poses=range(4)), {5: None, 2: None}

        def log_posteriors(self, shape, rest, size, order, offsets, forces):
            number = offsets[0, 0]
            assert (shape, size, rest[int(number)]) == ((2, 5, 2)[int(number)], 1.0 + number, 1.0)
            np.testing.assert_array_equal(offsets, [[number, pose] for pose in order])
            np.testing.assert_allclose(forces, number + order / 10)
            return np.log([[0.3, 0.7]] * len(order))

    orders = np.array([[[3, 0], [1, 3]], [[1, 2], [2, 0]], [[2, 3], [0, 1]]])
    some, found = _logs_of_interest(Named(), test, np.array([2, 0, 1]), orders, range(4, 7))
    assert some == range(4, 7)
    true = [0.7, 0.7, 0.3]  # of objects 2, 0 and 1, in the order of the shapes
    product = [p**2 / (0.3**2 + 0.7**2) for p in true]
    wanted = [[[p, 0.7, p], [p, 0.7, both]] for p, both in zip(true, product, strict=True)]
    np.testing.assert_allclose(np.exp(found), np.stack([wanted, wanted], axis=1))


def test_two_directions_of_faces_leave_the_rotations_of_a_body():
    for label, number in (("cube", 24), ("cuboid", 24), ("hexagonal_prism", 24), ("wedge", 14)):
        normals = EXTENDED_SHAPES[label].planes[0]
        square = normals[np.abs(normals @ normals[0]) < 1e-9][0]
        found = alignments(np.stack([normals[0], square]), normals)
        assert len(found) == number, label
        np.testing.assert_allclose(np.linalg.det(found), 1.0)
        for rotation in found:
            turned = normals @ rotation.T
            np.testing.assert_allclose([(turned @ each).max() for each in (normals[0], square)], 1.0)


def test_directions_are_two_only_if_they_are_not_parallel():
    one = np.array([[0.0, 0.6, 0.8]])
    assert two_directions(np.vstack([one, -one, one])) is None
    assert two_directions(np.empty((0, 3))) is None
    pair = two_directions(np.vstack([one, -one, [[1.0, 0.0, 0.0]]]))
    np.testing.assert_array_equal(pair, np.vstack([one, [[1.0, 0.0, 0.0]]]))


def test_the_posterior_is_as_sharp_as_it_is_right():
    """Under Bayes' rule, the mean probability of the true shape is that of a shape drawn from the posterior."""
    shapes = {"cube": CUBE, "wedge": EXTENDED_SHAPES["wedge"]}
    scene = replace(SCENE, shapes=shapes, pad=Pad(half_width=0.0075, num_taxels=16))
    contacts, rng, gaps = CongruentContacts(scene), np.random.default_rng(0), []
    for number in range(14):
        column = number % len(contacts.shapes)
        thing = scene.sample_object(list(contacts.shapes)[column], rng)
        poses, offsets = rng.permutation(6)[:2], np.array([scene.variation.sample_offset(rng) for _ in range(2)])
        touched = (thing.orientation, thing.scale, poses, offsets, rng.uniform(1.5, 3.0, 2))
        probs = np.exp(contacts.log_posteriors(thing.shape_index, *touched))
        gaps.append(probs[:, column] - (probs**2).sum(axis=1))
    error = np.std(gaps, axis=0) / np.sqrt(len(gaps))
    assert (np.abs(np.mean(gaps, axis=0)) < 3 * error).all()
