"""Sequences keep the laws they are named for, and the report stands alone."""

import json
import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from activetouch.data.dataset import CollectionPlan, TouchSet
from belief import metrics
from belief.calibration import TemperatureScaling
from belief.metrics import StopScore
from belief.observation_model import RatioModel
from belief.statistics.stop_thresholds import CandidateStops
from belief.touch_batch import TouchBatch
from experiments.calibration import measurements
from experiments.calibration.calibration_report import CalibrationReport, NoRepeats
from experiments.calibration.measurements import KINDS, Rounds, score_model
from experiments.scene_choice import SceneChoice
from experiments.sensor.collect import collect

N, R, P, K = 7, 4, 3, 2


@pytest.fixture
def rounds():
    """Every touch's first logit says which it is: object, round and pose."""
    logits = np.zeros((N, R, P, K))
    logits[..., 0] = np.arange(N * R * P).reshape(N, R, P)
    return Rounds(logits, np.arange(N) % K)


def identify(sequences):
    """Object, round and pose of each touch, ``(S, n)`` each."""
    return np.unravel_index(sequences.batch.logits[..., 0].astype(int), (N, R, P))


@pytest.mark.parametrize("kind", list(KINDS))
def test_a_sequence_has_one_object_its_poses_and_no_touch_twice(kind, rounds, rng):
    sequences = KINDS[kind](rounds, rng)
    objects, _, poses = identify(sequences)
    assert (objects == sequences.object_ids[:, None]).all()
    assert (poses == sequences.batch.poses).all()
    assert (sequences.shapes == rounds.shapes[sequences.object_ids]).all()
    for touches in sequences.batch.logits[..., 0]:
        assert len(set(touches)) == len(touches)


@pytest.mark.parametrize(("kind", "per_object", "length"), [("distinct poses", R, P), ("one pose", P, R)])
def test_distinct_and_repeated_poses_use_every_touch_once(kind, per_object, length, rounds, rng):
    sequences = KINDS[kind](rounds, rng)
    assert sequences.batch.poses.shape == (N * per_object, length)
    assert sorted(sequences.batch.logits[..., 0].ravel()) == list(range(N * R * P))


def test_one_pose_stays_and_its_rounds_come_in_random_order(rounds, rng):
    sequences = rounds.one_pose(rng)
    _, order, poses = identify(sequences)
    assert (poses == poses[:, :1]).all()
    assert (np.sort(order, axis=1) == np.arange(R)).all()
    assert len(np.unique(order, axis=0)) > 5


def test_touches_of_a_collection_lie_object_by_object_and_round_by_round():
    count = 2 * 3 * P
    logits = np.arange(count * K, dtype=float).reshape(count, K)
    blank, sizes = np.zeros(count), np.repeat([0.9, 1.1], 3 * P)
    touches = TouchSet(
        blank, np.repeat([1, 0], 3 * P), np.repeat([5, 9], 3 * P), np.tile(np.arange(P), 6), blank, blank, sizes=sizes
    )
    read = TouchBatch(touches.poses[None], logits[None], features=-logits[None, :, :1])
    found = Rounds.of(touches, read, P)
    assert found.logits.shape == (2, 3, P, K)
    assert found.shapes.tolist() == [1, 0]
    assert (found.logits.reshape(-1, K) == logits).all()
    for gather in KINDS.values():  # features go with their logits
        batch = gather(found, np.random.default_rng(0)).batch
        assert (batch.features == -batch.logits[..., :1]).all()


def test_a_search_stops_at_the_first_touch_that_is_sure_enough():
    probs = np.array(
        [
            [[0.6, 0.4], [0.95, 0.05], [0.99, 0.01]],  # sure after two
            [[0.5, 0.5], [0.6, 0.4], [0.9, 0.1]],  # never
            [[0.03, 0.97], [0.5, 0.5], [1.0 - 1e-9, 1e-9]],  # at once, and wrongly
        ]
    )
    found = CandidateStops.of_posteriors(np.log(probs), np.array([0, 0, 0]))
    rows = found.stops([0.9499])
    assert found.searches[rows].tolist() == [0, 2]
    assert found.touches[rows].tolist() == [2, 1]
    assert found.probs[rows] == pytest.approx([0.95, 0.97])
    assert found.is_wrong[rows].tolist() == [False, True]
    assert len(CandidateStops.of_posteriors(np.log(probs[1:2]), np.array([0])).stops([0.95])) == 0


def world(rng, num_objects, num_rounds, shared=1.0, scale=1.0):
    """Logits that are log-likelihood ratios of Gaussian touches, of which a part repeats in a pose."""
    shapes = np.arange(num_objects) % K
    repeats = rng.normal(size=(num_objects, 1, P, 1)) * np.sqrt(shared)
    alone = rng.normal(size=(num_objects, num_rounds, P, 1)) * np.sqrt(1.0 - shared)
    x = np.where(shapes == 0, 1.0, -1.0)[:, None, None, None] + repeats + alone
    return Rounds(scale * np.concatenate([x, -x], axis=3), shapes)


def test_taking_repeats_for_independent_claims_more_than_is_right(rng):
    model = RatioModel(("a", "b"), TemperatureScaling(1.0, "ok"), np.full(2, 0.5), 0.9, np.zeros((P, 1, 2)))
    sequences = {"one pose": world(rng, 2000, R, 0.9).one_pose(rng)}
    honest, naive = (score_model("ratio", replace(model, correlation=rho), sequences, 0.95, rng) for rho in (0.9, 0.0))
    overall: list[StopScore] = [found.stops["one pose"].overall for found in (honest, naive)]
    assert abs(overall[0].mean_stated - overall[0].share_right) < 0.01
    assert overall[1].mean_stated - overall[1].share_right > 0.03
    assert naive.fused["one pose"][-1].nll > honest.fused["one pose"][-1].nll


@pytest.fixture(scope="module")
def collection(tmp_path_factory):
    """Touches of a few objects, in two rounds."""
    folder = tmp_path_factory.mktemp("touches") / "coarse-repeats"
    plan = CollectionPlan(train=0, calibration=4, test=3, repeats=2)
    collect(SceneChoice("coarse", fidelity="quasistatic"), plan, folder, jobs=1)
    return folder


@pytest.mark.slow
@pytest.mark.mujoco
@pytest.mark.torch
def test_the_report_of_a_joint_sensor_has_its_model_and_stands_alone(collection, tmp_path, monkeypatch):
    monkeypatch.setattr(measurements, "_NULL_RESAMPLES", 20)
    monkeypatch.setattr(metrics, "calibration_report", partial(metrics.calibration_report, num_resamples=20))
    CalibrationReport("coarse", collection, Path("coarse"), tmp_path, anyway=True).run()
    page, numbers = (tmp_path / "report.html").read_text(), json.loads((tmp_path / "numbers.json").read_text())
    assert "rigid body" in {model["name"] for model in numbers["models"]}
    pictures = {"reliability.svg", "reliability.png", "stops_one_pose.csv", "stops_one_pose.tex"}
    assert {path.name for path in tmp_path.iterdir()} >= {"report.html", "numbers.json", "tables.md"} | pictures
    assert not re.search(r"(src|href)=\"(?!data:|#)|@import|<link|<script[^>]*src|url\((?!#)", page)
    assert numbers["num_objects"] == {"calibration": 16, "test": 12}
    error = numbers["models"][0]["fused"]["one pose"][0]["ece"]["value"]
    assert f"({error:.4f}"[1:] in page
    assert next(iter(numbers["touches"])) == "raw softmax"
    assert numbers["touches"]["structured_matrix"]["num_rows"] == 12 * 2 * 6
    assert "the largest error after any number of touches is: distinct poses" in page


@pytest.mark.mujoco
def test_a_collection_without_repeats_is_refused(tmp_path):
    folder = tmp_path / "once"
    collect(
        SceneChoice("coarse", fidelity="quasistatic"), CollectionPlan(train=0, calibration=1, test=1), folder, jobs=1
    )
    with pytest.raises(NoRepeats, match=r"Record several rounds: collect .*--plan\.repeats 6"):
        CalibrationReport(data=folder, out=tmp_path / "out").run()
    assert not (tmp_path / "out").exists()
