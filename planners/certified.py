"""Stops with a certificate: an object is confirmed only where calibration searches have bounded the error.

What is promised, over what randomness, and with what confidence: :mod:`belief.statistics.stop_thresholds` and
docs/certificate.md.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from belief.codec import INFINITE, OPTIONAL, from_fields, to_fields
from belief.constraints import Checked, Count, CountOrNone, Fraction, NotEmpty, Within, check
from belief.errors import ActiveTouchError, CorruptFile, InvalidArgument
from belief.files import require_regular_file, sealed_json, unsealed_json, write_text
from belief.naming import UNKNOWN
from belief.observation_model.model import ObservationModel
from belief.problem import Confirm, Probe, Touch, Unsure
from belief.statistics.exchangeability import log_e_values
from belief.statistics.online_stops import OnlineStops
from belief.statistics.stop_thresholds import CertifiedThresholds
from belief.table import Table, Tabular
from belief.touch_fit import touch_fit
from belief.validation import require_count, require_index, require_number
from planners.abstaining import Abstaining
from planners.decider import Decider, Decision, InformationState, are_touches_used, checked_decision, require_unsure
from planners.episode import Step
from planners.session import Session

SCHEMA = "activetouch certificate 3"
WANTED, WORLD = "confirm_prob", "sensor_world"
"""Scores of a decision. The first, where the decider would confirm: the stated probability that this is right. The
second, where the state of the sensor is unknown: index of its likeliest world, 0 as described."""
FALSE_ALARM = 0.05
"""Largest probability that a certificate is ever withdrawn in the world that it was made for."""
_LARGEST = 1e9  # nats
NEVER = (math.inf,)
"""Thresholds with which nothing is confirmed: calibration searches list all that could be."""


class NotCertified(ActiveTouchError, ValueError):
    """A certificate does not hold for what it is used with."""


@dataclass(frozen=True)
class Certified(Checked):
    """Follows any decider, but confirms only at a threshold that depends on the touches of the object.

    Where the decider would confirm below the threshold, the object is touched again, in the pose that was used least.
    After ``max_touches`` of the object, or at the touch limit of the search, the answer is "I do not know". So two sets
    of thresholds give the same search up to its end, and the stops of all of them can be read from one search with
    :data:`NEVER`. Rejections are those of the decider; nothing is promised about them.

    Attributes:
        thresholds: stated probability of the target from which an object is confirmed, by the number of its touches;
            the last one is for its number and more; infinite for never.
        made_for: that of the certificate; None without one.
    """

    decider: Decider
    thresholds: Annotated[tuple[float, ...], NotEmpty(), Within(0.0, math.inf)]
    max_touches: Count = 6
    made_for: Mapping[str, Any] | None = field(default=None, repr=False, compare=False)

    @property
    def stop_rule(self) -> dict[str, Any]:
        """The rule that ends its searches, as JSON types for the log of a session."""
        limits = [float(limit) if math.isfinite(limit) else None for limit in self.thresholds]
        return {"thresholds": limits, "max_touches": self.max_touches}

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`."""
        require_unsure(info.problem, "stops with a certificate need")
        wanted = checked_decision(self.decider.decide(info, rng), self.decider, info.problem)
        if info.scene is not None and (health := info.scene.sensor_health) is not None:
            wanted = replace(wanted, scores={**wanted.scores, WORLD: float(health.probs[:-1].argmax())})
        if not isinstance(wanted.action, Confirm):
            return wanted
        touches, prob = len(info.history), min(info.target_prob, 1.0)
        scores = {**wanted.scores, WANTED: prob}
        if prob >= self.thresholds[min(touches, len(self.thresholds) - 1)]:
            return Decision(wanted.action, scores)
        if touches >= self.max_touches or are_touches_used(info):
            return Decision(Unsure(), {**scores, "is_uncertified": 1.0})
        return Decision(Probe(int(info.uses.argmin())), {**scores, "overruled": 1.0})


Fit = tuple[int, float, float]
"""Target of a search, and how well its touches fit: misfit and strangeness (:func:`belief.touch_fit.touch_fit`)."""


def fit_of_search(target: int, steps: Sequence[Step], model: ObservationModel) -> Fit:
    """Fit of the touches of a search to the likeliest world of its sensor, up to the first possible confirmation.

    Up to there, a search is the same with all certificates.
    """
    objects, world = dict[int, list[Touch]](), 0.0
    for step in steps:
        world = step.decision.scores.get(WORLD, world)
        if WANTED in step.decision.scores:
            break
        if step.touch is not None:
            objects.setdefault(step.object_index, []).append(step.touch)
    misfit, strangeness = touch_fit(model, objects.values(), int(world))
    limited = np.clip([misfit, strangeness], -_LARGEST, _LARGEST).round(4)
    return target, float(limited[0]), float(limited[1])


def learned(stops: OnlineStops, session: Session) -> OnlineStops:
    """Stops that learn from a search whose true shapes were revealed (:meth:`planners.Session.reveal`).

    What counts is the first moment at which the decider would confirm, whether it was allowed to or not: follow it by
    ``Certified(decider, (stops.threshold,))``, and report all searches. A search without such a moment says nothing.

    Raises:
        InvalidArgument: nobody knows the shape of the object that would be confirmed.
    """
    for step in session.steps:
        if WANTED in step.decision.scores or isinstance(step.decision.action, Confirm):
            shape = session.arrangement[step.object_index]
            if shape == UNKNOWN:
                raise InvalidArgument("stops learn from searches whose shapes are known: say them with reveal()")
            stated = min(float(step.belief.probs[session.target]), 1.0)
            return stops.after(stated, shape != session.target)
    return stops


@dataclass(frozen=True)
class Certificate(Tabular):
    """Thresholds for the stops of one decider with one sensor in one world, and what they were made from.

    With probability ``confidence`` over the calibration searches, P(wrong | confirmed after k touches) ≤ ``risk`` for
    every k, over searches of the world that is named: its objects, and a target drawn uniformly from its targets.

    The certificate is withdrawn when the searches of a set-up (:meth:`after`) no longer look like the calibration
    searches for the same targets: by :func:`belief.statistics.exchangeability.log_e_values`, with a probability of at
    most :data:`FALSE_ALARM` ever, however many searches there are, if they are of that world.

    Attributes:
        decider: name of the decider, with settings.
        risk: α.
        confidence: confidence level of the promise.
        num_searches: calibration searches; half of them proposed the thresholds, the others tested them.
        thresholds: as of :class:`Certified`.
        stops: stops in the testing half, by number of touches as ``thresholds``.
        wrong: wrong ones among these.
        max_touches: as of :class:`Certified`.
        made_for: JSON types that name the world, the objects, the decider, the sensor and the rules.
        usual: fit of each calibration search.
        since: fit of each search of the set-up, in their order.
        counted: digests of the sessions of these searches.
        answers: of searches in a tray, by which the thresholds are in place of numbers of touches.
        seed: of the calibration searches.
    """

    decider: str
    risk: Fraction
    confidence: Fraction
    num_searches: Count
    thresholds: Annotated[tuple[float, ...], INFINITE]
    stops: tuple[CountOrNone, ...]
    wrong: tuple[int, ...]
    max_touches: Count
    made_for: Mapping[str, Any] = field(repr=False)
    usual: tuple[Fit, ...] = field(default=(), repr=False)
    since: tuple[Fit, ...] = field(default=(), repr=False)
    counted: tuple[str, ...] = field(default=(), repr=False)
    answers: Annotated[tuple[str, ...], OPTIONAL] = ()
    seed: Annotated[int, OPTIONAL] = 0

    def __post_init__(self) -> None:
        check(self)
        for limit in self.thresholds:
            require_number("a threshold below infinity", 0.0 if limit == math.inf else limit, 0.0, 1.0)
        for stops, wrong in zip(self.stops, self.wrong, strict=True):
            require_index("wrong", wrong, stops + 1)
        for target, *fit in (*self.usual, *self.since):
            require_count("the target of a search", target, 0)
            for number in fit:
                require_number("the fit of a search", number, -_LARGEST, _LARGEST)
        labels = self.made_for["targets"]
        if not (isinstance(labels, list) and labels and all(isinstance(label, str) for label in labels)):
            raise InvalidArgument(f"the targets must be one label or more, got {labels!r:.80}")
        if not (len(self.thresholds) == len(self.stops) > 0 and len(self.counted) <= len(self.since)):
            raise InvalidArgument("thresholds, stops and searches do not fit each other")

    def table(self) -> Table:
        """The thresholds by number of touches, and what is promised."""
        rate = f"P(wrong | confirmed after k touches) ≤ {self.risk:g} for every k"
        if self.answers:
            rate = f"P(wrong | answer) ≤ {self.risk:g} for every answer"
        title = f"{self.decider}: {rate}, with confidence {self.confidence:g}, from {self.num_searches} searches"
        about = self.risk, self.confidence, self.num_searches
        counted = CertifiedThresholds(self.thresholds, self.stops, self.wrong, *about, answers=self.answers).table()
        return replace(counted, title=title, note=self._withdrawal if self.is_withdrawn else counted.note)

    @cached_property
    def log_alarms(self) -> NDArray[np.float64]:
        """Log e-value against "the world is that of the calibration searches" after each search since, ``(T,)``."""
        usual, since = (np.array(some).reshape(-1, 3) for some in (self.usual, self.since))
        return log_e_values(usual[:, 1:], usual[:, 0], since[:, 1:], since[:, 0])

    @property
    def is_withdrawn(self) -> bool:
        """Whether the searches since no longer look like the calibration searches, now or earlier."""
        return bool((self.log_alarms >= -math.log(FALSE_ALARM)).any())

    @property
    def _withdrawal(self) -> str:
        number = int(np.argmax(self.log_alarms >= -math.log(FALSE_ALARM))) + 1
        return (
            f"the certificate is withdrawn after {number} searches: their touches do not look like those of its own "
            "searches, so stops are no longer certified. Calibrate the sensor in its world (activetouch calibrate), or "
            "let searches infer what has changed (--unknown-state, unknown_state=True), and certify again"
        )

    def after(self, session: Session) -> Certificate:
        """The certificate after a search of the set-up that stopped by it; withdrawn if the world has changed.

        Count all searches, for targets that were chosen without knowledge of the touches.

        Raises:
            InvalidArgument: the search has not ended, sought another target, did not stop by this certificate (another
                decider, sensor or certificate, or none), or was counted before. Nothing is counted then.
        """
        target = session.problem.shape_labels[session.target]
        if session.outcome is None:
            raise InvalidArgument("the certificate counts ended searches, and this one has not ended")
        if target not in self.made_for["targets"]:
            raise InvalidArgument(f"the certificate counts searches for its targets, got one for {target}")
        decider = session.decider.decider if isinstance(session.decider, Abstaining) else session.decider
        if not isinstance(decider, Certified) or decider.made_for is None:
            raise InvalidArgument(
                "the certificate counts searches that stopped by it, and this one had none: begin it with "
                "sensor.session(…, certificate=…)"
            )
        if other := self._other(decider.made_for):
            raise InvalidArgument(f"the certificate does not count a search of something else: {other}")
        if (decider.thresholds, decider.max_touches) != (self.thresholds, self.max_touches):
            raise InvalidArgument(f"the search stopped by another certificate, with thresholds {decider.thresholds}")
        if session.digest in self.counted:
            raise InvalidArgument("the certificate counts a session once, and has counted this one before")
        fit = fit_of_search(session.target, session.steps, session.model)
        return replace(self, since=(*self.since, fit), counted=(*self.counted, session.digest))

    def wrap(self, decider: Decider, made_for: Mapping[str, Any]) -> Certified:
        """The decider, with the stops of this certificate.

        Args:
            decider: the decider that it was made for.
            made_for: what it will be used for, in the form of the attribute.

        Raises:
            NotCertified: it was withdrawn, or made for something else; the message says what differs.
        """
        self.require(made_for)
        return Certified(decider, self.thresholds, self.max_touches, self.made_for)

    def require(self, made_for: Mapping[str, Any]) -> None:
        """Check that it holds for what it will be used for; raises as :meth:`wrap`."""
        if self.is_withdrawn:
            raise NotCertified(self._withdrawal)
        if other := self._other(made_for):
            raise NotCertified(
                f"the certificate does not hold here, because it was made for something else: {other}. "
                "Make one with activetouch certify"
            )

    def _other(self, made_for: Mapping[str, Any]) -> str:
        """How something differs from what the certificate was made for, in words; empty if it does not."""
        names = dict.fromkeys([*self.made_for, *made_for])
        other = [name for name in names if self.made_for.get(name) != made_for.get(name)]
        return "; ".join(f"the {name}: {_differing(self.made_for.get(name), made_for.get(name))}" for name in other)

    def save(self, path: str | Path) -> None:
        """Write the certificate as JSON with a digest; raises CannotWrite."""
        write_text(Path(path), sealed_json({"schema": SCHEMA, **to_fields(self)}) + "\n")

    @classmethod
    def opened(cls, certificate: str | Path | Certificate) -> Certificate:
        """A certificate, or the one in a file; raises as :meth:`load`."""
        return certificate if isinstance(certificate, Certificate) else cls.load(certificate)

    @classmethod
    def load(cls, path: str | Path) -> Certificate:
        """The certificate of a file.

        Raises:
            FileNotFoundError: there is no file.
            CorruptFile: it is no certificate, or was changed after it was written.
        """
        file = require_regular_file(Path(path))
        try:
            given = unsealed_json(file.read_text(encoding="utf-8"))
            if (schema := given.pop("schema", None)) != SCHEMA:
                raise ValueError(f"its schema is {schema!r}, not {SCHEMA!r}")
            return from_fields(cls, given)
        except FileNotFoundError:
            raise FileNotFoundError(f"there is no certificate {file}; make it with activetouch certify") from None
        except (OSError, ValueError, TypeError, LookupError) as error:
            raise CorruptFile(f"{file} is no certificate: {error}") from error


def _differing(mine: Any, other: Any) -> str:
    """How two values of JSON types differ, in a few words."""
    if isinstance(mine, Mapping) and isinstance(other, Mapping):
        names = [name for name in dict.fromkeys([*mine, *other]) if mine.get(name) != other.get(name)]
        return f"other {', '.join(names)}"
    one, two = str(mine), str(other)
    place = next((place for place, (a, b) in enumerate(zip(one, two, strict=False)) if a != b), 0)
    start = max(place - 30, 0)  # long texts are alike up to there
    return f"{one[start:]:.90}, not {two[start:]:.90}"
