"""Shapes that feel alike: congruent ones are never told apart, different ones are, and a hole shows where it is met."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from activetouch import SCENES
from activetouch.poses import random_orientation
from activetouch.shapes import EXTENDED_SHAPES, SHAPES, Mesh, Sphere
from belief.errors import InvalidArgument
from benchmarks.alike import alike
from benchmarks.contact_fit import ContactFit

GEL = SCENES["gel"].scene


def _cube(half_edge, hole=0.0, depth=0.0):
    """A cube as a mesh, with a round hole in its upper face."""
    num = 16
    angle = np.arange(num) * 2 * np.pi / num
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    square = ring / np.abs(ring).max(axis=1, keepdims=True) * half_edge
    small = ring * (hole or half_edge / 2)
    levels = [(square, -half_edge), (square, half_edge), (small, half_edge), (small, half_edge - depth)]
    corners = [np.column_stack([outline, np.full(num, z)]) for outline, z in levels]
    vertices = np.vstack([*corners, [[0, 0, -half_edge], [0, 0, half_edge - depth]]])
    faces = []
    for i in range(num):
        j = (i + 1) % num
        for level in range(3 if hole else 2):
            a, b, c, d = level * num + i, level * num + j, (level + 1) * num + i, (level + 1) * num + j
            faces += [(a, b, d), (a, d, c)]
        bottom = 3 * num if hole else 2 * num
        faces += [(j, i, 4 * num), (bottom + i, bottom + j, 4 * num + 1)]
    return Mesh("cube", vertices, faces)


@cache
def found(*shapes, num_objects=8, scene="gel"):
    named = {f"{number}": shape for number, shape in enumerate(shapes)}
    return alike(replace(SCENES[scene].scene, shapes=named), num_objects=num_objects)


def test_two_labels_of_one_body_are_told_apart_by_chance_without_an_estimate():
    (pair,) = found(_cube(0.012), _cube(0.012), num_objects=2).pairs
    assert (pair.one, pair.all, pair.shown, pair.shown_from_26) == (0.5, 0.5, 0.0, 0.0)


def test_different_shapes_are_told_apart_by_one_touch():
    (pair,) = found(Sphere(0.02), SHAPES["cube"]).pairs
    assert pair.one == pytest.approx(0.0, abs=0.01)
    assert pair.all_compared == pytest.approx(0.0, abs=0.05)
    assert (pair.shown, pair.shown_from_26) == (1.0, None)


def test_a_hole_in_one_face_shows_in_few_objects_and_in_more_from_26_directions():
    result = found(_cube(0.007), _cube(0.007, hole=0.0025, depth=0.006), num_objects=12)
    (pair,) = result.pairs
    assert 0.2 < pair.all < 0.5  # most objects never show the face with the hole
    assert 0.0 < pair.shown <= 0.4
    assert pair.shown_from_26 > pair.shown + 0.2


def test_one_shape_or_one_object_is_nothing_to_compare():
    with pytest.raises(InvalidArgument, match="two shapes and two objects"):
        alike(replace(GEL, shapes={"cube": SHAPES["cube"]}))
    with pytest.raises(InvalidArgument, match="got 4 and 1"):
        alike(GEL, num_objects=1)


def test_a_fit_finds_the_press_that_made_the_images(rng):
    scene = replace(GEL, shapes={"ellipsoid": EXTENDED_SHAPES["ellipsoid"]})
    fit, body, poses = ContactFit.of(scene), scene.solids["ellipsoid"], np.array(list(scene.rotations.values()))
    true = np.array([[*random_orientation(rng), 1.03, *[0.001, -0.0005, 0.0] * 6] for _ in range(4)])
    images = fit.images(fit.heights(body, true, poses)).reshape(4, 6, fit.edge, fit.edge)
    start = true.copy()
    start[:, :4] += 0.03
    start[:, :4] /= np.linalg.norm(start[:, :4], axis=1, keepdims=True)
    start[:, 4:] = [1.0, *[0.0] * 18]
    far = fit.fit(body, images, start, poses, 0)[1]
    presses, near = fit.fit(body, images, start, poses, 15)
    assert (near < 0.01 * far).all()
    assert presses[:, 4] == pytest.approx(1.03, abs=0.01)
