"""When the description of a sensor is doubted, and what may be the matter with it.

After every touch, two things are asked about what was felt, beside the conflict test of the model. First, how well some
twenty coarse alternatives to the described state explain it, with the reader of any object and few hypotheses. Second,
where a shape is probable, whether presses of what is believed look like it
(:mod:`activetouch.perception.pressed_beliefs`).

In doubt, the listed states of the sensor are weighed; what is then believed is pressed in the likeliest of them. If
that does not look like what was felt, changes of this state are composed, one at a time, as long as each explains the
touches better than a penalty costs. The pads that a description allows are weighed from the first touch, and nothing is
composed.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from activetouch.perception.card import read_card
from activetouch.perception.contacts.hypotheses import cell_of
from activetouch.perception.contacts.random_views import VIEWS, log_normalisers, random_views
from activetouch.perception.imaging import BROKEN, Floats32, Imaging, SensorState, regridded, sensor_state
from activetouch.perception.pressed_beliefs import DRAWN, PressedBeliefs, Residuals, compared, oddness
from activetouch.perception.proportions import OtherProportions, ReadsAnyObject
from activetouch.perception.sensor_worlds import (
    BODIES,
    EmbeddedWorlds,
    broken_cells,
    in_unknown_state,
    listed_states,
    simulated_touches,
    state_of_each,
    with_changes,
)
from activetouch.poses import turned
from activetouch.pressing.height_maps import predicted_contacts
from activetouch.scene import Scene
from belief.conflict import SimulatedTouches
from belief.observation_model.doubted_sensor import DoubtedEvidence, DoubtedSensorModel, Explanation
from belief.observation_model.embedded_hypotheses import scaled
from belief.observation_model.evidence import ObjectEvidence
from belief.observation_model.model import ArrayModel
from belief.observation_model.repeat_discount import repeat_shares
from belief.observation_model.rigid_body import RigidBodyModel, joint_model
from belief.observation_model.rigid_body_evidence import joint_evidence
from belief.observation_model.sensor_health import SensorEvidence, SensorHealthModel
from belief.observation_model.sensor_worlds import SensorHealth, spread_prior
from belief.observation_model.varied_bodies import SHARE, VariedBodyModel, VariedEvidence
from belief.problem import Touch
from belief.validation import Floats

_FEW = 64
"""Hypotheses of each shape, where many states are asked."""
_SOFTER = 1.0  # temperature of few hypotheses, which is above that of many
_DOUBTED = math.log(0.13 / 0.87)  # log odds of other states from which the described one is doubted
_LEAST_FACTOR, _MOST_FACTOR = -0.7, 6.0  # of the log Bayes factor of a discrepancy
_SUSPICION = math.log(3.5)  # of the conflict test
_COARSE = (
    {"noise": 1.6},
    {"noise": 2.5},
    {"noise": 6.0},
    {"force": 0.3},
    {"force": 0.55},
    {"force": 1.3},
    {"stiffness": 0.4},
    {"stiffness": 0.65},
    {"stiffness": 1.5},
    {"stiffness": 0.4, "force": 0.3},
    {"blur": 0.05},
    {"blur": 0.12},
    {"blur": 0.25},
    {"hysteresis": 0.09},
    {"stuck": 0.06},
    {"dead": 0.11},
    {"dead": 0.2},
    {"shift": (-0.25, 0.0)},
    {"shift": (0.25, 0.0)},
    {"shift": (0.0, -0.25)},
    {"shift": (0.0, 0.25)},
)
"""Changes of the described state that are asked about after every touch; those beyond a reader are limited."""
_NOMINAL = 0.9  # prior probability of the described state
_USUAL, _WIDTH, _STRANGE, _WIDE = -0.4, 1.5, 2.5, 2.5  # normal densities of discrepancies: usual ones, and others
_NAMED = 0.8  # probability of a shape, for one object alone, from which it is pressed as it is believed to be
_PENALTY = 6.0  # log ratio by which a further change must explain the touches better: there are some 70
_FULL = 0.9  # reading of a cell that may be stuck, relative to full scale
_MOST_CHANGES = 3
_BLANK = 12.0  # log Bayes factor that a sensor tells nothing, where its taxels all read the same: noise makes that rare
_UNEXPLAINED = 2.0  # log Bayes factor from which changes are composed


class _Believed(NamedTuple):
    """Log weights of hypotheses about an object: of nominal proportions ``(K, N)`` and of others ``(V, N')``, or None.

    Both are up to the same constant.
    """

    nominal: Floats
    varied: Floats | None = None


class _Composed(NamedTuple):
    """States that explain the touches better and better."""

    model: SensorHealthModel
    states: SensorState


@dataclass(frozen=True, eq=False)
class SensorDoubts(ReadsAnyObject):
    """Doubts of the sensor of a scene; see :class:`belief.observation_model.doubted_sensor.Doubts`.

    Attributes:
        varied: hypotheses of other proportions, where objects may have them: a reason for odd touches that is no doubt.
    """

    varied: OtherProportions | None = None

    @cached_property
    def imaging(self) -> Imaging:
        """Of the sensor."""
        fields = read_card(self.path).imaging
        assert fields is not None, "a reader of any object"
        return Imaging.from_fields(fields)

    @property
    def _is_of_pad(self) -> bool:
        """Whether a file describes the pad: then the states are all that it allows, and are weighed from the start."""
        return self.imaging.described is not None

    @cached_property
    def described(self) -> SensorState:
        """The state that the scene describes."""
        return sensor_state(self.imaging, self.scene)

    @cached_property
    def _listed(self) -> tuple[tuple[str, ...], SensorState]:
        labels, states = listed_states(self.imaging, self.scene)
        return labels, _joined(self.described, states)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the states beside the described one."""
        return self._listed[0]

    def read_again(self, touch: Touch) -> Touch:
        """See :class:`belief.observation_model.doubted_sensor.Doubts`."""
        assert touch.image is not None, "asked before"
        return Touch(touch.pose, features=self.reader.run(touch.image[None])[0][0], image=touch.image)

    def states(self) -> SensorHealthModel:
        """See :class:`belief.observation_model.doubted_sensor.Doubts`."""
        return self._states

    @cached_property
    def _states(self) -> SensorHealthModel:
        found = in_unknown_state(self.reader, self.scene)
        if self.varied is None or not isinstance(found.nominal, RigidBodyModel):
            return found
        return replace(found, nominal=VariedBodyModel(found.nominal, self.varied))

    def are_odd(self, objects: Sequence[DoubtedEvidence], log_conflict: float) -> bool:
        """See :class:`belief.observation_model.doubted_sensor.Doubts`."""
        if log_conflict >= _SUSPICION or _are_blank(objects):
            return True
        log_probs = np.log([_NOMINAL, *[(1.0 - _NOMINAL) / len(_COARSE)] * len(_COARSE)])
        log_probs = log_probs + sum(map(self._coarsely, objects))
        log_odds = float(np.logaddexp.reduce(log_probs[1:]) - log_probs[0]) + max(log_conflict, 0.0)
        if log_odds + _LEAST_FACTOR >= _DOUBTED:
            return True
        if log_odds + _MOST_FACTOR < _DOUBTED:
            return False
        likely = [one.nominal.log_likelihood for one in objects]
        weights = [_believed(one.nominal) for one in objects]
        odd = self._oddness(objects, likely, weights, self.described, "described")
        factor = 0.0 if odd is None else min(max(_log_factor(odd), _LEAST_FACTOR), _MOST_FACTOR)
        return log_odds + factor >= _DOUBTED

    def _coarsely(self, one: DoubtedEvidence) -> Floats:
        """Log evidence of an object in the described state and each of the coarse alternatives."""
        if "coarsely" not in one.kept:
            found = np.logaddexp.reduce(self._summed(one, "coarsely", self._alternatives.in_pose), axis=(1, 2))
            if (varied := self.varied) is not None:
                others = self._summed(one, "others", lambda pose: varied.embedded(pose)[0])
                others = np.logaddexp.reduce(others, axis=None)
                shares = np.log1p(-SHARE), math.log(SHARE * _FEW / varied.number)
                found[0] = np.logaddexp(shares[0] + found[0], shares[1] + others)
            one.kept["coarsely"] = found
        return np.asarray(one.kept["coarsely"])

    @staticmethod
    def _summed(one: DoubtedEvidence, name: str, in_pose: Callable[[int], NDArray[np.floating]]) -> Floats:
        """Log ratios of all touches of an object under hypotheses that are embedded in a pose, ``(..., D)``."""
        number, scores = one.sums.get(name, (0, np.zeros((1, 1, 1))))
        for touch in one.again[number:]:
            scores = scores + in_pose(int(touch.pose)) @ _features(touch)
        one.sums[name] = len(one.again), scores
        return np.asarray(scores / _SOFTER)

    @cached_property
    def _alternatives(self) -> EmbeddedWorlds:
        changed = [with_changes(self.imaging, self.described, change) for change in _COARSE]
        states = _joined(self.described, *changed)
        return EmbeddedWorlds(self._hypotheses, self.scene, states, _FEW, np.float32)  # asked after every touch

    def _oddness(
        self,
        objects: Sequence[DoubtedEvidence],
        likely: Sequence[Floats],
        believed: Sequence[_Believed],
        state: SensorState,
        name: str,
    ) -> float | None:
        """Discrepancy of the images of all objects that may be named from presses of what is believed, in a state.

        None where no object may be named.
        """
        found = []
        for one, probs, weights in zip(objects, likely, believed, strict=True):
            shape = int(probs.argmax())
            if probs[shape] - np.logaddexp.reduce(probs) < math.log(_NAMED):
                continue
            key = "pressed", name, shape
            if key not in one.kept:
                one.kept[key] = self._residuals(one.touches, shape, weights, state)
            found.append(one.kept[key])
        return oddness(found) if found else None

    def _residuals(self, touches: Sequence[Touch], shape: int, believed: _Believed, state: SensorState) -> Residuals:
        """Of presses of bodies drawn from the belief about a shape, of nominal and of other proportions."""
        log_weights, rng = believed.nominal[shape], np.random.default_rng(list(_digest(touches)))
        number, other = len(log_weights), -1
        if believed.varied is not None and self.varied is not None and shape in self.varied.shapes:
            other = int(np.searchsorted(self.varied.shapes, shape))
            varied = believed.varied[other]
            log_weights = log_weights + (math.log1p(-SHARE) - math.log(number))
            log_weights = np.concatenate([log_weights, varied + (math.log(SHARE) - math.log(len(varied)))])
        shares = np.exp(log_weights - log_weights.max())
        chosen = rng.choice(len(shares), DRAWN, p=shares / shares.sum())
        parts = [(self._pressed(self.scene, number), shape, chosen[chosen < number])]
        if self.varied is not None:
            parts.append(
                (self._pressed(self.varied.bodies, self.varied.number), other, chosen[chosen >= number] - number)
            )
        images = compared(np.stack([touch.image for touch in touches if touch.image is not None]))
        drawn = []
        for touch in touches:
            each = [some.pressed(which, rows, int(touch.pose), state, rng) for some, which, rows in parts if len(rows)]
            drawn.append(np.concatenate(each))
        return Residuals.of(images, drawn)

    def _pressed(self, scene: Scene, number: int) -> PressedBeliefs:
        """Presses so many hypotheses of each shape of a scene: the own one, or that of other proportions."""
        key = scene is self.scene, number
        if key not in self._kept:
            self._kept[key] = PressedBeliefs(scene, self.imaging, scene.hypotheses(number), cell_of(number))
        return self._kept[key]

    @cached_property
    def _kept(self) -> dict[tuple[bool, int], PressedBeliefs]:
        return {}

    def explained(
        self, objects: Sequence[DoubtedEvidence], log_likelihoods: Floats, health: SensorHealth
    ) -> Explanation:
        """See :class:`belief.observation_model.doubted_sensor.Doubts`."""
        if _are_blank(objects):
            return Explanation(log_likelihoods, str(health), _BLANK)
        inferred = [one.inferred for one in objects]
        found = self._checked(objects, inferred, log_likelihoods, health, self._listed[1])
        if found.log_unexplained < _UNEXPLAINED or self._is_of_pad:
            return found
        for composed in self._composed(objects, int(health.probs[:-1].argmax())):
            evidence = [self._in_composed(one, composed.model) for one in objects]
            likely, health = composed.model.over_objects(evidence, 0.0)
            other = self._checked(objects, evidence, likely, health, composed.states)
            found = other if other.log_unexplained < found.log_unexplained else found
        return found

    def log_stranger(self, one: DoubtedEvidence) -> float:
        """See :class:`belief.observation_model.doubted_sensor.Doubts`: of random bodies and of few hypotheses."""
        number, total = one.sums.get("stranger", (0, np.zeros(1)))
        for touch in one.again[number:]:
            total = total + log_normalisers(self._described_bodies, _features(touch)[None], 1.0 / _SOFTER)
        one.sums["stranger"] = len(one.again), total
        return float(total[0] - self._coarsely(one)[0]) + math.log(_FEW * len(self.scene.shape_labels))

    def log_strangers(self, one: DoubtedEvidence) -> Floats:
        """See :class:`belief.observation_model.doubted_sensor.Doubts`: a random body in every touch."""
        body, alone = joint_model(one.model.states), joint_evidence(one.inferred.nominal)
        assert body is not None, "of a rigid body"
        assert alone is not None, "of a rigid body"
        any_body = self._any_body(one.model.states.simulated)
        number, felt = one.sums.get("strangers", (0, np.zeros((0, len(self._random) + 1))))
        for touch in one.again[number:]:
            embedding = body.embedding_of(touch)
            scores = self._random @ scaled(embedding, body.temperature)[0].astype(np.float32)
            some = logsumexp(scores, axis=1) - math.log(scores.shape[1])
            felt = np.vstack([felt, np.append(some, any_body.e_value(embedding[0]))])
        one.sums["strangers"] = len(one.again), felt
        poses = np.array([[int(touch.pose) for touch in one.again]])
        found = repeat_shares(poses, body.correlation, body.drift)[0] @ felt[:, :-1] - alone.constant
        return np.append(found, math.log(felt[:, -1].mean()))

    def _any_body(self, of_shapes: SimulatedTouches | None) -> SimulatedTouches:
        """Touches of the shapes and of random bodies in all states."""
        if "any" not in self._simulated:
            others = SensorState(*(part[1:] for part in self._listed[1]))
            strange = simulated_touches(self.reader, self.scene, others, are_strangers=True)
            bodies, every, states = np.arange(len(strange)) // VIEWS % BODIES, strange, state_of_each(strange, others)
            if of_shapes is not None:
                every = np.concatenate([strange, of_shapes.embeddings])
                bodies = np.append(bodies, BODIES + np.arange(len(of_shapes.embeddings)))
                states = np.append(states, of_shapes.states)
            self._simulated["any"] = SimulatedTouches.of(every, states, bodies)
        return self._simulated["any"]

    @cached_property
    def _simulated(self) -> dict[str, SimulatedTouches]:
        return {}

    @cached_property
    def _described_bodies(self) -> Floats32:
        """Embedded views of random bodies in the described state, ``(B, D)``: before any doubt no others are asked."""
        return random_views(self._hypotheses, self.imaging.code(self.described), BODIES)[0]

    @cached_property
    def _random(self) -> Floats32:
        """Embedded views of random bodies in the described state and the listed ones, ``(1 + W, B, D)``."""
        return random_views(self._hypotheses, self.imaging.code(self._listed[1]), BODIES)

    def _checked(
        self,
        objects: Sequence[DoubtedEvidence],
        inferred: Sequence[SensorEvidence],
        likely: Floats,
        health: SensorHealth,
        states: SensorState,
    ) -> Explanation:
        """What states say, and whether the likeliest one explains the images."""
        best = int(health.probs[:-1].argmax())
        weights = [_Believed(one.log_weights[best - 1]) if best else _believed(one.nominal) for one in inferred]
        odd = self._oddness(objects, list(likely), weights, _row(states, best), health.labels[best])
        return Explanation(likely, str(health), 0.0 if odd is None else _log_factor(odd))

    def _in_composed(self, one: DoubtedEvidence, model: SensorHealthModel) -> SensorEvidence:
        key = model.world_labels
        if key not in one.kept:
            one.kept[key] = model.start().updated(one.again)
        found: SensorEvidence = one.kept[key]
        return found

    def _composed(self, objects: Sequence[DoubtedEvidence], start: int) -> list[_Composed]:
        """States that explain the touches better and better, by further changes of a listed state.

        They are found with the first 2, 4, 8, … touches. Another ascent begins with all cells that were at full scale
        in every one of these touches stuck.
        """
        number = sum(len(one.touches) for one in objects)
        left, felt, again = 1 << (number.bit_length() - 1), list[Touch](), list[tuple[Touch, ...]]()
        for one in objects:
            if left > 0:
                felt += one.touches[:left]
                again.append(one.again[:left])
                left -= len(one.touches)
        key = start, _digest(felt)
        if key not in self._known:
            label = ("as described", *self.labels)[start]
            starts = [(label, _row(self._listed[1], start))]
            high = np.min([_cells(touch) for touch in felt], axis=0) > _FULL
            if high.any():
                state = with_changes(self.imaging, self.described, {"stuck": high.astype(float)})
                where = "; ".join(f"row {row + 1}, column {column + 1}" for row, column in np.argwhere(high))
                starts.append((f"stuck taxels in {where} of {BROKEN}", state))
            climbed = [self._climbed(again, *one, len(starts) > 1) for one in starts]
            self._known[key] = [one for one in climbed if one is not None]
        return self._known[key]

    @cached_property
    def _known(self) -> dict[Any, list[_Composed]]:
        return {}

    def _climbed(
        self, touches: Sequence[Sequence[Touch]], label: str, start: SensorState, is_new: bool
    ) -> _Composed | None:
        """Greedy ascent from a state, one change at a time; None if none is worth its penalty and the start is old."""
        maps = {pose: self._maps(pose) for pose in sorted({int(touch.pose) for some in touches for touch in some})}
        names, path, changes = [label], [start], _changes()
        [log_evidence] = self._explain(touches, maps, start).tolist()
        while len(path) <= _MOST_CHANGES:
            states = [with_changes(self.imaging, path[-1], change) for _, change in changes]
            reached = self._explain(touches, maps, _joined(*states)) - _PENALTY
            best = int(reached.argmax())
            if reached[best] <= log_evidence:
                break
            log_evidence = float(reached[best])
            names.append(f"{names[-1]} + {changes[best][0]}")
            path.append(states[best])
        if len(path) == 1 and not is_new:
            return None
        if label == "as described":  # which is the nominal component
            names, path = [name.removeprefix(f"{label} + ") for name in names[1:]], path[1:]
        if not path:
            return None
        worlds = EmbeddedWorlds(self._hypotheses, self.scene, _joined(*path))
        known = self.states()
        prior = spread_prior(len(names))
        model = SensorHealthModel(known.nominal, worlds, tuple(names), prior, simulated=known.simulated)
        return _Composed(model, _joined(self.described, *path))

    def _maps(self, pose: int) -> Floats32:
        """Predicted contacts of few hypotheses of each shape in a pose, ``(K * H, n, n)``."""
        bodies, scene = self.scene.hypotheses(_FEW), self.scene
        turns = turned(scene.rotations[scene.pose_labels[pose]], bodies.rests)
        found = []
        for label in scene.shape_labels:
            solids, members = scene.bodies(label, bodies.shares)
            for hypothesis, member in enumerate(members):
                rows = slice(hypothesis, hypothesis + 1)
                window, aim = self.imaging.wide_window, scene.aim_offsets[pose]
                solid, sizes = solids[member], bodies.sizes[rows]
                found.append(predicted_contacts(solid, turns[rows], aim, window, sizes, np.float32))
        return np.concatenate(found)

    def _explain(
        self, touches: Sequence[Sequence[Touch]], maps: dict[int, Floats32], states: SensorState
    ) -> NDArray[np.float64]:
        """Log evidence of the touches of some objects in W states, ``(W,)``."""
        codes, cell = self.imaging.code(states), cell_of(_FEW)
        embedded = {pose: self._hypotheses.embed(some, cell, codes) for pose, some in maps.items()}
        total = np.zeros(len(codes))
        for some in touches:
            scores = np.zeros((len(codes), 1))
            for touch in some:
                scores = scores + embedded[int(touch.pose)] @ _features(touch)
            total += np.logaddexp.reduce(scores / _SOFTER, axis=1)
        return total


def doubted(model: ArrayModel, path: Path, scene: Scene) -> ArrayModel:
    """The model of a sensor that doubts its description with the reader of any object in a file.

    A model of other kinds than that of one rigid body, also in an unknown state, is returned as it is.
    """
    if not isinstance(model, RigidBodyModel | VariedBodyModel | SensorHealthModel):
        return model
    varied = model.varied if isinstance(model, VariedBodyModel) else None
    return DoubtedSensorModel(
        model, SensorDoubts(path, scene, varied if isinstance(varied, OtherProportions) else None)
    )


def _are_blank(objects: Sequence[DoubtedEvidence]) -> bool:
    """Whether in every touch, all taxels read the same."""
    images = [touch.image for one in objects for touch in one.touches]
    return bool(images) and all(image is not None and np.ptp(image) == 0 for image in images)


def _believed(evidence: ObjectEvidence) -> _Believed:
    """What evidence about a body says of its hypotheses, if the sensor is as described."""
    joint = joint_evidence(evidence)
    assert joint is not None, "of a rigid body"
    varied = evidence.log_weights if isinstance(evidence, VariedEvidence) else None
    return _Believed(joint.log_weights, None if varied is None else varied - joint.constant)


def _log_factor(odd: float) -> float:
    """Log Bayes factor of "this is no such press" of a discrepancy; increasing."""
    usual, strange = max(odd - _USUAL, 0.0) / _WIDTH, min(odd - _STRANGE, 0.0) / _WIDE
    return float((usual**2 - strange**2) / 2.0 + math.log(_WIDTH / _WIDE))


def _changes() -> list[tuple[str, dict[str, Any]]]:
    """Single changes of a state, in words and numbers."""
    factors = [("noise", (2.0, 1.5, 0.67)), ("stiffness", (1.5, 0.67)), ("force", (1.5, 0.67)), ("gain", (1.15, 0.87))]
    found: list[tuple[str, dict[str, Any]]] = [
        (f"{name} × {factor:g}", {name: factor}) for name, values in factors for factor in values
    ]
    found += [("blur 0.05", {"blur": 0.05}), ("hysteresis 0.04", {"hysteresis": 0.04})]
    for rows, columns in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        found.append((f"shift ({0.1 * rows:+g}, {0.1 * columns:+g})", {"shift": (0.1 * rows, 0.1 * columns)}))
    return found + broken_cells()


def _digest(touches: Sequence[Touch]) -> bytes:
    """A digest of the poses and images of touches."""
    found = hashlib.sha256()
    for touch in touches:
        found.update(bytes([int(touch.pose) % 256]))
        found.update(b"" if touch.image is None else touch.image.tobytes())
    return found.digest()


def _joined(*states: SensorState) -> SensorState:
    return SensorState(*map(np.concatenate, zip(*states, strict=True)))


def _features(touch: Touch) -> NDArray[np.float32]:
    """The embedding that a touch brings, ``(D,)``."""
    assert touch.features is not None, "of a reader of any object"
    return np.asarray(touch.features, np.float32)


def _cells(touch: Touch) -> Floats32:
    """Mean reading of the taxels in each cell of an image, ``(BROKEN, BROKEN)`` in [0, 1]."""
    assert touch.image is not None, "asked before"
    return regridded(touch.image[None].astype(np.float32) / 255.0, BROKEN)[0]


def _row(states: SensorState, index: int) -> SensorState:
    return SensorState(*(part[index : index + 1] for part in states))
