"""An agent of pomdp-py that tests one object: POUCT with a belief about four shapes, updated by what it is shown.

It knows the environment by its observation alone: the softmax of four shapes, the last action, one-hot, the time, and
the target, one-hot. It believes that the likeliest shape is the right one in seven of ten touches.

Run: activetouch compare --scene coarse --deciders "policy:pomdp_py_agent:Agent(remembers=True,sees_target=True)" \
         information_gain
"""

import random

import numpy as np
import pomdp_py
from pomdp_py.utils.templates import SimpleAction, SimpleObservation, SimpleState

SHAPES, POSES, RIGHT, PRICE = 4, 6, 0.7, 0.02
STATES, SEEN = [SimpleState(k) for k in range(SHAPES)], [SimpleObservation(k) for k in range(SHAPES)]
TOUCH, CONFIRM, REJECT = (SimpleAction(name) for name in ("touch", "confirm", "reject"))
END, NOTHING = SimpleState("end"), SimpleObservation("nothing")


class Transitions(pomdp_py.TransitionModel):
    def probability(self, next_state, state, action):
        return float(next_state == self.sample(state, action))

    def sample(self, state, action):
        return state if action == TOUCH else END


class Observations(pomdp_py.ObservationModel):
    def probability(self, observation, next_state, action):
        return RIGHT if observation.data == next_state.data else (1.0 - RIGHT) / (SHAPES - 1)

    def sample(self, next_state, action):
        if action != TOUCH or next_state == END:
            return NOTHING
        return random.choices(SEEN, [self.probability(seen, next_state, action) for seen in SEEN])[0]


class Rewards(pomdp_py.RewardModel):
    def __init__(self, target):
        self.target = target

    def sample(self, state, action, next_state):
        if state == END or action == TOUCH:
            return 0.0 if state == END else -PRICE
        return 1.0 if (state.data == self.target) == (action == CONFIRM) else -1.0


class Policy(pomdp_py.RolloutPolicy):
    def __init__(self, target):
        self.target = target

    def get_all_actions(self, state=None, history=None):
        return [TOUCH, CONFIRM, REJECT]

    def rollout(self, state, history):
        return CONFIRM if state == END or state.data == self.target else REJECT


class Agent:
    """Called with the observations of one object, from the first to the last, it returns an action for each."""

    def __init__(self):
        random.seed(0)
        self.agent, self.touches = None, 0

    def __call__(self, observation):
        frame, target = observation[:SHAPES], int(observation[-SHAPES:].argmax())
        if self.agent is None:
            prior, policy = pomdp_py.Histogram(dict.fromkeys(STATES, 1.0 / SHAPES)), Policy(target)
            self.agent = pomdp_py.Agent(prior, policy, Transitions(), Observations(), Rewards(target))
        else:
            seen, models = SEEN[int(np.argmax(frame))], (self.agent.observation_model, self.agent.transition_model)
            self.agent.set_belief(pomdp_py.update_histogram_belief(self.agent.belief, TOUCH, seen, *models))
            self.touches += 1
        planner = pomdp_py.POUCT(
            max_depth=8,
            discount_factor=1.0,
            num_sims=300,
            exploration_const=1.0,
            rollout_policy=self.agent.policy_model,
        )
        action = planner.plan(self.agent)
        self.agent.tree = None
        return {TOUCH: self.touches % POSES, CONFIRM: POSES, REJECT: POSES + 1}[action]
