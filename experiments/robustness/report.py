"""Tables of ``robustness``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from belief.table import Table, Value, interval
from experiments.robustness.searches import CONFIDENCE, ROBOTS
from experiments.robustness.strangers import FALSE_ALARMS
from experiments.robustness.touches import AS_TRAINED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Numbers: TypeAlias = Mapping[str, Any]


def robustness_tables(numbers: Numbers) -> list[Table]:
    """Tables of a report, from the contents of ``robustness.json``."""
    first = _own(numbers["conditions"][AS_TRAINED])
    found = [_accuracy_table(numbers), _stops_table(numbers)]
    if "searches" in first:
        found.append(_searches_table(numbers))
        if "abstaining" in first["searches"]:
            found.append(_abstention_table(numbers))
    if numbers["unseen"]:
        found.append(_strangers_table(numbers))
    if numbers["left_out"]:
        found.append(Table("left out", ("condition", ("because", "")), list(numbers["left_out"].items())))
    return found


def write_robustness_page(numbers: Numbers, path: Path) -> None:
    """Write an HTML page with the tables of a report, and a figure of what is stated and right in each condition.

    Args:
        numbers: contents of ``robustness.json``.
        path: file to write.

    Raises:
        CannotWrite: the disk is full, or the folder cannot be written.
    """
    from experiments.reporting.page import Section, write_page
    from experiments.reporting.style import Picture

    found = {name: _own(row)["stops"] for name, row in numbers["conditions"].items()}
    kept = {name: stops for name, stops in found.items() if stops and stops["stated"] is not None}
    said = f"Objects are named at a stated probability of at least {CONFIDENCE:g}; in {len(kept)} conditions some are."
    if widest := _widest(numbers, found):
        worst, _ = widest
        said += (
            f" Where single touches tell more than chance, stated and right differ most in “{worst}”: it states "
            f"{kept[worst]['stated']:.3f} and is right in {kept[worst]['achieved']:.3f}."
        )
    caption = "Stated probability (open) and fraction right (filled) where an object is named, in each condition."
    size = (6.5, 0.8 + 0.24 * len(kept))
    drawn = [Picture("stated_and_right", caption, [partial(_draw_stops, stops=kept)], size=size)] if kept else []
    tables = robustness_tables(numbers)
    title = f"Changed worlds: the sensor of the scene “{numbers['scene']}”"
    write_page(path, title, [Section("Stated and right", [said], pictures=drawn), Section("Tables", tables=tables)])


def _draw_stops(axes: Axes, stops: Mapping[str, Numbers]) -> None:
    """Stated against right, one line for each condition, the first on top."""
    from experiments.reporting.style import PALETTE

    for place, found in enumerate(stops.values()):
        axes.plot([found["achieved"], found["stated"]], [place, place], color="#9aa5b1", linewidth=1.5)
        axes.plot(found["stated"], place, "o", color=PALETTE[0], markerfacecolor="none")
        axes.plot(found["achieved"], place, "o", color=PALETTE[0])
    axes.set_yticks(range(len(stops)), list(stops))
    axes.invert_yaxis()
    axes.set_xlabel("stated (open) and right (filled)")
    axes.grid(axis="x", alpha=0.3)


def _accuracy_table(numbers: Numbers) -> Table:
    rows = []
    for condition, row in numbers["conditions"].items():
        own, number = _own(row), row["num_objects"]
        fewer = number < numbers["conditions"][AS_TRAINED]["num_objects"]
        difference = interval(row["difference"], *row["difference_interval"], spec="+.3f")
        rows.append(
            (
                f"{condition} ({number} objects)" if fewer else condition,
                interval(row["accuracy"], *row["accuracy_interval"]) + " (chance)" * row["is_chance"],
                "" if condition == AS_TRAINED else difference,
                own["nll"],
                own["ece"],
                interval(own["fused_accuracy"], *own["fused_interval"]),
            )
        )
    of = f"{numbers['objects_per_shape']} objects of every shape, {numbers['num_poses']} poses"
    return Table(
        f"{numbers['scene']}: accuracy in other conditions than trained ({of})",
        ("condition", "accuracy, one touch", "difference", ("NLL", ".3f"), ("ECE", ".3f"), "all touches fused"),
        rows,
    )


def _own(row: Numbers) -> Numbers:
    """The scores of the sensor's own observation model in a condition; records of earlier versions have others too."""
    scores: Numbers = next(iter(row["models"].values()))
    return scores


def _with_ends(
    numbers: Numbers, title: str, columns: Sequence[str], cells: Callable[[Numbers], tuple[list[Value], Numbers | None]]
) -> Table:
    """One row per condition: the given cells, and what the model states and achieves at the end.

    Args:
        numbers: contents of ``robustness.json``.
        title: of the table.
        columns: headings of the given cells.
        cells: from the scores of the model: the given cells, and ``touches``, ``stated`` and ``achieved``, if any.
    """
    rows: list[list[Value]] = []
    found: dict[str, Numbers | None] = {}
    for condition, row in numbers["conditions"].items():
        given, ends = cells(_own(row))
        rows.append([condition, *given, *((ends or {}).get(key) for key in ("touches", "stated", "achieved"))])
        found[condition] = ends
    headings = ["condition", *((heading, "") for heading in columns)]
    headings += [("touches", ".2f"), ("stated", ".3f"), ("achieved", ".3f")]
    widest = _widest(numbers, found)
    note = "" if widest is None else f"Largest gap: {widest[1]:+.3f} ({widest[0]})."
    return Table(f"{numbers['scene']}: {title}", headings, rows, note)


def _widest(numbers: Numbers, ends: Mapping[str, Numbers | None]) -> tuple[str, float] | None:
    """The condition in which stated and right differ most, of those not at chance, and by how much; None without any.

    Args:
        numbers: contents of ``robustness.json``.
        ends: by condition; with ``stated`` and ``achieved``, or None.
    """
    gaps = {
        name: one["stated"] - one["achieved"]
        for name, one in ends.items()
        if one and one["stated"] is not None and not numbers["conditions"][name]["is_chance"]
    }
    return max(gaps.items(), key=lambda pair: abs(pair[1]), default=None)


def _stops_table(numbers: Numbers) -> Table:
    def cells(scores: Numbers) -> tuple[list[Value], Numbers | None]:
        stops, fired = scores["stops"], scores.get("alarms")
        worst = None if stops is None else "{} {:.3f}".format(*stops["worst_shape"])
        fused = interval(scores["fused_accuracy"], *scores["fused_interval"])
        return [fused, worst, None if fired is None else interval(*fired)], stops

    title = f"objects touched in random order of the poses, until a shape has a posterior of {CONFIDENCE:g}"
    return _with_ends(numbers, title, ("all touches fused", "worst shape", "alarms of the conflict test"), cells)


def _searches_table(numbers: Numbers) -> Table:
    def cells(scores: Numbers) -> tuple[list[Value], Numbers | None]:
        found = scores.get("searches")
        return [None if found is None else interval(found["success"], *found["interval"])], found

    number = _own(numbers["conditions"][AS_TRAINED])["searches"]["number"]
    return _with_ends(numbers, f"{number} live searches by information gain", ("success",), cells)


def _abstention_table(numbers: Numbers) -> Table:
    """Wrong confirmations without and with the answer "I do not know", by condition."""
    columns = (
        "condition",
        "always answers: wrong",
        "may be unsure: wrong",
        "unsure",
        "right among confirmed",
        "alarms",
    )
    rows: list[tuple[Value, ...]] = []
    for condition, row in numbers["conditions"].items():
        searches = _own(row).get("searches")
        if searches is None:
            rows.append((condition, *[None] * 5))
            continue
        found, sure = searches["abstaining"], searches["abstaining"]["sure"]
        right = None if sure is None else f"{interval(sure['achieved'], *sure['interval'])} of {sure['number']}"
        alarms = "0"
        if found["alarms"]:
            when = f"in search {found['searches_to_alarm']:g}, touch {found['touches_to_alarm']:g}"
            alarms = f"{found['alarms']}, {when}"
        wrong = (interval(*kind["wrong"]) for kind in (searches, found))
        rows.append((condition, *wrong, interval(*found["unsure"]), right, alarms))
    return Table(
        f"{numbers['scene']}: live searches that confirmed a wrong object, and that ended with “I do not know”",
        columns,
        rows,
        f"The same searches by a decider that may be unsure; at most {ROBOTS} robots share them; intervals resample "
        "robots. Alarms: how many robots had one, in which search and after how many touches in all, the medians.",
    )


def _strangers_table(numbers: Numbers) -> Table:
    """AUROC of strangers by score and number of touches, and how often the conflict test fires."""
    after = next(iter(numbers["unseen"].values()))["after"]
    last = list(after)[-1]
    scores = list(after[last]["auroc"])
    columns: list[Sequence[str]] = ["unknown shape"]
    columns += [(f"{score}, after {number}", ".3f") for score in scores for number in after]
    columns += [(f"alarms, after {last}", ""), ("taken for", "")]
    rows: list[tuple[Value, ...]] = []
    for label, row in numbers["unseen"].items():
        values = [row["after"][number]["auroc"][score][0] for score in scores for number in after]
        found, taken = row["after"][last]["alarms"], f"{row['taken_for']} ({row['share']:.0%})"
        rows.append((label, *values, None if found is None else interval(*found), taken))
    wrong = after[last]["false_alarms"]
    note = f"The test fires for {interval(*wrong)} of the known objects; {FALSE_ALARMS:g} stated." if wrong else ""
    return Table(f"{numbers['scene']}: AUROC of unknown against known shapes, by touches", columns, rows, note)
