"""Compare the return of solved policies with upper bounds, and measure the time of solving and deciding. One thread.

Run: python benchmarks/solve.py                                                        (half an hour)
     python benchmarks/solve.py coarse paper --outcomes 12 24 --touch-costs 0.02 --no-bounds   (finer tables)

For every target and touch cost, it prints the value of the policy at the start and the certified upper bound, for one
object and for a search among four distinct objects, with the time to solve and per decision; then the mean value of
searches over targets. The synthetic table is softmax(2 z), z standard normal: 6 poses, 4 shapes, 12 outcomes, 0.85 nats
per touch in the best pose.
"""

from __future__ import annotations

import argparse
import time
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax
from upper_bounds.object import object_bound
from upper_bounds.search import search_bound

from activetouch.sensor_files import fitted_model
from belief.validation import Floats
from experiments.sensor_choice import independent_sensor
from planners.solve import SearchPolicy, SearchTouchProblem, TouchPolicy, TouchProblem, solve


def table(name: str, num_outcomes: int | None) -> Floats:
    """An outcome table, by name."""
    if name == "synthetic":
        return np.asarray(softmax(2.0 * np.random.default_rng(1).normal(size=(6, 4, 12)), axis=2))
    return fitted_model(independent_sensor(name), independent=True).model.outcome_table(num_outcomes).probs


def decision_times(policy: TouchPolicy) -> tuple[float, float]:
    """Seconds per decision, alone and in a batch of 100 000: medians of rounds."""
    beliefs = np.random.default_rng(0).dirichlet(np.ones(policy.problem.num_shapes), size=100_000)
    alone, batched = [], []
    for _ in range(7):
        started = time.perf_counter()
        for belief in beliefs[:2000]:
            policy.action(belief)
        alone.append((time.perf_counter() - started) / 2000)
        started = time.perf_counter()
        policy.action(beliefs)
        batched.append((time.perf_counter() - started) / len(beliefs))
    return float(np.median(alone)), float(np.median(batched))


def of_bound(policy: TouchPolicy | SearchPolicy, bounds: bool) -> tuple[str, str]:
    """Value of a policy and its upper bound, and their ratio."""
    low = policy.lower_bound
    if not bounds:
        return f"{low:.4f}", ""
    rng, problem = np.random.default_rng(0), policy.problem
    high = object_bound(problem, rng) if isinstance(problem, TouchProblem) else search_bound(problem, rng)
    return f"{low:.4f} of {high:.4f}", f"{low / high:.2%}"


def print_rows(kind: str, probs: NDArray[np.float64], cost: float, bounds: bool) -> None:
    """Print a row for every target, and one with the mean value of searches."""
    num_shapes, values = probs.shape[1], []
    for target in range(num_shapes):
        started = time.perf_counter()
        single = solve(TouchProblem(probs, np.full(num_shapes, 1 / num_shapes), target, cost))
        solved = time.perf_counter()
        search = solve(SearchTouchProblem(probs, 4, "distinct", target, cost))
        searched = time.perf_counter()
        values.append(search.lower_bound)
        alone, batched = decision_times(single)
        cells = [
            f"| {kind} | {cost} | {target}",
            *of_bound(single, bounds),
            f"{solved - started:.2f} s",
            f"{1e6 * alone:.1f} µs, {1e6 * batched:.2f} µs",
            *of_bound(search, bounds),
            f"{searched - solved:.2f} s |",
        ]
        print(" | ".join(cells), flush=True)
    print(f"| {kind} | {cost} | mean | | | | | {np.mean(values):.4f} | | |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tables", nargs="*", default=["synthetic", "coarse", "gel"], help="synthetic, or scenes")
    parser.add_argument("--touch-costs", type=float, nargs="+", default=[0.01, 0.05, 0.1], metavar="λ")
    parser.add_argument("--outcomes", type=int, nargs="+", default=[None], help="outcomes of the scenes' tables")
    parser.add_argument("--no-bounds", dest="bounds", action="store_false", help="leave out the upper bounds")
    chosen = parser.parse_args()
    print("| table | λ | target | one object | | solved in | decision alone, batched | search of four | | solved in |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for name, outcomes in product(chosen.tables, chosen.outcomes):
        probs, kind = table(name, outcomes), name if outcomes is None else f"{name}, {outcomes} outcomes"
        for cost in chosen.touch_costs:
            print_rows(kind, probs, cost, chosen.bounds)


if __name__ == "__main__":
    main()
