"""Which of two policies bears a perturbation better changes when a control is subtracted.

All data here are simulated: 16 families of perturbations, 50 episodes each, two policies. `plain` fails in some
episodes without a perturbation, too, and loses little by it; `tuned` fails only when perturbed. Success under
perturbation favours `tuned`; minus each policy's own control, the same episodes unperturbed, most families favour
`plain`. A report of this change of sign on real data is lerobot#4619. The files are as for
`activetouch compare --results A B --control A0 B0`.

Run: python examples/gallery/subtract_a_control.py [FIGURE.png]   (3 s of processor time)
"""

import csv
import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from experiments.search.results import compare_results

FAMILIES, EPISODES = (4, 20) if "--short" in sys.argv else (16, 50)
ARMS = ("plain", "tuned", "plain unperturbed", "tuned unperturbed")

rng = np.random.default_rng(0)
rows = {name: [] for name in ARMS}
for family in range(FAMILIES):
    unperturbed = rng.uniform(0.10, 0.24)  # share of episodes in which plain fails in any case
    added = rng.uniform(0.0, 0.04), rng.uniform(0.04, 0.14)  # further failures by the perturbation
    for seed in range(EPISODES):
        hard, *broken = rng.random(3)
        fails = hard < unperturbed or broken[0] < added[0], broken[1] < added[1], hard < unperturbed, False
        for name, failed in zip(ARMS, fails, strict=True):
            rows[name].append((seed, f"family {family + 1}", int(not failed)))

with tempfile.TemporaryDirectory() as folder:
    paths = [Path(folder, f"{name}.csv") for name in ARMS]
    for path in paths:
        with path.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows([("seed", "task", "success"), *rows[path.stem]])
    found = compare_results(paths[:2], control=paths[2:])
print("Simulated data.", *found.verdict(), sep="\n")

figure, axes = plt.subplots(figsize=(6, 3.4), layout="constrained")
of_tasks = [values for (_, task), values in found.beyond_controls.items() if task != "all"]
places = np.arange(1, FAMILIES + 1)
before, after = np.array([one for one, _ in of_tasks]), np.array([three for _, three in of_tasks])
axes.axhline(0.0, color="0.7", linewidth=1)
axes.plot(places - 0.12, before, "o", label="under perturbation")
bars = np.abs(after[:, 1:].T - after[:, 0])
axes.errorbar(places + 0.12, after[:, 0], bars, fmt="s", markersize=5, label="minus controls, 95 %")
axes.set(xlabel="family of perturbations (simulated)", ylabel="success, tuned minus plain", xticks=places)
axes.legend(frameon=False, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 1.0))
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "subtract_a_control.png")
