"""The paper's task (§5.8): is this object the target?"""

from __future__ import annotations

import numpy as np

from activetouch.envs.base import TouchEnv, live_or_given
from activetouch.envs.priors import ObjectPriors, TargetProb
from activetouch.envs.touch_source import Touches
from belief import Belief, Composition, SearchProblem
from belief.policy_state import TOUCH_LIMIT


class ObjectTestEnv(TouchEnv):
    """One object, which is or is not of the target's shape: probe it, then CONFIRM or REJECT.

    ## Description
    The task on which the paper trains its policies (§5.8). An object of unknown size and orientation is in front of a
    tactile pad. A probe turns it into one of six poses, presses it against the pad, and has a network read the image. A
    decision ends the episode.

    ## Action Space
    `Discrete(8)` with the six poses of the named scenes:

    | action | meaning |
    |---|---|
    | 0 … 5 | probe in pose `front`, `z45`, `z90`, `y45`, `y90`, `corner` |
    | 6 | CONFIRM: it is the target |
    | 7 | REJECT: it is not |

    `env.unwrapped.action_masks()` says which of them make sense, for `sb3_contrib.MaskablePPO`.

    ## Observation Space
    The paper's state, a `Box(0, 1, (13,), float32)` with four shapes and six poses:

    | entries | meaning |
    |---|---|
    | 0 … 3 | the classifier's softmax of the last touch (sphere, cube, cylinder, cone); uniform before it |
    | 4 … 11 | the previous action, one-hot; zeros at the start |
    | 12 | touches made, as a share of `touch_limit` |

    Other observations by wrapper: :class:`activetouch.envs.wrappers.PosteriorState` for what the touches add up to,
    :class:`activetouch.envs.wrappers.RawImage` for the image.

    ## Starting State
    The object has the target's shape with probability `target_prob`, and each other shape as often as the next; that is
    also the belief. Nothing was felt yet. `reset(options={"seed": (…)})` makes the episode of that key.

    ## Rewards
    CONFIRM and REJECT: +1 where right, -1 where wrong. A probe: `-touch_cost` (λ).

    ## Episode End
    - Termination: CONFIRM or REJECT.
    - Truncation: a probe when `touch_limit` touches were made. It feels nothing, and costs what a probe costs.

    ## Information
    `reset()` and `step()` return a dictionary with
    - `is_success`: whether the episode ended with the right decision;
    - `num_touches`: made so far;
    - `target_prob`: posterior probability that it is the target; from `reset()`, the prior.

    ## Arguments
    ```python
    import gymnasium
    gymnasium.make("activetouch.envs:activetouch/ObjectTest-v0", scene="coarse", target="cone", touch_cost=0.02)
    ```
    - `scene="gel"`: the named scene, with the sensor that comes with it.
    - `target="cone"`: the shape sought.
    - `touch_cost=0.02`: λ, in units of a right decision.
    - `touch_limit=12`: T_max.
    - `target_prob=0.5`: how often the object is the target (decision 0030); or a range such as `(0.05, 0.95)`, from
      which every episode draws its own (decision 0024).
    - `touches=None`: other touches than the scene's live ones, a :class:`activetouch.envs.touch_source.Touches`.
    - `render_mode=None`: or `"rgb_array"`.

    ## Version History
    * v0: first version
    """

    def __init__(
        self,
        scene: str = "gel",
        target: str = "cone",
        touch_cost: float = 0.02,
        touch_limit: int = TOUCH_LIMIT,
        target_prob: TargetProb = 0.5,
        touches: Touches | None = None,
        render_mode: str | None = None,
    ) -> None:
        source = live_or_given(touches, scene)
        labels = source.model.shape_labels
        problem = SearchProblem(labels, source.pose_labels, 1, Composition.INDEPENDENT, touch_cost, touch_limit)
        super().__init__(problem, source, target, render_mode)
        self._priors = ObjectPriors.of(len(labels), self.target, target_prob)

    def _sample_arrangement(self, rng: np.random.Generator) -> tuple[int, ...]:
        self._prior = Belief.from_probs(self.problem.shape_labels, self._priors.probs(self._priors.draw(rng, 1)[0]))
        return (int(rng.choice(self.problem.num_shapes, p=self._prior.probs)),)

    def _act(self, action: int) -> tuple[float, bool, bool, bool]:
        if action < self.confirm:
            if self._num_touches == self.problem.touch_limit:
                return -self.problem.touch_cost, False, True, False
            self._probe(action)
            return -self.problem.touch_cost, False, False, False
        self._previous = action
        right = (action == self.confirm) == (self._arrangement[0] == self.target)
        return (1.0 if right else -1.0), True, False, right
