"""Stops with a certificate: an object is confirmed only where calibration searches have bounded the error.

What is promised, over what randomness, and with what confidence: :mod:`belief.statistics.stop_thresholds` and
docs/certificate.md.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from belief.errors import ActiveTouchError, CorruptFile, InvalidArgument
from belief.files import require_regular_file, sealed_json, unsealed_json, write_text
from belief.problem import Confirm, Probe, Unsure
from belief.validation import require_count
from planners.answers import checked_decision
from planners.decider import Decider, Decision, InformationState, are_touches_used

SCHEMA = "activetouch certificate 1"
WANTED = "confirm_prob"
"""Score of a decision where the decider would confirm: the stated probability that this is right."""
NEVER = (math.inf,)
"""Thresholds with which nothing is confirmed: calibration searches list all that could be."""


class NotCertified(ActiveTouchError, ValueError):
    """A certificate does not hold for what it is used with."""


@dataclass(frozen=True)
class Certified:
    """Follows any decider, but confirms only at a threshold that depends on the touches of the object.

    Where the decider would confirm below the threshold, the object is touched again, in the pose that was used least.
    After ``max_touches`` of the object, or at the touch limit of the search, the answer is "I do not know". So two sets
    of thresholds give the same search up to its end, and the stops of all of them can be read from one search with
    :data:`NEVER`. Rejections are the decider's; nothing is promised about them.

    Attributes:
        decider: the decider that is followed.
        thresholds: stated probability of the target from which an object is confirmed, by the number of its touches;
            the last one is for so many and more; infinite for never.
        max_touches: touches of one object after which it is not touched again, at least 1.

    Raises:
        InvalidArgument: no threshold, or a number out of its range; in :meth:`decide`, the search does not have the
            answer "I do not know".
    """

    decider: Decider
    thresholds: tuple[float, ...]
    max_touches: int = 6

    def __post_init__(self) -> None:
        if not self.thresholds or not all(threshold >= 0.0 for threshold in self.thresholds):
            raise InvalidArgument(f"thresholds must be one or more numbers ≥ 0, got {self.thresholds!r}")
        require_count("max_touches", self.max_touches)

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`."""
        if info.problem.unsure_reward is None:
            raise InvalidArgument(
                "stops with a certificate need a search with the answer 'I do not know': "
                "SearchProblem(unsure_reward=0.0)"
            )
        wanted = checked_decision(self.decider.decide(info, rng), self.decider, info.problem)
        if not isinstance(wanted.action, Confirm):
            return wanted
        touches, prob = len(info.history), min(info.target_prob, 1.0)
        scores = {**wanted.scores, WANTED: prob}
        if prob >= self.thresholds[min(touches, len(self.thresholds) - 1)]:
            return Decision(wanted.action, scores)
        if touches >= self.max_touches or are_touches_used(info):
            return Decision(Unsure(), {**scores, "is_uncertified": 1.0})
        return Decision(Probe(int(info.uses.argmin())), {**scores, "overruled": 1.0})


@dataclass(frozen=True)
class Certificate:
    """Thresholds for the stops of one decider with one sensor in one world, and what they were made from.

    With probability ``confidence`` over the calibration searches, P(wrong | confirmed after k touches) ≤ ``risk`` for
    every k, over searches of the world that is named: its objects, and a target drawn uniformly from its targets.

    Attributes:
        decider: its name, with settings.
        risk: α.
        confidence: of the promise.
        num_searches: calibration searches; half of them proposed the thresholds, the others tested them.
        thresholds: as of :class:`Certified`.
        stops: stops in the testing half, by number of touches as ``thresholds``.
        wrong: wrong ones among these.
        max_touches: as of :class:`Certified`.
        abstain: false-alarm rate and promise of the conflict test (:class:`planners.abstaining.Abstaining`) with which
            the decider was followed; None without the test.
        made_for: JSON types that name the world, the objects, the decider, the sensor and the rules.
    """

    decider: str
    risk: float
    confidence: float
    num_searches: int
    thresholds: tuple[float, ...]
    stops: tuple[int, ...]
    wrong: tuple[int, ...]
    max_touches: int
    abstain: tuple[float, float] | None
    made_for: Mapping[str, Any] = field(repr=False)

    def __str__(self) -> str:
        """The certificate as a table, with what it promises."""
        lines = [
            f"{self.decider}: P(wrong | confirmed after k touches) ≤ {self.risk:g} for every k, with confidence "
            f"{self.confidence:g}, from {self.num_searches} searches",
            f"{'touches':>9s}{'confirm at':>12s}{'stops':>8s}{'wrong':>8s}",
        ]
        for touches, threshold in enumerate(self.thresholds):
            name = f"≥ {touches}" if touches == len(self.thresholds) - 1 else str(touches)
            limit = f"{threshold:.6f}" if math.isfinite(threshold) else "never"
            lines.append(f"{name:>9s}{limit:>12s}{self.stops[touches]:8d}{self.wrong[touches]:8d}")
        return "\n".join(lines)

    def wrap(self, decider: Decider, made_for: Mapping[str, Any]) -> Certified:
        """The decider, with the stops of this certificate.

        Args:
            decider: the decider that it was made for.
            made_for: what it is to be used for, as the attribute.

        Raises:
            NotCertified: it was made for something else; the message says what differs.
        """
        names = dict.fromkeys([*self.made_for, *made_for])
        if other := [name for name in names if self.made_for.get(name) != made_for.get(name)]:
            told = "; ".join(f"the {name}: {_differing(self.made_for.get(name), made_for.get(name))}" for name in other)
            raise NotCertified(
                f"the certificate does not hold here, because it was made for something else: {told}. "
                "Make one with activetouch certify"
            )
        return Certified(decider, self.thresholds, self.max_touches)

    def save(self, path: str | Path) -> None:
        """Write the certificate as JSON with a digest; raises CannotWrite."""
        limits = [limit if math.isfinite(limit) else None for limit in self.thresholds]
        write_text(Path(path), sealed_json({"schema": SCHEMA, **asdict(self), "thresholds": limits}) + "\n")

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
            limits = tuple(math.inf if limit is None else float(limit) for limit in given["thresholds"])
            counts = {name: tuple(int(number) for number in given[name]) for name in ("stops", "wrong")}
            tested = None if given["abstain"] is None else (float(given["abstain"][0]), float(given["abstain"][1]))
            found = cls(**{**given, "thresholds": limits, **counts, "abstain": tested})
            if (
                not isinstance(found.made_for["targets"], list)
                or not len(limits) == len(found.stops) == len(found.wrong) > 0
            ):
                raise ValueError("its fields do not fit each other")
            return found
        except FileNotFoundError:
            raise FileNotFoundError(f"there is no certificate {file}; make it with activetouch certify") from None
        except (OSError, ValueError, TypeError, LookupError) as error:
            raise CorruptFile(f"{file} is no certificate: {error}") from error


def _differing(mine: Any, other: Any) -> str:
    """In which two values of JSON types differ, in a few words."""
    if isinstance(mine, Mapping) and isinstance(other, Mapping):
        names = [name for name in dict.fromkeys([*mine, *other]) if mine.get(name) != other.get(name)]
        return f"other {', '.join(names)}"
    return f"{mine!s:.90}, not {other!s:.90}"
