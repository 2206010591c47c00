"""Play searches by the loop, and over a pipe by a second process that is killed and resumed at every step.

Run: python -m benchmarks.live_search         (five minutes on one core)

The robot presses the same simulated objects in both. At every step the second process gets SIGKILL, in one of two steps
before the robot has read its answer: whether the touch was kept is then open, and the robot tells it again. The new
process is a fork of one that has loaded the sensor, and knows nothing but the log. The actions of both searches, and
the last posterior of all objects, are compared bit by bit.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from activetouch import TactileSensor
from belief.problem import Probe
from belief.scene_belief import SceneBelief
from belief.seeding import touch_rng
from experiments.search.live_protocol import Conversation, converse
from experiments.search.one_search import problem_of, session_with
from experiments.search.play import make_world
from planners import Decider, Episode, make_decider, search
from planners.episode import ACTION_NAMES

DECIDERS = ("information_gain", "random_poses")  # the second one draws random numbers


@dataclass
class Live:
    """The process that decides.

    Attributes:
        sensor: loaded before it is forked.
        decider: chooses the actions.
        key: of the search; its second number is the target.
        log: all that it has after a kill.
    """

    sensor: TactileSensor
    decider: Decider
    key: tuple[int, int, int]
    log: Path
    pid: int = 0
    pipes: list[IO[bytes]] = field(default_factory=list)

    def start(self) -> None:
        """Fork it."""
        (lines, to), (of, answers) = os.pipe(), os.pipe()
        self.pid = os.fork()
        if not self.pid:
            os.close(to)
            os.close(of)
            session = session_with(self.sensor, self.key[1], self.decider, self.key, log=self.log, abstain=False)
            with open(lines, "rb") as requests, open(answers, "wb") as replies:
                converse(Conversation(session, self.sensor), requests, replies)
            os._exit(0)
        os.close(lines)
        os.close(answers)
        self.pipes = [open(to, "wb"), open(of, "rb")]  # noqa: SIM115

    def send(self, **request: Any) -> None:
        """Send a line."""
        self.pipes[0].write(json.dumps(request).encode() + b"\n")
        self.pipes[0].flush()

    def says(self, **request: Any) -> dict[str, Any]:
        """The answer to a line."""
        self.send(**request)
        found: dict[str, Any] = json.loads(self.pipes[1].readline())
        return found

    def kill(self) -> None:
        """Kill it, without a chance to clean up."""
        os.kill(self.pid, signal.SIGKILL)
        os.waitpid(self.pid, 0)
        for pipe in self.pipes:
            with suppress(BrokenPipeError):
                pipe.close()


def over_the_pipe(live: Live, rng: np.random.Generator, counts: dict[str, int]) -> tuple[list[Any], bytes]:
    """Actions and last log posterior of a search that is killed at every step."""
    sensor, key = live.sensor, live.key
    world, uses, actions = make_world(problem_of(sensor), sensor, key), {}, []
    live.start()
    while (question := live.says(do="ask"))["action"] is not None:
        place, step = question["object"], question["step"]
        actions.append(question.get("pose", question["action"]))
        if question["action"] == "touch":
            pose = sensor.pose_labels.index(question["pose"])
            repeat = uses[place, pose] = uses.get((place, pose), -1) + 1
            image, _ = world.press(pose, touch_rng(key, place, pose, repeat))
            told: dict[str, Any] = {"image": image.tolist()}
        else:
            told = {"done": True}
        if rng.random() < 0.5:
            live.send(do="tell", step=step, **told)
            time.sleep(rng.exponential(0.002))
        else:
            assert live.says(do="tell", step=step, **told)["ok"]
        live.kill()
        live.start()
        counts["kills"] += 1
        now = live.says(do="state")
        if now["step"] == step:
            counts["told again"] += 1
            assert live.says(do="tell", step=step, **told)["ok"]
        if question["action"] == "reject" and live.says(do="state")["outcome"] is None:
            world.advance()
    marginals = np.array(live.says(do="state")["log_marginals"])
    live.kill()
    return actions, marginals.tobytes()


def by_the_loop(sensor: TactileSensor, decider: Decider, key: tuple[int, int, int]) -> tuple[list[Any], bytes, Episode]:
    """Actions and last log posterior of the same search, and its record."""
    problem = problem_of(sensor)
    episode = search(make_world(problem, sensor, key), decider, problem, key[1], sensor.model, key)
    scene = SceneBelief(problem, sensor.model)
    for step in episode.steps:
        if step.touch is not None:
            scene.update(step.object_index, [step.touch])
    actions = [step.decision.action for step in episode.steps]
    named = [problem.pose_labels[a.pose] if isinstance(a, Probe) else ACTION_NAMES[type(a)] for a in actions]
    return named, scene.log_marginals().clip(-1e300).tobytes(), episode


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--searches", type=int, default=300)
    parser.add_argument("--scene", default="coarse")
    given = parser.parse_args()
    sensor, rng = TactileSensor.shipped(given.scene), np.random.default_rng(0)
    table, counts = sensor.model.outcome_table(), {"kills": 0, "told again": 0}
    deciders = [make_decider(name, table, sensor.model) for name in DECIDERS]
    same_actions = same_posterior = touches = 0
    with tempfile.TemporaryDirectory() as folder:
        for number in range(given.searches):
            decider, target = deciders[number % 2], number // 2 % len(sensor.shape_labels)
            key = (0, target, number)
            actions, posterior, episode = by_the_loop(sensor, decider, key)
            found, last = over_the_pipe(Live(sensor, decider, key, Path(folder, f"{number}.jsonl")), rng, counts)
            same_actions += found == actions
            same_posterior += last == posterior
            touches += episode.num_touches
    print(f"scene {given.scene}, searches {given.searches} ({' and '.join(DECIDERS)}), seeds 0 to {given.searches - 1}")
    print(f"touches {touches}, kills {counts['kills']}, told again after a kill {counts['told again']}")
    print(f"searches with the same actions {same_actions}, with the same posterior byte for byte {same_posterior}")


if __name__ == "__main__":
    main()
