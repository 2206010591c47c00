"""Meshes of very many triangles: fewer triangles, and an error that is measured."""

import re
import warnings

import numpy as np
import pytest
import trimesh

from activetouch.errors import MeshWarning
from activetouch.shapes import Mesh
from activetouch.solids.mesh_reduction import LARGEST_ERROR, reduced
from activetouch.solids.raycast import first_entry

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


def test_noise_that_cannot_be_reduced_is_kept_and_said(tmp_path, rng):
    rough = BALL.vertices * (1 + rng.uniform(-0.03, 0.03, (len(BALL.vertices), 1)))
    trimesh.Trimesh(rough, BALL.faces, process=False).export(tmp_path / "rough.stl")
    with pytest.warns(MeshWarning, match=r"20480 triangles kept, because fewer would move points by more than 0\.1 mm"):
        assert len(Mesh.from_file(tmp_path / "rough.stl", max_triangles=10_000).faces) == 20_480


def test_triangles_of_no_area_and_of_vast_extent_are_kept():
    line = np.zeros((3000, 3))
    line[:, 0] = np.arange(3000) * 2.0**-20
    faces = np.arange(2998)[:, None] + np.arange(3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for vertices in (line, BALL.vertices * 1e60):
            some = faces if vertices is line else BALL.faces
            kept_vertices, kept, error = reduced(vertices, some, 100)
            assert kept_vertices is vertices
            assert kept is some
            assert error == 0.0


def test_a_slot_that_is_wider_than_twice_the_error_stays_open(rng):
    """Two plates whose only vertices in the slot are at its rims, which lie on the surface that closes it."""
    gap, side = 0.0006, np.linspace(-0.02, 0.02, 121)
    x, y = (part.ravel() for part in np.meshgrid(side, side, indexing="ij"))
    low = (np.arange(121 * 120).reshape(120, 121)[:, :-1]).ravel()
    top = np.vstack([np.column_stack([low, low + 121, low + 122]), np.column_stack([low, low + 122, low + 1])])
    grid = np.arange(121 * 121).reshape(121, 121)
    around = np.concatenate([grid[:-1, 0], grid[-1, :-1], grid[:0:-1, -1], grid[0, :0:-1]])
    following, below = np.roll(around, -1), 121 * 121
    wall = np.vstack(
        [
            np.column_stack([around, around + below, following + below]),
            np.column_stack([around, following + below, following]),
        ]
    )
    plate = np.vstack([np.column_stack([x, y, np.full(x.size, height)]) for height in (0.002, -0.002)])
    faces = np.vstack([top, top[:, ::-1] + below, wall])
    shift = np.array([0.02 + gap / 2, 0.0, 0.0])
    vertices, faces = np.vstack([plate - shift, plate + shift]), np.vstack([faces, faces + len(plate)])
    fewer_vertices, fewer, error = reduced(vertices, faces, 10_000)
    slot = np.vstack([np.zeros(50), rng.uniform(-0.019, 0.019, 50), np.full(50, 0.03)])
    assert error <= LARGEST_ERROR
    assert np.isinf(first_entry(fewer_vertices, fewer, slot, np.array([0.0, 0.0, -1.0]))).all()


def test_a_file_causes_one_warning_which_points_at_the_caller(tmp_path):
    balls = [BALL.copy().apply_scale(1000), BALL.copy().apply_scale(1000).apply_translation([50, 0, 0])]
    trimesh.util.concatenate(balls).export(tmp_path / "balls.stl")
    with pytest.warns(MeshWarning) as told:
        Mesh.from_file(tmp_path / "balls.stl", max_triangles=5000)
    [warning] = told
    assert re.match(r"balls\.stl: read in millimetres .*; 40960 triangles reduced .*; 2 separate", str(warning.message))
    assert warning.filename == __file__
