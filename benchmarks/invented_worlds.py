"""Ten worlds that no reader was trained for and no list names, invented before any of them was looked at.

Run: python -m benchmarks.invented_worlds coarse --searches 9 --seed 31

Each changes the images of a sensor in a way of its own. The table is that of ``activetouch robustness``, whose sensor
doubts its description: how many searches are right, wrong and unsure.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from activetouch.rendering.faults import Fault, Image
from activetouch.scene import Scene
from experiments.robustness.conditions import Change
from experiments.robustness.robustness import robustness
from experiments.scene_choice import SceneChoice
from experiments.sensor_choice import open_sensor


@dataclass(frozen=True)
class Changed:
    """A fault by its name in :data:`FAULTS`, so that a description of the scene says which one it is."""

    isotropic: ClassVar[bool] = False

    name: str

    def __call__(self, image: Image, rng: np.random.Generator) -> Image:
        """See :class:`Fault`."""
        return FAULTS[self.name](image, rng)


def worn_corner(image: Image, rng: np.random.Generator) -> Image:
    """A quarter of the pad answers half as much."""
    found, (rows, columns) = image.copy(), image.shape[:2]
    found[: rows // 2, : columns // 2] *= 0.5
    return found


def turned_mount(image: Image, rng: np.random.Generator) -> Image:
    """The pad is mounted 8° turned about its middle."""
    from scipy.ndimage import rotate

    return np.asarray(rotate(image, 8.0, reshape=False, order=1))


def mirrored(image: Image, rng: np.random.Generator) -> Image:
    """The columns are wired in the other order."""
    return image[:, ::-1].copy()


def rows_out_of_tune(image: Image, rng: np.random.Generator) -> Image:
    """Each row has a gain of its own, within ± 25 %, the same in every touch."""
    gains = np.random.default_rng(0).uniform(0.75, 1.25, len(image))
    return image * gains.reshape(-1, *[1] * (image.ndim - 1))


def power_law(image: Image, rng: np.random.Generator) -> Image:
    """Readings are pressures to the power of 0.6."""
    return np.maximum(image, 0.0) ** 0.6


def saturated(image: Image, rng: np.random.Generator) -> Image:
    """Taxels read half of full scale at most."""
    return np.minimum(image, 0.5)


def drifted_zero(image: Image, rng: np.random.Generator) -> Image:
    """Every taxel reads 0.08 of full scale too much."""
    return image + 0.08


def flickering(image: Image, rng: np.random.Generator) -> Image:
    """A tenth of the taxels read nothing, others in every touch."""
    return image * (rng.random(image.shape) >= 0.1)


def spikes(image: Image, rng: np.random.Generator) -> Image:
    """One in fifty taxels reads full scale, others in every touch."""
    return np.maximum(image, (rng.random(image.shape) < 0.02).astype(image.dtype))


def row_crosstalk(image: Image, rng: np.random.Generator) -> Image:
    """Every taxel also reads a fifth of the mean of its row."""
    return image + 0.2 * image.mean(axis=1, keepdims=True)


FAULTS: Mapping[str, Fault] = MappingProxyType(
    {
        "a quarter of the pad worn": worn_corner,
        "mounted 8° turned": turned_mount,
        "mirrored": mirrored,
        "rows out of tune ± 25 %": rows_out_of_tune,
        "power law 0.6": power_law,
        "saturated at half": saturated,
        "zero drifted by 8 %": drifted_zero,
        "10 % flicker": flickering,
        "2 % spikes": spikes,
        "cross-talk along rows": row_crosstalk,
    }  # type: ignore[arg-type]  # functions, which Changed makes faults of
)


def world(name: str) -> Change:
    """The scene with a changed sensor."""

    def changed(scene: Scene) -> Scene:
        return replace(scene, faults=(Changed(name), *scene.faults))

    return changed


WORLDS: Mapping[str, Change] = MappingProxyType({name: world(name) for name in FAULTS})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", default="coarse")
    parser.add_argument("--searches", type=int, default=9)
    parser.add_argument("--seed", type=int, default=31)
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    choice = SceneChoice(given.scene)
    sensor = open_sensor(None, choice, guarded=True)
    options = {"name": given.scene, "searches": given.searches, "seed": given.seed, "jobs": given.jobs}
    found = robustness(sensor, choice.named, conditions=WORLDS, abstain=0.02, **options)
    for table in found.tables():
        print(table, end="\n\n")


if __name__ == "__main__":
    main()
