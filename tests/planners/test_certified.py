import copy
import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from belief import Confirm, Probe, Reject, SearchProblem, Unsure
from belief.errors import CorruptFile, InvalidArgument
from belief.files import sealed_json
from belief.journal import Journal, read_journal
from belief.statistics.online_stops import OnlineStops
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from planners import SequentialDecider, Session, search
from planners.certified import NEVER, SCHEMA, WANTED, Certificate, Certified, NotCertified, learned
from planners.probing import FixedOrder
from planners.session_log import OtherModel
from planners.stopping import PosteriorThresholds

MODEL = random_model(np.random.default_rng(3), sharpness=3.0)
PROBLEM = SearchProblem(MODEL.shape_labels, ("p0", "p1", "p2"), 3, touch_limit=40, unsure_reward=0.0)
EAGER = SequentialDecider(PosteriorThresholds(0.6, 0.02), FixedOrder())
WORLD = {"scene": {"pad": 1, "noise": 0.1}, "decider": "eager", "targets": ["shape_0"]}
CERTIFICATE = Certificate("eager", 0.05, 0.9, 100, (np.inf, 0.9, 0.5), (0, 30, 20), (0, 1, 0), 4, WORLD)


def played(thresholds, seed):
    world = SyntheticWorld(MODEL, sample_arrangement(PROBLEM, np.random.default_rng([seed, 9])))
    return search(world, Certified(EAGER, thresholds, max_touches=4), PROBLEM, 0, MODEL, seed)


def actions(episode):
    return [(step.object_index, step.decision.action) for step in episode.steps]


def test_a_search_with_thresholds_is_the_beginning_of_the_one_that_confirms_nothing():
    confirmed = 0
    for seed in range(20):
        whole, ends = played(NEVER, seed), []
        assert not any(isinstance(step.decision.action, Confirm) for step in whole.steps)
        for thresholds in ((0.0,), (np.inf, 0.95, 0.8, 0.0)):
            episode = played(thresholds, seed)
            number = len(episode.steps)
            assert actions(episode)[:-1] == actions(whole)[: number - 1]
            ends.append(isinstance(episode.steps[-1].decision.action, Confirm))
            if ends[-1]:
                index, prob = whole.steps[number - 1].object_index, whole.steps[number - 1].decision.scores[WANTED]
                touches = sum(
                    step.object_index == index and step.touch is not None for step in whole.steps[: number - 1]
                )
                assert prob >= thresholds[min(touches, len(thresholds) - 1)]
        confirmed += all(ends)
    assert confirmed > 6


def test_without_a_limit_the_decider_is_followed_and_below_it_touches_are_spread_until_the_answer_is_unsure():
    for seed in range(10):
        plain = search(
            SyntheticWorld(MODEL, sample_arrangement(PROBLEM, np.random.default_rng([seed, 9]))),
            EAGER, PROBLEM, 0, MODEL, seed,
        )  # fmt: skip
        assert actions(played((0.0,), seed)) == actions(plain)
        whole = played(NEVER, seed)
        if isinstance(whole.steps[-1].decision.action, Unsure):
            assert whole.steps[-1].decision.scores["is_uncertified"] == 1.0
            of_last = [a.pose for i, a in actions(whole) if i == whole.steps[-1].object_index and isinstance(a, Probe)]
            assert len(of_last) == 4
            assert set(of_last) == {0, 1, 2}


def test_a_search_without_the_answer_unsure_and_numbers_out_of_range_are_refused(rng):
    world = SyntheticWorld(MODEL, sample_arrangement(PROBLEM, rng))
    with pytest.raises(InvalidArgument, match="I do not know"):
        search(world, Certified(EAGER, (0.9,)), replace(PROBLEM, unsure_reward=None), 0, MODEL, 0)
    for wrong in ((), (np.nan,), (-0.1,)):
        with pytest.raises(InvalidArgument, match="thresholds"):
            Certified(EAGER, wrong)


def test_a_certificate_comes_back_from_its_file_and_a_changed_file_is_refused(tmp_path):
    CERTIFICATE.save(tmp_path / "a.json")
    assert Certificate.load(tmp_path / "a.json") == CERTIFICATE
    text = (tmp_path / "a.json").read_text()
    for name, content in {"b": text.replace("0.9", "0.8"), "c": "{}", "d": json.dumps([1]), "e": ""}.items():
        (tmp_path / name).write_text(content)
        with pytest.raises(CorruptFile, match="is no certificate"):
            Certificate.load(tmp_path / name)
    with pytest.raises(FileNotFoundError, match="activetouch certify"):
        Certificate.load(tmp_path / "none.json")


def test_a_certificate_holds_for_what_it_was_made_for_alone():
    assert CERTIFICATE.wrap(EAGER, WORLD) == Certified(EAGER, (np.inf, 0.9, 0.5), 4)
    for change, told in (
        ({"scene": {"pad": 1, "noise": 0.2}}, "the scene: other noise"),
        ({"decider": "patient"}, "the decider: eager, not patient"),
        ({"sensor": "abc"}, "the sensor: None, not abc"),
    ):
        with pytest.raises(NotCertified, match=told):
            CERTIFICATE.wrap(EAGER, WORLD | change)


def test_the_log_of_a_session_keeps_the_rule_that_ends_it_and_older_logs_have_none(tmp_path):
    limits, log = (np.inf, np.float32(0.9)), tmp_path / "log.jsonl"
    begun = Session(PROBLEM, Certified(EAGER, limits, 4), 0, MODEL, abstain=False)
    begun.save(log)
    begun.close()
    for other in (Certified(EAGER, limits, 2), Certified(EAGER, (0.9,), 4), EAGER):
        with pytest.raises(OtherModel, match="another certificate, or without one"):
            Session.load(log, model=MODEL, decider=other)
    Session.load(log, model=MODEL, decider=Certified(EAGER, limits, 4)).close()
    header = {
        name: value for name, value in read_journal(log)[0].items() if name not in ("line", "sha256", "stop_rule")
    }
    Journal.create(tmp_path / "older.jsonl", [header]).close()
    Session.load(tmp_path / "older.jsonl", model=MODEL, decider=Certified(EAGER, limits, 4)).close()


def ended(decider, seed=0, problem=PROBLEM, **rules):
    """A session that was played to its end."""
    session = Session(problem, decider, 0, MODEL, seed, abstain=False, **rules)
    world = SyntheticWorld(MODEL, sample_arrangement(problem, np.random.default_rng([seed, 9])))
    while (action := session.ask()) is not None:
        session.tell(world.touch(action.pose, np.random.default_rng()) if isinstance(action, Probe) else None)
        if isinstance(action, Reject) and session.outcome is None:
            world.advance()
    return session


def test_a_certificate_counts_each_session_that_stopped_by_it_once(tmp_path):
    decider = CERTIFICATE.wrap(EAGER, WORLD)
    session, other = ended(decider), ended(decider)  # the same search with other touches
    session.save(tmp_path / "log")
    session.close()
    loaded = Session.load(tmp_path / "log", model=MODEL, decider=decider)
    once = CERTIFICATE.after(session)
    for same in (session, loaded, copy.copy(session)):
        with pytest.raises(InvalidArgument, match="counts a session once, and has counted this one before"):
            once.after(same)
    loaded.undo()
    loaded.ask()
    loaded.tell()
    with pytest.raises(InvalidArgument, match="once"):
        once.after(loaded)
    twice = once.after(other)
    assert (len(twice.since), len({*twice.counted})) == (2, 2)
    twice.save(tmp_path / "certificate")
    with pytest.raises(InvalidArgument, match="once"):
        Certificate.load(tmp_path / "certificate").after(session)
    loaded.close()


def test_a_certificate_counts_no_session_of_something_else():
    def signed(**changes):
        return replace(CERTIFICATE, made_for={**WORLD, **changes})

    for session, told in (
        (ended(EAGER), "this one had none: begin it with sensor.session"),
        (ended(Certified(EAGER, CERTIFICATE.thresholds, 4)), "this one had none"),
        (ended(signed(decider="patient").wrap(EAGER, {**WORLD, "decider": "patient"})), "the decider: eager, not pat"),
        (ended(signed(scene={"pad": 2}).wrap(EAGER, {**WORLD, "scene": {"pad": 2}})), "the scene: other pad, noise"),
        (ended(signed(sensor="a").wrap(EAGER, {**WORLD, "sensor": "a"})), "the sensor: None, not a"),
        (ended(replace(CERTIFICATE, thresholds=(0.0, 0.0, 0.0)).wrap(EAGER, WORLD)), "another certificate"),
        (ended(replace(CERTIFICATE, max_touches=3).wrap(EAGER, WORLD)), "another certificate"),
    ):
        with pytest.raises(InvalidArgument, match=told):
            CERTIFICATE.after(session)


@pytest.mark.parametrize(
    ("name", "values"),
    {
        "risk": (2, 0, 1, -0.05, "0.05", None, [0.05]),
        "confidence": (-1, 0, 1, 1e300),
        "num_searches": (0, -1, 2.5, True, None),
        "max_touches": (0, -2, 3.5),
        "thresholds": ([], [-0.1, 0.9, 0.5], [1.5, 0.9, 0.5], [0.9], "abc", [None, "x", 0.5]),
        "stops": ([0, -30, 20], [0, 30.5, 20], [0, 30], [0, True, 20], None),
        "wrong": ([0, 31, 0], [0, -1, 0], [0, 0.5, 0], [0]),
        "usual": ([[0, 0.1]], [[-1, 0.1, 0.2]], [[0.5, 0.1, 0.2]], [[0, 1e300, 0.2]], [[0, "x", 0.2]], 3),
        "since": ([[0, 0.1, -1e10]], [[0, None, 0.2]]),
        "counted": (["a"], 3),
        "made_for": ({}, {"targets": []}, {"targets": "shape_0"}, {"targets": [3]}, None),
    }.items(),
)
def test_a_certificate_with_a_number_out_of_its_range_is_refused_though_it_is_sealed(name, values, tmp_path):
    CERTIFICATE.save(tmp_path / "right.json")
    right = json.loads((tmp_path / "right.json").read_text())
    del right["sha256"]
    assert Certificate.load(tmp_path / "right.json").made_for == WORLD
    for value in values:
        (tmp_path / "wrong.json").write_text(sealed_json({**right, name: value}))
        with pytest.raises(CorruptFile, match="is no certificate"):
            Certificate.load(tmp_path / "wrong.json")
    assert right["schema"] == SCHEMA


def test_a_certificate_of_an_earlier_version_knows_of_no_counted_sessions(tmp_path):
    fields = {**asdict(CERTIFICATE), "thresholds": [None, 0.9, 0.5], "since": [[0, 0.5, 0.5]], "schema": SCHEMA}
    del fields["counted"]
    (tmp_path / "older.json").write_text(sealed_json(fields))
    assert Certificate.load(tmp_path / "older.json").counted == ()


def test_stops_learn_from_searches_whose_shapes_are_revealed():
    stops, rng = OnlineStops(risk=0.2), np.random.default_rng(0)
    for seed in range(3):
        shapes = sample_arrangement(PROBLEM, np.random.default_rng([seed, 9]))
        world = SyntheticWorld(MODEL, shapes)
        session = Session(PROBLEM, Certified(EAGER, NEVER, max_touches=4), 0, MODEL, seed)
        while (action := session.ask()) is not None:
            if isinstance(action, Probe):
                session.tell(world.touch(action.pose, rng))
            else:
                session.tell()
                if session.outcome is None:
                    world.advance()
        wanted = [step for step in session.steps if WANTED in step.decision.scores]
        if wanted:
            with pytest.raises(InvalidArgument, match="reveal"):
                learned(stops, session)
        session.reveal(shapes)
        before, stops = stops, learned(stops, session)
        assert stops.num_outcomes == before.num_outcomes + bool(wanted)
        assert stops.num_wrong == before.num_wrong + bool(wanted and shapes[wanted[0].object_index] != 0)
    assert stops.num_outcomes > 0
