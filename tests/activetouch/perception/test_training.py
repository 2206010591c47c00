"""Training learns, stops when it should, and an interrupted training ends where an uninterrupted one does."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from activetouch.data.dataset import TouchSet
from activetouch.errors import LabelMismatch, TrainingDiverged
from activetouch.perception import learner
from activetouch.perception.classifier import ClassifierCard, TouchClassifier, TouchNetwork
from activetouch.perception.recipe import RECIPES, TrainingRecipe
from activetouch.perception.training import Trainer
from belief.errors import CorruptFile

pytestmark = pytest.mark.torch
RECIPE = replace(RECIPES["large"], epochs=3, batch_size=16, learning_rate=3e-3, warmup=0.2, bf16=False)


def discs_and_bars(n=96) -> TouchSet:
    """Two classes any network can tell apart, at random places."""
    rng = np.random.default_rng(0)
    images = np.zeros((n, 32, 32), np.uint8)
    shapes = np.arange(n) % 2
    y, x = np.mgrid[:32, :32]
    for image, shape, (cy, cx) in zip(images, shapes, rng.integers(10, 22, (n, 2)), strict=True):
        image[np.hypot(y - cy, x - cx) < 6 if shape else np.abs(y - cy) < 2] = 200
    return TouchSet(images, shapes, np.arange(n), np.zeros(n, int), np.ones(n), np.ones(n))


TOUCHES = discs_and_bars()


def trainer(state, recipe=RECIPE, seed=0, backbone="cnn", train=TOUCHES, calibration=TOUCHES):
    torch.manual_seed(seed)
    card = ClassifierCard(backbone, 32, ("bar", "disc"), ("p",))
    return Trainer(TouchClassifier(card, TouchNetwork(card)), recipe, train, calibration, state)


def weights(trained):
    return torch.cat([value.flatten() for value in trained.classifier.network.state_dict().values()])


@pytest.mark.parametrize("bf16", [True, False])
def test_training_learns_a_simple_task(bf16, tmp_path, monkeypatch):
    monkeypatch.setattr(learner, "has_bfloat16", lambda device: True)  # also where it is slow
    trained = trainer(tmp_path / "state.safetensors", replace(RECIPE, bf16=bf16))
    reports = [trained.run_epoch() for _ in range(3)]
    assert reports[-1].calibration_loss < reports[0].calibration_loss
    assert reports[-1].calibration_accuracy > 0.9


@pytest.mark.parametrize("has", ["amx_bf16", "avx512_bf16", "bf16", None])
def test_bfloat16_is_for_processors_that_have_instructions_for_it(has, monkeypatch):
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx2": True, "amx_bf16": False, has: True})
    learner.has_bfloat16.cache_clear()
    for is_asked in (True, False):
        with learner.mixed_precision(is_asked):
            found = torch.ones(2, 2) @ torch.ones(2, 2)
        assert found.dtype == (torch.bfloat16 if is_asked and has else torch.float32)
    monkeypatch.undo()
    learner.has_bfloat16.cache_clear()


@pytest.mark.parametrize("shape", [(12, 5), (5, 12), (8, 8)])
def test_muon_in_single_precision_steps_as_that_of_torch(shape):
    rng = torch.Generator().manual_seed(0)
    start = torch.randn(shape, generator=rng)
    found = []
    for kind, settings in ((learner.SingleMuon, {}), (torch.optim.Muon, {"adjust_lr_fn": "match_rms_adamw"})):
        matrix, chance = torch.nn.Parameter(start.clone()), torch.Generator().manual_seed(1)
        optimizer = kind([matrix], lr=0.01, weight_decay=0.05, **settings)
        for _ in range(3):
            matrix.grad = torch.randn(shape, generator=chance)
            optimizer.step()
        found.append(matrix.detach() - start)
    assert (found[0] - found[1]).norm() < 0.03 * found[1].norm()  # which rounds to bfloat16
    assert found[0].norm() > 0.01


@pytest.mark.parametrize("optimizer", ["adamw", "muon"])
def test_an_interrupted_training_ends_where_an_uninterrupted_one_does(optimizer, tmp_path):
    recipe = replace(RECIPE, optimizer=optimizer)
    whole = trainer(tmp_path / "whole.safetensors", recipe)
    for _ in range(3):
        whole.run_epoch()
    first = trainer(tmp_path / "parts.safetensors", recipe)
    first.run_epoch()
    second = trainer(tmp_path / "parts.safetensors", recipe, seed=99)  # its own initial weights must not matter
    assert second.reports == first.reports
    for _ in range(2):
        second.run_epoch()
    torch.testing.assert_close(weights(second), weights(whole), rtol=0, atol=0)
    assert second.reports == whole.reports


def test_patience_stops_and_goes_back_to_the_best_epoch(tmp_path):
    swapped = replace(TOUCHES, shapes=1 - TOUCHES.shapes)  # what is learned makes this loss grow
    recipe = replace(RECIPE, epochs=9, patience=2)
    trained = trainer(tmp_path / "state.safetensors", recipe, calibration=swapped)
    epochs = []
    while not trained.is_finished:
        trained.run_epoch()
        epochs.append(weights(trained))
    assert trained.epochs_done == trained.best_epoch + 2 < 9
    trained.finish()
    torch.testing.assert_close(weights(trained), epochs[trained.best_epoch - 1], rtol=0, atol=0)
    again = trainer(tmp_path / "state.safetensors", recipe, calibration=swapped)
    assert again.is_finished
    again.finish()
    torch.testing.assert_close(weights(again), weights(trained), rtol=0, atol=0)


def test_class_weights_make_all_shapes_count_alike(tmp_path):
    few_discs = TOUCHES.select(np.flatnonzero((TOUCHES.shapes == 0) | (np.arange(96) < 12)))
    counts = np.bincount(few_discs.shapes)
    assert counts.tolist() == [48, 6]
    weighted = trainer(tmp_path / "a.safetensors", replace(RECIPE, class_weights=True), train=few_discs)
    np.testing.assert_allclose(weighted.objective.class_weights.numpy() * counts, counts.sum() / 2)
    plain = trainer(tmp_path / "b.safetensors", replace(RECIPE, class_weights=False), train=few_discs)
    assert plain.objective.class_weights.tolist() == [1.0, 1.0]


def test_a_gradient_that_is_not_finite_is_refused_with_advice_and_nothing_is_written(tmp_path):
    diverged = trainer(tmp_path / "state.safetensors")
    with torch.no_grad():
        diverged.classifier.network.head.bias.fill_(torch.inf)
    with pytest.raises(TrainingDiverged, match=r"epoch 1: after 0 images .*--change\.learning-rate"):
        diverged.run_epoch()
    assert not diverged.state.exists()


def test_what_differs_from_the_training_of_a_state_is_named(tmp_path):
    trainer(tmp_path / "state.safetensors").run_epoch()
    with pytest.raises(LabelMismatch, match=r"another training, with another epochs\. Choose"):
        trainer(tmp_path / "state.safetensors", replace(RECIPE, epochs=9))


@pytest.mark.parametrize("split", ["train", "calibration"])
def test_other_touches_do_not_resume_though_they_are_as_many_and_look_alike(split, tmp_path):
    trainer(tmp_path / "state.safetensors").run_epoch()
    swapped = replace(TOUCHES, shapes=1 - TOUCHES.shapes)
    with pytest.raises(LabelMismatch, match=rf"with another {split.replace('train', 'training')} touches\. Choose"):
        trainer(tmp_path / "state.safetensors", **{split: swapped})


def test_a_flipped_bit_of_a_training_state_is_noticed(tmp_path):
    state = tmp_path / "state.safetensors"
    trainer(state).run_epoch()
    whole, rng = state.read_bytes(), np.random.default_rng(0)
    for place in [len(whole) - 1, *rng.integers(len(whole), size=20).tolist()]:
        damaged = bytearray(whole)
        damaged[place] ^= 1 << int(rng.integers(8))
        state.write_bytes(damaged)
        with pytest.raises(CorruptFile, match="delete it to start anew"):
            trainer(state)


@pytest.mark.parametrize(
    "change",
    [{"epochs": 0}, {"batch_size": 0}, {"learning_rate": 0.0}, {"learning_rate": np.inf}, {"weight_decay": -1.0},
     {"warmup": 30.0}, {"rotation": -1.0}, {"patience": 0}, {"optimizer": "sgd"}, {"gain": 1.1}, {"noise": -0.1},
     {"noise": np.inf}, {"dead": 1.1}, {"focus": ("cube",)}],
)  # fmt: skip
def test_impossible_recipes_are_refused(change):
    with pytest.raises(ValueError, match=r"must .* got|by contrast, got"):
        TrainingRecipe(**change)
