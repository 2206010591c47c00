"""Real pads of the hand SDH-2, read by a reader for their description; nothing is fitted to real touches.

    python -m benchmarks.sdh2_described FOLDER --trees 6000
    python -m benchmarks.sdh2_described FOLDER
    python -m benchmarks.sdh2_described FOLDER --held 10
    activetouch train --pad benchmarks/recorded_sets/sdh2.toml --out sensors/sdh2
    python -m benchmarks.sdh2_described FOLDER --sensor sensors/sdh2

The second line is of the reader of any pad, the last one of what goes on from it for this pad. With ``--held``, an axis
of each object points at the pad, missed by a turn of so many degrees (standard deviation about each axis), as a hand
holds it; without, objects lie in any orientation. With ``--trees``, forty numbers of each touch are read by extra trees
that learn from so many presses of the described pad, each with a random response: what the description itself carries
over.

FOLDER holds the set ``sdh2``. Each grasp gives one touch: the frame of the largest total pressure, and in it the pad of
the largest sum; its rows are moved by whole taxels, so that the contact lies in the middle of the pad's length. The
hypotheses are those of benchmarks/sdh2_zero_shot.py. The pad is in an unknown state, inferred from the touches of an
object, within the ranges of the description. Prints the share that is right and the stated probability of single
grasps and of four grasps of an object, and what is stated where a search would stop. Readers then name objects in
sessions of at most four grasps, which end unsure where grasps look like no press on any pad of the description.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import softmax

from activetouch import PadDescription, Scene, TactileSensor, read_pad, sensor_of_pad
from activetouch.orientations import Held
from belief import Confirm, Probe
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
    return centred(felt, rows) if felt.sum() > 0 else None


def centred(felt: np.ndarray, rows: int) -> np.ndarray:
    """A pad's readings, moved along its rows by whole taxels, so that the middle of the contact is in the middle."""
    whole = np.zeros((3 * rows, felt.shape[1]))
    middle = (felt.sum(axis=1) * np.arange(len(felt))).sum() / felt.sum()
    start = rows - round(float(middle - (rows - 1) / 2))
    whole[start : start + len(felt)] = felt
    return whole[rows : 2 * rows].ravel()


def numbers_of(readings: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Forty numbers of the readings of a touch: the extents of the contact, and its largest readings and sums."""
    image = readings.reshape(shape) / readings.max()
    weights, places = image.ravel() / image.sum(), np.indices(shape).reshape(2, -1)
    away = places - (places @ weights)[:, None]
    spread = (weights * away) @ away.T
    small, large = np.linalg.eigvalsh(spread)
    counts = [
        (image > 0.1).sum(),
        (image > 0.5).sum(),
        (image > 0.1).any(axis=0).sum(),
        (image > 0.1).any(axis=1).sum(),
    ]
    sums = [np.sort(image.sum(axis=0))[::-1], np.sort(image.sum(axis=1))[::-1][:8], np.sort(image.ravel())[::-1][:16]]
    extents = [small, large, small / (large + 0.05), spread[0, 0], spread[1, 1], abs(spread[0, 1])]
    return np.concatenate([extents, counts, *sums])


def simulated(pad: PadDescription, base: Scene, number: int, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of simulated touches, each with another response, and their shapes."""
    rng = np.random.default_rng(0)
    found, truths = [], []
    for press in range(number):
        scene = pad.scene(base, rng.uniform(size=7))
        truth = press % len(base.shapes)
        image = scene.press(scene.sample_object(truth, rng), int(rng.integers(len(scene.poses))), rng).image
        readings = pad.taxels.mean(image / 255.0)
        if readings.max() > 0.0:
            found.append(numbers_of(centred(readings.reshape(shape), shape[0]), shape))
            truths.append(truth)
    return np.array(found), np.array(truths)


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
    parser.add_argument("--sensor", type=Path)
    parser.add_argument("--trees", type=int)
    parser.add_argument("--held", type=float)
    given = parser.parse_args()
    pad, base = read_pad(DESCRIPTION), real_scene()
    if given.held is not None:
        base = replace(base, presentation=Held(np.deg2rad(given.held)))
    rows, labels = round(2 * pad.taxels.half_width / pad.taxels.pitch), list(base.shapes)
    shape = rows, len(pad.taxels) // rows
    top = given.folder / "grasps" if (given.folder / "grasps").is_dir() else given.folder
    if given.trees:
        from sklearn.ensemble import ExtraTreesClassifier

        numbers, shapes = simulated(pad, base, given.trees, shape)
        trees = ExtraTreesClassifier(400, min_samples_leaf=3, random_state=0).fit(numbers, shapes)

        def likelihoods(felt: np.ndarray) -> np.ndarray:
            found = trees.predict_proba(np.stack([numbers_of(one, shape) for one in felt]))
            return np.log(np.maximum(found, 1e-3))[:, None]

        prior = np.zeros(1)
    else:
        front = next(iter(base.rotations.items()))
        sensor = TactileSensor.load(given.sensor or sensor_of_pad(pad), pad.scene(replace(base, poses=dict([front]))))
        model: Any = sensor.model.nominal  # without the question whether images look like any press
        prior = model.log_prior

        def likelihoods(felt: np.ndarray) -> np.ndarray:
            touches = sensor.read(pad.image(felt), [0] * len(felt))
            return np.stack([model.start().update(touch).log_ratios for touch in touches])

    report(top, likelihoods, prior, labels, rows)
    if not given.trees:
        name_in_sessions(sensor, pad, grasps_of(top, rows))


def grasps_of(top: Path, rows: int) -> list[tuple[str, str, list[np.ndarray]]]:
    """Shape, name and readings of each object that was felt."""
    found = []
    for shape, names in SHAPES.items():
        for name in names:
            each = [readings_of(path, rows) for path in sorted((top / name).glob("*.dsa"))]
            if felt := [one for one in each if one is not None]:
                found.append((shape, name, felt))
    return found


def name_in_sessions(
    sensor: TactileSensor, pad: PadDescription, objects: list[tuple[str, str, list[np.ndarray]]], rounds: int = 5
) -> None:
    """Print how many sessions name an object, and how many rightly; each has other grasps."""
    named, stated, number = [], [], rounds * len(objects)
    for shape, _, felt in objects:
        for seed in range(rounds):
            grasps = np.random.default_rng([seed, 7]).permutation(len(felt))
            session = sensor.naming(seed=seed, threshold=_STOP, max_touches=GRASPS)
            while isinstance(asked := session.ask(), Probe):
                session.tell(image=pad.image(felt[grasps[len(session.steps)]]), pose=0)
            session.tell()
            if isinstance(asked, Confirm):
                named.append(session.answer == shape)
                stated.append(session.stated)
    low, high = wilson_interval(sum(named), len(named))
    right = f"right {np.mean(named):.3f} [{low:.3f}, {high:.3f}], stated {np.mean(stated):.3f}" if named else "none"
    print(f"sessions of up to {GRASPS} grasps: {len(named)} of {number} named, {right}")


def report(
    top: Path, likelihoods: Callable[[np.ndarray], np.ndarray], prior: np.ndarray, labels: list[str], rows: int
) -> None:
    """Print right and stated shares; ``likelihoods (n, C, K)`` are those of n touches under C pads and K shapes."""

    def posterior(some: np.ndarray) -> np.ndarray:
        """Probabilities of the shapes of an object whose touches are independent given the shape and the pad."""
        return np.asarray(softmax(np.logaddexp.reduce(prior[:, None] + some.sum(axis=0), axis=0)))

    rng = np.random.default_rng(0)
    single, truths, several, of_several, means = [], [], [], [], []
    for shape, name, felt in grasps_of(top, rows):
        each = likelihoods(np.stack(felt))
        own = np.array([posterior(each[i : i + 1]) for i in range(len(each))])
        single.append(own)
        truths += [labels.index(shape)] * len(own)
        means.append(np.mean(own.argmax(axis=1) == labels.index(shape)))
        print(f"  {shape:8} {name:24} {len(own):3} grasps, right {means[-1]:.3f}", flush=True)
        for _ in range(_REPEATS if len(each) >= GRASPS else 0):
            several.append(posterior(each[rng.choice(len(each), GRASPS, replace=False)]))
            of_several.append(labels.index(shape))
    confusion = np.zeros((len(labels), len(labels)), int)
    np.add.at(confusion, (truths, np.concatenate(single).argmax(axis=1)), 1)
    print("read as", labels)
    for label, row in zip(labels, confusion, strict=True):
        print(f"  {label:8} {row.tolist()}")
    print(f"mean over {len(means)} objects {np.mean(means):.3f}")
    print(told("single grasps", np.concatenate(single), np.array(truths)))
    print(told(f"{GRASPS} grasps of an object, taken as independent", np.array(several), np.array(of_several)))


if __name__ == "__main__":
    main()
