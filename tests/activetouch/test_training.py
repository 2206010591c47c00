"""Training learns, and an interrupted training ends where an uninterrupted one does."""

import numpy as np
import pytest
import torch

from activetouch.classifier import Backbone, ClassifierCard, TouchClassifier, TouchNetwork
from activetouch.dataset import TouchSet
from activetouch.errors import CorruptFile, LabelMismatch
from activetouch.recipe import TrainingRecipe
from activetouch.training import Trainer

pytestmark = pytest.mark.torch
SMALL = Backbone((1, 1, 1, 1), (8, 8, 16, 16))
RECIPE = TrainingRecipe(epochs=3, batch_size=16, learning_rate=3e-3, warmup=0.2, bf16=False)


def discs_and_bars(n=96) -> TouchSet:
    """Two classes any network can tell apart, at random places."""
    rng = np.random.default_rng(0)
    images = np.zeros((n, 32, 32), np.uint8)
    shapes = np.arange(n) % 2
    y, x = np.mgrid[:32, :32]
    for image, shape, (cy, cx) in zip(images, shapes, rng.integers(10, 22, (n, 2)), strict=True):
        image[np.hypot(y - cy, x - cx) < 6 if shape else np.abs(y - cy) < 2] = 200
    return TouchSet(images, shapes, np.arange(n), np.zeros(n, int), np.ones(n), np.ones(n))


def trainer(state, recipe=RECIPE, seed=0):
    torch.manual_seed(seed)
    card = ClassifierCard("atto", 32, ("bar", "disc"), ("p",))
    return Trainer(TouchClassifier(card, TouchNetwork(SMALL, 2, 32)), recipe, 96, state)


def weights(trained):
    return torch.cat([value.flatten() for value in trained.classifier.network.state_dict().values()])


def test_training_learns_a_simple_task(tmp_path):
    touches, trained = discs_and_bars(), trainer(tmp_path / "state.safetensors")
    reports = [trained.run_epoch(touches, touches, lambda n: None) for _ in range(3)]
    assert reports[-1].calibration_loss < reports[0].calibration_loss
    assert reports[-1].calibration_accuracy > 0.9


def test_an_interrupted_training_ends_where_an_uninterrupted_one_does(tmp_path):
    touches = discs_and_bars()
    whole = trainer(tmp_path / "whole.safetensors")
    for _ in range(3):
        whole.run_epoch(touches, touches, lambda n: None)
    first = trainer(tmp_path / "parts.safetensors")
    first.run_epoch(touches, touches, lambda n: None)
    second = trainer(tmp_path / "parts.safetensors", seed=99)  # its own initial weights must not matter
    assert second.epochs_done == 1
    for _ in range(2):
        second.run_epoch(touches, touches, lambda n: None)
    torch.testing.assert_close(weights(second), weights(whole), rtol=0, atol=0)


def test_another_recipe_does_not_resume(tmp_path):
    touches, trained = discs_and_bars(), trainer(tmp_path / "state.safetensors")
    trained.run_epoch(touches, touches, lambda n: None)
    with pytest.raises(LabelMismatch, match="delete this file"):
        trainer(tmp_path / "state.safetensors", TrainingRecipe(epochs=9))


def test_a_damaged_training_state_is_a_clear_error(tmp_path):
    (tmp_path / "state.safetensors").write_bytes(b"half a file")
    with pytest.raises(CorruptFile, match="delete it to start anew"):
        trainer(tmp_path / "state.safetensors")
