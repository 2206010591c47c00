"""Training on a small collection, and what is computed from readings."""

import numpy as np
import pytest
import torch

from activetouch import SCENES
from activetouch.data.dataset import read_split
from activetouch.errors import ImpossibleRecipe
from activetouch.perception import classifier
from activetouch.perception.backbones import ConvNeXt
from activetouch.perception.reader import TactileReader
from activetouch.perception.recipe import RECIPES
from activetouch.sensor_files import READER_FILE
from belief.observation_model.selection import log_posteriors
from belief.statistics import clopper_pearson_interval, cluster_bootstrap
from belief.synthetic import random_model
from belief.touch_batch import TouchBatch
from experiments.command_line.arguments import BadArgument
from experiments.scene_choice import SceneChoice
from experiments.sensor import train
from experiments.sensor.calibrate import best_order
from experiments.sensor.collect import Collect, PlanArguments
from experiments.sensor.scores import accuracy_of_objects
from experiments.sensor.train import Changes, Train, card_for, new_classifier, train_any_object

pytestmark = [pytest.mark.mujoco, pytest.mark.torch]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("touches") / "coarse"
    choice = SceneChoice("coarse", fidelity="quasistatic")
    Collect(choice, out=folder, plan=PlanArguments(train=24, calibration=12, test=12), jobs=1).run()
    return folder


def trained(data, out, **settings):
    change = Changes(epochs=2, batch_size=64)
    settings = {"backbone": "cnn", "input_size": 16, "recipe": "large", "change": change, "jobs": 1} | settings
    Train(scene="coarse", data=data, out=out, **settings).run()
    return TactileReader.load(out / READER_FILE)


def test_a_trained_classifier_knows_what_it_was_trained_on(data, tmp_path, capsys):
    reader, train = trained(data, tmp_path), read_split(data, "train")
    card = reader.card
    assert (reader.read(train.images).labels == train.shapes).mean() > 0.4
    assert card.shape_labels == ("sphere", "cube", "cylinder", "cone")
    assert card.pixel_mean == pytest.approx(train.images.mean() / 255, abs=2e-3)
    assert card.pixel_std == pytest.approx(train.images.std() / 255, abs=5e-3)
    assert "576 images, from random weights" in card.training
    said = capsys.readouterr().out
    assert "576 images, from random weights" in said
    assert "learning rate 0.001" in said
    assert "epoch 2: training loss" in said
    assert "TrainingRecipe(" not in said + card.training
    assert "EpochReport(" not in said
    assert "epoch 1 " not in said  # no bar is left of an epoch that is done


@pytest.mark.parametrize("is_trained", [False, pytest.param(True, marks=pytest.mark.nightly)])
def test_a_convnext_starts_from_a_folder_of_weights_and_its_reader_says_so(is_trained, data, tmp_path, monkeypatch):
    from transformers import ConvNextConfig, ConvNextModel

    small, folder = {"tiny": ConvNeXt((1, 1, 1, 1), (8, 8, 16, 16))}, tmp_path / "published"
    for module in (classifier, train):
        monkeypatch.setattr(module, "BACKBONES", small)
    config = ConvNextConfig(num_channels=3, depths=[1, 1, 1, 1], hidden_sizes=[8, 8, 16, 16])
    ConvNextModel(config).save_pretrained(folder)
    first, again, random = (
        new_classifier(card_for(read_split(data, "train"), "tiny", 32, ("a", "b"), ("front",)), 0, weights)
        for weights in (str(folder), str(folder), None)
    )
    same, other = (
        [
            torch.equal(a, b)
            for a, b in zip(first.network.backbone.parameters(), one.network.backbone.parameters(), strict=True)
        ]
        for one in (again, random)
    )
    assert all(same)
    assert not all(other)
    assert first.card.training == f"from the weights in {folder}"
    assert random.card.training == "from random weights"
    if is_trained:
        change = Changes(epochs=1, batch_size=512)
        reader = trained(data, tmp_path / "out", backbone="tiny", input_size=32, change=change, weights=str(folder))
        assert reader.card.training.endswith(f"576 images, from the weights in {folder}")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"weights": "imagenet"}, "--weights are of a ConvNeXt, and the backbone 'cnn' is none; add --backbone tiny"),
        ({"weights": "imagenet", "recipe": "contacts"}, "a reader of any object is none; leave them out"),
        ({"weights": "imagenet", "recipe": "pads"}, "a reader of any object is none; leave them out"),
        ({"input_size": 7}, ("--input-size", "got 7", "1, 2, 4")),
        ({"backbone": "atto", "input_size": 16}, ("--input-size", "at least 32", "got 16")),
        ({"backbone": "grid_cnn", "input_size": 16}, ("--input-size", "at least 17", "got 16")),
    ],
)
def test_what_a_collection_or_a_network_cannot_give_is_refused_before_training(data, tmp_path, wrong, words):
    with pytest.raises(BadArgument) as refused:
        trained(data, tmp_path / "out", **wrong)
    assert all(word in str(refused.value) for word in words)
    assert not (tmp_path / "out").exists()


def test_changes_leave_the_rest_of_a_recipe():
    changed = Changes(epochs=3, seed=7).of(RECIPES["large"])
    assert (changed.epochs, changed.seed, changed.learning_rate) == (3, 7, RECIPES["large"].learning_rate)
    with pytest.raises(ImpossibleRecipe):
        Changes(epochs=0).of(RECIPES["large"])


@pytest.mark.parametrize("value", [0.0, 0.5, 1.0])
def test_the_accuracy_of_objects_that_are_all_alike_has_no_interval_of_width_zero(value, rng):
    objects = np.arange(10).repeat(6)
    assert accuracy_of_objects(np.full(60, value), objects, rng) == (
        *(value, *clopper_pearson_interval(round(10 * value), 10)),
    )
    accuracy, low, high = accuracy_of_objects(np.array([1.0, 1.0, 0.0]), np.zeros(3), rng)  # of one object
    assert low < accuracy < high
    right = (objects > 0).astype(float)
    assert accuracy_of_objects(right, objects, np.random.default_rng(0)) == cluster_bootstrap(
        right, objects, np.random.default_rng(0)
    )


def test_the_best_order_begins_with_the_pose_that_tells_most(rng):
    model, shapes = random_model(rng, num_shapes=4, num_poses=3), np.arange(40) % 4
    rounds = TouchBatch.of([model.sample(int(shape), [0, 1, 2, 0, 1, 2], rng) for shape in shapes])
    order, losses = best_order(model, rounds, shapes)
    alone = [
        -log_posteriors(model, rounds.take((slice(None), [pose])))[np.arange(40), shapes].mean() for pose in range(3)
    ]
    assert order[0] == np.argmin(alone)
    assert losses[0] == pytest.approx(min(alone))
    every = log_posteriors(model, rounds.first(3))[np.arange(40), shapes]
    assert losses[2] == pytest.approx(-every.mean())
    assert sorted(order) == [0, 1, 2]


def test_a_gpu_that_is_not_there_is_refused_before_anything_is_written(tmp_path, monkeypatch):
    import torch

    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(BadArgument, match="finds no GPU"):
        train_any_object(SCENES["gel"].scene, tmp_path / "out", device="cuda")
    assert not (tmp_path / "out").exists()
