"""Objects from mesh files: the same touches as the true solids, MuJoCo's rays, and refusals that say why."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from activetouch.poses import Placement, random_orientation, to_matrix
from activetouch.pressing.contact import Pad, surface_gap
from activetouch.shapes import BadMesh, Mesh, Torus
from tests.rays import entry

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.016
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
CUBE_FACES = np.array([triangle for a, b, c, d in QUADS for triangle in ((a, b, c), (a, c, d))])
CUBE = Mesh("cube", CORNERS, CUBE_FACES)


def turned(profile, num_sides=24):
    """A solid of revolution about the z axis from its profile of (radius, z), the first and last on the axis."""
    mesh = trimesh.creation.revolve(np.array(profile), sections=num_sides)
    return Mesh("turned", mesh.vertices, mesh.faces)


CUP = turned([(0, -0.016), (0.014, -0.016), (0.018, 0.016), (0.015, 0.016), (0.011, -0.012), (0, -0.012)])


def random_rays(rng, n=400):
    rotation = to_matrix(random_orientation(rng))
    starts = np.stack([np.full(n, -0.06), *rng.uniform(-0.03, 0.03, size=(2, n))])
    return rotation.T @ starts, rotation.T[:, 0]


def mesh_of_torus(torus, num_sections):
    mesh = trimesh.creation.torus(torus.ring_radius, torus.tube_radius, 2 * num_sections, num_sections)
    return Mesh("torus", mesh.vertices, mesh.faces)


def test_a_mesh_leaves_the_image_of_the_solid_it_describes(rng):
    mesh = mesh_of_torus(Torus(0.016, 0.007), 128)
    placement = Placement(Torus(0.016, 0.007), 1.1, random_orientation(rng))
    true, facetted = surface_gap(Pad(), placement), surface_gap(Pad(), replace(placement, shape=mesh))
    felt = true < 0.002
    assert felt.sum() > 100
    np.testing.assert_allclose(facetted[felt], true[felt], atol=6e-5)


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply"])
def test_a_file_gives_the_mesh_about_its_centre_of_mass(suffix, tmp_path, rng):
    path = tmp_path / f"cup.{suffix}"
    trimesh.Trimesh(CUP.vertices * 1000 + [300, -20, 50], CUP.faces, process=False).export(path)
    mesh = Mesh.from_file(path, scale=0.001)
    centre = trimesh.Trimesh(CUP.vertices, CUP.faces).center_mass
    assert len(mesh.faces) == len(CUP.faces)
    origins, direction = random_rays(rng)
    expected = entry(CUP, origins + centre[:, None], direction)
    actual = entry(mesh, origins, direction)
    assert (np.isfinite(actual) != np.isfinite(expected)).sum() <= 1
    both = np.isfinite(actual) & np.isfinite(expected)
    assert np.quantile(np.abs(actual[both] - expected[both]), 0.98) < 1e-5


def test_a_surface_turned_inside_out_wholly_or_in_part_is_put_right(tmp_path, rng):
    origins, direction = random_rays(rng)
    expected = entry(CUBE, origins, direction)
    for wrong in (slice(None), slice(3, 7)):
        faces = CUBE_FACES.copy()
        faces[wrong] = faces[wrong, ::-1]
        path = tmp_path / "cube.stl"
        trimesh.Trimesh(CORNERS, faces, process=False).export(path)
        np.testing.assert_allclose(entry(Mesh.from_file(path), origins, direction), expected, atol=1e-5)


def test_materials_and_other_files_that_a_file_names_are_not_opened(tmp_path):
    path = tmp_path / "cube.obj"
    text = trimesh.Trimesh(CORNERS, CUBE_FACES, process=False).export(file_type="obj")
    path.write_text("mtllib trap.mtl\nusemtl gold\n" + text)
    (tmp_path / "trap.mtl").mkdir()  # to open it would fail
    assert len(Mesh.from_file(path).faces) == 12


@pytest.mark.parametrize(
    ("vertices", "faces", "problem"),
    [
        (CORNERS, np.zeros((0, 3), int), "no triangles"),
        (CORNERS, CUBE_FACES[2:], r"4 open edges; 16\.\d% of \d+ rays from outside first meet the inside, 10%"),
        (CORNERS, CUBE_FACES[:2], "it is flat"),
        (CORNERS, CUBE_FACES[2:4], "it is flat"),
        (CORNERS * [1, 1, 0.5], CUBE_FACES[4:8], "sheet without thickness, or has large holes"),
        (CORNERS * np.nan, CUBE_FACES, "not finite"),
        (CORNERS, CUBE_FACES + 1, "not among the 8"),
        (CORNERS * [1, 1, 0], CUBE_FACES, "no volume"),
        (CORNERS * 1e103, CUBE_FACES, "not finite"),
    ],
)
def test_triangles_that_bound_no_solid_are_refused(vertices, faces, problem):
    with pytest.raises(BadMesh, match=f"thing: .*{problem}"):
        Mesh("thing", vertices, faces)


@pytest.mark.parametrize(
    ("factor", "advice"),
    [
        (300, r"8\.314 m .* metres.*scale: 0\.001 if it is in millimetres, or 0\.01 if it is in centimetres"),
        (1 / 0.0254, r"1\.091 m .* scale: .* or 0\.0254 if it is in inches.*cube\.stl@0\.01 on the command line"),
        (
            1 / 0.0254,
            r"scale: 0\.001 if it is in millimetres, or 0\.01 if .* centimetres, or 0\.0254 if it is in inches;",
        ),
        (0.01, r"0\.0002771 m .* Lengths are in metres.*scale: no usual unit fits, but 1\.8 to 1\.1e\+03 would"),
        (30_000, r"831\.4 m .* scale: no usual unit fits, but 6e-07 to 0\.00036 would"),
    ],
)
def test_an_absurd_size_is_refused_with_the_scale_that_may_mend_it(factor, advice, tmp_path):
    path = tmp_path / "cube.stl"
    trimesh.Trimesh(CORNERS * factor, CUBE_FACES, process=False).export(path)
    with pytest.raises(BadMesh, match=f"cube.stl: .*{advice}"):
        Mesh.from_file(path)
    assert Mesh.from_file(path, scale=1 / factor).bounding_radius == pytest.approx(CUBE.bounding_radius)


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("empty.stl", b"", "it is empty"),
        ("empty.obj", b"# nothing\n", "no triangles"),
        ("noise.stl", bytes(range(256)) * 4, "(cannot be read as STL|no triangles)"),
        ("noise.ply", b"ply\nformat nonsense\n", "cannot be read as PLY"),
        ("words.obj", b"v one two three\nf 1 2 3\n", "cannot be read as OBJ"),
        ("points.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no triangles"),
        ("nan.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n", "not finite"),
        ("vast.obj", b"v 1e300 0 0\nv 1e300 1e300 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n", "finite"),
        ("far.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "cannot be read as OBJ"),
        ("part.step", b"ISO-10303-21;", r"read from \.stl, \.obj"),
    ],
)
def test_a_file_that_holds_no_mesh_is_refused_by_name(name, content, problem, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(BadMesh, match=f"{name}: .*{problem}"):
        Mesh.from_file(tmp_path / name)


@pytest.mark.parametrize("scale", [0.0, -1.0, np.nan, np.inf])
def test_a_scale_that_is_none_is_refused(scale, tmp_path):
    with pytest.raises(ValueError, match="scale must be positive"):
        Mesh.from_file(tmp_path / "cube.stl", scale=scale)
