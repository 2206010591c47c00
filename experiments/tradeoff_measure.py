"""Measure one configuration: its searches, and what a touch costs by part.

Times are of the processor, not of the clock: on an idle core they are the same, and other programs on the machine do
not lengthen them.
"""

from __future__ import annotations

import json
import multiprocessing
import resource
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from activetouch import TactileSensor
from activetouch.atomic import write_text
from activetouch.world import MODELS, POLICIES
from belief import Touch
from experiments.episodes import episode_seed, make_world
from experiments.tradeoff_configuration import Configuration, Network
from experiments.tradeoff_touches import RecordedWorld, observation_model, read_rounds
from planners import Episode, make_decider, search_lockstep
from planners.search import TouchRequest

_PRESSES, _READINGS = 60, 40
_TOGETHER = 25  # episodes in lockstep


@dataclass(frozen=True)
class Result:
    """What came of a configuration's searches; one entry an episode, target after target.

    Attributes:
        configuration: which.
        successes: 1 or 0.
        touches: of each search.
        decisions: of each search, touches included.
        rewards: return of each.
        decision_seconds: belief and decider, of all together.
    """

    configuration: Configuration
    successes: list[int]
    touches: list[int]
    decisions: list[int]
    rewards: list[float]
    decision_seconds: float

    @property
    def ms_per_decision(self) -> float:
        """Belief and decider, on average."""
        return 1e3 * self.decision_seconds / sum(self.decisions)


@dataclass(frozen=True)
class TouchCost:
    """What a touch costs beside the decision, and what the sensor needs.

    Attributes:
        physics: of a press and its image [ms].
        network: to read one image [ms].
        weights: of the network in memory [MB].
        memory: peak of a process that loads the sensor and searches once [MB].
    """

    physics: float
    network: float
    weights: float
    memory: float


def measured(configuration: Configuration, folder: Path) -> Result:
    """The result of a configuration: from its shard if it is there; searched, and the shard written, if not."""
    path = folder / "results" / f"{configuration.key}.json"
    if not path.exists():
        result = _search(configuration, folder / "touches")
        write_text(path, json.dumps(asdict(result)) + "\n")
    fields = json.loads(path.read_text())
    return Result(**{**fields, "configuration": configuration})


def finished(folder: Path) -> list[tuple[Result, TouchCost]]:
    """All results that a folder holds, with their costs; of those that differ in their number only the largest."""
    found: dict[Configuration, tuple[Result, TouchCost]] = {}
    for path in sorted((folder / "results").glob("[!.]*.json")):
        fields = json.loads(path.read_text())
        network = Network(**fields["configuration"].pop("network"))
        configuration = Configuration(network=network, **fields["configuration"])
        if configuration.key != path.stem or not _cost_file(configuration, folder).exists():
            continue  # of a shipped sensor that is no longer shipped, or not fully measured
        result = Result(**{**fields, "configuration": configuration})
        same = replace(configuration, episodes=0)
        if same not in found or len(found[same][0].successes) < len(result.successes):
            found[same] = (result, touch_cost(configuration, folder))
    return list(found.values())


def _cost_file(configuration: Configuration, folder: Path) -> Path:
    name = f"{configuration.scene}-{configuration.network.sha256[:12]}-{configuration.precision}"
    return folder / "costs" / f"{name}-{configuration.fidelity or 'own'}.json"


def _search(configuration: Configuration, cache: Path) -> Result:
    import torch

    torch.set_num_threads(1)
    setting = configuration.setting
    problem = setting.problem
    model = observation_model(configuration, cache)
    decider = make_decider(
        configuration.decider, model.outcome_table(), model, setting.sensor_folder / POLICIES, configuration.simulations
    )
    serve: Callable[[Sequence[TouchRequest[Any]]], Sequence[Touch]]
    if configuration.touches == "live":
        sensor = replace(_sensor(configuration), model=model)
        worlds = {seed: make_world(setting, sensor, seed) for seed in _seeds(configuration)}
        serve = sensor.touch_many
    else:
        rounds = read_rounds(configuration.network, configuration.precision, "test", cache)
        worlds = {seed: RecordedWorld.sample(rounds, problem, seed) for seed in _seeds(configuration)}

        def serve(requests: Sequence[TouchRequest[Any]]) -> list[Touch]:
            return [request.world.touch(request.pose, request.rng) for request in requests]

    touching = 0.0

    def timed(requests: Sequence[TouchRequest[Any]]) -> Sequence[Touch]:
        nonlocal touching
        started = time.thread_time()
        touches = serve(requests)
        touching += time.thread_time() - started
        return touches

    episodes: list[Episode] = []
    started, seeds = time.thread_time(), list(worlds)
    for first in range(0, len(seeds), _TOGETHER):
        some = seeds[first : first + _TOGETHER]
        targets = [seed[1] for seed in some]
        episodes += search_lockstep([worlds[s] for s in some], decider, problem, targets, model, some, timed)
    spent = time.thread_time() - started
    return Result(
        configuration,
        [int(episode.success) for episode in episodes],
        [episode.num_touches for episode in episodes],
        [len(episode.steps) for episode in episodes],
        [episode.reward(problem) for episode in episodes],
        spent - touching,
    )


def _seeds(configuration: Configuration) -> list[tuple[int, ...]]:
    """Of all episodes, target after target."""
    num_shapes = configuration.setting.problem.num_shapes
    return [
        episode_seed(configuration.seed, target, n)
        for target in range(num_shapes)
        for n in range(configuration.episodes)
    ]


def _sensor(configuration: Configuration) -> TactileSensor:
    """The scene with the configuration's network, and the shipped observation model."""
    from activetouch.classifier import TouchClassifier  # loads torch

    sensor = TactileSensor.load(MODELS / configuration.scene, configuration.setting.scene)
    classifier = TouchClassifier.load(configuration.network.path)
    return replace(sensor, classifier=classifier.to_bfloat16() if configuration.precision == "bf16" else classifier)


def touch_cost(configuration: Configuration, folder: Path) -> TouchCost:
    """What a touch costs in a configuration: from its shard if it is there; measured in a fresh process if not."""
    path = _cost_file(configuration, folder)
    if not path.exists():
        context = multiprocessing.get_context("forkserver")  # which is lean, and loads these once
        context.set_forkserver_preload(["activetouch.classifier", "activetouch.rig", __name__])
        with ProcessPoolExecutor(1, mp_context=context) as pool:
            cost = pool.submit(_cost_here, configuration).result()
        write_text(path, json.dumps(asdict(cost)) + "\n")
    return TouchCost(**json.loads(path.read_text()))


def _cost_here(configuration: Configuration) -> TouchCost:
    import torch

    torch.set_num_threads(1)
    sensor, rng = _sensor(configuration), np.random.default_rng(0)
    things = [sensor.scene.sample_object(n % len(sensor.scene.shapes), rng) for n in range(_PRESSES)]
    images, presses = [], []
    for number, thing in enumerate(things):
        started = time.thread_time()
        _, image = sensor.scene.press(thing, number % len(sensor.scene.poses), rng)
        presses.append(time.thread_time() - started)
        images.append(image)
    readings = []
    for number in range(_READINGS):
        started = time.thread_time()
        sensor.read(images[number][None], [0])
        readings.append(time.thread_time() - started)
    weights = sum(p.numel() * p.element_size() for p in sensor.classifier.network.parameters()) / 1e6
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    warm = len(sensor.scene.shapes)  # the first press of a shape compiles its model
    return TouchCost(1e3 * float(np.mean(presses[warm:])), 1e3 * float(np.median(readings)), weights, memory)


def export_sensor(configuration: Configuration, folder: Path) -> Path | None:
    """A folder from which a comparison can load the configuration's sensor; None where it is the shipped one."""
    from activetouch.world import CLASSIFIER_FILE, OBSERVATION_FILE

    if configuration.observation_model == "shipped" and configuration.network == Network.of(configuration.scene):
        return None
    out = folder / "sensors" / configuration.key
    out.mkdir(parents=True, exist_ok=True)
    write_text(out / OBSERVATION_FILE, observation_model(configuration, folder / "touches").to_json() + "\n")
    (out / CLASSIFIER_FILE).write_bytes(configuration.network.path.read_bytes())
    return out
