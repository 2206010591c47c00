"""The analytic height maps against MuJoCo's ray caster and against geometry done by hand."""

import mujoco
import numpy as np
import pytest

from activetouch.poses import random_orientation, to_matrix
from activetouch.rig import build_spec
from activetouch.shapes import SHAPES, Box, Cone, Cylinder, Sphere

every_shape = pytest.mark.parametrize("name", list(SHAPES))


def random_rays(rng, reach, n=400):
    """Parallel rays from a square outside any object, in a random direction of the object frame."""
    rotation = to_matrix(random_orientation(rng))
    starts = np.stack([np.full(n, -reach), *rng.uniform(-0.03, 0.03, size=(2, n))])
    return rotation.T @ starts, rotation.T[:, 0]


def mujoco_distance(shape, origins, direction):
    """Distances by mj_ray on the shape's own collision geom; inf where the ray misses."""
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
    distances = [mujoco.mj_ray(model, data, o, direction, None, 1, -1, hit, None) for o in origins.T]
    return np.array([d if d >= 0 else np.inf for d in distances])


def errors_against_mujoco(shape, rng, most_missed):
    """Differences on rays both hit; rays only one of them hits may only be grazing ones, at most this share."""
    errors = []
    for _ in range(10):
        origins, direction = random_rays(rng, 0.06)
        ours, theirs = shape.entry_distance(origins, direction), mujoco_distance(shape, origins, direction)
        hit = np.isfinite(ours) & np.isfinite(theirs)
        assert (np.isfinite(ours) != np.isfinite(theirs)).mean() < most_missed
        errors.append(np.abs(ours[hit] - theirs[hit]))
    return np.concatenate(errors)


@pytest.mark.mujoco
@pytest.mark.parametrize("name", ["sphere", "cube", "cylinder"])
def test_primitives_agree_with_mujocos_rays_to_a_micrometre(name, rng):
    assert errors_against_mujoco(SHAPES[name], rng, most_missed=0.005).max() < 1e-6


@pytest.mark.mujoco
def test_the_round_cone_agrees_with_its_polygonal_mesh_up_to_the_facets(rng):
    errors = errors_against_mujoco(Cone(0.018, 0.036, num_facets=512), rng, most_missed=0.02)
    assert np.quantile(errors, 0.99) < 2e-5
    assert errors.max() < 7e-4  # at the rim


@every_shape
def test_every_ray_that_enters_meets_the_surface(name, rng):
    shape = SHAPES[name]
    origins, direction = random_rays(rng, 0.06)
    distance = shape.entry_distance(origins, direction)
    points = (origins + distance * direction[:, None])[:, np.isfinite(distance)]
    radius = np.hypot(points[0], points[1])
    residual = {
        "sphere": lambda: np.linalg.norm(points, axis=0) - 0.020,
        "cube": lambda: np.abs(points).max(axis=0) - 0.016,
        "cylinder": lambda: np.maximum(radius - 0.016, np.abs(points[2]) - 0.020),
        "cone": lambda: np.maximum((radius - 0.5 * (0.018 - points[2])), -points[2] - 0.018),
    }[name]()
    assert points.shape[1] > 50
    np.testing.assert_allclose(residual, 0.0, atol=1e-12)


@every_shape
def test_no_point_lies_outside_the_bounding_radius(name, rng):
    shape = SHAPES[name]
    origins, direction = random_rays(rng, 0.06)
    distance = shape.entry_distance(origins, direction)
    points = (origins + distance * direction[:, None])[:, np.isfinite(distance)]
    assert np.linalg.norm(points, axis=0).max() <= shape.bounding_radius + 1e-12


@pytest.mark.parametrize(
    ("shape", "origin", "direction", "expected"),
    [
        (Sphere(1.0), (-3, 0, 0), (1, 0, 0), 2.0),
        (Sphere(1.0), (-3, 1.1, 0), (1, 0, 0), np.inf),
        (Box((1, 2, 3)), (-3, 0, 0), (1, 0, 0), 2.0),
        (Box((1, 2, 3)), (-3, 2.1, 0), (1, 0, 0), np.inf),
        (Cylinder(1.0, 2.0), (0, 0, -5), (0, 0, 1), 3.0),
        (Cylinder(1.0, 2.0), (-5, 0, 1.9), (1, 0, 0), 4.0),
        (Cylinder(1.0, 2.0), (-5, 0, 2.1), (1, 0, 0), np.inf),
        (Cone(1.0, 2.0), (0, 0, -5), (0, 0, 1), 4.0),
        (Cone(1.0, 2.0), (0, 0, 5), (0, 0, -1), 4.0),
        (Cone(1.0, 2.0), (0.5, 0, 5), (0, 0, -1), 5.0),
        (Cone(1.0, 2.0), (-5, 0, 0), (1, 0, 0), 4.5),
        (Cone(1.0, 2.0), (-5, 0, 1.1), (1, 0, 0), np.inf),
    ],
)
def test_distances_by_hand(shape, origin, direction, expected):
    distance = shape.entry_distance(np.array(origin, float)[:, None], np.array(direction, float))
    assert distance[0] == pytest.approx(expected)


@pytest.mark.mujoco
@every_shape
def test_every_shape_compiles_into_a_scene_with_one_contact_pair(name):
    from activetouch.pad import Pad

    model = build_spec(Pad(), SHAPES[name], timestep=0.002).compile()
    assert (model.ngeom, model.njnt, model.nu) == (2, 1, 1)
