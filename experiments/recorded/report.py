"""The files of ``recorded``: a page, tables, numbers, searches and figures."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from belief.files import write_text
from experiments.recorded.figures import pictures
from experiments.recorded.identifying import FIXED, GAIN, RANDOM, Named
from experiments.recorded.leaks import doubts
from experiments.recorded.results import Measured, Part, by_thing, saving, touches_of
from experiments.reporting.page import Section, write_page
from experiments.reporting.tables import Table, interval

_FEW = 6  # names in a sentence
_MOSTLY = 0.5  # share of objects that reach the threshold, below which a mean number of touches tells little


def write_report(out: Path, measured: Measured, facts: Mapping[str, Any]) -> tuple[list[Table], list[str]]:
    """Write all files into a folder; return the tables and the sentences of the verdict.

    Args:
        out: folder.
        measured: the results.
        facts: about the set and the settings.
    """
    tables, main = measured.tables(facts["threshold"]), measured.main
    drawn = pictures(main, facts["threshold"])
    verdict = verdict_of(measured, facts)
    chosen = Counter(name for fold in main.folds for name in fold.reading.reader.chosen)
    about = [
        f"{facts['touches']} touches of {facts['things']} objects"
        + ("" if facts["task"] == "objects" else f" of {facts['labels']} {facts['task']}")
        + "; actions: "
        f"{', '.join(facts['actions'])}. Source: {facts['provenance']}; licence: {facts['licence']}.",
        "Classifiers by cross-validation, times chosen: "
        + "; ".join(f"{name} ({count})" for name, count in chosen.most_common())
        + f". Best fixed order{' of the first split' * (len(main.folds) > 1)}: {', '.join(main.folds[0].order)}.",
        *facts["notes"],
    ]
    sections = [
        Section("Result", verdict, tables[:1], drawn[:2]),
        Section("Correlation of touches", (), tables[1:4], drawn[2:]),
        *([Section("Searches", (), tables[4:5])] if main.found else []),
        Section("Leak controls", (), tables[-1:]),
        Section("The set", about),
    ]
    title = f"Recorded touches: {facts['format']}, {facts['task']}"
    write_page(out / "report.html", title, sections)
    for picture in drawn:
        picture.write(out)
    texts = [f"# {title}", *verdict, *about, *(table.markdown() for table in tables)]
    write_text(out / "recorded.md", "\n\n".join(texts) + "\n")
    for table in tables:
        table.write_csv(out / f"{table.name}.csv")
    kernels = [fold.models["kernel"].kernel.tolist() for fold in main.folds]
    result = {
        **facts,
        "verdict": verdict,
        "kernels": kernels,
        "tables": {t.name: [list(r) for r in t.rows] for t in tables},
    }
    write_text(out / "results.json", json.dumps(result, indent=1, ensure_ascii=False) + "\n")
    episodes = [{"decider": one.decider, "scene": one.scene, **one.episode.to_dict()} for one in main.found]
    write_text(out / "episodes.jsonl", "".join(json.dumps(episode) + "\n" for episode in episodes))
    return tables, verdict


def verdict_of(measured: Measured, facts: Mapping[str, Any]) -> list[str]:
    """Sentences that say what was found."""
    named = measured.main.named
    sentences = _touches_to_name(named, facts)
    if len(facts["actions"]) == 1:
        sentences.append(
            f"There is one action, so that deciders have nothing to choose among {facts['labels']} labels."
        )
    else:
        saved = {other: interval(*saving(named, GAIN, other), spec=".1%") for other in (RANDOM, FIXED)}
        sentences.append(
            f"Without being less accurate, information gain saves {saved[RANDOM]} of the touches of a random order, "
            f"and {saved[FIXED]} of those of the best fixed order."
        )
    sentences += doubts(measured.controls)
    for law, words in (("none", "If touches count as independent"), ("kernel", "With fitted correlations")):
        both = [one for one in named if one.law == law and one.decider in (RANDOM, GAIN)]
        certain = [one.result for one in both if one.result.is_certain]
        if certain:
            stated, right = np.mean([one.stated for one in certain]), np.mean([one.is_right for one in certain])
            sentences.append(
                f"{words}, the {len(certain)} stops of random order and information gain that reach it state "
                f"{stated:.3f} and are right in {right:.3f}."
            )
    number, wrong = misread(measured.main)
    if wrong:
        names = ", ".join(f"{name} ({share:.2f} right)" for name, share in wrong[:_FEW])
        names += f" and {len(wrong) - _FEW} more" if len(wrong) > _FEW else ""
        sentences.append(f"After {number} touches, these are read wrongly more often than rightly: {names}.")
    return sentences


def _touches_to_name(named: Sequence[Named], facts: Mapping[str, Any]) -> list[str]:
    """Which share of the objects is named with the probability asked for, and after how many touches if it is large."""
    deciders = (GAIN, RANDOM, FIXED)
    chosen = {name: [one for one in named if (one.decider, one.law) == (name, "kernel")] for name in deciders}
    shares = {name: float(by_thing(some, lambda one: one.is_certain)[0].mean()) for name, some in chosen.items()}
    needed = {name: float(touches_of(named, name, "kernel")[0].mean()) for name in deciders}
    goal = f"probability {facts['threshold']:g}"
    if min(shares.values()) < _MOSTLY:
        listed = ", ".join(f"{name} {shares[name]:.3f}" for name in deciders)
        most = max(len(one.result.poses) for some in chosen.values() for one in some)
        return [
            f"Few {facts['task']} are named with {goal} within {most} touches: {listed} of all attempts. The others "
            "stay undecided, so that a mean number of touches says little."
        ]
    listed = ", ".join(f"{name} {needed[name]:.2f} ({shares[name]:.3f})" for name in deciders)
    return [
        f"Mean touches to name one of {facts['labels']} {facts['task']} with {goal}, and the share of attempts that "
        f"reach it: {listed}. Attempts that do not reach it count with all their touches."
    ]


def misread(part: Part) -> tuple[int, list[tuple[str, float]]]:
    """The largest number of touches that was judged, and the objects that are then mostly misread, with accuracy."""
    number = max(one.number for one in part.after)
    chosen = [one for one in part.after if one.law == "kernel" and one.number == number]
    right = np.concatenate([one.probs.argmax(axis=1) == one.labels for one in chosen])
    things = np.concatenate([one.things for one in chosen])
    names = part.folds[0].touches.source.object_names
    shares = {names[thing]: float(right[things == thing].mean()) for thing in np.unique(things).tolist()}
    return number, [(name, share) for name, share in shares.items() if share < 0.5]
