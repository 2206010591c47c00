"""Searches of a described pad that feels noise: how many confirm an object.

    python -m benchmarks.noise_at_a_pad

Every touch of a search brings other readings: uniform, normal, of a tenth of the taxels, or of a pad at rest. The pad
is that of docs/your_own_pad.md, the four objects are those of ``gel``. The last row is of touches by a pad that the
description allows, drawn anew for each search.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from collections.abc import Callable

import numpy as np

from activetouch import PadDescription, TactileSensor, Taxels, sensor_of_pad
from belief import Probe

PAD = PadDescription(Taxels.grid(8, 8, 0.004, [".######.", *["########"] * 7]), is_relative=True)
TAXELS = len(PAD.taxels)
NOISES: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    "uniform": lambda rng: rng.random(TAXELS),
    "normal": lambda rng: 0.05 * np.abs(rng.normal(size=TAXELS)),
    "a tenth of the taxels": lambda rng: (rng.random(TAXELS) < 0.1) * rng.random(TAXELS),
    "at rest": lambda rng: 1e-3 * rng.random(TAXELS),
}


def outcomes(sensor: TactileSensor, name: str, searches: int) -> Counter[str]:
    """How the searches for a cone end."""
    found = Counter[str]()
    for seed in range(searches):
        rng = np.random.default_rng(seed)
        scene = PAD.scene(share=rng.uniform(size=7))
        bodies = [scene.sample_object(int(shape), rng) for shape in rng.permutation(4)]
        session = sensor.session("cone", num_objects=4, seed=seed)
        while (asked := session.ask()) is not None:
            if not isinstance(asked, Probe):
                session.tell()
            elif name in NOISES:
                session.tell(image=PAD.image(NOISES[name](rng)))
            else:
                session.tell(image=scene.press(bodies[session.object_index], asked.pose, rng).image)
        is_cone = session.scene.labels[bodies[session.object_index].shape_index] == "cone"
        found[
            f"{session.outcome} a cone" if str(session.outcome) == "confirmed" and is_cone else str(session.outcome)
        ] += 1
    return found


def main() -> None:
    """Play and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--searches", type=int, default=40, help="of each kind")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    sensor = TactileSensor.load(sensor_of_pad(PAD), PAD.scene())
    for name in (*NOISES, "touches"):
        found = outcomes(sensor, name, given.searches)
        print(f"{name:22} {', '.join(f'{number} {end}' for end, number in found.most_common())}", flush=True)


if __name__ == "__main__":
    main()
