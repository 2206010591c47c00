import json
from dataclasses import replace

import numpy as np
import pytest

from belief import Confirm, Probe, SearchProblem, Unsure
from belief.errors import CorruptFile, InvalidArgument
from belief.journal import Journal, read_journal
from belief.synthetic import SyntheticWorld, random_model, sample_arrangement
from planners import SequentialDecider, Session, search
from planners.certified import NEVER, WANTED, Certificate, Certified, NotCertified
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
