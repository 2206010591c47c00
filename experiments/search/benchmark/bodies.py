"""The scene of the task with a hundred meshes: random bodies that no training knows, made by their numbers."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

from activetouch.distributions import Constant
from activetouch.errors import BadMesh, MeshWarning
from activetouch.named_scenes import SCENES, NamedScene
from activetouch.perception.contacts.bodies import random_body
from activetouch.solids.mesh import Mesh
from belief.composition import Composition

_FIRST = 62_000_000  # neither of training nor of the strangers in searches


def hundred(number: int = 100, scene: str = "gel") -> NamedScene:
    """Searches among four of as many random bodies, of which at most one is the target, with the pad of a scene."""
    named = SCENES[scene]
    shapes = {f"body_{index:03d}": body for index, body in enumerate(itertools.islice(_bodies(), number))}
    variation = replace(named.scene.variation, size=Constant(1.0))
    scene_of = replace(named.scene, shapes=shapes, variation=variation)
    return NamedScene(scene_of, num_objects=4, composition=Composition.AT_MOST_ONE)


def _bodies() -> Iterator[Mesh]:
    for index in itertools.count(_FIRST):
        surface = random_body(index)
        with suppress(BadMesh), warnings.catch_warnings():
            warnings.simplefilter("ignore", MeshWarning)
            yield Mesh(f"random body {index}", surface.vertices.T, surface.faces.T)
