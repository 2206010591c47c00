"""Training by contrast learns ratios of likelihoods, and labels turn with their images."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from activetouch import Quasistatic, Scene
from activetouch.data.dataset import TouchSet
from activetouch.perception.augmentation import augment
from activetouch.perception.card import ClassifierCard
from activetouch.perception.classifier import Hypotheses, TouchClassifier, TouchNetwork
from activetouch.perception.export import export_reader, fixed_hypotheses
from activetouch.perception.objective import Contrast, turned
from activetouch.perception.recipe import RECIPES
from activetouch.perception.training import Trainer
from activetouch.poses import Placement, multiply, random_orientation, to_matrices, turn
from activetouch.pressing.contact import Pad
from activetouch.scene import Symmetry

pytestmark = pytest.mark.torch
RECIPE = replace(RECIPES["contrast"], epochs=8, batch_size=32, negatives=64, cell=0.0, bf16=False)
SCENE = Scene(pad=Pad(num_taxels=32), press_model=Quasistatic())


def image_of(orientation):
    placement = Placement(SCENE.solids["cone"], 1.0, np.asarray(orientation, float))
    return SCENE.image(SCENE.press_model.press(SCENE.pad, placement, 2.0))


@pytest.mark.parametrize("seed", range(4))
def test_a_turned_image_is_the_image_of_the_turned_object(seed, rng):
    """A quarter turn as augmentation makes it, against a press of the object in its new orientation."""
    orientation = torch.from_numpy(random_orientation(rng)).float()[None]
    image = torch.from_numpy((255 * image_of(orientation[0])).round().astype(np.uint8))[None]
    chance = torch.Generator().manual_seed(seed)
    shown, angles = augment(image, Symmetry.ROTATIONS, 0.0, chance)
    kinds, sizes = torch.zeros(1, dtype=torch.long), torch.ones(1)
    body = Hypotheses(kinds, orientation, sizes)
    orientation = turned(body, angles).orientations
    pressed = (255 * image_of(orientation[0])).round()
    assert np.abs(pressed - shown[0].numpy()).max() <= 2
    if float(angles[0]):
        assert np.abs(pressed - image[0].numpy()).max() > 10


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A training to its end, its losses, and the reader of its network."""
    train = bars_and_discs(240)
    whole = trainer(tmp_path_factory.mktemp("whole") / "state", train, RECIPE)
    losses = [whole.run_epoch().calibration_loss for _ in range(RECIPE.epochs)]
    return whole, losses, export_reader(whole.finish(), (16, 16), fixed_hypotheses(whole.classifier, train))


def test_training_by_contrast_learns_shape_and_orientation(trained):
    """Bars at three angles: the network must tell the angle, and a body of the other shape, a disc, from them."""
    (whole, losses, reader), train = trained, bars_and_discs(240)
    assert losses[-1] < losses[0] - 0.5
    assert whole.reports[-1].calibration_accuracy > 0.95
    reading = reader.read(train.images)
    assert (reading.labels == train.shapes).mean() > 0.95
    bars = np.flatnonzero(train.shapes == 0)
    known = reader.hypotheses.embed(np.zeros(3, np.int64), to_matrices(ANGLES), np.ones(3))
    found = (reading.embeddings[bars] @ known.T).argmax(axis=1)
    alike = [np.abs(train.orientations[bars] @ some.T) for some in (ANGLES, multiply(HALF_TURN, ANGLES.T).T)]
    assert (found == np.maximum(*alike).argmax(axis=1)).mean() > 0.95


def test_orientations_related_by_a_symmetry_get_equal_ratios(trained):
    """A bar turned by half a turn is the same bar: nobody tells the network, and it learns so."""
    (_, _, reader), train = trained, bars_and_discs(240)
    bars = reader.read(train.images[train.shapes == 0]).embeddings
    ratios, of_twins = (
        bars @ reader.hypotheses.embed(np.zeros(3, np.int64), to_matrices(q), np.ones(3)).T
        for q in (ANGLES, multiply(HALF_TURN, ANGLES.T).T)
    )
    assert np.abs(ratios - of_twins).mean() < 0.15 * ratios.std()


def test_a_focus_draws_a_shape_more_often():
    train = bars_and_discs(240)
    for focus in ("bar", "disc"):
        objective = Contrast(train, ("bar", "disc"), replace(RECIPE, focus=(focus,)))
        rows = torch.cat(objective.batches(torch.Generator().manual_seed(0)))
        assert len(rows) == len(train.images)
        assert (train.shapes[rows] == ("bar", "disc").index(focus)).mean() == pytest.approx(0.8, abs=0.06)


ANGLES = np.stack([turn("x", angle) for angle in np.deg2rad([0.0, 60.0, 120.0])])
"""Orientations of a bar."""
HALF_TURN = np.array([0.0, 1.0, 0.0, 0.0])


def bars_and_discs(number) -> TouchSet:
    """Images of bars, shape 0, at one of three angles or the same plus half a turn, and of discs, shape 1."""
    rng = np.random.default_rng(0)
    shapes, which, flipped = np.arange(number) % 2, rng.integers(3, size=number), rng.random(number) < 0.5
    z, y = np.mgrid[:16, :16] - 7.5
    angles = np.deg2rad(60.0) * which
    across = np.cos(angles)[:, None, None] * z - np.sin(angles)[:, None, None] * y
    inside = np.where((shapes == 0)[:, None, None], np.abs(across) < 1.5, np.hypot(z, y) < 4.0)
    images = (200 * inside + rng.integers(0, 40, inside.shape)).astype(np.uint8)
    orientations = np.stack([turn("x", angle + np.pi * flip) for angle, flip in zip(angles, flipped, strict=True)])
    blank = np.zeros(number)
    return TouchSet(
        images, shapes, np.arange(number), blank.astype(int), blank, blank, orientations, orientations, blank + 1.0
    )


def trainer(state, train, recipe):
    card = ClassifierCard("cnn", 16, ("bar", "disc"), ("p",), embedding=16, log_size_std=0.1)
    with torch.random.fork_rng():
        torch.manual_seed(0)
        network = TouchNetwork(replace(card))
    recipe = replace(recipe, embedding=16)
    return Trainer(TouchClassifier(card, network), recipe, train, train, state)


class ByShape(torch.nn.Module):
    """Embeds an image by its brightness and a hypothesis by its shape, so that losses can be worked out by hand."""

    def __init__(self) -> None:
        super().__init__()
        self.vectors = torch.tensor([[0.3, -0.5], [1.1, 0.2]])

    def forward(self, images):
        bright = images.float().mean(dim=(1, 2)) / 50.0
        return torch.stack([bright, 1.0 - bright], dim=1), None

    def hypotheses(self, some):
        return self.vectors[some.shapes]

    def losses(self, images, own, others, log_prior=(0.0, 0.0)):
        """Negative log probability of each touch's own hypothesis among all, and of its shape, by the definitions."""
        scores = self(torch.from_numpy(images))[0].double().numpy() @ self.vectors.double().numpy().T  # of each shape
        found = []
        for row, (shape, among) in enumerate(zip(own, others, strict=True)):
            ratio = np.exp(scores[row, shape]) / np.exp(scores[row, among]).mean()
            of_shapes = np.exp(scores[row] + log_prior)
            found.append(-np.log(ratio) - np.log(of_shapes[shape] / of_shapes.sum()))
        return np.array(found)


@pytest.mark.parametrize(("focus", "drawn_shapes"), [((), [0, 1] * 5), (("disc",), [0] * 2 + [1] * 8)])
def test_the_losses_of_contrast_are_those_of_their_definitions(focus, drawn_shapes):
    touches, network = bars_and_discs(300), ByShape()
    objective = Contrast(touches, ("bar", "disc"), replace(RECIPE, negatives=10, focus=focus))
    rows, chance = torch.tensor([0, 3, 4, 7, 9]), torch.Generator().manual_seed(0)
    images, shapes = touches.images[rows], touches.shapes[rows]
    found = objective.loss(network, torch.from_numpy(images), rows, torch.zeros(5), chance)
    prior = np.log([2.0 / 5.0, 8.0 / 5.0]) if focus else np.zeros(2)  # a shape in focus is drawn four times as often
    wanted = network.losses(images, shapes, [np.concatenate([shapes, drawn_shapes])] * 5, prior)
    assert float(found) == pytest.approx(wanted.mean(), rel=1e-5)
    loss, accuracy = objective.evaluate(network, touches)
    others = [np.append(np.arange(4096) % 2, shape) for shape in touches.shapes]
    assert loss == pytest.approx(network.losses(touches.images, touches.shapes, others).mean(), rel=1e-5)
    read = (network(torch.from_numpy(touches.images))[0] @ network.vectors.T).argmax(dim=1).numpy()
    assert accuracy == (read == touches.shapes).mean()
