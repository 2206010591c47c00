"""Cut and joined solids: the same rays as the polyhedra and meshes that they are."""

import numpy as np
import pytest

from activetouch.poses import random_orientation, to_matrix
from activetouch.shapes import KEYED_SHAPES, Box, Cut, Cylinder, Mesh, Sphere, Torus, Union
from activetouch.solids.primitives import Hull as Base
from tests.rays import entry

CUBE = Box((0.016, 0.016, 0.016))


class Hull(Base):
    def __init__(self, vertices):
        self.vertices = vertices

    @property
    def corners(self):
        return self.vertices


def rays(rng, n=300):
    rotation = to_matrix(random_orientation(rng))
    starts = np.stack([np.full(n, -0.08), *rng.uniform(-0.03, 0.03, size=(2, n))])
    return rotation.T @ starts, rotation.T[:, 0]


@pytest.mark.parametrize("name", ["cube_cut", "cube_cut_twice", "cube_chamfered"])
def test_a_cut_cube_is_the_polyhedron_of_its_remaining_corners(name, rng):
    cut = KEYED_SHAPES[name]
    same = Hull(cut.geom.vertices)
    for _ in range(20):
        some = rays(rng)
        np.testing.assert_allclose(entry(cut, *some), entry(same, *some), atol=1e-5)


def test_a_union_is_met_at_its_nearest_part_and_hull_and_ball_contain_it(rng):
    parts = (CUBE, Cylinder(0.005, 0.030))
    union = Union(parts)
    for _ in range(10):
        some = rays(rng)
        np.testing.assert_array_equal(entry(union, *some), np.minimum(*(entry(part, *some) for part in parts)))
    for solid in (union, *KEYED_SHAPES.values()):
        if (corners := solid.geom.vertices) is not None:
            assert np.linalg.norm(corners, axis=1).max() <= solid.bounding_radius * (1 + 1e-9)


def test_equal_solids_are_equal_and_bad_ones_are_refused():
    assert Cut(CUBE, ((1.0, 0.0, 0.0, 0.01),)) == Cut(CUBE, ((1.0, 0.0, 0.0, 0.01),))
    assert len({KEYED_SHAPES[name] for name in KEYED_SHAPES}) == 8
    for plane in ((0.0, 0.0, 0.0, 0.01), (1.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, np.nan), (1.0, 0.0, 0.0)):
        with pytest.raises(ValueError, match="plane"):
            Cut(CUBE, (plane,))
    with pytest.raises(ValueError, match="at least one part"):
        Union(())


@pytest.mark.parametrize("solid", [Sphere(0.02), Mesh("box", *CUBE.triangles())], ids=["ball", "mesh"])
def test_every_convex_solid_can_be_cut_and_joined(solid, rng):
    cut, plane = Cut(solid, ((2.0, 0.0, 0.0, 0.01),)), 0.01
    assert cut.surface.vertices[0].max() == pytest.approx(plane)
    origins, direction = rays(rng)
    whole, part = entry(solid, origins, direction), entry(cut, origins, direction)
    met = (origins + whole * direction[:, None])[0]
    kept = np.isfinite(whole) & (met < plane)
    assert kept.sum() > 20
    np.testing.assert_allclose(part[kept], whole[kept], rtol=0, atol=1e-5)
    if direction[0]:
        on_plane = (plane - origins[0]) / direction[0]
        assert (part >= np.where(np.isfinite(whole), np.minimum(whole, on_plane), np.inf) - 1e-5).all()
    joined = Union((solid, Cylinder(0.005, 0.030)))
    assert joined.bounding_radius == max(part.bounding_radius for part in joined.parts)


@pytest.mark.parametrize(
    "solid",
    [
        Torus(0.016, 0.007),
        Union((Box((0.02, 0.004, 0.004)), Box((0.004, 0.004, 0.02)))),
        Mesh("ring", *Torus(0.016, 0.007).triangles()),
    ],
    ids=["torus", "union", "mesh"],
)
def test_a_solid_that_is_not_convex_is_not_cut(solid):
    with pytest.raises(ValueError, match="only convex solids"):
        Cut(solid, ((1.0, 0.0, 0.0, 0.001),))
