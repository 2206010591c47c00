"""The protocol of all sensors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol, Unpack, runtime_checkable

from numpy.typing import ArrayLike, NDArray

from belief.composition import Composition, Counts
from belief.naming import Name
from belief.observation_model.model import ArrayModel
from belief.problem import SearchProblem, Touch
from planners import Decider, Episode, Session
from planners.certified import Certificate
from planners.session import SessionSettings
from planners.session_log import ImageReader


@runtime_checkable
class Sensor(Protocol):
    """Reads touches of objects of known shapes, and searches with them."""

    @property
    def shape_labels(self) -> tuple[str, ...]:
        """The K labels of the shapes that it tells apart."""

    @property
    def pose_labels(self) -> tuple[str, ...]:
        """The P labels of the poses in which it can touch."""

    @property
    def model(self) -> ArrayModel:
        """The observation model, which turns readings into evidence."""

    def read(self, images: NDArray[Any], poses: Sequence[Name]) -> list[Touch]:
        """Touches from N images, or rows of features, and the N poses in which they were made."""

    @property
    def image_reader(self) -> ImageReader:
        """The reader of the images, or rows of features, that a session receives."""

    def problem(
        self,
        num_objects: int | None = None,
        composition: Composition | Counts | str | None = None,
        touch_cost: float = 0.02,
        unlisted: float = 0.0,
        opinion: ArrayLike | None = None,
    ) -> SearchProblem:
        """The rules of a search; arguments as of :meth:`search`."""

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
        """Search for an object of the target's shape among simulated objects.

        The same seed gives the same objects and touches.

        Args:
            target: label or index of the shape.
            decider: its name, as ``compare --deciders`` takes it, or an object with ``decide(info, rng)``.
            seed: of the search, or its key.
            num_objects: number of objects; by default the usual one of the sensor.
            composition: "distinct", "independent", or a :class:`belief.Composition` or :class:`belief.Counts`; by
                default the usual one of the sensor. Where the exact sum over distinct objects is too large, they are
                then independent, with a warning.
            touch_cost: cost λ of one touch, in units of a success.
            unlisted: prior probability that an object has none of the shapes (:attr:`belief.SearchProblem.unlisted`).
            opinion: probabilities of the shapes of each object from another source, such as a camera
                (:attr:`belief.SearchProblem.opinion`).

        Returns:
            The episode, which prints as its steps.

        Raises:
            UnknownName: no shape or no decider has this name.
            InvalidArgument: a number is out of its range, or the seed is not valid.
        """

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
        """A search whose touches a robot or another program makes; it reads the images that it receives.

        Args:
            target: label or index of the shape.
            decider: as of :meth:`search`.
            seed: of the decider.
            num_objects: as of :meth:`search`.
            composition: as of :meth:`search`.
            touch_cost: as of :meth:`search`.
            unlisted: as of :meth:`search`.
            opinion: as of :meth:`search`.
            log: file for all that the session receives, on disk before the next question; if it exists, its search
                continues, with its own settings alone.
            certificate: of :func:`activetouch.certify`, or its file: it says where an object is confirmed.
            settings: of :class:`planners.Session`. Where it may abstain and there is no certificate, an image that
                could be one of no contact is a miss, unless ``least_area`` is given.

        Raises:
            UnknownName: no shape or no decider has this name.
            InvalidArgument: a number is out of its range, or the log is of another search, decider or limit.
            NotCertified: the certificate was made for another search.
            CorruptFile, CannotWrite: the log cannot be read or written.
        """
