"""Twins: meshes that are the same body, mirror images, or the same body in another size."""

import numpy as np
import pytest
import trimesh

from activetouch.distributions import Constant, Uniform
from activetouch.errors import MeshWarning
from activetouch.poses import random_orientation, to_matrix
from activetouch.scene import Scene, Variation
from activetouch.shapes import SHAPES, Mesh
from activetouch.solids.twins import find_twins, text_of_twins

FACES = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
HANDED = Mesh("handed", np.array([[0, 0, 0], [0.03, 0, 0], [0.005, 0.015, 0], [0.001, 0.004, 0.01]]), FACES)
MIRROR = Mesh("mirror", HANDED.vertices * [1, 1, -1], FACES)


def moved(mesh, rng, scale=1.0):
    """The mesh, turned, shifted, with its vertices in another order and each triangle divided in four."""
    turn = to_matrix(random_orientation(rng))
    fine = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).subdivide()
    order = rng.permutation(len(fine.vertices))
    return Mesh("moved", scale * (fine.vertices @ turn.T + 0.001)[order], np.argsort(order)[fine.faces])


def hulls(number, rng):
    found = (trimesh.convex.convex_hull(rng.normal(size=(40, 3)) * 0.01) for _ in range(number))
    return {f"hull{i}": Mesh("hull", hull.vertices, hull.faces) for i, hull in enumerate(found)}


@pytest.mark.parametrize(
    ("other", "scale", "mirrored"),
    [(HANDED, 1.0, False), (MIRROR, 1.0, True), (HANDED, 1.2, False), (MIRROR, 0.9, True)],
)
def test_a_moved_turned_and_divided_copy_is_found_with_its_size_and_handedness(other, scale, mirrored, rng):
    [twins] = find_twins({"a": HANDED, "b": moved(other, rng, scale)})
    assert (twins.first, twins.second, twins.mirrored) == ("a", "b", mirrored)
    assert twins.factor == pytest.approx(scale, rel=1e-9)


def test_other_bodies_are_no_twins(rng):
    shapes = hulls(100, rng) | dict(SHAPES)
    dented = HANDED.vertices + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 3e-5]])
    assert find_twins(shapes | {"a": HANDED, "b": Mesh("dented", dented, FACES)}) == []


def test_what_is_said_depends_on_how_sizes_vary():
    larger = Mesh("larger", HANDED.vertices * 1.1, FACES)
    assert (
        text_of_twins({"a": HANDED, "b": HANDED}, (1.0, 1.0)) == "a and b are the same body: no touch tells them apart"
    )
    assert "mirror images: only touches" in text_of_twins({"a": HANDED, "b": MIRROR}, (1.0, 1.0))
    assert text_of_twins({"a": HANDED, "b": larger}, (1.0, 1.0)) == ""
    assert "b is 1.1 × as large" in text_of_twins({"a": HANDED, "b": larger}, (0.9, 1.1))


def test_a_scene_with_twins_warns_and_is_made():
    with pytest.warns(MeshWarning, match="left and right are the same body: no touch tells them apart"):
        scene = Scene(shapes={"left": HANDED, "right": Mesh("right", HANDED.vertices, HANDED.faces)})
    assert scene.shape_labels == ("left", "right")
    larger = Mesh("larger", HANDED.vertices * 1.1, FACES)
    Scene(shapes={"one": HANDED, "other": larger}, variation=Variation(size=Constant(1.0)))
    with pytest.warns(MeshWarning, match="the same body in two sizes"):
        Scene(shapes={"one": HANDED, "other": larger}, variation=Variation(size=Uniform(0.9, 1.1)))
