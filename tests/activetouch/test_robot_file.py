"""Links of URDF and bodies of MJCF files are objects of the size that MuJoCo gives them."""

import re
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest

from activetouch.errors import BadMesh, DuplicateShape, MeshWarning
from activetouch.mesh_source import MeshSource, labelled_sources, read_files, read_meshes
from activetouch.robot_file import read_link, read_robot
from activetouch.scene import Scene
from activetouch.solids.primitives import Box
from belief.errors import InvalidArgument

CORNERS = [(x, y, z) for x in (0, 1) for y in (0, 2) for z in (0, 3)]
QUADS = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
BLOCK = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS) + "".join(f"f {a} {b} {c} {d}\n" for a, b, c, d in QUADS)
MJCF = """<mujoco><compiler meshdir="assets" eulerseq="zyx"/>
<default><geom group="0"/><mesh scale=".01 .01 .02"/><default class="thin"><geom type="capsule" size=".004"/>
<default class="thick"><geom size=".008 .02"/></default></default></default>
<asset><mesh file="block.obj"/><mesh name="turned" file="block.obj" scale=".01 .02 .01" refpos=".1 0 0"
 refquat="1 1 0 0"/><mesh name="points" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>
<worldbody><geom type="plane" size="1 1 1"/>
<body name="palm" childclass="thin"><geom type="mesh" mesh="block"/>
 <geom class="main" type="box" size="1 1 1" group="3"/>
 <body name="finger"><geom fromto="0 0 0 .02 .01 .03"/>
  <geom type="ellipsoid" size=".01 .02 .03" euler="20 30 40"/></body>
 <body name="thumb"><frame pos=".01 0 0" euler="0 90 0"><geom class="thick" axisangle="1 1 0 30" pos="0 .03 0"/>
  <geom class="main" type="cylinder" size=".01 .02" zaxis="0 1 1"/></frame></body></body>
<body name="other"><geom type="mesh" mesh="turned"/><geom type="box" size=".01 .02 .03" xyaxes="1 1 0 -1 1 0"/></body>
<body name="hull"><geom type="mesh" mesh="points" quat="1 2 3 4" group="3"/><geom fromto="0 0 0 0 0 -.02" type="box"
 size=".01" group="4"/></body>
</worldbody></mujoco>"""
URDF = """<?xml version="1.0"?><robot name="arm">
<link name="base"><visual><origin xyz=".01 0 0" rpy=".1 .2 .3"/><geometry>
 <mesh filename="package://arm/meshes/block.obj" scale=".01 .02 .01"/></geometry></visual>
 <collision><geometry><box size="9 9 9"/></geometry></collision></link>
<link name="rod">
 <collision><origin rpy="1.5 0 0"/><geometry><cylinder radius=".01" length=".06"/></geometry></collision>
 <collision><geometry><sphere radius=".012"/></geometry></collision>
 <collision><geometry><box size=".02 .02 .04"/></geometry></collision></link>
<link name="frame"/>
<joint name="j" type="fixed"><parent link="base"/><child link="rod"/></joint>
<joint name="k" type="fixed"><parent link="base"/><child link="frame"/></joint></robot>"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "arm" / "urdf").mkdir(parents=True)
    (tmp_path / "arm" / "meshes").mkdir()
    (tmp_path / "hand" / "assets").mkdir(parents=True)
    for name in ("arm/meshes", "hand/assets"):
        (tmp_path / name / "block.obj").write_text(BLOCK)
    (tmp_path / "arm" / "urdf" / "arm.urdf").write_text(URDF)
    (tmp_path / "hand" / "hand.xml").write_text(MJCF)
    (tmp_path / "package.xml").write_text("<package/>")
    return tmp_path


def sizes(model):
    """Extents of the shown geoms of each body in its frame [m], from MuJoCo."""
    found = {}
    for body in range(1, model.nbody):
        geoms = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] == body]
        points = []
        for geom in [geom for geom in geoms if model.geom_group[geom] < 3] or geoms:
            turned = np.zeros(9)
            mujoco.mju_quat2Mat(turned, model.geom_quat[geom])
            turned, size = turned.reshape(3, 3), model.geom_size[geom]
            across = np.linalg.norm(turned[:, :2], axis=1)
            half = {
                mujoco.mjtGeom.mjGEOM_SPHERE: size[[0, 0, 0]],
                mujoco.mjtGeom.mjGEOM_BOX: np.abs(turned) @ size,
                mujoco.mjtGeom.mjGEOM_CAPSULE: np.abs(turned[:, 2]) * size[1] + size[0],
                mujoco.mjtGeom.mjGEOM_CYLINDER: np.abs(turned[:, 2]) * size[1] + across * size[0],
                mujoco.mjtGeom.mjGEOM_ELLIPSOID: np.sqrt(turned**2 @ size**2),
            }.get(mujoco.mjtGeom(model.geom_type[geom]))
            corners = np.array([-1, 1])[:, None] * half if half is not None else None
            if corners is None:
                mesh = model.geom_dataid[geom]
                start = model.mesh_vertadr[mesh]
                corners = model.mesh_vert[start : start + model.mesh_vertnum[mesh]] @ turned.T
            points += [corners.min(axis=0) + model.geom_pos[geom], corners.max(axis=0) + model.geom_pos[geom]]
        if points:
            found[model.body(body).name] = np.ptp(points, axis=0)
    return found


def test_bodies_have_the_sizes_that_mujoco_compiles(folder):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshWarning)
        meshes, left_out = read_files(f"{folder / 'hand' / 'hand.xml'}")
    expected = sizes(mujoco.MjModel.from_xml_path(str(folder / "hand" / "hand.xml")))
    assert meshes.keys() == expected.keys() - {"hull"} | {"hull"}
    for name, mesh in meshes.items():
        assert np.ptp(mesh.vertices, axis=0) == pytest.approx(expected[name], abs=3e-5), name
    assert [line.partition(": ")[2] for line in left_out] == ["a geom of world: a plane of no mesh is not read"]


@pytest.mark.parametrize(
    ("defaults", "geom"),
    [
        ('<default><geom type="box" size=".01 .02 .03"/></default><default><geom group="1"/></default>', ""),
        ('<default><geom type="box" size=".01 .02 .03"/></default><default><geom size=".02"/></default>', ""),
        ('<default><geom type="box" size=".01 .02 .03"/></default>', 'size=".03 .01"'),
        ('<default><geom euler="90 0 0"/></default>', 'type="box" size=".01 .02 .03" quat="1 0 0 .5"'),
        ('<default><geom euler="90 0 0"/></default>', 'type="box" size=".01 .02 .03" axisangle="1 0 0 30"'),
        ('<default><geom zaxis="0 1 1"/></default>', 'type="box" size=".01" fromto=".01 0 0 .09 0 .01"'),
        ('<asset><mesh file="block.obj" scale=".01 .01 .01"/></asset>', 'type="mesh" mesh="block" zaxis="0 0 -1"'),
    ],
)
def test_what_geoms_inherit_is_what_mujoco_compiles(defaults, geom, folder):
    path = folder / "hand" / "assets" / "one.xml"
    path.write_text(
        f'<mujoco>{defaults}<worldbody><body name="one"><geom {geom}/><geom type="box" size=".005 .005 .005" '
        'pos=".02 .03 .04" quat="1 0 0 0"/></body></worldbody></mujoco>'
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshWarning)
        extents = np.ptp(read_meshes(path)["one"].vertices, axis=0)
    expected = sizes(mujoco.MjModel.from_xml_path(str(path)))["one"]
    assert extents == pytest.approx(expected, abs=3e-5)


def test_a_root_class_of_another_name_is_that_of_all_geoms(tmp_path):  # as older MuJoCos had it
    (tmp_path / "old.xml").write_text(
        '<mujoco><default class="b"><geom type="box" size=".01 .02 .03"/></default><worldbody><geom/>'
        '<geom class="b"/></worldbody></mujoco>'
    )
    pieces = read_robot(tmp_path / "old.xml").pieces["world"]
    assert [piece.source for piece in pieces] == [Box((0.01, 0.02, 0.03))] * 2


def test_links_have_the_sizes_that_mujoco_compiles(folder):
    text = URDF.replace("package://arm", str(folder / "arm"))
    option = '<mujoco><compiler discardvisual="false" strippath="false" fusestatic="false"/></mujoco>'
    text = text.replace('<robot name="arm">', f'<robot name="arm">{option}')
    text = text.replace('<collision><geometry><box size="9 9 9"/></geometry></collision>', "")
    expected = sizes(mujoco.MjModel.from_xml_string(text))
    with pytest.warns(MeshWarning, match="3 separate surfaces"):
        meshes = read_meshes(folder / "arm")
    assert meshes.keys() == {"base", "rod"}  # and not the mesh file, which the robot names
    for name, mesh in meshes.items():
        assert np.ptp(mesh.vertices, axis=0) == pytest.approx(expected[name], abs=3e-5), name


def test_packages_are_named_with_two_slashes_or_three(folder):
    three = folder / "arm" / "urdf" / "three.urdf"
    three.write_text(URDF.replace("package://arm", "package:///name_of_arm"))
    assert read_link(three, folder, "base") == read_link(folder / "arm" / "urdf" / "arm.urdf", folder, "base")


def test_a_package_is_looked_for_by_its_name_first(folder):
    (folder / "hand" / "block.obj").write_text(BLOCK.replace("v 1", "v 0.1"))
    (folder / "arm" / "block.obj").write_text(BLOCK)  # nearer, but of another package
    other = folder / "arm" / "other.urdf"
    other.write_text(one_link('<mesh filename="package://hand/block.obj" scale=".01 .01 .01"/>'))
    assert np.ptp(read_link(other, folder, "a").vertices, axis=0) == pytest.approx([0.001, 0.02, 0.03])


def test_what_an_included_file_declares_is_left_out_and_the_rest_is_read(tmp_path):
    (tmp_path / "hand.xml").write_text(
        '<mujoco><include file="shared.xml"/><asset><mesh class="far" file="block.obj"/></asset><worldbody>'
        '<body name="palm"><geom type="box" size=".01 .02 .03"/></body><body name="tip"><geom class="far"/></body>'
        "</worldbody></mujoco>"
    )
    meshes, left_out = read_files(tmp_path / "hand.xml")
    assert list(meshes) == ["palm"]
    assert [line.partition(": ")[2] for line in left_out] == [
        "the mesh block.obj: there is no default class 'far'",
        "what it includes; no other file is opened than meshes, so name those files, too",
        "a geom of tip: there is no default class 'far'",
    ]


def test_links_are_named_alone_and_told_apart(folder):
    urdf = folder / "arm" / "urdf" / "arm.urdf"
    assert MeshSource.parse(f"grip={urdf}#rod@0.5") == MeshSource(urdf, 0.5, "grip", "rod")
    assert str(MeshSource.parse(f"grip={urdf}#rod@0.5")) == f"grip={urdf}#rod@0.5"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshWarning)
        [(label, mesh)] = read_meshes(f"grip={urdf}#rod@0.5").items()
        whole = read_link(urdf, folder, "rod")
        scene = Scene(shapes={"a": f"{urdf}#rod"})
    assert label == "grip"
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx(np.ptp(whole.vertices, axis=0) / 2)
    assert scene.solids["a"] == whole
    with pytest.raises(BadMesh, match=r"no single object ''; name one of: arm\.urdf#base, arm\.urdf#rod$"):
        Scene(shapes={"a": urdf})
    (folder / "arm" / "urdf" / "second.urdf").write_text(URDF)
    found, _ = labelled_sources(folder / "arm")
    assert list(found) == ["arm/base", "arm/rod", "second/base", "second/rod"]
    assert list(labelled_sources(f"my={urdf}")[0]) == ["my/base", "my/rod"]
    with pytest.raises(DuplicateShape, match="is given twice"):
        read_meshes(f"{urdf}#rod", f"{urdf}#rod")


BOX = '<visual><geometry><box size=".01 .01 .01"/></geometry></visual>'


def one_link(geometry):
    return f'<robot><link name="a"><visual><geometry>{geometry}</geometry></visual></link></robot>'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (one_link('<mesh filename="../secret.obj"/>'), r"'\S*/\.\./secret\.obj', which is not below"),
        (one_link('<mesh filename="package://x/../../secret.obj"/>'), "which is not below"),
        (one_link('<mesh filename="file:///etc/passwd"/>'), "'/etc/passwd', which is not below"),
        (one_link('<mesh filename="https://example.org/a.obj"/>'), "is no file; files elsewhere are not opened"),
        (one_link('<mesh filename="missing.obj"/>'), r"there is no '\S*missing\.obj'"),
        (one_link('<mesh filename="link.obj"/>'), "which is not below"),
        (one_link('<mesh filename="in.obj" scale="1 2"/>'), "no links or bodies|finite numbers"),
        (one_link('<box size="1 nan 1"/>'), "should be 3 finite numbers"),
        (one_link('<sphere radius="-1"/>'), "needs finite lengths above zero"),
        (one_link('<torus radius="1"/>'), "a torus is not read"),
        (one_link('<box size="${width} 1 1"/>'), r"'\${width}' is not a decimal number"),
        ('<!DOCTYPE a [<!ENTITY e SYSTEM "file:///etc/passwd">]><robot>&e;</robot>', "document type"),
        ("<sdf/>", "begins with <sdf>"),
        ("<robot>" * 200_000, "no XML"),
        ('<mujoco><worldbody><geom class="b"/></worldbody></mujoco>', "there is no default class 'b'"),
        ('<mujoco><include file="/etc/passwd"/></mujoco>', "what it includes; no other file is opened"),
        ('<mujoco><worldbody><replicate count="9999999"><geom/></replicate></worldbody></mujoco>', "a replicate of"),
        ("<mujoco><worldbody>" + "<body>" * 3000 + "</body>" * 3000 + "</worldbody></mujoco>", "recursion|no links"),
    ],
)
def test_what_a_robot_may_not_ask_for_is_left_out_with_a_line(text, said, tmp_path):
    (tmp_path / "secret.obj").write_text(BLOCK)
    folder = tmp_path / "robot"
    folder.mkdir()
    (folder / "link.obj").symlink_to("../secret.obj")
    (folder / "good.urdf").write_text(one_link('<box size=".01 .02 .03"/>').replace('"a"', '"good"'))
    (folder / "in.obj").write_text(BLOCK.replace("v 1", "v 0.1"))
    (folder / "bad.xml" if "<mujoco" in text else folder / "bad.urdf").write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshWarning)
        meshes, left_out = read_files(folder)
    assert "good" in meshes
    assert [line for line in left_out if re.search(said, line)], left_out


def test_a_link_of_endless_pieces_is_refused_when_it_has_too_many_triangles(tmp_path, monkeypatch):
    monkeypatch.setattr("activetouch.robot_file.MOST_TRIANGLES", 30)
    (tmp_path / "many.urdf").write_text(
        one_link('<box size=".01 .02 .03"/>').replace("<visual>", BOX * 1000 + "<visual>")
    )
    with pytest.raises(BadMesh, match=r"many\.urdf#a: it has more than 36 triangles, 30 are the most"):
        read_meshes(tmp_path / "many.urdf")


def test_a_robot_that_cannot_be_read_is_an_error_unless_it_is_left_out(tmp_path):
    (tmp_path / "bad.urdf").write_text("<robot>")
    (tmp_path / "good.urdf").write_text(one_link('<box size=".01 .02 .03"/>'))
    with pytest.raises(BadMesh, match=r"bad\.urdf: cannot be read as URDF or MJCF: it is no XML"):
        read_meshes(tmp_path / "bad.urdf", tmp_path / "good.urdf")
    meshes, left_out = read_files(tmp_path / "bad.urdf", tmp_path / "good.urdf", is_lenient=True)
    assert list(meshes) == ["a"]
    assert len(left_out) == 1
    with pytest.raises(InvalidArgument, match=r"no mesh could be read .*\n- \S*bad\.urdf is left out"):
        read_files(tmp_path / "bad.urdf", is_lenient=True)
    with pytest.raises(FileNotFoundError, match=r"missing\.urdf"):
        read_meshes(Path(tmp_path / "missing.urdf"))
