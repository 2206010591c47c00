"""Fill tables of the pages about results, calibration, changed worlds, perception, speed, the paper and real touches.

Pages show a part of the long tables; ``records/tables`` has all of them, and ``records/submissions`` the scoreboard.

Run: python docs/generate/tables.py

They are filled from the files in records/ that the commands wrote. A test checks that the pages hold what this writes.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from belief.statistics.comparison import pareto_front, wilson_interval
from belief.table import interval
from experiments.search.benchmark.cards import Card
from experiments.search.benchmark.checking import check
from experiments.search.benchmark.checking import tables as submission_tables
from experiments.tradeoff.report import SHARES

DOCS = Path(__file__).parent.parent
RECORDS = DOCS.parent / "records"
SHIFTED = ("gel", "coarse", "paper", "hard", "many")
DOUBTING = ("coarse", "gel", "hard")
TOUCHED = ("paper", "coarse", "gel", "hard", "many")
CALIBRATED = {
    "coarse": ("coarse", ("rigid body",)),
    "paper-independent": ("paper_independent", ("ratio", "independent")),
}
"""Record and observation models by sensor."""
_HEALTH = re.compile(
    r"(?P<stops>\d+) stops .* stated (?P<stated>[\d.]+), right (?P<right>[\d.]+).*; "
    r"(?P<alarms>\d+) of (?P<sessions>\d+) alarms"
)
DRAWN = (
    *("usual", "size ± 25 %", "hysteresis 5 %", "stiffness × 0.7", "stiffness × 1.5"),
    *(f"noise × {factor}" for factor in (1.5, 2, 3, 6)),
    *("cylinder twice as long", "19 % more dead", "stiffness × 0.4", "force 0.3 to 1 N"),
    *("stiffness × 0.4 + force 0.5 to 1.5 N", "shifted by 1 taxel", "blurred by 1 taxel", "6 % stuck at full scale"),
    "noise × 2 + 6 % stuck at full scale",
)
"""Worlds of the figure."""
INFERRED = (
    *DRAWN,
    *("1 % stuck", "5 % stuck", "blurred by 2 pixels", "blurred by 5 pixels", "shifted by 2 pixels"),
    *("shifted by 4 pixels", "shifted by 10 pixels", "hysteresis 10 %", "force 0.5 to 1.5 N", "force 1 to 4 N"),
    *("stiffness × 0.5 to 2", "noise that repeats", "gain falls 5 % a touch", "slip, random", "slip, steady"),
    *(f"pose error {angle}°" for angle in (5, 10, 20)),
    *("press guarded_move", "friction 0.05", "offset ± 4 mm", "smaller by ≤ 15 %", "cylinder × 0.5", "cylinder × 1.25"),
    *("cone × 0.6", "cone × 1.5", "cube 1 : 1 : 1.25", "noise × 1.5 + stiffness × 0.7"),
    *("noise × 2 + shifted by 3 % of the edge", "hysteresis 5 % + 5 % more dead"),
)
"""Worlds that a sensor in an unknown state infers."""
_BASELINES = ("information_gain", "information_per_cost")
"""Agent that is shown with every task."""
_PROMISED = 0.93  # accuracy of stops below which a number is bold


SHOWN = (
    *("as trained", "noise × 2", "6 % stuck at full scale", "shifted by 1 taxel"),
    *("cylinder twice as long", "stiffness × 0.4", "force 0.3 to 1 N"),
)
"""Conditions of the page."""


def robustness(page: str) -> str:
    """The page with its table of some conditions of three scenes."""
    rows = []
    for name in SHOWN:
        cells = []
        for scene in DOUBTING:
            described, doubting = (read_record(f"robustness/{kind}{scene}")["conditions"] for kind in ("", "default_"))
            cells += [_stops(described.get(name))] * (scene == "coarse") + [_guarded_stops(doubting.get(name))]
        rows.append(_row(name, *cells))
    return _with_rows(page, "## What is stated", rows)


def all_worlds(page: str) -> str:
    """The tables of all conditions and scenes, of all states of sensors, and of searches among unknown objects."""
    records = {scene: read_record(f"robustness/{scene}") for scene in SHIFTED}
    conditions = list(dict.fromkeys(name for record in records.values() for name in record["conditions"]))
    for beginning, cell in (("## Stated and right", _stops), ("## Wrong and unsure", _answers)):
        rows = [
            _row(name, *(cell(record["conditions"].get(name)) for record in records.values())) for name in conditions
        ]
        page = _with_rows(page, beginning, rows)
    doubting = [read_record(f"robustness/default_{scene}")["conditions"] for scene in DOUBTING]
    names = dict.fromkeys(name for found in doubting for name in found)
    rows = [_row(name, *(_guarded(found.get(name)) for found in doubting)) for name in names]
    page = _with_rows(page, "## By default", rows)
    among = []
    for scene, record in records.items():
        if found := record["among_strangers"]:
            first = found["knows of strangers"]
            cells = (f"{_interval(some)}, {some['wrong'][0]:.3f}, {some['touches']:.1f}" for some in found.values())
            among.append(_row(f"`{scene}`, {first['number']} searches", *cells, f"{first['no_touch']:.2f}"))
    page = _with_rows(page, "## Unknown objects", among)
    return _with_rows(page, "## Unknown states", [_row(name, *_health(name)) for name in INFERRED])


def health_of(scene: str, world: str, sensor: str) -> dict[str, str] | None:
    """Numbers of a sensor in a world from the records of benchmarks/sensor_health.py; None if it was not measured."""
    found = (RECORDS / f"perception/health_{scene}.txt").read_text(encoding="utf-8")
    text = re.search(rf"^{re.escape(world)}: .*\n(?:  .*\n)*?  {sensor} +(\d.*)", found, re.M)
    numbers = None if text is None else _HEALTH.match(text[1])
    return None if numbers is None else numbers.groupdict()


def _health(world: str) -> Iterator[str]:
    """What a sensor with its own reader, and one in an unknown state, state at stops, what is right, and its alarms."""
    alarms = []
    for scene in ("coarse", "gel", "hard"):
        for sensor in ("own", "unknown"):
            found = health_of(scene, world, sensor)
            yield "–" if found is None else f"{found['stated']}, {_kept(float(found['right']))}"
        alarms.append("–" if found is None else f"{found['alarms']} of {found['sessions']}")
    yield ", ".join(alarms)


def perception(page: str) -> str:
    """The tables of several touches of one body, hypotheses and networks."""
    rows = []
    for scene in TOUCHED:
        record = read_record(f"perception/several-touches-{scene}")
        independent, joint = (entry["results"] for entry in record["entries"])
        for one, other in zip(independent, joint, strict=True):
            if (number := one["touches"]) <= _MANY_TOUCHES:
                scene_cell = f"`{scene}`, {_grouped(record['objects'])}" if number == 1 else ""
                rows.append(_row(scene_cell, str(number), _touched(one), _touched(other)))
    page = _with_rows(page, "## Several touches of one body", rows)
    page = _with_rows(page, "**How many hypotheses?**", _hypotheses(_by_touches))
    networks = [
        _row(
            f"{entry['network']}, {entry['runtime']}",
            "{:.4f} [{:.4f}, {:.4f}]".format(entry["scores"]["accuracy"], *entry["scores"]["interval"]),
            f"{entry['scores']['nll']:.4f}",
            *(f"{entry['milliseconds'][batch]:.2f} ({entry['ratio'][batch]:.2f})" for batch in ("1", "64")),
            f"{entry['megabytes']:.1f}",
            _grouped(entry["parameters"]),
        )
        for entry in read_record("perception/frontier")["entries"]
        if entry["runtime"] in ("torch", "ONNX Runtime")
    ]
    return _with_rows(page, "## What it costs", networks)


_MANY_TOUCHES = 3  # touches of one body from which on the rows say the same


def results(page: str) -> str:
    """The page with its table of accuracy after one to three touches."""
    rows = []
    for scene in TOUCHED:
        models = [entry["results"] for entry in read_record(f"perception/several-touches-{scene}")["entries"]]
        independent, joint = ({found["touches"]: found for found in model} for model in models)
        later = (f"{independent[n]['accuracy']:.3f}, {_right(joint[n], '**')}" for n in (2, 3))
        rows.append(_row(f"`{scene}`", _right(joint[1]), *later))
    return _with_rows(page, "Accuracy on unseen objects", rows)


def calibration(page: str) -> str:
    """The tables of single touches and of sequences, of two sensors."""
    single, sequences = [], []
    for sensor, (record, models) in CALIBRATED.items():
        name = f"calibration/{record}.txt"
        text = (RECORDS / name).read_text(encoding="utf-8")
        tables, link = dict(_markdown(text)), f"[`{sensor}`](../{name})"
        before, *others = next(rows for title, rows in tables.items() if title.startswith("Single touches"))
        after = next(row for row in others if row["calibration"].endswith(_CHOSEN))
        chosen = after["calibration"].removesuffix(_CHOSEN).replace("_", " ")
        changes = (f"{before[column]} → {after[column]}" for column in ("NLL", "ECE", "classwise"))
        bias = after["classwise, bias-corrected"]
        single.append(_row(link, chosen.replace("dirichlet", "Dirichlet"), *changes, bias))
        for kind in ("distinct poses", "one pose", "random poses"):
            for model in models[: 1 if kind == "distinct poses" else 2]:
                sequences.append(_row(link, kind, model, *_sequences(tables, kind, model)))
    page = _with_rows(page, "## Single touches", single)
    return _with_rows(page, "## Several touches, and at stopping", sequences)


def tradeoff(page: str) -> str:
    """The page with all configurations by scene, * on the Pareto front, and its tables of hypotheses and networks."""
    first, second = (read_record(f"tradeoff/searches_{seed}")["points"] for seed in (0, 1))
    again = {point["name"]: point for point in second}
    for scene in SHARES:
        points = [point for point in first if point["configuration"]["scene"] == scene]
        is_best = pareto_front(*([p[axis] for p in points] for axis in ("ms_per_search", "success")))
        rows = []
        for place in sorted(range(len(points)), key=lambda place: points[place]["ms_per_search"]):
            point = points[place]
            right = (interval(some["success"], *some["interval"]) for some in (point, again[point["name"]]))
            times = (f"{point[part]:.2f}" for part in ("physics", "network", "decision"))
            numbers = f"{point['touches']:.2f}", f"{point['reward']:.3f}", f"{point['ms_per_search']:.1f}"
            rows.append(_row(point["name"] + " *" * bool(is_best[place]), *right, *numbers, *times))
        page = _with_rows(page, f"**{scene}**", rows)
    page = _with_rows(page, "## How many hypotheses", list(_live_hypotheses(list(_searched()))))
    rows = []
    for entry in read_record("tradeoff/networks")["entries"]:
        if (entry["hypotheses"], entry["precision"]) == (2048, "float32"):
            found = {result["touches"]: result for result in entry["results"]}
            times = (f"{entry[name]:.2f}" for name in ("read_milliseconds", "update_milliseconds"))
            rows.append(_row(entry["network"], *_by_score(found, (1, 3, 6)), *times))
    return _with_rows(page, "## Networks that know orientations", rows)


def reproduction(page: str) -> str:
    """The page with the paper's Tables 1 and 2 beside ours."""
    page = _with_rows(page, "## Table 1: the classifier", _table1(""))
    rows = [_row("paper: Manual", *_PAPER_MANUAL), _row("paper: PPO", *_PAPER_PPO)]
    for found in read_record("reproduction/table2"):
        trials, right = found["trials"], found["successes"]
        by_target = ("{:.2f} [{:.2f}, {:.2f}]".format(*_rate(right[shape], trials)) for shape in _TARGETS)
        whole = "{:.3f} [{:.3f}, {:.3f}]".format(*_rate(sum(right.values()), trials * len(right)))
        cells = f"{found['touches']:.1f}", f"{found['no_touch_baseline']:.2f}"
        rows.append(_row(f"{found['decider']}, {found['scene']}", *by_target, whole, *cells))
    return _with_rows(page, "## Table 2: success of the searches", rows)


def real_touch(page: str) -> str:
    """The table of touches until an object is named."""
    rows = []
    for name, splits in NAMED.items():
        found = read_record(f"real_touch/{name}")["tables"]["identification"]
        for split, words in splits.items():
            by_decider = {decider: cells for some, decider, *cells in found if some == split}
            chance, fixed, gain, plan = (by_decider[name] for name in _ORDERS)
            bound = by_decider.get("bound: outcomes known in advance", "–")[0]
            right = ", ".join(cells[3].partition(" ")[0] for cells in (chance, gain))
            saved = (
                re.sub(r"(?<=\d)%", " %", cell, count=1).replace("%,", ",").replace("%]", "]") for cell in gain[1:3]
            )
            gained = "**{}** [{}".format(*gain[0].split(" [")) if "cy101" in name else gain[0]
            rows.append(_row(words, chance[0], fixed[0], gained, plan[0], *saved, bound, right))
    return _with_rows(page, "## Touches until an object is named", rows)


_ORDERS = ("random order", "best fixed order", "information gain", "point-based")
NAMED = {  # splits of the record, and what the page calls them
    "cy101-objects": {
        "in order of recording": "`cy101`, 97 objects, last trial",
        "random sessions": "the same, random trials",
    },
    "cy101-categories": {"unseen objects": "`cy101`, 20 categories, unseen objects"},
    "bts3-objects": {
        "in order of recording": "`bts3`, 41 objects, order of the file",
        "random sessions": "the same, random grasps",
    },
}


def benchmark(page: str) -> str:
    """The page with its table of the tasks, with a baseline."""
    entries, by_task = _submissions(_BASELINES)
    own = {one.submission.header.task: one for one in entries if one.submission and one.name in _BASELINES}
    tasks = []
    for card in Card.every():
        header = own[card.name].submission.header
        base, elapsed = by_task[card.name][header.agent], header.elapsed
        success = interval(base["success"], base["success_low"], base["success_high"])
        cells = (success, f"{base['touches']:.2f}", f"{base['return']:.3f}", f"{card.bound:.3f}", f"{elapsed:.0f} s")
        tasks.append(_row(f"`{card.name}`", card.summary, str(len(card.sought) * card.episodes), *cells))
    return _with_rows(page, "## Tasks", tasks)


def scoreboard(page: str) -> str:
    """The table of all submissions."""
    rows = []
    for task, found in _submissions()[1].items():
        for name, row in found.items():
            success = interval(row["success"], row["success_low"], row["success_high"])
            returned = interval(row["return"], row["return_low"], row["return_high"])
            cells = (row["group"], success, f"{row['touches']:.2f}", returned, f"{row['to_bound']:.3f}")
            rows.append(_row(f"`{task}`", f"`{name}`", *cells, f"{row['ms']:.1f}"))
    return _with_rows(page, "# Scoreboard", rows)


def baselines(page: str) -> str:
    """What ``activetouch benchmark`` prints beside an agent: success, touches and return of a baseline and a guess."""
    shown, keys = (*_BASELINES, "random_confirm", "random"), ("success", "touches", "return")
    by_task = {
        task: {name: [round(found[name][key], 4) for key in keys] for name in shown if name in found}
        for task, found in _submissions()[1].items()
    }
    return json.dumps(by_task, indent=1) + "\n"


@cache
def _submissions(files: tuple[str, ...] = ("*",)) -> tuple[list[Any], dict[str, dict[str, Any]]]:
    """The submissions in these files, all by default, and the rows of their results by task and agent."""
    paths = (path for name in files for path in (RECORDS / "submissions").glob(f"*/{name}.jsonl.gz"))
    entries = check(sorted(paths), share=0.0)
    assert not [entry for entry in entries if entry.faults], entries
    shown = [table for table in submission_tables(entries) if table.name.endswith("_results")]
    by_task = {table.name.removesuffix("_results"): table.records() for table in shown}
    return entries, {card.name: {row["agent"]: row for row in by_task[card.name]} for card in Card.every()}


PAGES = {
    "docs/robustness.md": robustness,
    "records/tables/robustness.md": all_worlds,
    "records/tables/perception.md": perception,
    "records/tables/calibration.md": calibration,
    "docs/results.md": results,
    "records/tables/tradeoff.md": tradeoff,
    "docs/reproduction.md": reproduction,
    "records/tables/real_touch.md": real_touch,
    "docs/benchmark.md": benchmark,
    "records/submissions/README.md": scoreboard,
    "experiments/search/benchmark/baselines.json": baselines,
}
"""What fills each page, by its path."""
OF_ALL_SUBMISSIONS = ("records/submissions/README.md", "experiments/search/benchmark/baselines.json")
"""Those that read every submission, for which the nightly list has the time."""


_TARGETS = ("sphere", "cube", "cylinder", "cone")
_PAPER_MANUAL = ("1.00", "1.00", "0.05", "0.08", "0.532", "", "")
_PAPER_PPO = ("0.46", "0.13", "0.15", "0.20", "0.235", "", "")


def _table1(mark: str) -> list[str]:
    """Rows of the paper's Table 1 beside ours, with the accuracies between marks."""
    record = read_record("reproduction/table1")
    columns = [record["splits"][split][read] for split in ("by image", "by object") for read in _READ]
    rows = [
        _row(shape, *(_precision(found) for found in (record["paper"][shape], *(c["shapes"][shape] for c in columns))))
        for shape in sorted(_TARGETS)
    ]
    ours = ("{0}{1:.3f}{0} [{2:.3f}, {3:.3f}]".format(mark, c["accuracy"], *c["interval"]) for c in columns)
    near = ("{:.3f} [{:.3f}, {:.3f}]".format(c["nearest"], *c["nearest_interval"]) for c in columns)
    nearest = "of the nearest training image" if mark else "accuracy of the nearest training image"
    return [*rows, _row("accuracy", f"{mark}0.81{mark}", *ours), _row(nearest, "", *near)]


_READ = ("held out", "held-out objects")


def _precision(found: Mapping[str, Any]) -> str:
    return "{precision:.2f} / {recall:.2f} / {f1:.2f} ({support})".format(**found)


def _rate(successes: int, trials: int) -> tuple[float, float, float]:
    return successes / trials, *wilson_interval(successes, trials)


def _hypotheses(cells: Callable[[Mapping[int, Any]], Iterable[str]]) -> list[str]:
    """A row for every number of hypotheses: cells of the results by number of touches, then time and memory."""
    rows = []
    for entry in read_record("perception/hypotheses-coarse")["entries"]:
        if entry["hypotheses"]:
            found = cells({result["touches"]: result for result in entry["results"]})
            cost = f"{entry['update_milliseconds']:.2f}", f"{entry['megabytes']:.1f}"
            rows.append(_row(_grouped(entry["hypotheses"]), *found, *cost))
    return rows


def _searched() -> Iterator[list[str]]:
    """Rows of the trade-off, rounded; differences are quoted in the file so that no program adds them up."""
    with (RECORDS / "tradeoff" / "tradeoff.csv").open(encoding="utf-8", newline="") as file:
        _, *rows = csv.reader(file)
    for cells in rows:
        marked = zip(cells, _SEARCHED, strict=True)
        yield [f"{float(cell):{spec}}" if spec else cell.removeprefix("'") for cell, spec in marked]


_SEARCHED = ("", "", "", "", ".2f", ".3f", ".1f", ".2f", ".2f", ".2f", ".1f", ".0f", ".2f")


def _live_hypotheses(searched: list[list[str]]) -> Iterator[str]:
    """A row for every number of hypotheses in live searches of a scene."""
    rows = {cells[0]: cells for cells in searched}
    for scene in ("coarse", "hard"):
        names = {
            _grouped(n): f"{scene}, rigid body × {n}, information_gain, λ 0.02"
            for n in (64, 256, 1024, 2048, 4096, 16_384)
        }
        for hypotheses, name in names.items():
            cells = rows[name]
            yield _row(f"`{scene}`", hypotheses, cells[2], *cells[4:8])


def _by_touches(results: Mapping[int, Any]) -> list[str]:
    return [f"{results[n]['accuracy']:.3f}, {results[n]['nll']:.4f}" for n in (1, 2, 3, 6)]


def _by_score(results: Mapping[int, Any], numbers: tuple[int, ...]) -> list[str]:
    return [f"{results[n][score]:.3f}" for score in ("accuracy", "nll") for n in numbers]


def read_record(name: str) -> Any:
    """The JSON file of a record; where it has none, the one at the end of what was printed."""
    file = RECORDS / f"{name}.json"
    printed = file.with_suffix(".txt").read_text(encoding="utf-8") if not file.exists() else ""
    return json.loads(printed.partition(".json:\n\n")[2] or file.read_text(encoding="utf-8"))


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _interval(found: Mapping[str, Any], name: str = "success") -> str:
    low, high = found["interval"]
    return f"{found[name]:.3f} [{low:.3f}, {high:.3f}]"


def _grouped(number: int) -> str:
    return f"{number:,}".replace(",", " ")


_CHOSEN = " (chosen)"


def _sequences(tables: Mapping[str, Any], kind: str, model: str) -> Iterator[str]:
    """Cells of a model in sequences of a kind: worst error, stops, largest gap; bold where a target is missed."""

    def of(title: str) -> list[Mapping[str, str]]:
        return [row for row in tables[f"{title}, {kind}"] if next(iter(row.values())).removesuffix(_CHOSEN) == model]

    [targets], [stops], [errors] = of("Targets"), of("Stops at 0.95"), of("Calibration error (chance)")
    error, chance = max(_pair(cell) for heading, cell in errors.items() if heading.isdecimal())
    yield f"{_missed(f'{error:.3f}', targets['error ≤ 0.020'])} ({chance:.3f})"
    yield _grouped(int(stops["stops"].partition(" ")[0]))
    yield stops["confidence"]
    low, high = re.findall(r"\d\.\d+", stops["objects resampled"])
    yield f"{stops['accuracy']} [{f'**{low}**' if float(low) < 0.95 else low}, {high}]"
    gaps = [
        (abs(float(row["confidence"]) - float(row["accuracy [Clopper-Pearson]"].partition(" ")[0])), row["touches"])
        for row in of("By touches at stopping")
        if int(row["stops"]) >= _ENOUGH
    ]
    largest = targets["gap ≤ 0.020"]
    yield f"{_missed(largest.partition(' ')[0], largest)} at {max(gaps)[1]}"


_ENOUGH = 200  # stops for a gap


def _pair(cell: str) -> tuple[float, float]:
    value, chance = re.findall(r"\d\.\d+", cell)
    return float(value), float(chance)


def _missed(number: str, target: str) -> str:
    return f"**{number}**" if "✗" in target else number


def _markdown(text: str) -> Iterator[tuple[str, list[dict[str, str]]]]:
    """Title of every table of a text, and its rows: cells by heading."""
    for title, head, body in re.findall(r"^\*\*(.+)\*\*\n\n\| (.+) \|\n\|[-:| ]+\|\n((?:\|.+\n)+)", text, re.M):
        headings = head.split(" | ")
        yield title, [dict(zip(headings, line[2:-2].split(" | "), strict=True)) for line in body.splitlines()]


def _stops(condition: Mapping[str, Any] | None) -> str:
    """Stated confidence and accuracy of confirmations in a changed world."""
    if condition is None:
        return "–"
    searches = condition["models"]["rigid body"]["searches"]
    return f"{searches['stated']:.3f}, {_kept(searches['achieved'])}"


def _guarded_stops(condition: Mapping[str, Any] | None) -> str:
    """Stated confidence and accuracy of confirmations of a sensor that doubts, and the share that ends unsure."""
    if condition is None:
        return "–"
    stops = "–" if condition["stated"] is None else f"{condition['stated']:.3f}, {_kept(condition['achieved'])}"
    return f"{stops}; {condition['unsure'][0]:.2f}"


def _guarded(condition: Mapping[str, Any] | None) -> str:
    """The same, with the share that ends wrong, and touches."""
    if condition is None:
        return "–"
    return f"{_guarded_stops(condition)}; {condition['wrong'][0]:.3f}; {condition['touches']:.1f}"


def _answers(condition: Mapping[str, Any] | None) -> str:
    """Wrong confirmations of deciders that always answer and that may be unsure, and the share that is unsure."""
    if condition is None:
        return "–"
    searches = condition["models"]["rigid body"]["searches"]
    unsure = searches["abstaining"]
    return f"{searches['wrong'][0]:.3f}, {unsure['wrong'][0]:.3f}; {unsure['unsure'][0]:.3f}"


def _kept(achieved: float) -> str:
    return f"{achieved:.3f}" if achieved >= _PROMISED else f"**{achieved:.3f}**"


def _touched(found: Mapping[str, Any]) -> str:
    low, high = found["gap_interval"]
    return f"{_right(found)}, {found['nll']:.4f}, {found['gap']:+.3f} [{low:+.3f}, {high:+.3f}]"


def _right(found: Mapping[str, Any], mark: str = "") -> str:
    low, high = found["accuracy_interval"]
    return f"{mark}{found['accuracy']:.3f}{mark} [{low:.3f}, {high:.3f}]"


def _with_rows(page: str, beginning: str, rows: list[str]) -> str:
    """The page with other rows in the first table after some words."""
    line = re.compile(r"^\|[-:| ]+\|\n", re.M).search(page, page.index(beginning))
    assert line is not None, beginning
    end = page.find("\n\n", line.end())
    return page[: line.end()] + "\n".join(rows) + (page[end:] if end >= 0 else "\n")


def main() -> None:
    """Write the pages."""
    for name, filled in PAGES.items():
        page = RECORDS.parent / name
        page.write_text(filled(page.read_text(encoding="utf-8")), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
