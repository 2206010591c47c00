"""A reader that knows the sensor: random bodies, their simulated touches, a training that goes on where it stopped."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from activetouch import SCENES, SHAPES, predicted_contacts
from activetouch.errors import ImpossibleRecipe
from activetouch.perception.contacts.bodies import _FAMILIES, random_body
from activetouch.perception.imaging import STATE_SIZE, Imaging, SensorState, encoded
from activetouch.poses import Placement, random_orientation, to_matrices
from activetouch.pressing.contact import Quasistatic
from activetouch.solids.raster import heights

GEL = SCENES["gel"].scene
WIDTHS = (4, 4, 4, 4, 4)
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


def seen(imaging, maps, world):
    """Images of height maps in one world."""
    import torch

    from activetouch.perception.contacts.images import images

    random = torch.Generator().manual_seed(0)
    read, hit = images(imaging, torch.from_numpy(maps), world, np.zeros(len(maps), int), random)
    return read.numpy(), hit.numpy()


@pytest.mark.torch
@pytest.mark.parametrize("shape", ["sphere", "cube", "cone"])
def test_an_image_in_the_nominal_world_is_that_of_the_scene(shape, rng):
    placement = Placement(SHAPES[shape], 1.1, random_orientation(rng), np.array([0.001, -0.0015]))
    wanted = GEL.image(Quasistatic().press(GEL.pad, placement, 2.0)).reshape(32, 4, 32, 4).mean(axis=(1, 3))
    maps = predicted_contacts(
        placement.shape, placement.orientation[None], placement.offset, IMAGING.window, placement.scale, np.float32
    )
    found, hit = seen(replace(IMAGING, force=(2.0, 2.0)), maps, SensorState.nominal(1))
    assert hit.all()
    assert np.abs(found[0] - wanted).max() < 0.01


@pytest.mark.torch
def test_worlds_change_the_image_as_they_say():
    maps = predicted_contacts(SHAPES["sphere"], np.eye(4)[:1], (0.0, 0.0), IMAGING.window, dtype=np.float32)

    def changed(**changes):
        world = SensorState.nominal(1)._replace(**{n: np.asarray(v, np.float32) for n, v in changes.items()})
        return seen(IMAGING, maps, world)[0][0], world.code()[0]

    usual, code = changed()
    assert code.shape == (STATE_SIZE,)
    assert not code.any()
    assert changed(force=[0.5])[0].sum() < 0.7 * usual.sum()
    assert np.allclose(np.roll(usual, 3, axis=0), changed(shift=[[3 / 32, 0.0]])[0], atol=0.01)
    corner = np.zeros((1, 4, 4))
    corner[0, 0, 0] = 1.0
    assert (changed(stuck=corner)[0][:8, :8] == 1.0).all()
    assert not changed(dead=corner)[0][:8, :8].any()
    blurred = changed(blur=[0.05])[0]
    assert np.abs(blurred - gaussian_filter(usual, 0.05 * 32, mode="constant")).max() < 0.02
    assert blurred.max() < usual.max()


def greatest_anywhere(planes, starts, edge):
    """What the kernel of a graphics processor computes, in plain torch."""
    import torch

    along = torch.arange(edge, dtype=torch.float32)
    row, column = along[:, None], along[None]
    maps = torch.full((len(starts) - 1, edge, edge), -torch.inf)
    for number, (first, last) in enumerate(zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True)):
        part = planes[first:last, :, None, None].unbind(1)
        inside = torch.ones(last - first, edge, edge, dtype=torch.bool)
        for a, b, c in (part[:3], part[3:6], part[6:9]):
            inside &= a * row + b * column + c >= -1e-4
        height = torch.minimum(torch.maximum(part[9] * row + part[10] * column + part[11], part[12]), part[13])
        maps[number] = torch.where(inside, height, -torch.inf).amax(dim=0)
    return maps


@pytest.mark.torch
def test_height_maps_and_contacts_are_the_same_where_a_network_is_trained(rng, monkeypatch):
    import torch

    from activetouch.perception.contacts import images
    from activetouch.perception.contacts.device_heights import DeviceBodies

    monkeypatch.setattr("activetouch.perception.contacts.device_heights.greatest", greatest_anywhere)
    surfaces = [random_body(number) for number in (3, 7, 8)]
    bodies, turns = np.array([2, 0, 2, 1]), to_matrices(np.stack([random_orientation(rng) for _ in range(4)]))
    places = rng.uniform(-0.002, 0.002, (4, 2))
    found = DeviceBodies(surfaces, "cpu").heights(bodies, turns * 1.1, places, 0.001, 20).numpy()
    each = zip(bodies, turns, places, strict=True)
    wanted = np.concatenate([heights(surfaces[b], t[None] * 1.1, p[None], 0.001, 20, np.float32) for b, t, p in each])
    assert (np.isfinite(found) == np.isfinite(wanted)).mean() > 0.999
    both = np.isfinite(found) & np.isfinite(wanted)
    assert np.abs(found[both] - wanted[both]).max() < 2e-5
    wanted[0] = -np.inf
    assert np.allclose(images.encoded(torch.from_numpy(wanted), 16).numpy(), encoded(wanted, 16), atol=1e-6)


@pytest.mark.torch
def test_late_batches_have_more_hypotheses_and_the_usual_sensor():
    from activetouch.perception.contacts.touches import Batches

    batches = Batches(replace(IMAGING, samples=32), range(6), groups=2, touches=4, worlds=4, late=1, others=5)
    early, late, again = batches[0], batches[1], batches[1]
    assert len(early.images) == len(early.contacts) == len(late.images) == 8
    assert len(late.contacts) == len(late.cells) == 8 + 2 * 5
    assert not late.codes[:2].any()
    assert early.codes[1:].any()
    assert late.layout is again.layout is None
    for one, other in zip(late[:-1], again[:-1], strict=True):
        assert one.equal(other)


@pytest.mark.torch
def test_a_training_goes_on_where_it_stopped(tmp_path, monkeypatch):
    from activetouch.perception import contact_training as training

    monkeypatch.setattr(training, "HELD_OUT", 4)
    monkeypatch.setattr(training, "CHECKS", 1)
    monkeypatch.setattr(training.ContactRecipe, "rate", lambda self, step: 1e-3)
    batch = {"groups": 2, "touches": 4, "worlds": 2, "others": 3}
    recipe = training.ContactRecipe(2, 6, WIDTHS, WIDTHS, dense=8, embedding=4, bf16=False, **batch)
    imaging = replace(IMAGING, samples=32)

    def trained(recipe, folder):
        trainer = training.ContactTrainer(imaging, recipe, folder, workers=0)
        list(trainer.run())
        return trainer.network.state_dict()

    trained(replace(recipe, steps=1), tmp_path / "two")
    resumed, once = trained(recipe, tmp_path / "two"), trained(recipe, tmp_path / "one")
    assert len((tmp_path / "two" / "log.jsonl").read_text().splitlines()) == 2
    with pytest.raises(ImpossibleRecipe, match=r"dense 8 \(not 16\)"):
        trained(replace(recipe, dense=16), tmp_path / "one")
    for name, part in once.items():
        np.testing.assert_allclose(resumed[name].numpy(), part.numpy(), atol=1e-6)
