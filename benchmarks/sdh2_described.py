"""Real pads of the hand SDH-2, read by a reader for their description; nothing is fitted to real touches.

    activetouch train --pad benchmarks/recorded_sets/sdh2.toml --out sensors/sdh2
    python -m benchmarks.sdh2_described FOLDER --sensor sensors/sdh2

FOLDER holds the set ``sdh2``. Each grasp gives one touch: the frame of the largest total pressure, and in it the pad of
the largest sum; its rows are moved by whole taxels, so that the contact lies in the middle of the pad's length. The
hypotheses are those of benchmarks/sdh2_zero_shot.py. The pad is in an unknown state, inferred from the touches of an
object, within the ranges of the description. Prints the share that is right and the stated probability of single
grasps and of four grasps of an object, and what is stated where a search would stop.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import softmax

from activetouch import PadDescription, TactileSensor, read_pad
from belief.statistics import wilson_interval
from benchmarks.recorded_sets.dsa import read_dsa
from benchmarks.recorded_sets.sdh2 import SHAPES
from benchmarks.sdh2_zero_shot import real_scene

DESCRIPTION = Path(__file__).parent / "recorded_sets" / "sdh2.toml"
GRASPS = 4
_REPEATS = 20
_STOP = 0.9


def readings_of(path: Path, rows: int) -> np.ndarray | None:
    """The taxels of a grasp, ``(rows · columns,)``; None if nothing was felt."""
    film = read_dsa(path)
    pads = film.pads(film.frames[film.frames.sum(axis=1).argmax()])
    felt = max(pads, key=lambda pad: pad.sum())
    if not felt.sum() > 0:
        return None
    whole = np.zeros((3 * rows, felt.shape[1]))
    middle = (felt.sum(axis=1) * np.arange(len(felt))).sum() / felt.sum()
    start = rows - round(float(middle - (rows - 1) / 2))
    whole[start : start + len(felt)] = felt
    return whole[rows : 2 * rows].ravel()


def posterior(sensor: TactileSensor, touches: list[Any]) -> np.ndarray:
    """Probabilities of the shapes of an object whose touches are independent given the shape and the pad."""
    model: Any = sensor.model
    found = sum(model.start().update(touch).log_ratios for touch in touches)
    return np.asarray(softmax(np.logaddexp.reduce(model.log_prior[:, None] + found, axis=0)))


def told(name: str, posteriors: np.ndarray, truths: np.ndarray) -> str:
    """A line on right and stated shares."""
    right = posteriors.argmax(axis=1) == truths
    low, high = wilson_interval(int(right.sum()), len(right))
    stops = posteriors.max(axis=1) >= _STOP
    at_stops = (
        f"{right[stops].mean():.3f} right of {stops.mean():.3f} that state {_STOP}" if stops.any() else "no stops"
    )
    stated = posteriors.max(axis=1).mean()
    return f"{name}: {len(right)}, right {right.mean():.3f} [{low:.3f}, {high:.3f}], stated {stated:.3f}; {at_stops}"


def main() -> None:
    """Read all grasps and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sensor", type=Path, required=True)
    given = parser.parse_args()
    pad: PadDescription = read_pad(DESCRIPTION)
    rows = round(2 * pad.taxels.half_width / pad.taxels.pitch)
    base = real_scene()
    front = next(iter(base.rotations.items()))
    sensor = TactileSensor.load(given.sensor, pad.scene(replace(base, poses=dict([front]))))
    top = given.folder / "grasps" if (given.folder / "grasps").is_dir() else given.folder
    rng, labels = np.random.default_rng(0), list(base.shapes)
    single, truths, several, of_several = [], [], [], []
    for shape, names in SHAPES.items():
        for name in names:
            found = [readings_of(path, rows) for path in sorted((top / name).glob("*.dsa"))]
            felt = [one for one in found if one is not None]
            if not felt:
                continue
            touches = sensor.read(pad.image(np.stack(felt)), [0] * len(felt))
            own = [posterior(sensor, [touch]) for touch in touches]
            single += own
            truths += [labels.index(shape)] * len(own)
            right = np.mean(np.argmax(own, axis=1) == labels.index(shape))
            print(f"  {shape:8} {name:24} {len(own):3} grasps, right {right:.3f}", flush=True)
            for _ in range(_REPEATS if len(touches) >= GRASPS else 0):
                some = rng.choice(len(touches), GRASPS, replace=False)
                several.append(posterior(sensor, [touches[i] for i in some]))
                of_several.append(labels.index(shape))
    confusion = np.zeros((len(labels), len(labels)), int)
    np.add.at(confusion, (truths, np.argmax(single, axis=1)), 1)
    print("read as", labels)
    for label, row in zip(labels, confusion, strict=True):
        print(f"  {label:8} {row.tolist()}")
    print(told("single grasps", np.array(single), np.array(truths)))
    print(told(f"{GRASPS} grasps of an object, taken as independent", np.array(several), np.array(of_several)))


if __name__ == "__main__":
    main()
