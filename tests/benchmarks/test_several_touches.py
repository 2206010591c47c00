"""Several touches of one body: what the command measures, on a small collection."""

import json
from dataclasses import replace
from itertools import accumulate, chain

import numpy as np
import pytest

from activetouch.data.dataset import CollectionPlan, TouchSet
from activetouch.perception.reader import TactileReader
from activetouch.sensor_files import MODELS, READER_FILE
from belief.observation_model.rigid_body_evidence import RigidBodyEvidence
from belief.statistics import wilson_interval
from belief.touch_batch import TouchBatch
from benchmarks.belief_cost import belief_cost
from benchmarks.precision import in_precision
from benchmarks.several_touches import (
    Entry,
    SeveralTouches,
    _milliseconds,
    after_touches,
    draw,
    first_round,
    in_random_orders,
)
from experiments.command_line.arguments import BadArgument
from experiments.scene_choice import SceneChoice
from experiments.sensor.collect import collect
from experiments.sensor.scores import read_images


def test_each_object_keeps_its_touches_in_orders_of_its_own():
    """Two rounds of three poses of four objects: of each pose the first touch, and no touch of another object."""
    objects, poses = np.repeat(np.arange(4), 6), np.tile(np.arange(3), 8)
    logits = np.stack([objects, np.arange(24) % 6], axis=1).astype(float)
    nothing = np.zeros(24)
    truth = TouchSet(np.zeros((24, 2, 2), np.uint8), objects % 2, objects, poses, nothing, nothing)
    found = in_random_orders(TouchBatch(poses[None], logits[None], logits[None]), truth, number=5, seed=0)
    assert found.poses.shape == (20, 3)
    assert (np.sort(found.poses, axis=1) == np.arange(3)).all()
    assert (found.logits[..., 0] == np.tile(np.arange(4), 5)[:, None]).all()
    assert (found.logits[..., 1] == found.poses).all()  # the first round
    assert (found.features == found.logits).all()
    assert len({tuple(order) for order in found.poses[::4].tolist()}) > 1
    first = first_round(truth, 3)
    assert first.object_ids.tolist() == np.repeat(np.arange(4), 3).tolist()
    assert first.poses.tolist() == np.tile(np.arange(3), 4).tolist()
    numbered = replace(truth, forces=np.arange(24.0))
    assert (first_round(numbered, 3).forces.reshape(4, 3) == 6 * np.arange(4)[:, None] + np.arange(3)).all()


def test_a_touch_costs_its_share_of_the_processor_time_and_the_arrays_of_its_model(body, monkeypatch):
    monkeypatch.setattr("benchmarks.belief_cost.time.thread_time", iter([10.0, 15.0]).__next__)
    updated, update = [], RigidBodyEvidence.update
    monkeypatch.setattr(RigidBodyEvidence, "update", lambda self, touch: updated.append(self) or update(self, touch))
    cost = belief_cost(body, 4)
    assert cost.update == pytest.approx(100.0)  # 5 s for 50 touches
    assert (
        len({id(evidence) for evidence in updated}) == len(updated) == 51
    )  # each adds to the one before; one to begin
    held = [*vars(body).values(), body.table]
    arrays = {id(value): value.nbytes for value in held if isinstance(value, np.ndarray)}
    assert cost.memory == sum(arrays.values()) / 1e6


def test_the_time_of_a_reading_is_the_median(monkeypatch):
    ticks = accumulate(chain([0.0], *((seconds, 1.0) for seconds in [0.002] * 16 + [9.0] * 14)))
    monkeypatch.setattr("benchmarks.several_touches.time.thread_time", ticks.__next__)
    assert _milliseconds(lambda: None) == pytest.approx(2.0)


def test_what_a_reader_makes_of_touches_keeps_their_order(rng):
    poses = rng.integers(6, size=300)
    for name in ("coarse", "paper-independent"):
        reader = TactileReader.load(MODELS / name / READER_FILE)
        images = rng.integers(256, size=(300, *reader.card.image_shape), dtype=np.uint8)
        found = read_images(reader, images, poses, "reading")
        assert found.logits.shape[:2] == found.poses.shape == (1, 300)
        np.testing.assert_array_equal(found.poses[0], poses)
        assert (found.features is None) == (reader.hypotheses is None)
        for number in (0, 255, 256, 299):
            alone = reader.read(images[number : number + 1])
            np.testing.assert_allclose(found.logits[0, number], alone.logits[0], atol=1e-3)
            if found.features is not None:
                np.testing.assert_allclose(found.features[0, number], alone.embeddings[0], atol=1e-3)


def test_a_network_of_eight_bits_reads_nearly_the_same():
    reader = TactileReader.load(MODELS / "coarse" / READER_FILE)
    images = np.random.default_rng(0).integers(256, size=(8, *reader.card.image_shape), dtype=np.uint8)
    exact, rounded = (in_precision(reader, name).read(images).embeddings for name in ("float32", "int8"))
    assert 0.0 < np.abs(exact - rounded).max() < 0.05 * np.abs(exact).max()
    assert len(in_precision(reader, "int8").network) < len(reader.network)


def test_scores_of_known_posteriors():
    log_probs, shapes = np.log([[0.9, 0.1], [0.9, 0.1], [0.2, 0.8], [0.4, 0.6]]), np.array([0, 1, 1, 1])
    found = after_touches(log_probs, shapes, np.arange(4), touches=2, seed=0)
    assert found.accuracy == 0.75
    assert found.accuracy_interval == wilson_interval(3, 4)
    assert found.nll == pytest.approx(-np.log([0.9, 0.1, 0.8, 0.6]).mean())
    assert found.stated == pytest.approx(0.8)
    assert found.gap == pytest.approx(0.05)
    assert found.nll_interval[0] < found.nll < found.nll_interval[1]
    assert found.gap_interval[0] < found.gap < found.gap_interval[1]


def test_more_orders_of_the_same_objects_do_not_narrow_the_intervals():
    """They hold for unseen objects, however often each of these was touched."""
    log_probs, shapes = np.log([[0.9, 0.1], [0.9, 0.1], [0.2, 0.8], [0.4, 0.6]]), np.array([0, 1, 1, 1])
    once = after_touches(log_probs, shapes, np.arange(4), touches=2, seed=0)
    again = after_touches(np.tile(log_probs, (3, 1)), np.tile(shapes, 3), np.tile(np.arange(4), 3), touches=2, seed=0)
    assert again.accuracy_interval == once.accuracy_interval
    assert again.nll_interval == pytest.approx(once.nll_interval)
    assert again.gap_interval == pytest.approx(once.gap_interval)


def test_only_many_touches_are_drawn_too(tmp_path):
    results = [after_touches(np.log([[0.9, 0.1]] * 4), np.zeros(4, int), np.arange(4), n, seed=0) for n in (6, 4)]
    entries = [Entry("cnn 16 px", "float32", number, tuple(results), 1.0, 0.1, 1.0) for number in (0, 64)]
    draw(entries, "coarse", tmp_path / "drawn.svg")
    assert "4 touches" in (tmp_path / "drawn.svg").read_text()


@pytest.mark.mujoco
def test_more_touches_and_more_hypotheses_tell_more(tmp_path, capsys):
    data = tmp_path / "data"
    collect(SceneChoice("paper"), CollectionPlan(0, 6, 6, repeats=1), data, jobs=1)
    readers = (MODELS / "paper" / READER_FILE, MODELS / "paper-independent" / READER_FILE)
    SeveralTouches("paper", readers, data, hypotheses=(2, 512), touches=(1, 4), out=tmp_path / "out").run()
    independent, few, many, of_shapes = json.loads((tmp_path / "out" / "several-touches.json").read_text())["entries"]
    assert [entry["hypotheses"] for entry in (independent, few, many, of_shapes)] == [0, 2, 512, 0]
    one, four = many["results"]
    assert four["accuracy"] >= 0.9  # 0.99 on thousands of objects
    assert four["nll"] < one["nll"]
    assert four["nll"] < few["results"][1]["nll"]
    table = 6 * 4 * 64 * 4 / 1e6  # poses, shapes, embedding, bytes: of one hypothesis
    assert many["megabytes"] - few["megabytes"] == pytest.approx(510 * table)
    assert (tmp_path / "out" / "several-touches.svg").exists()
    assert "N = 512" in (tmp_path / "out" / "several-touches.md").read_text()


def test_more_touches_than_poses_are_refused(tmp_path):
    with pytest.raises(BadArgument, match="at most 6"):
        SeveralTouches("coarse", touches=(7,), out=tmp_path / "out").run()
    assert not (tmp_path / "out").exists()
