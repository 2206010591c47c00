"""Frames of a recorded search. The touch images are computed again from the episode's seed."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from activetouch import TactileSensor
from activetouch.scene import WorldObject
from belief.observation_model.rigid_body_evidence import RigidBodyEvidence, joint_evidence
from belief.problem import Action, Probe, Reject, SearchProblem
from belief.seeding import touch_rng
from experiments.search.play import make_world
from planners import Episode, Step
from planners.episode import ACTION_NAMES


@dataclass(frozen=True, eq=False)
class Frame:
    """One decision of a replayed search.

    Attributes:
        step: decision and the belief before it.
        shape: true shape of the object.
        image: tactile image, uint8; None for a decision without a touch.
        posterior: belief about the object after the step, shape ``(K,)``.
        body: the object.
        evidence: all touches of the object so far, under a joint observation model; None with any other.
    """

    step: Step
    shape: int
    image: NDArray[np.uint8] | None
    posterior: NDArray[np.float64]
    body: WorldObject
    evidence: RigidBodyEvidence | None = None


def action_words(action: Action, problem: SearchProblem) -> str:
    """An action in words: "touch corner", "confirm", "reject" or "unsure"."""
    if isinstance(action, Probe):
        return f"touch {problem.pose_labels[action.pose]}"
    return ACTION_NAMES[type(action)]


def replay(sensor: TactileSensor, problem: SearchProblem, episode: Episode) -> list[Frame]:
    """Repeat the touches of an episode of a run with its sensor."""
    world = make_world(problem, sensor, episode.seed)
    uses: Counter[tuple[int, int]] = Counter()
    frames, nothing = [], sensor.model.start()
    evidence = nothing
    for number, step in enumerate(episode.steps):
        body = world.current
        image, posterior = None, step.belief.probs
        if isinstance(step.decision.action, Probe) and step.touch is not None:
            pose = step.decision.action.pose
            rng = touch_rng(episode.seed, step.object_index, pose, uses[step.object_index, pose])
            image, _ = world.press(pose, rng)
            uses[step.object_index, pose] += 1
            if joint_evidence(evidence) is not None:
                [touch] = replace(sensor, with_logits=False).read(image[None], [pose])  # recorded were logits alone
                evidence = evidence.update(touch)
            posterior = episode.steps[number + 1].belief.probs  # a touch is always followed by a decision
        elif isinstance(step.decision.action, Reject) and number + 1 < len(episode.steps):
            world.advance()
        frames.append(
            Frame(step, episode.arrangement[step.object_index], image, posterior, body, joint_evidence(evidence))
        )
        evidence = nothing if isinstance(step.decision.action, Reject) else evidence
    return frames
