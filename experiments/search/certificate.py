"""What a certificate of stops holds for, and deciders that stop by one."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from activetouch import TactileSensor
from activetouch.scene_description import scene_fields
from belief.problem import SearchProblem
from experiments.search.fingerprint import digest_of, fingerprint
from experiments.search.play import sensor_digest
from planners import Decider
from planners.certified import Certificate


def made_for(
    sensor: TactileSensor,
    problem: SearchProblem,
    targets: Sequence[str],
    name: str,
    decider: Decider,
    known: Mapping[str, object],
) -> dict[str, Any]:
    """What a certificate holds for, as JSON types.

    ``known`` are objects by name that deciders hold and that the sensor determines.
    """
    targets = [label for label in problem.shape_labels if label in targets]
    deciders = [fingerprint(decider, target, known) for target in targets]
    world = {
        "scene": scene_fields(sensor.scene),
        "objects and rules": repr(problem),
        "targets": targets,
        "decider": name,
        "settings, code or policies of the decider": digest_of(deciders),
        "sensor (SHA-256)": sensor_digest(sensor),
    }
    return json.loads(json.dumps(world))


def with_unsure(problem: SearchProblem) -> SearchProblem:
    """The rules of a search that stops by a certificate."""
    return problem if problem.unsure_reward is not None else replace(problem, unsure_reward=0.0)


def opened(certificate: str | Path | Certificate) -> Certificate:
    """A certificate, or that of a file; raises as :meth:`planners.certified.Certificate.load`."""
    return certificate if isinstance(certificate, Certificate) else Certificate.load(certificate)


def certified(
    certificate: Certificate,
    decider: Decider,
    sensor: TactileSensor,
    problem: SearchProblem,
    targets: Sequence[str],
    known: Mapping[str, object],
) -> Decider:
    """A decider that stops by a certificate; arguments as of :func:`made_for`.

    Raises:
        NotCertified: the certificate was made for something else.
    """
    name = certificate.decider
    return certificate.wrap(decider, made_for(sensor, problem, targets, name, decider, known))
