"""A reader of any object as a part of the product: its file, its hypotheses, and what is prepared for a scene."""

import json
import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import logsumexp

from activetouch import SCENES, Quasistatic, TactileSensor
from activetouch.distributions import Uniform
from activetouch.errors import AlikeShapes
from activetouch.perception.card import READER
from activetouch.perception.contacts import hypotheses
from activetouch.perception.preparation import prepared
from activetouch.perception.reader import HypothesisTable, TactileReader
from activetouch.pressing.dynamic import Dynamic
from activetouch.rendering import Noise
from activetouch.sensor_files import ANY_OBJECT_FILE, MODELS
from activetouch.shapes import Box, Sphere
from activetouch.solids.family import Family
from belief.errors import CorruptFile
from belief.sealed_tensors import read_tensors, write_tensors

FILE = MODELS / "coarse" / ANY_OBJECT_FILE
POSES = {label: SCENES["coarse"].scene.rotations[label] for label in ("front", "corner")}
SCENE = replace(
    SCENES["coarse"].scene,
    shapes={"ball": Sphere(0.02), "plate": Box((0.02, 0.02, 0.004))},
    poses=POSES,
    press_model=Quasistatic(),
)
IMAGES = np.random.default_rng(0).integers(0, 255, (5, 4, 4)).astype(np.uint8)


@pytest.fixture(scope="module")
def reader():
    return TactileReader.load(FILE)


@pytest.fixture
def cache(few_hypotheses, tmp_path, monkeypatch):
    """An empty cache."""
    monkeypatch.setenv("ACTIVETOUCH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_a_reader_comes_back_from_its_file(reader, cache, tmp_path):
    bound = reader.bound_to(SCENE)
    bound.save(tmp_path / "reader.safetensors")
    back = TactileReader.load(tmp_path / "reader.safetensors")
    assert back.card == reader.card  # a file is about no objects
    assert back.digest == reader.digest
    for one, other in zip(back.bound_to(SCENE).read(IMAGES), bound.read(IMAGES), strict=True):
        assert np.array_equal(one, other)
    assert (tmp_path / "reader.safetensors").read_bytes() == FILE.read_bytes()


FOREIGN = {
    "no imaging": lambda card: card | {"imaging": {}},
    "a number": lambda card: card | {"imaging": 3},
    "another field": lambda card: card | {"imaging": card["imaging"] | {"colour": 1}},
    "a field less": lambda card: card | {"imaging": {k: v for k, v in card["imaging"].items() if k != "pixels"}},
    "pixels that do not divide": lambda card: card | {"imaging": card["imaging"] | {"pixels": 3}},
    "three forces": lambda card: card | {"imaging": card["imaging"] | {"force": [1, 2, 3]}},
    "a pad of no size": lambda card: (
        card | {"imaging": card["imaging"] | {"pad": card["imaging"]["pad"] | {"half_width": 0.0}}}
    ),
    "dead taxels of another sensor": lambda card: card | {"imaging": card["imaging"] | {"dead": [[1, 0], [0, 1]]}},
    "another network": lambda card: card | {"hypothesis_network": "residual"},
}


@pytest.mark.parametrize("what", FOREIGN)
def test_a_card_of_something_else_is_refused(what, tmp_path):
    tensors, card = read_tensors(FILE, READER)
    path = tmp_path / ANY_OBJECT_FILE
    write_tensors(path, tensors, FOREIGN[what](card), READER)
    with pytest.raises(CorruptFile, match=re.escape(str(path))):
        TactileReader.load(path)
    with pytest.raises(CorruptFile, match=re.escape(str(path))):
        TactileSensor.load(tmp_path, SCENE)


def test_a_reader_that_is_about_no_objects_yet_says_so(reader):
    with pytest.raises(ValueError, match=r"about none yet; bound_to\(scene\)"):
        reader.read(IMAGES)
    embeddings, features = reader.run(IMAGES)
    assert len(embeddings) == len(features) == 5
    with pytest.raises(ValueError, match="nothing to read"):
        reader.bound_to(SCENE).read(IMAGES[:0])
    with pytest.raises(ValueError, match="must be uint8"):
        reader.run(IMAGES.astype(np.float16))


@pytest.mark.parametrize("at_once", [1, 10**9])
def test_shape_logits_are_mean_ratios_over_the_hypotheses_of_the_table(reader, cache, monkeypatch, at_once):
    monkeypatch.setattr(hypotheses, "_MOST_SCORES", at_once)
    bound = reader.bound_to(SCENE)
    table = HypothesisTable(bound, SCENE)(64)  # poses, shapes, hypotheses, numbers
    fixed = np.concatenate([table[0][:, ::2], table[1][:, 1::2]], axis=1)  # taking turns
    read = bound.read(IMAGES)
    wanted = logsumexp(np.einsum("nd,kmd->nkm", read.embeddings, fixed), axis=2) - np.log(fixed.shape[1])
    np.testing.assert_allclose(read.logits, wanted, atol=1e-4)
    assert read.logits.shape == (5, 2)


def test_a_table_depends_on_all_that_the_scene_says_and_its_objects(reader, cache):
    scenes = {
        "own": SCENE,
        "noise": replace(SCENE, faults=(*SCENE.faults, Noise(0.1))),
        "force": replace(SCENE, variation=replace(SCENE.variation, force=Uniform(0.5, 1.0))),
        "sizes": replace(SCENE, variation=replace(SCENE.variation, size=Uniform(0.5, 0.6))),
        "aim": replace(SCENE, aims={"front": (0.003, 0.0)}),
        "pose": replace(SCENE, poses={"front": POSES["corner"]}),
        "shape": replace(SCENE, shapes={"ball": Sphere(0.015), "plate": SCENE.shapes["plate"]}),
        "family": replace(
            SCENE, shapes={"ball": Family(Sphere(0.02), radius=Uniform(0.005, 0.015)), "plate": Box((0.02,) * 3)}
        ),
    }
    tables = {name: HypothesisTable(reader, scene).in_pose(32, 0) for name, scene in scenes.items()}
    for name, table in tables.items():
        if name != "own":
            assert np.abs(table - tables["own"]).max() > 1e-3, name
    num_files = len(list(cache.iterdir()))
    for name, scene in scenes.items():
        assert np.array_equal(HypothesisTable(reader, scene).in_pose(32, 0), tables[name]), name
    same = replace(SCENE, shapes={"other": SCENE.shapes["plate"], "name": SCENE.shapes["ball"]}, press_model=Dynamic())
    assert np.array_equal(HypothesisTable(reader, same).in_pose(32, 0)[::-1], tables["own"])  # names do not matter
    assert len(list(cache.iterdir())) == num_files


def test_what_is_prepared_twice_is_pressed_once_and_the_same(reader, cache, monkeypatch):
    bound, presses = reader.bound_to(SCENE), []
    press = type(SCENE).press
    monkeypatch.setattr(type(SCENE), "press", lambda *given: presses.append(1) or press(*given))
    first = prepared(bound, SCENE)
    assert len(presses) == 2 * 2 * 12
    second = prepared(bound, SCENE)
    assert len(presses) == 2 * 2 * 12
    assert first.to_json({}) == second.to_json({})
    for path in cache.glob("*.json"):
        path.write_text(path.read_text()[:100])
    assert prepared(bound, SCENE).to_json({}) == first.to_json({})
    assert len(presses) == 2 * 2 * 2 * 12
    [path] = cache.glob("*.json")
    path.rename(cache / "other.json")
    other = prepared(bound, SCENE, seed=1)
    [at_other] = set(cache.glob("*.json")) - {cache / "other.json"}
    at_other.write_bytes((cache / "other.json").read_bytes())  # that of another key
    assert prepared(bound, SCENE, seed=1).to_json({}) == other.to_json({}) != first.to_json({})


def test_shapes_that_look_equal_are_said_to_be_alike(reader, cache):
    cube = Box((0.016, 0.016, 0.016))
    scene = replace(SCENE, shapes={"cube": cube, "dice": Box((0.016, 0.016, 0.016))})
    with pytest.warns(AlikeShapes, match=r"(cube for dice|dice for cube).*activetouch explain.*directions26") as told:
        prepared(reader.bound_to(scene), scene)
    assert len(told) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        prepared(reader.bound_to(SCENE), SCENE)


@pytest.mark.torch
@pytest.mark.slow
def test_an_untrained_network_becomes_a_reader(cache, tmp_path):
    from activetouch.perception.contact_training import export
    from activetouch.perception.contacts.network import ContactReader
    from activetouch.perception.imaging import imaging_of

    scene = replace(SCENE, renderer=type(SCENE.renderer)(4), faults=SCENE.faults[:2])
    imaging = imaging_of(scene)
    assert imaging.pixels == 8
    exported = export(ContactReader((2,), (2,), 4, 3, imaging.pixels), imaging, scene, "none")
    exported.save(tmp_path / ANY_OBJECT_FILE)
    fields = read_tensors(tmp_path / ANY_OBJECT_FILE, READER)[1]
    assert json.loads(json.dumps(fields["imaging"])) == json.loads(json.dumps(imaging.fields()))
    back = TactileReader.load(Path(tmp_path / ANY_OBJECT_FILE)).bound_to(scene)
    images = IMAGES.repeat(2, axis=1).repeat(2, axis=2)
    read = back.read(images)
    assert read.embeddings.shape == (5, 3)
    np.testing.assert_allclose(read.logits, exported.bound_to(scene).read(images).logits, atol=1e-5)
