"""The multi-object search of pomdp-py, played by an exact belief and gain per cost, beside pomdp-py's own POUCT.

Run: OMP_NUM_THREADS=1 python -m benchmarks.object_search            (seconds; --simulations 100 takes minutes)

A robot in a grid with obstacles looks for five objects: a look shows, with errors, those within four cells; "find"
marks those in range as found, at most as often as there are objects. World, rewards and sensor are those of the
package's own demonstration (pomdp_py.problems.multi_object_search): random_world(10, 10, 5, 10), radius 4, sigma .05,
epsilon .95.

As in the searches of a tray, the belief about the place of each object is exact, a look that shows nothing moves its
mass elsewhere, and the next place is that with the largest expected gain divided by its cost: steps of the way.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import random
import sys
import time
from dataclasses import dataclass, field
from typing import Any
from unittest.mock import MagicMock

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from belief.tray import convolved

for _missing in ("pygame", "cv2"):  # the package draws with these; nothing is drawn here
    sys.modules.setdefault(_missing, MagicMock())

import pomdp_py  # noqa: E402
from pomdp_py.problems.multi_object_search.domain.action import ALL_MOTION_ACTIONS, Find, Look  # noqa: E402
from pomdp_py.problems.multi_object_search.env.env import make_proximity_sensor  # noqa: E402
from pomdp_py.problems.multi_object_search.example_worlds import random_world  # noqa: E402
from pomdp_py.problems.multi_object_search.problem import MosOOPOMDP, belief_update  # noqa: E402

Floats = NDArray[np.float64]
RADIUS, SIGMA, EPSILON, MOST_STEPS = 4, 0.05, 0.95, 100
SURE = 0.9
"""Probability that an object not found yet is in range, from which "find" is said after a look."""
WORTH = 0.02
"""The same, from which a look is worth a step."""


def problem(seed: int) -> Any:
    """The world of a seed, as the demonstration makes it."""
    random.seed(seed)
    np.random.seed(seed)  # noqa: NPY002
    grid, robot = random_world(10, 10, 5, 10)
    sensors = {robot: make_proximity_sensor(RADIUS, False)}
    return MosOOPOMDP(
        robot, grid_map=grid, sensors=sensors, sigma=SIGMA, epsilon=EPSILON, prior="uniform", agent_has_map=True
    )


@dataclass
class GainPerCost:
    """Exact belief about each object ``(X, Y)``, and the place with the largest gain per step."""

    world: Any
    beliefs: dict[int, Floats] = field(default_factory=dict)
    found: set[int] = field(default_factory=set)
    has_looked: bool = False

    def __post_init__(self) -> None:
        env = self.world.env
        self.size = env.width, env.length
        self.robot = self.world.agent.robot_id
        self.beliefs = {one: np.full(self.size, 1.0 / np.prod(self.size)) for one in env.target_objects}
        along = np.arange(-RADIUS, RADIUS + 1)
        distance = np.hypot(along[:, None], along)
        self.disc = ((distance >= 0.1) & (distance <= RADIUS)).astype(float)
        self.area = env.sensors[self.robot].sensing_region_size
        self.moves = [action.motion[:2] for action in ALL_MOTION_ACTIONS]
        self._steps_from = self._ways({env.state.pose(one) for one in env.obstacles})

    def _ways(self, obstacles: set[tuple[int, int]]) -> tuple[Floats, NDArray[np.int32]]:
        """Steps between all cells, and the cell before the last on the way, both ``(X · Y, X · Y)``."""
        rows, columns = [], []
        for x in range(self.size[0]):
            for y in range(self.size[1]):
                for along, across in self.moves:
                    to = x + along, y + across
                    if 0 <= to[0] < self.size[0] and 0 <= to[1] < self.size[1] and to not in obstacles:
                        rows.append(x * self.size[1] + y)
                        columns.append(to[0] * self.size[1] + to[1])
        number = self.size[0] * self.size[1]
        graph = coo_array((np.ones(len(rows)), (rows, columns)), (number, number)).tocsr()
        steps, before = dijkstra(graph, return_predecessors=True)
        return steps, before

    def in_range(self, place: tuple[int, int]) -> Floats:
        """Whether each cell is in range of the sensor at a place."""
        single = np.zeros(self.size)
        single[place] = 1.0
        return convolved(single, self.disc) > 0.5

    def act(self) -> Any:
        """The next action."""
        place = tuple(self.world.env.state.pose(self.robot)[:2])
        masses = {one: convolved(self.beliefs[one], self.disc) for one in self.beliefs if one not in self.found}
        here = 1.0 - float(np.prod([1.0 - min(mass[place], 1.0) for mass in masses.values()]))
        if self.has_looked and here > SURE:
            return Find
        if not self.has_looked and here > WORTH:
            return Look
        start = place[0] * self.size[1] + place[1]
        steps = self._steps_from[0][start]
        gain = sum(np.minimum(mass, 1.0) for mass in masses.values()).ravel()
        index = np.where((steps > 0) & np.isfinite(steps), gain / (2.0 * steps + 2.0), -1.0)  # moves, looks, a find
        cell = int(index.argmax())
        if index[cell] < 0.0:  # the robot is enclosed
            return Find if self.has_looked else Look
        while (before := int(self._steps_from[1][start, cell])) != start:
            cell = before
        towards = cell // self.size[1] - place[0], cell % self.size[1] - place[1]
        return ALL_MOTION_ACTIONS[self.moves.index(towards)] if towards in self.moves else Look

    def told(self, action: Any, observation: Any) -> None:
        """Bayes' rule after a look; what was in range of a find is found, and the rest is elsewhere."""
        place = tuple(self.world.env.state.pose(self.robot)[:2])
        inside = self.in_range(place)
        if action is Look:
            other = (1.0 - EPSILON) / 2.0
            for one, belief in self.beliefs.items():
                seen = observation.for_obj(one).pose
                likelihood = other / self.area + np.where(inside, other, EPSILON)
                if seen is not None:
                    x, y = np.indices(self.size)
                    near = np.exp(-((x - seen[0]) ** 2 + (y - seen[1]) ** 2) / (2.0 * SIGMA**2)) / (
                        2.0 * np.pi * SIGMA**2
                    )
                    likelihood = near * np.where(inside, EPSILON, other) + other / self.area
                self.beliefs[one] = belief * likelihood / float((belief * likelihood).sum())
        if action is Find:
            self.found = set(self.world.env.state.object_states[self.robot].objects_found)
            for one in self.beliefs:
                if one not in self.found:
                    left = np.where(inside, 1e-9, self.beliefs[one])
                    self.beliefs[one] = left / left.sum()
        self.has_looked = action is Look


class Pouct:
    """The planner of the demonstration."""

    def __init__(self, world: Any, simulations: int) -> None:
        self.world = world
        self.planner = pomdp_py.POUCT(
            max_depth=10,
            discount_factor=0.99,
            num_sims=simulations,
            exploration_const=1000,
            rollout_policy=world.agent.policy_model,
        )

    def act(self) -> Any:
        """The next action."""
        return self.planner.plan(self.world.agent)

    def told(self, action: Any, observation: Any) -> None:
        """The demonstration's own update."""
        agent, env = self.world.agent, self.world.env
        agent.clear_history()
        agent.update_history(action, observation)
        belief_update(agent, action, observation, env.state.object_states[agent.robot_id], self.planner)


def play(world: Any, player: Any) -> dict[str, float]:
    """One search: objects found, steps, reward, and milliseconds of a decision."""
    env, robot = world.env, world.agent.robot_id
    reward, finds, seconds = 0.0, 0, 0.0
    steps = 0
    while steps < MOST_STEPS:
        steps += 1
        start = time.process_time()
        action = player.act()
        seconds += time.process_time() - start
        reward += env.state_transition(action, execute=True, robot_id=robot)
        observation = env.provide_observation(world.agent.observation_model, action)
        finds += action == Find
        start = time.process_time()
        player.told(action, observation)
        seconds += time.process_time() - start
        found = set(env.state.object_states[robot].objects_found)
        if found == set(env.target_objects) or finds >= len(env.target_objects):
            break
    return {
        "all": float(found == set(env.target_objects)),
        "steps": steps,
        "reward": reward,
        "ms": 1e3 * seconds / steps,
    }


def report(name: str, seeds: range, simulations: int) -> None:
    """Play some seeds and print their means."""
    rows = []
    for seed in seeds:
        with contextlib.redirect_stdout(io.StringIO()):
            world = problem(seed)
            rows.append(play(world, Pouct(world, simulations) if simulations else GainPerCost(world)))
    every = {key: np.array([row[key] for row in rows]) for key in rows[0]}
    errors = {key: 1.96 * part.std(ddof=1) / len(part) ** 0.5 for key, part in every.items()}
    print(
        f"{name:<22} seeds {seeds.start}-{seeds.stop - 1}: all found in {int(every['all'].sum())} of {len(rows)}, "
        f"steps {every['steps'].mean():.1f} ± {errors['steps']:.1f}, reward {every['reward'].mean():.0f} ± "
        f"{errors['reward']:.0f}, {every['ms'].mean():.2f} ms CPU a step",
        flush=True,
    )


def main() -> None:
    """Play and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=100, help="searches of the exact belief")
    parser.add_argument("--simulations", type=int, nargs="*", default=[], help="of POUCT, such as 100 1000")
    parser.add_argument("--pouct-seeds", type=int, default=20, help="searches of POUCT, which takes long")
    given = parser.parse_args()
    report("gain per cost", range(given.seeds), 0)
    for simulations in given.simulations:
        report(f"POUCT {simulations}", range(given.pouct_seeds), simulations)


if __name__ == "__main__":
    main()
