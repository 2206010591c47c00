"""Tables and figure of ``robustness``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from experiments.reporting.style import PALETTE, figure
from experiments.reporting.tables import Table, Value, interval
from experiments.robustness.conflict import FALSE_ALARMS, STREAM
from experiments.robustness.searches import CONFIDENCE, SET_UPS
from experiments.robustness.shifted_touches import AS_TRAINED

Parts: TypeAlias = Callable[[Mapping[str, Any]], tuple[tuple[float, float, float] | None, Mapping[str, Any] | None]]
_TICKS = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0)


def robustness_tables(numbers: Mapping[str, Any]) -> list[Table]:
    """Tables of a report, from the contents of ``robustness.json``."""
    name, of = numbers["scene"], f"{numbers['objects_per_shape']} objects of every shape, {numbers['num_poses']} poses"
    rows, models = [], list(numbers["conditions"][AS_TRAINED]["models"])
    for condition, row in numbers["conditions"].items():
        own = row["models"][models[0]]
        fewer = row["num_objects"] < numbers["conditions"][AS_TRAINED]["num_objects"]
        rows.append(
            (
                f"{condition} ({row['num_objects']} objects)" if fewer else condition,
                interval(row["accuracy"], *row["accuracy_interval"]) + (" (chance)" if row["is_chance"] else ""),
                interval(row["difference"], *row["difference_interval"], spec="+.3f")
                if condition != AS_TRAINED
                else "",
                f"{own['nll']:.3f}",
                f"{own['ece']:.3f}",
                interval(own["fused_accuracy"], *own["fused_interval"]),
            )
        )
    headings = ("condition", "accuracy, one touch", "difference", "NLL", "ECE", "all touches fused")
    found = [
        Table(f"{name}: accuracy in other conditions than trained ({of})", headings, rows),
        _stops_table(numbers),
    ]
    if any(own["conflict"] for own in numbers["conditions"][AS_TRAINED]["models"].values()):
        found.append(_conflict_table(numbers))
    if "searches" in numbers["conditions"][AS_TRAINED]["models"][models[0]]:
        found.append(_searches_table(numbers))
        if "abstaining" in numbers["conditions"][AS_TRAINED]["models"][models[0]]["searches"]:
            found.append(_abstention_table(numbers))
    if numbers["unseen"]:
        pairs = [(score, unit) for score in ("energy", "mahalanobis") for unit in ("touch", "object")]
        unseen = [
            (
                label,
                *(interval(*row["auroc"][score][unit]) for score, unit in pairs),
                f"{row['taken_for']} ({row['share']:.0%})",
                f"{row['confidence']:.3f}",
            )
            for label, row in numbers["unseen"].items()
        ]
        columns = ("unseen shape", *(f"{score}, {unit}" for score, unit in pairs), "taken for", "confidence")
        found.append(Table(f"{name}: AUROC of unseen against known shapes ({of})", columns, unseen))
        found.append(_strangers_table(numbers))
    if numbers["among_strangers"]:
        found.append(_among_strangers_table(numbers))
    if numbers["left_out"]:
        found.append(Table("left out", ("condition", ("because", "")), list(numbers["left_out"].items())))
    return found


def _beside(
    numbers: Mapping[str, Any], title: str, note: str, right: str, parts: Parts, more: tuple[str, ...] = ()
) -> Table:
    """One row per condition, and for every model: how often it is right, and what it states and achieves at the end.

    Args:
        numbers: contents of ``robustness.json``.
        title: of the table.
        note: what stated and achieved mean.
        right: heading of the first of a model's columns.
        parts: from the scores of a model: value and interval of the first column, and the other ones; None without.
        more: names of columns of text after those.
    """
    models = list(numbers["conditions"][AS_TRAINED]["models"])
    columns: list[Sequence[str]] = ["condition"]
    for model in models:
        columns += [(f"{model}: {right}", ""), ("touches", ".2f"), ("stated", ".3f"), ("achieved", ".3f")]
        columns += [(name, "") for name in more]
    rows: list[tuple[Value, ...]] = []
    gaps: dict[str, dict[str, float]] = {model: {} for model in models}
    for condition, row in numbers["conditions"].items():
        cells: list[Value] = []
        for model in models:
            value, ends = parts(row["models"][model])
            cells += [None if value is None else interval(*value)]
            cells += [None if ends is None else ends[key] for key in ("touches", "stated", "achieved", *more)]
            if ends is not None and ends["stated"] is not None and not row["is_chance"]:
                gaps[model][condition] = ends["stated"] - ends["achieved"]
        rows.append((condition, *cells))
    sentences = []
    for model, found in gaps.items():
        if found:
            _, worst, gap = max((abs(gap), condition, gap) for condition, gap in found.items())
            sentences.append(f"Largest gap of {model}: {gap:+.3f} ({worst}).")
    return Table(f"{numbers['scene']}: {title}", columns, rows, " ".join([note, *sentences]))


def _stops_table(numbers: Mapping[str, Any]) -> Table:
    def parts(own: Mapping[str, Any]) -> tuple[tuple[float, float, float], Mapping[str, Any] | None]:
        found, fused = own["stops"], (own["fused_accuracy"], *own["fused_interval"])
        return fused, found and found | {"worst shape": "{} {:.3f}".format(*found["worst_shape"])}

    return _beside(
        numbers,
        "stated confidence and accuracy at the stop",
        f"Each object is touched in its poses in random order, until a shape has a posterior of {CONFIDENCE:g}.",
        "all touches fused",
        parts,
        ("worst shape",),
    )


def _conflict_table(numbers: Mapping[str, Any]) -> Table:
    """How often the conflict test fires in every condition, and what is stated and right where it does not."""
    models = [name for name, own in numbers["conditions"][AS_TRAINED]["models"].items() if own["conflict"]]
    columns: list[Sequence[str]] = ["condition"]
    for model in models:
        columns += [(f"{model}: streams that fire", ""), ("touches until then", ".1f")]
        columns += [("stated in the others", ".3f"), ("achieved", ".3f")]
    rows: list[tuple[Value, ...]] = []
    for condition, row in numbers["conditions"].items():
        cells: list[Value] = []
        for model in models:
            found = row["models"][model]["conflict"]
            quiet = found["quiet"] or {"stated": None, "achieved": None}
            cells += [None if found["fired"] is None else interval(*found["fired"]), found["touches"]]
            cells += [quiet["stated"], quiet["achieved"]]
        rows.append((condition, *cells))
    streams = numbers["conditions"][AS_TRAINED]["models"][models[0]]["conflict"]["streams"]
    return Table(
        f"{numbers['scene']}: streams of {STREAM} touches in which the conflict test fires ({streams} streams)",
        columns,
        rows,
        f"Its stated rate of false alarms is {FALSE_ALARMS:g}. Stated and achieved are those at the stops of the other "
        "streams.",
    )


def _strangers_table(numbers: Mapping[str, Any]) -> Table:
    """AUROC of strangers by score and number of touches, and how often the conflict test fires."""
    after = next(iter(numbers["unseen"].values()))["after"]
    last = list(after)[-1]
    scores = list(after[last]["auroc"])
    columns: list[Sequence[str]] = ["unseen shape"]
    columns += [(f"{score}, after {number}", ".3f") for score in scores for number in after]
    columns += [(f"alarms, after {last}", "")]
    rows: list[tuple[Value, ...]] = []
    for label, row in numbers["unseen"].items():
        values = [row["after"][number]["auroc"][score][0] for score in scores for number in after]
        found = row["after"][last]["alarms"]
        rows.append((label, *values, None if found is None else interval(*found)))
    wrong = after[last]["false_alarms"]
    note = (
        ""
        if wrong is None
        else f"The test fires for {interval(*wrong)} of the known objects, at most {FALSE_ALARMS:g} stated."
    )
    return Table(f"{numbers['scene']}: AUROC of strangers after several touches of an object", columns, rows, note)


def _among_strangers_table(numbers: Mapping[str, Any]) -> Table:
    rows: list[tuple[Value, ...]] = [
        (
            belief,
            interval(found["success"], *found["interval"]),
            interval(*found["wrong"]),
            *(found[key] for key in ("taken", "touches", "no_touch")),
        )
        for belief, found in numbers["among_strangers"].items()
    ]
    columns = ("belief", "success", "wrong", ("confirmed a stranger", ".3f"), ("touches", ".2f"), ("no touch", ".3f"))
    number = next(iter(numbers["among_strangers"].values()))["number"]
    return Table(
        f"{numbers['scene']}: {number} live searches for a known shape among strangers",
        columns,
        rows,
        "The bag holds one object of every known shape and as many of unknown ones, so the target may be absent; then "
        "rejecting all objects is right. No touch: success of rejecting all objects, or of confirming the first.",
    )


def _searches_table(numbers: Mapping[str, Any]) -> Table:
    def parts(own: Mapping[str, Any]) -> tuple[tuple[float, float, float] | None, Mapping[str, Any] | None]:
        found = own.get("searches")
        return (None, None) if found is None else ((found["success"], *found["interval"]), found)

    searches = next(iter(numbers["conditions"][AS_TRAINED]["models"].values()))["searches"]
    return _beside(
        numbers,
        f"{searches['number']} live searches by information gain",
        "Stated confidence and accuracy are those at confirmation.",
        "success",
        parts,
    )


def _abstention_table(numbers: Mapping[str, Any]) -> Table:
    """Wrong confirmations without and with the answer "I do not know", by condition, for the sensor's own model."""
    columns = (
        "condition",
        "always answers: wrong",
        "may be unsure: wrong",
        "unsure",
        "right among confirmed",
        "alarms",
    )
    first = next(iter(numbers["conditions"][AS_TRAINED]["models"].values()))["searches"]
    robots = min(SET_UPS, first["number"])
    rows: list[tuple[Value, ...]] = []
    for condition, row in numbers["conditions"].items():
        searches = next(iter(row["models"].values())).get("searches")
        if searches is None:
            rows.append((condition, *[None] * 5))
            continue
        found, sure = searches["abstaining"], searches["abstaining"]["sure"]
        right = None if sure is None else f"{interval(sure['achieved'], *sure['interval'])} of {sure['number']}"
        wrong = (interval(*some["wrong"]) for some in (searches, found))
        rows.append((condition, *wrong, interval(*found["unsure"]), right, _alarms(found)))
    return Table(
        f"{numbers['scene']}: live searches that confirmed a wrong object, and that ended with “I do not know”",
        columns,
        rows,
        "Fractions of all searches. The same searches are made by a decider that always answers and by one that may be "
        f"unsure; {robots} robots share those, and intervals resample the robots. The conflict test of a robot runs "
        "on from search to search, and the targets come in random order. Alarms: how many robots had one, in which "
        "search and after how many touches in all, the medians.",
    )


def _alarms(found: Mapping[str, Any]) -> str:
    """How many robots had an alarm, in which search, and after how many touches."""
    if not found["alarms"]:
        return "0"
    return f"{found['alarms']}, in search {found['searches_to_alarm']:g}, touch {found['touches_to_alarm']:g}"


def draw_conditions(numbers: Mapping[str, Any], *paths: Path) -> None:
    """Draw the error rates of one touch and of all touches fused; the endings of the paths decide the formats.

    The scale is logarithmic above 1 % and linear below, so that it can show zero.
    """
    rows, trained = numbers["conditions"], numbers["conditions"][AS_TRAINED]
    with figure((9, 1.3 + 0.24 * len(rows)), *paths) as drawn:
        drawn.suptitle(f"{numbers['scene']}: {trained['num_objects']} objects, intervals at 95 %")
        models = list(trained["models"])
        alone = [("", [(row["accuracy"], *row["accuracy_interval"]) for row in rows.values()])]
        fused = [
            (model, [(own["fused_accuracy"], *own["fused_interval"]) for own in _of(model, rows)]) for model in models
        ]
        place = list(rows).index(AS_TRAINED)
        panels = (("one touch", alone), ("all touches", fused))
        for axes, (title, series) in zip(drawn.subplots(1, 2, sharey=True), panels, strict=True):
            for number, (label, found) in enumerate(series):
                values, high, low = 1.0 - np.array(found).T
                if number == 0:
                    axes.axvspan(low[place], high[place], color="0.9", linewidth=0)
                    axes.axvline(values[place], color="0.5", linewidth=1)
                    axes.axvline(1.0 - numbers["chance"], color="0.5", linewidth=1, linestyle=":")
                reach = np.maximum([values - low, high - values], 0.0)  # a mean and its quantiles round differently
                colour, marker = PALETTE[number], "os"[number]
                style = {"fmt": marker, "color": colour, "markersize": 4, "elinewidth": 1, "label": label}
                axes.errorbar(values, np.arange(len(rows)) + 0.2 * number, xerr=reach, **style)
            axes.set_yticks(range(len(rows)), list(rows))
            if len(series) > 1:
                axes.legend(loc="lower right")
            axes.set(title=title, xlabel="error rate (line: as trained; dotted: chance)")
            axes.set_xscale("symlog", linthresh=0.01, linscale=0.7)
            axes.set(
                xlim=(-0.001, 1.0), xticks=_TICKS, xticklabels=[f"{100 * tick:g}" for tick in _TICKS[:-1]] + ["100 %"]
            )
            axes.minorticks_off()
            axes.grid(axis="x", alpha=0.25)
        axes.invert_yaxis()


def _of(model: str, rows: Mapping[str, Any]) -> list[Any]:
    """The scores of a model in every condition."""
    return [row["models"][model] for row in rows.values()]
