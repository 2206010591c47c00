"""Extremes of the commands: senseless arguments, and run folders that are damaged or belong to other runs."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from activetouch.errors import ImpossibleRecipe, UnknownLikelihood
from activetouch.perception.recipe import RECIPES
from activetouch.rendering import Quantisation
from belief.errors import CannotWrite, CorruptFile, UnknownName
from belief.files import sealed_json
from experiments.bayes_error.image_bank import SensorNoise
from experiments.calibration.calibration_report import CalibrationReport
from experiments.command_line.arguments import BadArgument
from experiments.extremes.cases import Case, answers, equal_to, in_folder, refusals, refuses
from experiments.press.explain import Explain
from experiments.press.touch import Touch
from experiments.scene_choice import DuplicateShape, SceneChoice
from experiments.search.compare import Compare
from experiments.search.replay import Replay
from experiments.search.run_folder import RunFolder, RunMismatch, ShardKey
from experiments.search.setting import Setting
from experiments.sensor.collect import Collect
from experiments.sensor.train import Changes, Train
from experiments.sensor_choice import NoSensor

_COARSE = Setting(SceneChoice("coarse"))


def _compare(folder: Path, **how: object) -> Compare:
    asked = {
        "deciders": ("random_confirm",),
        "targets": ("cone",),
        "episodes": 3,
        "setting": _COARSE,
        "out": folder / "run",
        "jobs": 1,
    }
    return Compare(**{**asked, **how})


def _played(**how: object) -> Callable[[], object]:
    return in_folder(lambda folder: _compare(folder, **how).play())


def _after(change: Callable[[Path], None], **how: object) -> Callable[[], object]:
    """Play, change the folder, play again."""

    def twice(folder: Path) -> int:
        _compare(folder).play()
        change(folder / "run")
        return len(_compare(folder, **how).play().episodes["random_confirm", "cone"])

    return in_folder(twice)


def _lose(folder: Path) -> None:
    [shard] = (folder / "shards").glob("random_confirm-*.jsonl")
    shard.unlink()


def _litter(folder: Path) -> None:
    (folder / "shards" / ".cone.jsonl.half").write_text('{"half a li')


def _cut_run(folder: Path) -> None:
    file = folder / "run.json"
    file.write_text(file.read_text()[:99])


def _into_a_file(folder: Path) -> None:
    (folder / "run").write_text("mine")
    _compare(folder).play()


def _with_versions(folder: Path) -> None:
    run = json.loads((folder / "run.json").read_text())
    del run["sha256"]
    run["identity"]["versions"]["torch"] = "1.0"
    (folder / "run.json").write_text(sealed_json(run))


_TETRAHEDRON = "v 0 0 0\nv .02 0 0\nv 0 .02 0\nv 0 0 .02\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"

CASES: tuple[Case, ...] = (
    refuses("compare", "a run.json that was cut off", _after(_cut_run), CorruptFile, "Choose another --out"),
    refuses("compare", "a file as --out", in_folder(_into_a_file), CannotWrite, "is no folder"),
    refuses("compare", "no decider", _played(deciders=()), BadArgument, "must name one"),
    *refusals(
        "compare",
        UnknownName,
        {
            "a decider with a slip": (_played(deciders=("threshhold",)), "Did you mean 'threshold'"),
            "a target with a slip": (_played(targets=("cohne",)), "Did you mean 'cone'"),
            "a scene with a slip": (_played(setting=Setting(SceneChoice("coarze"))), "Did you mean 'coarse'"),
        },
    ),
    *refusals(
        "compare",
        BadArgument,
        {
            "five distinct objects of four shapes": (_played(setting=replace(_COARSE, num_objects=5)), "independent"),
        },
    ),
    refuses(
        "compare",
        "a sensor that is not there",
        _played(setting=replace(_COARSE, sensor=Path("nowhere"))),
        NoSensor,
        "holds no sensor",
    ),
    *refusals(
        "compare",
        RunMismatch,
        {
            "a run of another seed in the folder": (_after(lambda folder: None, seed=1), "other seed"),
            "a run of other versions in the folder": (_after(_with_versions), "other versions"),
        },
    ),
    answers("compare", "a shard that was lost: played again", _after(_lose), equal_to(3)),
    answers("compare", "what a kill in the middle of writing leaves", _after(_litter), equal_to(3)),
    answers("compare", "more episodes than there are", _after(lambda folder: None, episodes=5), equal_to(5)),
    refuses(
        "RunFolder.read_run",
        "an empty folder",
        in_folder(lambda folder: RunFolder(folder).read_run()),
        FileNotFoundError,
        "activetouch compare --out",
    ),
    refuses(
        "RunFolder.lines",
        "a shard that is not there",
        in_folder(lambda folder: RunFolder(folder).lines(ShardKey("a", "b", 0))),
        FileNotFoundError,
        "play it with",
    ),
    *refusals(
        "replay",
        FileNotFoundError,
        {
            "an empty folder": (in_folder(lambda folder: Replay(folder).run()), "holds no run"),
            "an episode that was not played": (
                in_folder(
                    lambda f: [
                        _compare(f).play(),
                        Replay(f / "run", "random_confirm", "cone", number=30, out=f / "x.png").run(),
                    ]
                ),
                "numbers 0 to 2",
            ),
        },
    ),
    refuses("touch", "a shape with a slip", lambda: Touch(shape="conee").run(), UnknownName, "Did you mean 'cone'"),
    refuses("explain", "an unknown scene", lambda: Explain(SceneChoice("nowhere")).run(), UnknownName, "Known: paper"),
    refuses(
        "collect",
        "a mesh that is called like a shape",
        in_folder(
            lambda f: [
                (f / "cone.obj").write_text(_TETRAHEDRON),
                Collect(SceneChoice("gel", meshes=(f / "cone.obj",)), f / "out").run(),
            ]
        ),
        DuplicateShape,
        "other names",
    ),
    refuses(
        "collect",
        "a manifest that is not there",
        in_folder(lambda f: Collect(from_manifest=f / "none", out=f / "out").run()),
        CorruptFile,
        "none",
    ),
    refuses(
        "train",
        "a collection that is not there",
        in_folder(lambda f: Train(data=f / "none", out=f / "out").run()),
        CorruptFile,
        "activetouch collect|manifest",
    ),
    refuses(
        "train",
        "a rate of NaN",
        lambda: Changes(learning_rate=float("nan")).of(RECIPES["paper"]),
        ImpossibleRecipe,
        "learning_rate",
    ),
    refuses(
        "calibration-report",
        "a collection that is not there",
        in_folder(lambda f: CalibrationReport(data=f / "none").run()),
        CorruptFile,
        "none",
    ),
    refuses(
        "limit",
        "a sensor whose likelihood has no closed form",
        lambda: SensorNoise.of((Quantisation(4),), 4),
        UnknownLikelihood,
        "Quantisation",
    ),
)
"""Cases of the commands."""
