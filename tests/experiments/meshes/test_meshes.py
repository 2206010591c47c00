"""Find and identify among meshes: the belief is that of all cells, views are right, reports are written."""

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
import scipy
import trimesh
from scipy.special import logsumexp

from activetouch import PadDescription, Response, TactileSensor, Taxels, TouchWorld
from activetouch.distributions import Uniform
from activetouch.errors import MeshWarning, WrongScene
from activetouch.mesh_source import labelled_sources
from activetouch.named_scenes import SCENES, NamedScene
from activetouch.orientations import Upright
from activetouch.perception import many_bodies
from activetouch.perception.contacts.close_look import CloseLook
from activetouch.perception.contacts.views import BodySet, ViewPlan, are_embedded, embedded_views
from activetouch.perception.many_bodies import NestedPlan, are_many
from activetouch.poses import POSE_SETS, to_matrices, turned
from activetouch.pressing.height_maps import predicted_contacts
from activetouch.rotation_cells import centres, nearest, nested
from activetouch.shapes import SHAPES, Box, Cylinder, Family, Mesh
from belief import Probe, Reject, SceneBelief, SearchProblem
from belief.coarse_to_fine import CoarseToFine, Effort
from belief.errors import InvalidArgument, UnknownName
from belief.files import sealed_json, unsealed_json
from belief.naming import NONE_OF_THESE, UNLISTED
from experiments.cli import REGISTRY
from experiments.meshes import setting as setting_module
from experiments.meshes.find import Find, find, stated
from experiments.meshes.identify import Identified, Identify, identify
from experiments.meshes.near_twins import MOST, near_twins
from experiments.meshes.result import RESULTS, result_of, solids_of
from experiments.meshes.setting import (
    cost_words,
    read_folder,
    reader_of,
    reading_words,
    scene_of,
    sensor_of,
    view_seconds,
)
from experiments.press.explain import Explain
from experiments.scene_choice import SceneChoice
from experiments.search.certify import certify
from planners import Outcome
from planners.certified import NotCertified
from planners.search import Identification

RULES = {"num_objects": 3, "composition": "at_most_one"}
PLAN, FEW, EFFORT = ViewPlan(12, 4), ViewPlan(4, 4), Effort()
GLANCE = CloseLook(proposed=3, divided=2)  # where it does not count how close a look is
TWO_SEARCHES = {
    "num_objects": 2,
    "num_searches": 2,
    "jobs": 1,
    "plan": PLAN,
    "levels": (0, 1),
    "look": GLANCE,
    "pressed": 4,
}
POSES = np.array(list(POSE_SETS["directions26"].values()))


def box(x, y, z):
    corners = np.array([(a, b, c) for a in (-x, x) for b in (-y, y) for c in (-z, z)])
    faces = [
        (0, 1, 3),
        (0, 3, 2),
        (4, 6, 7),
        (4, 7, 5),
        (0, 4, 5),
        (0, 5, 1),
        (2, 3, 7),
        (2, 7, 6),
        (0, 2, 6),
        (0, 6, 4),
    ]
    return Mesh("box", corners, np.array([*faces, (1, 5, 7), (1, 7, 3)]))


def test_the_evidence_of_twenty_bodies_is_that_of_all_finest_cells():
    rng, plan = np.random.default_rng(0), ViewPlan()
    turns = to_matrices(plan.orientations).reshape(-1, 9)
    smooth = np.concatenate([turns, turns**2, turns * np.roll(turns, 1, axis=1)], axis=1)
    table = np.einsum("vf,kfd->kvd", smooth, rng.normal(0.0, 0.5, (20, 27, 8))).astype(np.float32)
    bodies = BodySet(tuple(map(str, range(20))), np.ascontiguousarray(table.swapaxes(0, 1)), plan, POSES, (1, 2))
    belief = CoarseToFine.start(np.zeros(20), nested((1, 2)), bodies, Effort(tolerance=0.01), 0.8, 0.05)
    rest, whole = centres(2)[1000], np.zeros((20, 6912))
    for count, pose in enumerate((3, 9, 21, 14, 0, 7), 1):
        view = nearest(turned(POSES[pose], rest[None]), plan.orientations)[0]
        embedding = table[4, view] + rng.normal(0.0, 0.5, 8).astype(np.float32)
        belief = belief.update(bodies.felt(pose, embedding))
        whole += (table @ embedding)[:, nearest(turned(POSES[pose], centres(2)), plan.orientations)]
        logs = logsumexp(whole * 0.8 / (1 + 0.05 * (count - 1)) + np.log(nested((2,)).shares[0]), axis=1)
        assert np.abs(belief.probs - np.exp(logs - logsumexp(logs))).max() < 0.05
    assert belief.unresolved <= 0.01
    ratios = bodies.log_ratios(np.array([0, 1]), np.array([4, 4]), np.array([5, 1000]), embedding[None])
    assert ratios[7, 1, 0] == pytest.approx(float(table[4, view] @ embedding), rel=1e-4)


def test_views_are_the_contacts_of_their_orientations_turned_by_quarters():
    reader, scene = reader_of("gel").hypotheses, SCENES["gel"].scene
    solid = box(0.012, 0.009, 0.02)
    found, code = embedded_views(reader, scene, solid, PLAN), np.zeros((1, 41), np.float32)
    maps = predicted_contacts(solid, PLAN.orientations, (0.0, 0.0), reader.imaging.wide_window, 1.0, np.float32)
    (expected,) = reader.embed(maps, PLAN.width, code)
    assert np.corrcoef(found.ravel(), expected.ravel())[0, 1] > 0.999
    assert are_embedded(reader, scene, solid, PLAN)
    assert not are_embedded(reader, scene, box(0.012, 0.009, 0.021), PLAN)


def write_obj(path, mesh):
    lines = [f"v {x} {y} {z}" for x, y, z in mesh.vertices] + [f"f {a} {b} {c}" for a, b, c in mesh.faces + 1]
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("meshes")
    (made / "sub").mkdir()
    for name, sides in {"cube": (14, 14, 14), "bar": (8, 8, 24), "sub/plate": (22, 18, 5)}.items():
        write_obj(made / f"{name}.obj", box(*(side / 1000 for side in sides)))
    (made / "broken.obj").write_text("v 0 0 0\n")
    shutil.copy(made / "bar.obj", made / "same.obj")
    return made


@pytest.fixture(scope="module")
def sensor(folder):
    return sensor_of(read_folder(folder)[0], plan=NestedPlan(PLAN, (0, 1), look=GLANCE, pressed=4), jobs=1)


def test_a_folder_is_read_with_what_cannot_be_read_left_out(folder, tmp_path):
    solids, refused = read_folder(folder)
    assert list(solids) == ["bar", "cube", "same", "plate"]
    assert len(refused) == 1
    assert "broken" in refused[0]
    for name in "abcde":
        (tmp_path / f"{name}.obj").write_text("v 0 0 0\n")
    with pytest.raises(InvalidArgument, match=r"(?s)no mesh.*:\n- \S*/a.*\n- \S*/c.*\n- and 2 more files$"):
        read_folder(tmp_path)
    (tmp_path / "large.obj").write_text("v 0 0 0\nv 30 0 0\nv 0 30 0\nv 0 0 30\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n")
    with pytest.warns(MeshWarning, match="millimetres") as said:
        assert solids_of([tmp_path / "large.obj", folder / "cube.obj"], None)
    assert [one.filename for one in said] == [__file__]  # once, with the line of the user
    with pytest.raises(FileNotFoundError, match="no folder"):
        read_folder(tmp_path / "missing")


def test_every_command_says_what_a_folder_has_and_is_not_read(tmp_path, capsys):
    for name, sides in {"cube.obj": (14, 14, 14), "cube.ply": (8, 8, 24)}.items():
        mesh = box(*(side / 1000 for side in sides))
        trimesh.Trimesh(mesh.vertices, mesh.faces).export(tmp_path / name)
    (tmp_path / "cube.step").write_text("")
    (tmp_path / "gone.stl").symlink_to("nowhere.stl")
    begins = [f"{tmp_path}/cube.step is left out: STEP is not read; ", f"{tmp_path}/gone.stl is left out: it is a link"]
    for command in (Find(folder=tmp_path, target="cube.ply", out=tmp_path), Identify(folder=tmp_path, out=tmp_path)):
        solids, left_out = command.read("cube.ply")
        assert list(solids) == ["cube.obj", "cube.ply"]
        assert [line.startswith(begin) for line, begin in zip(left_out, begins, strict=True)] == [True] * 2
        assert capsys.readouterr().out.splitlines()[-2:] == left_out
    (tmp_path / "cube.ply").unlink()
    with pytest.raises(InvalidArgument, match=r"(?s)one body, cube: nothing .*\n- \S*cube.step is left out: STEP"):
        Find(folder=tmp_path, target="cube", out=tmp_path).read("cube")
    capsys.readouterr()
    choice = SceneChoice("coarse", meshes=(tmp_path,), only=True)
    with pytest.warns(MeshWarning, match="is left out"):
        Explain(choice, presses=2, alike=False).run()
    assert capsys.readouterr().out.splitlines()[-2:] == [f"- {line}" for line in left_out]


def test_twins_are_named_before_the_first_touch(sensor):
    found = near_twins(sensor.model)
    assert {found[0].first, found[0].second} == {"bar", "same"}
    assert found[0].nats == pytest.approx(0.0, abs=1e-3)
    assert "a touch favours the true one 1.00 times (0.00 nats)" in str(found[0])


def test_bodies_that_differ_in_one_place_are_twins_by_the_touches_that_tell_nothing():
    block, knob = box(0.015, 0.012, 0.018), box(0.004, 0.004, 0.014)
    corners = np.concatenate([block.vertices, knob.vertices + np.array([0.019, 0.0, 0.0])])
    with pytest.warns(MeshWarning, match="2 separate surfaces"):
        handled = Mesh("handled", corners, np.concatenate([block.faces, knob.faces + len(block.vertices)]))
    bodies, plan = {"plain": block, "handled": handled, "ball": SHAPES["sphere"]}, NestedPlan(PLAN, pressed=6, check=0)
    model = sensor_of(bodies, plan=plan, jobs=1).model
    (twins,) = near_twins(model)
    assert {twins.first, twins.second} == {"plain", "handled"}
    assert twins.silent >= MOST
    assert "of touches tell next to nothing" in str(twins)


def test_a_body_that_is_about_to_be_named_is_looked_at_beside_its_nearest_after_any_number_of_touches(sensor):
    bodies, rng = sensor.model.bodies, np.random.default_rng(4)
    world, belief = TouchWorld.sample(sensor, [0], rng), sensor.model.start().belief
    for pose in (0, 9, 17):
        belief = belief.update(bodies.felt(pose, world.touch(pose, rng).features))
    assert belief.probs.max() < 0.6  # bar and same are one body
    assert bodies.looked(belief) is belief  # three touches are early
    probable = replace(bodies, look=CloseLook(named=0.4))
    assert probable.looked(belief).correction.any()
    assert set(bodies._nearest[0].tolist()) >= {0, 2}
    never = replace(bodies, look=CloseLook(0, named=0.0))
    assert never.looked(belief) is belief


def test_bodies_are_named_and_the_report_shows_those_that_are_possible(folder, tmp_path):
    with pytest.warns(MeshWarning, match="broken.obj is left out: there are no triangles"):
        found = identify(folder, num_objects=4, max_touches=3, jobs=1, plan=PLAN, levels=(0, 1), look=GLANCE, pressed=4)
    rows = found.rows()
    assert {row["body"] for row in rows} == {"bar", "cube", "same", "plate"}
    for row, naming in zip(rows, found.namings, strict=True):
        assert 1 <= row["touches"] <= 3
        assert row["stated"] <= 0.6 or row["named"] in ("cube", "plate")  # bar and same are one body
        assert len(set(naming.poses)) == len(naming.poses) == len(naming.log_probs)
    page = found.save(tmp_path / "report").read_text()
    assert "broken.obj is left out: there are no triangles" in page
    assert "broken.obj is left out: there are no triangles" in str(found)
    assert page.count("expected of ") >= 2 * sum(row["touches"] for row in rows)  # each name is a caption and a text
    assert len([*re.finditer(r'<section class="story"', page)]) == 4
    assert "feel nearly alike" in page
    assert len((tmp_path / "report" / "objects.csv").read_text().splitlines()) == 5


def test_what_needs_a_look_comes_first(sensor, tmp_path, capsys, monkeypatch):
    kinds = [(True, True, False), (True, False, False), (True, True, True), (False, True, False), (True, True, False)]
    assert [result_of(*kind) for kind in kinds] == ["right", "unsure", NONE_OF_THESE, "wrong", "right"]
    named = [(0, 0, True), (0, 0, False), (UNLISTED, UNLISTED, True), (0, 1, True), (1, 1, True)]
    namings = [Identification(truth, name, 0.9, (0, 1), certain) for truth, name, certain in named]
    found = Identified(sensor, [], namings, left_out=["broken.obj is left out"])
    command = Identify(folder=tmp_path, out=tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(Identified, "save", lambda *_: "page")
        command.report(found)
    said = capsys.readouterr().out.splitlines()
    assert said[-2:] == ["bodies: 4; left out, as said above: 1", "wrote page"]
    rows = [row[:2] for row in found.table().rows]
    assert rows == [("wrong", 4), ("unsure", 2), (NONE_OF_THESE, 3), ("right", 1), ("right", 5)]
    assert [row["object"] for row in found.rows()] == [1, 2, 3, 4, 5]
    assert found.answer() == (
        "4 of 5 objects are named rightly, with 2.0 touches on average; a guess without a touch is right in 25 %. "
        "1 is wrong, 1 is unsure, 1 is rightly none of these."
    )


@pytest.mark.filterwarnings("ignore:.*broken.obj is left out")
def test_a_search_says_where_the_target_is_or_that_it_is_not_there(folder, tmp_path):
    found = find(
        folder, "cube.obj", num_objects=2, num_searches=6, jobs=1, plan=PLAN, levels=(0, 1), look=GLANCE, pressed=4
    )
    assert len(found.rows()) == 6
    for row in found.rows():
        assert ("cube" in row["objects"].split()) == (row["target"] != "not there")
    assert sum(row["right"] for row in found.rows()) >= 4
    assert "answers are right" in str(found)
    assert f"{sum(row['right'] for row in found.rows())} of 6 searches are answered rightly" in found.answer()
    page = found.save(tmp_path).read_text()
    assert page.count('<section class="story"') == 3  # its own, in place of that of compare
    shown = re.findall(r"Search \d, (wrong|unsure|right):", page)
    assert shown[::2] == sorted((row["result"] for row in found.rows()), key=RESULTS.index)[:3]
    usual = find(
        folder, "cube", num_searches=1, threshold=0.3, jobs=1, plan=PLAN, levels=(0, 1), look=GLANCE, pressed=4
    )
    assert len(usual.rows()[0]["objects"].split()) == 3


@pytest.mark.filterwarnings("ignore:.*broken.obj is left out")
def test_what_cannot_be_sought_is_refused(folder):
    with pytest.raises(UnknownName, match="mug"):
        find(folder, "mug.obj", num_objects=4)
    with pytest.raises(InvalidArgument, match="add meshes, or use --objects 3"):
        find(folder, "cube", num_objects=4)
    with pytest.raises(InvalidArgument, match="nothing to tell apart"):
        find([folder / "cube.obj"], "cube")
    with pytest.raises(InvalidArgument, match="reader of any object"):
        sensor_of({"cube": Box((0.01, 0.01, 0.01))}, "paper")
    with pytest.raises(InvalidArgument, match="no bodies"):
        sensor_of({})
    with pytest.raises(InvalidArgument, match="within"):
        identify(folder, within=0.0, num_objects=1, body="plate", jobs=1)


def test_a_folder_has_a_scale_and_names_are_checked_before_files_are_read(folder, tmp_path, capsys):
    plain, scaled = read_folder(folder, 1.0)[0], read_folder(f"{folder}@0.5")[0]
    assert list(plain) == list(scaled)
    for label, mesh in plain.items():
        np.testing.assert_allclose(np.ptp(scaled[label].vertices, axis=0), np.ptp(mesh.vertices, axis=0) / 2)
    for command in (Find(folder=folder, target="cub", out=tmp_path), Identify(folder=folder, body="cub", out=tmp_path)):
        with pytest.raises(UnknownName, match="Did you mean 'cube'"):
            command.run()
    assert capsys.readouterr().out == ""


def resealed(text, **changes):
    return sealed_json({**unsealed_json(text), **changes})


DAMAGES = {
    "an empty object": lambda own, other: "{}",
    "a list": lambda own, other: "[]",
    "nothing": lambda own, other: "",
    "a part": lambda own, other: own[: len(own) // 2],
    "a tenfold scale": lambda own, other: json.dumps({**json.loads(own), "scale": 10 * json.loads(own)["scale"]}),
    "no number": lambda own, other: json.dumps({**json.loads(own), "scale": np.nan}),
    "other keys": lambda own, other: sealed_json({"of": 1}),
    "another set": lambda own, other: other,
    "another set, sealed again": lambda own, other: resealed(other),
    "no name": lambda own, other: sealed_json({k: v for k, v in unsealed_json(own).items() if k != "name"}),
    "negative numbers": lambda own, other: resealed(own, scale=-1.0),
    "no references": lambda own, other: resealed(own, references={"shape": [0, 96], "float16": ""}),
    "references that are none": lambda own, other: resealed(own, references=3),
}


def test_a_fit_that_is_damaged_or_of_another_set_is_made_again(sensor, tmp_path, monkeypatch):
    monkeypatch.setenv("ACTIVETOUCH_CACHE", str(tmp_path))
    random = sensor.model.strangers.random[None]  # whose views would be embedded again
    monkeypatch.setattr(many_bodies, "random_views", lambda hypotheses, code: random)
    densities, found = many_bodies._densities, {}

    def of_labels(model, *pressed):
        """What fits of these tests take longest for, once for each set."""
        if model.shape_labels not in found:
            found[model.shape_labels] = densities(model, *pressed)
        return found[model.shape_labels]

    monkeypatch.setattr(many_bodies, "_densities", of_labels)

    def fit(*sides, pressed=1, levels=(0,), views=FEW, effort=EFFORT):
        solids = {f"{side}": box(0.014, side / 1000, 0.018) for side in sides}
        before = set(tmp_path.glob("*.json"))
        made = sensor_of(solids, plan=NestedPlan(views, levels, effort, pressed=pressed), jobs=1).model
        return made, set(tmp_path.glob("*.json")) - before

    own, [path] = fit(7, 9)
    _, [other] = fit(8, 9)
    content, of_another = path.read_text(), other.read_text()
    for name, damage in DAMAGES.items():
        path.write_text(damage(content, of_another))
        again, new = fit(7, 9)
        assert not new, name
        assert (again.scale, again.drift) == (own.scale, own.drift), name
        np.testing.assert_array_equal(again.references, own.references, name)
        assert path.read_text() == content, name
    for others in ({"pressed": 2}, {"levels": (1,)}, {"views": ViewPlan(4, 4, 0.3)}, {"effort": Effort(splits=8)}):
        assert len(fit(7, 9, **others)[1]) == 1, others


@pytest.mark.nightly  # as poses are inferred in tests of them
@pytest.mark.filterwarnings("ignore:.*broken.obj is left out")
def test_touches_go_on_until_it_is_known_how_an_object_lies(folder, tmp_path):
    small = {
        "plan": PLAN,
        "levels": (0, 1),
        "pressed": 4,
        "unlisted": 0.0,
        "check": 0,
        "jobs": 1,
        "body": "plate",
    }
    named, known = (identify(folder, num_objects=1, max_touches=5, **small, **own) for own in ({}, {"within": 12.0}))
    [lies] = known.lying
    assert not named.lying
    assert len(known.namings[0].poses) > len(named.namings[0].poses)
    assert lies.within <= 12.0 or len(known.namings[0].poses) == 5
    assert len(lies.after) == len(known.namings[0].poses)
    assert lies.within == lies.after[-1].credible().radius < lies.after[0].credible().radius
    page = known.save(tmp_path)
    assert "How they lie" in page.read_text()
    assert (tmp_path / "lies1.png").stat().st_size > 1000


def test_find_plays_every_decider_of_compare_and_its_run_can_be_continued(folder, tmp_path, capsys):
    small = dict(TWO_SEARCHES)
    players = ["information_gain", "shape_information_gain", "value_of_information", "point_based", "threshold"]
    with pytest.warns(MeshWarning, match="broken"):
        found = find(folder, "cube", deciders=[*players, "random_confirm", "random_poses"], out=tmp_path, **small)
    assert set(found.comparison.deciders) == {*players, "random_confirm", "random_poses"}
    for row in found.rows():
        assert row["right"] == (row["answer"] == row["target"])
        assert 0.0 < row["stated"] <= 1.0
    kept = {path: path.read_bytes() for path in tmp_path.glob("cells/*")}
    with pytest.warns(MeshWarning, match="broken"):
        again = find(folder, "cube", deciders=players[:1], out=tmp_path, **small)
    assert kept == {path: path.read_bytes() for path in tmp_path.glob("cells/*")}
    assert again.rows() == [row for row in found.rows() if row["decider"] == players[0]]


def test_what_is_stated_of_a_search_for_at_most_one_target_is_its_posterior(sensor):
    problem = SearchProblem(sensor.shape_labels, sensor.pose_labels, 3, "at_most_one")
    for seed in range(6):
        episode = sensor.search("bar", "random_poses(confirm=0.9, reject=0.05, max_touches=2)", seed, **RULES)
        scene = SceneBelief(problem, sensor.model, target="bar")
        for step in episode.steps:
            if step.touch is not None:
                scene.update(step.object_index, [step.touch])
        is_found = episode.outcome is Outcome.CONFIRMED
        probs = [scene.belief(place).probs[0] for place in range(3)]
        expected = probs[episode.steps[-1].object_index] if is_found else 1.0 - scene.prob_present("bar")
        assert stated(episode) == pytest.approx(expected, rel=1e-6)


def test_a_session_among_many_meshes_continues_from_its_log(sensor, tmp_path):
    rng, world = np.random.default_rng(0), TouchWorld.sample(sensor, ["plate", "bar"], np.random.default_rng(1))
    rules = {"seed": 3, "log": tmp_path / "log", "abstain": False, "num_objects": 2, "composition": "at_most_one"}
    session = sensor.session("bar", **rules)
    session.tell(image=world.press(session.ask().pose, rng)[0])
    belief = session.belief.probs
    session.close()
    session = sensor.session("bar", **rules)
    np.testing.assert_array_equal(session.belief.probs, belief)
    while (action := session.ask()) is not None:
        session.tell(*([world.touch(action.pose, rng)] if isinstance(action, Probe) else []))
        if action == Reject():
            world.advance()
    assert session.outcome is Outcome.CONFIRMED
    assert session.object_index == 1
    session.close()


@pytest.mark.nightly  # as searches in trays are
@pytest.mark.filterwarnings("ignore:.*broken.obj is left out")
def test_searches_among_many_meshes_are_certified(folder, sensor):
    rules = {"risk": 0.5, "searches": 24, "targets": "cube", "num_objects": 2, "composition": "at_most_one", "jobs": 1}
    rules["max_touches"] = 3
    certificate = certify(NamedScene(sensor.scene), sensor=sensor, **rules)
    small = {**TWO_SEARCHES, "unlisted": 0.0}
    found = find(folder, "cube", certificate=certificate, **small)
    assert found.comparison.deciders == ["information_gain", "certified information_gain"]
    with pytest.raises(NotCertified, match="num_objects=3"):
        find(folder, "cube", certificate=certificate, **{**small, "num_objects": 3})


def test_all_that_find_and_identify_spend_is_said_before(tmp_path, monkeypatch):
    solids = {f"{side}": box(0.014, side / 1000, 0.018) for side in (7, 9)}
    monkeypatch.setenv("ACTIVETOUCH_CACHE", str(tmp_path / "cache"))

    def costs(some, touches=300.0, pictured=20.0, jobs=1):
        words = cost_words(some, "gel", touches, pictured, jobs)
        found = re.search(
            r"bodies: about (\d+) s, of which (\d+) s for 1056 views of each of (\d+) new bodies and (\d+) s for the "
            r"fit of the set, once, (\d+) s for about 300 touches and (\d+) s for the report; \d+ MB on disk",
            words,
        )
        assert found, words
        return list(map(int, found.groups()))

    whole, views, new, fit, touches, report = costs(solids)
    assert whole == pytest.approx(views + fit + touches + report, abs=2)
    assert new == 2
    assert min(fit, touches, report) > views  # which alone were said
    corners = np.random.default_rng(0).normal(size=(20_000, 3))
    corners /= np.linalg.norm(corners, axis=1)[:, None] * 80
    fine = Mesh("fine", corners, scipy.spatial.ConvexHull(corners).simplices)
    assert all(more > less for more, less in zip(costs({**solids, "fine": fine})[:3], (whole, views, new), strict=True))
    assert costs(solids, jobs=4)[4] < touches
    monkeypatch.setattr(setting_module, "to_embed", lambda reader, scene, views: [solids["7"]])
    monkeypatch.setattr(setting_module, "is_fitted", lambda reader, scene, plan: True)
    assert costs(solids)[2:4] == [1, 0]
    assert view_seconds(fine) > 1.5 * view_seconds(solids["7"])
    (tmp_path / "a.stl").write_bytes(bytes(20_000_000))
    assert reading_words(labelled_sources(tmp_path / "a.stl")[0]) == "reading 1 files of 20.0 MB: about 3 s"
    searches = Find(folder=tmp_path, target="a", searches=10, out=tmp_path)
    assert searches._expected(2) == (10, 3)
    assert searches._expected(9) == (40, 12)
    objects = Identify(folder=tmp_path, objects=10, max_touches=3, out=tmp_path)
    assert objects._expected(100) == (30, 18)


def test_find_and_identify_are_commands():
    assert {"find", "identify"} <= set(REGISTRY)
    assert scene_of({"cube": Box((0.01, 0.01, 0.01))}).variation.size.support == (0.97, 1.03)


def test_a_closer_look_finds_how_an_object_lies_and_what_it_is_among_bodies_that_are_nearly_alike():
    solids = {f"{side}": box(0.014, side / 1000, 0.018) for side in (7, 9, 11)}
    sensor = sensor_of(solids, plan=NestedPlan(PLAN, pressed=3, check=0), jobs=1)
    never = replace(sensor.model, bodies=replace(sensor.model.bodies, look=CloseLook(0)))
    rng, look, hypotheses = np.random.default_rng(2), CloseLook(), sensor.reader.hypotheses
    world, evidence = TouchWorld.sample(sensor, [1], rng), never.start()
    obj = world.current
    for pose in (0, 4, 9, 13, 17, 22):
        evidence = evidence.update(world.touch(pose, rng))
    belief = evidence.belief
    found = sensor.model.bodies.log_evidence(np.arange(3), belief.touches)
    rest, exact = np.array(obj.orientation), 0.0
    for touch in belief.touches:
        turn, window = turned(POSES[touch.pose], rest[None]), hypotheses.imaging.wide_window
        maps = predicted_contacts(list(solids.values())[1], turn, (0.0, 0.0), window, obj.scale, np.float32)
        (embedded,) = hypotheses.embed(maps, look.widths[-1], np.zeros((1, 41), np.float32))
        exact += float(embedded[0] @ touch.embedding)
    share = look.scale / (1.0 + look.drift * 5)
    assert found[1] > share * exact - np.log(len(centres(4)) * 3) - 5.0
    assert found.argmax() == 1
    assert sensor.model.bodies.looked(belief).probs[1] > belief.probs[1]
    np.testing.assert_array_equal(never.bodies.looked(belief).probs, belief.probs)
    with pytest.raises(InvalidArgument, match="divided"):
        CloseLook(divided=0)


def test_a_belief_about_nested_cells_is_for_many_bodies_that_lie_anyhow():
    boxes = {f"{n}": Box((0.01, 0.01, 0.01 + n / 10_000)) for n in range(46)}
    scene = scene_of(boxes)
    assert are_many(scene)
    assert not are_many(scene_of(dict(list(boxes.items())[1:])))
    wide = replace(scene.variation, size=Uniform(0.8, 1.2))
    for changes, reason in (
        ({"presentation": Upright()}, "presented by Upright"),
        ({"variation": wide}, "sizes of the objects vary by more than 5 %"),
        ({"shapes": {**boxes, "family": Family(Cylinder(0.01, 0.02), radius=Uniform(0.01, 0.02))}}, "family vary"),
    ):
        other = replace(scene, **changes)
        assert not are_many(other)
        with pytest.raises(WrongScene, match=reason):
            TactileSensor.shipped("gel", other, nested=True)
    with pytest.raises(InvalidArgument, match="not inferred with a belief about nested cells"):
        TactileSensor.shipped("gel", scene, unknown_state=True, nested=NestedPlan(FEW, pressed=1))


@pytest.mark.filterwarnings("ignore:.*broken.obj is left out")
def test_other_meshes_may_be_pressed_than_those_that_are_named(folder, tmp_path):
    for name, sides in {"cube": (14, 14, 14), "rod": (6, 6, 30)}.items():
        write_obj(tmp_path / f"{name}.obj", box(*(side / 1000 for side in sides)))
    plan = {"plan": PLAN, "levels": (0, 1), "look": GLANCE, "pressed": 4}
    found = identify(folder, press=tmp_path, num_objects=4, max_touches=3, jobs=1, **plan)
    rows = found.rows()
    assert {row["body"] for row in rows} == {"cube", "rod"}
    for row, naming in zip(rows, found.namings, strict=True):
        assert naming.truth == (UNLISTED if row["body"] == "rod" else list(found.sensor.shape_labels).index("cube"))
        assert row["right"] == (row["named"] == row["body"])
    assert not any(row["right"] for row in rows if row["body"] == "rod")


@pytest.mark.filterwarnings("ignore:.*broken.obj is left out")
def test_a_sensor_in_another_world_than_described_presses_there(folder):
    plan = {"plan": PLAN, "levels": (0, 1), "look": GLANCE, "pressed": 4, "max_touches": 2, "num_objects": 2, "jobs": 1}
    usual, softer = (identify(folder, world=world, **plan).namings for world in (None, "stiffness × 0.4"))
    for one, other in zip(usual, softer, strict=True):
        assert one.truth == other.truth
        assert other.touches[0].image.mean() < 0.6 * one.touches[0].image.mean()
    with pytest.raises(UnknownName, match="noise × 3"):
        identify(folder, world="noise x 3", **plan)
    with pytest.raises(InvalidArgument, match=r"'cone × 0\.6' does not apply: it has no cone"):
        identify(folder, world="cone × 0.6", **plan)


def test_a_pad_that_is_hardly_known_is_said_to_be_taken_in_the_middle(tmp_path):
    taxels, path = Taxels.grid(4, 4, 0.005), tmp_path / "mine.toml"
    for ranges, words in (
        ({}, "stiffness and law"),
        ({"stiffness": [5e7, 1e8]}, "law"),
        ({"stiffness": [5e7, 1e8], "law": [0.9, 1.1]}, ""),
    ):
        PadDescription(taxels, Response.of(ranges)).save(path)
        assert setting_module._wide_ranges(path) == words
