"""Measure the time of beliefs, observation models and outcome tables, compared with pomdp-py. One thread.

Run: OMP_NUM_THREADS=1 python benchmarks/beliefs.py       (pomdp-py: Linux, Python 3.11 or 3.12)

Times are medians of interleaved rounds; ratios are taken within a round. Beliefs are over four shapes unless a row says
otherwise. The last table gives the information about the shape in a touch and in its outcome.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import permutations

import numpy as np
from rounds import time_in_rounds

from activetouch.sensor_files import fitted_model
from belief import Touch
from belief.arrangement import arrangement_marginals
from belief.bayes import target_information_gain, update
from belief.observation_model import ArrayModel
from belief.observation_model.plda import sampled_posteriors
from experiments.sensor_choice import independent_sensor

BATCH, NUM_SHAPES = 100_000, 4
THEIRS = "pomdp-py, one belief"


def updates() -> dict[str, tuple[Callable[[int], object], int]]:
    """Functions to time, which take a running number, with the number of beliefs that they update."""
    rng = np.random.default_rng(0)
    prior, likelihood = rng.dirichlet(np.ones(NUM_SHAPES), size=(2, BATCH))
    log_prior, log_likelihood = np.log(prior), np.log(likelihood)
    cases: dict[str, tuple[Callable[[int], object], int]] = {
        "update, batched": (lambda _: update(log_prior, log_likelihood), BATCH),
        "update, one belief": (lambda i: update(log_prior[i], log_likelihood[i]), 1),
    }
    try:
        return {THEIRS: (histogram_update(prior, likelihood), 1), **cases}
    except ModuleNotFoundError:
        print("pomdp-py is not installed, so there is nothing to compare with")
        return cases


def histogram_update(prior: np.ndarray, likelihood: np.ndarray) -> Callable[[int], object]:
    """pomdp-py's update of one belief about a static state, with the same numbers."""
    import pomdp_py

    class State(pomdp_py.SimpleState):
        pass

    class Sensor(pomdp_py.ObservationModel):
        def probability(self, observation: int, next_state: State, action: object) -> float:
            return rows[observation][next_state.data]

    rows, states = likelihood.tolist(), [State(k) for k in range(NUM_SHAPES)]
    beliefs = [pomdp_py.Histogram(dict(zip(states, row, strict=True))) for row in prior[:1000].tolist()]
    sensor, action = Sensor(), pomdp_py.SimpleAction("probe")

    def call(index: int) -> object:
        return pomdp_py.update_histogram_belief(beliefs[index], action, index, sensor, None, static_transition=True)

    found = [call(7)[state] for state in states]
    np.testing.assert_allclose(found, np.exp(update(np.log(prior[7]), np.log(likelihood[7]))[0]))
    return call


def others() -> dict[str, Callable[[int], object]]:
    """Functions of the other steps of a search, which take a running number."""
    rng = np.random.default_rng(0)
    cases: dict[str, Callable[[int], object]] = {}
    for name in ("gel", "many", "hard"):
        model = fitted_model(independent_sensor(name), independent=True).model
        table, num_shapes = model.outcome_table().probs, len(model.shape_labels)
        some = [Touch(i % len(table), row) for i, row in enumerate(rng.normal(size=(12, num_shapes)))]
        probs = rng.dirichlet(np.ones(num_shapes))
        kind = f"{name} ({model.name}, K = {num_shapes})"
        cases[f"likelihood of 12 touches, {kind}"] = lambda _, m=model, t=some: m.log_likelihood(t)
        cases[f"information about the target, M = {table.shape[2]}, {kind}"] = lambda _, b=probs, t=table: (
            target_information_gain(b, t, 0)
        )
    return cases


@cache
def every_permutation(number: int) -> np.ndarray:
    """All permutations of N numbers, ``(N!, N)``."""
    return np.array(list(permutations(range(number))))


def by_permutations(log_weights: np.ndarray) -> np.ndarray:
    """Marginals of N distinct objects as one sum over all permutations: the plain reference up to six objects."""
    number, chosen = len(log_weights), every_permutation(len(log_weights))
    probs = np.exp(log_weights[np.arange(number), chosen].sum(axis=1))
    return np.array([np.bincount(column, probs, number) for column in chosen.T]) / probs.sum()


def by_subsets(log_weights: np.ndarray) -> np.ndarray:
    """Marginals of N distinct objects by subset sums in a loop: the plain reference for more than six objects."""
    number, weights = len(log_weights), np.exp(log_weights)
    forward, backward = np.zeros((2, 2**number))
    forward[0] = backward[-1] = 1.0
    subsets = [(used, used.bit_count()) for used in range(2**number)]
    for used, size in subsets[1:]:
        forward[used] = sum(forward[used ^ 1 << k] * weights[size - 1, k] for k in range(number) if used >> k & 1)
    found = np.zeros((number, number))
    for used, size in subsets[-2::-1]:
        rest = [k for k in range(number) if not used >> k & 1]
        parts = [weights[size, k] * backward[used | 1 << k] for k in rest]
        backward[used] = sum(parts)
        found[size, rest] += forward[used] * np.array(parts)
    return found / backward[0]


def print_marginals() -> None:
    print(f"\n{'exact marginals of N objects of N shapes':<42}{'ms':>9}{'plain, ms':>11}{'ratio':>7}")
    rng = np.random.default_rng(0)
    for number in (2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 18, 20):
        weights = 2.0 * rng.normal(size=(number, number))
        plain = by_permutations if number <= 6 else by_subsets
        cases: dict[str, Callable[[int], object]] = {"ours": lambda _, w=weights: arrangement_marginals(w)}
        if number <= 12:
            np.testing.assert_allclose(arrangement_marginals(weights), plain(weights), rtol=1e-9)
            cases["plain"] = lambda _, w=weights, f=plain: f(w)
        times = time_in_rounds(cases, 7, 20 if number <= 6 else 1)
        ours = f"N = {number:<38}{np.median(times['ours']):9.3f}"
        if "plain" in times:
            ours += f"{np.median(times['plain']):11.3f}{np.median(times['ours'] / times['plain']):7.3f}"
        print(ours)


def information_of_touch(model: ArrayModel, num_samples: int) -> np.ndarray:
    """Mutual information of touch and shape by pose [nats], ``(P,)``; standard error about 0.5 / √(K · num_samples)."""
    log_posteriors = sampled_posteriors(model, np.random.default_rng(1), num_samples)
    return np.einsum("pknk->pkn", log_posteriors).mean(axis=(1, 2)) + np.log(log_posteriors.shape[1])


def print_information() -> None:
    print(f"\n{'nats per touch, mean over poses':<34}{'touch':>8}{'table':>8}{'kept':>8}{'outcomes':>10}")
    for sensor in map(independent_sensor, ("coarse", "gel", "hard", "many", "paper")):
        model = fitted_model(sensor, independent=True).model
        touch, table = information_of_touch(model, num_samples=20_000).mean(), model.outcome_table()
        kind, kept = f"{sensor.name} ({model.name}, K = {table.num_shapes})", table.information().mean()
        print(f"{kind:<34}{touch:8.3f}{kept:8.3f}{kept / touch:8.3f}{table.num_outcomes:10}")


def main() -> None:
    cases = updates()
    batched = {name: call for name, (call, number) in cases.items() if number > 1}
    single = {name: call for name, (call, number) in cases.items() if number == 1}
    milliseconds = {**time_in_rounds(single, 15, 1000), **time_in_rounds(batched, 15, 5)}
    rates = {name: cases[name][1] / times * 1e3 for name, times in milliseconds.items()}
    print(f"{'median of 15 rounds':<30}{'updates/s':>12}{'/ pomdp-py':>12}")
    for name, rate in rates.items():
        ratio = f"{np.median(rate / rates[THEIRS]):12.1f}" if THEIRS in rates else ""
        print(f"{name:<30}{np.median(rate):12.3g}{ratio}")
    print(f"\n{'median of 15 rounds':<62}{'µs':>9}")
    for name, times in time_in_rounds(others(), 15, 20).items():
        print(f"{name:<62}{1e3 * np.median(times):9.1f}")
    print_marginals()
    print_information()


if __name__ == "__main__":
    main()
