"""The result of ``recorded``: its verdict, its tables, and the files of a page, tables, numbers and searches."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # whose parts load at first use

from activetouch.recorded.checking import Leaks
from belief.statistics import cluster_bootstrap
from belief.table import Table, Value, interval
from belief.validation import Floats
from experiments.recorded.play import FIXED, GAIN, RANDOM, Fold, Found, Named
from experiments.report import Report, Reported, Section
from experiments.sensor.scores import accuracy_of_objects
from planners.search import Identification

RESULTS = "results.json"
_MOSTLY = 0.5  # share of objects that reach the threshold, below which a mean number of touches tells little
_WIDE, _LEAST = 0.1, 6  # width of an interval below what is stated that shows little; pairs that show a difference


@dataclass(frozen=True, eq=False)
class RecordedReport(Reported):
    """Identifications and searches among recorded objects, in some splits; it prints as a verdict and tables.

    ``facts`` are about the set and the settings, of JSON types; ``leaks`` are accuracies of guesses and controls.
    """

    folds: Sequence[Fold]
    named: Sequence[Named]
    found: Sequence[Found]
    facts: Mapping[str, Any]
    leaks: Leaks

    def tables(self) -> list[Table]:
        """The tables of the report."""
        return [self._identification(), *([search_table(self.found)] if self.found else [])]

    def verdict(self) -> list[str]:
        """Sentences that say what was found."""
        warnings = [f"{text[0].upper()}{text[1:]}." for text in self.leaks.warnings()]
        sentences = [*self._guess(), *warnings, *trust(self.named), *self._best(), self.leaks.summary()]
        order = [name for name in (GAIN, RANDOM, FIXED) if name in self.deciders()]
        shares = {name: self._mean(name, lambda one: one.is_certain) for name in order}
        task, goal = self.facts["task"], f"probability {self.facts['threshold']:g}"
        if min(shares.values()) < _MOSTLY:
            listed = ", ".join(f"{name} {share:.3f}" for name, share in shares.items())
            most = max(len(one.result.poses) for one in self.named)
            sentences.append(
                f"Few {task} are named with {goal} within {most} touches: {listed} of all attempts. The others stay "
                "undecided, so that a mean number of touches says little."
            )
        else:
            needed = {name: self._mean(name, lambda one: len(one.poses)) for name in shares}
            listed = ", ".join(f"{name} {needed[name]:.2f} ({shares[name]:.3f})" for name in shares)
            sentences.append(
                f"Mean touches to name one of {self.facts['labels']} {task} with {goal}, and the share of "
                f"attempts that reach it: {listed}. Attempts that do not reach it count with all their touches."
            )
        if len(order) == 1:
            sentences.append(
                "There is one action, so that deciders have nothing to choose: random order, best fixed order and "
                "information gain are the same, and one row shows them."
            )
        scenes = len({one.scene for one in self.found})
        if scenes < (wanted := self.facts["scenes"] * len(self.folds)):
            sentences.append(
                f"{wanted - scenes} of {wanted} scenes are left out: their objects have no action in common, or the "
                f"split has fewer than {self.facts['objects']} {task}."
            )
        return sentences

    def _guess(self) -> list[str]:
        """A sentence where neither one touch nor all of an identification show more than a guess."""
        shares, objects = by_object(self.named, lambda one: one.is_right)
        right, low, high = accuracy_of_objects(shares, objects, np.random.default_rng(0))
        guess = 1.0 / self.facts["labels"]
        if low > guess or not self.leaks.is_guess:
            return []
        return [
            f"Do not trust these probabilities: {interval(right, low, high)} of the names are right, a guess is in "
            f"{guess:.3f}: no better than guessing."
        ]

    def _best(self) -> list[str]:
        """Sentences that name the best decider of identifications and of searches."""
        fewest = {name: -by_object(self._by(name), lambda one: len(one.poses))[0] for name in self.deciders()}
        return_of, shown = dict[str, Floats](), _shown(self.found)
        for name in shown:
            scenes, rewards = np.array([(one.scene, one.reward) for one in self.found if one.decider == name]).T
            return_of[shown[name]] = _means(rewards, scenes)[0]
        texts = {"Fewest touches until an object is named": fewest, "Largest return of searches": return_of}
        return [best_of(text, values) for text, values in texts.items() if len(values) > 1]

    def report(self) -> Report:
        """Verdict, tables and the set, with ``results.json`` and ``episodes.jsonl``."""
        tables, verdict = self.tables(), self.verdict()
        sections = [Section("Result", verdict, tables[:1])]
        sections += [Section("Searches", (), [table]) for table in tables[1:]]
        sections += [Section("The set", self._about())]
        result = {
            **self.facts,
            "verdict": verdict,
            "leaks": {
                "guess": self.leaks.guess,
                **self.leaks.groups,
                "single features": dict(zip(self.leaks.names, self.leaks.single.tolist(), strict=True)),
                "variance within objects": dict(zip(self.leaks.names, self.leaks.within.tolist(), strict=True)),
            },
            "kernels": [fold.model.kernel.tolist() for fold in self.folds],
            "tables": {table.name: [list(row) for row in table.rows] for table in tables},
        }
        episodes = [{"decider": one.decider, "scene": one.scene, **one.episode.to_dict()} for one in self.found]
        files = {
            RESULTS: json.dumps(result, indent=1, ensure_ascii=False) + "\n",
            "episodes.jsonl": "".join(json.dumps(episode) + "\n" for episode in episodes),
        }
        title = f"Recorded touches: {self.facts['name']}, {self.facts['task']}"
        return Report(title, sections, markdown="recorded.md", files=files)

    def _about(self) -> list[str]:
        facts, folds = self.facts, self.folds
        chosen = Counter(name for fold in folds for name in fold.reading.reader.chosen)
        labels = "" if facts["task"] == "objects" else f" of {facts['labels']} {facts['task']}"
        which = " of the first split" * (len(folds) > 1)
        return [
            f"{facts['touches']} touches of {facts['num_objects']} objects{labels}; actions: "
            f"{', '.join(facts['actions'])}. Source: {facts['provenance']}; licence: {facts['licence']}.",
            "Classifiers by cross-validation, times chosen: "
            + "; ".join(f"{name} ({count})" for name, count in chosen.most_common())
            + f". Best fixed order{which}: {', '.join(folds[0].order)}.",
            *facts["notes"],
        ]

    def deciders(self) -> list[str]:
        """The names of the rules that chose actions, in the order of the table."""
        return list(dict.fromkeys(one.decider for one in self.named))

    def _by(self, decider: str) -> list[Named]:
        return [one for one in self.named if one.decider == decider]

    def _mean(self, decider: str, value: Callable[[Identification], float]) -> float:
        return float(by_object(self._by(decider), value)[0].mean())

    def _identification(self) -> Table:
        rows: list[Sequence[Value]] = []
        for decider in self.deciders():
            chosen = self._by(decider)
            touches = cluster_bootstrap(*by_object(chosen, lambda one: len(one.poses)), np.random.default_rng(0))
            right = accuracy_of_objects(*by_object(chosen, lambda one: one.is_right), np.random.default_rng(0))
            certain = self._mean(decider, lambda one: one.is_certain)
            stops = [one for one in chosen if one.result.is_certain]
            cells = ["–", "–"]
            if stops:
                known, objects = np.array([(one.result.is_right, one.object_index) for one in stops]).T
                share = accuracy_of_objects(known, objects, np.random.default_rng(0))
                cells = [f"{np.mean([one.result.stated for one in stops]):.3f}", interval(*share)]
            shown = decider if len(self.deciders()) > 1 else "the only action"
            rows.append((shown, interval(*touches, spec=".2f"), interval(*right), certain, *cells))
        how = "by later recordings" if self.facts["task"] == "objects" else "of unseen objects"
        rows.append(("no touch: a guess", "0", f"{1 / self.facts['labels']:.3f}", 0.0, "–", "–"))
        return Table(
            f"Identification {how}: touches until a label has probability {self.facts['threshold']:g}",
            ("decider", "touches [95 %]", "right [95 %]", ("reached it", ".3f"), "these: stated", "right [95 %]"),
            rows,
            "Intervals resample objects.",
            "identification",
        )


def by_object(chosen: Sequence[Named], value: Callable[[Identification], float]) -> tuple[Floats, np.ndarray]:
    """Mean of a value over the identifications of each object, and the objects, so that every object counts equally."""
    objects = np.array([one.object_index for one in chosen])
    values = np.array([value(one.result) for one in chosen], np.float64)
    return _means(values, objects)


def _means(values: Floats, groups: np.ndarray) -> tuple[Floats, np.ndarray]:
    known = np.unique(groups)
    return np.array([values[groups == index].mean() for index in known]), known


def trust(named: Sequence[Named]) -> list[str]:
    """A sentence that compares what stops state with what is right; none without stops."""
    stops = [one for one in named if one.decider != FIXED and one.result.is_certain]
    if not stops:
        return []
    known, objects, said = np.array([(one.result.is_right, one.object_index, one.result.stated) for one in stops]).T
    (right, low, high), stated = accuracy_of_objects(known, objects, np.random.default_rng(0)), float(said.mean())
    word = "are lower than what is right" if stated < low else "agree with what is right"
    if is_weak := stated > min(high, low + _WIDE):
        word = "cannot be judged by so few objects"
    of = " of random order and information gain" * any(one.decider == GAIN for one in named)
    doubt = "Do not trust these probabilities, which are too high" if stated > high else f"Stated probabilities {word}"
    return [
        f"{doubt}: {len(stops)} stops{of} at {len(np.unique(objects))} objects state {stated:.3f} "
        f"and are right in {interval(right, low, high)}{'; record more sessions or objects' * is_weak}."
    ]


def best_of(text: str, values: Mapping[str, Floats]) -> str:
    """Which rule has the largest mean of paired values ``(n,)``, by t-tests at 5 % over the number of other rules."""
    best, alike = max(values, key=lambda name: values[name].mean()), list[str]()
    for name in sorted(set(values) - {best}):
        gain = values[best] - values[name]
        ratio = gain.mean() / max(gain.std() / np.sqrt(max(len(gain) - 1, 1)), 1e-12)
        if len(gain) < _LEAST or 2.0 * scipy.special.stdtr(len(gain) - 1, -ratio) >= 0.05 / (len(values) - 1):
            alike.append(name)
    if len(alike) == len(values) - 1:
        return f"{text}: no difference between {', '.join(values)} was found."
    return f"{text}: {best}" + f"; from {', '.join(alike)} no difference was found" * bool(alike) + "."


def _shown(found: Sequence[Found]) -> dict[str, str]:
    """Names of deciders in tables: without their settings, where these do not tell them apart."""
    words = {name: name.split("(")[0] for name in dict.fromkeys(one.decider for one in found)}
    return {name: word if list(words.values()).count(word) == 1 else name for name, word in words.items()}


def search_table(found: Sequence[Found]) -> Table:
    """Searches for a target among objects of known, different labels."""
    rows: list[Sequence[Value]] = []
    for name, shown in _shown(found).items():
        chosen = [one for one in found if one.decider == name]
        scenes, rng = np.array([one.scene for one in chosen]), np.random.default_rng(0)
        success = accuracy_of_objects(np.array([one.episode.success for one in chosen]), scenes, rng)
        touches = cluster_bootstrap([one.episode.num_touches for one in chosen], scenes, rng)
        reward = cluster_bootstrap([one.reward for one in chosen], scenes, rng)
        rows.append((shown, interval(*success), interval(*touches, spec=".2f"), interval(*reward), len(chosen)))
    guess = 1.0 / len(found[0].episode.arrangement)
    rows.append(("no touch: a guess", f"{guess:.3f}", "0", f"{2.0 * guess - 1.0:.3f}", None))
    return Table(
        "Searches: find the target among objects of known, different labels",
        ("decider", "success [95 %]", "touches [95 %]", "return [95 %]", "searches"),
        rows,
        "Success is 1, failure -1, a touch costs 0.02. Intervals resample scenes; those of touches and returns are too "
        "narrow for few scenes.",
        "searches",
    )
