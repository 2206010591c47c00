"""The trade of speed for accuracy: keys, recorded worlds, fronts and picks by hand, a small sweep that resumes."""

import csv
import json
import shlex
import shutil
from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest

from activetouch.errors import LabelMismatch
from activetouch.named_scenes import SCENES
from activetouch.sensor_files import MODELS
from belief.errors import UnknownName
from experiments.command_line.arguments import BadArgument
from experiments.tradeoff.configuration import SHARES, Configuration, sweep
from experiments.tradeoff.measure import Measured, fronts, picks
from experiments.tradeoff.report import TradeoffReport
from experiments.tradeoff.tradeoff import Tradeoff, measure_all
from planners import DECIDERS
from planners.registry import NEED_FILES

GEL = Configuration("gel")


def point(name: str, successes: int, touches: float, press: float = 1.0, **changes) -> Measured:
    """Of 400 searches."""
    configuration = replace(GEL, decider=name, **changes)
    right = [1] * successes + [0] * (400 - successes)
    return Measured(configuration, right, [int(touches)] * 400, [int(touches) + 1] * 400, [0.0] * 400, 0.0, press, 0.0)


def test_a_key_follows_from_what_decides_the_result_and_from_nothing_else(tmp_path):
    base = replace(GEL, sensor=str(shutil.copytree(MODELS / "gel", tmp_path / "one")))
    moved = replace(base, sensor=str(shutil.copytree(MODELS / "gel", tmp_path / "other")))
    assert moved.key == base.key == GEL.key
    (tmp_path / "other" / "reader.safetensors").write_bytes(b"another")
    changes = [
        {"decider": "threshold"}, {"touch_cost": 0.03}, {"fidelity": "quasistatic"}, {"episodes": 9}, {"seed": 1},
        {"sensor": moved.sensor},
    ]  # fmt: skip
    keys = [replace(base, **change).key for change in changes]
    assert len({base.key, *keys}) == len(changes) + 1


def test_a_sweep_names_every_decider_that_needs_no_training_and_nothing_twice():
    found = sweep(["coarse", "gel", "paper"], {"gel": ["runs/small"]}, episodes=100, seed=0)
    assert len({c.name for c in found}) == len(found) >= 30
    left_out = {"random_confirm", "pouct", "pomcp", *NEED_FILES}
    wanted = {name for name in DECIDERS if name not in left_out}
    assert {c.decider for c in found if c.scene == "coarse"} == wanted
    for sensor in ("paper-independent", "runs/small"):
        assert {c.decider for c in found if c.sensor == sensor} == {"information_gain", "point_based"}
    priced = {(c.decider, c.touch_cost) for c in found if c.scene == "coarse" and c.touch_cost != 0.02}
    assert priced == set(product(("point_based", "value_of_information"), (0.005, 0.05, 0.1)))
    assert {c.fidelity for c in found} == {None, "quasistatic", "guarded_move"}


def test_the_command_of_a_configuration_is_one_for_a_shell(tmp_path):
    folder = str(shutil.copytree(MODELS / "gel", tmp_path / "my sensor"))
    words = shlex.split(replace(GEL, sensor=folder, fidelity="dynamic").command())
    assert words[words.index("--sensor") + 1] == folder
    assert words[words.index("--fidelity") + 1] == "dynamic"
    assert GEL.command() == (
        f"activetouch compare --scene gel --deciders information_gain --touch-cost 0.02 --out runs/compare-{GEL.key}"
    )


def test_the_front_and_the_picks_are_those_found_by_hand():
    cheap = point("threshold", 300, 2)
    good = point("information_gain", 399, 4)
    wasteful = point("fixed_poses", 399, 8)
    best = point("value_of_information", 400, 9)
    [front] = fronts([best, wasteful, good, cheap])
    assert list(front.points) == [cheap, good, wasteful, best]
    assert front.on_front.tolist() == [True, True, False, True]
    assert [pick.point for pick in picks(front, 0.98, 50.0)] == [good, best]
    assert [pick.point for pick in picks(front, 0.9999, 0.5)] == [None, None]


def test_the_report_says_of_each_configuration_what_was_measured(tmp_path):
    base = point("information_gain", 380, 3)
    better = point("value_of_information", 390, 4)
    fewer = replace(point("threshold", 400, 9), successes=[1] * 90, touches=[9] * 90, decisions=[10] * 90,
                    rewards=[0.5] * 90)  # fmt: skip
    other = replace(base, configuration=Configuration("coarse", decider="fixed_poses"))
    found = TradeoffReport([base, better, fewer, other], 0.9, 0.5)
    found.save(tmp_path)
    numbers = json.loads((tmp_path / "tradeoff.json").read_text())
    entries = {entry["key"]: entry for entry in numbers["points"]}
    for one in found.points:
        entry = entries[one.configuration.key]
        assert (entry["searches"], entry["success"]) == (one.num_searches, one.success)
        assert (entry["touches"], entry["ms_per_search"]) == (one.mean_touches, one.ms_per_search)
    rows = list(csv.DictReader((tmp_path / "tradeoff.csv").read_text().splitlines()))
    assert [row["configuration"] for row in rows] == [  # scene after scene, the fastest first
        one.configuration.name for one in (base, better, fewer, other)
    ]
    against = {row["configuration"]: row["minus_default"] for row in rows}
    assert against[base.configuration.name] == "default"
    assert against[better.configuration.name].startswith("'+0.025 [+0.0")  # no formula
    assert against[fewer.configuration.name] == "–"  # it played fewer searches
    assert against[other.configuration.name] == "–"  # its scene has no default
    fastest, accurate = numbers["answers"]
    assert f"{base.configuration.name}. Success 0.950 [" in fastest
    assert accurate.endswith("under 0.5 ms per touch, with the fewest touches among equals: no configuration.")
    assert fastest in str(found)
    assert "4 configurations in 2 scenes (gel, coarse), 1 290 live searches" in (tmp_path / "report.html").read_text()


def test_what_makes_no_sense_is_refused(tmp_path):
    for scene in ("coarze", "keyed"):
        with pytest.raises(UnknownName, match="coarse"):
            Tradeoff(scenes=(scene,), out=tmp_path).run()
    for sensor in ("runs/mine", "hard=runs/mine", "coarse="):
        with pytest.raises(BadArgument, match="SCENE=FOLDER"):
            Tradeoff(scenes=("coarse",), sensors=(sensor,), out=tmp_path).run()
    with pytest.raises(LabelMismatch):
        Tradeoff(scenes=("coarse",), sensors=("coarse=many",), out=tmp_path).run()


@pytest.mark.mujoco
def test_results_are_kept_and_read_not_searched_again(tmp_path):
    two = [Configuration("coarse", episodes=1, decider=name) for name in ("threshold", "information_gain")]
    first = measure_all(two, tmp_path)
    assert [one.configuration for one in first] == two
    shard = tmp_path / "results" / f"{two[0].key}.json"
    shard.write_text(shard.read_text().replace('"ms_per_decision": ', '"ms_per_decision": 1'))
    (tmp_path / "results" / f".{shard.name}.half").write_text('{"configurat')  # of a killed run
    again = measure_all(two, tmp_path)
    assert again[0].ms_per_decision > first[0].ms_per_decision
    assert again[0].successes == first[0].successes
    assert again[1] == first[1]


def test_the_figures_of_the_documentation_are_those_of_its_table():
    folder = Path(__file__).parents[3] / "records" / "tradeoff"
    numbers = json.loads((folder / "tradeoff.json").read_text())
    page = (Path(__file__).parents[3] / "docs" / "tradeoff.md").read_text()
    assert len(numbers["points"]) >= 40
    assert {p["configuration"]["network"]["scene"] for p in numbers["points"]} == set(SHARES)
    with (folder / "tradeoff.csv").open(newline="") as file:
        rows = list(csv.reader(file))[1:]
    assert len(rows) == len(numbers["points"])
    written = {tuple(row[:3]) for row in rows}
    shown = [tuple(line.strip("| ").split(" | ")[:3]) for line in page.splitlines() if line.count("|") == 14]
    shown = [row for row in shown if row[0].split(",")[0] in SCENES]
    assert len(shown) >= 8
    assert set(shown) <= written
    for line in numbers["answers"]:
        assert line.split(". Success")[0] in " ".join(page.split())
