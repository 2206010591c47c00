"""Mesh files as people name them: one name and one scale each, and files that are called alike."""

import re
import warnings

import numpy as np
import pytest

from activetouch.distributions import Constant
from activetouch.errors import BadMesh, DuplicateShape, MeshWarning
from activetouch.mesh_source import MeshSource, read_meshes
from activetouch.scene import Dynamic, Quasistatic, Scene, Variation
from belief.errors import InvalidArgument

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.012  # a cube of 24 mm
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = [triangle for a, b, c, d in QUADS for triangle in ((a, b, c), (a, c, d))]
TWICE = FACES + [tuple(i + 8 for i in face) for face in FACES]


@pytest.fixture
def folder(tmp_path):
    """Small files, one for each fault that files of other people have."""

    def write(name, vertices, faces):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        lines = ["v {:.12g} {:.12g} {:.12g}\n".format(*vertex) for vertex in vertices]
        lines += ["f {} {} {}\n".format(*(i + 1 for i in face)) for face in faces]
        (tmp_path / name).write_text("".join(lines))

    write("two.obj", np.vstack([CUBE, CUBE * 0.6 + [0.012, 0, 0]]), TWICE)
    write("hollow.obj", np.vstack([CUBE, CUBE * 0.5]), FACES + [tuple(i + 8 for i in face[::-1]) for face in FACES])
    write("hole.obj", CUBE, FACES[1:])
    write("edge.obj", np.vstack([CUBE, CUBE + np.array([0.024, 0.024, 0])]), TWICE)
    write("pencil.obj", CUBE * [17 / 2, 0.3, 0.3], FACES)
    write("a_mm.obj", CUBE * 1000, FACES)
    write("b_m.obj", CUBE * 0.9, FACES)
    write("inch.obj", CUBE / 0.0254, FACES)
    write("mug/model.obj", CUBE, FACES)
    write("box/model.obj", CUBE * 0.8, FACES)
    write("cube.obj", CUBE * 0.9, FACES)
    write("at=@0.5.obj", CUBE, FACES)
    return tmp_path


def size(mesh):
    return np.ptp(mesh.vertices, axis=0).round(9).tolist()


@pytest.mark.parametrize(
    ("name", "said", "extent"),
    [
        ("two.obj", "2 separate surfaces, which are felt as their union", [0.0312, 0.024, 0.024]),
        ("hollow.obj", None, [0.024] * 3),
        ("hole.obj", r"3 open edges; 8\.\d% of \d+ rays from outside first meet the inside", [0.024] * 3),
        ("edge.obj", "1 edges of more than two triangles", [0.048, 0.048, 0.024]),
        ("pencil.obj", None, [0.204, 0.0072, 0.0072]),
        (
            "a_mm.obj",
            r"read in millimetres \(24 × 24 × 24 mm\).*write a_mm\.obj@0\.001, or @0\.001",
            [0.024] * 3,
        ),
        ("b_m.obj", None, [0.0216] * 3),
        ("inch.obj@0.0254", None, [0.024] * 3),
    ],
)
def test_a_file_is_read_and_what_is_unusual_is_said_once(name, said, extent, folder):
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        [mesh] = read_meshes(folder / name).values()
    assert size(mesh) == pytest.approx(extent, abs=1e-9)
    assert len(told) == (said is not None)
    if said is not None:
        with pytest.warns(MeshWarning, match=said):
            read_meshes(folder / name)


@pytest.mark.parametrize(
    ("radius", "said"),
    [
        (0.001, "read in metres, its farthest point is 1 mm .* unusual; .*: 1 if it is in metres$"),
        (0.2, "is 200 mm .* unusual; .*: 0.01 if .* centimetres, or 0.0254 if .* inches, or 1 if it is in metres$"),
        (20.0, "in millimetres .* Its scale is 0.001 if it is in millimetres, or 0.01 if it is in centimetres$"),
        (200.0, r"in millimetres .* write b\.obj@0\.001.* Its scale is 0.001 if it is in millimetres$"),
        (0.003, None),
        (0.14, None),
    ],
)
def test_an_unusual_size_is_read_with_advice_that_names_all_units_that_fit(radius, said, tmp_path):
    lines = ["v {:.12g} {:.12g} {:.12g}".format(*vertex) for vertex in CUBE * radius / np.linalg.norm(CUBE[0])]
    lines += ["f {} {} {}".format(*(i + 1 for i in face)) for face in FACES]
    (tmp_path / "b.obj").write_text("\n".join(lines))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        [mesh] = read_meshes(tmp_path / "b.obj").values()
    assert mesh.bounding_radius == pytest.approx(radius if radius < 1 else radius / 1000)
    assert bool(told) == (said is not None)
    for one in told:
        assert re.search(said, str(one.message))
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # nothing is said of a scale that is given
        read_meshes(f"{tmp_path}/b.obj@{1.0 if radius < 1 else 0.001}")
    with pytest.raises(BadMesh, match=r"0\.3 m.*Give its scale: .*metres"):
        read_meshes(f"{tmp_path}/b.obj@{400 / radius}")  # advice is about the unit of the file


def test_files_of_different_units_are_read_in_one_call(folder):
    with pytest.warns(MeshWarning, match="a_mm.obj: read in millimetres"):
        meshes = read_meshes(folder / "a_mm.obj", folder / "b_m.obj")
    assert [size(mesh)[0] for mesh in meshes.values()] == pytest.approx([0.024, 0.0216])
    meshes = read_meshes(folder / "a_mm.obj", f"{folder}/b_m.obj@1", scale=0.001)
    assert [size(mesh)[0] for mesh in meshes.values()] == pytest.approx([0.024, 0.0216])
    with pytest.raises(BadMesh, match=r"0\.01 if it is in centimetres, or 0\.0254 if it is in inches"):
        read_meshes(f"{folder}/inch.obj@2.5")


def test_names_are_given_or_those_of_the_files_or_of_their_folders(folder):
    sources = ("mug/model.obj", "box/model.obj", "cup=cube.obj", "big=b_m.obj@1.5")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        meshes = read_meshes(*sources)
        assert read_meshes("mug/model.obj").keys() == {"model"}
        assert read_meshes("mug", "big=box@1.5").keys() == {"model", "big"}
        (folder / "empty").mkdir()
        with pytest.raises(InvalidArgument, match="no mesh file in empty"):
            read_meshes("empty")
        with pytest.raises(DuplicateShape, match=r"is given twice, .* my_model=mug/model\.obj"):
            read_meshes("mug/model.obj", "mug/model.obj")
        with pytest.raises(DuplicateShape, match=r"must have other names than mug, .* my_mug=\S*mug/model\.obj"):
            read_meshes("mug/model.obj", "box/model.obj", "mug=cube.obj")
        with pytest.raises(DuplicateShape, match="must have other names than cup"):
            read_meshes("cup=mug/model.obj", "cup=box/model.obj")
    assert list(meshes) == ["mug", "box", "cup", "big"]
    assert size(meshes["big"])[0] == pytest.approx(0.0324)


@pytest.mark.parametrize("scale", ["mm", "", "0x1"])
def test_a_scale_that_is_no_number_is_refused(scale, folder):
    with pytest.raises(InvalidArgument, match=r"after @ there must be metres per unit, such as 0\.001 for millimetres"):
        MeshSource.parse(f"{folder}/cube.obj@{scale}")


@pytest.mark.parametrize("scale", ["0", "-1", "nan", "inf"])
def test_a_scale_that_makes_no_object_is_refused(scale, folder):
    with pytest.raises(InvalidArgument, match="scale must be positive and finite"):
        read_meshes(f"{folder}/cube.obj@{scale}")


@pytest.mark.mujoco
@pytest.mark.parametrize("press_model", [Quasistatic(), Dynamic()], ids=["quasistatic", "dynamic"])
def test_an_object_much_larger_than_the_pad_is_pressed(press_model, folder, rng):
    scene = Scene(
        shapes={"pencil": folder / "pencil.obj", "can": f"{folder}/cube.obj@15"},
        press_model=press_model,
        variation=Variation(size=Constant(1.0)),
    )
    assert scene.solids["can"].bounding_radius == pytest.approx(0.28, abs=0.01)
    for label in scene.shape_labels:
        pressed = scene.press(scene.sample_object(label, rng), "front", rng)
        assert 1.0 < pressed.contact.force < 3.5
        assert pressed.ideal.max() > 0.05
