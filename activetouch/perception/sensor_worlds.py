"""Possible faults of a sensor: states that a session weighs against the one that its scene describes.

Each world is the state of the sensor that the scene describes, with something changed: other forces, another stiffness,
more noise, and all of these together; an image that is blurred or shifted; hysteresis; broken taxels. A reader of any
object was trained with all of them, and reads in each.

>>> from activetouch import SCENES
>>> from activetouch.perception.imaging import imaging_of
>>> labels, states = changed_worlds(imaging_of(SCENES["gel"].scene), SensorState.nominal(1))
>>> labels[:2], len(labels) == len(states.noise)
(('noise × 1.6', 'noise × 2.5'), True)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.distributions import Bodies
from activetouch.perception.cached_arrays import announced, cached_array
from activetouch.perception.contacts.hypotheses import ContactHypotheses, cell_of
from activetouch.perception.contacts.random_views import views_of_bodies
from activetouch.perception.described_pads import possible_pads
from activetouch.perception.imaging import BROKEN, Floats32, Imaging, SensorState, sensor_state, states_with
from activetouch.perception.pressed_beliefs import PressedBeliefs, images_of
from activetouch.perception.reader import HypothesisTable, TactileReader
from activetouch.scene import Scene
from activetouch.scene_description import scene_fields
from belief.conflict import SimulatedTouches
from belief.errors import InvalidArgument
from belief.frozen import frozen
from belief.observation_model import SensorHealthModel, spread_prior
from belief.observation_model.model import ArrayModel
from belief.observation_model.rigid_body import joint_model

HYPOTHESES = 512
"""Number of hypotheses of each shape in a changed world."""
_NOISES, _STIFFNESSES, _FORCES = (1.0, 1.6, 2.5), (1.0, 0.4, 0.65, 1.5), (1.0, 0.3, 0.55, 1.3)
_ALONE = {"noise": (3.6, 6.0), "gain": (0.8, 1.2), "blur": (0.02, 0.05, 0.12, 0.25), "hysteresis": (0.04, 0.09)}
_SHIFTS = 0.035, 0.075, 0.15, 0.25  # parts of the edge of the image
_SIMULATED = 6144  # touches of a scene's bodies in all states, about
BODIES = 64
"""Random bodies, in a few views each, that stand for objects of none of the shapes."""
_UNKNOWN = 0.005  # prior probability of a described pad that is like none of those that its description allows
_SHARES = 0.012, 0.03, 0.06, 0.11, 0.2  # of all taxels


def changed_worlds(imaging: Imaging, usual: SensorState) -> tuple[tuple[str, ...], SensorState]:
    """Changed states of a sensor, within the training of its reader: in words, and arrays of as many states."""
    found: list[tuple[str, dict[str, Any]]] = []
    for stiffness, force, noise in product(_STIFFNESSES, _FORCES, _NOISES):
        factors = {"noise": noise, "stiffness": stiffness, "force": force}
        changed = {name: factor for name, factor in factors.items() if factor != 1.0}
        if changed:
            found.append((", ".join(f"{name} × {factor:g}" for name, factor in changed.items()), changed))
    for name, values in _ALONE.items():
        sign = "× " if name in ("noise", "gain") else ""
        known = [value for value in values if value <= imaging.limits[name][1]]
        found += [(f"{name} {sign}{value:g}", {name: value}) for value in known]
    around = [(rows, columns) for rows, columns in product((-1, 0, 1), repeat=2) if rows or columns]
    shifts = [part for part in _SHIFTS if part <= imaging.limits["shift"][1]]
    for part, (rows, columns) in product(shifts, around):
        found.append((f"shift ({rows * part:+g}, {columns * part:+g})", {"shift": (rows * part, columns * part)}))
    found += broken_cells()
    for name, axis, line in product(("stuck", "dead"), (0, 1), range(BROKEN)):
        cells = np.zeros((BROKEN, BROKEN))
        cells[(line, slice(None)) if axis == 0 else (slice(None), line)] = 1.0
        found.append((f"{name} {('row', 'column')[axis]} {line + 1} of {BROKEN}", {name: cells}))
    for name, share in product(("stuck", "dead"), _SHARES):
        found.append((f"{share:.1%} of the taxels {name}", {name: np.full((BROKEN, BROKEN), share)}))
    states = [with_changes(imaging, usual, changed) for _, changed in found]
    return tuple(label for label, _ in found), SensorState(*map(np.concatenate, zip(*states, strict=True)))


def broken_cells() -> list[tuple[str, dict[str, Any]]]:
    """Changes of a state by stuck or dead taxels in one cell: in words and numbers."""
    cells = zip(np.ndindex(BROKEN, BROKEN), np.eye(BROKEN**2).reshape(-1, BROKEN, BROKEN), strict=True)
    return [
        (f"{name} taxels in row {row + 1}, column {column + 1} of {BROKEN}", {name: cell})
        for name, ((row, column), cell) in product(("stuck", "dead"), cells)
    ]


def with_changes(imaging: Imaging, usual: SensorState, changed: dict[str, Any]) -> SensorState:
    """A state with changed numbers, clipped to the training of readers."""
    found, limits = usual._asdict(), imaging.limits
    for name, value in changed.items():
        before = found[name]
        if name in ("noise", "stiffness", "force", "gain"):
            new = before * value
        elif name in ("stuck", "dead"):
            new = np.maximum(before, value)
        else:
            new = before + np.asarray(value)
        found[name] = np.clip(new, *limits.get(name, (0.0, 1.0))).astype(np.float32)
    return SensorState(**found)


def listed_states(imaging: Imaging, scene: Scene) -> tuple[tuple[str, ...], SensorState]:
    """States that are weighed beside that of a scene: changed ones, or the pads that a description allows."""
    if imaging.described is None:
        return changed_worlds(imaging, sensor_state(imaging, scene))
    labels, parts = possible_pads(imaging.description)
    return labels, states_with(parts)


@dataclass(frozen=True, eq=False)
class EmbeddedWorlds:
    """Hypotheses of a scene's objects, ``number`` of each shape, embedded in changed worlds: by pose, at first use.

    ``kind`` is that of the numbers of the tables that are kept: half precision, or single, which is read faster.
    """

    reader: ContactHypotheses
    scene: Scene
    states: SensorState
    number: int = HYPOTHESES
    kind: type[np.float16 | np.float32] = np.float16

    def in_pose(self, pose: int) -> NDArray[np.float16 | np.float32]:
        """See :class:`belief.observation_model.sensor_health.EmbedsWorlds`; read-only, kept."""
        return self._embedded(pose, self.scene, pose)

    def in_place(self, place: tuple[float, ...]) -> NDArray[np.float16 | np.float32]:
        """Embedded hypotheses for a quaternion and an aim (:meth:`activetouch.session_reader.SensorReader.at`)."""
        there = self.scene.with_pose(np.array(place[:4]), np.array(place[4:]))
        return self._embedded(place, there, len(self.scene.poses))

    def _embedded(self, key: int | tuple[float, ...], scene: Scene, pose: int) -> NDArray[np.float16 | np.float32]:
        if key not in self._kept:
            found = self.reader.embedded_in(scene, self._bodies, pose, self.reader.imaging.code(self.states))
            self._kept[key] = frozen(found.astype(self.kind))
        return self._kept[key]

    @cached_property
    def _kept(self) -> dict[int | tuple[float, ...], NDArray[np.float16 | np.float32]]:
        return {}

    @cached_property
    def _bodies(self) -> Bodies:
        return self.scene.hypotheses(self.number)

    def __getstate__(self) -> dict[str, Any]:
        """The state for another process: without tables, which it reads from the cache, where they are put first."""
        for pose in range(len(self.scene.poses)):
            self.in_pose(pose)
        return {name: value for name, value in vars(self).items() if name != "_kept"}


def in_unknown_state(reader: TactileReader, scene: Scene) -> SensorHealthModel:
    """The model of a sensor in an unknown state, fitted to the objects of a scene and kept in the cache."""
    from activetouch.perception.preparation import prepared  # sensors of known objects do not need it

    with announced("preparing other states of the sensor: up to two minutes the first time, then kept in the cache"):
        model = prepared(reader, scene).with_hypotheses(HypothesisTable(reader, scene))
        return sensor_health(model, reader, scene)


def sensor_health(model: ArrayModel, reader: TactileReader, scene: Scene) -> SensorHealthModel:
    """The observation model of a sensor in an unknown state; a reader of any object embeds in other states."""
    described, hypotheses = joint_model(model), reader.hypotheses
    if described is None or not isinstance(hypotheses, ContactHypotheses):
        raise InvalidArgument("the state of a sensor is inferred with a reader of any object and its joint model")
    labels, states = listed_states(hypotheses.imaging, scene)
    prior = spread_prior(len(labels))
    if hypotheses.imaging.described is not None:
        prior = spread_prior(len(labels), (1.0 - _UNKNOWN) / (1 + len(labels)), _UNKNOWN)
    touches = simulated_touches(reader, scene, states)
    simulated = SimulatedTouches.of(touches, state_of_each(touches, states))
    worlds = EmbeddedWorlds(hypotheses, scene, states)
    return SensorHealthModel(described, worlds, labels, prior, simulated=simulated)


def state_of_each(touches: Floats32, states: SensorState) -> NDArray[np.int64]:
    """State of each of the :func:`simulated_touches`: 0 is that of the scene."""
    return np.arange(len(touches)) // (len(touches) // (1 + len(states.noise)))


def simulated_touches(
    reader: TactileReader, scene: Scene, states: SensorState, are_strangers: bool = False
) -> Floats32:
    """Embeddings of touches of a scene's bodies in its own state and W others, ``(B, D)``, from the cache or new.

    A body and a pose are drawn for each touch; all shapes and states have equally many touches. Those of strangers are
    of random bodies in place of the shapes: the views of :func:`views_of_bodies` in turn.
    """
    hypotheses = reader.hypotheses
    assert isinstance(hypotheses, ContactHypotheses), "of a reader of any object"
    imaging, poses = hypotheses.imaging, len(scene.poses)
    shapes = 1 if are_strangers else len(scene.shapes)
    every = SensorState(*map(np.concatenate, zip(sensor_state(imaging, scene), states, strict=True)))
    number = -(-_SIMULATED // (shapes * len(every.noise)))

    def make() -> Floats32:
        rng, found = np.random.default_rng(0), []
        states_of = [SensorState(*(part[state : state + 1] for part in every)) for state in range(len(every.noise))]
        if are_strangers:
            views = np.concatenate(list(views_of_bodies(imaging.window, BODIES)))
            for state, own in enumerate(states_of):
                some = np.arange(state * number, (state + 1) * number) % len(views)
                found.append(images_of(imaging, views[some], own, rng, imaging.pixels))
        else:
            pressed = PressedBeliefs(scene, imaging, scene.hypotheses(HYPOTHESES), cell_of(HYPOTHESES))
            for own, shape in product(states_of, range(shapes)):
                chosen, pose = rng.integers(HYPOTHESES, size=number), int(rng.integers(poses))
                found.append(pressed.pressed(shape, chosen, pose, own, rng, imaging.pixels))
        return reader.run(np.rint(255 * np.concatenate(found)).astype(np.uint8))[0]

    state = [(np.round(imaging.code(every), 6) + 0.0).tolist(), number, *["in turn"] * are_strangers]
    return cached_array({"reader": reader.digest, "scene": scene_fields(scene), "simulated": state}, make)
