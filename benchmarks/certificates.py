"""Certificates of one decider in one scene: errors in fresh searches, extra touches, and how often promises are broken.

    python -m benchmarks.certificates coarse --calibration 4000 --fresh 2000

For risks of 0.05 and 0.01: the certificate; stops and errors by number of touches in fresh searches, with exact 95 %
limits; touches with and without the certificate in the same fresh searches, with a bootstrap interval of the mean
difference; and the share of 50 certificates, made from calibration searches that are drawn again, that break the
promise. For the last, all searches of this run are the world: calibration searches are drawn from them with
replacement, and the errors of a certificate are its errors in all of them. A search that confirms nothing lists every
moment at which an object could have been confirmed, so one set of searches serves all certificates.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from belief.statistics import clopper_pearson_interval, paired_bootstrap
from belief.statistics.stop_thresholds import CandidateStops, certified_thresholds
from experiments.scene_choice import SceneChoice
from experiments.search.certify import Calibration, play_calibration, with_unsure
from experiments.search.comparison import prepared
from experiments.search.setting import Setting

RISKS, CERTIFICATES = (0.05, 0.01), 50


def show(
    calibration: CandidateStops, fresh: Calibration, every: CandidateStops, risk: float, confidence: float
) -> None:
    made, candidates = certified_thresholds(calibration, risk, confidence), fresh.candidates
    print(f"\nrisk {risk:g}, confidence {confidence:g}, {calibration.num_searches} calibration searches")
    print(f"{'touches':>9s}{'confirm at':>12s}{'tested':>8s}{'wrong':>7s}{'fresh':>8s}{'wrong':>7s}  95 %")
    for touches, (limit, stops, wrong) in enumerate(
        zip(made.thresholds, *candidates.counts(made.thresholds), strict=True)
    ):
        low, high = clopper_pearson_interval(int(wrong), int(stops)) if stops else (0.0, 1.0)
        name = f"≥ {touches}" if touches == len(made.thresholds) - 1 else str(touches)
        tested = f"{made.stops[touches]:8d}{made.wrong[touches]:7d}"
        print(f"{name:>9s}{limit:12.6f}{tested}{stops:8d}{wrong:7d}  [{low:.4f}, {high:.4f}]")
    plain, certified = (fresh.touches_with(limits).astype(float) for limits in ([0.0], made.thresholds))
    more = paired_bootstrap(certified, plain, np.random.default_rng(0))
    stopped = len(candidates.stops(made.thresholds)), len(candidates.stops([0.0]))
    print(
        f"fresh searches that confirm: {stopped[0]} of {candidates.num_searches}; without the certificate {stopped[1]}"
    )
    interval = f"{more[0]:+.3f} [{more[1]:+.3f}, {more[2]:+.3f}]"
    print(f"touches: {certified.mean():.3f}, without the certificate {plain.mean():.3f}; difference {interval}")
    rng, broken, shares = np.random.default_rng(1), 0, []
    for _ in range(CERTIFICATES):
        drawn = every.of(rng.integers(every.num_searches, size=calibration.num_searches))
        again = certified_thresholds(drawn, risk, confidence)
        stops, wrong = every.counts(again.thresholds)
        broken += bool((wrong > risk * stops).any())
        shares.append(stops.sum() / len(every.stops([0.0])))
    print(
        f"{CERTIFICATES} certificates from searches drawn again: {broken} break the promise at some number of touches; "
        f"they confirm in {np.mean(shares):.3f} of the searches in which the decider does, the least {min(shares):.3f}"
    )


def main() -> None:
    """Play, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--decider", default="information_gain")
    parser.add_argument("--calibration", type=int, default=4000)
    parser.add_argument("--fresh", type=int, default=2000)
    parser.add_argument("--max-touches", type=int, default=6)
    parser.add_argument("--confidence", type=float, default=0.9)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    run = prepared(Setting(SceneChoice(given.scene)), given.decider, seed=given.seed, jobs=1)
    searches = replace(run.searches, problem=with_unsure(run.searches.problem))
    number = given.calibration + given.fresh
    played = play_calibration(searches, run.deciders[given.decider], number, run.targets, given.max_touches, jobs=1)
    every, first = played.candidates, given.calibration
    rows = every.searches >= first
    fresh = Calibration(every.between(first, number), played.spent[rows], played.num_touches[first:])
    stops, wrong = every.counts([0.0] * (given.max_touches + 1))
    print(
        f"{given.decider} in {given.scene}, {number} searches, seed {given.seed}: uncertified stops by touches, wrong"
    )
    for touches, (stop, error) in enumerate(zip(stops, wrong, strict=True)):
        print(f"{touches:>9d}{stop:8d}{error:7d}")
    for risk in RISKS:
        show(every.between(0, first), fresh, every, risk, given.confidence)


if __name__ == "__main__":
    main()
