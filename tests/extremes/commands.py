"""Extremes of the commands: senseless arguments, and run folders that are damaged or belong to other runs."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from activetouch.errors import DuplicateShape, ImpossibleRecipe
from activetouch.perception.recipe import RECIPES
from belief.errors import CannotWrite, CorruptFile, UnknownName
from belief.files import sealed_json
from experiments.calibration.calibration_report import CalibrationReport
from experiments.command_line.arguments import BadArgument
from experiments.press.explain import Explain
from experiments.press.touch import TouchCommand
from experiments.scene_choice import SceneChoice
from experiments.search.compare import Compare
from experiments.search.play import Setting
from experiments.search.replay import Replay
from experiments.search.run import RunFolder, RunMismatch
from experiments.sensor.collect import Collect
from experiments.sensor.train import Changes, Train
from experiments.sensor_choice import NoSensor
from tests.extremes.cases import Case, answers, equal_to, in_folder, refuses

_COARSE = Setting(SceneChoice("coarse"))
_NAN_RATE = Changes(learning_rate=math.nan)
_NO_COLLECTION = CalibrationReport(data=Path("nowhere"))


def _compare(folder: Path, **how: Any) -> Compare:
    return replace(Compare(("random_confirm",), None, ("cone",), 3, setting=_COARSE, out=folder / "run", jobs=1), **how)


def _played(**how: Any) -> Callable[[], object]:
    return in_folder(lambda folder: _compare(folder, **how).play())


def _in_setting(**how: Any) -> Callable[[], object]:
    return _played(setting=replace(_COARSE, **how))


def _after(change: Callable[[Path], object], **how: Any) -> Callable[[], object]:
    """Play, change the folder, play again."""

    def twice(folder: Path) -> int:
        _compare(folder).play()
        change(folder / "run")
        return len(_compare(folder, **how).play().episodes["random_confirm", "cone"])

    return in_folder(twice)


def _unchanged(folder: Path) -> None:
    pass


def _without_cell(folder: Path) -> None:
    [cell] = (folder / "cells").glob("random_confirm-*.jsonl")
    cell.unlink()


def _with_unfinished_batch(folder: Path) -> None:
    for cell in (folder / "cells").glob("*.jsonl"):
        cell.write_bytes(cell.read_bytes()[:-99])


def _truncated(folder: Path) -> None:
    file = folder / "run.json"
    file.write_text(file.read_text()[:99])


def _into_a_file(folder: Path) -> None:
    (folder / "run").write_text("mine")
    _compare(folder).play()


def _with_versions(folder: Path) -> None:
    run = json.loads((folder / "run.json").read_text())
    del run["sha256"]
    run["identity"]["versions"]["onnxruntime"] = "1.0"
    (folder / "run.json").write_text(sealed_json(run))


def _missing_episode(folder: Path) -> None:
    _compare(folder).run()
    Replay(folder / "run", "random_confirm", "cone", number=30, out=folder / "x.png").run()


def _named_like_a_shape(folder: Path) -> None:
    mesh = folder / "cone.obj"
    mesh.write_text("v 0 0 0\nv .02 0 0\nv 0 .02 0\nv 0 0 .02\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n")
    Collect(SceneChoice("gel", meshes=(mesh,)), folder / "out").run()


def _of_no_collection(folder: Path) -> None:
    Train(data=folder / "none", out=folder / "out").run()


CASES: tuple[Case, ...] = (
    refuses("compare", "a truncated run.json", _after(_truncated), CorruptFile, "Choose another --out"),
    refuses("compare", "a file as --out", in_folder(_into_a_file), CannotWrite, "is no folder"),
    refuses("compare", "no decider", _played(deciders=()), BadArgument, "must name one"),
    refuses("compare", "a misspelt decider", _played(deciders=("threshhold",)), UnknownName, "mean 'threshold'"),
    refuses("compare", "a misspelt target", _played(targets=("cohne",)), UnknownName, "Did you mean 'cone'"),
    refuses("compare", "a misspelt scene", _in_setting(choice=SceneChoice("coarze")), UnknownName, "mean 'coarse'"),
    refuses("compare", "five distinct objects of four shapes", _in_setting(num_objects=5), BadArgument, "independent"),
    refuses("compare", "a missing sensor", _in_setting(sensor=Path("nowhere")), NoSensor, "holds no sensor"),
    refuses("compare", "a run of another seed in the folder", _after(_unchanged, seed=1), RunMismatch, "other seed"),
    refuses("compare", "a run of other versions in the folder", _after(_with_versions), RunMismatch, "other versions"),
    answers("compare", "a missing cell: played again", _after(_without_cell), equal_to(3)),
    answers("compare", "an unfinished batch of a killed run", _after(_with_unfinished_batch), equal_to(3)),
    answers("compare", "more episodes than there are", _after(_unchanged, episodes=5), equal_to(5)),
    refuses("RunFolder", "no run.json", in_folder(lambda f: RunFolder(f).read_run()), FileNotFoundError, "compare"),
    refuses("replay", "an empty folder", in_folder(lambda f: Replay(f).run()), FileNotFoundError, "holds no run"),
    refuses("replay", "a missing episode", in_folder(_missing_episode), FileNotFoundError, "numbers 0 to 2"),
    refuses("touch", "a misspelt shape", TouchCommand(shape="conee").run, UnknownName, "Did you mean 'cone'"),
    refuses("explain", "an unknown scene", Explain(SceneChoice("nowhere")).run, UnknownName, "Known: paper"),
    refuses("collect", "a mesh named like a shape", in_folder(_named_like_a_shape), DuplicateShape, "other names"),
    refuses("train", "a missing collection", in_folder(_of_no_collection), CorruptFile, "activetouch collect|manifest"),
    refuses("train", "a rate of NaN", lambda: _NAN_RATE.of(RECIPES["paper"]), ImpossibleRecipe, "learning_rate"),
    refuses("calibration-report", "a missing collection", _NO_COLLECTION.run, CorruptFile, "nowhere"),
)
"""Cases of the commands."""
