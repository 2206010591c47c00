"""Live searches: the arguments that describe them, what determines them, how they are played, repeated and certified.

The seed alone determines the objects of an episode.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import astuple, dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import tyro
from numpy.typing import NDArray

from activetouch import Scene, TactileSensor, TouchWorld
from activetouch.named_scenes import NamedScene
from activetouch.poses import Placement, WorldObject
from activetouch.pressing.contact import PressedObject
from activetouch.scene_description import scene_fields
from activetouch.sensor_files import ANY_OBJECT_FILE, observation_file, other_reader, reader_file
from activetouch.world import TouchTime, touch_many
from belief.codec import from_fields, to_fields
from belief.composition import Composition
from belief.constraints import Fraction, NotNegative, Probability
from belief.errors import CorruptFile, InvalidArgument
from belief.naming import NONE_OF_THESE, UNLISTED
from belief.observation_model.model import ObservationModel
from belief.observation_model.rigid_body_evidence import innermost
from belief.problem import Action, Confirm, Probe, Reject, SearchProblem, Touch
from belief.scene_belief import SceneBelief
from belief.seeding import touch_rng
from experiments.command_line.arguments import BadArgument, Count, Trust, check_arguments
from experiments.scene_choice import SceneChoice
from experiments.sensor_choice import asked_state, open_sensor, sensor_folder
from planners import Decider, Decision, Episode, InformationState, Outcome, Step, search_lockstep
from planners.episode import ACTION_NAMES
from planners.fingerprint import digest_of, fingerprint, versions
from planners.probing import HYPOTHESES, OUTCOMES
from planners.search import TouchRequest

CompositionName: TypeAlias = Literal["distinct", "independent", "at_most_one"]
"""Name of a :class:`belief.Composition`."""
FULL_INFORMATION = "full information"
"""Name of :class:`FullInformation` in reports."""
_MOST_SHAPES = 12  # in a picture of a belief


@dataclass(frozen=True)
class Setting:
    """Sensor and rules of all searches."""

    choice: tyro.conf.OmitArgPrefixes[SceneChoice] = field(default_factory=SceneChoice)
    """The scene."""
    sensor: Path | None = None
    """Folder of a sensor, or name of a shipped one; that of the scene by default, or one that reads any --pad."""
    num_objects: Count | None = None
    """Objects in a search; that of the scene by default."""
    composition: CompositionName | None = None
    """distinct: all objects differ. independent: each can have any shape. at_most_one: one has the target's shape, or
    none, each place as probable as none; for many shapes. That of the scene by default."""
    observation_model: Literal["independent", "nested"] | None = None
    """independent: touches of an object are independent given its shape, not of one rigid body. nested: orientations
    are weighed coarse to fine, for hundreds of meshes; the default where a table of them all would be too large."""
    unknown_state: bool = False
    """Infer from the touches what is the matter with the sensor: forces, stiffness, noise, broken taxels, a shifted
    image. Needs a reader of any object."""
    doubted_state: bool = False
    """The same, but only where touches are odd for the sensor as described. Needs both readers."""
    other_proportions: bool = False
    """Built-in solids may have other proportions than those of the scene, from half to double, with a probability of
    0.04. Needs both readers."""
    touch_cost: NotNegative = 0.02
    """Cost λ of one touch, in units of a success."""
    unlisted: Probability = 0.0
    """Probability that an object has none of the shapes, such as 0.05: simulated ones are of random bodies."""
    prior: str | None = None
    """Probabilities of shapes before the first touch, whatever the objects are: mug=.7,bowl=.3, or a CSV file with
    columns object, shape and prob. They count less than touches. Where all objects differ, give a file."""
    abstain: Fraction | None = None
    """False-alarm rate of the conflict test, such as 0.02: deciders can answer "I do not know"."""
    anyway: bool = False
    """Accept a sensor that was made for another scene; the report lists the differences."""

    def to_dict(self) -> dict[str, Any]:
        """The setting as plain values."""
        return to_fields(self)

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any] | None, trust: Trust) -> Setting:
        """The setting from :meth:`to_dict`, in a file."""
        if fields is None:
            raise CorruptFile(
                f"{trust.source} has searches with a scene or a sensor that a program made; only that program can "
                "continue or replay them"
            )
        try:
            choice = SceneChoice.from_dict(fields["choice"], trust)
            found = from_fields(cls, {**fields, "choice": choice})
        except (TypeError, KeyError, AttributeError, InvalidArgument) as error:
            raise CorruptFile(f"{trust.source} does not describe a search: {error}") from error
        check_arguments(found)
        return found

    @property
    def scene(self) -> Scene:
        """The scene of the searches."""
        return self.choice.named.scene

    @property
    def sensor_folder(self) -> Path:
        """Folder of the sensor."""
        return sensor_folder(self.sensor, self.choice.scene, self.choice.pad)

    def sensor_files(self, scene: Scene) -> list[Path]:
        """The files that determine what the sensor reads in a scene; for a reader of any object, its file alone."""
        independent, nested = (self.observation_model == name for name in ("independent", "nested"))
        reader = reader_file(self.sensor_folder, scene, independent, self.unknown_state or nested)
        if reader.name == ANY_OBJECT_FILE:
            return [reader]
        asks_other = self.other_proportions or self.doubted_state
        other = other_reader(self.sensor_folder, reader, scene, independent) if asks_other else None
        return [reader, observation_file(self.sensor_folder, independent), *([] if other is None else [other])]

    def open_sensor(self, named: NamedScene | None = None, jobs: int | None = None) -> TactileSensor:
        """The sensor, after a check that it fits the scene, or ``named`` in place of the setting's scene."""
        scene = self.choice if named is None else named
        model = self.observation_model
        nested = True if model == "nested" else None
        unknown = asked_state(self.unknown_state, self.doubted_state)
        varied, independent = self.other_proportions, model == "independent"
        return open_sensor(self.sensor, scene, self.anyway, independent, unknown, jobs, nested, varied)

    @property
    def problem(self) -> SearchProblem:
        """The rules of the search; raises as :meth:`problem_in`."""
        return self.problem_in(self.choice.named)

    def problem_in(self, named: NamedScene) -> SearchProblem:
        """The rules of the search in a scene."""
        number = named.num_objects if self.num_objects is None else self.num_objects
        shapes = named.scene.shape_labels
        composition = named.composition if self.composition is None else Composition(self.composition)
        opinion: Any = None
        if self.prior is not None:
            from belief.opinion import read_opinion

            opinion = read_opinion(self.prior, shapes, number)
        if self.num_objects is not None and number > len(shapes) and composition == Composition.DISTINCT:
            raise BadArgument(
                f"--num-objects {number}: the scene has only {len(shapes)} shapes ({', '.join(shapes)}), and all "
                "objects must differ; --composition independent allows several of one shape"
            )
        try:
            return SearchProblem(
                shapes,
                named.scene.pose_labels,
                num_objects=number,
                composition=composition,
                touch_cost=self.touch_cost,
                touch_limit=named.touches_per_object * number,
                unsure_reward=None if self.abstain is None else 0.0,
                unlisted=self.unlisted,
                opinion=opinion,
            )
        except ValueError as error:
            raise BadArgument(str(error)) from error


EPISODES_PER_BATCH = 25
"""Fixed, because the last bits of the network's output depend on which images are read together."""
Seed: TypeAlias = tuple[int, ...]


@dataclass(frozen=True)
class Seconds:
    """Seconds that a set of episodes took, by part; its number of touches, and of presses repeated until settled."""

    physics: float = 0.0
    network: float = 0.0
    decision: float = 0.0
    num_touches: int = 0
    pressed_again: int = 0

    def __add__(self, other: Seconds) -> Seconds:
        """Sum of two sets of episodes."""
        return Seconds(*(mine + theirs for mine, theirs in zip(astuple(self), astuple(other), strict=True)))

    def ms_per_touch(self) -> dict[str, float]:
        """Milliseconds per touch by part; zero without touches."""
        per = 1e3 / self.num_touches if self.num_touches else 0.0
        return {"physics": self.physics * per, "network": self.network * per, "decision": self.decision * per}


@dataclass(frozen=True, eq=False)
class Searches:
    """Everything that determines the searches of a comparison, apart from the decider; the sensor has the scene."""

    sensor: TactileSensor
    problem: SearchProblem
    seed: int
    scene_name: str
    sensor_sha256: str

    @cached_property
    def identity(self) -> dict[str, Any]:
        """These fields as JSON types, which are the same for all searches of one folder."""
        rules = identity_of(self.sensor.scene, self.problem, self.seed)
        return rules | {"sensor_sha256": self.sensor_sha256}

    @cached_property
    def code(self) -> str:
        """Digest of the code of the scene, of the observation model and of the search itself."""
        return digest_of([fingerprint(part) for part in (self.sensor.scene, type(self.sensor.model), play_episodes)])


def identity_of(scene: Scene, problem: SearchProblem, seed: int) -> dict[str, Any]:
    """All that determines searches apart from the sensor, as JSON types."""
    return {"seed": seed, "problem": repr(problem), "scene": scene_fields(scene), "versions": versions()}


@dataclass(frozen=True)
class FullInformation:
    """What could be reached: touches every object once in every pose, and then gives the most probable answer.

    No decider that touches no pose of an object again has a higher expected success with the same sensor.
    """

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.Decider`."""
        number = len(info.history)
        return Decision(Probe(number) if number < info.problem.num_poses else Reject())

    def answered(self, episode: Episode, problem: SearchProblem, model: ObservationModel) -> Episode:
        """The search with its answer: an object that it comes back to, as no search may, or that none is the target."""
        scene = SceneBelief(problem, model)
        for step in episode.steps:
            if step.touch is not None:
                scene.update(step.object_index, [step.touch])
        here = scene.marginals()[:, episode.target]
        best = int(here.argmax())
        if 1.0 - scene.prob_present(episode.target) > here[best]:
            return episode
        last = Step(best, scene.belief(best), Decision(Confirm()), None)
        return replace(episode, steps=(*episode.steps[:-1], last), outcome=Outcome.CONFIRMED)


def prepare(searches: Searches, decider: Decider, target: int) -> bool:
    """Let a decider with a method ``prepare`` load what it needs, or raise why it cannot play; False if blind."""
    player = getattr(decider, "decider", decider)
    if callable(ready := getattr(player, "prepare", None)):
        problem = searches.problem.seeking(target)
        info = InformationState.of(problem, target, SceneBelief(problem, searches.sensor.model), 0)
        ready(info)
        return not hasattr(player, "knows_target") or bool(player.knows_target(info))
    return True


@lru_cache(maxsize=1)
def _warm_up(searches: Searches) -> None:
    """Touch once and predict a next touch, so that the loading at the first touch of a process is not timed."""
    sensor, problem, seed = searches.sensor, searches.problem.seeking(0), (searches.seed, 0, 0)
    request = TouchRequest(TouchWorld.of_search(sensor, problem, seed), 0, touch_rng(seed, 0, 0, 0))
    scene = SceneBelief(problem, sensor.model)
    scene.update(0, touch_many(sensor, [request])[0])
    scene.view().evidence(0).outcome_mixture(OUTCOMES, HYPOTHESES)


def play_episodes(
    searches: Searches, decider: Decider, target: int, numbers: Sequence[int]
) -> tuple[list[Episode], Seconds]:
    """Play the episodes of a target with these numbers in lockstep; return them and the time that they took.

    The same arguments give the same episodes, bit for bit, in any process: a copy of the decider plays.
    """
    sensor, problem, spent = searches.sensor, searches.problem.seeking(target), [TouchTime()]
    if isinstance(decider, FullInformation):
        problem = replace(problem, touch_limit=problem.num_poses * problem.num_objects)
    seeds: list[Seed] = [(searches.seed, target, number) for number in numbers]
    worlds = [TouchWorld.of_search(sensor, problem, seed) for seed in seeds]
    waited = 0.0

    def touch_and_time(requests: Sequence[TouchRequest[TouchWorld]]) -> list[Touch]:
        nonlocal waited
        asked = time.perf_counter()
        touches, seconds = touch_many(sensor, requests)
        spent.append(seconds)
        waited += time.perf_counter() - asked
        return touches

    player = deepcopy(decider, {id(sensor.model): sensor.model})  # which no decider changes
    _warm_up(searches)
    prepare(searches, player, target)
    targets, started = [target] * len(worlds), time.perf_counter()
    episodes = search_lockstep(worlds, player, problem, targets, sensor.model, seeds, touch_and_time)
    if isinstance(decider, FullInformation):
        episodes = [decider.answered(episode, problem, sensor.model) for episode in episodes]
    thinking = time.perf_counter() - started - waited
    touches = sum(episode.num_touches for episode in episodes)
    seconds = sum(spent, TouchTime())
    return episodes, Seconds(seconds.physics, seconds.network, thinking, touches, seconds.pressed_again)


@dataclass(frozen=True, eq=False)
class Frame:
    """One decision of a replayed search; ``posterior (K,)`` is after it, and ``pressed`` None without a touch.

    ``evidence`` is that of a belief about one body, None for other models.
    """

    step: Step
    shape: int
    pressed: PressedObject | None
    posterior: NDArray[np.float64]
    body: WorldObject
    evidence: Any = None

    @property
    def image(self) -> NDArray[np.uint8] | None:
        """What was felt."""
        return None if self.pressed is None else self.pressed.image


def action_words(action: Action, problem: SearchProblem) -> str:
    """An action in words: "touch corner", "confirm", "reject" or "unsure"."""
    if isinstance(action, Probe):
        return f"touch {problem.pose_labels[action.pose]}"
    return ACTION_NAMES[type(action)]


def body_words(labels: Sequence[str], shape: int) -> str:
    """What an object is: "a cone", or "none of these"."""
    return NONE_OF_THESE if shape == UNLISTED else f"a {labels[shape]}"


def shown_shapes(posterior: NDArray[np.float64], target: int) -> list[int]:
    """Indices of the shapes that a picture shows: all, or the target and the most probable ones where they are many."""
    if len(posterior) <= _MOST_SHAPES:
        return list(range(len(posterior)))
    return sorted({target, *np.argsort(-posterior, kind="stable")[: _MOST_SHAPES - 1].tolist()})


def replay(sensor: TactileSensor, problem: SearchProblem, episode: Episode) -> list[Frame]:
    """Repeat the touches of an episode of a run with its sensor."""
    world = TouchWorld.of_search(sensor, problem.seeking(episode.target), episode.seed)
    uses: Counter[tuple[int, int]] = Counter()
    frames, nothing = [], sensor.model.start()
    evidence, is_of_body = nothing, sensor.model.reads == "embeddings"
    for number, step in enumerate(episode.steps):
        body = world.current
        pressed, posterior = None, step.belief.probs
        if isinstance(step.decision.action, Probe) and step.touch is not None:
            pose = step.decision.action.pose
            rng = touch_rng(episode.seed, step.object_index, pose, uses[step.object_index, pose])
            image, _ = world.press(pose, rng)
            pressed, body = world.last, world.current  # which may have moved
            uses[step.object_index, pose] += 1
            if is_of_body:
                [touch] = replace(sensor, with_logits=False).read(image[None], [pose])  # recorded were logits alone
                evidence = evidence.update(touch)
            posterior = episode.steps[number + 1].belief.probs  # a touch is always followed by a decision
        elif isinstance(step.decision.action, Reject) and number + 1 < len(episode.steps):
            world.advance()
        about = innermost(evidence) if is_of_body else None
        frames.append(Frame(step, episode.arrangement[step.object_index], pressed, posterior, body, about))
        evidence = nothing if isinstance(step.decision.action, Reject) else evidence
    return frames


MOST_PICTURES = 200
APPROACH = (-0.016, -0.009, -0.003)
"""Depths of an object on its way to the pad [m]."""
_WAITING = APPROACH[0]
_MOVING, _TOUCHED, _DECIDED, _ENDED = 120, 1500, 1700, 5000
"""How long pictures of each kind are shown [ms]."""


@dataclass(frozen=True, eq=False)
class Moment:
    """One picture of a search.

    Attributes:
        placement: the object in front of the pad; of a hand, in front of its first finger.
        depth: of the object in the pad [m]; negative on its way there.
        frame: the step of the search.
        image: tactile image of the last touch of this object; None before the first.
        evidence: about its body from its touches; None for models that are not of one body.
        probs: belief about its shape.
        states: of each object: "", "rejected" or "found", or "wrong" for a confirmed one of another shape.
        words: description of the action.
        milliseconds: how long the picture is shown.
    """

    placement: Placement
    depth: float
    frame: Frame
    image: NDArray[np.uint8] | None
    evidence: Any
    probs: NDArray[np.float64]
    states: tuple[str, ...]
    words: str
    milliseconds: int


def moments(
    sensor: TactileSensor, problem: SearchProblem, episode: Episode, approach: Sequence[float] = ()
) -> list[Moment]:
    """The pictures of a search in order, at most :data:`MOST_PICTURES`: one for each step, and those of ``approach``.

    Approaches are left out where these are too many.
    """
    found = list(_moments(sensor, problem, episode, approach))
    if len(found) > MOST_PICTURES:
        found = list(_moments(sensor, problem, episode, ()))
    kept = np.unique(np.linspace(0, len(found) - 1, min(len(found), MOST_PICTURES)).round().astype(int))
    return [found[index] for index in kept]


def _moments(
    sensor: TactileSensor, problem: SearchProblem, episode: Episode, approach: Sequence[float]
) -> Iterator[Moment]:
    nothing = sensor.model.start()
    start = innermost(nothing) if sensor.model.reads == "embeddings" else None
    states = [""] * problem.num_objects
    target, current, num_touches = problem.shape_labels[episode.target], -1, 0
    for frame in replay(sensor, problem, episode):
        step = frame.step
        index, action, probs = step.object_index, step.decision.action, step.belief.probs
        if index != current:
            image, evidence, depth, current = None, start, _WAITING, index
            placement = sensor.scene.place(frame.body, 0, touch_rng(episode.seed, index, 0, 0))
        name, milliseconds = f"Object {index + 1}", _DECIDED
        if isinstance(action, Probe):
            words, milliseconds = f"{name}, touch {num_touches + 1}", _TOUCHED
            if frame.pressed is None:
                words = f"{name}: nothing is felt in pose {problem.pose_labels[action.pose]}"
            else:
                placement, depth = frame.pressed.placement, frame.pressed.contact.depth
                for away in approach:
                    yield Moment(placement, away, frame, image, evidence, probs, tuple(states), words, _MOVING)
                image, evidence, probs, num_touches = frame.image, frame.evidence, frame.posterior, num_touches + 1
        elif isinstance(action, Reject):
            states[index] = "rejected"
            words = f"{name} is no {target}: rejected" + ", wrongly" * (frame.shape == episode.target)
        elif isinstance(action, Confirm):
            is_right = frame.shape == episode.target
            states[index], truth = "found" if is_right else "wrong", body_words(problem.shape_labels, frame.shape)
            ends = f"found with {num_touches} touches" if is_right else f"wrong, it is {truth}"
            words = f"{name} is the {target} (probability {probs[episode.target]:.3f}): {ends}"
        else:
            words = f"{name}: I do not know, after {num_touches} touches"
        is_last = step is episode.steps[-1]
        milliseconds = _ENDED if is_last else milliseconds
        yield Moment(placement, depth, frame, image, evidence, probs, tuple(states), words, milliseconds)
