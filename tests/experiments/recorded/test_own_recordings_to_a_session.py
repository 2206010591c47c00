"""From a CSV of real grasps to a live session: bts3, with grasps that nothing was trained on in place of a robot."""

import os
from pathlib import Path

import numpy as np
import pytest

from activetouch import RecordedSensor, TactileSensor
from activetouch.errors import BadRecording
from activetouch.recorded import read_recorded
from activetouch.recorded.session_log import logged_touches
from belief import Probe
from benchmarks.recorded_sets.cy101 import read_cy101
from benchmarks.recorded_sets.sdh2 import read_sdh2

BTS3 = Path(__file__).parents[2] / "fixtures" / "bts3"


@pytest.fixture(scope="module")
def grasps():
    return read_recorded(BTS3, "bts3")[0]


@pytest.fixture(scope="module")
def held(grasps):
    """Names of objects, and rows of the last fifth of the grasps of each with each pose."""
    names = grasps.object_names[:8]
    last = {}
    for index in range(len(names)):
        for action in range(3):
            rows = np.flatnonzero((grasps.objects == index) & (grasps.actions == action))
            last[index, action] = rows[-(len(rows) // 5) :]
    return names, last


@pytest.fixture(scope="module")
def sensor(grasps, held, tmp_path_factory):
    """The sensor that a CSV of the other grasps gives, saved and loaded."""
    names, last = held
    folder, test = tmp_path_factory.mktemp("mine"), set(np.concatenate([*last.values()]).tolist())
    lines = ["object,action," + ",".join(grasps.feature_names)]
    for row in np.flatnonzero(grasps.objects < len(names)).tolist():
        if row not in test:
            words = names[grasps.objects[row]], grasps.action_names[grasps.actions[row]]
            lines.append(",".join([*words, *map(str, grasps.features[row])]))
    (folder / "touches.csv").write_text("\n".join(lines))
    touches, _ = read_recorded(folder, "csv")
    RecordedSensor.fit(touches).save(folder / "sensor")
    return TactileSensor.load(folder / "sensor")


def played(session, table, grasps, last, stop_after=None):
    """A robot that grasps the objects on the table until the session ends; what it was asked."""
    rng, asked = np.random.default_rng(0), []
    while (action := session.ask()) is not None and len(asked) != stop_after:
        asked.append(action)
        draw = rng.integers(1 << 30)
        if isinstance(action, Probe):
            pose = grasps.action_names.index(session.problem.pose_labels[action.pose])
            rows = last[table[session.object_index], pose]
            session.tell(image=grasps.features[rows[draw % len(rows)]])
        else:
            session.tell()
    return asked


def test_sessions_find_objects_by_grasps_that_nothing_was_trained_on(sensor, grasps, held):
    names, last = held
    right = 0
    for target in range(4):
        session = sensor.among(names[:4]).session(names[target], num_objects=4, abstain=False, seed=target)
        table = np.random.default_rng(target).permutation(4)
        played(session, table, grasps, last)
        session.reveal([names[index] for index in table])
        right += session.episode.success
    assert right >= 3


def test_a_damaged_log_is_refused_by_name(tmp_path):
    (tmp_path / "log.jsonl").write_text("{}")
    with pytest.raises(BadRecording, match=r"log\.jsonl"):
        logged_touches(tmp_path / "log.jsonl")


def test_a_session_with_a_log_goes_on_as_if_nothing_had_happened(sensor, grasps, held, tmp_path):
    names, last = held
    table, log = [3, 0, 2, 1], tmp_path / "today.jsonl"
    whole = played(sensor.session(names[0], num_objects=4), table, grasps, last)
    session = sensor.session(names[0], num_objects=4, log=log)
    begun = played(session, table, grasps, last, stop_after=3)
    session.close()
    assert begun == whole[:3]
    again = sensor.session(names[0], num_objects=4, log=log)
    assert again.ask() == whole[3]
    again.reveal([names[index] for index in table])
    again.close()
    header, touches = logged_touches(log)
    assert header["target"] == names[0]
    assert len(touches) == sum(isinstance(action, Probe) for action in begun)
    for touch in touches:
        assert touch.label == names[table[touch.object_index]]
        assert (touch.arrays["image"] == grasps.features[grasps.objects == names.index(touch.label)]).all(axis=1).any()


@pytest.mark.parametrize(("name", "task"), [("cy101", "categories"), ("sdh2", "shapes")])
def test_sets_that_this_project_may_not_contain_become_sensors_where_they_are(name, task, tmp_path):
    folder = os.environ.get(f"ACTIVETOUCH_{name.upper()}")
    if not folder:
        pytest.skip(f"ACTIVETOUCH_{name.upper()} names no folder with {name}")
    touches, _ = {"cy101": read_cy101, "sdh2": read_sdh2}[name](Path(folder))
    RecordedSensor.fit(touches, task).save(tmp_path)
    sensor = TactileSensor.load(tmp_path)
    labels, chosen = sensor.shape_labels[:3], touches.for_task(task)
    session = sensor.among(labels).session(labels[1], num_objects=3, abstain=False)
    rows = {
        (index, action): chosen.rows[(chosen.labels == index) & (chosen.actions == action)]
        for index in range(3)
        for action in range(touches.num_actions)
    }
    played(session, [2, 0, 1], touches, rows)
    session.reveal([labels[index] for index in (2, 0, 1)])
    assert session.episode.success
