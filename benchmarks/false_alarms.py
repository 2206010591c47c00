"""Measure how often the conflict test and the alarm of certificates sound in unchanged worlds with odd objects.

Run: python benchmarks/false_alarms.py         (some minutes on one core)

All objects, of the calibration and of the searches, come from one world, so every alarm is false. A search touches each
object one to six times in turn, 25 touches in all; its test is read after every touch, against log(1 / 0.02).
Embeddings have three normal numbers, misfits are exponential. In all touches of an odd object, embeddings are four
times as far away, and misfits five times as large. In those of a heavy-tailed object both are multiplied by |t|, where
t has Student's distribution with two degrees of freedom.

Then the same worlds with the alarm of :mod:`belief.statistics.exchangeability`, at 1 / 0.05: a set-up makes 1000
searches of five objects; the calibration are other searches. Scores of a search are those of certificates: the sum of
misfits by the square root of their number, and the mean squared length of embeddings.
"""

from __future__ import annotations

import numpy as np

from belief.conflict import ConflictTest, log_conflict
from belief.statistics import clopper_pearson_interval, cluster_bootstrap
from belief.statistics.exchangeability import log_e_values
from belief.validation import Floats

TOUCHES, MOST_OF_AN_OBJECT, ALARM = 25, 6, np.log(1 / 0.02)
NUM_TESTS, NUM_SEARCHES = 40, 50
CALIBRATION_OBJECTS = (20, 200, 1200)
ODD = {"no odd objects": 0.0, "0.5 % odd objects": 0.005, "1 % odd objects": 0.01, "3 % odd objects": 0.03}
HEAVY = "heavy-tailed objects"
CALIBRATION_SEARCHES, SET_UPS, SEARCHES, OBJECTS = (200, 2000), 300, 1000, 5


def draw(rng: np.random.Generator, world: str, number: int) -> tuple[Floats, Floats]:
    """Embeddings and misfits of some objects."""
    embeddings = rng.normal(size=(number, MOST_OF_AN_OBJECT, 3))
    misfits = rng.exponential(size=(number, MOST_OF_AN_OBJECT))
    if world == HEAVY:
        size = np.abs(rng.standard_t(2.0, size=(2, number)))
    else:
        size = np.where(rng.random(number) < ODD[world], [[4.0], [5.0]], 1.0)
    return embeddings * size[0, :, None, None], misfits * size[1, :, None]


def has_alarm(rng: np.random.Generator, test: ConflictTest, world: str) -> bool:
    """Whether a search has an alarm."""
    bets, left = np.zeros(1), TOUCHES
    while left:
        number = min(left, int(rng.integers(1, MOST_OF_AN_OBJECT + 1)))
        state, left = test.start(), left - number
        embeddings, misfits = draw(rng, world, 1)
        for touch in range(number):
            state = state.update(embeddings[0, touch], misfits[0, touch])
            if log_conflict([bets, state.log_bets]) > ALARM:
                return True
        bets = bets + state.log_bets
    return False


def scores(rng: np.random.Generator, world: str, number: int) -> Floats:
    """Scores of some searches, ``(number, 2)``."""
    embeddings, misfits = draw(rng, world, number * OBJECTS)
    felt = np.arange(MOST_OF_AN_OBJECT) < rng.integers(1, MOST_OF_AN_OBJECT + 1, number * OBJECTS)[:, None]
    felt, later = felt.reshape(number, -1), (felt & (np.arange(MOST_OF_AN_OBJECT) > 0)).reshape(number, -1)
    total = (misfits.reshape(number, -1) * later).sum(axis=1) / np.sqrt(np.maximum(later.sum(axis=1), 1))
    lengths = np.square(embeddings).sum(axis=2).reshape(number, -1)
    return np.stack([total, (lengths * felt).sum(axis=1) / felt.sum(axis=1)], axis=1)


def main() -> None:
    rng = np.random.default_rng(0)
    print(
        f"{'world':<24}{'objects':>8}   false alarms, 95 % interval ({NUM_TESTS} tests, {NUM_SEARCHES} searches each)"
    )
    for world in (*ODD, HEAVY):
        for number in CALIBRATION_OBJECTS:
            alarms = np.zeros((NUM_TESTS, NUM_SEARCHES))
            for row in alarms:
                test = ConflictTest.fit(*draw(rng, world, number), np.arange(number) % 2)
                assert test is not None
                row[:] = [has_alarm(rng, test, world) for _ in range(NUM_SEARCHES)]
            tests = np.repeat(np.arange(NUM_TESTS), NUM_SEARCHES)
            mean, low, high = cluster_bootstrap(alarms.ravel(), tests, rng)
            print(f"{world:<24}{number:>8}   {mean:.3f} [{low:.3f}, {high:.3f}]", flush=True)
    print(f"\n{'world':<24}{'searches':>8}   alarms of certificates, 95 % interval ({SET_UPS} set-ups)")
    for world in (*ODD, HEAVY):
        for number in CALIBRATION_SEARCHES:
            heard = 0
            for seed in range(SET_UPS):
                known, since = scores(rng, world, number), scores(rng, world, SEARCHES)
                e_values = log_e_values(known, np.zeros(number), since, np.zeros(SEARCHES), seed)
                heard += int(e_values.max() >= np.log(1 / 0.05))
            low, high = clopper_pearson_interval(heard, SET_UPS)
            print(f"{world:<24}{number:>8}   {heard / SET_UPS:.3f} [{low:.3f}, {high:.3f}]", flush=True)


if __name__ == "__main__":
    main()
