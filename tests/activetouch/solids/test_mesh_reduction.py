"""Meshes of very many triangles: fewer triangles, and an error that is measured."""

import re
import warnings

import numpy as np
import pytest
import trimesh

from activetouch.shapes import Mesh
from activetouch.solids.mesh_reduction import LARGEST_ERROR, reduced

BALL = trimesh.creation.icosphere(subdivisions=5, radius=0.02)  # 20 480 triangles


def divided(mesh, times):
    for _ in range(times):
        mesh = mesh.subdivide()
    return mesh


def test_a_ball_stays_round_within_the_error_that_is_said():
    vertices, faces, error = reduced(BALL.vertices, BALL.faces, 5000)
    assert 3000 < len(faces) < 12_000
    assert 0.0 < error < LARGEST_ERROR
    radii = np.linalg.norm(vertices, axis=1)
    centres = np.linalg.norm(vertices[faces].mean(axis=1), axis=1)
    assert max(np.abs(radii - 0.02).max(), np.abs(centres - 0.02).max()) < 2 * LARGEST_ERROR


def test_a_box_keeps_its_edges_and_corners_sharp(rng):
    box = divided(trimesh.creation.box((0.03, 0.04, 0.05)), 6)  # 49 152 triangles
    vertices, faces, error = reduced(box.vertices, box.faces, 3000)
    assert len(faces) < 8000
    assert error < 1e-9
    np.testing.assert_allclose(np.abs(vertices).max(axis=0), [0.015, 0.020, 0.025], atol=1e-9)
    corners = np.abs(vertices) @ np.ones(3)
    assert corners.max() == pytest.approx(0.060, abs=1e-9)
    plain, fewer = Mesh("box", box.vertices, box.faces), Mesh("box", vertices, faces)
    rays = np.vstack([np.full(500, -0.06), rng.uniform(-0.019, 0.019, 500), rng.uniform(-0.024, 0.024, 500)])
    x = np.array([1.0, 0.0, 0.0])
    np.testing.assert_allclose(fewer.entry_distance(rays, x), plain.entry_distance(rays, x), atol=1e-9)


def test_a_file_of_many_triangles_is_reduced_and_says_so_unless_all_are_wanted(tmp_path):
    BALL.export(tmp_path / "ball.stl")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        mesh = Mesh.from_file(tmp_path / "ball.stl", max_triangles=5000)
    said = r"ball\.stl: 20480 triangles reduced to \d+; no measured point moves by more than 0\.0\d+ mm"
    assert re.match(said, str(told[0].message))
    assert len(mesh.faces) < 12_000
    assert mesh.bounding_radius == pytest.approx(0.02, abs=LARGEST_ERROR)
    assert len(Mesh.from_file(tmp_path / "ball.stl", max_triangles=None).faces) == 20_480
    assert len(Mesh.from_file(tmp_path / "ball.stl").faces) == 20_480
