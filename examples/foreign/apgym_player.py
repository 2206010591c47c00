"""A player for ap_gym's classification tasks: it learns what each pose shows of each class, and touches and predicts.

It knows nothing of the task but its spaces, and the class that ap_gym tells after an episode. Without a rule it plays
with both, on the same episodes, and writes their results.

Run: python apgym_player.py [LEARNED] [PLAYED]         (episodes: 300 and 200; writes in_turn.csv and at_random.csv)
     activetouch compare --results in_turn.csv at_random.csv
"""

import csv
import sys

import ap_gym
import numpy as np

TASK = "activetouch.envs.apgym:activetouch/ShapeTouch-v0"
learned, played = (int(word) for word in sys.argv[1:]) if len(sys.argv) > 1 else (300, 200)
env = ap_gym.make(TASK, scene="coarse", step_limit=4)
num_poses, num_classes = env.inner_action_space.shape[0], env.prediction_space.shape[0]


def play(rule, rng, means=None, spread=1.0, **start):
    """Images, poses, class, and whether the last prediction was right, of one episode."""
    seen, _ = env.reset(**start)
    images, poses, logits, done = [], [], np.zeros(num_classes), False
    while not done:
        images.append(seen["sensor_img"].ravel())
        poses.append(int(seen["sensor_pose"].argmax()))
        if means is not None:
            logits = logits - ((images[-1] - means[poses[-1]]) ** 2).sum(axis=1) / spread
        action = np.zeros(num_poses, np.float32)
        action[(poses[-1] + 1) % num_poses if rule == "in_turn" else rng.integers(num_poses)] = 1.0
        seen, _, terminated, truncated, info = env.step({"action": action, "prediction": logits.astype(np.float32)})
        done = terminated or truncated
    return images, poses, int(info["prediction"]["target"]), info["stats"]["scalar"]


rng = np.random.default_rng(0)
images, poses, classes = [], [], []
for seed in range(learned):
    some, where, which, _ = play("at_random", rng, seed=10_000 + seed)
    images, poses, classes = images + some, poses + where, classes + [which] * len(some)
images, poses, classes = np.array(images), np.array(poses), np.array(classes)
means = np.zeros((num_poses, num_classes, images.shape[1]))
for pose, which in np.ndindex(num_poses, num_classes):
    found = images[(poses == pose) & (classes == which)]
    means[pose, which] = found.mean(axis=0) if len(found) else images.mean(axis=0)
spread = 2.0 * ((images - means[poses, classes]) ** 2).sum(axis=1).mean() / 4

for rule in ("in_turn", "at_random"):
    with open(f"{rule}.csv", "w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["seed", "task", "success", "length"])
        for seed in range(played):
            scores = play(rule, rng, means, spread, seed=seed)[3]
            rows.writerow([seed, "coarse", int(scores["final_accuracy"]), int(scores.get("last_incorrect", -1)) + 1])
    print(f"wrote {rule}.csv")
