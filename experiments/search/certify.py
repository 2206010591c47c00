"""``activetouch certify``: bound the error of confirmed objects at every number of touches, by calibration searches."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import tyro
from numpy.typing import NDArray

from activetouch import Scene, TactileSensor
from activetouch.named_scenes import NamedScene
from belief.constraints import Fraction, Within
from belief.errors import ActiveTouchError
from belief.files import in_file_name, require_writable_file
from belief.observation_model.model import ObservationModel
from belief.references import ForeignCode
from belief.seeding import keyed_rng
from belief.statistics.stop_thresholds import CandidateStops, certified_thresholds, least_searches
from experiments.command_line.arguments import BadArgument, Cluster, Count, Jobs, OnCluster, Seed, check_arguments
from experiments.parallel import Shared, Task, default_jobs, run_tasks
from experiments.search.comparison import prepared, setting_of
from experiments.search.play import EPISODES_PER_BATCH, CompositionName, Searches, Setting, play_episodes
from experiments.search.run import RunMismatch, differing
from planners import Decider, Episode
from planners.certified import NEVER, WANTED, Certificate, Certified, Fit, fit_of_search

_SEEDS = 0xCE47 << 32  # added to the seed: no comparison plays the searches of a certificate
Searched = Annotated[int, Within(2, 10**8)]


class TooFewSearches(ActiveTouchError, ValueError):
    """Calibration searches are too few, or err too often, to certify any stop."""


class CalibrationSearch(NamedTuple):
    """A search that confirms nothing, from which the search with any certificate can be read.

    ``stops`` are the moments at which an object could have been confirmed: touches of the object, stated probability,
    whether it is wrong, and touches of the whole search before.
    """

    stops: list[tuple[int, float, bool, int]]
    num_touches: int
    fit: Fit


def play_calibration(
    searches: Searches,
    decider: Decider,
    num_searches: int,
    targets: Sequence[str],
    max_touches: int,
    jobs: int | None = None,
) -> list[CalibrationSearch]:
    """Play searches that confirm nothing, each with a target drawn uniformly, so that they are independent and alike.

    A search ends when an object has been touched ``max_touches`` times.
    """
    labels = list(searches.problem.shape_labels)
    searches = replace(searches, seed=searches.seed + _SEEDS)
    drawn = keyed_rng([searches.seed]).choice([labels.index(target) for target in targets], num_searches)
    player: Decider = Certified(decider, NEVER, max_touches)
    shared, tasks = Shared((searches, player)), list[Task[dict[int, CalibrationSearch]]]()
    for target in np.unique(drawn).tolist():
        places = np.flatnonzero(drawn == target)
        for first in range(0, len(places), EPISODES_PER_BATCH):
            tasks.append(partial(_play_batch, shared, target, first, places[first : first + EPISODES_PER_BATCH]))
    found: dict[int, CalibrationSearch] = {}
    for batch in run_tasks(tasks, jobs, "calibrating"):
        found |= batch
    return [found[place] for place in range(num_searches)]


def _play_batch(
    shared: Shared[tuple[Searches, Decider]], target: int, first: int, places: NDArray[np.int64]
) -> dict[int, CalibrationSearch]:
    """The episodes of a target from number ``first`` on, by their places among all searches."""
    searches, decider = shared.value
    with ForeignCode(f"in a calibration search, target {searches.problem.shape_labels[target]}"):
        episodes, _ = play_episodes(searches, decider, target, range(first, first + len(places)))
    model = searches.sensor.model
    return {place: _read(episode, model) for place, episode in zip(places.tolist(), episodes, strict=True)}


def _read(episode: Episode, model: ObservationModel) -> CalibrationSearch:
    found, spent, on_object = [], 0, Counter[int]()
    for step in episode.steps:
        index, scores = step.object_index, step.decision.scores
        if WANTED in scores:
            found.append((on_object[index], scores[WANTED], episode.arrangement[index] != episode.target, spent))
        spent += step.touch is not None
        on_object[index] += step.touch is not None
    return CalibrationSearch(found, spent, fit_of_search(episode.target, episode.steps, model))


def candidate_stops(played: Sequence[CalibrationSearch]) -> CandidateStops:
    """All moments at which the searches could have confirmed."""
    rows = [(number, *stop[:3]) for number, search in enumerate(played) for stop in search.stops]
    searches, touches, probs, is_wrong = np.reshape(rows, (-1, 4)).T
    return CandidateStops(searches, touches, probs, is_wrong, len(played))


def certify(
    scene: str | Scene | NamedScene = "gel",
    decider: str = "information_gain",
    *,
    risk: float = 0.05,
    confidence: float = 0.9,
    searches: int = 2000,
    seed: int = 0,
    targets: Sequence[str] | str = (),
    sensor: str | Path | TactileSensor | None = None,
    out: str | Path | None = None,
    num_objects: int | None = None,
    composition: CompositionName | None = None,
    touch_cost: float = 0.02,
    unlisted: float = 0.0,
    max_touches: int = 6,
    anyway: bool = False,
    jobs: int | None = None,
) -> Certificate:
    """Bound the error of confirmed objects at every number of touches, by simulated calibration searches.

    With probability ``confidence`` over the calibration searches, P(wrong | confirmed after k touches) ≤ ``risk`` for
    every k, over searches of the same world for a target drawn uniformly from ``targets``
    (:mod:`belief.statistics.stop_thresholds`, docs/certificate.md).

    Args:
        scene: name of a scene, or a scene object.
        decider: its name, with settings, as ``compare --deciders`` takes it.
        risk: α, in (0, 1).
        confidence: of the promise, in (0, 1).
        searches: number of calibration searches.
        seed: of these; comparisons with the same seed play other searches.
        targets: shapes to search for, each equally often, or one; all by default.
        sensor: as of :func:`activetouch.compare`.
        out: file to write; none by default.
        num_objects: number of objects in a search; that of the scene by default.
        composition: as of :func:`activetouch.compare`.
        touch_cost: cost λ of one touch, in units of a success.
        unlisted: as of :func:`activetouch.compare`; 0.05 for :func:`activetouch.find`.
        max_touches: of one object, after which it is not touched again for the certificate.
        anyway: whether to accept a sensor that was made for another scene.
        jobs: number of processes; all cores by default.

    Returns:
        The certificate, which prints as a table.

    Raises:
        BadArgument: an argument is invalid.
        TooFewSearches: no stop can be certified from so many searches.
        RunMismatch: ``out`` holds another certificate.
        ActiveTouchError: as :func:`activetouch.compare`.

    Example::

        certificate = activetouch.certify("coarse", risk=0.05, searches=1000)
        activetouch.compare("coarse", "information_gain", certificate=certificate)
    """
    rules = {"num_objects": num_objects, "composition": composition, "touch_cost": touch_cost}
    rules |= {"unlisted": unlisted}
    setting, named, own = setting_of(scene, sensor, **rules, anyway=anyway)
    asked = Certify(
        decider,
        risk,
        confidence,
        searches,
        seed,
        (targets,) if isinstance(targets, str) else tuple(targets),
        max_touches,
        setting,
        None if out is None else Path(out),
        default_jobs() if jobs is None else jobs,
    )
    return asked.certificate(named, own)


@dataclass(frozen=True)
class Certify:
    """Bound the error of confirmed objects at every number of touches, by simulated calibration searches.

    Writes a certificate, by which compare --certificate and sessions stop.

    For example:

        activetouch certify --scene coarse --decider information_gain --risk 0.05
        activetouch certify --scene coarse --risk 0.01 --searches 4000 --out runs/coarse-0.01.json
        activetouch compare --scene coarse --deciders information_gain --certificate runs/coarse-0.01.json
    """

    decider: str = "information_gain"
    """The decider, with settings as in 'information_gain(confirm=0.97)'."""
    risk: Fraction = 0.05
    """Largest probability that a confirmed object is wrong, at every number of touches."""
    confidence: Fraction = 0.9
    """Probability, over the calibration searches, with which the promise holds."""
    searches: Searched = 2000
    """Number of calibration searches."""
    seed: Seed = 0
    """Seed of the calibration searches; comparisons with the same seed play others."""
    targets: tuple[str, ...] = ()
    """Shapes to search for, each equally often; all by default."""
    max_touches: Count = 6
    """Touches of one object, after which it is not touched again for the certificate."""
    setting: tyro.conf.OmitArgPrefixes[Setting] = field(default_factory=Setting)
    """Sensor and rules of all searches."""
    out: Path | None = None
    """File to write; by default certificate-DECIDER-RISK.json in the working folder."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes; the result does not depend on it."""
    cluster: OnCluster = field(default_factory=Cluster)
    """Workers of other machines."""

    def run(self) -> None:
        """Play the calibration searches, print the certificate and write it; raises as :func:`certify`."""
        name = f"certificate-{in_file_name(self.decider, '-')}-{self.risk:g}.json"
        out = Path(name) if self.out is None else self.out
        print(replace(self, out=out).certificate())
        print(f"certificate: {out}")

    def certificate(self, named: NamedScene | None = None, own_sensor: TactileSensor | None = None) -> Certificate:
        """Play the calibration searches, write the certificate; ``named`` and ``own_sensor`` replace the setting's."""
        check_arguments(self)
        if not isinstance(self.decider, str):
            raise BadArgument(
                f"a certificate is for a decider by name, such as 'information_gain', got {self.decider!r:.80}"
            )
        if self.searches < (least := least_searches(self.risk, self.confidence)):
            raise TooFewSearches(
                f"at least {least} calibration searches are needed for a risk of {self.risk:g} with confidence "
                f"{self.confidence:g}, got {self.searches}: play more --searches, or accept more --risk"
            )
        if named is None and self.setting.choice.is_tray:
            return self._in_a_tray()
        if self.setting.abstain is not None:
            raise BadArgument("a certificate says itself when a decider is unsure: leave out --abstain")
        run = prepared(
            *(self.setting, self.decider, named, own_sensor), targets=self.targets, seed=self.seed, jobs=self.jobs
        )
        player = run.deciders[self.decider]
        searches = replace(run.searches, problem=run.searches.problem.with_unsure())
        world = searches.sensor.certified_world(searches.problem, run.targets, self.decider, player, run.known)
        self._require_free(world, self.max_touches)
        played = play_calibration(searches, player, self.searches, run.targets, self.max_touches, self.jobs)
        candidates = candidate_stops(played)
        found = certified_thresholds(candidates, self.risk, self.confidence)
        if not np.isfinite(found.thresholds).any():
            stops, wrong = candidates.counts([0.0])
            raise TooFewSearches(
                f"{self.searches} searches certify no stop of {self.decider} at a risk of {self.risk:g} with "
                f"confidence {self.confidence:g}: {wrong[0]} of its {stops[0]} confirmations are wrong, and at least "
                f"{least} searches without an error are needed; play more --searches, or accept more --risk"
            )
        certificate = Certificate(
            *(self.decider, self.risk, self.confidence, self.searches),
            *(found.thresholds, found.stops, found.wrong, self.max_touches),
            made_for=world,
            usual=tuple(search.fit for search in played),
            seed=self.seed,
        )
        return self._saved(certificate)

    def _in_a_tray(self) -> Certificate:
        """The certificate of both answers of searches in a tray, which go on until nothing is left to tell."""
        from experiments.search.drawer.drawer import play  # whose modules no other scene needs
        from experiments.search.drawer.searches import Searches as TraySearches
        from planners.tray_session import ANSWERS, SUREST
        from planners.tray_session import candidate_stops as stops_in_trays

        searches = TraySearches.of(self.setting, self.seed + _SEEDS)
        sensor, rules = searches.made(), searches.rules
        labels = list(self.targets or sensor.shape_labels)
        world = sensor.certified_world(labels, self.decider)
        self._require_free(world, rules.most_touches)
        drawn = keyed_rng([searches.seed]).choice(labels, self.searches).tolist()
        searches = replace(searches, rules=replace(rules, sure=SUREST, sure_absent=SUREST))
        found = play(searches, [self.decider], drawn, self.searches, jobs=self.jobs).episodes[self.decider]
        stops = certified_thresholds(stops_in_trays(found), self.risk, self.confidence, answers=ANSWERS)
        if not np.isfinite(stops.thresholds).all():
            raise TooFewSearches(f"{stops.note} Play more --searches, or accept more --risk")
        counts = stops.thresholds, stops.stops, stops.wrong, rules.most_touches
        about = self.decider, self.risk, self.confidence, self.searches
        return self._saved(Certificate(*about, *counts, made_for=world, answers=ANSWERS, seed=self.seed))

    def _require_free(self, world: dict[str, Any], max_touches: int) -> None:
        """Refuse, before anything is played, a file that holds another certificate, or one with searches since."""
        if self.out is None:
            return
        require_writable_file(self.out)
        if not self.out.exists():
            return
        held, words = Certificate.load(self.out), ("--risk", "--confidence", "--searches", "--seed", "--max-touches")
        there = held.risk, held.confidence, held.num_searches, held.seed, held.max_touches
        here = self.risk, self.confidence, self.searches, self.seed, max_touches
        one, other = (dict(zip(words, each, strict=True)) for each in (there, here))
        one["searches counted since"], other["searches counted since"] = len(held.since), 0
        if differs := differing({**held.made_for, **one}, world | other):
            raise RunMismatch(f"{self.out} holds another certificate: {differs}. Choose another --out, or delete it")

    def _saved(self, certificate: Certificate) -> Certificate:
        if self.out is not None:
            certificate.save(self.out)
        return certificate
