"""A real sensor: naming 41 objects by grasps that a robot hand with three BioTac fingers recorded.

A plain classifier learns from the first grasps of every object and is tested on the last ones. Its probabilities are
multiplied as if grasps were independent. The stated confidence (dashed) is above the accuracy (solid): this is why
touches need a calibrated model of how they repeat. `activetouch recorded` has such a model, searches and intervals.

Run: python examples/gallery/a_real_sensor.py [FIGURE.png]   (6 s of processor time; needs the extra recorded)
"""

from activetouch.extras import script_needs

script_needs("recorded")

import sys
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

from activetouch.recorded import read_recorded

TOUCHES, DRAWS = (2, 2) if "--short" in sys.argv else (8, 20)
folder = Path(__file__).resolve().parents[2] / "tests" / "fixtures" / "bts3"
touches, _ = read_recorded(folder, "bts3")
features, things, rng = touches.features, touches.objects, np.random.default_rng(0)

late = np.zeros(len(things), bool)
for thing in np.unique(things):
    rows = np.flatnonzero(things == thing)
    late[rows[np.argsort(touches.sessions[rows], kind="stable")][-len(rows) // 4 :]] = True
reader = LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto").fit(features[~late], things[~late])
log_probs = reader.predict_log_proba(features)

sums, truth = [], []
for thing in reader.classes_:
    rows = np.flatnonzero(late & (things == thing))
    for _ in range(DRAWS):
        sums.append(log_probs[rng.choice(rows, TOUCHES, replace=len(rows) < TOUCHES)].cumsum(axis=0))
        truth.append(thing)
scores = np.array(sums)
probs = np.exp(scores - scores.max(axis=2, keepdims=True))
probs /= probs.sum(axis=2, keepdims=True)
right = reader.classes_[probs.argmax(axis=2)] == np.array(truth)[:, None]
numbers = range(1, TOUCHES + 1)

figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
axes.plot(numbers, probs.max(axis=2).mean(axis=0), "--", color="#d55e00", label="stated, as independent")
axes.plot(numbers, right.mean(axis=0), "o-", color="#0072b2", label="right")
axes.axhline(1 / len(reader.classes_), color="#555", linestyle=":", label="a guess")
axes.set(xlabel="grasps of an object", ylabel=f"of {len(reader.classes_)} objects", ylim=(0, 1.02), xticks=numbers)
axes.legend(frameon=False)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "a_real_sensor.png")
print(f"one grasp: {right[:, 0].mean():.3f} right, a guess {1 / len(reader.classes_):.3f}")
