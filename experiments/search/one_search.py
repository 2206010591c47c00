"""One search with a sensor object: what its methods ``search`` and ``session`` do."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from activetouch import TactileSensor
from activetouch.named_scenes import SCENES
from activetouch.sensor import RecordedSensor
from activetouch.session_reader import session_reader
from belief.arrangement import num_states
from belief.composition import Composition, Counts
from belief.errors import InvalidArgument
from belief.naming import Name, index_of
from belief.problem import SearchProblem
from belief.seeding import checked_key
from experiments.scene_choice import as_named
from experiments.search.play import made_for, make_world, opened, with_unsure
from planners import Decider, Episode, Session, make_decider, search
from planners.certified import Certificate, NotCertified
from planners.session_log import differences

_TOUCHES_PER_OBJECT = 12


def search_with(
    sensor: TactileSensor,
    target: Name,
    decider: str | Decider,
    seed: int | Sequence[int],
    *rules: Any,
) -> Episode:
    """Search for a target among objects of the sensor's scene; see :meth:`activetouch.TactileSensor.search`.

    ``rules`` are as of :func:`problem_of`.
    """
    problem = problem_of(sensor, *rules)
    shape, key, chosen = _played(sensor, problem, target, decider, seed)
    return search(make_world(problem, sensor, key), chosen, problem, shape, sensor.model, key)


def session_with(
    sensor: TactileSensor,
    target: Name,
    decider: str | Decider,
    seed: int | Sequence[int],
    num_objects: int | None = None,
    composition: Composition | Counts | str | None = None,
    touch_cost: float = 0.02,
    log: str | Path | None = None,
    certificate: str | Path | Certificate | None = None,
    **settings: Any,
) -> Session:
    """A session of a sensor; see :meth:`activetouch.TactileSensor.session`."""
    problem = problem_of(sensor, num_objects, composition, touch_cost)
    shape, key, chosen = _played(sensor, problem, target, decider, seed)
    if certificate is not None:
        problem = with_unsure(problem)
        chosen = _certified(sensor, problem, problem.shape_labels[shape], decider, opened(certificate))
    reader = session_reader(sensor)
    is_abstaining = settings.get("abstain")
    is_abstaining = settings.get("arrangement") is None if is_abstaining is None else is_abstaining
    is_free = certificate is None and settings.get("least_area") is None  # misses are not among what is certified
    if is_abstaining and is_free:
        settings["least_area"] = 0.0  # an image that could be one of no contact is none
    begun = Session(problem, chosen, shape, sensor.model, key, reader=reader, **settings)
    if log is None:
        return begun
    if not Path(log).exists():
        begun.save(log)
        return begun
    found = Session.load(log, model=sensor.model, decider=chosen, reader=reader)
    checked = dict.fromkeys(("arrangement", "decider", "stop_rule"))  # by load, or of no matter
    if other := differences({**found.set_up, **checked}, {**begun.set_up, **checked}):
        found.close()
        raise InvalidArgument(f"{log} is the log of another search: {'; '.join(other)}")
    return found


def _certified(
    sensor: TactileSensor, problem: SearchProblem, target: str, decider: str | Decider, certificate: Certificate
) -> Decider:
    """A decider that stops by a certificate."""
    if isinstance(sensor, RecordedSensor) or decider != certificate.decider:
        raise NotCertified(f"the certificate is for the decider {certificate.decider!r} of a sensor with a scene")
    targets = [label for label in problem.shape_labels if label in certificate.made_for["targets"]]
    if target not in targets:
        raise NotCertified(f"the certificate is for the targets {', '.join(targets)}, not {target}")
    table = sensor.model.outcome_table()
    made = make_decider(certificate.decider, table, sensor.model)
    known = {"observation model": sensor.model, "outcome table": table}
    return certificate.wrap(made, made_for(sensor, problem, targets, certificate.decider, made, known))


def problem_of(
    sensor: TactileSensor,
    num_objects: int | None = None,
    composition: Composition | Counts | str | None = None,
    touch_cost: float = 0.02,
) -> SearchProblem:
    """The rules of a search with a sensor; by default those of its named scene, or of up to four different objects.

    By default, where the exact sum over different objects is too large, they are independent, with a warning.
    """
    if isinstance(sensor, RecordedSensor):
        usual, per_object = min(4, len(sensor.shape_labels)), _TOUCHES_PER_OBJECT
        among: Composition | Counts = Composition.DISTINCT
    else:
        scene, hand = sensor.scene, sensor.scene.hand
        known = [some for some in SCENES.values() if scene in (some.scene, hand and some.scene.with_hand(hand))]
        named = known[0] if known else as_named(scene)
        usual, among, per_object = named.num_objects, named.composition, named.touches_per_object
    if isinstance(composition, Counts):
        usual = min(usual, composition.total)
    number = usual if num_objects is None else num_objects
    problem = SearchProblem(
        sensor.shape_labels,
        sensor.pose_labels,
        number,
        Composition(composition) if isinstance(composition, str) else composition or among,
        touch_cost,
        touch_limit=per_object * number,
    )
    try:
        if composition is None and problem.counts is not None:
            num_states(problem.counts, number)
    except InvalidArgument as error:
        warnings.warn(f"the objects are taken to be independent, so that two may be alike: {error}", stacklevel=4)
        problem = replace(problem, composition=Composition.INDEPENDENT)
    return problem


def _played(
    sensor: TactileSensor, problem: SearchProblem, target: Name, decider: str | Decider, seed: int | Sequence[int]
) -> tuple[int, tuple[int, ...], Decider]:
    """Index of the target, key of the search, and the decider."""
    shape, model = index_of("target", problem.shape_labels, target), sensor.model
    words = checked_key(seed)
    key = (*words, shape, 0) if len(words) == 1 else words
    return shape, key, make_decider(decider, model.outcome_table(), model) if isinstance(decider, str) else decider
