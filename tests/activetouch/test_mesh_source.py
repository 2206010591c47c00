"""Mesh files as people name them: one name and one scale each, and files that are called alike."""

import os
import re
import shlex
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh

from activetouch.distributions import Constant
from activetouch.errors import BadMesh, DuplicateShape, MeshWarning
from activetouch.mesh_source import MeshSource, labelled_sources, read_files, read_meshes
from activetouch.scene import Dynamic, Quasistatic, Scene, Variation
from activetouch.solids.mesh_file import conversion
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
    assert size(mesh) == pytest.approx(extent, abs=1e-5)
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


def test_a_body_ten_times_as_large_as_most_others_may_be_in_another_unit(tmp_path):
    for name, edge in {"a": 3.0, "b": 2.5, "c": 2.0, "mm": 27.0}.items():  # three in centimetres
        lines = ["v {:.12g} {:.12g} {:.12g}".format(*vertex) for vertex in CUBE * edge / np.ptp(CUBE[:, 0])]
        lines += ["f {} {} {}".format(*(i + 1 for i in face)) for face in FACES]
        (tmp_path / f"{name}.obj").write_text("\n".join(lines))
    with pytest.warns(MeshWarning, match=r"mm\.obj: .* is 234 mm .* others 21.7 mm: .* Read with @0.001, .* 23.4 mm$"):
        read_meshes(f"{tmp_path}@0.01")
    read_meshes(*(f"{tmp_path}/{name}.obj@0.01" for name in "abc"), f"{tmp_path}/mm.obj@0.001")


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
        assert list(read_meshes("mug/model.obj", "box/model.obj", "mug=cube.obj")) == ["mug/model", "box/model", "mug"]
        with pytest.raises(DuplicateShape, match="must have other names than cup"):
            read_meshes("cup=mug/model.obj", "cup=box/model.obj")
    assert list(meshes) == ["mug", "box", "cup", "big"]
    assert size(meshes["big"])[0] == pytest.approx(0.0324)


@pytest.mark.parametrize(
    ("names", "labels"),
    [
        (["mug.obj", "mug.stl", "cup.obj"], ["cup", "mug.obj", "mug.stl"]),
        (["mug.obj", "mug.OBJ"], ["mug.OBJ", "mug.obj"]),
        (["cup/model.obj", "saucer/model.obj"], ["cup", "saucer"]),
        (["cup/model.obj", "saucer/cup.obj"], ["model", "cup"]),
        (["cup/model.obj", "saucer/model.obj", "x/cup.obj"], ["cup/model", "saucer/model", "cup"]),
        (["a/mug.obj", "a/mug.stl", "b/mug.obj"], ["a/mug.obj", "a/mug.stl", "b/mug.obj"]),
        (["a/x/mug.obj", "b/x/mug.obj"], ["a/x/mug", "b/x/mug"]),
        (["a/x/mug.obj", "a/x/mug.stl", "b/x/mug.obj"], ["a/x/mug.obj", "a/x/mug.stl", "b/x/mug.obj"]),
        (["mug/a.obj", "mug/b/a.obj", "mug/b/c/a.obj"], ["mug", "b", "c"]),
        (["mug.obj", "mug.obj.obj", "mug.stl"], ["folder0/mug.obj", "mug.obj", "folder0/mug.stl"]),
        (["a/b.obj", "c/b.obj", "d/a.obj", "e/a.obj"], ["a/b", "c/b", "d", "e"]),
    ],
)
def test_no_file_of_a_folder_is_lost_to_another_of_its_name(names, labels, tmp_path):
    folder = tmp_path / "folder0"
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("")
    found, left_out = labelled_sources(folder)
    assert list(found) == labels
    assert len({source.path for source in found.values()}) == len(names)
    assert left_out == []
    assert labelled_sources(folder)[0] == found
    one_by_one, _ = labelled_sources(*(source.path for source in found.values()))
    assert list(one_by_one) == labels


OTHER_FORMATS = ["step", "stp", "fbx", "blend", "usd", "usdz", "wrl", "x3d"]


def test_what_a_folder_has_and_is_not_read_is_said_line_by_line(folder, tmp_path):
    (folder / "dangling.stl").symlink_to("nowhere.stl")
    (folder / "loop.stl").symlink_to("loop.stl")
    (folder / "link.obj").symlink_to("cube.obj")
    (folder / "linked").symlink_to("mug")
    (folder / "damaged.ply").write_text("ply\n")
    (folder / "texture.png").write_text("")
    (folder / "cube.mtl").write_text("")
    with open(os.fsencode(folder / "caf") + b"\xe9.obj", "w"):
        pass
    for ending in OTHER_FORMATS:
        (folder / f"my mug.{ending.upper()}").write_text("")
    with pytest.warns(MeshWarning) as said:
        meshes = read_meshes(folder)
    assert sum("left out" in str(one.message) for one in said) == 10  # and how many more there are
    assert f"and {len(OTHER_FORMATS) + 7 - 10} more files" in [str(one.message) for one in said]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshWarning)
        again, lines = read_files(folder)
    assert list(again) == list(meshes)
    assert {"cube", "mug", "box"} <= meshes.keys()
    assert len(lines) == len(OTHER_FORMATS) + 7

    def line(name):
        [found] = [one for one in lines if one.startswith(f"{folder}/{name} is left out: ")]
        return found

    assert "or 0.0254 if it is in inches; that is inch.obj@0.01 on" in line("inch.obj")
    assert line("dangling.stl").endswith("it is a link to nowhere.stl, which does not exist")
    assert line("loop.stl").endswith("it is a link to loop.stl, which does not exist")
    assert line("link.obj").endswith(f"it is the same file as {folder}/cube.obj")
    assert line("linked").endswith("it is a link to a folder; name that, too")
    assert line("damaged.ply").endswith("cannot be read as PLY: it has no header from 'ply' to 'end_header'")
    assert line("caf\\xe9.obj").endswith("its name is not UTF-8; rename it")
    for ending in OTHER_FORMATS:
        words = line(f"my mug.{ending.upper()}").partition(": ")[2]
        assert words.startswith(f"{ending.upper()} is not read; ")
        assert ("python -c" in words) == (ending in ("step", "stp"))
    with pytest.raises(BadMesh, match=r"read from \.stl, .* files; STEP is not read; .* '\S*/my mug\.STEP'$"):
        read_meshes(folder / "my mug.STEP")
    (tmp_path / "only").mkdir()
    (tmp_path / "only" / "mug.step").write_text("")
    with pytest.raises(
        InvalidArgument, match=r"(?s)no mesh file in .*only; they end in .*\n- \S*mug.step is left out: STEP"
    ):
        read_meshes(tmp_path / "only")


def test_a_file_name_that_is_not_utf_8_is_refused_before_the_file_is_read(tmp_path):
    path = os.fsdecode(os.fsencode(tmp_path / "caf") + b"\xe9.obj")
    for given in (path, Path(path)):
        with pytest.raises(InvalidArgument, match=r"caf\\xe9\.obj is left out: its name is not UTF-8; rename it"):
            read_meshes(given)


@pytest.mark.parametrize("ending", ["glb"])
def test_the_line_about_another_format_writes_a_file_that_is_read(ending, tmp_path, monkeypatch):
    path = tmp_path / f"my 'mug'.{ending}"
    trimesh.Trimesh(CUBE, FACES).export(path)
    line = conversion(path)
    assert line.startswith(f"{ending.upper()} is not read; pip install trimesh, then this writes {path.name}.stl: ")
    python, option, code, given = shlex.split(line.partition(".stl: ")[2])
    assert (python, option) == ("python", "-c")
    monkeypatch.setattr(sys, "argv", [option, given])
    exec(code, {})
    [mesh] = read_meshes(f"{path}.stl").values()
    assert size(mesh) == pytest.approx([0.024] * 3, abs=1e-5)


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


def test_a_file_that_leads_to_itself_is_not_there(tmp_path):
    (tmp_path / "loop.stl").symlink_to(tmp_path / "loop.stl")
    with pytest.raises(FileNotFoundError, match="there is no mesh file"):
        read_meshes(tmp_path / "loop.stl")
