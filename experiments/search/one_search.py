"""One search with a sensor object: what :meth:`activetouch.TactileSensor.search` does."""

from __future__ import annotations

from collections.abc import Sequence

from activetouch import TactileSensor, TouchWorld
from activetouch.named_scenes import SCENES
from belief.composition import Composition, Counts
from belief.naming import Name, index_of, seed_words
from belief.problem import SearchProblem
from belief.seeding import arrangement_rng
from belief.synthetic import sample_arrangement
from experiments.scene_choice import as_named
from planners import Decider, Episode, make_decider, search


def search_with(
    sensor: TactileSensor,
    target: Name,
    decider: str | Decider,
    seed: int | Sequence[int],
    num_objects: int | None = None,
    composition: Composition | Counts | str | None = None,
    touch_cost: float = 0.02,
) -> Episode:
    """Search for a target among objects of the sensor's scene; see :meth:`activetouch.TactileSensor.search`."""
    scene, model = sensor.scene, sensor.model
    named = next((known for known in SCENES.values() if known.scene == scene), None) or as_named(scene)
    number = named.num_objects if num_objects is None else num_objects
    problem = SearchProblem(
        scene.shape_labels,
        scene.pose_labels,
        number,
        Composition(composition) if isinstance(composition, str) else composition or named.composition,
        touch_cost,
        touch_limit=named.touches_per_object * number,
    )
    shape = index_of("target", problem.shape_labels, target)
    words = seed_words(seed)
    key = (*words, shape, 0) if len(words) == 1 else words
    chosen = make_decider(decider, model.outcome_table(), model) if isinstance(decider, str) else decider
    rng = arrangement_rng(key)
    world = TouchWorld.sample(sensor, sample_arrangement(problem, rng), rng)
    return search(world, chosen, problem, shape, model, key)
