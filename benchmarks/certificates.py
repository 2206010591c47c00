"""Certificates of one decider in one scene: errors in fresh searches, extra touches, broken promises, and alarms.

    python -m benchmarks.certificates coarse --calibration 4000 --fresh 2000 --worlds "noise × 2" "stiffness × 0.7"

For risks of 0.05 and 0.01: the certificate; stops and errors by number of touches in fresh searches; touches with and
without the certificate; and the share of 50 certificates, from resampled calibration searches, whose errors in all
searches of this run break the promise. A search that confirms nothing lists every moment at which an object could have
been confirmed, so one set of searches serves all certificates.

Alarms that withdraw a certificate are counted in the certified world, in one sequence of all fresh searches and in
sessions of 250 from 200 shuffles of all searches; and in other worlds, each a condition of ``robustness`` or "blunt
cone" (of 0.6 times the height), with eight robots of 40 searches each. For these it prints the robots with an alarm,
their median searches and touches until then, and how many stops are right: of all that a certificate for a risk of 0.05
allows, and of those before the alarm.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from activetouch import Scene
from activetouch.solids.primitives import Cone
from belief.statistics import clopper_pearson_interval, cluster_bootstrap, paired_bootstrap
from belief.statistics.exchangeability import log_e_values
from belief.statistics.stop_thresholds import CandidateStops, certified_thresholds
from experiments.robustness.conditions import CONDITIONS, DoesNotApply
from experiments.scene_choice import SceneChoice
from experiments.search.certify import CalibrationSearch, candidate_stops, play_calibration
from experiments.search.comparison import prepared
from experiments.search.play import Setting
from planners.certified import FALSE_ALARM

RISKS, CERTIFICATES = (0.05, 0.01), 50
ROBOTS, SEARCHES = 8, 40
SESSION, SHUFFLES = 250, 200
BLUNT = "blunt cone"


def touches_with(played: Sequence[CalibrationSearch], thresholds: ArrayLike) -> np.ndarray:
    """Touches of each search that stops by these thresholds, ``(N,)``; ``[0.0]`` is the decider alone."""
    candidates, touches = candidate_stops(played), np.array([search.num_touches for search in played])
    spent = np.array([stop[-1] for search in played for stop in search.stops], int)
    stops = candidates.stops(np.asarray(thresholds).tolist())
    touches[candidates.searches[stops]] = spent[stops]
    return touches


def show(
    calibration: CandidateStops,
    fresh: Sequence[CalibrationSearch],
    every: CandidateStops,
    risk: float,
    confidence: float,
) -> None:
    made, candidates = certified_thresholds(calibration, risk, confidence), candidate_stops(fresh)
    print(f"\nrisk {risk:g}, confidence {confidence:g}, {calibration.num_searches} calibration searches")
    print(f"{'touches':>9s}{'confirm at':>12s}{'tested':>8s}{'wrong':>7s}{'fresh':>8s}{'wrong':>7s}  95 %")
    for touches, (limit, stops, wrong) in enumerate(
        zip(made.thresholds, *candidates.counts(made.thresholds), strict=True)
    ):
        low, high = clopper_pearson_interval(int(wrong), int(stops)) if stops else (0.0, 1.0)
        name = f"≥ {touches}" if touches == len(made.thresholds) - 1 else str(touches)
        tested = f"{made.stops[touches]:8d}{made.wrong[touches]:7d}"
        print(f"{name:>9s}{limit:12.6f}{tested}{stops:8d}{wrong:7d}  [{low:.4f}, {high:.4f}]")
    plain, certified = (touches_with(fresh, limits).astype(float) for limits in ([0.0], made.thresholds))
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


def first_alarm(known: np.ndarray, since: np.ndarray, seed: int) -> int:
    """Number of searches until the alarm, or one more than there are; searches are rows of target and fit."""
    found = log_e_values(known[:, 1:], known[:, 0], since[:, 1:], since[:, 0], seed) >= -np.log(FALSE_ALARM)
    return 1 + int(found.argmax() if found.any() else len(found))


def show_false_alarms(calibration: np.ndarray, fresh: np.ndarray) -> None:
    number, every, rng = len(calibration), np.concatenate([calibration, fresh]), np.random.default_rng(2)
    first, alarms = first_alarm(calibration, fresh, 0), []
    for _ in range(SHUFFLES):
        mixed = rng.permutation(every)
        sessions = [mixed[begin : begin + SESSION] for begin in range(number, len(mixed) - SESSION + 1, SESSION)]
        alarms.append([first_alarm(mixed[:number], one, seed) <= SESSION for seed, one in enumerate(sessions)])
    told = f"an alarm in search {first}" if first <= len(fresh) else "no alarm"
    rows = np.repeat(np.arange(SHUFFLES), len(alarms[0]))
    share, low, high = cluster_bootstrap(np.ravel(alarms), rows, rng) if alarms[0] else (np.nan,) * 3
    print(f"\nalarms in the certified world, at most {FALSE_ALARM:g}: {told} in {len(fresh)} fresh searches in turn;")
    print(f"in sessions of {SESSION} searches {share:.4f} [{low:.4f}, {high:.4f}], {np.size(alarms)} sessions")


def show_world(world: str, calibration: np.ndarray, played: Sequence[CalibrationSearch], thresholds: ArrayLike) -> None:
    """Print when robots in another world have an alarm, and which stops are right."""
    candidates, fits = candidate_stops(played), np.array([search.fit for search in played])
    stops, touches = candidates.stops(thresholds), touches_with(played, thresholds)
    is_wrong, ends = dict(zip(candidates.searches[stops], candidates.is_wrong[stops], strict=True)), []
    right: list[list[bool]] = [[], []]
    for robot in range(ROBOTS):
        own = np.arange(robot * SEARCHES, (robot + 1) * SEARCHES)
        end = first_alarm(calibration, fits[own], robot)
        ends += [(end, touches[own[:end]].sum())] if end <= SEARCHES else []
        for group, searches in zip(right, (own, own[:end]), strict=True):
            group += [not is_wrong[search] for search in searches if search in is_wrong]
    median = ", {:g} searches, {:g} touches".format(*np.median(ends, axis=0)) if ends else ""
    shares = [
        f"{sum(group)} of {len(group)} right [{low:.3f}, {high:.3f}]"
        for group in right
        for low, high in [clopper_pearson_interval(sum(group), len(group)) if group else (0.0, 1.0)]
    ]
    print(
        f"{world}: {len(ends)} of {ROBOTS} robots{median}; stops {shares[0]}, before the alarm {shares[1]}", flush=True
    )


def changed(scene: Scene, world: str) -> Scene:
    if world != BLUNT:
        return CONDITIONS[world](scene)
    cone = scene.shapes["cone"]
    assert isinstance(cone, Cone)
    return replace(scene, shapes={**scene.shapes, "cone": replace(cone, height=0.6 * cone.height)})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--decider", default="information_gain")
    parser.add_argument("--calibration", type=int, default=4000)
    parser.add_argument("--fresh", type=int, default=2000)
    parser.add_argument("--max-touches", type=int, default=6)
    parser.add_argument("--confidence", type=float, default=0.9)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--worlds", nargs="*", default=[])
    given = parser.parse_args()
    run = prepared(Setting(SceneChoice(given.scene)), given.decider, seed=given.seed, jobs=1)
    searches = replace(run.searches, problem=run.searches.problem.with_unsure())
    number = given.calibration + given.fresh
    played = play_calibration(searches, run.deciders[given.decider], number, run.targets, given.max_touches, jobs=1)
    every, first = candidate_stops(played), given.calibration
    stops, wrong = every.counts([0.0] * (given.max_touches + 1))
    print(
        f"{given.decider} in {given.scene}, {number} searches, seed {given.seed}: uncertified stops by touches, wrong"
    )
    for touches, (stop, error) in enumerate(zip(stops, wrong, strict=True)):
        print(f"{touches:>9d}{stop:8d}{error:7d}")
    for risk in RISKS:
        show(every.between(0, first), played[first:], every, risk, given.confidence)
    fits = np.array([search.fit for search in played])
    made = certified_thresholds(every.between(0, first), RISKS[0], given.confidence)
    show_false_alarms(fits[:first], fits[first:])
    print("\nalarms in other worlds")
    for world in given.worlds:
        try:
            scene = changed(searches.sensor.scene, world)
        except DoesNotApply as reason:
            print(f"{world}: {reason}")
            continue
        there = replace(searches, sensor=replace(searches.sensor, scene=scene))
        player, number = run.deciders[given.decider], ROBOTS * SEARCHES
        found = play_calibration(there, player, number, run.targets, given.max_touches, jobs=1)
        show_world(world, fits[:first], found, made.thresholds)


if __name__ == "__main__":
    main()
