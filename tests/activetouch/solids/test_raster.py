"""Height maps of triangles: the same as rays one by one, whichever way triangles face, without a leak at an edge."""

from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from activetouch.poses import random_orientation, to_matrix
from activetouch.shapes import Box
from activetouch.solids import raster
from activetouch.solids.examination import first_met
from activetouch.solids.raster import Surface, foremost, heights
from tests.rays import entry, first_met_one_by_one

PIXEL, NUM = 0.001, 40
BALL = trimesh.creation.icosphere(subdivisions=3, radius=0.014)
TORUS = trimesh.creation.torus(0.012, 0.005)
CUBE = trimesh.creation.box((0.02, 0.02, 0.02))
CAVE = trimesh.util.concatenate([CUBE, trimesh.creation.box((0.01, 0.01, 0.01))])
CAVE.faces[12:] = CAVE.faces[12:, ::-1]
HOLED = trimesh.Trimesh(TORUS.vertices, TORUS.faces[::3], process=False)
TWO = trimesh.util.concatenate([BALL, TORUS.copy().apply_translation((0.006, 0.004, 0.002))])
BALLS = trimesh.util.concatenate([BALL, BALL.copy().apply_translation((0.006, 0.004, 0.002))])
TURNED = trimesh.util.concatenate([BALL.copy().apply_translation((0.03, 0, 0)), BALL])
TURNED.faces[len(BALL.faces) :] = TURNED.faces[len(BALL.faces) :, ::-1]  # one of two balls
FLIPPED = trimesh.Trimesh(
    TORUS.vertices, np.where(np.arange(len(TORUS.faces))[:, None] % 2, TORUS.faces, TORUS.faces[:, ::-1]), process=False
)
# A torus of which a part is pulled through itself: closed, all triangles in one direction, but in places inside out.
CROSSED = TORUS.copy()
CROSSED.vertices[CROSSED.vertices[:, 0] > 0.006, 2] *= -1.0


def ray_heights(vertices, faces, turn, place, pixel=PIXEL, num=NUM):
    """The same map by rays."""
    at = (np.arange(num) - (num - 1) / 2) * pixel
    z, y = (axis.ravel() for axis in np.meshgrid(at - place[1], at - place[0], indexing="ij"))
    origins = np.linalg.inv(turn) @ np.stack([np.full(y.size, -0.2), y, z])
    scale = np.cbrt(np.linalg.det(turn))
    found = entry(SimpleNamespace(surface=Surface(vertices.T, faces.T, None)), origins, turn[0] / scale)
    return (0.2 - found * scale).reshape(num, num)


every_mesh = pytest.mark.parametrize(
    ("mesh", "star_shaped"),
    [
        (BALL, True),
        (TORUS, False),
        (CUBE, True),
        (TWO, False),
        (BALLS, True),
        (CAVE, False),
        (HOLED, False),
        (TURNED, False),
        (FLIPPED, False),
        (CROSSED, False),
    ],
    ids=[
        "ball",
        "torus",
        "cube",
        "a ball and a ring",
        "two balls",
        "cavity",
        "holes",
        "a turned body",
        "turned triangles",
        "crosses itself",
    ],
)


@every_mesh
def test_a_map_is_what_rays_say_one_by_one(mesh, star_shaped, rng):
    surface = Surface.of(mesh.vertices, mesh.faces)
    assert (surface.normals is not None) == star_shaped
    turns = np.array([to_matrix(random_orientation(rng)) for _ in range(12)]) * rng.uniform(0.5, 1.4, (12, 1, 1))
    places = rng.uniform(-0.004, 0.004, (12, 2))
    maps = heights(surface, turns, places, PIXEL, NUM)
    for found, turn, place in zip(maps, turns, places, strict=True):
        expected = ray_heights(mesh.vertices, mesh.faces, turn, place)
        assert np.isfinite(expected).sum() > 50
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5)


def random_bodies(seed):
    """Boxes and balls at random places, some of them with holes, inside out, or with turned triangles."""
    rng, parts = np.random.default_rng(seed), []
    for _ in range(rng.integers(1, 6)):
        part = trimesh.creation.box(rng.uniform(0.005, 0.03, 3)) if rng.uniform() < 0.6 else BALL.copy()
        part.apply_transform(trimesh.transformations.random_rotation_matrix(rng.uniform(size=3)))
        part.apply_translation(rng.uniform(-0.012, 0.012, 3))
        kept = rng.uniform(size=len(part.faces)) > rng.choice([0.0, 0.0, 0.1])
        turned = rng.uniform(size=len(part.faces)) < rng.choice([0.0, 0.0, 0.3, 1.0])
        faces = np.where(turned[:, None], part.faces[:, ::-1], part.faces)
        parts.append(trimesh.Trimesh(part.vertices, faces[kept], process=False))
    return trimesh.util.concatenate([*parts, *parts[: rng.integers(2)]])  # the first may be there twice


def assert_rays_meet(mesh, found):
    """The triangles that rays meet first, and their sides, are those of the oracle; the order does not matter."""
    wanted = first_met_one_by_one(mesh.vertices, mesh.faces)
    for one, other in zip(found, wanted, strict=True):
        assert one.dtype == other.dtype
    sides = [
        np.bincount(2 * triangle + is_back, minlength=2 * len(mesh.faces)) for triangle, is_back in (found, wanted)
    ]
    np.testing.assert_array_equal(*sides)


@every_mesh
@pytest.mark.parametrize("num", [3, 16, 64])
def test_a_map_is_the_same_to_the_last_bit_without_the_triangles_that_miss_every_pixel(
    mesh, star_shaped, num, monkeypatch, rng
):
    surface, turns = Surface.of(mesh.vertices, mesh.faces), np.array([to_matrix(random_orientation(rng))] * 3)
    places = rng.uniform(-0.004, 0.004, (3, 2))
    without = heights(surface, turns, places, 0.03 / num, num)
    monkeypatch.setattr(raster, "_MARGIN", np.inf)
    np.testing.assert_array_equal(without, heights(surface, turns, places, 0.03 / num, num))


@every_mesh
def test_the_triangles_that_are_met_first_are_what_rays_say_one_by_one(mesh, star_shaped):
    assert_rays_meet(mesh, first_met(mesh.vertices, mesh.faces))
    if star_shaped:
        assert_rays_meet(mesh, first_met(mesh.vertices, mesh.faces, is_sound=True))


@pytest.mark.parametrize("seed", range(8))
def test_the_triangles_of_random_bodies_that_are_met_first_are_what_rays_say_one_by_one(seed):
    mesh = random_bodies(seed)
    assert_rays_meet(mesh, first_met(mesh.vertices, mesh.faces))


def test_fewer_rays_meet_thousands_of_triangles_that_most_of_them_pass_through():
    cubes = trimesh.util.concatenate([trimesh.creation.box(np.full(3, 0.02 + i * 1e-6)) for i in range(200)])
    triangle, is_back = first_met(cubes.vertices, cubes.faces)
    all_rays, _ = first_met(CUBE.vertices, CUBE.faces)
    assert 0.5 < len(triangle) / len(all_rays) < 0.9
    assert (triangle >= len(cubes.faces) - 12).all()  # those of the largest
    assert not is_back.any()


@pytest.mark.parametrize("towards", [(1, 0, 0), (1, 1, 0), (1, 1, 1), (3, 4, 0)])
@pytest.mark.parametrize("two_sided", [False, True])
def test_no_pixel_on_an_edge_or_a_corner_is_left_out(towards, two_sided, rng):
    # The corners of a finely divided cube lie on pixel centres exactly, or next to them by rounding.
    fine = CUBE.copy().subdivide().subdivide().subdivide()
    surface = Surface.of(fine.vertices, fine.faces)
    surface = Surface(surface.vertices, surface.faces, None) if two_sided else surface
    x = np.array(towards) / np.linalg.norm(towards)
    y = np.cross((0.0, 0.0, 1.0), x) / np.linalg.norm(np.cross((0.0, 0.0, 1.0), x))
    turn = np.stack([x, y, np.cross(x, y)])
    across = fine.vertices @ turn[1:].T  # places of the corners along y and z
    start, end = across[fine.edges_unique.T]
    points = np.concatenate([across, 0.5 * (start + end), 0.25 * start + 0.75 * end])
    places = -points * (1 - 1e-9)  # every point in the middle of a window of one pixel, none on the silhouette
    maps = heights(surface, np.broadcast_to(turn, (len(places), 3, 3)), places, PIXEL, 1).ravel()
    origins = turn.T @ np.stack([np.full(len(places), -0.1), *-places.T])
    expected = 0.1 - entry(Box((0.01, 0.01, 0.01)), origins, turn[0])
    np.testing.assert_allclose(maps, expected, rtol=0, atol=1e-5)


def test_a_map_depends_neither_on_the_others_nor_on_the_size_of_a_portion(rng):
    turns = np.array([to_matrix(random_orientation(rng)) for _ in range(20)])
    places, surface = rng.uniform(-0.01, 0.01, (20, 2)), Surface.of(TWO.vertices, TWO.faces)
    together = heights(surface, turns, places, PIXEL, 16)
    alone = np.concatenate([heights(surface, turns[i : i + 1], places[i : i + 1], PIXEL, 16) for i in range(20)])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(raster, "_MOST", 50)
        few = heights(surface, turns, places, PIXEL, 16)
    np.testing.assert_allclose(together, alone, rtol=0, atol=1e-5)
    np.testing.assert_allclose(together, few, rtol=0, atol=1e-5)
    single = heights(surface, turns, places, PIXEL, 16, np.float32)
    assert single.dtype == np.float32
    np.testing.assert_array_equal(single, together.astype(np.float32))


@pytest.mark.parametrize(
    "mesh", [BALL, TORUS, CUBE, TWO, CROSSED], ids=["ball", "torus", "cube", "two", "crosses itself"]
)
@pytest.mark.parametrize("reach", [0.005, 0.03])
def test_the_foremost_part_of_a_map_is_that_of_the_whole(mesh, reach, rng):
    surface, depth, met = Surface.of(mesh.vertices, mesh.faces), 0.003, 0
    for _ in range(40):
        turn = to_matrix(random_orientation(rng)) * rng.uniform(0.5, 1.4)
        place = rng.uniform(-reach, reach, 2)
        whole = heights(surface, turn[None], place[None], PIXEL, 24)[0]
        part = foremost(surface, turn, place, PIXEL, 24, depth)
        near = whole >= whole.max() - depth
        np.testing.assert_allclose(part[near], whole[near], rtol=0, atol=1e-5)
        assert (part[~near] <= whole[~near] + 1e-5).all()
        met += np.isfinite(whole).any()
    assert met > 10


def test_a_tip_between_two_pixels_does_not_hide_what_lies_beside_it():
    ball, num = BALL.copy(), 24
    ball.vertices[ball.vertices[:, 0].argmin(), 0] -= 0.02  # a needle, thinner than a pixel
    surface = Surface.of(ball.vertices, ball.faces)
    for place in ([0.0, 0.0], [0.0005, 0.0005], [0.0003, -0.0004]):
        whole = heights(surface, np.eye(3)[None], np.array([place]), 2 * PIXEL, num)[0]
        part = foremost(surface, np.eye(3), np.array(place), 2 * PIXEL, num, 0.003)
        near = whole >= whole.max() - 0.003
        np.testing.assert_allclose(part[near], whole[near], rtol=0, atol=1e-5)
