"""A reader that knows the sensor: random bodies, their simulated touches, a training that goes on where it stopped."""

from dataclasses import replace

import numpy as np
import pytest

from activetouch import SCENES, SHAPES, predicted_contacts
from activetouch.perception.contacts.bodies import _FAMILIES, random_body
from activetouch.perception.contacts.imaging import STATE_SIZE, Imaging, SensorState
from activetouch.placement import Placement
from activetouch.poses import random_orientation, to_matrices
from activetouch.pressing.press import Quasistatic
from activetouch.solids.raster import heights

GEL = SCENES["gel"].scene
IMAGING = Imaging(GEL.pad, taxels=128, pixels=32, samples=128, gain=0.0, noise=1e-4)


@pytest.mark.parametrize("family", _FAMILIES, ids=lambda family: family.__name__)
def test_a_part_is_closed_and_faces_outwards(family):
    for seed in range(3):
        vertices, faces = family(np.random.default_rng(seed))
        faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
        edges = {(a, b) for face in faces.tolist() for a, b in zip(face, np.roll(face, -1).tolist(), strict=True)}
        assert all((b, a) in edges for a, b in edges)
        a, b, c = vertices[faces].transpose(1, 0, 2)
        assert np.einsum("fi,fi->", a, np.cross(b, c)) > 0


def test_a_body_follows_from_its_number_and_its_middle_is_near_the_origin():
    one, again, other = random_body(3), random_body(3), random_body(4)
    assert np.array_equal(one.vertices, again.vertices)
    assert one.vertices.shape != other.vertices.shape or not np.allclose(one.vertices, other.vertices)
    turns = to_matrices(np.eye(4))
    maps = heights(one, turns, np.zeros((4, 2)), 0.001, 9)
    assert np.isfinite(maps[:, 4, 4]).any()


@pytest.mark.parametrize("shape", ["sphere", "cube", "cone"])
def test_an_image_in_the_nominal_world_is_that_of_the_scene(shape, rng):
    placement = Placement(SHAPES[shape], 1.1, random_orientation(rng), np.array([0.001, -0.0015]))
    wanted = GEL.image(Quasistatic().press(GEL.setup, placement, 2.0)).reshape(32, 4, 32, 4).mean(axis=(1, 3))
    maps = predicted_contacts(
        placement.shape, placement.orientation[None], placement.offset, IMAGING.window, placement.scale, np.float32
    )
    imaging = replace(IMAGING, force=(2.0, 2.0))
    found, hit = imaging.images(maps, SensorState.nominal(1), np.random.default_rng(0))
    assert hit.all()
    assert np.abs(found[0] - wanted).max() < 0.01


def test_worlds_change_the_image_as_they_say():
    maps = predicted_contacts(SHAPES["sphere"], np.eye(4)[:1], (0.0, 0.0), IMAGING.window, dtype=np.float32)

    def seen(**changes):
        world = SensorState.nominal(1)._replace(**{n: np.asarray(v, np.float32) for n, v in changes.items()})
        return IMAGING.images(maps, world, np.random.default_rng(0))[0][0], world.code()[0]

    usual, code = seen()
    assert code.shape == (STATE_SIZE,)
    assert not code.any()
    assert seen(force=[0.5])[0].sum() < 0.7 * usual.sum()
    assert np.allclose(np.roll(usual, 3, axis=0), seen(shift=[[3 / 32, 0.0]])[0], atol=0.01)
    corner = np.zeros((1, 4, 4))
    corner[0, 0, 0] = 1.0
    assert (seen(stuck=corner)[0][:8, :8] == 1.0).all()
    assert not seen(dead=corner)[0][:8, :8].any()
    assert seen(blur=[0.05])[0].max() < usual.max()


@pytest.mark.torch
def test_a_training_goes_on_where_it_stopped(tmp_path, monkeypatch):
    from activetouch.perception import contact_training as training

    monkeypatch.setattr(training, "HELD_OUT", 4)
    monkeypatch.setattr(training, "CHECKS", 1)
    monkeypatch.setattr(training.ContactRecipe, "rate", lambda self, step: 1e-3)
    recipe = training.ContactRecipe(
        2, bodies=6, widths=(4, 4, 4, 4, 4), dense=8, embedding=4, groups=2, touches=4, worlds=2, bf16=False
    )
    imaging = replace(IMAGING, samples=32)

    def trained(recipe, folder):
        trainer = training.ContactTrainer(imaging, recipe, folder, workers=0)
        list(trainer.run())
        return trainer.network.state_dict()

    trained(replace(recipe, steps=1), tmp_path / "two")
    resumed, once = trained(recipe, tmp_path / "two"), trained(recipe, tmp_path / "one")
    assert len((tmp_path / "two" / "log.jsonl").read_text().splitlines()) == 2
    for name, part in once.items():
        np.testing.assert_allclose(resumed[name].numpy(), part.numpy(), atol=1e-6)
