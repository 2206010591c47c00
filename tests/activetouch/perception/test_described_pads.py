"""Readers of described pads: what they learn is what the scene presses, and a sensor says which pads it may have."""

import json
from dataclasses import replace
from functools import partial
from unittest.mock import Mock

import numpy as np
import pytest

from activetouch import PadDescription, Response, TactileSensor, Taxels, predicted_contacts
from activetouch.distributions import Constant, Uniform
from activetouch.errors import WrongScene
from activetouch.perception import described_pads
from activetouch.perception.described_pads import (
    PADS,
    from_state,
    has_pad,
    is_known,
    limits_of,
    numbers_of,
    possible_pads,
    to_state,
)
from activetouch.perception.imaging import Imaging, SensorState, fields_read, imaging_of_pad, sensor_state, states_with
from activetouch.perception.reader import resized
from activetouch.scene_description import scene_fields
from activetouch.sensor.any_pad import reader_of_pad
from activetouch.shapes import SHAPES

PADS_BY_NAME = {
    "grid": PadDescription(Taxels.grid(6, 4, 0.004), is_relative=True),
    "outline": PadDescription(Taxels.grid(5, 5, 0.004, [".###.", *["#####"] * 4]), force=(2.0, 2.0), full_scale=5e4),
}


@pytest.fixture(params=PADS_BY_NAME)
def pad(request):
    return PADS_BY_NAME[request.param]


def test_the_imaging_of_a_pad_is_kept_in_a_file(pad):
    imaging = imaging_of_pad(pad)
    found = Imaging.from_fields(json.loads(json.dumps(imaging.fields())))
    assert found.fields() == imaging.fields()
    assert found.description.taxels.raster == pad.taxels.raster
    assert found.state_size == imaging.code(SensorState.nominal(2)).shape[1]
    reach, felt = found.face
    assert reach.shape == felt.shape == (imaging.wide_window.num_pixels,) * 2
    assert ((felt > 0.0) == np.isfinite(reach)).all()
    assert 0 < (felt > 0.0).sum() < felt.size
    assert found.layout.size == imaging.pixels**2 + len(numbers_of(pad))


def test_a_state_holds_the_numbers_of_a_response(pad):
    numbers = pad.response.drawn(9, np.random.default_rng(0))
    states = states_with(to_state(pad, numbers))
    back = from_state(pad, states)
    for name in ("law", "threshold", "crosstalk", "gain", "blur"):
        assert np.allclose(back[name], numbers[name], rtol=1e-5), name
    for name, (low, high) in limits_of(pad).items():
        values = getattr(states, name)
        assert (values >= low * 0.9999 - 1e-6).all(), name
        assert (values <= high * 1.0001 + 1e-6).all(), name


def test_a_scene_has_a_pad_of_a_description(pad):
    imaging = imaging_of_pad(pad)
    for share in (None, np.full(7, 0.1), np.ones(7)):
        scene = pad.scene(share=share)
        assert has_pad(pad, scene)
        own = scene_fields(pad.scene())
        assert fields_read(imaging, own, scene, scene_fields(scene)) == scene_fields(scene)
        numbers = from_state(pad, sensor_state(imaging, scene))
        assert np.isclose(numbers["law"][0], scene.faults[0].law)
    scene = pad.scene()
    harder = replace(scene.variation, stiffness=Constant(1e3))
    other_pad = PadDescription(Taxels.grid(3, 3, 0.004)).scene()
    for other in (replace(scene, variation=harder), replace(scene, faults=()), other_pad):
        assert not has_pad(pad, other)


def test_pads_that_a_description_allows(pad):
    labels, parts = possible_pads(pad)
    assert len(set(labels)) == len(parts["law"]) == PADS
    assert not is_known(pad)
    least = {name: ends[0] for name, ends in pad.response.ranges().items()}
    assert is_known(PadDescription(pad.taxels, Response.of(least)))


@pytest.mark.torch
def test_training_presses_as_the_scene_does():
    torch = pytest.importorskip("torch")
    from activetouch.perception.contacts.images import images

    pad = PADS_BY_NAME["outline"]
    quiet = replace(pad, response=replace(pad.response, noise=Constant(0.0)))
    imaging, rng = imaging_of_pad(quiet), np.random.default_rng(3)
    for share in rng.uniform(size=(4, 7)):
        scene = quiet.scene(share=share)
        state = sensor_state(imaging, scene)
        for label in SHAPES:
            scene = replace(scene, variation=replace(scene.variation, offset=Uniform(0.0, 0.0)))
            pressed = scene.press(scene.sample_object(label, rng), 0, rng)
            placed = pressed.placement
            maps = predicted_contacts(
                placed.shape, placed.orientation[None], (0.0, 0.0), imaging.window, placed.scale, np.float32
            )
            learnt, hit = images(imaging, torch.from_numpy(maps), state, np.zeros(1, int), torch.Generator())
            wanted = resized(pressed.image[None], learnt.shape[1:], is_any_size=True) / 255.0
            assert hit.all()
            assert np.abs(learnt[0].numpy() - wanted[0]).max() < 0.02, label


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::activetouch.errors.AlikeShapes")
@pytest.mark.torch
@pytest.mark.parametrize("is_whole", [False, pytest.param(True, marks=pytest.mark.nightly)])
def test_from_a_description_to_a_search(is_whole, few_hypotheses, tmp_path, monkeypatch):
    pytest.importorskip("torch")
    from activetouch.perception import contact_training
    from experiments.sensor.train import train_any_object

    recipe = contact_training.ContactRecipe  # in small: it does not count here how well the reader reads
    small = {"groups": 2, "touches": 6, "others": 4, "widths": (8, 8), "image_widths": (8, 8)}
    monkeypatch.setattr(recipe, "of", partial(recipe.of, **small))
    monkeypatch.setattr(contact_training, "CHECKS", 1)
    pad = PadDescription(Taxels.grid(4, 4, 0.005))
    with monkeypatch.context() as patched:
        patched.setattr(
            "activetouch.perception.contact_training.export", Mock(side_effect=KeyboardInterrupt)
        )  # which takes longest
        with pytest.raises(KeyboardInterrupt):
            train_any_object(pad.scene(), tmp_path, steps=2, pad=pad, any_pad=True)
    assert list(tmp_path.iterdir())
    if not is_whole:
        return
    train_any_object(pad.scene(), tmp_path, steps=3, pad=pad, any_pad=True)  # resumes
    scene = pad.scene(share=np.full(7, 0.2))
    few_bodies = replace(
        scene,
        shapes={name: SHAPES[name] for name in ("sphere", "cube")},
        poses={"front": scene.rotations["front"]},
    )
    sensor = TactileSensor.load(tmp_path, few_bodies)
    assert len(sensor.model.nominal.world_labels) == described_pads.PADS
    episode = sensor.search(sensor.shape_labels[0], seed=1, num_objects=2)
    assert episode.steps
    with pytest.raises(WrongScene):
        TactileSensor.load(tmp_path, PadDescription(Taxels.grid(5, 4, 0.005)).scene())


@pytest.mark.torch
def test_training_with_random_pads_goes_on_from_the_shipped_reader(tmp_path, monkeypatch):
    pytest.importorskip("torch")
    from activetouch.perception import contact_training
    from experiments.sensor.train import Train

    recipe, export = contact_training.ContactRecipe, Mock(side_effect=KeyboardInterrupt)  # which takes longest
    monkeypatch.setattr(recipe, "of", partial(recipe.of, groups=2, touches=6, others=4))
    monkeypatch.setattr(contact_training, "CHECKS", 1)
    monkeypatch.setattr(contact_training, "export", export)
    with pytest.raises(KeyboardInterrupt):
        Train(recipe="pads", weights="any_pad", steps=1, out=tmp_path, jobs=1).run()
    (network, _, _, words), start = export.call_args.args, reader_of_pad(described_pads.EXAMPLE)
    assert words == f"{start.card.training}, then 1 steps of 12"
    before, after = contact_training.weights_of(start), network.state_dict()
    apart = [float((after[name] - before[name]).abs().max()) for name in before]
    assert 0.0 < max(apart) < 0.01  # a step of a warm-up
