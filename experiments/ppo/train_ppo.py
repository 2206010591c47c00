"""``activetouch train-ppo``: from touch banks to one policy a target."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import numpy as np

from activetouch.errors import WrongScene
from activetouch.scene_description import require_scene
from activetouch.world import MODELS, observation_model_and_scene
from belief.errors import CorruptFile, UnknownName
from belief.files import atomic_path, require_writable, write_text
from experiments.command_line.arguments import Count, Jobs, NotNegative, Positive, Within, check_arguments
from experiments.parallel import default_jobs, run_tasks
from experiments.ppo.recipe import PPO_RECIPES, ImpossiblePPO, PPORecipe
from experiments.ppo.touch_bank import TEST, TRAINING
from experiments.scene_choice import bank_folder, in_file_names, named_scene
from experiments.sensor_choice import command, tell_shift
from planners.ppo import policy_file

if TYPE_CHECKING:
    from experiments.ppo.training import Score, Training

_PROB = Within(0.0, 1.0, open_low=True, open_high=True)
RecipeName: TypeAlias = Literal[tuple(PPO_RECIPES)]  # type: ignore[valid-type]


@dataclass(frozen=True)
class PPOChanges:
    """What to change about the named recipes."""

    steps: Count | None = None
    """Of all environments together."""
    learning_rate: Positive | None = None
    """At the start; falls linearly to nothing."""
    entropy: NotNegative | None = None
    """Weight of the entropy bonus."""
    beta: NotNegative | None = None
    """Weight of the shaping reward (decision 0031)."""
    touch_cost: NotNegative | None = None
    """λ."""
    touch_limit: Count | None = None
    """T_max, touches of one object."""
    target_prob: Annotated[float | tuple[float, float] | None, _PROB] = None
    """How often the object of a training episode is the target, or a range (decisions 0030 and 0024)."""

    def of(self, recipe: PPORecipe) -> PPORecipe:
        """The recipe with these changes."""
        return replace(recipe, **{name: value for name, value in asdict(self).items() if value is not None})


@dataclass(frozen=True)
class TrainPPO:
    """Train PPO policies on recorded touches, one a target and seed, and keep the best seed of each.

    Every training is kept in a folder of its own and goes on from there when the command is started again. Learning
    curves are measured on the objects of the test split; which seed is kept, on those it learned from. OUT/policies is
    what the deciders ppo, ppo_posterior and ppo_confident read: it belongs beside the sensor, in SENSOR/policies. With
    tensorboard installed, SB3's log is in the folder of each training.

    For example:

        activetouch touch-bank --scene coarse
        activetouch train-ppo --scene coarse
        activetouch train-ppo --scene coarse --targets cone --recipes posterior_masked --seeds 1 --out runs/ppo-masked
    """

    scene: str = "gel"
    """The scene it is for: decides the next three where they are not given."""
    bank: Path | None = None
    """Folder of the touch banks; data/SCENE-bank by default."""
    sensor: Path | None = None
    """Folder of the observation model; that of the sensor that comes with the scene by default."""
    out: Path | None = None
    """Where trainings and policies are kept; runs/ppo-SCENE by default."""
    targets: tuple[str, ...] = ()
    """Shapes to train for; all by default."""
    recipes: tuple[RecipeName, ...] = ("paper", "posterior")
    """What policies see, and how they learn; one recipe a state."""
    change: PPOChanges = field(default_factory=PPOChanges)
    """Settings that differ from the recipes'."""
    seeds: Count = 3
    """Trainings of each."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Processes."""
    anyway: bool = False
    """Use banks of another scene than the sensor's."""

    def run(self) -> None:
        """Train what is missing, choose, and write policies and learning curves."""
        check_arguments(self)
        from experiments.ppo.training import POLICY  # loads gymnasium

        named_scene(self.scene)  # or say which there are
        recipes = self._recipes()
        out = self.out if self.out is not None else Path(f"runs/ppo-{in_file_names(self.scene)}")
        require_writable(out)
        trainings = self._trainings(out, recipes)
        tasks = [partial(_run, index, training) for index, training in enumerate(trainings)]
        curves: dict[int, list[Score]] = {}
        for index, curve in run_tasks(tasks, self.jobs, "training policies"):
            curves[index] = curve
            training, last = trainings[index], curve[-1]
            print(
                f"{training.recipe.state} {training.target} seed {training.seed}: return {last.mean_return:.3f}, "
                f"success {last.success:.3f}, {last.touches:.2f} touches"
            )
        groups: dict[tuple[str, str], list[int]] = {}
        for index, training in enumerate(trainings):
            groups.setdefault((training.recipe.state, training.target), []).append(index)
        found: dict[str, dict[str, list[list[Score]]]] = {}
        chosen: dict[int, list[Score]] = {}
        for (state, target), members in groups.items():
            best = max(members, key=lambda index: trainings[index].score().mean_return)
            chosen[best] = curves[best]
            with atomic_path(out / "policies" / policy_file(state, target)) as temporary:
                temporary.write_bytes((trainings[best].folder / POLICY).read_bytes())
            found.setdefault(state, {})[target] = [curves[index] for index in members]
        self._compare_with_references(trainings, chosen, out)
        write_text(out / "curves.json", json.dumps(found, indent=1) + "\n")
        draw_curves(found, out / "curves.svg")
        print(f"wrote {out / 'policies'} and the learning curves, {out / 'curves.svg'}")

    @staticmethod
    def _compare_with_references(trainings: Sequence[Training], chosen: Mapping[int, list[Score]], out: Path) -> None:
        """Print and write what the chosen policies return beside what there is to be had."""
        from experiments.ppo.reference import reference

        rows = []
        for index, curve in chosen.items():
            one = trainings[index]
            against = reference(one.bank, one.test_bank, one.model, one.target, one.recipe)
            last, best = curve[-1], against.score
            rows.append({"state": one.recipe.state, "target": one.target, **last._asdict(), **asdict(against)})
            confirm, reject = against.thresholds
            print(
                f"{one.recipe.state} {one.target}: return {last.mean_return:.3f} is "
                f"{last.mean_return / best.mean_return:.3f} of the {best.mean_return:.3f} of the best thresholds "
                f"({reject}, {confirm}); at most {against.optimum:.3f} in the table of outcomes, repeats priced; "
                f"all touches for nothing {against.free:.3f}"
            )
        write_text(out / "references.json", json.dumps(rows, indent=1) + "\n")

    def _recipes(self) -> dict[str, PPORecipe]:
        """The changed recipes by name, or an error about an argument."""
        recipes = {name: self.change.of(PPO_RECIPES[name]) for name in self.recipes}
        if not recipes or len({recipe.state for recipe in recipes.values()}) < len(self.recipes):
            raise ImpossiblePPO("--recipes", "one recipe a state", " ".join(self.recipes))
        return recipes

    def _trainings(self, out: Path, recipes: Mapping[str, PPORecipe]) -> list[Training]:
        """All trainings, or an error before any is started."""
        from activetouch.envs.touch_bank import TouchBank  # loads gymnasium
        from experiments.ppo.training import Training

        folder = self.bank if self.bank is not None else bank_folder(self.scene)
        sensor = self.sensor if self.sensor is not None else MODELS / self.scene
        model, fitted_to = observation_model_and_scene(sensor)
        remedy = "Make it again with: " + command("touch-bank", scene=self.scene, sensor=sensor, out=folder)
        try:
            bank, test_bank = TouchBank.open(folder / TRAINING), TouchBank.open(folder / TEST)
        except CorruptFile as error:
            raise CorruptFile(f"{error}. {remedy}") from error
        for one in (bank, test_bank):
            if one.scene != fitted_to:
                try:
                    tell_shift(require_scene(f"the model in {sensor}", fitted_to, one.scene or {}, self.anyway))
                except WrongScene as error:
                    raise WrongScene(f"{folder} is no bank for it: {error}. {remedy}") from error
        for target in self.targets:
            if target not in bank.shape_labels:
                raise UnknownName("target", target, list(bank.shape_labels))
        return [
            Training(bank, test_bank, model, target, recipe, seed, out / f"{name}-{target}-{seed}")
            for name, recipe in recipes.items()
            for target in dict.fromkeys(self.targets or bank.shape_labels)
            for seed in range(self.seeds)
        ]


def _run(index: int, training: Training) -> tuple[int, list[Score]]:
    import torch

    torch.set_num_threads(1)  # networks this small only lose by more
    return index, training.run()


def draw_curves(found: Mapping[str, Mapping[str, Sequence[Sequence[Score]]]], path: Path) -> None:
    """Return against steps, one panel a state, one colour a target: the mean of the seeds, and their range."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.2 * len(found), 3.2), layout="constrained")
    axes = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
    for panel, (state, targets) in zip(axes, found.items(), strict=True):
        for index, (target, curves) in enumerate(targets.items()):
            length = min(len(curve) for curve in curves)
            steps = np.array([[point[0] for point in curve[:length]] for curve in curves]).mean(axis=0) / 1000
            values = np.array([[point[1] for point in curve[:length]] for curve in curves])
            panel.plot(steps, values.mean(axis=0), color=f"C{index}", label=target)
            panel.fill_between(steps, values.min(axis=0), values.max(axis=0), color=f"C{index}", alpha=0.2, lw=0)
        panel.set(title=f"state: {state}", xlabel="thousand steps")
    axes[0].set_ylabel("return of a test")
    axes[0].set_ylim(-0.25, 1.02)  # networks that have learned nothing may lie lower
    axes[-1].legend()
    with atomic_path(path) as temporary:
        figure.savefig(temporary)
