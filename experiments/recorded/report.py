"""The result of ``recorded``: its verdict, and the files of a page, tables, numbers, searches and figures."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from belief.files import write_text
from belief.table import Table, interval
from experiments.recorded.identifying import FIXED, GAIN, RANDOM
from experiments.recorded.leaks import doubts
from experiments.recorded.results import Measured, by_object, num_touches, saving

_FEW = 6  # names in a sentence
_MOSTLY = 0.5  # share of objects that reach the threshold, below which a mean number of touches tells little


@dataclass(frozen=True, eq=False)
class RecordedReport:
    """Identifications and searches among recorded objects; it prints as a verdict and tables.

    Attributes:
        measured: the results.
        facts: about the set and the settings, of JSON types.
    """

    measured: Measured
    facts: Mapping[str, Any]

    def tables(self) -> list[Table]:
        """The tables of the report."""
        return self.measured.tables()

    def verdict(self) -> list[str]:
        """Sentences that say what was found."""
        measured = self.measured
        sentences = self._touches_to_name()
        if len(self.facts["actions"]) == 1:
            sentences.append("There is one action, so that deciders have nothing to choose.")
        else:
            gain = measured.named_by(GAIN)
            saved = {name: interval(*saving(gain, measured.named_by(name)), spec=".1%") for name in (RANDOM, FIXED)}
            sentences.append(
                f"Without being less accurate, information gain saves {saved[RANDOM]} of the touches of a random "
                f"order, and {saved[FIXED]} of those of the best fixed order."
            )
        sentences += doubts(measured.controls)
        for law, words in (("none", "If touches count as independent"), ("kernel", "With fitted correlations")):
            both = [one for name in (RANDOM, GAIN) for one in measured.named if (one.decider, one.law) == (name, law)]
            certain = [one.result for one in both if one.result.is_certain]
            if certain:
                stated, right = np.mean([(one.stated, one.is_right) for one in certain], axis=0)
                sentences.append(
                    f"{words}, the {len(certain)} stops of random order and information gain that reach it state "
                    f"{stated:.3f} and are right in {right:.3f}."
                )
        return [*sentences, *self._misread()]

    def __str__(self) -> str:
        texts = [f"# {self._title()}", *self.verdict(), *self._about(), *(table.markdown() for table in self.tables())]
        return "\n\n".join(texts)

    def save(self, folder: Path) -> None:
        """Write report.html, recorded.md, results.json, episodes.jsonl, tables and figures into a folder.

        Raises:
            CannotWrite: the disk is full, or the folder cannot be written.
        """
        from experiments.recorded.figures import pictures  # loads matplotlib
        from experiments.reporting.page import Section, write_page

        tables, drawn, verdict = self.tables(), pictures(self.measured), self.verdict()
        sections = [
            Section("Result", verdict, tables[:1], drawn[:1]),
            Section("Correlation of touches", (), tables[1:3], drawn[1:]),
            *([Section("Searches", (), tables[3:4])] if self.measured.found else []),
            Section("Leak controls", (), tables[-1:]),
            Section("The set", self._about()),
        ]
        write_page(folder / "report.html", self._title(), sections)
        for picture in drawn:
            picture.write(folder)
        for table in tables:
            table.write_csv(folder / f"{table.name}.csv")
        write_text(folder / "recorded.md", f"{self}\n")
        kernels = [fold.models["kernel"].kernel.tolist() for fold in self.measured.folds]
        rows = {table.name: [list(row) for row in table.rows] for table in tables}
        result = {**self.facts, "verdict": verdict, "kernels": kernels, "tables": rows}
        write_text(folder / "results.json", json.dumps(result, indent=1, ensure_ascii=False) + "\n")
        found = self.measured.found
        episodes = [{"decider": one.decider, "scene": one.scene, **one.episode.to_dict()} for one in found]
        write_text(folder / "episodes.jsonl", "".join(json.dumps(episode) + "\n" for episode in episodes))

    def _title(self) -> str:
        return f"Recorded touches: {self.facts['name']}, {self.facts['task']}"

    def _about(self) -> list[str]:
        facts, folds = self.facts, self.measured.folds
        chosen = Counter(name for fold in folds for name in fold.reading.reader.chosen)
        task = "" if facts["task"] == "objects" else f" of {facts['labels']} {facts['task']}"
        order = f"Best fixed order{' of the first split' * (len(folds) > 1)}: {', '.join(folds[0].order)}."
        return [
            f"{facts['touches']} touches of {facts['num_objects']} objects{task}; actions: "
            f"{', '.join(facts['actions'])}. Source: {facts['provenance']}; licence: {facts['licence']}.",
            "Classifiers by cross-validation, times chosen: "
            + "; ".join(f"{name} ({count})" for name, count in chosen.most_common())
            + f". {order}",
            *facts["notes"],
        ]

    def _touches_to_name(self) -> list[str]:
        """Which share of the objects is named with the threshold, and after how many touches if it is large."""
        chosen = {name: self.measured.named_by(name) for name in (GAIN, RANDOM, FIXED)}
        shares = {name: by_object(named, lambda one: one.is_certain)[0].mean() for name, named in chosen.items()}
        task, goal = self.facts["task"], f"probability {self.measured.threshold:g}"
        if min(shares.values()) < _MOSTLY:
            listed = ", ".join(f"{name} {share:.3f}" for name, share in shares.items())
            most = max(len(one.result.poses) for named in chosen.values() for one in named)
            return [
                f"Few {task} are named with {goal} within {most} touches: {listed} of all attempts. The others stay "
                "undecided, so that a mean number of touches says little."
            ]
        needed = {name: num_touches(named)[0].mean() for name, named in chosen.items()}
        listed = ", ".join(f"{name} {needed[name]:.2f} ({shares[name]:.3f})" for name in chosen)
        return [
            f"Mean touches to name one of {self.facts['labels']} {task} with {goal}, and the share of attempts that "
            f"reach it: {listed}. Attempts that do not reach it count with all their touches."
        ]

    def _misread(self) -> list[str]:
        """The objects that are mostly misread after the largest number of touches that was judged."""
        number = max(one.number for one in self.measured.after)
        chosen = [one for one in self.measured.after if one.law == "kernel" and one.number == number]
        right = np.concatenate([one.probs.argmax(axis=1) == one.labels for one in chosen])
        objects = np.concatenate([one.objects for one in chosen])
        names = self.measured.folds[0].touches.source.object_names
        shares = {names[index]: right[objects == index].mean() for index in np.unique(objects).tolist()}
        wrong = [f"{name} ({share:.2f} right)" for name, share in shares.items() if share < _MOSTLY]
        more = f" and {len(wrong) - _FEW} more" if len(wrong) > _FEW else ""
        listed = ", ".join(wrong[:_FEW]) + more
        return [f"After {number} touches, these are read wrongly more often than rightly: {listed}."] if wrong else []
