"""Upper bounds on the return of a scene's searches, and the time that each takes. One thread, without randomness.

Run: OMP_NUM_THREADS=1 python -m benchmarks.bounds hard many                (a minute or two a scene)
     OMP_NUM_THREADS=1 python -m benchmarks.bounds coarse --targets cone    (on a grid of beliefs: minutes a target)

For every target: one touch that reveals the shape; the joint sensor whose bodies are revealed, with its standard error;
its discretised model of independent touches. Means over targets in the last line.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from benchmarks.search_bound import best_expected_return, best_return_with_revealed_bodies
from experiments.scene_choice import SceneChoice
from experiments.search.setting import Setting
from planners.one_touch import one_touch_bound


def timed(find: Callable[[], object]) -> tuple[object, float]:
    """What a function returns, and the processor time it takes [s]."""
    started = time.process_time()
    return find(), time.process_time() - started


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--targets", nargs="+", help="all shapes by default")
    chosen = parser.parse_args()
    print("| scene | target | one touch | revealed body | s | discretised model | s |")
    print("|---|---|---|---|---|---|---|")
    for scene in chosen.scenes:
        joint = Setting(SceneChoice(scene))
        alone = Setting(SceneChoice(scene), observation_model="independent")
        labels, rows = list(joint.problem.shape_labels), []
        for label in chosen.targets or labels:
            target = labels.index(label)
            revealed, first = timed(lambda joint=joint, target=target: best_return_with_revealed_bodies(joint, target))
            found, second = timed(lambda alone=alone, target=target: best_expected_return(alone, target))
            rows.append([one_touch_bound(joint.problem, target), *revealed, first, found, second])
            print(line(scene, label, rows[-1]), flush=True)
        print(line(scene, "mean", np.mean(rows, axis=0)), flush=True)


def line(scene: str, target: str, row: list[float] | np.ndarray) -> str:
    """A row of the table."""
    one, mean, error, first, found, second = row
    cells = [scene, target, f"{one:.3f}", f"{mean:.3f} ± {error:.3f}", f"{first:.1f}", f"{found:.3f}", f"{second:.1f}"]
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
