"""The reader of any pad: what it learns from, and sensors that are made of it without training."""

from dataclasses import replace

import numpy as np
import pytest

from activetouch import PadDescription, Response, TactileSensor, Taxels, TouchWorld, read_pad
from activetouch.errors import SceneShift
from activetouch.perception.described_pads import EXAMPLE, RANGES, responses_beyond
from activetouch.perception.imaging import SAMPLES, SensorState, imaging_of_pad
from activetouch.perception.reader import TactileReader, resized
from activetouch.sensor.any_pad import READER, reader_of_pad, sensor_of_pad
from activetouch.sensor_files import ANY_OBJECT_FILE, PAD_FILE
from belief import Probe
from belief.naming import UNLISTED

SMALL = PadDescription(Taxels.grid(4, 4, 0.005), is_relative=True)
LONG = PadDescription(Taxels.grid(12, 3, 0.002), is_relative=True)


@pytest.mark.torch
@pytest.mark.parametrize("seed", range(12))
def test_any_random_pad_is_told_in_as_many_numbers(seed):
    pytest.importorskip("torch")
    from activetouch.perception.contacts.random_pads import random_pad

    pad = random_pad(np.random.default_rng(seed))
    imaging, example = imaging_of_pad(pad), imaging_of_pad(EXAMPLE)
    assert imaging.layout.shape == example.layout.shape
    assert imaging.face.shape == example.face.shape
    assert imaging.state_size == example.state_size
    assert imaging.code(SensorState.nominal(3)).shape == (3, example.state_size)
    assert np.isfinite(imaging.layout).all()
    assert responses_beyond(pad) == ""


@pytest.mark.torch
def test_a_batch_follows_from_its_number_and_shows_another_pad_than_the_next():
    pytest.importorskip("torch")
    from activetouch.perception.contacts.touches import Batches

    batches = Batches(None, range(20), groups=2, touches=3, worlds=2)
    first, again, other = batches[4], batches[4], batches[5]
    assert first.images.shape == (6, SAMPLES, SAMPLES)
    assert (first.images == again.images).all()
    assert not (first.layout == other.layout).all()


def test_a_reader_is_told_about_a_pad():
    image = np.zeros((1, SAMPLES, SAMPLES), np.uint8)
    image[0, 12:20, 12:20] = 255
    small, wide = (reader_of_pad(pad) for pad in (SMALL, LONG))
    assert small.network == wide.network == TactileReader.load(READER).network
    assert small.digest != wide.digest
    assert small.hypotheses.digest != wide.hypotheses.digest
    assert not np.allclose(small.run(image)[0], wide.run(image)[0])


def test_images_of_any_raster_are_read():
    reader = reader_of_pad(SMALL)
    pixels = SMALL.taxels.raster
    readings = np.random.default_rng(0).uniform(size=(3, 16))
    image = SMALL.image(readings)
    assert image.shape == (3, pixels, pixels)
    assert pixels != SAMPLES
    larger = image.repeat(SAMPLES, axis=1).repeat(SAMPLES, axis=2)
    blocks = larger.reshape(3, SAMPLES, pixels, SAMPLES, pixels).mean(axis=(2, 4)).round().astype(np.uint8)
    assert np.allclose(reader.run(image)[0], reader.run(blocks)[0], atol=0.02)


def test_responses_beyond_the_training_are_named():
    strange = PadDescription(Taxels.grid(4, 4, 0.005), Response.of({"stiffness": [1e6, 1e7], "law": [0.3, 1.0]}))
    with pytest.warns(SceneShift, match=r"stiffness 1e\+06 to 1e\+07 \(trained: 4e\+06 to 3e\+09\), law 0\.3 to 1"):
        reader_of_pad(strange)
    loud = PadDescription(Taxels.grid(4, 4, 0.005), Response.of({"gain": [1.0, 50.0]}), is_relative=True)
    assert responses_beyond(loud) == ""  # readings are parts of the largest
    assert responses_beyond(PadDescription(Taxels.grid(2, 2, 0.005), RANGES)) == ""


def test_a_sensor_of_a_pad_is_made_once(tmp_path, monkeypatch):
    monkeypatch.setenv("ACTIVETOUCH_CACHE", str(tmp_path / "cache"))
    SMALL.save(tmp_path / "mine.toml")
    folder = sensor_of_pad(tmp_path / "mine.toml")
    made = (folder / ANY_OBJECT_FILE).stat().st_mtime_ns
    assert sensor_of_pad(SMALL) == folder
    assert (folder / ANY_OBJECT_FILE).stat().st_mtime_ns == made
    assert sensor_of_pad(LONG) != folder
    fitted = replace(SMALL, response=Response.of({"law": [0.9, 1.1]}))
    assert read_pad(sensor_of_pad(fitted) / PAD_FILE).response.ranges()["law"] == (0.9, 1.1)
    assert TactileReader.load(folder / ANY_OBJECT_FILE).digest == reader_of_pad(SMALL).digest


@pytest.mark.filterwarnings("error")
def test_a_sensor_of_a_pad_tells_solids_apart(few_hypotheses):
    """Of 40 solids that are touched twice, guessing names 20: at least 28 with probability 0.008 by chance."""
    scene = SMALL.scene()
    scene = replace(scene, shapes={name: scene.solids[name] for name in ("sphere", "cube")})
    sensor = TactileSensor.load(sensor_of_pad(SMALL), scene)
    rng, right = np.random.default_rng(0), 0
    for number in range(40):
        body = scene.sample_object(number % 2, rng)
        evidence = sensor.model.start()
        for touch in sensor.read(np.stack([scene.press(body, pose, rng).image for pose in (0, 1)]), [0, 1]):
            evidence = evidence.update(touch)
        right += evidence.log_likelihood.argmax() == number % 2
    assert right >= 28


def ends(sensor, images_of, seed):
    """How a search ends whose touches a function of a random generator and the question gives."""
    rng, session = np.random.default_rng(seed), sensor.session("sphere", num_objects=2, seed=seed)
    while (asked := session.ask()) is not None:
        if isinstance(asked, Probe):
            session.tell(image=images_of(rng, session, asked))
        else:
            session.tell()
    return str(session.outcome)


def test_noise_is_no_touch_of_a_pad_that_its_description_allows(few_hypotheses):
    """Before presses of what is believed were compared, three in ten searches in noise confirmed an object."""
    scene = SMALL.scene()
    scene = replace(scene, shapes={name: scene.solids[name] for name in ("sphere", "cube", "cone")})
    sensor = TactileSensor.load(sensor_of_pad(SMALL), scene)
    noises = [ends(sensor, lambda rng, *_: SMALL.image(rng.random(16)), seed) for seed in range(12)]
    assert "confirmed" not in noises

    bodies = [scene.sample_object(shape, np.random.default_rng(3)) for shape in (1, 0)]
    other = SMALL.scene(scene, np.random.default_rng(5).uniform(size=7))  # a pad that the description allows

    def felt(rng, session, asked):
        return other.press(bodies[session.object_index], asked.pose, rng).image

    assert ends(sensor, felt, 0) != "unsure"

    rng, session = np.random.default_rng(0), sensor.naming()  # which weighs bodies of none of the shapes on each pad
    stranger = TouchWorld.sample(sensor, [UNLISTED], rng)
    for pose in (0, 2):
        session.tell(stranger.touch(pose, rng))
    assert session.belief.unlisted > 0.05


@pytest.mark.torch
def test_a_training_begins_with_the_weights_of_a_file(tmp_path):
    torch = pytest.importorskip("torch")
    from activetouch.perception.contact_training import ContactRecipe, ContactTrainer, weights_of

    reader, imaging = reader_of_pad(LONG), imaging_of_pad(LONG)
    network = ContactRecipe.of(imaging).network(imaging)
    network.load_state_dict(weights_of(reader))
    image = LONG.image(np.random.default_rng(0).uniform(size=(2, 36)))
    seen = torch.from_numpy(resized(image, (SAMPLES, SAMPLES), is_any_size=True)) / 255.0
    with torch.inference_mode():
        mine = network.f(seen, torch.from_numpy(imaging.layout)).numpy()
    assert np.allclose(mine, reader.run(image)[0], atol=2e-3)
    small = ContactRecipe.of(imaging, groups=2, touches=4, others=2, steps=1)
    trainer = ContactTrainer(imaging, small, tmp_path, workers=0, start=reader)
    assert np.allclose(trainer.network.of_layout.bias.detach(), weights_of(reader)["of_layout.bias"])
