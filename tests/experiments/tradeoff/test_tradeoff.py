"""The trade of speed for accuracy: fronts and picks by hand, and a small sweep that resumes."""

import csv
import json
import shlex
import shutil
from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest

from activetouch.errors import LabelMismatch
from activetouch.sensor_files import MODELS
from belief.errors import UnknownName
from experiments.command_line.arguments import BadArgument
from experiments.tradeoff.report import SHARES, Configuration, Measured, TradeoffReport, sweep
from experiments.tradeoff.tradeoff import Tradeoff, measure_all
from planners import DECIDERS
from planners.registry import NEED_FILES

GEL = Configuration("gel")


def point(name: str, successes: int, touches: float, number: int = 400, **changes) -> Measured:
    """A touch takes one millisecond."""
    right = (True,) * successes + (False,) * (number - successes)
    return Measured(replace(GEL, decider=name, **changes), right, touches, 0.0, 0.5, 0.25, 0.25)


def test_a_sweep_names_every_decider_that_needs_no_training_and_nothing_twice():
    found = sweep(["coarse", "gel", "paper"], {"gel": ["runs/small"]})
    assert len({c.name for c in found}) == len(found) >= 30
    left_out = {"random_confirm", "pouct", *NEED_FILES}
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
    assert GEL.command() == ("activetouch compare --scene gel --deciders information_gain --touch-cost 0.02")


def test_the_front_and_the_recommendations_are_those_found_by_hand(tmp_path):
    base, cheap = point("information_gain", 399, 4), point("threshold", 300, 2)
    wasteful, best = point("fixed_poses", 399, 8), point("value_of_information", 400, 9)
    fewer = point("random_poses", 90, 9, number=90)
    other = replace(point("fixed_poses", 390, 5), configuration=Configuration("coarse", decider="fixed_poses"))
    found = TradeoffReport([best, wasteful, base, cheap, fewer, other])
    fastest, accurate = found.sentences()
    assert f"{base.configuration.name}. Success 0.998 [" in fastest
    assert f"{best.configuration.name}. Success 1.000 [" in accurate
    assert "9.00 touches and 9.0 ms per search, 1.00 ms per touch" in accurate
    none = TradeoffReport([best, base, cheap], least_success=0.9999, most_ms=0.5).sentences()
    assert all(said.endswith("no configuration.") for said in none)
    found.save(tmp_path)
    rows = list(csv.DictReader((tmp_path / "tradeoff.csv").read_text().splitlines()))
    names = [one.configuration.name for one in (cheap, base, wasteful, best, fewer, other)]
    assert [row["configuration"].removesuffix(" *") for row in rows] == names  # scene by scene, the fastest first
    assert [row["configuration"].endswith(" *") for row in rows] == [True, True, False, True, True, False]
    against = {row["configuration"].removesuffix(" *"): row["minus_default"] for row in rows}
    assert against[base.configuration.name] == "default"
    assert against[best.configuration.name].startswith("'+0.003 [+0.0")  # no formula
    assert against[fewer.configuration.name] == "–"  # it played fewer searches
    assert against[other.configuration.name] == "–"  # its scene has no default
    stored = json.loads((tmp_path / "tradeoff.json").read_text())
    assert stored["answers"] == [fastest, accurate]
    assert [one["name"] for one in stored["points"]] == [one.configuration.name for one in found.points]
    assert fastest in str(found)


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
def test_searches_are_kept_and_read_not_played_again(tmp_path):
    two = [Configuration("coarse", decider=name, fidelity="quasistatic") for name in ("threshold", "information_gain")]
    first = measure_all(two, 1, 0, tmp_path)
    assert [one.configuration for one in first] == two
    assert {len(one.successes) for one in first} == {4}
    assert all(one.ms_per_search > 0.0 for one in first)
    assert measure_all(two, 1, 0, tmp_path) == first  # and so are the times


def test_the_figures_of_the_documentation_are_those_of_its_table():
    folder = Path(__file__).parents[3] / "records" / "tradeoff"
    numbers = json.loads((folder / "searches_0.txt").read_text().partition(".json:\n\n")[2])
    page = (Path(__file__).parents[3] / "docs" / "tradeoff.md").read_text()
    assert len(numbers["points"]) >= 40
    assert {p["configuration"]["scene"] for p in numbers["points"]} == set(SHARES)
    assert any("Command: activetouch compare --scene gel" in line for line in numbers["answers"])
    for line in numbers["answers"]:
        assert line.partition("Command: ")[2] in page  # nothing where no configuration qualifies
