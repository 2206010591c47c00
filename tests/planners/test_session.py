"""A session asks and is told, and is the search of the loop; its log survives a kill at any byte."""

import copy
import json
import os
import pickle

import numpy as np
import pytest

from belief import Composition, Confirm, ImpossibleObservation, Probe, Reject, SearchProblem, Touch, Unsure
from belief.calibration import TemperatureScaling
from belief.errors import CannotWrite, CorruptFile, InvalidArgument, UnknownName
from belief.journal import Journal, read_journal
from belief.naming import UNKNOWN
from belief.observation_model import ConfusionModel
from belief.seeding import touch_rng
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from planners import Decision, Outcome, Session, make_decider, search
from planners.abstaining import Abstaining
from planners.episode import Episode, judged
from planners.session import AlreadyTold
from planners.session_log import OtherModel

MODEL = random_model(np.random.default_rng(0))
PROBLEM = SearchProblem(MODEL.shape_labels, ("front", "side", "top"), 4, touch_limit=20)
NAMES = ("information_gain", "random_poses", "threshold", "random_confirm")  # two of them draw random numbers


def decider(name="random_poses"):
    return make_decider(name, MODEL.outcome_table(), MODEL)


def world(seed):
    return SyntheticWorld(MODEL, sample_arrangement(PROBLEM, np.random.default_rng([seed, 5])))


def begun(name="random_poses", seed=0, **given):
    return Session(PROBLEM, decider(name), "shape_1", MODEL, seed, **{"abstain": False, **given})


def answer(session, robot):
    """Carry out one action."""
    action = session.ask()
    if isinstance(action, Probe):
        key = session.seed, session.object_index, action.pose, session.uses(action.pose)
        session.tell(robot.touch(action.pose, touch_rng(*key)), step=session.step)
        return
    session.tell()
    if isinstance(action, Reject) and session.outcome is None:
        robot.advance()


def felt(pose, *logits):
    return Touch(pose, np.array(logits))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", range(4))
def test_a_session_that_is_killed_at_every_step_is_the_search(name, seed, tmp_path):
    expected, robot, path = search(world(seed), decider(name), PROBLEM, 1, MODEL, seed), world(seed), tmp_path / "log"
    session = begun(name, seed, arrangement=robot.arrangement)
    session.save(path)
    while session.ask() is not None:
        answer(session, robot)
        session.close()  # which writes nothing
        session = Session.load(path, model=MODEL, decider=decider(name))
    assert json.dumps(session.episode.to_dict()) == json.dumps(expected.to_dict())
    assert session.scene.log_marginals().tobytes() == replayed(expected).tobytes()


def replayed(episode):
    from belief import SceneBelief

    scene = SceneBelief(PROBLEM, MODEL)
    for step in episode.steps:
        if step.touch is not None:
            scene.update(step.object_index, [step.touch])
    return scene.log_marginals()


@pytest.mark.parametrize("name", NAMES[:2])
def test_touches_that_were_taken_back_leave_no_trace(name, tmp_path):
    robot, session, rng = world(1), begun(name, 1), np.random.default_rng(3)
    session.save(tmp_path / "log")
    expected = search(world(1), decider(name), PROBLEM, 1, MODEL, 1)
    while session.ask() is not None:
        for pose in rng.integers(3, size=rng.integers(3)):
            try:
                session.tell(MODEL.sample(0, [int(pose)], rng)[0])
            except InvalidArgument:  # the touch limit
                continue
            session.ask()
            assert session.undo() == "touch"
        if rng.random() < 0.3:
            session.tell(missed=True, pose=0)
            assert session.undo() == "miss"
        answer(session, robot)
    assert [s.decision for s in session.steps] == [s.decision for s in expected.steps]
    session.close()
    again = Session.load(tmp_path / "log", model=MODEL, decider=decider(name))
    assert again.step == session.step
    assert again.scene.log_marginals().tobytes() == session.scene.log_marginals().tobytes()
    session.save(tmp_path / "copy")  # the same events from memory as line by line
    before, after = read_journal(tmp_path / "log"), read_journal(tmp_path / "copy")
    for lines in (before, after):
        for line in lines:
            line.pop("time")
    assert before == after


def test_a_log_cut_at_any_byte_loses_at_most_its_last_line(tmp_path):
    session, robot, path = begun(seed=2), world(2), tmp_path / "log"
    session.save(path)
    for _ in range(4):
        answer(session, robot)
    session.close()
    content, lines = path.read_bytes(), path.read_bytes().splitlines(keepends=True)
    first = len(lines[0])
    for cut in [*range(first, len(content), 97), len(content) - 1]:
        path.write_bytes(content[:cut])
        part = Session.load(path, model=MODEL, decider=decider())
        assert part.step == content[:cut].count(b"\n") - 1
        part.tell(part_touch(part))
        part.close()
        assert len(read_journal(path)) == part.step + 1
    for damaged in (lines[1], *lines[2:], lines[0][:-20] + b"\n" + lines[1], lines[0].replace(b"20", b"21") + lines[1]):
        path.write_bytes(lines[0] + damaged if damaged in lines[2:] else damaged)
        with pytest.raises(CorruptFile, match="log"):
            Session.load(path, model=MODEL, decider=decider())


def part_touch(session):
    action = session.ask()
    return felt(action.pose if isinstance(action, Probe) else 0, 0.1, 0.2, 0.3, 0.5)


def test_a_disk_that_is_full_changes_nothing(tmp_path, monkeypatch):
    session = begun()
    session.save(tmp_path / "log")
    asked, belief = session.ask(), session.belief.probs.tobytes()

    def full(handle, content):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(os, "write", full)
        with pytest.raises(CannotWrite, match="No space"):
            session.tell(part_touch(session))
    assert (session.ask(), session.belief.probs.tobytes(), session.step) == (asked, belief, 0)
    session.tell(part_touch(session))
    assert len(read_journal(tmp_path / "log")) == 2


def test_a_file_is_one_sessions_log(tmp_path):
    session = begun()
    session.save(tmp_path / "log")
    session.save(tmp_path / "log")
    with pytest.raises(CannotWrite, match="exists"):
        begun().save(tmp_path / "log")
    with pytest.raises(CannotWrite, match="in use"):
        Session.load(tmp_path / "log", model=MODEL, decider=decider())
    session.close()
    with pytest.raises(OtherModel, match="another model"):
        Session.load(tmp_path / "log", model=random_model(np.random.default_rng(9)), decider=decider())
    (tmp_path / "other").write_text('{"a": 1}\n')
    with pytest.raises(CorruptFile, match="SHA-256"):
        Session.load(tmp_path / "other", model=MODEL, decider=decider())


def test_the_log_says_which_decider_began_it_and_goes_on_with_no_other(tmp_path):
    begun("information_gain(confirm=0.97)", abstain=True).save(tmp_path / "log")
    header = read_journal(tmp_path / "log")[0]
    assert (header["decider"]["class"], header["decider"]["promise"]) == ("Abstaining", 0.95)
    stopping = header["decider"]["decider"]["stopping"]
    assert stopping == {"class": "PosteriorThresholds", "confirm": 0.97, "reject": 0.01, "max_touches": 12}
    for other, told in (
        (decider("information_gain"), "its confirm is 0.97, not 0.99"),
        (decider("information_gain(confirm=0.97, max_touches=3)"), "its max_touches is 12, not 3"),
        (decider("random_poses(confirm=0.97)"), "its probing is 'TargetInformationGain', not 'RandomOrder'"),
        (Confirms(), "its decider is 'SequentialDecider', not 'Confirms'"),
        (Abstaining(decider("information_gain(confirm=0.97)"), promise=0.5), "its promise is 0.95, not 0.5"),
    ):
        with pytest.raises(OtherModel, match=f"began with another decider: {told}"):
            Session.load(tmp_path / "log", model=MODEL, decider=other)
    Session.load(tmp_path / "log", model=MODEL, decider=decider("information_gain(confirm=0.97)")).close()


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda session: pickle.loads(pickle.dumps(session))])
def test_a_copy_of_a_session_goes_on_by_itself(copied, tmp_path):
    session, robot = begun("random_poses", 3), world(3)
    session.save(tmp_path / "log")
    for _ in range(2):
        answer(session, robot)
    twin, before = copied(session), session.belief.probs.tobytes()
    lines = (tmp_path / "log").read_bytes()
    assert (twin.belief.probs.tobytes(), twin.ask(), twin.step) == (before, session.ask(), 2)
    twin.tell(part_touch(twin))
    twin.undo()
    twin.tell(part_touch(twin))
    twin.reveal(["shape_1"] * 4)
    assert (session.belief.probs.tobytes(), session.step, len(session.steps)) == (before, 2, 2)
    assert session.arrangement == (UNKNOWN,) * 4
    assert (tmp_path / "log").read_bytes() == lines
    while session.ask() is not None:
        answer(session, robot)
    expected = search(world(3), decider("random_poses"), PROBLEM, 1, MODEL, 3)
    assert [step.decision for step in session.steps] == [step.decision for step in expected.steps]


@pytest.mark.parametrize(
    ("place", "name", "values"),
    [
        ("line", "object", (-1, 4, 0.5, True, None, "0")),
        ("line", "force", (-1, True, "1", 10**400)),
        ("line", "area", (-1e-9, [1])),
        ("line", "told", ("felt", None, 3)),
        ("line", "pose", (3, "back", -1)),
        ("header", "target", ("mug", 4, -1)),
        ("header", "seed", ([-1], "a", [0.5])),
        ("header", "least_force", (-1, "x")),
        ("header", "least_area", (-1, [])),
        ("header", "arrangement", (["shape_1"], [9, None, None, None])),
        ("problem", "num_objects", (0, -1, 2.5, 5, 10**9)),
        ("problem", "touch_limit", (0, -1, 2.5)),
        ("problem", "touch_cost", (-1, "x")),
        ("problem", "unsure_reward", (-2, 1, "x")),
        ("problem", "composition", ("heap", {"shape_0": -1}, 3)),
    ],
)
def test_a_log_with_a_number_out_of_its_range_is_refused_though_it_is_sealed(place, name, values, tmp_path):
    session = begun()
    session.tell(part_touch(session), pose=0, force=1.0, area=1e-5)
    session.save(tmp_path / "log")
    session.close()
    for number, value in enumerate(values):
        header, line = read_journal(tmp_path / "log")
        {"line": line, "header": header, "problem": header["problem"]}[place][name] = value
        Journal.create(tmp_path / f"{number}", [header, line]).close()
        with pytest.raises(CorruptFile, match="is no log of a session"):
            Session.load(tmp_path / f"{number}", model=MODEL, decider=decider())


class Probes:
    def decide(self, info, rng):
        return Decision(Probe(1))


class Confirms:
    def decide(self, info, rng):
        return Decision(Confirm())


def test_without_truth_a_session_may_be_unsure_and_has_no_success():
    unknown = Session(PROBLEM, Confirms(), 1, MODEL)
    assert unknown.problem.unsure_reward == 0.0
    assert unknown.ask() == Unsure()  # 0.25 is less than any promise
    unknown.tell()
    episode = unknown.episode
    assert (episode.outcome, episode.success, episode.arrangement) == (Outcome.UNSURE, None, (UNKNOWN,) * 4)
    assert (
        Episode.from_dict(json.loads(json.dumps(episode.to_dict())), MODEL.shape_labels).arrangement == (UNKNOWN,) * 4
    )
    assert "unsure, no answer" in str(episode)
    plain = Session(PROBLEM, Confirms(), 1, MODEL, abstain=False)
    assert plain.ask() == Confirm()
    plain.tell()
    assert plain.episode.success is None
    assert "truth unknown" in str(plain.episode)
    with pytest.raises(InvalidArgument, match="true shapes"):
        plain.episode.reward(PROBLEM)
    plain.reveal(["shape_1", None, None, None])
    assert plain.episode.success
    assert plain.episode.reward(PROBLEM) == 1.0
    known = plain.episode
    assert judged([episode, known]) == [known]


def test_revealed_shapes_are_in_the_log(tmp_path):
    session = begun()
    session.save(tmp_path / "log")
    session.reveal([None, "shape_2", 0, None])
    session.close()
    assert Session.load(tmp_path / "log", model=MODEL, decider=decider()).arrangement == (-1, 2, 0, -1)


def test_a_log_whose_name_is_too_long_cannot_be_written(tmp_path):
    with pytest.raises(CannotWrite, match="cannot be written: File name too long"):
        begun().begun(tmp_path / ("x" * 300))


@pytest.mark.parametrize("is_given", [True, False])
def test_true_shapes_of_before_the_log_are_in_it_whoever_goes_on_with_it(is_given, tmp_path):
    shapes = ["shape_3", "shape_2", None, None] if is_given else None
    session = begun(abstain=True, arrangement=shapes)
    if not is_given:
        session.reveal(["shape_3", "shape_2", None, None])
    session.save(tmp_path / "log")
    session.close()
    resumed = begun(abstain=True)
    resumed.resume(tmp_path / "log")
    assert resumed.arrangement == (3, 2, UNKNOWN, UNKNOWN)
    resumed.reveal([0, 2, 1, 3])
    resumed.close()
    same = begun(abstain=True, arrangement=["shape_3", "shape_2", None, None])
    same.resume(tmp_path / "log")
    assert same.arrangement == (0, 2, 1, 3)
    same.close()
    with pytest.raises(InvalidArgument, match="another search: its arrangement is"):
        begun(abstain=True, arrangement=[1, 2, 3, 0]).resume(tmp_path / "log")
    unknown = begun(abstain=True)
    unknown.save(tmp_path / "unknown")
    unknown.close()
    known = begun(abstain=True, arrangement=[1, 2, 3, 0])
    known.resume(tmp_path / "unknown")
    assert known.arrangement == (1, 2, 3, 0)


class KnowsMisses(ConfusionModel):
    """A miss says that the object is the first shape."""

    def missed(self, pose):
        return felt(pose, 9.0, 0.0, 0.0, 0.0)


def test_a_miss_is_evidence_only_where_the_model_knows_misses():
    session = begun("information_gain", least_force=0.2)
    asked, before = session.ask(), session.belief.probs.tobytes()
    for told in ({"missed": True}, {"touch": felt(asked.pose, 9.0, 0, 0, 0), "force": 0.1}):
        assert (session.ask(), session.belief.probs.tobytes()) == (asked, before)
        assert session.tell(**told) == "miss"
        assert (session.steps[-1].touch, session.steps[-1].decision.scores["is_miss"]) == (None, 1.0)
    session.tell(felt(asked.pose, 9.0, 0, 0, 0), force=0.21)
    assert session.belief.probs.tobytes() != before
    knows = KnowsMisses(
        MODEL.shape_labels, MODEL.outcome_table().probs.transpose(0, 1, 2), TemperatureScaling(1.0, "ok")
    )
    session = Session(PROBLEM, decider("information_gain"), 1, knows, abstain=False)
    session.tell(missed=True)
    assert session.belief.probs.argmax() == 0
    assert session.uses(asked.pose) == 1


def test_after_two_misses_another_pose_is_asked_for_and_at_the_limit_it_is_unsure(tmp_path):
    session, asked = begun("fixed_poses", abstain=True), []
    session.save(tmp_path / "log")
    while isinstance(action := session.ask(), Probe):
        asked.append(action.pose)
        session.tell(missed=True)
    limit = PROBLEM.touch_limit
    assert asked == [0, 0, 1, 1, 2, 2, *([0, 1, 2] * limit)][:limit]
    assert (action, session.reason) == (Unsure(), "the limit of touches is reached")
    session.close()
    again = Session.load(tmp_path / "log", model=MODEL, decider=decider("fixed_poses"))
    assert again.ask() == Unsure()
    assert again.tell() == "done"
    assert (again.outcome, again.answer) == ("unsure", None)
    plain = begun("fixed_poses", abstain=False)
    while plain.ask() is not None:
        plain.tell(missed=True)
    assert plain.outcome == "truncated"


def test_touches_that_were_not_asked_for_are_evidence():
    session = begun("information_gain")
    other = (session.ask().pose + 1) % 3
    session.tell(felt(session.ask().pose, 0.0, 5.0, 0.0, 0.0), pose=PROBLEM.pose_labels[other])
    assert session.uses(other) == 1
    assert session.steps[-1].decision.action == Probe(other)
    assert session.steps[-1].decision.scores == {"is_unasked": 1.0}


def test_what_cannot_be_meant_is_refused_and_changes_nothing():
    session = begun("information_gain")
    touch, step = part_touch(session), session.step
    for error, told in (
        (InvalidArgument, {}),
        (InvalidArgument, {"touch": touch, "missed": True}),
        (InvalidArgument, {"touch": "cone"}),
        (InvalidArgument, {"touch": felt(7, 0, 0, 0, 0)}),
        (ValueError, {"touch": felt(0, 0.0, 1.0)}),
        (UnknownName, {"touch": touch, "pose": "bottom"}),
        (InvalidArgument, {"touch": touch, "force": float("nan")}),
        (InvalidArgument, {"touch": touch, "area": -1.0}),
        (InvalidArgument, {"image": np.zeros((2, 2), np.uint8)}),
        (InvalidArgument, {"touch": touch, "step": 1}),
        (InvalidArgument, {"pose": 0}),
    ):
        with pytest.raises(error):
            session.tell(**told)
    assert (session.step, session.steps, session.belief.probs.tolist()) == (step, (), [0.25] * 4)
    for odd in (True, 0.0, "0", -1, np.int64(1)):
        with pytest.raises(InvalidArgument, match="step must be the integer 0, which was asked"):
            session.tell(touch, step=odd)
    session.tell(touch, step=np.int64(0))
    with pytest.raises(AlreadyTold, match="step 0 was answered"):
        session.tell(touch, step=0)
    with pytest.raises(InvalidArgument, match="nothing was told"):
        begun().undo()
    with pytest.raises(InvalidArgument, match="arrangement"):
        begun(arrangement=["shape_1"])
    with pytest.raises(InvalidArgument, match="least_force"):
        begun(least_force=-1.0)


def test_after_the_end_nothing_is_told_but_the_last_may_be_taken_back(tmp_path):
    short = SearchProblem(MODEL.shape_labels, PROBLEM.pose_labels, 2, Composition.INDEPENDENT, touch_limit=2)
    session = Session(short, Probes(), 1, MODEL, abstain=False)
    session.save(tmp_path / "log")
    while session.ask() is not None:
        session.tell(felt(session.ask().pose, 0, 0, 0, 0))
    assert session.outcome is Outcome.TRUNCATED
    with pytest.raises(InvalidArgument, match="has ended"):
        session.tell(felt(0, 0, 0, 0, 0))
    session.close()
    session = Session.load(tmp_path / "log", model=MODEL, decider=Probes())
    assert session.outcome is Outcome.TRUNCATED
    assert session.undo() == "touch"
    assert isinstance(session.ask(), Probe)
    ended = Session(PROBLEM, Confirms(), 1, MODEL, abstain=False)
    ended.ask()
    ended.tell()
    assert (ended.outcome, ended.ask()) == (Outcome.CONFIRMED, None)
    assert (ended.undo(), ended.outcome, ended.ask()) == ("done", None, Confirm())


def test_an_impossible_touch_leaves_the_session_as_it_was():
    certain = ConfusionModel(MODEL.shape_labels, np.tile(np.eye(4), (3, 1, 1)), TemperatureScaling(1.0, "ok"))
    session = Session(PROBLEM, decider("fixed_poses"), 1, certain, abstain=False)
    session.tell(felt(0, -1e4, -1e4, 0.0, -1e4))
    before = session.belief.probs.tobytes(), session.step, session.ask()
    with pytest.raises(ImpossibleObservation):
        session.tell(felt(1, 0.0, -1e4, -1e4, -1e4))
    assert (session.belief.probs.tobytes(), session.step, session.ask()) == before
