"""Stops on recorded touches whose features drift after the sensor was made: stated, right, and withheld.

    python -m benchmarks.recorded_drift --data tests/fixtures/bts3 --format bts3
    python -m benchmarks.recorded_drift --data cy101.npz --format npz

A sensor learns from the first four fifths of the sessions of each object, or from other objects for labels that are not
objects. The rest are named in random order, each in a session of its own; with ``--carried``, the evidence of the
conflict test is carried from each session to the next. Offsets are in units of each feature's standard deviation, with
a random sign for each feature; one grows from object to object. Prints for each drift how many objects are named, what
these stops state, and how many are right, with a 95 % bootstrap over objects. All others end unsure.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from activetouch import RecordedSensor
from activetouch.recorded import RecordedTouches, read_recorded
from activetouch.recorded.touches import splits_of
from belief.problem import Confirm, Probe
from experiments.sensor.scores import accuracy_of_objects
from planners.search import log_bets_after

Floats = NDArray[np.float64]
Drift = Callable[[Floats, float], Floats]


def drifts(touches: RecordedTouches, rng: np.random.Generator) -> dict[str, Drift]:
    """What features ``(F,)`` become after a share of the objects."""
    unit = touches.features.std(axis=0) * rng.choice([-1.0, 1.0], touches.features.shape[1])
    found: dict[str, Drift] = {"none": lambda row, _: row}
    for size in (0.25, 0.5, 1.0, 2.0):
        found[f"offset of {size:g}"] = lambda row, _, size=size: row + size * unit  # type: ignore[misc]
    found["offset that grows to 2"] = lambda row, share: row + 2.0 * share * unit
    found["factor of 1.2"] = lambda row, _: 1.2 * row
    return found


def named(
    sensor: RecordedSensor, held: RecordedTouches, drift: Drift, threshold: float, rounds: int, seed: int, carried: bool
) -> list[tuple[int, bool, float, bool]]:
    """Of each session: the object, whether it is named, with which probability, and whether rightly."""
    rng, bets, found = np.random.default_rng([seed, 1]), np.zeros(()), []
    order = [index for _ in range(rounds) for index in rng.permutation(np.unique(held.objects)).tolist()]
    for number, index in enumerate(order):
        rows = {action: here for action in range(held.num_actions) if len(here := places(held, index, action, rng))}
        limit = sum(map(len, rows.values()))
        session = sensor.naming(seed=[seed, number], threshold=threshold, max_touches=limit, log_bets=bets)
        while isinstance(asked := session.ask(), Probe):
            action = asked.pose if len(rows.get(asked.pose, ())) else next(one for one in rows if len(rows[one]))
            row, rows[action] = rows[action][0], rows[action][1:]
            session.tell(image=drift(held.features[row], number / len(order)), pose=action)
        session.tell()
        label = held.label_names[held.labels[held.objects == index][0]]
        found.append((index, isinstance(asked, Confirm), session.stated, session.answer == label))
        if carried:
            bets = log_bets_after(session.episode, session.problem, sensor.model, bets)
    return found


def places(held: RecordedTouches, index: int, action: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Rows of the touches of an object with an action, in random order."""
    return rng.permutation(np.flatnonzero((held.objects == index) & (held.actions == action)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", required=True)
    parser.add_argument("--format", default="csv")
    parser.add_argument("--task", default="objects")
    parser.add_argument("--threshold", type=float, default=0.9)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--carried", action="store_true")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    touches = read_recorded(given.data, given.format)[0].for_task(given.task)
    parts = []
    for split in splits_of(touches, 5):
        known = np.ones(touches.num_touches, np.bool_)
        known[split.test] = False
        parts.append((RecordedSensor.fit(touches.only(known)), touches.only(~known)))
    print(f"{given.task}: {len(np.unique(touches.objects))} objects, {len(touches.label_names)} labels")
    rules = given.threshold, given.rounds, given.seed, given.carried
    for name, drift in drifts(touches, np.random.default_rng(given.seed)).items():
        found = [one for part in parts for one in named(*part, drift, *rules)]
        stops = np.array([(index, stated, is_right) for index, is_named, stated, is_right in found if is_named])
        text = f"{name}: {len(stops)} of {len(found)} named"
        if len(stops):
            right, low, high = accuracy_of_objects(stops[:, 2], stops[:, 0], np.random.default_rng(0))
            text += f", stated {stops[:, 1].mean():.3f}, right {right:.3f} [{low:.3f}, {high:.3f}]"
        print(text, flush=True)


if __name__ == "__main__":
    main()
