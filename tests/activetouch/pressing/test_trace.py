"""The time series of a press, and the paper's log files."""

import numpy as np
import pandas
import pytest

from activetouch import SCENES, SHAPES, Dynamic
from activetouch.placement import Placement
from activetouch.poses import random_orientation
from activetouch.pressing.setup import Setup
from activetouch.pressing.trace import COLUMNS, Phase, write_csv
from experiments.press.touch import record_cycles

pytestmark = pytest.mark.mujoco
PAPER = SCENES["paper"].scene


def cycles(rng, shape=1, number=3):
    return record_cycles(PAPER, PAPER.sample_object(shape, rng), number, rng)


def test_pandas_reads_a_log_back_with_all_phases_in_their_order(rng, tmp_path):
    recorded = cycles(rng)
    write_csv(tmp_path / "cube.csv", recorded)
    table = pandas.read_csv(tmp_path / "cube.csv")
    assert list(table.columns) == list(COLUMNS)
    assert len(table) == sum(len(cycle) for cycle in recorded)
    assert not table.isna().any().any()
    for _, cycle in table.groupby("cycle"):
        assert list(dict.fromkeys(cycle["phase"])) == [phase.value for phase in Phase]
    assert (np.diff(table["time"]) > 0).all()
    np.testing.assert_allclose(table["fx"], np.concatenate([cycle.force[:, 0] for cycle in recorded]))
    np.testing.assert_allclose(table["z"], 0.07, atol=0.003)  # the pad's height, and the offset of a press


def test_the_force_acts_while_the_object_is_at_the_pad_and_never_before(rng):
    for cycle in cycles(rng, shape=3):
        touched = cycle.force.any(axis=1)
        phases = np.array(cycle.phase)
        assert not touched[phases == Phase.APPROACH][:-1].any()
        assert touched[phases == Phase.PAUSE].any()
        assert not touched[phases == Phase.ROTATE].any()
        assert (cycle.force[:, 0] >= 0.0).all()


def test_a_traced_press_is_the_press_itself(rng):
    placement = Placement(SHAPES["cylinder"], 1.0, random_orientation(rng))
    plain, traced = (Dynamic(traced=t).press(Setup(), placement, 2.0) for t in (False, True))
    assert plain.force == pytest.approx(traced.force, rel=1e-6)  # the plain one skips the free approach
    assert plain.trace is None
    end = traced.trace.end_of_pause
    assert traced.trace.force[end - 1, 0] == pytest.approx(traced.force, rel=1e-6)
    assert [traced.trace.phase[row] for row in (0, end - 1, -1)] == [Phase.APPROACH, Phase.PAUSE, Phase.WITHDRAW]


def test_the_contact_point_lies_under_the_imprint(rng):
    for shape in SHAPES.values():
        placement = Placement(shape, 1.0, random_orientation(rng))
        contact = Dynamic(traced=True).press(Setup(height=0.07), placement, 2.0)
        point = contact.trace.point[contact.trace.end_of_pause - 1]
        assert np.linalg.norm(point - contact.centre_of_pressure) < 0.006
