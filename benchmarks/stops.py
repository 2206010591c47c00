"""Whether searches that state at least 0.95 are right in 0.95, by scene, decider and touches of the confirmed object.

    python -m benchmarks.stops runs/compare-coarse runs/compare-gel

Rows are groups with at least 200 such confirmations, and all numbers of touches together.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

from belief import Confirm
from belief.metrics import calibration_at_stop
from belief.statistics import wilson_interval
from planners import Episode

STATED, ENOUGH = 0.95, 200


def confident_stops(episodes: list[Episode]) -> Iterator[tuple[int | None, int, float]]:
    """Touches of the confirmed object (None for all), number of confirmations that state 0.95, fraction right."""
    found = []
    for episode in episodes:
        last = episode.steps[-1] if episode.steps else None
        if last is not None and isinstance(last.decision.action, Confirm):
            touches = sum(step.touch is not None and step.object_index == last.object_index for step in episode.steps)
            found.append((min(float(last.belief.probs[episode.target]), 1.0), episode.success, touches))
    found = [stop for stop in found if stop[0] >= STATED]
    if found:
        stated, right, numbers = zip(*found, strict=True)
        scores = calibration_at_stop(stated, right, numbers)
        for score in (*scores.by_num_touches, scores.overall):
            if score.num_touches is None or score.count >= ENOUGH:
                yield score.num_touches, score.count, score.share_right


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, help="from activetouch compare")
    print(f"{'folder':16s}{'decider':22s}{'touches':>8s}{'stops':>7s}{'right':>8s}  95 %")
    for folder in parser.parse_args().folders:
        by_decider: dict[str, list[Episode]] = {}
        for line in (folder / "episodes.jsonl").read_text(encoding="utf-8").splitlines():
            fields = json.loads(line)
            unnamed = tuple(f"shape {number}" for number in range(len(fields["steps"][0]["belief"])))
            by_decider.setdefault(fields["decider"], []).append(Episode.from_dict(fields, unnamed))
        for decider, episodes in by_decider.items():
            for touches, number, share in confident_stops(episodes):
                low, high = wilson_interval(round(share * number), number)
                words = "all" if touches is None else str(touches)
                print(f"{folder.name:16s}{decider:22s}{words:>8s}{number:7d}{share:8.4f}  [{low:.3f}, {high:.3f}]")


if __name__ == "__main__":
    main()
