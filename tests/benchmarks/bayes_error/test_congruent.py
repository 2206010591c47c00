"""The lower bound by congruent contacts: cases that are known by hand, images that are the same, and the command."""

import json
from dataclasses import replace

import numpy as np
import pytest

from activetouch.data.manifest import CollectionPlan
from activetouch.distributions import Uniform
from activetouch.named_scenes import SCENES
from activetouch.placement import Placement
from activetouch.poses import to_matrix
from activetouch.pressing.contact import elastic_contact, surface_gap
from activetouch.pressing.pad import Pad
from activetouch.pressing.press import Quasistatic
from activetouch.shapes import EXTENDED_SHAPES
from benchmarks.bayes_error.congruent import CongruentContacts, Faces, see
from benchmarks.bayes_error.congruent_bound import CongruentBound
from benchmarks.limit import Limit
from experiments.scene_choice import SceneChoice
from experiments.sensor.collect import record

SCENE = replace(SCENES["hard"].scene, press_model=Quasistatic(), pad=Pad(half_width=0.0075, num_taxels=48))
CUBE, CUBOID = EXTENDED_SHAPES["cube"], EXTENDED_SHAPES["cuboid"]


def losses(contacts, shape, *touched):
    logs = contacts.log_posteriors(shape, *touched)
    np.testing.assert_allclose(np.exp(logs).sum(axis=1), 1.0)
    return -logs[:, list(contacts.shapes).index(shape)]


def test_a_flat_face_tells_nothing_and_an_edge_only_which_two_sides_meet():
    """An edge above the middle: the two sides of a cuboid are alike in 8 of 24 rotations, those of a cube in all."""
    cuboid = {"cube": CUBE, "cuboid": CUBOID}
    contacts = CongruentContacts(replace(SCENE, shapes=cuboid, pad=Pad(half_width=0.001, num_taxels=8)))
    lying = np.array([1.0, 0.0, 0.0, 0.0])
    loss = losses(contacts, 0, lying, 1.0, np.array([0, 1]), np.zeros((2, 2)), np.array([2.0, 2.0]))
    np.testing.assert_allclose(loss, [np.log(2.0), np.log(4.0 / 3.0)], rtol=1e-9)


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
