"""Several touches of one body: what the command measures, on a small collection."""

import json

import numpy as np
import pytest

from activetouch.data.manifest import CollectionPlan
from activetouch.sensor_files import MODELS, READER_FILE
from belief.statistics import wilson_interval
from benchmarks.several_touches import (
    SeveralTouches,
    after_touches,
)
from experiments.scene_choice import SceneChoice
from experiments.sensor.collect import collect


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


@pytest.mark.nightly
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
