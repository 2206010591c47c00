"""A decider of your own, compared with one of the registry.

Run in this folder:

    activetouch compare --scene coarse --deciders "own_decider:EveryPose(confirm=0.9)" information_gain --episodes 25

A decider is an object with a method ``decide``. Every worker process makes it from its name, so it must be in a file.
Parameters with the names ``table``, ``model`` and ``policies`` are passed to it; its other parameters are settings,
which are written in the brackets.
"""

from dataclasses import dataclass

import numpy as np

from belief import Confirm, Probe, Reject
from planners import Decision, InformationState, check_decider


@dataclass(frozen=True)
class EveryPose:
    """Touch every object once in each of the first poses, then give the more probable answer.

    Attributes:
        poses: number of poses.
        confirm: probability of the target at which it confirms at once.
    """

    poses: int = 3
    confirm: float = 0.95

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """The next action: probe in a pose, confirm, or reject."""
        scores = {"target_prob": info.target_prob}
        if info.target_prob >= self.confirm:
            return Decision(Confirm(), scores)
        if len(info.history) < min(self.poses, info.problem.num_poses):
            return Decision(Probe(len(info.history)), scores)
        return Decision(Confirm() if info.target_prob > 0.5 else Reject(), scores)


if __name__ == "__main__":
    print(f"{len(check_decider(EveryPose(), np.random.default_rng(0)))} searches: the decider meets the contract")
