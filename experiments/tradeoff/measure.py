"""Measurement of one configuration: results of its searches, and processor time of a touch.

Processor time does not depend on other programs; on an idle core it equals the elapsed time.
"""

from __future__ import annotations

import json
import multiprocessing
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from activetouch import TactileSensor, TouchWorld
from activetouch.named_scenes import SCENES
from activetouch.perception.reader import TactileReader
from activetouch.scene_description import scene_fields
from activetouch.sensor_files import POLICIES, READER_FILE, write_observation_model
from activetouch.world import touch_many
from belief import Touch
from belief.files import atomic_path, require_regular_file, write_text
from experiments.command_line.workers import in_own_process
from experiments.search.fingerprint import made_with
from experiments.search.play import episode_seed, make_world
from experiments.tradeoff.configuration import SHIPPED, Configuration, Network
from experiments.tradeoff.models import observation_model
from planners import Episode, make_decider, search_lockstep
from planners.search import TouchRequest

_PRESSES, _READINGS = 200, 100
_TOGETHER = 25  # episodes in lockstep


@dataclass(frozen=True)
class SearchResult:
    """Results of the searches of a configuration; lists have one entry per episode, target after target.

    Attributes:
        configuration: the configuration.
        successes: 1 for a success, 0 otherwise.
        touches: number of touches.
        decisions: number of decisions, including those to touch.
        rewards: return.
        decision_seconds: time of belief updates and decisions, sum over all episodes.
        planning_seconds: the same for one first search per target, which includes planning unless this process made
            the same plan before.
        made_with: digests of the code and versions of the packages; None if they are not known.
    """

    configuration: Configuration
    successes: list[int]
    touches: list[int]
    decisions: list[int]
    rewards: list[float]
    decision_seconds: float
    planning_seconds: float
    made_with: dict[str, str] | None = None

    @property
    def ms_per_decision(self) -> float:
        """Mean time of a belief update and decision [ms]."""
        return 1e3 * self.decision_seconds / sum(self.decisions)


@dataclass(frozen=True)
class TouchCost:
    """Time of a touch without the decision, and memory of the sensor.

    Attributes:
        physics: time of a press and its image [ms].
        network: time to read one image [ms].
        size: size of the reader's file [MB].
        memory: peak memory of a process that loads the sensor and touches [MB].
    """

    physics: float
    network: float
    size: float
    memory: float


def measured(configuration: Configuration, folder: Path) -> SearchResult:
    """Result of a configuration, read from its file, or measured and written if there is none."""
    path = folder / "results" / f"{configuration.key}.json"
    if not path.exists():
        result = _search(configuration, folder / "models")
        write_text(path, json.dumps(asdict(result)) + "\n")
    return SearchResult(**{**json.loads(require_regular_file(path).read_text()), "configuration": configuration})


def num_outdated(results: Iterable[SearchResult]) -> int:
    """Number of results that other code or other versions of packages measured than now."""
    now = made_with()
    return sum(result.made_with != now for result in results)


def finished(folder: Path, seed: int) -> list[tuple[SearchResult, TouchCost]]:
    """All results of a seed in a folder, with their costs; if some differ only in the number of searches, the largest.

    All of them played the same searches.
    """
    found: dict[Configuration, SearchResult] = {}
    for path in sorted((folder / "results").glob("[!.]*.json")):
        fields = json.loads(require_regular_file(path).read_text())
        network = Network(**fields["configuration"].pop("network"))
        configuration = Configuration(network=network, **fields["configuration"])
        if configuration.key != path.stem or configuration.seed != seed:
            continue  # measured with an earlier version of a shipped sensor, or in other searches
        result = SearchResult(**{**fields, "configuration": configuration})
        same = replace(configuration, episodes=0)
        if same not in found or len(found[same].successes) < len(result.successes):
            found[same] = result
    return [(result, touch_cost(result.configuration, folder)) for result in found.values()]


def _search(configuration: Configuration, cache: Path) -> SearchResult:
    problem = configuration.setting.problem
    sensor = _sensor(configuration)
    if configuration.observation_model != SHIPPED:
        sensor = replace(sensor, model=observation_model(configuration, cache))
    decider = make_decider(
        configuration.decider,
        sensor.model.outcome_table(),
        sensor.model,
        configuration.network.folder / POLICIES,
        configuration.simulations,
    )
    touching = 0.0

    def touch_and_time(requests: Sequence[TouchRequest[TouchWorld]]) -> Sequence[Touch]:
        nonlocal touching
        started = time.thread_time()
        touches = touch_many(sensor, requests)[0]
        touching += time.thread_time() - started
        return touches

    def play(seeds: Sequence[tuple[int, ...]]) -> tuple[list[Episode], float]:
        """Play episodes; return them and the seconds of belief updates and decisions."""
        episodes: list[Episode] = []
        thinking = 0.0
        for first in range(0, len(seeds), _TOGETHER):
            some = seeds[first : first + _TOGETHER]
            worlds, targets = [make_world(problem, sensor, seed) for seed in some], [seed[1] for seed in some]
            started = time.thread_time() - touching
            episodes += search_lockstep(worlds, decider, problem, targets, sensor.model, some, touch_and_time)
            thinking += time.thread_time() - touching - started
        return episodes, thinking

    targets = range(problem.num_shapes)
    seeds = [episode_seed(configuration.seed, t, number) for t in targets for number in range(configuration.episodes)]
    _, planning = play(seeds[:: configuration.episodes])  # one episode per target, in which plans are made
    episodes, thinking = play(seeds)
    return SearchResult(
        configuration,
        [int(episode.success) for episode in episodes],
        [episode.num_touches for episode in episodes],
        [len(episode.steps) for episode in episodes],
        [episode.reward(problem) for episode in episodes],
        thinking,
        planning,
        made_with(),
    )


def _sensor(configuration: Configuration) -> TactileSensor:
    """The sensor with the configuration's network and the observation model of a shipped sensor."""
    network = configuration.network
    sensor = TactileSensor.load(network.folder, configuration.setting.scene, anyway=True)
    return sensor if network.sensor else replace(sensor, reader=TactileReader.load(network.path))


def touch_cost(configuration: Configuration, folder: Path) -> TouchCost:
    """Costs of a touch, read from their files, or measured in new processes; all networks share those of a press."""
    scene, network = configuration.scene, configuration.network
    press = f"press-{scene}-{configuration.fidelity or 'own'}"
    read = f"read-{scene}-{network.sha256[:12]}"
    found: dict[str, float] = {}
    for stem, measure in ((press, _press_here), (read, _read_here)):
        path = folder / "costs" / f"{stem}.json"
        if not path.exists():
            context = multiprocessing.get_context("forkserver")  # small processes, and one import of these modules
            context.set_forkserver_preload(["activetouch.perception.reader", "activetouch.pressing.rig", __name__])
            write_text(path, json.dumps(in_own_process(context, measure, configuration)) + "\n")
        found |= json.loads(require_regular_file(path).read_text())
    return TouchCost(**found)


def _press_here(configuration: Configuration) -> dict[str, float]:
    scene, rng = configuration.setting.scene, np.random.default_rng(0)
    num_shapes = len(scene.shapes)
    seconds = []
    for number in range(num_shapes + _PRESSES):
        thing = scene.sample_object(number % num_shapes, rng)
        started = time.thread_time()
        scene.press(thing, number % len(scene.poses), rng)
        seconds.append(time.thread_time() - started)
    return {"physics": 1e3 * float(np.mean(seconds[num_shapes:]))}  # the first press of each shape compiles its model


def _read_here(configuration: Configuration) -> dict[str, float]:
    sensor, rng = _sensor(replace(configuration, fidelity=None)), np.random.default_rng(0)
    seconds = []
    for number in range(_READINGS):
        thing = sensor.scene.sample_object(number % len(sensor.scene.shapes), rng)
        image = sensor.scene.press(thing, 0, rng).image
        started = time.thread_time()
        sensor.read(image[None], [0])
        seconds.append(time.thread_time() - started)
    size = configuration.network.path.stat().st_size / 1e6
    return {"network": 1e3 * float(np.median(seconds)), "size": size, "memory": _peak_memory()}


def _peak_memory() -> float:
    """Peak memory of this process [MB]; NaN if the system does not report it.

    ``getrusage`` may include the parent process, so it is the second choice.
    """
    status = Path("/proc/self/status")
    if status.exists():
        [peak] = (line.split()[1] for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(peak) / 1e3
    try:
        import resource
    except ImportError:  # Windows
        return float("nan")
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def export_sensor(configuration: Configuration, folder: Path) -> Path | None:
    """Write a folder from which ``compare`` can load the configuration's sensor; None for a shipped sensor."""
    if configuration.observation_model == SHIPPED:
        return None
    out = folder / "sensors" / configuration.key
    fitted_to = scene_fields(SCENES[configuration.network.scene].scene)
    write_observation_model(out, observation_model(configuration, folder / "models"), fitted_to)
    with atomic_path(out / READER_FILE) as temporary:
        temporary.write_bytes(configuration.network.path.read_bytes())
    return out
