"""Compare with other packages in one run: beliefs, planners and calibration, as ratios, with versions.

Run: OMP_NUM_THREADS=1 python benchmarks/peers.py        (some minutes; packages that are not installed are left out)

Times are of the processor, medians of interleaved rounds; ratios are taken within a round, so they hardly depend on
other load. Planners play the same searches, with touches drawn from the table they plan with.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version

import beliefs
import calibration
import deciders
import numpy as np

from belief.bayes import update, update_probs
from belief.calibration import TemperatureScaling
from belief.metrics import negative_log_likelihood
from belief.statistics import paired_bootstrap, wilson_interval
from planners import make_decider

PEERS = ("pomdp-py", "scikit-learn", "netcal")
Calls = dict[str, Callable[[int], object]]


def time_in_rounds(calls: Calls, rounds: int, per_round: int) -> dict[str, np.ndarray]:
    """Milliseconds of the processor per call, of every case and round; one more round is run first and dropped."""
    found: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds + 1):
        for name, call in calls.items():
            started = time.process_time()
            for index in range(per_round):
                call(index)
            found[name].append(1e3 * (time.process_time() - started) / per_round)
    return {name: np.array(times[1:]) for name, times in found.items()}


def has(package: str) -> bool:
    """Whether a distribution is installed."""
    try:
        return bool(version(package))
    except PackageNotFoundError:
        return False


def measure_beliefs() -> None:
    """One Bayes update of a belief over four shapes: ours, ours in a batch of 100 000, and pomdp-py's histogram."""
    number = beliefs.BATCH
    prior, likelihood = np.random.default_rng(0).dirichlet(np.ones(4), size=(2, number))
    logs = np.log(prior), np.log(likelihood)
    theirs = beliefs.histogram_update(prior, likelihood)
    one: Calls = {"pomdp-py": theirs, "activetouch": lambda i: update(logs[0][i], logs[1][i])}
    found = time_in_rounds(one, 21, 300)
    batch = time_in_rounds({"batch": lambda _: update_probs(prior, likelihood)}, 21, 1)["batch"] / number
    found["activetouch, in a batch"] = batch
    print("\nBayes update, one belief over four shapes")
    report(found, "pomdp-py", 1e3, "µs")


def measure_planners(searches: int) -> None:
    """The same searches by the point-based planner, by pomdp-py's tree searches, and without a touch."""
    table, first, milliseconds = deciders.tables()["coarse"], np.empty(0), []
    print(f"\n{searches} searches among four objects, table of scene coarse, touch cost {deciders.TOUCH_COST}, seed 0")
    for name in ("point_based", "random_confirm", *(f"{tree}(simulations=100)" for tree in deciders.TREES)):
        timed = deciders.Timed(make_decider(name, table))
        episodes, problem = deciders.play(table, timed, searches, seed=0)
        returns = np.array([episode.reward(problem) for episode in episodes])
        first = first if first.size else returns
        over = "{:+.3f} [{:+.3f}, {:+.3f}]".format(*paired_bootstrap(returns, first, np.random.default_rng(0)))
        right = sum(episode.success for episode in episodes)
        success = "{:.3f} [{:.3f}, {:.3f}]".format(right / searches, *wilson_interval(right, searches))
        milliseconds.append(1e3 * float(np.median(timed.seconds)))
        print(
            f"{name:<24} return {returns.mean():+.3f}, over point_based {over}, success {success}, "
            f"{milliseconds[-1]:.3f} ms a decision, {milliseconds[-1] / milliseconds[0]:.2g} × point_based",
            flush=True,
        )
    print("best expected return: between {:.3f} and {:.3f}".format(*deciders.bounds(table)))


def measure_calibration(number: int) -> None:
    """One temperature fitted to the same over-confident logits."""
    logits, labels = calibration.touches(number)
    calls: Calls = {"activetouch": lambda _: TemperatureScaling().fit(logits, labels)}
    probs = {"activetouch": TemperatureScaling().fit(logits, labels).predict_proba(logits)}
    if has("scikit-learn"):
        fit = sklearn_fit()
        calls["scikit-learn"] = lambda _: fit(logits, labels)
        probs["scikit-learn"] = fit(logits, labels).predict_proba(logits)
    if has("netcal"):
        from netcal.scaling import TemperatureScaling as Netcal

        raw = TemperatureScaling().predict_proba(logits)
        calls["netcal"] = lambda _: Netcal().fit(raw, labels, tensorboard=False)
        probs["netcal"] = Netcal().fit(raw, labels, tensorboard=False).transform(raw)
    print(f"\nTemperature scaling, {number} touches of four shapes")
    report(time_in_rounds(calls, 9, 3), "activetouch", 1.0, "ms")
    print("NLL: " + ", ".join(f"{name} {negative_log_likelihood(p, labels):.6f}" for name, p in probs.items()))


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


def report(found: dict[str, np.ndarray], base: str, scale: float, unit: str) -> None:
    """Print medians and ratios."""
    for name, times in found.items():
        ratio = np.median(found[base] / times) if name != base else 1.0
        print(f"{name:<28}{scale * np.median(times):10.3f} {unit}{ratio:12.3g} × as fast as {base}")


def main(searches: int) -> None:
    """Measure and print everything."""
    known = ", ".join(f"{name} {version(name) if has(name) else 'not installed'}" for name in PEERS)
    print(f"Python {sys.version.split()[0]}, numpy {np.__version__}; {known}")
    for number in (560, 100_000):
        measure_calibration(number)
    if has("pomdp-py"):
        measure_beliefs()
        measure_planners(searches)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
