"""Learning from several touches of an object: the estimate of the loss, what is learned, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from activetouch.data.dataset import TouchSet
from activetouch.perception import fused_posterior
from activetouch.perception.card import ClassifierCard
from activetouch.perception.classifier import TouchClassifier, TouchNetwork
from activetouch.perception.fused_posterior import FusedPosterior
from activetouch.perception.hypothesis_network import Hypotheses, compose
from activetouch.perception.recipe import RECIPES, TrainingRecipe
from activetouch.perception.training import Trainer
from activetouch.poses import multiply, turn

pytestmark = pytest.mark.torch
POSES = np.stack([turn("x", angle) for angle in (0.0, 0.7, 1.9)])
RECIPE = replace(RECIPES["fused"], epochs=8, batch_size=48, learning_rate=2e-3, negatives=64, cell=0.0, bf16=False)


def bars_and_discs(number) -> TouchSet:
    """Every object is touched in three poses; a bar, shape 0, lies at one of four angles, which a disc hides."""
    rng = np.random.default_rng(0)
    which, rests = rng.integers(4, size=number), []
    images, orientations = [], []
    z, y = np.mgrid[:16, :16] - 7.5
    for index, each in enumerate(which):
        rest = turn("x", np.pi / 4 * each)
        rests += [rest] * len(POSES)
        for pose in POSES:
            shown = multiply(pose, rest)
            angle = 2 * np.arctan2(shown[1], shown[0])
            across = np.cos(angle) * z - np.sin(angle) * y
            inside = np.hypot(z, y) < 4.0 if index % 2 else np.abs(across) < 1.5
            images.append(200 * inside + rng.integers(0, 40, inside.shape))
            orientations.append(shown)
    total = number * len(POSES)
    objects = np.repeat(np.arange(number), len(POSES))
    blank = np.zeros(total)
    poses = np.tile(np.arange(len(POSES)), number)
    return TouchSet(
        np.array(images).astype(np.uint8), objects % 2, objects, poses, blank, blank, np.array(rests),
        np.array(orientations), blank + 1.0,
    )  # fmt: skip


def network(seed=0):
    card = ClassifierCard("cnn", 16, ("bar", "disc"), ("a", "b", "c"), embedding=16, log_size_std=0.1)
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        return card, TouchNetwork(card)


def trainer(state, train, recipe=RECIPE):
    return Trainer(TouchClassifier(*network()), replace(recipe, embedding=16), train, train, state)


def test_it_learns_shape_and_orientation_and_goes_on_where_it_stopped(tmp_path):
    train = bars_and_discs(96)
    whole, first = (trainer(tmp_path / name, train) for name in ("whole", "parts"))
    losses = [whole.run_epoch().calibration_loss for _ in range(RECIPE.epochs)]
    assert losses[-1] < losses[0] - 0.5
    assert whole.reports[-1].calibration_accuracy > 0.95
    for _ in range(3):
        first.run_epoch()
    second = trainer(tmp_path / "parts", train)
    assert [second.run_epoch().calibration_loss for _ in range(RECIPE.epochs - 3)] == losses[3:]


def test_the_loss_is_the_negative_log_posterior_of_the_body():
    """Against the sum over all bodies of the prior: both shapes, each at one of four angles."""
    train, (_, net) = bars_and_discs(16), network()
    for part in (net.head[-1], net.hypotheses[-1]):
        part.weight.data *= 2.0  # so that posteriors differ from the prior
    objective = FusedPosterior(train, 2, replace(RECIPE, embedding=16, touches=2, batch_size=32, negatives=256))
    chance = torch.Generator().manual_seed(0)
    estimates, exact = [], []
    for rows in [rows for _ in range(12) for rows in objective.batches(chance)]:
        images, still = torch.from_numpy(train.images[rows.numpy()]), torch.zeros(len(rows))
        with torch.no_grad():
            estimates.append(float(objective.loss(net, images, rows, still, chance)))
            exact.append(exact_loss(net, train, images, rows.reshape(-1, 2)))
    assert np.std(exact) > 0.05
    np.testing.assert_allclose(estimates, exact, atol=0.3)
    assert np.mean(estimates) == pytest.approx(np.mean(exact), abs=0.05)


def exact_loss(net, train, images, rows):
    embeddings = net(images)[0].reshape(*rows.shape, -1)
    poses = train.poses[rows[0].numpy()]
    rests = torch.from_numpy(train.rests[:: len(POSES)]).float()
    total, losses = torch.zeros(len(rows), 2, len(rests)), []
    for number, pose in enumerate(poses):
        shown = compose(torch.from_numpy(POSES[pose]).float().expand_as(rests), rests)
        one = torch.ones(len(rests))
        for shape in range(2):
            kind = torch.full((len(rests),), shape)
            known = net.hypotheses(Hypotheses(kind, shown, one, one, torch.zeros(len(rests), 2)))
            total[:, shape] += embeddings[:, number] @ known.T
        objects = torch.from_numpy(train.object_ids[rows[:, 0].numpy()])
        own = total[torch.arange(len(rows)), objects % 2, objects]
        losses.append((torch.logsumexp(total.flatten(1), dim=1) - np.log(2 * len(rests)) - own).mean())
    return float(torch.stack(losses).mean())


def test_bodies_of_the_posterior_make_the_estimate_better(monkeypatch):
    """Of a posterior that is sharp; few random bodies alone hardly ever hit it."""
    train, (_, net) = bars_and_discs(16), network()
    for part in (net.head[-1], net.hypotheses[-1]):
        part.weight.data *= 12.0

    def errors(confused):
        monkeypatch.setattr(fused_posterior, "_CONFUSED", confused)
        objective = FusedPosterior(train, 2, replace(RECIPE, embedding=16, touches=2, batch_size=32, negatives=4))
        chance, found = torch.Generator().manual_seed(0), []
        for rows in [rows for _ in range(12) for rows in objective.batches(chance)]:
            images = torch.from_numpy(train.images[rows.numpy()])
            with torch.no_grad():
                loss = float(objective.loss(net, images, rows, torch.zeros(len(rows)), chance))
                found.append(loss - exact_loss(net, train, images, rows.reshape(-1, 2)))
        return np.abs(found).mean()

    assert errors(24) < 0.5 * errors(1)


def test_all_touches_of_an_epoch_come_in_groups_of_one_object_and_different_poses():
    train = bars_and_discs(20)
    objective = FusedPosterior(train, 2, replace(RECIPE, touches=2, batch_size=10))
    batches = objective.batches(torch.Generator().manual_seed(1))
    assert sum(map(len, batches)) == 40
    for rows in batches:
        pairs = rows.reshape(-1, 2).numpy()
        assert (train.object_ids[pairs[:, 0]] == train.object_ids[pairs[:, 1]]).all()
        assert len(np.unique(train.poses[pairs[:, 0]])) == len(np.unique(train.poses[pairs[:, 1]])) == 1
        assert train.poses[pairs[0, 0]] != train.poses[pairs[0, 1]]


def test_touches_that_cannot_be_fused_are_refused():
    train = bars_and_discs(8)
    with pytest.raises(ValueError, match="as many poses, there are 3"):
        FusedPosterior(train, 2, replace(RECIPE, touches=4))
    with pytest.raises(ValueError, match="every object in every pose"):
        FusedPosterior(train.select(np.arange(23)), 2, RECIPE)
    with pytest.raises(ValueError, match="turn all objects alike"):
        FusedPosterior(replace(train, rests=np.full((24, 4), np.nan)), 2, RECIPE)
    with pytest.raises(ValueError, match="turn all objects alike"):
        FusedPosterior(replace(train, rests=train.rests[::-1].copy()), 2, RECIPE)
    with pytest.raises(ValueError, match="do not say in which orientation"):
        FusedPosterior(replace(train, sizes=np.full(24, np.nan)), 2, RECIPE)


def test_recipes_without_an_embedding_have_single_touches():
    with pytest.raises(ValueError, match="touches must be at least 1, and 1 without an embedding"):
        TrainingRecipe(touches=3)
