"""Trade-off of speed and accuracy: configurations of a scene, what is measured of them, and the report."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import compress
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from activetouch.named_scenes import SCENES
from activetouch.sensor_files import INDEPENDENT_SUFFIX, MODELS
from belief.statistics import paired_bootstrap, pareto_front, wilson_interval
from belief.table import Table, Value, interval
from experiments.report import Report, Reported, Section
from experiments.scene_choice import FIDELITIES, command
from planners import DECIDERS
from planners.registry import NEED_FILES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from experiments.report import Picture

SHARES: Mapping[str, float] = MappingProxyType({"gel": 1.0, "coarse": 1.0, "paper": 0.6, "hard": 0.2, "many": 0.16})
"""Number of searches per target relative to ``gel``: fewer where they take longer."""
_WHOLE = ("gel", "coarse")  # scenes in which everything is varied
_MAIN = ("information_gain", "point_based", "threshold", "value_of_information")
_SLOW = ("pouct",)  # tree search, whose decisions take hundreds of times as long
_TOUCH_COSTS = (0.005, 0.05, 0.1)  # besides the default
_WEIGH_COSTS = ("point_based", "value_of_information")  # deciders that weigh the cost of a touch


@dataclass(frozen=True)
class Configuration:
    """A combination of sensor (empty for the scene's), decider, touch cost λ and press (None for the scene's)."""

    scene: str
    sensor: str = ""
    decider: str = _MAIN[0]
    touch_cost: float = 0.02
    fidelity: str | None = None

    @property
    def name(self) -> str:
        """Description in one line: sensor, decider, touch cost, and press if it is not the scene's."""
        own = not self.sensor or (MODELS / self.sensor).is_dir()
        parts = [(self.sensor or self.scene) if own else f"{self.scene}, {Path(self.sensor).name}", self.decider]
        return ", ".join([*parts, f"λ {self.touch_cost:g}", *([self.fidelity] if self.fidelity else [])])

    @property
    def varied(self) -> str:
        """The property that differs from the scene's default; "nothing" for the default itself."""
        words = {"sensor": "sensor", "fidelity": "fidelity", "touch_cost": "touch cost λ", "decider": "decider"}
        default = Configuration(self.scene)
        return next((words[name] for name in words if getattr(self, name) != getattr(default, name)), "nothing")

    @property
    def number(self) -> float | None:
        """The setting, if configurations that differ in a number are joined by a line."""
        return -self.touch_cost if self.varied == "touch cost λ" else None

    def command(self) -> str:
        """The ``compare`` command for this configuration."""
        return command(
            "compare",
            scene=self.scene,
            deciders=self.decider,
            touch_cost=f"{self.touch_cost:g}",
            fidelity=self.fidelity,
            sensor=self.sensor or None,
        )


def sweep(scenes: Sequence[str], sensors: Mapping[str, Sequence[str]]) -> list[Configuration]:
    """Configurations that differ from a scene's default in one property, without duplicates, the defaults first.

    Those of another sensor are played by two deciders, because the best decider depends on the sensor. ``sensors`` are
    folders of further ones, by scene.
    """
    found = []
    for scene in (scene for scene in SHARES if scene in scenes):
        base, own, is_whole = Configuration(scene), SCENES[scene].scene.press_model, scene in _WHOLE
        independent = scene + INDEPENDENT_SUFFIX
        others = [*([independent] if (MODELS / independent).is_dir() else []), *sensors.get(scene, ())]
        weighing = _WEIGH_COSTS if is_whole else _WEIGH_COSTS[:1]
        presses = [] if scene == "paper" else list(FIDELITIES)  # force patches need a guarded move
        not_varied = {"random_confirm", *NEED_FILES, *_SLOW}
        found += [replace(base, decider=decider) for decider in _MAIN]
        found += [replace(base, sensor=sensor, decider=decider) for sensor in others for decider in _MAIN[:2]]
        found += [replace(base, decider=decider, touch_cost=cost) for decider in weighing for cost in _TOUCH_COSTS]
        found += [replace(base, fidelity=name) for name in presses if type(FIDELITIES[name]) is not type(own)]
        found += [replace(base, decider=decider) for decider in DECIDERS if is_whole and decider not in not_varied]
    return list(dict.fromkeys(found))


TASKS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "four objects of four shapes": ("paper", "coarse", "gel"),
        "eight objects of twelve shapes, any mixture": ("hard",),
        "twelve objects of twelve shapes": ("many",),
    }
)
"""Scenes with the same search task and different sensors, by task; each task has a Pareto front."""
_NOTE = (
    "Success: fraction of live searches, with its 95 % Wilson interval. Minus default: difference from the scene's "
    "default over the same searches, with its 95 % bootstrap interval. Times: of one process, which reads images of "
    "25 searches together; planning is in the decisions."
)
_COLUMNS = (
    *("configuration", ("searches", "d"), "success", "minus default", ("touches", ".2f"), ("return", ".3f")),
    *(("ms per search", ".1f"), ("ms per touch", ".2f"), ("physics", ".2f"), ("network", ".2f"), ("decision", ".2f")),
)
_LEAST_ERROR = 3e-4  # lower end of the axis, where an error of zero is drawn
_CAPTION = (
    "Failed searches against time, one panel per scene. Each point is a configuration that differs from the scene's "
    "default in one property, with its 95 % Wilson interval. Lines join the settings of a number. Dashed: no "
    "configuration of the scene is both faster and more successful."
)


@dataclass(frozen=True)
class Measured:
    """Results of the searches of a configuration; ``physics``, ``network``, ``decision`` are per touch [ms]."""

    configuration: Configuration
    successes: tuple[bool, ...]
    touches: float
    reward: float
    physics: float
    network: float
    decision: float

    @property
    def success(self) -> float:
        """Fraction of searches that succeeded."""
        return sum(self.successes) / len(self.successes)

    @property
    def interval(self) -> tuple[float, float]:
        """95 % Wilson interval of the success rate."""
        return wilson_interval(sum(self.successes), len(self.successes))

    @property
    def ms_per_touch(self) -> float:
        """Time from one touch to the next [ms]."""
        return self.physics + self.network + self.decision

    @property
    def ms_per_search(self) -> float:
        """Mean time of a search [ms]."""
        return self.touches * self.ms_per_touch


@dataclass(frozen=True, eq=False)
class TradeoffReport(Reported):
    """Measured configurations, and those recommended for a least success and a longest time per touch [ms]."""

    points: Sequence[Measured]
    least_success: float = 0.98
    most_ms: float = 50.0

    def sentences(self) -> list[str]:
        """The fastest configuration that is accurate enough, and the most accurate that is fast enough, of each task.

        Accuracy is the lower end of the interval of the success rate. Equally accurate configurations are ranked by
        touches, because a touch of a real robot takes longer than the computation.
        """
        lines = []
        for task, scenes in TASKS.items():
            points = sorted(
                (p for p in self.points if p.configuration.scene in scenes), key=lambda point: point.ms_per_search
            )
            if not points:
                continue
            good = [point for point in points if point.interval[0] >= self.least_success]
            fast = [point for point in points if point.ms_per_touch <= self.most_ms]
            best = max(fast, key=lambda p: (p.interval[0], -p.touches, -p.ms_per_search)) if fast else None
            asked = f"the fastest with success ≥ {self.least_success:g} (lower end of its interval)"
            lines.append(f"{task.capitalize()}, {asked}: {_said(good[0] if good else None)}")
            asked = f"the most accurate under {self.most_ms:g} ms per touch, with the fewest touches among equals"
            lines.append(f"{task.capitalize()}, {asked}: {_said(best)}")
        return lines

    def tables(self) -> list[Table]:
        """All configurations of every scene, fastest first; * marks the Pareto front of its task."""
        by_task = [[p for p in self.points if p.configuration.scene in scenes] for scenes in TASKS.values()]
        front = {id(point) for points in by_task if points for point in _front(points)}
        defaults = {p.configuration.scene: p for p in self.points if p.configuration.varied == "nothing"}
        ordered = sorted(self.points, key=lambda point: point.ms_per_search)
        tables = []
        for scene in SHARES:
            rows = [_row(p, defaults.get(scene), id(p) in front) for p in ordered if p.configuration.scene == scene]
            if rows:
                tables.append(Table(scene, _COLUMNS, rows, "*: no other is both faster and as successful.", scene))
        return tables

    def report(self) -> Report:
        """Recommendations, all configurations, and ``tradeoff.csv`` and ``tradeoff.json`` with them."""
        recommended, tables = self.sentences(), self.tables()
        sections = [
            Section("Recommended configurations", recommended, pictures=[front_picture(self.points)]),
            Section("All configurations by scene", [_NOTE], tables),
        ]
        points = [
            {
                **{name: value for name, value in asdict(p).items() if name != "successes"},
                **{name: getattr(p.configuration, name) for name in ("name", "varied", "number")},
                **{name: getattr(p, name) for name in ("success", "interval", "ms_per_search")},
                "searches": len(p.successes),
            }
            for p in self.points
        ]
        files = {
            "tradeoff.csv": Table("", _COLUMNS, [row for table in tables for row in table.rows]).csv(),
            "tradeoff.json": json.dumps({"points": points, "answers": recommended}, indent=1) + "\n",
        }
        return Report("Trade-off between speed and accuracy", sections, markdown="tradeoff.md", files=files)


def _front(points: Sequence[Measured]) -> list[Measured]:
    """Configurations than which no other is both faster and as successful, the fastest first."""
    on_front = pareto_front([p.ms_per_search for p in points], [p.success for p in points])
    return sorted(compress(points, on_front), key=lambda point: point.ms_per_search)


def _said(p: Measured | None) -> str:
    if p is None:
        return "no configuration."
    return (
        f"{p.configuration.name}. Success {interval(p.success, *p.interval)} of {len(p.successes)}, {p.touches:.2f} "
        f"touches and {p.ms_per_search:.1f} ms per search, {p.ms_per_touch:.2f} ms per touch. "
        f"Command: {p.configuration.command()}"
    )


def _row(p: Measured, default: Measured | None, is_on_front: bool) -> tuple[Value, ...]:
    if p is default:
        difference = "default"
    elif default is None or len(p.successes) != len(default.successes):
        difference = "–"
    else:
        mine, other = (np.array(one.successes, float) for one in (p, default))
        difference = interval(*paired_bootstrap(mine, other, np.random.default_rng(0)), spec="+.3f")
    name, success = p.configuration.name + " *" * is_on_front, interval(p.success, *p.interval)
    times = (p.ms_per_search, p.ms_per_touch, p.physics, p.network, p.decision)
    return (name, len(p.successes), success, difference, p.touches, p.reward, *times)


def front_picture(points: Sequence[Measured]) -> Picture:
    """Fraction of failed searches against milliseconds per search, both logarithmic, one panel per scene."""
    from experiments.report import INK, PALETTE, Picture  # loads matplotlib

    styles = {  # colour, marker, and name in the legend, by what differs from the default
        "hypotheses": (PALETTE[0], "P", "number of hypotheses, 64 to 16 384"),
        "touch cost λ": (PALETTE[1], "v", "touch cost λ, 0.1 to 0.005"),
        "sensor": (PALETTE[2], "X", "another shipped sensor"),
        "decider": (PALETTE[3], "o", "decider"),
        "network": (PALETTE[4], "s", "network or resolution"),
        "fidelity": ("#777777", "D", "fidelity of the press"),
        "nothing": (INK, "*", "the scene's default"),
    }
    by_scene = {scene: [p for p in points if p.configuration.scene == scene] for scene in SHARES}
    panels = [partial(_draw, scene=scene, points=some, styles=styles) for scene, some in by_scene.items() if some]
    legend = {label: colour for colour, _, label in styles.values()}
    return Picture("tradeoff", _CAPTION, panels, legend, size=(3.6, 3.0), columns=3)


def _draw(axes: Axes, scene: str, points: Sequence[Measured], styles: Mapping[str, tuple[str, str, str]]) -> None:
    from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter

    for what, (colour, marker, _) in styles.items():
        of_kind = [point for point in points if point.configuration.varied == what]
        for point in of_kind:
            low, high = point.interval
            axes.plot([point.ms_per_search] * 2, [_error(high), _error(low)], color=colour, linewidth=0.6, alpha=0.35)
        size = 150 if what == "nothing" else 30
        times, errors = [point.ms_per_search for point in of_kind], [_error(point.success) for point in of_kind]
        axes.scatter(times, errors, size, colour, marker=marker, alpha=0.85, linewidths=0, zorder=3)
        numbered = sorted(
            (p for p in of_kind if p.configuration.number is not None), key=lambda p: p.configuration.number or 0.0
        )
        for decider in dict.fromkeys(p.configuration.decider for p in numbered):
            path = [(p.ms_per_search, _error(p.success)) for p in numbered if p.configuration.decider == decider]
            axes.plot(*np.transpose(path), color=colour, linewidth=1.2, alpha=0.7)
    best = [(p.ms_per_search, _error(p.success)) for p in _front(points)]
    axes.step(*np.transpose(best), where="post", color=styles["nothing"][0], linewidth=1, linestyle="--")
    axes.set(xscale="log", yscale="log", xlabel="ms per search", ylabel="failed searches", title=scene)
    axes.set_ylim(_LEAST_ERROR * 0.7, 1.0)
    axes.yaxis.set_major_locator(FixedLocator([_LEAST_ERROR, 0.001, 0.01, 0.1, 1.0]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: "0" if y == _LEAST_ERROR else f"{y:g}"))
    axes.yaxis.minorticks_off()
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _error(success: float) -> float:
    return max(1 - success, _LEAST_ERROR)
