"""Measure the time of beliefs, observation models and outcome tables, compared with pomdp-py. One thread.

Run: OMP_NUM_THREADS=1 python benchmarks/beliefs.py       (pomdp-py: Linux, Python 3.11 or 3.12)

Times are medians of interleaved rounds. Ratios to pomdp-py's update of a histogram are taken within a round, so they
hardly depend on other load. Beliefs are over four shapes unless a row says otherwise. The last table gives the
information about the shape in a touch and in its outcome.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from rounds import time_in_rounds

from activetouch.world import MODELS, load_observation_model
from belief import Touch
from belief.arrangement import arrangement_marginals
from belief.bayes import target_information_gain, update, update_probs
from belief.observation_model import information_of_touch
from experiments.sensor_choice import independent_sensor

BATCH, NUM_SHAPES = 100_000, 4
THEIRS = "pomdp-py, one belief"


def updates() -> dict[str, tuple[Callable[[int], object], int]]:
    """Functions to time, which take a running number, with the number of beliefs that they update."""
    rng = np.random.default_rng(0)
    prior, likelihood = rng.dirichlet(np.ones(NUM_SHAPES), size=(2, BATCH))
    log_prior, log_likelihood = np.log(prior), np.log(likelihood)
    cases: dict[str, tuple[Callable[[int], object], int]] = {
        "update_probs, batched": (lambda _: update_probs(prior, likelihood), BATCH),
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
    np.testing.assert_allclose(found, update_probs(prior[7], likelihood[7])[0])
    return call


def others() -> dict[str, Callable[[int], object]]:
    """Functions of the other steps of a search."""
    rng = np.random.default_rng(0)
    weights = {n: rng.normal(size=(n, n)) for n in (4, 12)}
    cases: dict[str, Callable[[int], object]] = {
        f"exact marginals of {n} distinct objects": lambda _, w=w: arrangement_marginals(w) for n, w in weights.items()
    }
    for name in ("gel", "many", "hard"):
        model = load_observation_model(independent_sensor(name))
        table, num_shapes = model.outcome_table().probs, len(model.shape_labels)
        some = [Touch(i % len(table), row) for i, row in enumerate(rng.normal(size=(12, num_shapes)))]
        probs = rng.dirichlet(np.ones(num_shapes))
        kind = f"{name} ({model.name}, K = {num_shapes})"
        cases[f"likelihood of 12 touches, {kind}"] = lambda _, m=model, t=some: m.log_likelihood(t)
        cases[f"information about the target, M = {table.shape[2]}, {kind}"] = lambda _, b=probs, t=table: (
            target_information_gain(b, t, 0)
        )
    return cases


def print_information() -> None:
    """Print the information about the shape in a touch of the shipped models, and in its outcome."""
    print(f"\n{'nats per touch, mean over poses':<34}{'touch':>8}{'table':>8}{'outcomes':>10}")
    for sensor in sorted(MODELS.glob("*-independent")):
        model = load_observation_model(sensor)
        touch, table = information_of_touch(model, num_samples=20_000).mean(), model.outcome_table()
        kind = f"{sensor.name} ({model.name}, K = {table.num_shapes})"
        print(f"{kind:<34}{touch:8.3f}{table.information().mean():8.3f}{table.num_outcomes:10}")


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
    print_information()


if __name__ == "__main__":
    main()
