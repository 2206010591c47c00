"""A robot over a pipe: the search of the loop, whatever it sends and however often it is killed."""

import io
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from activetouch import PadDescription, RecordedSensor, TactileSensor, Taxels, TouchWorld
from activetouch.errors import BadRecording
from activetouch.named_scenes import SCENES
from activetouch.perception.reader import HypothesisTable, TactileReader
from activetouch.recorded import RecordedTouches, read_recorded
from activetouch.sensor_files import ANY_OBJECT_FILE, MODELS
from activetouch.shapes import EXTENDED_SHAPES
from activetouch.tray.sensor import TraySensor
from activetouch.tray.world import Tray
from belief import Probe, Touch
from belief.errors import ActiveTouchError, InvalidArgument
from belief.naming import NONE_OF_THESE
from belief.observation_model import RigidBodyModel
from belief.references import BadReference
from belief.seeding import arrangement_rng, touch_rng
from belief.synthetic import sample_arrangement
from experiments.command_line.arguments import BadArgument
from experiments.scene_choice import SceneChoice
from experiments.search.drawer import searches
from experiments.search.live import (
    MOST_BYTES,
    Conversation,
    Live,
    NamingConversation,
    TrayConversation,
    converse,
    requests,
)

pytestmark = pytest.mark.mujoco
KEY = (7, 3, 0)  # of sensor.search("cone", seed=7)


def sensor():
    return TactileSensor.shipped("coarse")


def world():
    rng = arrangement_rng(KEY)
    return TouchWorld.sample(sensor(), sample_arrangement(sensor().problem(), rng), rng)


def conversation(**settings):
    return Conversation(sensor().session("cone", "information_gain", 7, **settings), sensor())


def asked(talk, **request):
    return json.loads(talk.answer((json.dumps(request) + "\n").encode()))


class Robot:
    """Presses simulated objects, and speaks JSON."""

    def __init__(self):
        self.world, self.uses, self.object = world(), {}, 0

    def carries_out(self, question):
        if question["action"] != "touch":
            if question["action"] == "reject" and self.object < 3:
                self.world.advance()
                self.object += 1
            return {"done": True}
        pose = sensor().scene.pose_labels.index(question["pose"])
        repeat = self.uses.get((self.object, pose), 0)
        self.uses[self.object, pose] = repeat + 1
        image, _ = self.world.press(pose, touch_rng(KEY, self.object, pose, repeat))
        return {"image": image.tolist()}


def test_a_search_over_a_pipe_that_is_killed_is_the_search(tmp_path):
    expected, robot, log = sensor().search("cone", seed=7), Robot(), tmp_path / "log.jsonl"
    command = [sys.executable, "-m", "experiments.cli", "live", "--sensor", "coarse", "--target", "cone", "--seed", "7"]
    command += ["--never-unsure", "--as-described", "--log", str(log)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as live:

        def says(**request):
            live.stdin.write((json.dumps(request) + "\n").encode())
            live.stdin.flush()
            return json.loads(live.stdout.readline())

        for _ in range(4):
            pending = {"step": (question := says(do="ask"))["step"], **robot.carries_out(question)}
            assert says(do="tell", **pending)["ok"]
        live.kill()
    begun = sensor().session("cone", "information_gain", 7, log=log, abstain=False)
    talk = Conversation(begun, sensor())
    assert asked(talk, do="tell", **pending)["error"] == "AlreadyTold"  # nobody knows whether it was told: tell again
    while (question := asked(talk, do="ask"))["action"] is not None:
        assert asked(talk, do="tell", step=question["step"], **robot.carries_out(question))["ok"]
    ended = asked(talk, do="reveal", arrangement=[sensor().shape_labels[s] for s in robot.world.arrangement])
    begun.close()
    assert (ended["outcome"], ended["success"]) == (str(expected.outcome), expected.success)
    session = sensor().session("cone", "information_gain", 7, log=log, abstain=False)
    assert json.dumps(session.episode.to_dict()) == json.dumps(expected.to_dict())
    assert np.array(ended["log_marginals"]).tobytes() == session.scene.log_marginals().clip(-1e300).tobytes()
    session.close()
    touches, _ = read_recorded(log, "session")  # the day's searches are recordings
    assert touches.num_touches == expected.num_touches
    assert touches.features.shape[1] == 16


HUGE = ("1e999", "-1e999", "NaN", "Infinity", "-Infinity", "9" * 400, "9" * 5000, "[" * 300 + "]" * 300)
"""What JSON of Python reads, and nobody means."""


def hostile(rng, number):
    """Lines that are no requests of a robot that means well."""
    image = rng.integers(256, size=(4, 4)).tolist()
    good = {"do": "tell", "step": 0, "image": image}
    kinds = [
        lambda: rng.bytes(rng.integers(1, 200)).replace(b"\n", b" "),
        lambda: json.dumps(good).encode()[: rng.integers(1, 60)],
        lambda: b"[" * int(rng.integers(1, 5000)),
        lambda: json.dumps({**good, "image": [[float("nan")] * 4] * 4}).encode(),
        lambda: json.dumps({**good, "image": [[1e999] * 4] * 4}).encode(),
        lambda: json.dumps({**good, "image": (np.array(image) + rng.choice([-300, 0.5, 300])).tolist()}).encode(),
        lambda: json.dumps({**good, "image": np.zeros(rng.integers(5, 9, size=rng.integers(1, 5))).tolist()}).encode(),
        lambda: json.dumps({**good, "image": {"dtype": "O", "shape": [4, 4], "base64": "AAAA"}}).encode(),
        lambda: json.dumps({**good, "image": {"dtype": "|u1", "shape": [1 << 40, 4], "base64": "AAAA"}}).encode(),
        lambda: json.dumps({**good, "step": rng.choice([-1, 1, 10**9])}, default=int).encode(),
        lambda: json.dumps({**good, "step": None}).encode(),
        lambda: json.dumps({**good, "step": True}).encode(),
        lambda: json.dumps({**good, "pose": "x" * int(rng.integers(1, 100000))}).encode(),
        lambda: json.dumps({**good, "pose": {"quaternion": [1, 0, 0, rng.random() + 0.1]}}).encode(),
        lambda: json.dumps({**good, "pose": {"quaternion": ["1", 0, 0, 0], "aim": 3}}).encode(),
        lambda: json.dumps({**good, "force": "strong"}).encode(),
        lambda: json.dumps({**good, "missed": True}).encode(),
        lambda: json.dumps({"do": "tell", "step": 0, "done": True}).encode(),
        lambda: json.dumps({"do": "tell", "step": 0, "logits": [1, 2]}).encode(),
        lambda: json.dumps({"do": "tell", "step": 0, "features": [1e308] * 64, "logits": "a"}).encode(),
        lambda: json.dumps({"do": "undo"}).encode(),
        lambda: json.dumps({"do": "undo", "step": -3}).encode(),
        lambda: json.dumps({"do": rng.choice(["", "exit", "__init__", "ask\n"])}).encode(),
        lambda: json.dumps({"do": ["ask"], "id": {"a": 1}}).encode(),
        lambda: json.dumps({"do": "reveal", "arrangement": ["mug"] * int(rng.integers(9))}).encode(),
        lambda: b'{"do": "ask", "id": ' + b"9" * 5000 + b"}",
        lambda: b'"\\ud800"',
        lambda: json.dumps({"do": "ask", "id": "x"}).replace('"x"', rng.choice(HUGE)).encode(),
        lambda: json.dumps({**good, "image": "x"}).replace('"x"', f"[[{rng.choice(HUGE)}]]").encode(),
        lambda: json.dumps({**good, "force": "x"}).replace('"x"', rng.choice(HUGE)).encode(),
        lambda: json.dumps({**good, "step": "x"}).replace('"x"', rng.choice(HUGE)).encode(),
        lambda: json.dumps({"do": "tell", "step": 0, "logits": "x"}).replace('"x"', f"[{rng.choice(HUGE)}]").encode(),
        lambda: json.dumps({"do": "undo", "step": "x"}).replace('"x"', rng.choice(HUGE)).encode(),
        lambda: json.dumps({"do": "reveal", "arrangement": "x"}).replace('"x"', f"[{rng.choice(HUGE)}]").encode(),
        lambda: json.dumps({**good, "pose": {"place": "x"}}).replace('"x"', f"[{rng.choice(HUGE)}]").encode(),
        lambda: json.dumps({"do": "ask", "id": [[{"a": []}]]}).encode(),
        lambda: b"",
    ]
    return [kinds[i % len(kinds)]() + b"\n" for i in range(number)]


def test_hostile_lines_are_answered_and_change_nothing(tmp_path):
    talk, rng = conversation(log=tmp_path / "log"), np.random.default_rng(0)
    lines = hostile(rng, 1000)
    before, question = (tmp_path / "log").read_bytes(), talk.answer(b'{"do": "ask"}\n')
    answers = io.BytesIO()
    converse(talk, io.BytesIO(b"".join(lines)), answers)
    found = [json.loads(line) for line in answers.getvalue().splitlines()]
    assert [answer["ok"] for answer in found] == [False] * 1000
    assert all(answer["message"] and len(answer["message"]) <= 600 and answer["step"] == 0 for answer in found)
    assert (talk.answer(b'{"do": "ask"}\n'), (tmp_path / "log").read_bytes()) == (question, before)
    talk.session.close()


def test_a_line_without_end_is_answered_and_not_kept():
    class Endless(io.RawIOBase):
        """100 MB without a line break, then a request."""

        def __init__(self):
            self.left, self.most, self.rest = 100 << 20, 0, [b'{"do": "ask"}\n', b""]

        def readline(self, size=-1):
            self.most = max(self.most, size)
            if self.left <= 0:
                return self.rest.pop(0)
            self.left -= size
            return b"x" * (size - 1) + (b"x" if self.left > 0 else b"\n")

    stream = Endless()
    assert list(requests(stream)) == [None, b'{"do": "ask"}\n']
    assert stream.most == MOST_BYTES + 1
    assert "bytes" in json.loads(conversation().answer(None))["message"]


def test_a_misled_robot_is_told_so():
    talk, robot = conversation(), Robot()
    question = asked(talk, do="ask", id="a")
    assert (question["id"], question["step"], question["action"]) == ("a", 0, "touch")
    told = {"do": "tell", "step": 0, **robot.carries_out(question)}
    assert asked(talk, **told)["told"] == "touch"
    assert asked(talk, **told)["error"] == "AlreadyTold"  # sent twice
    state = asked(talk, do="state")
    assert state["num_touches"] == 1
    missing = asked(talk, do="tell", step=1, missed=True)
    assert (missing["told"], asked(talk, do="state")["beliefs"]) == ("miss", state["beliefs"])
    other = {"do": "tell", "step": 2, "pose": "y90", "image": told["image"]}
    assert asked(talk, **other)["told"] == "touch"
    assert asked(talk, do="undo", step=3) == {"ok": True, "undone": "touch", "step": 4}
    assert asked(talk, do="state")["beliefs"] == state["beliefs"]
    assert "sensor_health" not in state
    assert asked(talk, do="hello")["image"] == {"shape": [4, 4], "dtype": "uint8"}
    touch = sensor().read(np.array(told["image"], np.uint8)[None], [0])[0]
    assert asked(talk, do="tell", step=4, features=touch.features.tolist())["ok"]


def test_a_sensor_in_an_unknown_state_tells_what_may_be_the_matter(few_hypotheses):
    inferring = TactileSensor.shipped("coarse", unknown_state=True)
    session = inferring.session("cone", "random_poses", 7)
    assert asked(Conversation(session, inferring), do="state")["sensor_health"] == str(session.scene.sensor_health)
    assert repr(session).startswith("Session(step 0, object 0, Belief(")
    session.tell(missed=True)
    assert asked(Conversation(session, inferring), do="undo", step=None)["undone"] == "miss"


def test_readings_of_a_described_pad_are_told_as_they_come():
    pad = PadDescription(Taxels.grid(4, 4, 0.005), is_relative=True)
    talk, other = Conversation(sensor().session("cone", "information_gain", 7), sensor(), pad), conversation()
    assert asked(talk, do="hello")["readings"] == 16
    assert "readings" not in asked(other, do="hello")
    assert asked(other, do="tell", step=0, readings=[1] * 16)["message"].startswith(
        '"readings" are of the taxels of a pad'
    )
    assert "of 16 taxels" in asked(talk, do="tell", step=0, readings=[1, 2])["message"]
    told = list[Any]()
    talk.session.tell = lambda **given: told.append(given)
    asked(talk, do="tell", step=0, readings=list(range(16)))
    np.testing.assert_array_equal(told[0]["image"], pad.image(np.arange(16)))


def test_an_answer_that_is_withheld_has_a_reason():
    talk = conversation()
    noise = np.random.default_rng(0)
    while (question := asked(talk, do="ask"))["action"] == "touch":
        asked(talk, do="tell", step=question["step"], image=noise.integers(256, size=(4, 4)).tolist())
    assert (question["action"], question["why"]) == ("unsure", "the touches contradict the observation model")


@pytest.mark.parametrize("target", ["cube", "cone"])
def test_images_of_nothing_of_noise_or_of_saturation_give_no_answer(target):
    rng = np.random.default_rng(0)
    images = {"blank": lambda: np.zeros((4, 4)), "full": lambda: np.full((4, 4), 255)}
    images["noise"] = lambda: rng.integers(256, size=(4, 4))
    for kind, image in images.items():
        session = sensor().session(target, num_objects=4)
        while (action := session.ask()) is not None:
            session.tell(**({"image": image()} if isinstance(action, Probe) else {}))
        assert (session.outcome, session.answer) == ("unsure", None), kind


def test_a_contact_below_the_stated_area_is_none():
    reader, robot = sensor().image_reader, world()
    image, _ = robot.press("front", touch_rng(KEY, 0, 0, 0))
    area, faint = reader.area(image), image // 8
    assert 0.0 < area < (2 * sensor().scene.pad.half_width) ** 2
    assert reader.area(np.zeros((4, 4), np.uint8)) == 0.0
    session = sensor().session("cube", num_objects=2, least_area=area / 2)
    asked_for = session.ask()
    for told in ({"image": faint}, {"image": image, "area": 0.0}):
        assert session.ask() == asked_for
        assert session.tell(**told) == "miss"
        assert session.steps[-1].touch is None
    assert session.tell(image=image) == "touch"


def test_a_faint_image_is_a_touch_where_a_force_is_stated():
    faint = np.zeros((4, 4), np.uint8)
    for told, kind in (({"force": 2.0}, "touch"), ({"force": 2.0, "area": 0.0}, "miss"), ({"force": 0.0}, "miss")):
        assert sensor().session("cube").tell(image=faint, **told) == kind
    assert sensor().session("cube", least_area=1e-6).tell(image=faint, force=2.0) == "miss"
    assert sensor().session("cube", least_force=3.0).tell(image=faint, force=2.0) == "miss"


def test_a_force_or_an_area_in_another_unit_is_warned_of_once():
    image = world().press("front", touch_rng(KEY, 0, 0, 0))[0]
    for told, words in (
        ({"force": 2000.0}, r"force=2000 is in N, and contacts of this sensor have 1\.5 to 3 N: is it in mN\?"),
        ({"force": 0.002}, "force=0.002 is in N, .* is it in another unit"),
        ({"area": 90.0}, r"area=90 is in m², .* is it in mm²\?"),
    ):
        session = sensor().session("cube")
        with pytest.warns(UserWarning, match=words):
            session.tell(image=image, **told)
        session.tell(image=image, **told)
    with pytest.warns(UserWarning, match="least_force=100 is in N"):
        sensor().session("cube", least_force=100.0)
    sensor().session("cube", least_force=0.01).tell(image=image, force=0.1)


def test_a_place_that_is_a_pose_is_that_pose_and_others_are_evidence_of_one_rigid_body(tmp_path):
    scene, image = sensor().scene, world().press("front", touch_rng(KEY, 0, 0, 0))[0]
    in_pose, at_place, elsewhere = (sensor().session("cone", "information_gain", 7) for _ in range(3))
    elsewhere.save(tmp_path / "log")
    quaternion = scene.rotations["z45"]
    in_pose.tell(image=image, pose="z45")
    at_place.tell(image=image, pose={"quaternion": (-quaternion).tolist()})
    assert at_place.scene.log_marginals().tobytes() == in_pose.scene.log_marginals().tobytes()
    near = np.array([np.cos(0.4), 0.0, 0.0, np.sin(0.4)])  # 0.8 rad about z: 0.015 rad from z45
    elsewhere.tell(image=image, pose={"quaternion": near.tolist()})
    step = elsewhere.steps[-1]
    assert step.decision.action == Probe(scene.pose_labels.index("z45"))
    np.testing.assert_allclose(elsewhere.belief.probs, in_pose.belief.probs, atol=0.1)
    assert (elsewhere.belief.probs != in_pose.belief.probs).all()
    assert isinstance(elsewhere.ask(), Probe)
    elsewhere.close()
    again = sensor().session("cone", "information_gain", 7, log=tmp_path / "log")
    assert again.scene.log_marginals().tobytes() == elsewhere.scene.log_marginals().tobytes()
    again.close()
    with pytest.raises(InvalidArgument, match="predicted contacts"):
        elsewhere.tell(image=image, pose={"quaternion": near.tolist(), "aim": [0.001, 0.0]})
    with pytest.raises(BadRecording, match="not revealed"):
        read_recorded(tmp_path / "log", "session")


def test_a_reader_of_any_object_embeds_hypotheses_at_any_place():
    scene = SCENES["coarse"].scene
    reader = TactileReader.load(MODELS / "coarse" / ANY_OBJECT_FILE).bound_to(scene)
    table, width = HypothesisTable(reader, scene), reader.card.embedding
    references, logits = np.ones((6, 1, width)), np.zeros((6, 1, 4))
    model = RigidBodyModel(scene.shape_labels, 16, 1.0, references, logits, hypotheses=table)
    there = TactileSensor(scene, reader, model).image_reader
    quaternion, aim = np.array([0.5, 0.5, 0.5, -0.5]), np.array([0.002, -0.001])
    pose, elsewhere = there.at({"quaternion": quaternion.tolist(), "aim": aim.tolist()})
    listed = replace(scene, poses={"here": quaternion}, aims={"here": (0.002, -0.001)})
    expected = reader.hypotheses.embedded(listed, scene.hypotheses(16), 0)
    assert elsewhere.place == (*quaternion, *aim)
    assert elsewhere.hypotheses.tobytes() == expected.tobytes()
    for far in ([5.0, 0.0], [0.0, 0.08]):  # nothing reaches farther than 0.07 m
        with pytest.raises(InvalidArgument, match=r"must be at most 0\.06\d* m .*, got \[.*\] m, .* is it in mm\?"):
            there.at({"quaternion": quaternion.tolist(), "aim": far})
    assert there.at({"place": [*scene.rotations["y45"], 0.0, 0.0]}) == (scene.pose_labels.index("y45"), None)
    touch = Touch(pose, features=np.ones(width, np.float32), elsewhere=elsewhere)
    once = model.start().update(touch)
    scores = (expected @ np.ones(width)).astype(float)
    np.testing.assert_allclose(once.log_weights, scores - scores.max(), atol=1e-4)
    assert once.update(touch).num_touches == 2
    with pytest.raises(InvalidArgument, match="none of the poses"):
        model.log_likelihood([touch])


def test_a_log_of_another_search_is_refused_with_what_differs(tmp_path):
    log = tmp_path / "log.jsonl"
    sensor().session("cone", "fixed_poses", 7, log=log).close()
    for changed, message in (
        ({"target": "cube"}, "its target is 'cone', not 'cube'"),
        ({"num_objects": 3}, "its num_objects is 4, not 3"),
        ({"touch_cost": 0.5}, "its touch_cost is 0.02, not 0.5"),
        ({"abstain": False}, "its unsure_reward is 0.0, not None; its abstain is True, not False"),
        ({"least_force": 0.1}, "its least_force is None, not 0.1"),
        ({"least_area": 1e-6}, "its least_area is 0.0, not 1e-06"),
        ({"decider": "fixed_poses(confirm=0.9)"}, "another decider: its confirm is 0.99, not 0.9"),
    ):
        with pytest.raises(InvalidArgument, match=message):
            sensor().session(**{"target": "cone", "decider": "fixed_poses", "seed": 7, "log": log, **changed})
    with pytest.raises(InvalidArgument, match="5 objects cannot all differ"):
        sensor().session("cone", "fixed_poses", 7, num_objects=5)
    with pytest.raises(InvalidArgument, match=r"another model .* \(was it begun with --unknown-state"):
        Live(target="cone", sensor=Path("paper"), decider="fixed_poses", seed=7, log=log).run()
    sensor().session("cone", "fixed_poses", 7, log=log).close()


def recorded(folder, number):
    """A sensor that was trained on few recordings of so many things."""
    objects, sessions, actions = (axis.ravel() for axis in np.indices((number, 4, 2)))
    rng = np.random.default_rng(0)
    features = 3.0 * rng.normal(size=(number, 3))[objects] + rng.normal(size=(len(objects), 3))
    things = tuple(f"thing_{index}" for index in range(number))
    names = ("f0", "f1", "f2")
    touches = RecordedTouches(features, actions, objects, sessions, ("press", "rub"), things, feature_names=names)
    RecordedSensor.fit(touches).save(folder)
    return folder


def lines_of(capfd, monkeypatch, *said, **options):
    """What live answers to lines, and what it prints beside."""
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(b"".join(said))))
    try:
        Live(**options).run()
    finally:
        out, err = capfd.readouterr()
        lines_of.last = [json.loads(line) for line in out.splitlines()], err
    return lines_of.last


HELLO, STATE = b'{"do": "hello"}\n', b'{"do": "state"}\n'


def test_a_sum_that_is_too_large_falls_back_to_independent_objects_and_says_so(tmp_path, capfd, monkeypatch):
    folder = recorded(tmp_path / "sensor", 41)
    options = {"sensor": folder, "target": "thing_3", "log": tmp_path / "log"}
    with pytest.warns(UserWarning, match=r"taken to be independent, .* has more than 1048576 multisets"):
        (hello, state), _ = lines_of(capfd, monkeypatch, HELLO, STATE, **options, objects=8)
    assert (hello["composition"], hello["num_objects"], len(state["beliefs"])) == ("independent", 8, 8)
    with pytest.warns(UserWarning, match="independent"):
        (again,), _ = lines_of(capfd, monkeypatch, HELLO, **options, objects=8)
    assert again == hello
    few = {**options, "log": tmp_path / "few", "objects": 3}
    (hello, state), _ = lines_of(
        capfd, monkeypatch, HELLO, STATE, **few, among=("thing_3", "thing_0", "thing_9", "thing_3")
    )
    assert (hello["composition"], hello["shapes"]) == ("distinct", ["thing_3", "thing_0", "thing_9"])
    assert set(state["beliefs"][0]) == {"thing_3", "thing_0", "thing_9"}
    with pytest.warns(UserWarning, match="independent"):
        session = TactileSensor.load(folder).session("thing_3", num_objects=8)
    assert session.problem.composition == "independent"


def test_a_search_among_some_shapes_of_a_scene_believes_in_no_others(tmp_path, capfd, monkeypatch):
    options = {"sensor": Path("coarse"), "target": "cone", "among": ("cone", "cube"), "log": tmp_path / "log"}
    (hello, state), _ = lines_of(capfd, monkeypatch, HELLO, STATE, **options)
    assert (hello["num_objects"], hello["composition"]) == (2, {"cone": 1, "cube": 1})
    assert {shape: prob for shape, prob in state["beliefs"][0].items() if prob} == {"cone": 0.5, "cube": 0.5}


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"target": "mug"}, "UnknownName", "unknown target 'mug'"),
        ({"decider": "nobody"}, "UnknownName", "unknown decider"),
        ({"decider": "mine.zip"}, "BadReference", "name it sb3:mine.zip"),
        ({"objects": 5}, "InvalidArgument", "5 objects cannot all differ"),
        ({"objects": 0}, "BadArgument", "--objects"),
        ({"touch_cost": float("nan")}, "BadArgument", "--touch-cost"),
        ({"sensor": Path("nowhere")}, "NoSensor", "nowhere"),
        ({"among": ("cube", "sphere")}, "UnknownName", "unknown target among --among 'cone'"),
        ({"among": ("cone", "mug")}, "UnknownName", "unknown shape 'mug'"),
        ({"among": ("cone", "cube"), "objects": 3}, "InvalidArgument", "3 objects cannot come from a bag of 2"),
        ({"among": ("cone", "cube"), "composition": "independent"}, "BadArgument", "--among, for a sensor of a scene"),
        ({"threshold": 0.8}, "BadArgument", "leave out --threshold"),
        ({"target": None, "objects": 3, "among": ("cone",)}, "BadArgument", "leave out --objects, --among"),
        ({"target": None, "prior": "mug=0.5"}, "UnknownName", "mug"),
        ({"target": None, "scene": "drawer"}, "BadArgument", "--target, one of sphere, cube"),
        ({"log": Path(__file__).parent}, "CorruptFile", "is a folder"),
        ({"log": Path(__file__)}, "CorruptFile", "test_live.py"),
    ],
)
def test_an_error_at_the_start_is_one_line_of_json(changes, error, words, tmp_path, capfd, monkeypatch):
    options = {"sensor": Path("coarse"), "target": "cone", "log": tmp_path / "log", **changes}
    if scene := options.pop("scene", None):
        options["choice"] = SceneChoice(scene)
    with pytest.raises(ActiveTouchError, match=words):
        lines_of(capfd, monkeypatch, HELLO, **options)
    [line], _ = lines_of.last
    assert (line["ok"], line["error"]) == (False, error)
    assert words in line["message"]


def test_labels_and_compositions_that_a_recorded_sensor_cannot_search_are_said_at_the_start(
    tmp_path, capfd, monkeypatch
):
    options = {"sensor": recorded(tmp_path / "sensor", 41), "target": "thing_3", "objects": 8}
    for changes, words in (
        ({"among": ("thing_3", "mug")}, r"does not know \['mug'\]"),
        ({"composition": "distinct"}, "has more than 1048576 multisets"),
    ):
        with pytest.raises(InvalidArgument, match=words):
            lines_of(capfd, monkeypatch, HELLO, **options, **changes)
        assert [line["ok"] for line in lines_of.last[0]] == [False]


def test_without_a_target_an_object_is_named_and_a_broken_session_goes_on(tmp_path, capfd, monkeypatch):
    rng, options = np.random.default_rng(1), {"sensor": Path("coarse"), "log": tmp_path / "log"}
    body = sensor().scene.sample_object("cylinder", rng)

    def named(stop_after):
        talk = Live(**options)._begun()
        assert {"target", "composition"}.isdisjoint(asked(talk, do="hello"))
        while (question := asked(talk, do="ask"))["action"] == "touch" and stop_after:
            stop_after -= 1
            image = sensor().scene.press(body, question["pose"], rng).image
            assert asked(talk, do="tell", step=question["step"], image=image.tolist())["ok"]
        return talk, question

    talk, question = named(1)
    assert question["action"] == "touch"
    talk.session.close()
    talk, question = named(20)
    assert (question["action"], question["name"]) == ("name", "cylinder")
    assert 0.95 <= question["stated"] <= 1.0
    assert asked(talk, do="state")["outcome"] is None
    assert asked(talk, do="tell", step=question["step"], done=True)["ok"]
    last = asked(talk, do="ask")
    assert (last["action"], last["outcome"], last["name"], last["stated"]) == (
        None,
        "named",
        "cylinder",
        question["stated"],
    )
    assert asked(talk, do="state")["outcome"] == "named"
    talk.session.close()


@pytest.mark.parametrize(("target", "given", "usual"), [("cone", 0.3, 0.3), ("cone", None, 0.0), (None, None, 0.05)])
def test_a_sensor_that_is_doubted_weighs_strangers_too(target, given, usual, tmp_path):
    talk = Live(target, sensor=Path("coarse"), unlisted=given, log=tmp_path / "log")._begun()
    state = asked(talk, do="state")
    talk.session.close()
    assert state["sensor_health"] == "as described"
    assert state.get("unlisted", [0.0]) == pytest.approx([usual] * (4 if usual and target else 1))


@pytest.mark.parametrize("kind", ["noise", "blank"])
def test_noise_has_no_name(kind, few_hypotheses, tmp_path):
    rng, options = np.random.default_rng(0), {"sensor": Path("coarse"), "log": tmp_path / "log", "max_touches": 6}
    talk = Live(**options)._begun()
    while (question := asked(talk, do="ask"))["action"] == "touch":
        image = rng.integers(256, size=(4, 4)) if kind == "noise" else np.zeros((4, 4), int)
        assert asked(talk, do="tell", step=question["step"], image=image.tolist())["ok"]
    asked(talk, do="tell", step=question["step"], done=True)
    if kind == "noise":  # in which random bodies are as probable as the shapes
        assert question.get("name", NONE_OF_THESE) == NONE_OF_THESE
    else:
        assert (question["action"], question["why"]) == ("unsure", "the limit of touches is reached")
        assert asked(talk, do="ask")["outcome"] == asked(talk, do="state")["outcome"] == "unsure"
    talk.session.close()


def test_a_sensor_of_recorded_touches_names_objects(tmp_path):
    known = TactileSensor.load(recorded(tmp_path / "sensor", 6))
    touches, session = known.model.sample(2, range(len(known.pose_labels)), np.random.default_rng(0)), known.naming()
    while isinstance(action := session.ask(), Probe):
        session.tell(touches[action.pose])
    session.tell()
    assert (session.outcome, session.answer) == ("confirmed", known.shape_labels[2])
    row = np.ones(known.recorded_reader.num_features).tolist()
    for field in ("features", "image"):  # which are one for recordings
        talk = NamingConversation(known.naming(), known)
        assert asked(talk, do="tell", step=0, **{field: row})["ok"]


class Quits:
    def decide(self, info, rng):
        sys.exit(0)


def test_a_decider_that_exits_ends_no_conversation():
    talk = Conversation(sensor().session("cone", Quits(), 7), sensor())
    for _ in range(2):
        answer = asked(talk, do="ask", id=1.5)
        assert (answer["error"], answer["id"], answer["step"]) == ("CodeFailed", 1.5, 0)
        assert "sys.exit(0)" in answer["message"]
    assert asked(talk, do="state")["ok"]


TRAY = Tray(size=(0.16, 0.12), num_objects=2, present=0.7)
SCENE = "drawer(size=(0.16, 0.12), present=0.7)"


@pytest.fixture(scope="module")
def in_tray():
    shapes = {name: EXTENDED_SHAPES[name] for name in ("sphere", "cube", "half_sphere", "torus")}
    return TraySensor.shipped("coarse", shapes, TRAY)


def test_a_search_in_a_tray_over_a_pipe_that_is_broken_off_is_the_search(in_tray, tmp_path, monkeypatch, capfd):
    """The lines are those of all searches; places take the part of poses."""
    monkeypatch.setattr(TraySensor, "shipped", lambda name, meshes, tray, rules, _: replace(in_tray, tray=tray))
    monkeypatch.setattr(searches, "_MADE", {})
    expected, keyed, log = in_tray.search("torus", seed=2), in_tray.touched("torus", 2), tmp_path / "log.jsonl"
    choice = SceneChoice(scene=SCENE)
    given = {"target": "torus", "sensor": Path("coarse"), "choice": choice, "objects": 2, "log": log, "seed": 2}

    def says(**request):
        (answer,), err = lines_of(capfd, monkeypatch, json.dumps(request).encode() + b"\n", **given)
        assert f"log: {log}" in err  # each line has its own session, as after a kill
        return answer

    assert says(do="hello") == {
        "ok": True,
        "schema": "activetouch live 1",
        "shapes": list(in_tray.shape_labels),
        "target": "torus",
        "num_objects": 2,
        "size": [0.16, 0.12],
        "touch_limit": 150,
        "image": {"shape": [4, 4], "dtype": "uint8"},
        "step": 0,
    }
    while (question := says(do="ask"))["action"] == "touch":
        met = keyed.press(*question["place"])
        felt = {"missed": True} if met.image is None else {"image": met.image.tolist(), "height": met.height}
        told = says(do="tell", step=question["step"], **felt)
        assert told["told"] == ("miss" if met.image is None else "touch")
    assert question["action"] == {"here": "confirm", "absent": "reject", "unsure": "unsure"}[expected.answer]
    assert question.get("place") == (None if expected.place is None else list(expected.place))
    assert says(do="tell", step=question["step"], missed=True)["message"].startswith("the search has ended")
    assert says(do="tell", step=question["step"], done=True)["told"] == "done"
    assert says(do="tell", step=question["step"], done=True)["error"] == "AlreadyTold"
    assert says(do="ask")["outcome"] == {"here": "confirmed", "absent": "exhausted"}[expected.answer]
    assert says(do="reveal", arrangement=[*map(list, keyed.world.lay)])["success"] == expected.success
    ended = says(do="state")
    assert (ended["num_touches"], ended["success"]) == (expected.num_touches, expected.success)
    assert max(ended["absent"], *(one["prob"] for one in ended["places"])) == pytest.approx(expected.stated)
    assert says(do="undo")["undone"] == "done"
    for wrong in ({"never_unsure": True}, {"choice": SceneChoice(SCENE, meshes=(tmp_path, tmp_path))}):
        with pytest.raises(BadArgument, match="the scene drawer takes"):
            Live(**{**given, **wrong}).run()
    with pytest.raises(BadReference, match="no setting 'sizes_of'; it has size"):
        Live(**{**given, "choice": SceneChoice("drawer(sizes_of=1)")}).run()
    with pytest.raises(InvalidArgument, match="another search: its size"):
        Live(**{**given, "choice": SceneChoice("drawer(present=0.7)")}).run()


def test_hostile_lines_change_nothing_in_a_tray(in_tray, tmp_path):
    session = in_tray.session("cube", log=tmp_path / "log")
    talk, rng = TrayConversation(session, in_tray), np.random.default_rng(1)
    good = {"do": "tell", "step": 0, "image": [[0, 9, 9, 0]] * 4, "height": 0.03}
    wrong = [{"height": value} for value in (None, -1, 0, "high", [])]
    wrong += [
        {"place": value} for value in ("ab", [], [1], [0.1, "x"], [0.1, 9.0], [-0.1, 0.1], {"x": 0.1}, [[0.1], [0.1]])
    ]
    wrong += [{"pose": "y45"}, {"image": [[1, 2], [3]]}, {"image": [[300] * 4] * 4}, {"missed": True}, {"done": True}]
    lines = [json.dumps({**good, **one}).encode() + b"\n" for one in wrong] + hostile(rng, 200)
    lines += [json.dumps({"do": "reveal", "arrangement": one}).encode() for one in ([], ["cube"], [["mug", 0.1, 0.1]])]
    lines += [json.dumps({"do": "reveal", "arrangement": [["cube", 0.1, at]]}).encode() for at in (2.0, "x", None)]
    before, question = (tmp_path / "log").read_bytes(), talk.answer(b'{"do": "ask"}\n')
    found = [json.loads(talk.answer(line)) for line in lines]
    assert [answer["ok"] for answer in found] == [False] * len(lines)
    assert all(answer["message"] and answer["step"] == 0 for answer in found)
    assert (talk.answer(b'{"do": "ask"}\n'), (tmp_path / "log").read_bytes()) == (question, before)
    assert asked(talk, **good)["told"] == "touch"
    session.close()
