"""Whether thresholds that learn from reported outcomes keep their promise at all times, and when they are regained.

    python -m benchmarks.online_stops --replays 1000

The answers state 0.95 to 0.999. In a world in which a share of 0.055 is wrong, no threshold may be accepted for a risk
of 0.05; "ever" is the share of replays in which one is, within 500 outcomes. Then a good sensor (0.001 wrong, as
searches by touch are) breaks after 300 outcomes (half are wrong) and is repaired as soon as the threshold is withdrawn.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from belief.statistics.online_stops import OnlineStops
from belief.table import Table

GOOD, BROKEN, RISK = 0.001, 0.5, 0.05


def outcomes_until(
    stops: OnlineStops, wrong: float, most: int, rng: np.random.Generator, is_promised: bool
) -> tuple[OnlineStops, int]:
    """The stops once something is promised, or nothing any more, and after how many outcomes; -1 for never."""
    for number in range(most):
        if (stops.threshold < math.inf) == is_promised:
            return stops, number
        stops = stops.after(float(rng.uniform(0.95, 0.999)), bool(rng.random() < wrong))
    return stops, -1


def main() -> None:
    """Replay, and print how often the promise is broken and after how many outcomes it is there."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--replays", type=int, default=1_000)
    given = parser.parse_args()
    ever, first, lost, again = 0, [], [], []
    for replay in range(given.replays):
        rng = np.random.default_rng([3, replay])
        ever += outcomes_until(OnlineStops(RISK), 1.1 * RISK, 500, rng, is_promised=True)[1] >= 0
        stops, count = outcomes_until(OnlineStops(RISK), GOOD, 600, rng, is_promised=True)
        first.append(count)
        for _ in range(max(300 - count, 0)):
            stops = stops.after(float(rng.uniform(0.95, 0.999)), bool(rng.random() < GOOD))
        stops, count = outcomes_until(stops, BROKEN, 600, rng, is_promised=False)
        lost.append(count)
        again.append(outcomes_until(stops, GOOD, 600, rng, is_promised=True)[1])
    rows = [
        (name, *np.percentile(counts, [50, 90, 99]).tolist(), sum(count < 0 or count > 200 for count in counts))
        for name, counts in (("first promise", first), ("withdrawn after it broke", lost), ("regained", again))
    ]
    columns = ["outcomes until", ("median", ".0f"), ("90 %", ".0f"), ("99 %", ".0f"), ("more than 200", "d")]
    note = f"{given.replays} replays; promised ever where {1.1 * RISK:g} are wrong: {ever / given.replays:.3f}."
    print(Table("", columns, rows, note))


if __name__ == "__main__":
    main()
