"""Searches in trays at several seeds, beside an oracle that recognises each contact at once, with the time of a touch.

Run: python -m benchmarks.drawer --sensor gel --searches 200 --seeds 7 8        (a quarter of an hour on one core)

The oracle has the decider information_per_cost and the same trays. Its touches are the same, too, but each contact says
which shape was met, and where it lies: what is left to do is to meet the objects.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from activetouch import drawer
from activetouch.tray.sensor import Keyed, TraySensor
from activetouch.tray.world import Tray, TrayWorld
from belief.statistics.comparison import wilson_interval
from belief.tray import Found, PlaceTouch, TrayBelief, World
from planners.tray import ConfirmAt, Press, standing_of, stop


@dataclass
class Oracle:
    """A belief whose contacts are recognised."""

    belief: TrayBelief
    world: TrayWorld

    def told(self, touch: PlaceTouch, met: int | None) -> None:
        """The belief after a touch, which met an object."""
        before = self.belief.worlds[0].found
        after = self.belief.update(touch)
        found = before
        if met is not None:
            one = self._known(met)
            if all((one.shape[0], one.x[0], one.y[0]) != (other.shape[0], other.x[0], other.y[0]) for other in before):
                found = (*before, one)
        self.belief = replace(after, worlds=(World(found),))

    def _known(self, met: int) -> Found:
        """An object whose shape and place are known."""
        lying, table = self.world.objects[met], self.belief.table
        rows = np.flatnonzero(table.shape_of == lying.shape)
        x, y = self.belief.cell_at(float(lying.place[0]), float(lying.place[1]))
        places = np.full(len(rows), x), np.full(len(rows), y)
        base = np.log(table.prior[rows])
        return Found(
            met,
            (PlaceTouch((x, y)),),
            rows,
            *places,
            base,
            np.zeros(len(rows)),
            self.belief.noise,
            len(table.labels),
            table.shape_of[rows],
        )


def by_oracle(sensor: TraySensor, target: int, seed: tuple[int, int]) -> tuple[int, float, bool]:
    """Touches, travel [m], and whether the answer is right, of a search in which contacts are recognised."""
    keyed = sensor.touched(target, seed)
    world = keyed.world
    oracle = Oracle(sensor.belief(target), world)
    rng, at, travel = np.random.default_rng([*seed, target, 1]), (0.0, 0.0), 0.0
    decider = sensor.decider()
    while True:
        belief = oracle.belief
        answer = stop(standing_of(belief), belief.num_touches, sensor.rules)
        action = answer or decider.choose(belief, at, rng).action
        if not isinstance(action, Press):
            break
        place = belief.centre(action.cell)
        travel += float(np.hypot(place[0] - at[0], place[1] - at[1]))
        at, met = place, keyed.press(*place)
        read = (None, None) if met.image is None else sensor.read(met.image)
        oracle.told(PlaceTouch(action.cell, met.height, *read), met.met)
    is_there = any(one.shape == target for one in world.objects)
    return oracle.belief.num_touches, travel, isinstance(action, ConfirmAt) == is_there


def timed(sensor: TraySensor, searches: int) -> tuple[float, float]:
    """Median CPU time of an update and of a decision [ms]."""
    updates, decisions = [], []
    for number in range(searches):
        target = number % len(sensor.shape_labels)
        world, belief = sensor.world(target, (99, number)), sensor.belief(target)
        keyed, rng, at = Keyed(world, (99, number)), np.random.default_rng(number), (0.0, 0.0)
        decider = sensor.decider()
        for _ in range(25):
            if stop(standing_of(belief), belief.num_touches, sensor.rules):
                break
            start = time.process_time()
            action: Any = decider.choose(belief, at, rng).action
            decisions.append(time.process_time() - start)
            at = belief.centre(action.cell)
            met = keyed.press(*at)
            read = (None, None) if met.image is None else sensor.read(met.image)
            start = time.process_time()
            belief = belief.update(PlaceTouch(action.cell, met.height, *read))
            standing_of(belief)
            updates.append(time.process_time() - start)
    return 1e3 * float(np.median(updates)), 1e3 * float(np.median(decisions))


def main() -> None:
    """Play and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sensor", default="gel")
    parser.add_argument("--folder", type=Path, help="meshes in place of the twelve shapes")
    parser.add_argument(
        "--strangers", type=Path, help="meshes of other objects, which lie among these with probability .3"
    )
    parser.add_argument("--searches", type=int, default=200)
    parser.add_argument("--seeds", type=int, nargs="*", default=[7, 8])
    parser.add_argument("--deciders", nargs="*", default=["information_per_cost", "raster"])
    parser.add_argument("--push", type=float, default=0.0, help="largest push of a touch [mm]")
    parser.add_argument("--oracle", type=int, default=0, help="searches of the oracle")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, help="folder in which finished searches are kept")
    given = parser.parse_args()
    tray = Tray(push=given.push / 1e3, unlisted=0.3 if given.strangers else 0.0)
    worlds: dict[str, Any] = {"sensor": given.sensor, "shapes": given.folder, "strangers": given.strangers or ()}
    for seed in given.seeds:
        start = time.perf_counter()
        shared: dict[str, Any] = {"num_searches": given.searches, "seed": seed, "tray": tray, "jobs": given.jobs}
        out = None if given.out is None else given.out / f"{given.sensor}_{seed}"
        found = drawer(given.deciders, **shared, **worlds, out=out)
        for row in found.rows():
            row |= {name: np.nan for name, value in row.items() if value is None}
            low, high = row["right_interval"] if row["answered"] else (0.0, 1.0)
            print(
                f"{given.sensor}, seed {seed}, {row['decider']:<21} {row['searches']} trays: answered "
                f"{row['answered']:.3f}, stated {row['stated']:.3f}, right {row['right']:.3f} [{low:.3f}, {high:.3f}], "
                f"found {row['found']:.3f}, absent called present {row['called_present']:.3f}, touches "
                f"{row['touches']:.1f} ± {row['touches_error']:.1f}, travel {row['travel']:.2f} m",
                flush=True,
            )
        print(f"    {time.perf_counter() - start:.0f} s", flush=True)
    sensor = TraySensor.shipped(given.sensor, given.folder, tray, None, given.strangers or ())
    if given.oracle:
        number = len(sensor.shape_labels)
        rows = [by_oracle(sensor, one % number, (given.seeds[0], one)) for one in range(given.oracle)]
        touches, travel, right = (np.array(part, float) for part in zip(*rows, strict=True))
        low, high = wilson_interval(int(right.sum()), len(right))
        print(
            f"{given.sensor}, seed {given.seeds[0]}, oracle {len(rows)} trays: right {right.mean():.3f} [{low:.3f}, "
            f"{high:.3f}], touches {touches.mean():.1f}, travel {travel.mean():.2f} m",
            flush=True,
        )
    update, decision = timed(sensor, 12)
    print(f"{given.sensor}: median CPU time of an update {update:.1f} ms, of a decision {decision:.1f} ms", flush=True)


if __name__ == "__main__":
    main()
