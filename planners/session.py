"""Ask and tell: a search whose touches somebody else makes, such as a robot that this program does not drive.

A :class:`Session` returns each action and waits for its result. :func:`planners.search.search` runs one in a world.

>>> from belief.synthetic import random_model
>>> from planners.registry import make_decider
>>> model, rng = random_model(np.random.default_rng(0), num_shapes=2), np.random.default_rng(1)
>>> problem = SearchProblem(model.shape_labels, ("front", "side", "top"), num_objects=2)
>>> session = Session(problem, make_decider("fixed_poses", model.outcome_table()), "shape_1", model, seed=7)
>>> session.ask()
Probe(pose=0)
>>> session.tell(model.sample(0, [0], rng)[0])                 # as felt in the pose that was asked for
'touch'
>>> session.tell(model.sample(0, [2], rng)[0])                 # a touch in another pose is evidence as well
'touch'
>>> session.undo()                                             # but that one was a mistake
'touch'
>>> len(session.steps), session.ask(), session.outcome is None
(1, Probe(pose=1), True)
"""

from __future__ import annotations

import hashlib
import json
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from belief.bayes import Belief
from belief.constraints import NOT_NEGATIVE, require_rule
from belief.errors import InvalidArgument
from belief.naming import NONE_OF_THESE, UNKNOWN, UNLISTED, Name, index_of, one_line, shape_name
from belief.observation_model.model import ObservationModel
from belief.problem import Action, Elsewhere, Probe, SearchProblem, Touch, Unsure
from belief.scene_belief import SceneView
from belief.search_progress import Outcome, SearchProgress
from belief.validation import require_index
from planners.decider import Decider, Decision, InformationState, checked_decision, require_decider
from planners.episode import ACTION_NAMES, ACTIONS, MOVED, Episode, Step
from planners.session_log import AlreadyTold as AlreadyTold  # documented here
from planners.session_log import (
    AskAndTell,
    ImageReader,
    Told,
    decider_fields,
    digests,
    problem_fields,
    problem_from,
    reading,
    require_digests,
    standing_of,
)

_FAR = 20.0  # factor beyond the contacts of the reader's scene, from which a force or an area is in another unit
_MISSES = 2  # of an object in a pose, after which another pose is touched


class SessionSettings(TypedDict, total=False):
    """Settings of a :class:`Session`, without its search and the reader of its images."""

    arrangement: Sequence[Name | None] | None
    abstain: bool | None
    log_bets: ArrayLike
    least_force: float | None
    least_area: float | None


class Session(AskAndTell):
    """A search that asks for touches and is told what was felt.

    The same seed and the same touches give the same actions as :func:`planners.search.search`, to the last bit, also if
    the session was saved and loaded in between.

    Args:
        problem: the search.
        decider: chooses the actions.
        target: label or index of the shape sought.
        model: likelihood of touches.
        seed: seed of the decider, one number or several.
        arrangement: true shape of every object, by label or index, None for one that nobody knows, "none of these" for
            one whose shape is not listed; for scoring only.
        abstain: whether the decider may answer "I do not know" (:class:`planners.abstaining.Abstaining`); by default,
            if no true shape is given. The problem then has the answer Unsure, with a reward of 0 unless it has one.
        log_bets: log bets of an earlier search with the same set-up (:func:`planners.search.log_bets_after`).
        reader: reads images.
        least_force: a contact whose stated force is not larger is no contact [N].
        least_area: a contact whose area is not larger is no contact [m²].
        prior: belief about one object of an ``independent`` problem before its first touch; uniform by default.

    Attributes:
        problem: the search, with the answer Unsure if the decider may give it.
        model: likelihood of touches.
        target: index of the shape sought.
        decider: the decider that chooses the actions, in :class:`planners.abstaining.Abstaining` if it may be unsure.

    Raises:
        UnknownName: no shape has the target's name.
        ValueError: a target, a seed or a number out of range; arguments that do not fit each other.
    """

    schema = "activetouch session 1"

    def __init__(
        self,
        problem: SearchProblem,
        decider: Decider,
        target: Name,
        model: ObservationModel,
        seed: int | Sequence[int] = 0,
        *,
        arrangement: Sequence[Name | None] | None = None,
        abstain: bool | None = None,
        log_bets: ArrayLike = 0.0,
        reader: ImageReader | None = None,
        least_force: float | None = None,
        least_area: float | None = None,
        prior: Belief | None = None,
    ) -> None:
        require_decider(decider)
        self._abstains = arrangement is None if abstain is None else abstain
        if self._abstains:
            from planners.abstaining import Abstaining

            decider = decider if isinstance(decider, Abstaining) else Abstaining(decider)
            problem = problem.with_unsure()
        super().__init__(seed)
        self.target = index_of("target", problem.shape_labels, target)
        self._progress = SearchProgress(problem, model, prior, target=self.target, log_bets=log_bets)
        self.problem, self.model = self._progress.problem, model
        self._may_move = getattr(model, "moves", None) is not None
        self.decider, self._log_bets, self._prior = decider, log_bets, prior
        self._reader = reader
        self._least_force, self._least_area = least_force, least_area
        self._usual = dict(getattr(reader, "usual", {}))
        for name, limit in (("force", least_force), ("area", least_area)):
            if _not_negative(f"least_{name}", limit) and name in self._usual and limit > self._usual[name][1]:
                self._warn_of_unit(name, limit, f"least_{name}")
        self.arrangement = self._shapes([None] * self.problem.num_objects if arrangement is None else arrangement)
        self._steps: list[Step] = []

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "_progress": None}

    def __repr__(self) -> str:
        now = str(self.outcome) if self.outcome is not None else repr(self.belief)
        return one_line(Session, f"step {self.step}", f"object {self.object_index}", now)

    def ask(self) -> Action | None:
        """The next action, the same until it is told that it was carried out; None when the search has ended."""
        progress = self._progress
        if self._asked is None and progress.outcome is None:
            info = InformationState.of(self.problem, self.target, progress.scene, progress.object_index)
            decision = checked_decision(self.decider.decide(info, self._rng), self.decider, self.problem)
            decision = self._with_misses(decision)
            if self._may_move and (moved := self.prob_moved):
                decision = replace(decision, scores={**decision.scores, MOVED: moved})
            if isinstance(decision.action, Probe) and not progress.may_touch:
                self._steps.append(Step(progress.object_index, info.belief, decision, None))
                progress.act(decision.action)
            else:
                self._asked = decision
        return None if self._asked is None else self._asked.action

    def _with_misses(self, decision: Decision) -> Decision:
        """The decision, or another one after misses that are no evidence, which no decider sees.

        After two misses in a pose, an object is touched in the pose that was missed and touched least. At the touch
        limit, the answer is "I do not know", if there is one.
        """
        action, lost = decision.action, [step for step in self._steps if _is_lost(step)]
        if not isinstance(action, Probe) or not lost:
            return decision
        if not self._progress.may_touch and self.problem.unsure_reward is not None:
            return Decision(Unsure(), {**decision.scores, "is_cut_off": 1.0})
        misses = [self._misses(pose) for pose in range(self.problem.num_poses)]
        if misses[action.pose] < _MISSES:
            return decision
        uses = [self.uses(pose) for pose in range(self.problem.num_poses)]
        return replace(decision, action=Probe(int(np.lexsort((uses, misses))[0])))

    def _misses(self, pose: int) -> int:
        """Misses of the current object in a pose that are no evidence."""
        here = (step for step in self._steps if step.object_index == self.object_index and _is_lost(step))
        return sum(step.decision.action == Probe(pose) for step in here)

    @property
    def reason(self) -> str | None:
        """Why "I do not know" is asked for, in words; None where something else is, or the decider does not say it."""
        if self._asked is None or not isinstance(self._asked.action, Unsure):
            return None
        from planners.abstaining import REASONS  # most sessions end with an answer

        return next((words for name, words in REASONS.items() if self._asked.scores.get(name)), None)

    def tell(
        self,
        touch: Touch | None = None,
        *,
        image: Any = None,
        missed: bool = False,
        pose: Name | Mapping[str, Any] | None = None,
        force: float | None = None,
        area: float | None = None,
        step: int | None = None,
    ) -> str:
        """Answer :meth:`ask`: what was felt, or, without arguments, that the action was carried out.

        After a Reject was carried out, the next object is in place. A touch may be in another pose than asked for, and
        may come when none was asked for: it is evidence, and the next action is decided anew. A miss is evidence where
        the observation model knows misses; elsewhere it is recorded, counts for the touch limit, and the same touch is
        asked for once more, then one in another pose. With a log, what was told is on disk when this returns.

        Args:
            touch: what was felt, as a reader says it.
            image: what was felt, for the session's reader; uint8, ``(H, W)`` or ``(H, W, 3)``.
            missed: whether there was no contact.
            pose: label or index of the pose of the touch, or a place that is none of the poses, as the session's
                reader takes it; that of ``touch``, or the one asked for, by default.
            force: force of the contact [N]; not more than ``least_force`` is a miss.
            area: area of the contact [m²]; not more than ``least_area`` is a miss. By default what the reader sees;
                at a ``least_area`` of 0, a stated ``force`` makes a touch of an image that is too faint.
            step: which question is answered: :attr:`step` when it was asked. It protects from answers that come twice.

        Returns:
            What the answer counts as: touch, miss or done.

        Raises:
            AlreadyTold: the step was answered before.
            InvalidArgument: the search has ended; the arguments do not fit each other, the question or the model.
            UnknownName: there is no such pose.
            ImpossibleObservation: the touch has likelihood zero for every possible shape.
            CannotWrite: the log cannot be written. After every error, nothing has changed.

        Warns:
            UserWarning: once, a force or an area is so far from those of the scene that its unit is another one.
        """
        self._require_step(step)
        self.ask()
        if self._asked is None:
            raise InvalidArgument(f"the search has ended: {self.outcome}. undo() takes back what was told last")
        told = self._told(touch, image, missed, pose, force, area)
        if told.kind != "done" and not self._progress.may_touch:
            raise InvalidArgument(f"the touch limit of the search, {self.problem.touch_limit}, allows no more touches")
        return self._take(told)

    def _told(
        self, touch: Touch | None, image: Any, missed: bool, pose: Any, force: float | None, area: float | None
    ) -> Told:
        """What the answer to the question that waits means; see :meth:`tell`."""
        asked = self._asked, self._rng.bit_generator.state, self.object_index
        action = self._asked.action
        wanted = action.pose if isinstance(action, Probe) else None
        if wanted is None and not missed and all(part is None for part in (touch, image, pose, force, area)):
            return Told(*asked, time=time.time())
        if (touch is not None) + (image is not None) + bool(missed) != 1:
            raise InvalidArgument(
                f"asked was {self._in_words(action)}; a touch is told by one of tell(touch), tell(image=…) and "
                "tell(missed=True), another action that was carried out by tell() without arguments"
            )
        if touch is not None and not isinstance(touch, Touch):
            raise InvalidArgument(f"a touch must be a Touch, such as Touch(pose, logits), got {touch!r:.60}")
        place = next((p for p in (pose, touch.pose if touch else None, wanted) if p is not None), None)
        if place is None:
            raise InvalidArgument(f"asked was {self._in_words(action)}, so say in which pose: tell(…, pose=…)")
        at, elsewhere = self._place(place)
        elsewhere = touch.elsewhere if touch is not None and pose is None else elsewhere
        force, area = _not_negative("force", force), _not_negative("area", stated := area)
        if image is not None:
            if self._reader is None:
                raise InvalidArgument("this session has no reader of images; a sensor's has one: sensor.session(…)")
            image, touch, seen = self._reader.read(image, at)
            area = seen if area is None else area
        is_small = _is_within(area, self._least_area) and not (force and stated is None and self._least_area == 0.0)
        is_miss = bool(missed) or _is_within(force, self._least_force) or is_small
        if is_miss:
            of_miss = getattr(self.model, "missed", None)
            touch = None if of_miss is None else of_miss(at)
        elif touch is not None and (touch.pose != at or touch.elsewhere is not elsewhere):
            touch = replace(touch, pose=at, elsewhere=elsewhere)
        for name, given in (("force", force), ("area", stated)) if not is_miss else ():
            self._warn_of_unit(name, given, name)
        return Told(*asked, touch, is_miss, image, force, area, time.time())

    def _warn_of_unit(self, name: str, value: float | None, said: str) -> None:
        """Warn, once in a session, of a force or an area far beyond those of the reader's scene."""
        low, high, unit = self._usual.get(name, (0.0, np.inf, ""))
        if value and not low / _FAR <= value <= _FAR * high:
            other = f"m{unit}" if value > high else "another unit"
            words = f"{said}={value:g} is in {unit}, and contacts of this sensor have {low:g} to {high:g} {unit}"
            warnings.warn(f"{words}: is it in {other}?", stacklevel=4)
            del self._usual[name]

    def _place(self, pose: Any) -> tuple[int, Elsewhere | None]:
        if not isinstance(pose, Mapping):
            return index_of("pose", self.problem.pose_labels, pose), None
        if self._reader is None:
            raise InvalidArgument(
                f"a place that is no pose, such as {pose!r:.80}, needs a session of a sensor: sensor.session(…)"
            )
        return self._reader.at(pose)

    def _in_words(self, action: Action) -> str:
        return f"a touch in pose {self.problem.pose_labels[action.pose]}" if isinstance(action, Probe) else f"{action}"

    def reveal(self, arrangement: Sequence[Name | None]) -> None:
        """Say which shapes the objects really have, for scoring and for recordings; it is no evidence.

        Args:
            arrangement: shape of every object, by label or index; None for one that nobody knows.

        Raises:
            UnknownName: there is no such shape.
            InvalidArgument: not one for every object, or an index out of range.
        """
        shapes = self._shapes(arrangement)
        self._reveal(arrangement=self._named(shapes))
        self.arrangement = shapes

    @property
    def digest(self) -> str:
        """Digest of what was told first, and when: the same for a session, its copies and its log, whatever follows."""
        first = [self._line(told) for told in self._events[:1]]
        return hashlib.sha256(json.dumps([self.seed, self.target, first], sort_keys=True).encode()).hexdigest()

    @property
    def object_index(self) -> int:
        """The current object."""
        return self._progress.object_index

    @property
    def belief(self) -> Belief:
        """Posterior about the current object."""
        return self._progress.scene.belief(self.object_index)

    @property
    def answer(self) -> str | None:
        """The most probable shape of the current object, or "none of these"; None once no object was confirmed."""
        if self.outcome not in (None, Outcome.CONFIRMED):
            return None
        return shape_name(self.problem.shape_labels, likeliest(self.belief)[0])

    @property
    def stated(self) -> float:
        """Probability of the most probable shape of the current object, or that it has none of the shapes."""
        return likeliest(self.belief)[1]

    @property
    def prob_moved(self) -> float:
        """Probability that the current object moved just before its last touch; 0.0 where objects stay."""
        return self._progress.scene.prob_moved(self.object_index)

    def pose(self, shape: Name | None = None, object_index: int | None = None) -> Any:
        """How an object lies, by all that was felt of it (for a tactile sensor, ``activetouch.PoseBelief``).

        Args:
            shape: supposed shape of the object, by label or index; the most probable one by default.
            object_index: the object; the current one by default.

        Raises:
            InvalidArgument: the session has no reader of images that knows how objects lie; or no such object.
            UnknownName: there is no such shape.
        """
        find = getattr(self._reader, "pose", None)
        if find is None:
            raise InvalidArgument(
                "only a session of a tactile sensor knows how objects lie, one that sensor.session begins"
            )
        scene = self._progress.scene
        place = self.object_index if object_index is None else object_index
        likeliest = int(scene.belief(place).probs.argmax())
        shape_index = likeliest if shape is None else index_of("shape", self.problem.shape_labels, shape)
        felt = [
            (told.touch.pose, told.image)
            for told in standing_of(self._events)[0]
            if told.object_index == place and told.image is not None and told.touch and told.touch.elsewhere is None
        ]
        return find(scene.evidence(place), shape_index, [pose for pose, _ in felt], [image for _, image in felt])

    @property
    def scene(self) -> SceneView:
        """Joint belief about all objects; later touches do not change it."""
        return self._progress.scene.view()

    @property
    def outcome(self) -> Outcome | None:
        """How the search ended; None while it goes on."""
        return self._progress.outcome

    @property
    def steps(self) -> tuple[Step, ...]:
        """All decisions that were carried out, oldest first."""
        return tuple(self._steps)

    @property
    def episode(self) -> Episode:
        """The record of the search; raises InvalidArgument before it has ended."""
        if self.outcome is None:
            raise InvalidArgument("the search has not ended yet; its steps so far are session.steps")
        return Episode(self.seed, self.target, self.arrangement, self.steps, self.outcome)

    def uses(self, pose: int) -> int:
        """Number of touches of the current object in a pose."""
        return self._progress.uses(pose)

    @classmethod
    def load(
        cls, path: str | Path, *, model: ObservationModel, decider: Decider, reader: ImageReader | None = None
    ) -> Session:
        """The session of a log, which goes on in the same file.

        Args:
            path: path of the log.
            model: the observation model with which the session began.
            decider: the decider with which the session began.
            reader: the reader of images with which the session began.

        Raises:
            CorruptFile: it is no log of a session, or was changed after it was written.
            OtherModel: it was made with another model, reader, decider or certificate.
            CannotWrite: it cannot be written, or another process has it open.
        """
        from belief.journal import read_journal

        path = Path(path).resolve()
        header, *_ = read_journal(path)
        with reading(path):
            require_digests(header, digests(model, reader))
            problem, target, seed = problem_from(header["problem"]), header["target"], header["seed"]
            settings = ("arrangement", "abstain", "log_bets", "least_force", "least_area")
            given = {name: header[name] for name in settings}
            if "prior" in header:
                given["prior"] = Belief.from_probs(problem.shape_labels, header["prior"])
            session = cls(problem, decider, target, model, seed, reader=reader, **given)
        session.resume(path)
        return session

    def _apply(self, told: Told) -> None:
        """Count an answer; after an error, nothing has changed."""
        progress, decision = self._progress, told.asked
        index, belief = progress.object_index, self.belief
        if told.touch is not None:
            progress.touch(told.touch)
            if decision.action != Probe(told.touch.pose) or told.touch.elsewhere is not None:
                moved = {MOVED: decision.scores[MOVED]} if MOVED in decision.scores else {}
                decision = Decision(Probe(told.touch.pose), {**moved, "is_unasked": 1.0})
        elif told.is_miss:
            progress.miss()
        else:
            progress.act(decision.action)
        if told.is_miss:
            decision = replace(decision, scores={**decision.scores, "is_miss": 1.0})
        self._steps.append(Step(index, belief, decision, told.touch))
        # A miss that is no evidence changes nothing that the decider sees: the same is asked for once more.
        wanted, is_lost = told.asked.action, told.is_miss and told.touch is None and progress.may_touch
        is_used_up = isinstance(wanted, Probe) and self._misses(wanted.pose) >= _MISSES
        self._asked = told.asked if is_lost and not is_used_up else None

    def _rewind(self) -> None:
        self._progress = SearchProgress(self.problem, self.model, self._prior, log_bets=self._log_bets)
        self._steps = []

    def _restore(self, events: list[Told | None]) -> None:
        super()._restore(events)
        if not self._progress.may_touch:
            self.ask()  # where the touch limit ended the search, its outcome is known again

    def _fields(self, told: Told) -> dict[str, Any]:
        action, touch, poses = told.asked.action, told.touch, self.problem.pose_labels
        line: dict[str, Any] = {
            "told": told.kind,
            "object": told.object_index,
            "time": told.time,
            "asked": {"pose": poses[action.pose]} if isinstance(action, Probe) else ACTION_NAMES[type(action)],
            "scores": dict(told.asked.scores),
            "rng": told.rng,
        }
        from belief.journal import array_field

        arrays = {} if touch is None else {"logits": touch.logits, "features": touch.features}
        if touch is not None:
            line["pose"] = poses[touch.pose]
            line |= {} if touch.elsewhere is None else {"place": list(touch.elsewhere.place)}
        arrays["image"] = touch.image if told.image is None and touch is not None else told.image
        line |= {name: array_field(array) for name, array in arrays.items() if array is not None}
        return line | {name: value for name in ("force", "area") if (value := getattr(told, name)) is not None}

    def _answer_from(self, line: Mapping[str, Any]) -> Told:
        from belief.journal import array_from

        problem, asked, reader = self.problem, line["asked"], self._reader
        names = "logits", "features", "image"
        logits, features, image = (array_from(line[name]) if name in line else None for name in names)
        pose = None if isinstance(asked, str) else index_of("pose", problem.pose_labels, asked["pose"])
        scores = {str(name): float(value) for name, value in line["scores"].items()}
        if (kind := line["told"]) not in ("touch", "miss", "done"):
            raise ValueError(f"nothing known was told: {kind!r}")
        touch = None
        if "pose" in line:
            at = index_of("pose", problem.pose_labels, line["pose"])
            if "place" in line and reader is None:
                raise ValueError(
                    "a touch was made at a place that is no pose; give the reader that the session began with"
                )
            elsewhere = reader.at({"place": line["place"]})[1] if "place" in line and reader is not None else None
            is_seen = kind == "touch" and image is not None and image.dtype == np.uint8  # rows of features are not
            touch = Touch(at, logits, features, elsewhere, image if is_seen else None)
        if kind != "miss" and (touch is None) == (kind == "touch"):
            raise ValueError("a touch needs a pose, and an action that is no touch has none")
        force, area = (_not_negative(name, line.get(name)) for name in ("force", "area"))
        decision = Decision(ACTIONS[asked] if pose is None else Probe(pose), scores)
        require_index("object", line["object"], problem.num_objects)
        rest = touch, kind == "miss", image, force, area, float(line["time"])
        return Told(decision, line["rng"], line["object"], *rest)

    def _learn(self, truth: Mapping[str, Any]) -> None:
        self.arrangement = self._shapes(truth["arrangement"])

    def _learn_first(self, header: Mapping[str, Any]) -> None:
        if any(shape is not None for shape in header["arrangement"]):
            self._learn(header)

    @property
    def _truth(self) -> dict[str, Any]:
        return {}

    def _shapes(self, arrangement: Sequence[Name | None]) -> tuple[int, ...]:
        labels, number = self.problem.shape_labels, self.problem.num_objects
        if isinstance(arrangement, str) or len(arrangement) != number:
            raise InvalidArgument(f"the arrangement must be {number} shapes, None where unknown; got {arrangement!r}")
        return tuple(
            UNKNOWN if shape is None else UNLISTED if shape == NONE_OF_THESE else index_of("shape", labels, shape)
            for shape in arrangement
        )

    def _named(self, shapes: Sequence[int]) -> list[str | None]:
        words = {UNKNOWN: None, UNLISTED: NONE_OF_THESE}
        return [words[shape] if shape in words else self.problem.shape_labels[shape] for shape in shapes]

    @property
    def set_up(self) -> dict[str, Any]:
        """What the session began with, as JSON types: the fields of the first line of its log."""
        return {
            "problem": problem_fields(self.problem),
            "target": self.problem.shape_labels[self.target],
            "seed": list(self.seed),
            "arrangement": self._named(self.arrangement),
            "abstain": self._abstains,
            "decider": decider_fields(self.decider),
            "stop_rule": getattr(self.decider, "stop_rule", None),
            "log_bets": np.asarray(self._log_bets, np.float64).tolist(),
            "least_force": self._least_force,
            "least_area": self._least_area,
            **({} if self._prior is None else {"prior": self._prior.probs.tolist()}),
            **digests(self.model, self._reader),
        }


def likeliest(belief: Belief) -> tuple[int, float]:
    """The most probable label, or UNLISTED, and its probability."""
    best = int(belief.log_probs.argmax())
    stated = float(np.exp(belief.log_probs[best]))
    return (UNLISTED, belief.unlisted) if belief.unlisted > stated else (best, stated)


def _is_lost(step: Step) -> bool:
    """Whether a step was a miss that is no evidence."""
    return step.touch is None and "is_miss" in step.decision.scores


def _is_within(number: float | None, limit: float | None) -> bool:
    return number is not None and limit is not None and number <= limit


def _not_negative(name: str, value: float | None) -> float | None:
    if value is None:
        return None
    require_rule(name, value, NOT_NEGATIVE)
    return float(value)
