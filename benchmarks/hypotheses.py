"""How many hypotheses a choice of the next touch needs: touches and time by hypotheses and outcomes, among cubes.

    python -m benchmarks.hypotheses --searches 200 --out docs/hypotheses.png             (some minutes)

The searches are those of the variant "cubes" of :mod:`benchmarks.difficulty`, the same for all settings. The time is
processor time of one choice among 26 places on one thread.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from activetouch import TactileSensor
from belief import Probe, SearchProblem
from belief.statistics import paired_bootstrap, wilson_interval
from benchmarks.difficulty import VARIANTS, play, prepared
from benchmarks.timed import Timed
from planners import make_decider

SETTINGS = ((1, 128), (4, 128), (16, 32), (16, 128), (64, 32), (64, 128), (128, 256), (512, 512))
_STOP = "confirm=0.98,reject=0.02,max_touches=26"


def main() -> None:
    """Print the table and draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--searches", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("runs/hypotheses.png"))
    arguments = parser.parse_args()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    variant = VARIANTS["cubes"]
    sensor, model, shapes = prepared(TactileSensor.shipped("keyed"), variant)
    problem = SearchProblem(variant.shapes, sensor.scene.pose_labels, 4, "independent", touch_limit=4 * 26)
    drawn = Figure((8.0, 4.5), layout="constrained")
    times = "time of a choice [ms], labels: hypotheses of each shape × outcomes"
    axes = drawn.add_subplot(xscale="log", xlabel=times, ylabel="touches of a search")
    names = [(f"shape_information_gain(hypotheses={h},outcomes={m},{_STOP})", f"{h} × {m}") for h, m in SETTINGS]
    first = np.zeros(0)
    print(
        "hypotheses × outcomes  median [ms]  90 % below [ms]  success, 95 %          touches  fewer than random, 95 %"
    )
    for reference, label in ((f"random_poses({_STOP})", "random places"), *names):
        timed = Timed(make_decider(reference, model.outcome_table(), model))
        episodes = play(sensor, model, shapes, problem, timed, arguments.searches, arguments.seed)
        touches = np.array([episode.num_touches for episode in episodes], float)
        first = first if first.size else touches
        right = sum(episode.success for episode in episodes)
        low, high = wilson_interval(right, arguments.searches)
        fewer = paired_bootstrap(first, touches, np.random.default_rng(arguments.seed))
        median, most = np.quantile(timed.milliseconds[Probe], [0.5, 0.9])
        print(
            f"{label:<21}  {median:11.2f}  {most:15.2f}  {right / arguments.searches:.3f} [{low:.3f}, {high:.3f}]  "
            f"{touches.mean():7.2f}  {fewer[0]:.2f} [{fewer[1]:.2f}, {fewer[2]:.2f}]",
            flush=True,
        )
        error = 1.96 * touches.std(ddof=1) / np.sqrt(len(touches))
        if label == "random places":
            axes.axhspan(touches.mean() - error, touches.mean() + error, color="0.9", label=f"{label}, 95 %")
            continue
        axes.errorbar(median, touches.mean(), error, fmt="o", color="tab:blue")
        below = label.endswith("× 32") or label.startswith("16 ")
        place, shift = touches.mean() + (-error if below else error), -4 if below else 4
        how = {"rotation": 90, "ha": "center", "va": "top" if below else "bottom", "fontsize": 8}
        axes.annotate(label, (median, place), (0, shift), textcoords="offset points", **how)
    axes.set(xticks=(0.3, 0.5, 1, 2, 3), xticklabels=("0.3", "0.5", "1", "2", "3"), xlim=(0.3, 3), ylim=0)
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right")
    drawn.savefig(arguments.out, dpi=110)


if __name__ == "__main__":
    main()
