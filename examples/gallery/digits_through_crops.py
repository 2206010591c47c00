"""A belief tracker without touch: which digit is it, seen through four crops?

Nothing in `belief` knows about touch. Here a classifier of scikit-learn sees one quarter of an 8 × 8 image of a digit.
An observation model is fitted to digits that the classifier did not learn from, and Bayes' rule combines the quarters.

Run: python examples/gallery/digits_through_crops.py [FIGURE.png]   (8 s of processor time; needs the extra recorded)
"""

from activetouch.extras import script_needs

script_needs("recorded")

import sys

import numpy as np
from matplotlib import pyplot as plt
from sklearn.datasets import load_digits
from sklearn.linear_model import LogisticRegression

from belief import Touch
from belief.observation_model import RatioModel
from belief.observation_model.selection import log_posteriors
from belief.statistics import wilson_interval
from belief.touch_batch import TouchBatch

digits = load_digits()
order = np.random.default_rng(0).permutation(len(digits.target))
images, names = digits.images[order] / 16.0, digits.target[order]
crops = np.stack([images[:, r : r + 4, c : c + 4].reshape(-1, 16) for r in (0, 4) for c in (0, 4)], axis=1)
learn, fit, test = slice(0, 900), slice(900, 1300), slice(1300, None)

logits = np.stack(  # (number, 4, 10): one classifier for each quarter
    [
        LogisticRegression(max_iter=1000).fit(crops[learn, q], names[learn]).decision_function(crops[:, q])
        for q in range(4)
    ],
    axis=1,
)
touches = [Touch(q, row) for quarters in logits[fit] for q, row in enumerate(quarters)]
labels = tuple(map(str, range(10)))
model = RatioModel.fit(touches, np.repeat(names[fit], 4), np.repeat(np.arange(400), 4), shape_labels=labels)

number = len(names[test])
batch = TouchBatch(np.tile(np.arange(4), (number, 1)), logits[test])
probs = [np.exp(log_posteriors(model, batch.first(n))) for n in (1, 2, 3, 4)]
right = [(p.argmax(axis=1) == names[test]).sum() for p in probs]

figure, (left, axes) = plt.subplots(1, 2, figsize=(7, 3.4), layout="constrained", width_ratios=(1, 1.6))
left.imshow(images[test][0], cmap="gray_r")
left.axhline(3.5, color="#d55e00")
left.axvline(3.5, color="#d55e00")
left.set(xticks=[], yticks=[], title=f"a {names[test][0]}, in quarters")
bounds = np.array([wilson_interval(int(r), number) for r in right])
share = np.array(right) / number
axes.errorbar((1, 2, 3, 4), share, [share - bounds[:, 0], bounds[:, 1] - share], fmt="o-", label="right")
axes.plot((1, 2, 3, 4), [p.max(axis=1).mean() for p in probs], "--", label="stated")
axes.set(xlabel="quarters seen", xticks=(1, 2, 3, 4), ylabel=f"of {number} new digits", ylim=(0, 1.02))
axes.legend(frameon=False)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "digits_through_crops.png")
print("right after 1 to 4 quarters: " + ", ".join(f"{value:.3f}" for value in share))
