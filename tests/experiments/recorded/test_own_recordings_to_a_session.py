"""From a CSV of real grasps to a live session: bts3, with grasps that nothing was trained on in place of a robot."""

from pathlib import Path

import numpy as np
import pytest

from activetouch import RecordedSensor, TactileSensor
from activetouch.errors import BadRecording
from activetouch.recorded import read_recorded
from belief import Probe

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
        read_recorded(tmp_path / "log.jsonl", "session")


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
    touches, _ = read_recorded(log, "session")
    assert touches.num_touches == sum(isinstance(action, Probe) for action in begun)
    for row, thing in zip(touches.features, touches.objects, strict=True):
        named = names.index(touches.object_names[thing])
        assert (row == grasps.features[grasps.objects == named]).all(axis=1).any()
