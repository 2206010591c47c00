"""A reader of every pixel sees what an image holds, whichever way it is turned, and its findings are written."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from activetouch.data.dataset import CollectionPlan
from activetouch.named_scenes import SCENES
from activetouch.rendering import ForcePatchRenderer, GelSightRenderer, read_out
from experiments.bayes_error.held_out import Stream, fresh_touch
from experiments.bayes_error.limit import Limit
from experiments.bayes_error.pixel_reader import PLACE, REACH, CloseReader, close_ups
from experiments.bayes_error.pixels import CloseUp
from experiments.scene_choice import SceneChoice
from experiments.sensor.collect import collect

SCENE = SCENES["paper"].scene
RENDERER = SCENE.renderer
DARKEST = np.array([68, 1, 84], np.uint8)
"""Of the colours of viridis."""


@pytest.fixture(scope="module")
def contact():
    """Of a cone; its contact point lies off the pad's centre and diagonals."""
    return fresh_touch(SCENE, 0, Stream.TEST, 3).contact


def read(contact):
    return read_out(RENDERER(contact), (), np.random.default_rng(0))


@pytest.mark.parametrize("colormap", ["viridis", "magma", "gray"])
def test_colours_are_undone(colormap, contact):
    image = read_out(ForcePatchRenderer(colormap=colormap)(contact), (), np.random.default_rng(0))
    grey = read_out(ForcePatchRenderer(colormap="gray")(contact), (), np.random.default_rng(0))[..., 0]
    levels = ForcePatchRenderer(colormap=colormap).levels(image).astype(int)
    # Two neighbouring levels may share a colour; then the lower is given.
    assert levels.max() == 255
    assert np.all((levels <= grey) & (levels + 1 >= grey))


def test_images_of_other_colours_are_refused(contact):
    gelsight = read_out(GelSightRenderer()(contact), (), np.random.default_rng(0))
    with pytest.raises(ValueError, match=r"the pixel at \[0, 0, 0\] has the colour .* viridis does not have"):
        close_ups(gelsight[None], RENDERER)


def test_turned_and_mirrored_images_look_the_same(contact):
    image = read(contact)
    views = [turned[:, ::mirror] for turned in (np.rot90(image, n) for n in range(4)) for mirror in (1, -1)]
    seen = close_ups(np.stack(views), RENDERER)
    assert seen.shape == (8, (2 * REACH + 1) ** 2 + PLACE)
    np.testing.assert_allclose(seen, np.broadcast_to(seen[0], seen.shape), atol=1e-6)


def test_place_and_brightness_are_those_of_the_spot(contact):
    *_, along, across, _, _, brightness = close_ups(read(contact)[None], RENDERER)[0]
    rows = contact.trace.select(slice(0, contact.trace.end_of_pause))
    place = np.sort(np.abs(rows.point[-1])) / contact.pad.half_width
    np.testing.assert_allclose((across, along), place, atol=0.5 / 128)  # half a pixel
    assert brightness**2 == pytest.approx(RENDERER.levels(read(contact)).mean() / 255, rel=1e-5)


def test_a_spot_at_the_rim_and_an_empty_image_are_seen(contact):
    trace = replace(contact.trace, point=np.full_like(contact.trace.point, contact.pad.half_width))
    rim, empty = read(replace(contact, trace=trace)), np.zeros((128, 128, 3), np.uint8) + DARKEST
    seen = close_ups(np.stack([rim, empty]), RENDERER)
    assert np.isfinite(seen).all()
    assert 0.9 < seen[0, -PLACE] <= 1.0
    assert not seen[1, : (2 * REACH + 1) ** 2].any()


@pytest.mark.torch
def test_the_reader_reaches_the_best_accuracy_of_two_gaussians(rng):
    # Best: Φ(1) = .841; the standard error of 4 000 guesses is .006.
    shapes = np.arange(8000) % 2
    rows = rng.normal(size=(8000, 5)).astype(np.float32)
    rows[:, 0] += 2.0 * shapes
    read = CloseReader(epochs=5).learn(rows[:4000], shapes[:4000], seed=0)
    log_probs = read(rows[4000:])
    assert abs(np.mean(log_probs.argmax(axis=1) == shapes[4000:]) - stats.norm.cdf(1.0)) < 0.024
    np.testing.assert_allclose(np.exp(log_probs).sum(axis=1), 1.0, rtol=1e-5)


@pytest.mark.torch
@pytest.mark.mujoco
def test_the_findings_are_written(tmp_path):
    collect(SceneChoice("paper"), CollectionPlan(train=4, calibration=1, test=1), tmp_path / "data", jobs=1)
    assert Limit(learned_from=tmp_path / "data").estimator(SCENE) == CloseUp(tmp_path / "data")
    Limit(SceneChoice("paper"), touches=24, learned_from=tmp_path / "data", out=tmp_path / "limit", jobs=1).run()
    numbers = json.loads((tmp_path / "limit" / "limit.json").read_text())
    assert numbers["sizes"] == [24, 48, 96]
    whole = numbers["views"]["every pixel of the spot, its place, its brightness"]
    assert whole["learned_from"] > 0.5  # four shapes
    assert "bounds the limit from below" in (tmp_path / "limit" / "limit.md").read_text()
