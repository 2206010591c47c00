"""Readers of force-patch images see what an image holds, and neighbours read its numbers as well as can be."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from activetouch.data.manifest import CollectionPlan
from activetouch.named_scenes import SCENES
from activetouch.rendering import read_out
from benchmarks.force_patch_limit import (
    NUMBERS,
    WHOLE_SPOT,
    Main,
    PressNumbers,
    drawn_rows,
    press_numbers,
    read_by_neighbours,
)
from benchmarks.held_out import Stream, held_out_touch
from experiments.scene_choice import SceneChoice
from experiments.sensor.collect import collect

SCENE = SCENES["paper"].scene
RENDERER = SCENE.renderer
"""Of the colours of viridis."""


@pytest.mark.mujoco
@pytest.mark.parametrize("number", range(8))
def test_an_image_is_drawn_from_the_size_of_the_force_and_the_contact_point_of_a_few_rows(number):
    contact = held_out_touch(SCENE, 0, Stream.TEST, number).contact
    rows = drawn_rows(contact, SCENE.renderer)
    along_x = np.zeros_like(rows.force)
    along_x[:, 0] = np.linalg.norm(rows.force, axis=1)
    bare = replace(rows, force=along_x, position=np.zeros_like(rows.position))
    nothing = np.zeros_like(contact.gap)
    other = replace(contact, gap=nothing, indentation=nothing, pressure=nothing, force=0.0, trace=bare)
    np.testing.assert_array_equal(SCENE.renderer(other), SCENE.renderer(contact))


@pytest.mark.mujoco
def test_turning_and_mirroring_a_press_leaves_its_numbers():
    contact = held_out_touch(SCENE, 0, Stream.TEST, 1).contact
    trace = contact.trace
    expected = press_numbers(contact, SCENE.renderer)
    assert 0.0 < expected[2] < expected[1]
    for swap in (False, True):
        for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            order = [1, 0] if swap else [0, 1]
            turned = replace(
                trace,
                point=trace.point[:, order] * signs,
                force=np.column_stack([trace.force[:, 0], trace.force[:, 1:][:, order] * signs]),
            )
            np.testing.assert_allclose(press_numbers(replace(contact, trace=turned), SCENE.renderer), expected)


def toy(count, rng, second=1.0):
    """Two shapes whose forces are Gaussians 2 apart, and whose contact points are ``second`` apart."""
    shapes = np.arange(count) % 2
    values = rng.normal(size=(count, len(NUMBERS)))
    values[:, 0] += 2.0 * shapes
    values[:, 1] += second * shapes
    return PressNumbers(shapes, values)


def test_neighbours_reach_the_best_accuracy_of_two_gaussians(rng):
    # Best: Φ(1) = .841. 4 000 guesses have a standard error of .006: four of them, and .01 for so few neighbours.
    known, choice, test = toy(8000, rng), toy(2000, rng), toy(4000, rng)
    reader = read_by_neighbours(known, choice, test, ("force",))
    accuracy = np.mean(reader.guesses == test.shapes)
    best = stats.norm.cdf(1.0)
    assert best - 0.034 < accuracy < best + 0.024
    assert reader.upper > best - 0.024


@pytest.fixture(scope="module")
def contact():
    """Of a cone; its contact point lies off the pad's centre and diagonals."""
    return held_out_touch(SCENE, 0, Stream.TEST, 3).contact


def read(contact):
    return read_out(RENDERER(contact), (), np.random.default_rng(0))


@pytest.mark.torch
@pytest.mark.mujoco
@pytest.mark.parametrize("is_pixels", [False, True])
def test_the_findings_are_written(is_pixels, tmp_path):
    data = tmp_path / "data" if is_pixels else None
    if data is not None:
        collect(SceneChoice("paper"), CollectionPlan(train=4, calibration=1, test=1), data, jobs=1)
    Main(data, touches=12, known=40, choice=20, out=tmp_path / "limit", jobs=1).run()
    numbers = json.loads((tmp_path / "limit" / "limit.json").read_text())
    assert numbers["sizes"] == ([24, 48, 96] if is_pixels else [2, 5, 10, 20, 40])
    assert 0.0 < numbers["classifier"]["value"] <= 1.0
    if is_pixels:
        assert numbers["views"][WHOLE_SPOT]["learned_from"] > 0.5  # four shapes
