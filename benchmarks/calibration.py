"""Measure the time of fitting a calibration, compared with netcal's temperature scaling. One thread.

Run: python benchmarks/calibration.py       (needs netcal: pip install -c constraints.txt -e ".[bench]")

Both fit a temperature to the same touches of four shapes, in interleaved rounds; ratios are taken within a round.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from rounds import time_in_rounds

from belief.calibration import CALIBRATIONS, TemperatureScaling

TEMPERATURE = 2.0
OURS, THEIRS = "temperature", "temperature, netcal"


def touches(num: int) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Over-confident logits, too large by the factor :data:`TEMPERATURE`, and true shapes."""
    rng = np.random.default_rng(0)
    logits = 3.0 * rng.normal(size=(num, 4))
    noise = rng.gumbel(size=logits.shape)
    return logits, (logits / TEMPERATURE + noise).argmax(axis=1)


def cases(num: int) -> dict[str, Callable[[int], object]]:
    from netcal.scaling import TemperatureScaling as NetcalTemperature  # loads torch and pyro

    logits, labels = touches(num)
    probs = TemperatureScaling(1.0, "ok").predict_proba(logits)
    ours = TemperatureScaling().fit(logits, labels).temperature
    theirs = 1.0 / float(NetcalTemperature().fit(probs, labels, tensorboard=False).temperature[0])
    print(f"\n{num} touches: T = {ours:.6f}, by netcal {theirs:.6f}")
    return {
        THEIRS: lambda _: NetcalTemperature().fit(probs, labels, tensorboard=False),
        **{name: lambda _, kind=kind: kind().fit(logits, labels) for name, kind in CALIBRATIONS.items()},
    }


def main() -> None:
    if importlib.util.find_spec("netcal") is None:
        raise SystemExit('netcal is not installed: pip install -c constraints.txt -e ".[bench]"')
    import torch

    torch.set_num_threads(1)
    for num, rounds, per_round in ((560, 21, 20), (1_000_000, 7, 1)):
        milliseconds = time_in_rounds(cases(num), rounds, per_round)
        print(f"{f'median of {rounds} rounds':<30}{'ms':>10}{'netcal / this':>15}")
        for name, times in milliseconds.items():
            print(f"{name:<30}{np.median(times):10.3f}{np.median(milliseconds[THEIRS] / times):15.2f}")


if __name__ == "__main__":
    main()
