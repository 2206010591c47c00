"""The analytic height maps against MuJoCo's ray caster and against geometry done by hand."""

import pickle
from dataclasses import fields, replace

import mujoco
import numpy as np
import pytest

from activetouch.poses import random_orientation, to_matrix
from activetouch.pressing.rig import build_spec
from activetouch.shapes import (
    EXTENDED_SHAPES,
    Box,
    Capsule,
    Cone,
    Cylinder,
    Dome,
    Ellipsoid,
    Frustum,
    Prism,
    Sphere,
    Torus,
    Wedge,
)
from activetouch.solids.examination import examined
from activetouch.solids.primitives import TOLERANCE
from activetouch.solids.triangles import are_star_shaped
from tests.rays import entry

FACETS = TOLERANCE + 1e-9  # [m]
every_shape = pytest.mark.parametrize("name", list(EXTENDED_SHAPES))


def hexagon(x, y, circumradius):
    """Signed distance, inside at least, from a hexagon with a corner on the x axis."""
    angles = np.pi / 6 + np.arange(6) * np.pi / 3
    return np.max([x * np.cos(a) + y * np.sin(a) for a in angles], axis=0) - circumradius * np.cos(np.pi / 6)


# Positive outside, negative inside, zero on the surface; written out so that nothing is shared with the solids.
LEVEL = {
    "sphere": lambda x, y, z: np.hypot(np.hypot(x, y), z) - 0.020,
    "cube": lambda x, y, z: np.max([np.abs(x), np.abs(y), np.abs(z)], axis=0) - 0.016,
    "cylinder": lambda x, y, z: np.maximum(np.hypot(x, y) - 0.016, np.abs(z) - 0.020),
    "cone": lambda x, y, z: np.maximum(np.hypot(x, y) - 0.5 * (0.018 - z), -z - 0.018),
    "cuboid": lambda x, y, z: np.max([np.abs(x) - 0.016, np.abs(y) - 0.016, np.abs(z) - 0.024], axis=0),
    "wedge": lambda x, y, z: np.max(
        [-x - 0.032 / 3, -z - 0.032 / 3, np.abs(y) - 0.016, (x + z - 0.032 / 3) / np.sqrt(2)], axis=0
    ),
    "frustum": lambda x, y, z: np.maximum(np.hypot(x, y) - (0.013 - 0.5 * z), np.abs(z) - 0.010),
    "capsule": lambda x, y, z: np.hypot(np.hypot(x, y), z - np.clip(z, -0.012, 0.012)) - 0.016,
    "half_sphere": lambda x, y, z: np.maximum(np.hypot(np.hypot(x, y), z + 0.010) - 0.020, -z - 0.010),
    "hexagonal_prism": lambda x, y, z: np.maximum(hexagon(x, y, 0.0185), np.abs(z) - 0.020),
    "ellipsoid": lambda x, y, z: 0.016 * (np.sqrt((x / 0.016) ** 2 + (y / 0.020) ** 2 + (z / 0.024) ** 2) - 1),
    "torus": lambda x, y, z: np.hypot(np.hypot(x, y) - 0.016, z) - 0.007,
}


def random_rays(rng, reach=0.06, n=400):
    """Parallel rays from a square outside any object, in a random direction of the object frame."""
    rotation = to_matrix(random_orientation(rng))
    starts = np.stack([np.full(n, -reach), *rng.uniform(-0.03, 0.03, size=(2, n))])
    return rotation.T @ starts, rotation.T[:, 0]


def mujoco_distances(shape, rays):
    """Distances by mj_ray on the shape's own collision geom, one after the other; inf where a ray misses."""
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body()
    geom = shape.geom
    if geom.vertices is not None:
        spec.add_mesh(name="mesh", uservert=geom.vertices.ravel())
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh")
    else:
        body.add_geom(type=getattr(mujoco.mjtGeom, f"mjGEOM_{geom.type.upper()}"), size=geom.size)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    hit = np.zeros(1, np.int32)
    distances = np.array(
        [
            mujoco.mj_ray(model, data, origin, direction, None, 1, -1, hit, None)
            for origins, direction in rays
            for origin in origins.T
        ]
    )
    return np.where(distances >= 0.0, distances, np.inf)


def errors_against_mujoco(shape, rng, most_missed):
    """Differences on rays both hit; rays only one of them hits may only be grazing ones, at most this share."""
    rays = [random_rays(rng, n=40) for _ in range(30)]
    ours = np.concatenate([entry(shape, *ray) for ray in rays])
    theirs = mujoco_distances(shape, rays)
    hit = np.isfinite(ours) & np.isfinite(theirs)
    assert hit.sum() > 90
    assert (np.isfinite(ours) != np.isfinite(theirs)).mean() < most_missed
    return np.abs(ours[hit] - theirs[hit])


@pytest.mark.mujoco
@pytest.mark.parametrize(
    "shape",
    [EXTENDED_SHAPES[name] for name in EXTENDED_SHAPES if name not in ("cone", "frustum", "half_sphere", "torus")]
    + [Ellipsoid((0.004, 0.010, 0.030))],
    ids=repr,
)
def test_primitives_and_polyhedra_agree_with_mujocos_rays_up_to_the_facets(shape, rng):
    errors = errors_against_mujoco(shape, rng, most_missed=0.005)
    assert np.median(errors) < TOLERANCE
    assert np.quantile(errors, 0.99) < 2e-4  # most on steep sides


@pytest.mark.mujoco
@pytest.mark.parametrize(
    "shape",
    [
        Cone(0.018, 0.036, num_facets=512),
        Frustum(0.018, 0.008, 0.020, num_facets=512),
        Frustum(0.008, 0.018, 0.020, num_facets=512),
        Dome(0.020, num_facets=256),
    ],
    ids=repr,
)
def test_round_solids_agree_with_their_polygonal_meshes_up_to_the_facets(shape, rng):
    errors = errors_against_mujoco(shape, rng, most_missed=0.02)
    assert np.quantile(errors, 0.99) < 6e-5  # most on steep sides
    assert errors.max() < 7e-4  # at the rim


@every_shape
def test_the_triangles_of_a_solid_lie_on_its_surface_are_closed_and_face_outwards(name):
    shape = EXTENDED_SHAPES[name]
    vertices, faces = shape.triangles()
    shares = np.array([(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.5, 0.5, 0), (0.5, 0, 0.5), (0, 0.5, 0.5), (1 / 3,) * 3])
    points = np.einsum("sc,fci->isf", shares, vertices[faces]).reshape(3, -1)
    np.testing.assert_allclose(LEVEL[name](*points), 0.0, atol=FACETS)
    assert np.linalg.norm(points, axis=0).max() <= shape.bounding_radius + 1e-5
    assert 0.019 < shape.bounding_radius < 0.034  # sizes of the tables are alike
    assert are_star_shaped(vertices, faces) or name == "torus"
    found = examined(vertices, faces)
    assert (found.problem, found.remarks) == (None, ())
    assert np.array_equal(found.faces, faces)


@pytest.mark.parametrize("radius", [0.0002, 0.005, 0.05, 0.3])
def test_a_ball_of_any_size_is_right_to_what_a_pad_feels_and_no_finer(radius):
    vertices, faces = Sphere(radius).triangles()
    across = np.cross(*(vertices[faces[:, i]] - vertices[faces[:, 0]] for i in (1, 2)))
    nearest = np.abs((across * vertices[faces[:, 0]]).sum(axis=1)) / np.linalg.norm(across, axis=1)  # of each plane
    inside, outside = radius - nearest.min(), np.linalg.norm(vertices, axis=1).max() - radius
    assert 0.3 * TOLERANCE < inside < 1.01 * TOLERANCE
    assert outside == pytest.approx(TOLERANCE)


@pytest.mark.parametrize(
    ("shape", "origin", "direction", "expected"),
    [
        (Box((1, 2, 3)), (-3, 0, 0), (1, 0, 0), 2.0),
        (Cylinder(1.0, 2.0), (-5, 0, 1.9), (1, 0, 0), 4.0),
        (Cone(1.0, 2.0), (0, 0, -5), (0, 0, 1), 4.0),
        (Cone(1.0, 2.0), (0.5, 0, 5), (0, 0, -1), 5.0),
        (Frustum(2.0, 1.0, 2.0), (0, 0, 5), (0, 0, -1), 4.0),
        (Frustum(2.0, 1.0, 2.0), (1.5, 0, 5), (0, 0, -1), 5.0),
        (Capsule(1.0, 2.0), (0, 0, 9), (0, 0, -1), 6.0),
        (Dome(2.0), (0, 0, -5), (0, 0, 1), 4.0),
        (Dome(2.0), (-5, 0, -1.1), (1, 0, 0), np.inf),
        (Ellipsoid((1.0, 2.0, 3.0)), (0, 0, 5), (0, 0, -1), 2.0),
        (Wedge(3.0, 3.0, 1.0), (-5, 0, 0), (1, 0, 0), 4.0),
        (Prism(4, np.sqrt(2.0), 1.0), (-5, 0.5, 0), (1, 0, 0), 5 - np.sqrt(2.0) + 0.5),
        (Torus(2.0, 0.5), (0, 0, 5), (0, 0, -1), np.inf),
        (Torus(2.0, 0.5), (0, 0, 0), (1, 0, 0), 1.5),
    ],
)
def test_distances_by_hand(shape, origin, direction, expected):
    distance = entry(shape, np.array(origin, float)[:, None], np.array(direction, float))
    assert distance[0] == pytest.approx(expected, abs=2e-4)  # a hundred times as large as objects are


@pytest.mark.parametrize(
    "solid",
    [
        lambda sides: Frustum(0.02, 0.01, 0.02, sides - 1),
        lambda sides: Cone(0.02, 0.03, sides - 1),
        lambda sides: Dome(0.02, sides),
        lambda sides: Torus(0.02, 0.01, sides),
    ],
    ids=["frustum", "cone", "dome", "torus"],
)
def test_a_mesh_that_stands_for_a_round_solid_has_enough_sides(solid):
    assert np.ptp(solid(4).geom.vertices, axis=0).min() > 0.0
    with pytest.raises(ValueError, match="num_facets"):
        solid(3)


SOLIDS = [Sphere(1.0), Box((1.0, 2.0, 3.0)), Cylinder(1.0, 2.0), Cone(1.0, 2.0), Frustum(2.0, 1.0, 2.0)]
SOLIDS += [Capsule(1.0, 2.0), Dome(2.0), Ellipsoid((1.0, 2.0, 3.0)), Wedge(3.0, 3.0, 1.0), Prism(3, 1.0, 2.0)]
SOLIDS += [Torus(2.0, 0.5)]


@pytest.mark.parametrize("solid", SOLIDS, ids=lambda solid: type(solid).__name__)
@pytest.mark.parametrize("length", [np.nan, np.inf, -np.inf, 0.0, -1.0])
def test_every_length_of_a_solid_is_finite_and_above_zero(solid, length):
    for part in fields(solid):
        given = getattr(solid, part.name)
        if isinstance(given, tuple):
            wrong = [(*given[:axis], length, *given[axis + 1 :]) for axis in range(3)]
        else:
            wrong = [length] if isinstance(given, float) else []
        for value in wrong:
            if (part.name, value) == ("top_radius", 0.0):
                continue  # a cone
            with pytest.raises(ValueError, match="got"):
                replace(solid, **{part.name: value})


@pytest.mark.parametrize("make", [lambda: Box(0.02), lambda: Box((0.01, 0.02)), lambda: Ellipsoid(0.02)])
def test_a_box_and_an_ellipsoid_have_three_lengths(make):
    with pytest.raises(ValueError, match="must have 3 lengths"):
        make()


@every_shape
def test_a_shape_is_a_value(name):
    shape = EXTENDED_SHAPES[name]
    shape.triangles()  # fills whatever is cached
    twin = eval(repr(shape))  # the repr is complete
    assert (twin, hash(twin), repr(twin)) == (shape, hash(shape), repr(shape))
    assert pickle.loads(pickle.dumps(shape)) == shape
    assert len(repr(shape)) < 100


@pytest.mark.mujoco
@every_shape
def test_every_shape_compiles_into_a_scene_with_one_contact_pair(name):
    from activetouch.pressing.contact import Pad

    model = build_spec(Pad(), EXTENDED_SHAPES[name].geom, timestep=0.002).compile()
    assert (model.ngeom, model.njnt, model.nu, model.npair) == (2, 1, 1, 1)
