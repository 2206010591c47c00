"""The environment of the paper's task (§5.8): decide whether one object is the target."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.envs.object_search import ObjectSearchEnv, live_or_given
from activetouch.envs.touch_source import ObjectPriors, TargetProb, Touches
from activetouch.hand import Hand
from belief.bayes import Belief
from belief.composition import Composition
from belief.policy_state import TOUCH_LIMIT


class ObjectTestEnv(ObjectSearchEnv):
    """One object: probe it, then CONFIRM that it has the target's shape, or REJECT it.

    The task on which the paper trains its policies (§5.8). An object of unknown size and orientation is in front of a
    tactile pad. A probe turns it into a pose, presses it against the pad, and classifies the tactile image.

    ## Action Space
    `Discrete(8)` with six poses: 0 … 5 probe in pose `front`, `z45`, `z90`, `y45`, `y90`, `corner`; 6 is CONFIRM, 7 is
    REJECT. `env.unwrapped.action_masks()` gives the valid actions, for `sb3_contrib.MaskablePPO`.

    ## Observation Space
    By default the paper's state, a `Box(0, 1, (13,), float32)` with four shapes and six poses:

    | entries | meaning |
    |---|---|
    | 0 … 3 | the classifier's softmax of the last touch (sphere, cube, cylinder, cone); uniform before it |
    | 4 … 11 | the previous action, one-hot; zeros at the start |
    | 12 | touches made, as a fraction of `touch_limit` |

    `state="posterior"` is a `Box(-1, 1)` of K + P + 2 numbers (:func:`belief.policy_state.posterior_state`), and
    `state="gains"` of K + 2 P + 2 for a sensor of one rigid body (:func:`belief.policy_state.gains_state`).
    `env.unwrapped.last_image` is the image of the last press. With `target=None` the target follows, one-hot.

    ## Starting State
    The object has the target's shape with probability `target_prob`; the other shapes are equally likely. The belief
    starts at the same prior. `reset(options={"seed": (…)})` makes the episode with that key.

    ## Rewards
    CONFIRM and REJECT: +1 if correct, else -1. Probe: `-touch_cost` (λ).

    ## Episode End
    - Termination: CONFIRM or REJECT.
    - Truncation: a probe after `touch_limit` touches, which is not made but costs `touch_cost`.

    ## Information
    - `is_success`: whether the episode ended with the correct decision;
    - `num_touches`: number of touches so far;
    - `target_prob`: posterior probability of the target's shape; after `reset()`, the prior;
    - `target`, with `target=None`: label of the target shape.

    Args:
        scene: a named scene, with its shipped sensor; "gel" by default.
        target: label of the target shape, "cone" by default; or None to draw it at reset, uniformly.
        touch_cost: λ.
        touch_limit: T_max.
        target_prob: prior of the target (decision 0031); or a range such as ``(0.05, 0.95)``, from which every episode
            draws its own (decision 0031).
        touches: another source of touches, a :class:`activetouch.envs.touch_source.Touches`.
        render_mode: None, "rgb_array", or "human", a window that follows the episode.
        state: "paper", "posterior" or "gains".
        hand: a :class:`activetouch.hand.Hand`, or its name, such as "parallel": each probe is then one grasp.
    """

    def __init__(
        self,
        scene: str = "gel",
        target: str | None = "cone",
        touch_cost: float = 0.02,
        touch_limit: int = TOUCH_LIMIT,
        target_prob: TargetProb = 0.5,
        touches: Touches | None = None,
        render_mode: str | None = None,
        state: str = "paper",
        hand: Hand | str | None = None,
    ) -> None:
        source = live_or_given(touches, scene, hand)
        labels, among = source.model.shape_labels, Composition.INDEPENDENT
        self._draws_target = target is None
        self._num_more = len(labels) if self._draws_target else 0
        sought = labels[0] if target is None else target
        super().__init__(scene, sought, touch_cost, 1, among, touch_limit, source, render_mode, state=state)
        self._truncation_reward = -touch_cost
        self._priors = ObjectPriors.of(len(labels), target_prob)

    def _more(self) -> NDArray[np.floating]:
        """A drawn target, one-hot."""
        return np.eye(self.problem.num_shapes)[self.target] if self._draws_target else np.empty(0)

    def _sample_arrangement(self, rng: np.random.Generator) -> tuple[int, ...]:
        if self._draws_target:
            self.target = int(rng.integers(self.problem.num_shapes))
        probs = self._priors.probs(self._priors.draw(rng, 1)[0], self.target)
        self._prior = Belief.from_probs(self.problem.shape_labels, probs)
        return (int(rng.choice(self.problem.num_shapes, p=self._prior.probs)),)

    def _more_info(self) -> dict[str, Any]:
        return {"target": self.problem.shape_labels[self.target]} if self._draws_target else {}
