"""What the pages of deciders and scenes say beside what the code says."""

from __future__ import annotations

from typing import NamedTuple


class Description(NamedTuple):
    """Idea, meaning of the scores or results, and weaknesses of a decider or a scene."""

    idea: str
    scores: str
    weak: str


NOTHING = Description("See its docstring.", "See [what the columns mean](../columns.md).", "Not described yet.")

_TARGET = "`target_prob`: posterior probability that the current object is the target."
_GAINS = f"{_TARGET} `gain_POSE`: expected information of a touch in this pose in nats, discounted for repeats."
_THRESHOLDS = "It confirms at a posterior of 0.99, rejects at 0.01 (lower for a prior below 1/12), and touches an object twelve times at most."

DECIDERS = {
    "random_confirm": Description(
        "It confirms one of the objects at random and never touches. Its success is what touching has to beat.",
        "It has no scores.",
        "Everything, on purpose: it is the no-touch baseline.",
    ),
    "threshold": Description(
        "The paper's rule (§6.3). It reads the softmax of single touches: two in a row above 0.9 confirm, one below 0.1 rejects. Touches are not "
        "combined.",
        f"`frame_prob`: softmax of the last touch for the target, not calibrated. {_TARGET}",
        "Ambiguous touches: it rejects after one touch that looks unlike the target. In `paper` it is no better than a guess.",
    ),
    "random_poses": Description(
        f"Posterior thresholds with poses in random order, each once before any is used again. {_THRESHOLDS}",
        _TARGET,
        "Scenes in which poses differ in quality. It is there to measure what choosing poses is worth.",
    ),
    "fixed_poses": Description(
        f"Posterior thresholds with poses in a fixed order. {_THRESHOLDS}",
        _TARGET,
        "As `random_poses`; if the first pose is a poor one, every object is first touched there.",
    ),
    "best_order": Description(
        f"Posterior thresholds with the poses in the order that was best on calibration objects (that `calibrate` finds). {_THRESHOLDS}",
        _TARGET,
        "Scenes in which the next touch depends on what was felt. It is there to measure what choosing poses is worth.",
    ),
    "information_gain": Description(
        f"The next pose is the one that is expected to tell most about one question: is this object the target? {_THRESHOLDS} With a sensor of one "
        "body, the gain is that after the touches so far.",
        _GAINS,
        "Costs: it stops at a fixed posterior, whatever a touch costs and whatever is left to search.",
    ),
    "shape_information_gain": Description(
        f"As `information_gain`, but for the whole shape: it also pays to tell cube from cylinder when the target is a cone. {_THRESHOLDS}",
        _GAINS,
        "Searches with few touches for one target: part of what it learns does not matter for the answer. Where many touches are needed, as in `keyed`, the two need equally many.",
    ),
    "pose_information_gain": Description(
        f"As `shape_information_gain`, but for orientation and size as well: it goes on asking when the shape is known. {_THRESHOLDS}",
        _GAINS,
        "Searches: what it learns of how an object lies does not matter for the answer. Without a belief about a body it is `shape_information_gain`.",
    ),
    "value_of_information": Description(
        "It has no thresholds: it stops when no plan of two more touches is worth its cost (`depth=1`: of one). Rejecting is worth the value of the rest of the search.",
        f"{_TARGET} Further scores are expected returns of the actions.",
        "Uninformative touches: where more than two are needed, it answers too early.",
    ),
    "ppo": Description(
        "A small network for each target, trained by PPO on the paper's state: the last softmax, the last action and the time.",
        f"{_TARGET} `confirm`, `reject`: probabilities that the policy gives these actions.",
        "Combining touches: its state holds only the last one. It knows single objects, not whole searches.",
    ),
    "ppo_posterior": Description(
        "As `ppo`, trained on the posterior instead of the last softmax.",
        f"{_TARGET} `confirm`, `reject`: probabilities that the policy gives these actions.",
        "Other scenes and costs than those it was trained with.",
    ),
    "ppo_gains": Description(
        "As `ppo_posterior`, for sensors of one rigid body: the network also sees the gain of each pose that `information_gain` chooses by.",
        f"{_TARGET} `confirm`, `reject`: probabilities that the policy gives these actions.",
        "Other scenes and costs than those it was trained with, and `paper-independent`, for which there are no such gains.",
    ),
    "ppo_goal": Description(
        "As `ppo_gains`, with one network for all targets, which sees the target.",
        f"{_TARGET} `confirm`, `reject`: probabilities that the policy gives these actions.",
        "As `ppo_gains`.",
    ),
    "ppo_confident": Description(
        f"The poses of `ppo`, stopped by posterior thresholds. {_THRESHOLDS}",
        f"{_TARGET} `overruled`: the policy would have stopped.",
        "As `ppo`, in its choice of poses.",
    ),
    "pouct": Description(
        "Monte Carlo tree search by pomdp-py from the exact belief. Simulated searches end with the right decision for the simulated state.",
        "Expected returns and visit counts of the actions at the root of the tree.",
        "Time: a few hundred times that of `point_based` for each decision. It needs the extra `pomdp`.",
    ),
    "point_based": Description(
        "It solves the search as a POMDP once for each target, by point-based value iteration, and follows the plan with the "
        "exact belief.",
        f"{_TARGET} Further scores are expected returns of the actions under the plan.",
        "Twelve objects, where the plan has fewer states than the belief; and worlds in which its cost or its outcome table is wrong.",
    ),
}
"""By name; a decider without an entry has a page all the same."""

_SUCCESS = "A guess succeeds in {guess}. Differences between deciders show {where}."

WORLDS = {
    "paper": Description(
        "The paper's world: an object is pressed until a small force is reached. The image shows the force vector as a dot, not "
        "the geometry of the contact.",
        _SUCCESS.format(guess="0.25", where="in success and in touches: single touches are ambiguous"),
        "Single touches: `paper-independent` reads 0.64 of them right. Only a belief about one body solves its searches.",
    ),
    "coarse": Description(
        "A cheap sensor: 4 × 4 taxels, 5 % noise, two of them dead. Several touches of a body are needed, so deciders differ.",
        _SUCCESS.format(guess="0.25", where="mostly in touches and return"),
        "Cones: at most 0.49 of single touches of a cone can be recognised by any reader.",
    ),
    "gel": Description(
        "The default: 128 × 128 taxels of a gel pad. One touch nearly decides the shape.",
        _SUCCESS.format(guess="0.25", where="hardly: all sensible deciders succeed in 0.999 or more"),
        "Comparing deciders. Use it to see presses and images, or as a task that is nearly solved.",
    ),
    "hard": Description(
        "Eight objects, any mixture of twelve shapes that share faces and edges, very different sizes, half the pad. The target may be absent or "
        "there several times.",
        _SUCCESS.format(
            guess="0.50, because in half the scenes the target is absent and rejecting all is right",
            where="in success and return",
        ),
        "Pairs such as cube and cuboid, which some touches cannot tell apart.",
    ),
    "many": Description(
        "Twelve objects of twelve shapes with the default pad. What is learned about one object tells about the others.",
        _SUCCESS.format(guess="0.08", where="in touches: a search visits half of the objects on average"),
        "Time: the exact belief about twelve objects is the most expensive one.",
    ),
    "keyed": Description(
        "Cubes, shafts and plates that differ in one place each, such as a cut corner, touched from 26 directions. Here it matters where the next "
        "touch is ([where to touch next](../where_to_touch.md)).",
        _SUCCESS.format(
            guess="0.50, because in half the scenes the target is absent and rejecting all is right",
            where="mostly in touches: `information_gain` and `shape_information_gain` find the places that matter",
        ),
        "Time: it has more directions, and needs more touches, than the other scenes.",
    ),
}
"""By name; a scene without an entry has a page all the same."""
