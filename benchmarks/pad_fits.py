"""How often the response of a pad lies in the 90 % intervals of a fit to presses of one ball.

    python -m benchmarks.pad_fits --pads 30 --presses 40

Each pad has one of four layouts and a random response; stiffness is between 0.3 and 3 times 1.45e7 N/m³, the law
between ^0.7 and ^2. A ball of 20 mm is pressed in simulation, at random places with known forces from 1 to 8 N; every
second pad reads relative to its largest reading, and each has one dead taxel.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from dataclasses import replace

import numpy as np

from activetouch import PadDescription, Response, Taxels
from activetouch.pad_fit import BallPresses, PadFit, fit_pad
from activetouch.poses import Placement
from activetouch.pressing.contact import elastic_contact, surface_gap
from activetouch.rendering.response import TaxelResponse
from activetouch.solids.primitives import Sphere

LAYOUTS = (Taxels.grid(14, 6, 0.0034), Taxels.grid(8, 8, 0.004), Taxels.grid(4, 4, 0.0047), Taxels.grid(12, 3, 0.004))
RANGES = {"stiffness": [4.35e6, 4.35e7], "law": [0.7, 2.0]}
RADIUS = 0.010
_FELT = 0.02


def simulated(
    pad: PadDescription, share: np.ndarray, rng: np.random.Generator, number: int, dead: tuple[int, ...] = ()
) -> BallPresses:
    """Presses of a ball on a pad whose response lies at a share of its ranges; those that nobody feels are repeated."""
    scene, taxels = pad.scene(share=share), pad.taxels
    [answer], reach = scene.faults, np.abs(pad.taxels.centres[:, 1:]).max(axis=0)
    assert isinstance(answer, TaxelResponse)
    answer, stiffness = replace(answer, dead=dead), scene.variation.stiffness.support[0]
    readings, forces = [], []
    for _ in range(50 * number):
        force, place = rng.uniform(*pad.force), rng.uniform(-reach, reach)
        ball = Placement(Sphere(RADIUS), 1.0, np.array([1.0, 0.0, 0.0, 0.0]), place)
        contact = elastic_contact(scene.pad, surface_gap(scene.pad, ball), force, stiffness)
        read = answer.readings(taxels.mean(scene.image(contact)), rng)
        if read.max() > _FELT:
            readings.append(read)
            forces.append(force)
        if len(forces) == number:
            break
    return BallPresses(RADIUS, np.array(readings), np.array(forces))


def fitted(number: int, presses: int, seed: int) -> tuple[dict[str, float], int, PadFit]:
    """The true response of a simulated pad, its dead taxel, and the fit."""
    rng = np.random.default_rng([seed, number])
    layout = LAYOUTS[number % len(LAYOUTS)]
    is_relative = number // len(LAYOUTS) % 2 == 1
    pad = PadDescription(layout, Response.of(RANGES), (1.0, 8.0), full_scale=3e4, is_relative=is_relative)
    share, dead = rng.uniform(size=7), int(rng.integers(len(layout)))
    truth = {name: float(one[0]) for name, one in pad.response.at(share[None]).items()}
    return truth, dead, fit_pad(pad, simulated(pad, share, rng, presses, (dead,)))


def main() -> None:
    """Fit all pads and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pads", type=int, default=30)
    parser.add_argument("--presses", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    inside, widths, found_dead = defaultdict(list), defaultdict(list), []
    for number in range(given.pads):
        truth, dead, fit = fitted(number, given.presses, given.seed)
        found_dead.append(dead in fit.dead)
        for name, one in fit.numbers.items():
            inside[name].append(one.low <= truth[name] <= one.high)
            widths[name].append(one.high / one.low if name in ("stiffness", "gain") else one.high - one.low)
        words = ", ".join(f"{name} {truth[name]:.3g} in {fit.numbers[name]}" for name in ("stiffness", "law"))
        print(f"pad {number}: {words}; dead {dead}, found {fit.dead}, odd {fit.odd}", flush=True)
    for name, hits in inside.items():
        print(f"{name:10} inside {np.mean(hits):.3f} of {len(hits)}, median width {np.median(widths[name]):.3g}")
    print(f"dead taxel found {np.mean(found_dead):.3f}")


if __name__ == "__main__":
    main()
