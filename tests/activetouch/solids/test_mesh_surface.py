"""Surfaces that are not one closed solid: several bodies, cavities, holes and turned triangles."""

import warnings

import numpy as np
import pytest
import trimesh

from activetouch.errors import BadMesh, MeshWarning
from activetouch.shapes import Mesh
from activetouch.solids import mesh_surface
from activetouch.solids.mesh_surface import MOST_INSIDE, examined

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
    np.testing.assert_allclose(surface.centre, [0.025, 0, 0], atol=1e-12)


def test_a_triangle_that_is_turned_alone_is_turned_back_without_a_word():
    wrong = np.vstack([FACES[:1, ::-1], FACES[1:]])
    surface = examined(CUBE, wrong)
    assert surface.remarks == ()
    assert surface.problem is None
    np.testing.assert_array_equal(np.sort(surface.faces), np.sort(FACES))
    assert outwards(CUBE, surface.faces).min() > 0.0
    np.testing.assert_array_equal(Mesh("cube", CUBE, FACES[:, ::-1]).faces, FACES)


def test_a_closed_cavity_is_neither_told_nor_weighed():
    for turned in (False, True):
        surface = examined(*pair(CUBE, CUBE * 0.25 + [0.008, 0, 0], turned))
        assert (surface.remarks, surface.problem) == ((), None)
        np.testing.assert_allclose(surface.centre, 0.0, atol=1e-12)


def test_two_cubes_at_one_edge_are_read_with_their_edge_of_four_triangles():
    vertices = np.vstack([CUBE, CUBE + np.array([0.024, 0.024, 0])])
    same = np.arange(16)
    same[8:10] = 6, 7  # the common edge
    surface = examined(vertices, same[np.vstack([FACES, FACES + 8])])
    assert surface.remarks == ("1 edges of more than two triangles, which touches do not show",)
    np.testing.assert_allclose(surface.centre, [0.012, 0.012, 0.0], atol=1e-12)


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


def test_the_hole_in_a_turned_surface_is_the_same_hole():
    kept = BALL.faces[BALL.vertices[BALL.faces][:, :, 2].mean(axis=1) < 0.018]
    plain, turned = examined(BALL.vertices, kept), examined(BALL.vertices, kept[:, ::-1])
    np.testing.assert_array_equal(plain.faces, turned.faces)
    assert plain.remarks == turned.remarks


def test_a_cup_without_thickness_is_refused_with_its_hole():
    kept = BALL.faces[BALL.vertices[BALL.faces][:, :, 2].mean(axis=1) < 0.0]
    with pytest.raises(BadMesh, match=r"cup: it is not closed: \d+ open edges; [2-5]\d\.\d% of .* 10% are.*hole"):
        Mesh("cup", BALL.vertices, kept)


def test_a_warning_names_the_mesh_and_an_ordinary_mesh_causes_none():
    with pytest.warns(MeshWarning, match="two: 2 separate surfaces"):
        Mesh("two", *pair(CUBE, CUBE + np.array([0.05, 0, 0])))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Mesh("one", CUBE, FACES)


def test_a_heap_of_large_triangles_meets_fewer_rays_so_that_its_time_is_bounded(rng, monkeypatch):
    corners, faces = rng.uniform(-0.02, 0.02, (2400, 3)), np.arange(2400).reshape(-1, 3)
    plain = mesh_surface.first_met(corners, faces)[0]
    assert len(plain) > 16_000
    monkeypatch.setattr(mesh_surface, "_MOST_PAIRS", 1 << 18)
    sizes, seen_along = [], mesh_surface._seen_along

    def recorded(*args):
        sizes.append(seen_along(*args))
        return sizes[-1]

    monkeypatch.setattr(mesh_surface, "_seen_along", recorded)
    fewer = mesh_surface.first_met(corners, faces)[0]
    assert 1000 < len(fewer) < len(plain) / 4
    assert sum(size.prod(axis=1).sum() for _, _, size in sizes[-32:]) < 1.2 * 2**18
    assert "it is not closed" in examined(corners, faces).problem
