"""Surfaces that are not one closed solid: several bodies, cavities, holes and turned triangles."""

import warnings

import numpy as np
import pytest
import trimesh

from activetouch.errors import MeshWarning
from activetouch.shapes import Mesh
from activetouch.solids.examination import MOST_INSIDE, examined

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.012
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([triangle for a, b, c, d in QUADS for triangle in ((a, b, c), (a, c, d))])
BALL = trimesh.creation.icosphere(subdivisions=3, radius=0.02)


def pair(first, second, turned=False):
    """Vertices and faces of two cubes, the second of them inside out if it is turned."""
    return np.vstack([first, second]), np.vstack([FACES, (FACES[:, ::-1] if turned else FACES) + 8])


def outwards(vertices, faces):
    """The signed volume of each half of the faces, positive if they face outwards."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return np.einsum("fi,fi->f", a, np.cross(b, c)).reshape(2, -1).sum(axis=1)


def test_each_body_is_turned_outwards_by_itself():
    vertices, faces = pair(CUBE, CUBE + np.array([0.05, 0, 0]), turned=True)
    assert outwards(vertices, faces)[1] < 0.0
    surface = examined(vertices, faces)
    assert (outwards(vertices, surface.faces) > 0.0).all()
    assert surface.remarks == ("2 separate surfaces, which are felt as their union",)
    np.testing.assert_allclose(surface.centre, [0.025, 0, 0], atol=1e-5)


def test_a_triangle_that_is_turned_alone_is_turned_back_without_a_word():
    wrong = np.vstack([FACES[:1, ::-1], FACES[1:]])
    surface = examined(CUBE, wrong)
    assert surface.remarks == ()
    assert surface.problem is None
    np.testing.assert_array_equal(np.sort(surface.faces), np.sort(FACES))
    assert outwards(CUBE, surface.faces).min() > 0.0
    np.testing.assert_array_equal(Mesh("cube", CUBE, FACES[:, ::-1]).faces, FACES)


@pytest.mark.parametrize("height", [0.019, 0.017, 0.012])
def test_a_hole_is_told_with_the_share_of_rays_that_enter_it_and_refused_if_it_is_large(height):
    """Random rays enter convex surfaces in proportion to their areas, here the disc of the hole (Cauchy)."""
    disc, cap = 1 - (height / 0.02) ** 2, 2 * (1 - height / 0.02)
    kept = BALL.vertices[BALL.faces][:, :, 2].mean(axis=1) < height
    surface = examined(BALL.vertices, BALL.faces[kept])
    inside = float(surface.remarks[0].split("; ")[1].split("%")[0]) / 100
    assert inside == pytest.approx(disc / (4 - cap + disc), abs=0.01)
    assert (surface.problem is None) == (inside <= MOST_INSIDE) == (height > 0.015)
    np.testing.assert_allclose(surface.centre, 0.0, atol=0.006)


def test_a_warning_names_the_mesh_and_an_ordinary_mesh_causes_none():
    with pytest.warns(MeshWarning, match="two: 2 separate surfaces"):
        Mesh("two", *pair(CUBE, CUBE + np.array([0.05, 0, 0])))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Mesh("one", CUBE, FACES)
