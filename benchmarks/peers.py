"""Compare with other packages in one run: beliefs, planners and calibration, as ratios, with versions.

Run: OMP_NUM_THREADS=1 python benchmarks/peers.py        (some minutes; packages that are not installed are left out)

Times are of the processor, medians of interleaved rounds, and ratios are taken within a round. Planners play the same
searches, with touches drawn from the table they plan with.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import beliefs
import calibration
import deciders
import mujoco
import numpy as np
from mujoco_tactile import NativeSensor
from rounds import time_in_rounds

from activetouch import SHAPES
from activetouch.poses import Placement, random_orientation
from activetouch.pressing.contact import Pad, first_touch
from belief.bayes import update
from belief.calibration import TemperatureScaling
from belief.metrics import negative_log_likelihood
from belief.statistics import paired_bootstrap, wilson_interval
from planners import make_decider

PEERS = ("pomdp-py", "inferactively-pymdp", "scikit-learn", "netcal", "probmetrics", "jax", "torch")
Calls = dict[str, Callable[[int], Any]]
OURS, NUM_OUTCOMES, DEPTH = "activetouch", 8, 0.002


def has(package: str) -> bool:
    """Whether a distribution is installed."""
    try:
        return bool(version(package))
    except PackageNotFoundError:
        return False


def measure_beliefs() -> None:
    """Time a Bayes update of one belief over four shapes, and of 100 000, by every package that is installed."""
    number = beliefs.BATCH
    rng = np.random.default_rng(0)
    prior, outcomes = rng.dirichlet(np.ones(4), size=number), rng.integers(NUM_OUTCOMES, size=number)
    table = rng.dirichlet(np.ones(NUM_OUTCOMES), size=4).T.copy()  # p(outcome | shape), (outcome, shape)
    log_prior, log_table = np.log(prior), np.log(table)
    one: Calls = {OURS: lambda i: update(log_prior[i], log_table[outcomes[i]])}
    found = np.empty_like(prior)  # log-likelihoods, looked up in the table within the time, as by the others
    batch: Calls = {OURS: lambda _: update(log_prior, np.take(log_table, outcomes, axis=0, out=found, mode="clip"))}
    if has("pomdp-py"):
        one["pomdp-py, histogram"] = beliefs.histogram_update(prior, table[outcomes])
    if has("inferactively-pymdp"):
        one["pymdp, jit"], batch["pymdp, jit and vmap"] = pymdp_updates(table, prior, outcomes)
    print("\nBayes update, one belief over four shapes")
    report(time_in_rounds(one, 21, 300), 1e3, "µs")
    print(f"Bayes update, {number} beliefs at once, per belief")
    report({name: times / number for name, times in time_in_rounds(batch, 21, 1).items()}, 1e6, "ns")


def pymdp_updates(table: np.ndarray, prior: np.ndarray, outcomes: np.ndarray) -> list[Callable[[int], object]]:
    """Exact inference by pymdp of one belief and of all at once, compiled, in single precision; equal to ours."""
    import jax
    from pymdp.inference import update_posterior_states

    def infer(likelihood: jax.Array, belief: jax.Array, outcome: jax.Array) -> jax.Array:
        seen = [jax.nn.one_hot(outcome, NUM_OUTCOMES)]
        return update_posterior_states([likelihood], None, seen, None, [belief], method="exact")[0][0]

    arrays = tuple(map(jax.numpy.asarray, (table, prior, outcomes)))
    single, every = jax.jit(infer), jax.jit(jax.vmap(infer, (None, 0, 0)))
    np.testing.assert_allclose(every(*arrays), np.exp(update(np.log(prior), np.log(table[outcomes]))[0]), atol=1e-5)
    rows = list(zip(arrays[1][:1000], arrays[2][:1000], strict=True))
    return [
        lambda i: single(arrays[0], *rows[i]).block_until_ready(),
        lambda _: every(*arrays).block_until_ready(),
    ]


def measure_depths() -> None:
    """Time the depth of 4 096 taxels in a cylinder, by rays along the pad's normal and MuJoCo's tactile sensor."""
    pad, shape, rng = Pad(num_taxels=64), SHAPES["cylinder"], np.random.default_rng(0)
    placements = [Placement(shape, 1.0, random_orientation(rng), rng.uniform(-0.002, 0.002, 2)) for _ in range(32)]
    positions = [first_touch(pad, placement)[1] - DEPTH for placement in placements]
    sensor = NativeSensor(pad, shape)
    calls: Calls = {
        OURS: lambda i: np.maximum(DEPTH - first_touch(pad, placements[i])[0], 0.0),
        "MuJoCo's tactile sensor": lambda i: sensor.depth(placements[i], positions[i]),
    }
    found = [[call(i).ravel() for i in range(len(placements))] for call in calls.values()]
    ours, native = np.array(found)
    either = (ours > 0.0) | (native > 0.0)
    same = ((ours > 0.0) == (native > 0.0))[either].mean()
    print(f"\nDepths of 64 × 64 taxels in a cylinder; the two agree on {100 * same:.1f} % of the touched taxels")
    report(time_in_rounds(calls, 9, len(placements)), 1.0, "ms")


def measure_planners(searches: int) -> None:
    """Play the same searches by the point-based planner, by pomdp-py's tree searches, and without a touch."""
    table, first, milliseconds = deciders.tables()["coarse"], np.empty(0), []
    print(f"\n{searches} searches among four objects, table of scene coarse, touch cost {deciders.TOUCH_COST}, seed 0")
    trees = [f"{tree}(simulations=100)" for tree in deciders.TREES] if has("pomdp-py") else []
    for name in ("point_based", "random_confirm", *trees):
        timed = deciders.Timed(make_decider(name, table))
        episodes, problem = deciders.play(table, timed, searches, seed=0)
        returns = np.array([episode.reward(problem) for episode in episodes])
        first = first if first.size else returns
        over = "{:+.3f} [{:+.3f}, {:+.3f}]".format(*paired_bootstrap(returns, first, np.random.default_rng(0)))
        right = sum(episode.success for episode in episodes)
        success = "{:.3f} [{:.3f}, {:.3f}]".format(right / searches, *wilson_interval(right, searches))
        milliseconds.append(float(np.median(np.concatenate(list(timed.milliseconds.values())))))
        print(
            f"{name:<24} return {returns.mean():+.3f}, over point_based {over}, success {success}, "
            f"{milliseconds[-1]:.3f} ms a decision, {milliseconds[-1] / milliseconds[0]:.2g} × point_based",
            flush=True,
        )
    print("best expected return: between {:.3f} and {:.3f}".format(*deciders.bounds(table)))


def measure_calibration() -> None:
    for number in (560, 100_000):
        _measure_fit(number)


def _measure_fit(number: int) -> None:
    """Time the fit of one temperature to the same over-confident logits."""
    logits, labels = calibration.touches(number)
    raw = TemperatureScaling(1.0, "ok").predict_proba(logits)
    calls: Calls = {OURS: lambda _: TemperatureScaling().fit(logits, labels).predict_proba(logits)}
    if has("scikit-learn"):
        fit = sklearn_fit()
        calls["scikit-learn"] = lambda _: fit(logits, labels).predict_proba(logits)
    if has("netcal"):
        from netcal.scaling import TemperatureScaling as Netcal

        calls["netcal"] = lambda _: Netcal().fit(raw, labels, tensorboard=False).transform(raw)
    if has("probmetrics"):
        sys.path[:] = [place for place in sys.path if not Path(place, "peers.py").exists()]  # numba looks for coverage
        from probmetrics.calibrators import get_calibrator

        calls["probmetrics"] = lambda _: get_calibrator("temp-scaling").fit(raw, labels).predict_proba(raw)
    print(f"\nTemperature scaling, fitted to and applied to {number} touches of four shapes")
    report(time_in_rounds(calls, 9, 3 if number < 10_000 else 1), 1.0, "ms")
    print("NLL: " + ", ".join(f"{name} {negative_log_likelihood(call(0), labels):.6f}" for name, call in calls.items()))


def sklearn_fit() -> Callable[..., object]:
    """Scikit-learn's temperature scaling of given logits."""
    from sklearn.base import BaseEstimator, ClassifierMixin
    from sklearn.calibration import CalibratedClassifierCV
    from sklearn.frozen import FrozenEstimator

    class Given(ClassifierMixin, BaseEstimator):
        """A classifier whose logits are its inputs."""

        def fit(self, logits: np.ndarray, labels: np.ndarray) -> Given:
            self.classes_ = np.arange(logits.shape[1])
            return self

        def decision_function(self, logits: np.ndarray) -> np.ndarray:
            return logits

        def predict(self, logits: np.ndarray) -> np.ndarray:
            return logits.argmax(axis=1)

    def fit(logits: np.ndarray, labels: np.ndarray) -> object:
        given = FrozenEstimator(Given().fit(logits, labels))
        return CalibratedClassifierCV(given, method="temperature").fit(logits, labels)

    return fit


def report(found: dict[str, np.ndarray], scale: float, unit: str) -> None:
    """Print medians over rounds, and medians of the ratios within a round."""
    for name, times in found.items():
        ratio = float(np.median(times / found[OURS]))
        print(f"{name:<28}{scale * np.median(times):10.3f} {unit}{ratio:12.3g} times the time of {OURS}", flush=True)


PARTS: dict[str, Callable[[int], None]] = {
    "calibration": lambda _: measure_calibration(),
    "beliefs": lambda _: measure_beliefs(),
    "depths": lambda _: measure_depths(),
    "planners": measure_planners,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--searches", type=int, default=40, help="of each planner")
    asked = parser.parse_args()
    known = ", ".join(f"{name} {version(name) if has(name) else 'not installed'}" for name in PEERS)
    print(f"Python {sys.version.split()[0]}, numpy {np.__version__}, MuJoCo {mujoco.__version__}; {known}")
    for part in asked.parts:
        PARTS[part](asked.searches)


if __name__ == "__main__":
    main()
