"""What all sensors do alike: searches among simulated objects, and sessions with a robot's."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from numpy.typing import ArrayLike

from belief.arrangement import num_states
from belief.composition import Composition, Counts
from belief.errors import InvalidArgument
from belief.naming import Name, index_of
from belief.observation_model.evidence import WeighsStrangers, start
from belief.observation_model.model import ArrayModel
from belief.problem import SearchProblem
from belief.seeding import checked_key
from planners import Decider, Episode, World, make_decider, search
from planners.search import naming_session
from planners.session import Session, SessionSettings
from planners.session_log import ImageReader

if TYPE_CHECKING:
    from planners.certified import Certificate


STRANGERS = 0.15
"""Usual prior probability that an object is none of many bodies: at 0.05, strangers were named after few touches."""
UNLISTED_SHARE = 0.05
"""Usual prior probability that an object is none of few bodies."""


class Searching(ABC):
    """What all sensors do alike: searches among simulated objects, and sessions of robots (:class:`Sensor`)."""

    model: ArrayModel

    @property
    @abstractmethod
    def shape_labels(self) -> tuple[str, ...]:
        """The labels of the shapes that it tells apart."""

    @property
    @abstractmethod
    def pose_labels(self) -> tuple[str, ...]:
        """The labels of the poses in which it can touch."""

    @property
    @abstractmethod
    def image_reader(self) -> ImageReader:
        """The reader of the images that a session receives."""

    @abstractmethod
    def _usual(self) -> tuple[SearchProblem, int]:
        """The usual rules of a search, and the number of touches for each object."""

    @abstractmethod
    def _world(self, problem: SearchProblem, key: tuple[int, ...], target: int) -> World:
        """The simulated objects of a search."""

    @abstractmethod
    def _certified(
        self, problem: SearchProblem, target: int, decider: str | Decider, certificate: Certificate
    ) -> Decider:
        """The decider of a certificate, which stops by it; raises NotCertified."""

    def problem(
        self,
        num_objects: int | None = None,
        composition: Composition | Counts | str | None = None,
        touch_cost: float = 0.02,
        unlisted: float = 0.0,
        opinion: ArrayLike | None = None,
    ) -> SearchProblem:
        """The rules of a search; see :meth:`Sensor.problem`."""
        return _problem_of(*self._usual(), num_objects, composition, touch_cost, unlisted, opinion)

    def search(
        self,
        target: Name,
        decider: str | Decider = "information_gain",
        seed: int | Sequence[int] = 0,
        *,
        num_objects: int | None = None,
        composition: Composition | Counts | str | None = None,
        touch_cost: float = 0.02,
        unlisted: float = 0.0,
        opinion: ArrayLike | None = None,
    ) -> Episode:
        """Search for an object of the target's shape among simulated objects; see :meth:`Sensor.search`.

        ``seed=7`` is the first search for this target in ``activetouch compare --seed 7``; the key ``(7, 3, 12)`` is
        search number 12 for the target with index 3.
        """
        problem = self.problem(num_objects, composition, touch_cost, unlisted, opinion)
        shape, key, player = _player_of(problem, self.model, target, decider, seed)
        return search(self._world(problem, key, shape), player, problem, shape, self.model, key)

    def session(
        self,
        target: Name,
        decider: str | Decider = "information_gain",
        seed: int | Sequence[int] = 0,
        *,
        num_objects: int | None = None,
        composition: Composition | Counts | str | None = None,
        touch_cost: float = 0.02,
        unlisted: float = 0.0,
        opinion: ArrayLike | None = None,
        log: str | Path | None = None,
        certificate: str | Path | Certificate | None = None,
        **settings: Unpack[SessionSettings],
    ) -> Session:
        """A search whose touches a robot or another program makes; see :meth:`Sensor.session`.

        It asks for what :meth:`search` with the same seed would do, given the same touches, if ``abstain`` is False.
        """
        problem = self.problem(num_objects, composition, touch_cost, unlisted, opinion)
        shape, key, player = _player_of(problem, self.model, target, decider, seed)
        if certificate is None:
            settings = _with_misses(settings)  # which a certificate does not cover
        else:
            from planners.certified import Certificate

            problem = problem.with_unsure()
            player = self._certified(problem, shape, decider, Certificate.opened(certificate))
        return Session(problem, player, shape, self.model, key, reader=self.image_reader, **settings).begun(log)

    def naming(
        self,
        decider: str | Decider = "shape_information_gain",
        seed: int | Sequence[int] = 0,
        *,
        log: str | Path | None = None,
        **rules: Any,
    ) -> Session:
        """A session that says which object it is: touches that a robot makes, until one shape is probable enough.

        Its last action is Confirm where the object is named: :attr:`Session.answer` and :attr:`Session.stated` are the
        name and its probability. It is Unsure where no shape became probable enough, or touches contradict the model.

        Args:
            decider: its name, as ``compare --deciders`` takes it, or an object with ``decide(info, rng)``.
            seed: of the decider.
            log: as of :meth:`session`.
            rules: ``threshold``, ``max_touches``, ``unlisted``, ``opinion`` and others of
                :func:`planners.search.naming_session`. ``unlisted`` is by default :data:`UNLISTED_SHARE`, among
                many bodies :data:`STRANGERS`, and 0 where touches tell nothing about it.
        """
        made = make_decider(decider, self.model.outcome_table(), self.model) if isinstance(decider, str) else decider
        rules = {"least_area": 0.0, "reader": self.image_reader, "unlisted": _usual_share(self.model), **rules}
        return naming_session(made, self.model, self.pose_labels, seed, **rules).begun(log)


def _usual_share(model: ArrayModel) -> float:
    """Usual prior probability that an object has none of the shapes; 0 where touches tell nothing about that."""
    if hasattr(model, "strangers"):
        return 0.0 if model.strangers is None else STRANGERS
    with suppress(InvalidArgument):  # of a model without a conflict test
        return UNLISTED_SHARE * isinstance(start(model), WeighsStrangers)
    return 0.0


def _problem_of(
    usual: SearchProblem,
    touches_per_object: int,
    num_objects: int | None,
    composition: Composition | Counts | str | None,
    touch_cost: float,
    unlisted: float,
    opinion: ArrayLike | None,
) -> SearchProblem:
    """The usual search with changed rules; objects are independent, with a warning, if the exact sum is too large."""
    if num_objects is None:
        most = composition.total if isinstance(composition, Counts) else usual.num_objects
        num_objects = min(usual.num_objects, most)
    problem = replace(
        usual,
        num_objects=num_objects,
        composition=Composition(composition) if isinstance(composition, str) else composition or usual.composition,
        touch_cost=touch_cost,
        unlisted=unlisted,
        opinion=opinion,
        touch_limit=touches_per_object * num_objects,
    )
    try:
        if composition is None and problem.counts is not None:
            num_states(problem.counts, num_objects)
    except InvalidArgument as error:
        warnings.warn(f"the objects are taken to be independent, so that two may be alike: {error}", stacklevel=4)
        problem = replace(problem, composition=Composition.INDEPENDENT)
    return problem


def _player_of(
    problem: SearchProblem, model: ArrayModel, target: Name, decider: str | Decider, seed: int | Sequence[int]
) -> tuple[int, tuple[int, ...], Decider]:
    """Index of the target, key of the search, and the decider."""
    shape, words = index_of("target", problem.shape_labels, target), checked_key(seed)
    key = (*words, shape, 0) if len(words) == 1 else words
    return shape, key, make_decider(decider, model.outcome_table(), model) if isinstance(decider, str) else decider


def _with_misses(settings: SessionSettings) -> SessionSettings:
    """Settings of a session in which, if it may abstain, an image that could be one of no contact is a miss."""
    is_abstaining = settings.get("abstain")
    is_abstaining = settings.get("arrangement") is None if is_abstaining is None else is_abstaining
    if is_abstaining and settings.get("least_area") is None:
        return {**settings, "least_area": 0.0}
    return settings
