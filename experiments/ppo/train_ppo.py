"""``activetouch train-ppo``: PPO policies from touch banks, one per target or one for all."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import numpy as np

from activetouch.errors import WrongScene
from activetouch.extras import require_extra
from activetouch.scene_description import require_scene
from activetouch.sensor_files import fitted_model
from belief.claims import claim_folder, ends_claims
from belief.errors import CorruptFile, UnknownName
from belief.files import atomic_path, in_file_name, write_text
from belief.policy_state import GOAL, WITH_GAINS
from experiments.command_line.arguments import Count, Jobs, NotNegative, Positive, Within, check_arguments
from experiments.parallel import default_jobs, run_tasks
from experiments.ppo.recipe import PPO_RECIPES, ImpossiblePPO, PPORecipe
from experiments.ppo.touch_bank import TEST, TRAINING
from experiments.scene_choice import bank_folder, in_file_names, named_scene
from experiments.sensor_choice import load_quietly, sensor_folder, tell_shift
from experiments.sensor_commands import command
from planners.ppo import policy_file

if TYPE_CHECKING:
    from experiments.ppo.training import Score, Training

ALL = "all"
"""What stands for the target of a policy for all of them."""
_PROB = Within(0.0, 1.0, open_low=True, open_high=True)
RecipeName: TypeAlias = Literal[tuple(PPO_RECIPES)]  # type: ignore[valid-type]


@dataclass(frozen=True)
class PPOChanges:
    """Changes to the named recipes."""

    steps: Count | None = None
    """Total number of steps of all environments."""
    learning_rate: Positive | None = None
    """Initial learning rate; it falls linearly to zero."""
    entropy: NotNegative | None = None
    """Weight of the entropy bonus."""
    beta: NotNegative | None = None
    """Weight of the shaping reward (decision 0031)."""
    touch_cost: NotNegative | None = None
    """Cost λ of a touch."""
    touch_limit: Count | None = None
    """Largest number T_max of touches per object."""
    target_prob: Annotated[float | tuple[float, float] | None, _PROB] = None
    """Prior probability of the target in training, or a range (decisions 0030 and 0024)."""

    def of(self, recipe: PPORecipe) -> PPORecipe:
        """The recipe with these changes."""
        return replace(recipe, **{name: value for name, value in asdict(self).items() if value is not None})


@dataclass(frozen=True)
class TrainPPO:
    """Train PPO policies on recorded touches, one per target and seed, and keep the best seed of each target.

    After an interruption, the same command continues. Learning curves are evaluated on the objects of the test split;
    the seed is chosen on the objects of training. The deciders ppo, ppo_posterior and ppo_confident read
    SENSOR/policies: copy OUT/policies there. If tensorboard is installed, the folder of each training has SB3's log.

    The recipes gains and goal, for ppo_gains and ppo_goal, need a sensor whose belief is about one rigid body, and a
    bank that its reader wrote. Goal is one policy for all targets.

    For example:

        activetouch touch-bank --scene coarse
        activetouch train-ppo --scene coarse
        activetouch touch-bank --scene paper --sensor paper-independent --out data/paper-independent-bank
        activetouch train-ppo --scene paper --sensor paper-independent --bank data/paper-independent-bank
        activetouch train-ppo --scene coarse --targets cone --recipes gains --seeds 1 --out runs/ppo-cone
    """

    scene: str = "gel"
    """Name of the scene, which gives the defaults of the next three."""
    bank: Path | None = None
    """Folder of the touch banks; data/SCENE-bank by default."""
    sensor: Path | None = None
    """Folder of the sensor, or name of a shipped one; the scene's by default."""
    out: Path | None = None
    """Folder for trainings and policies; runs/ppo-SCENE by default."""
    targets: tuple[str, ...] = ()
    """Shapes to train for, except of the recipe goal; all by default."""
    recipes: tuple[RecipeName, ...] = ()
    """Recipes of training, at most one per state; by default gains and goal for a sensor of one rigid body, paper and
    posterior for any other."""
    change: PPOChanges = field(default_factory=PPOChanges)
    """Changes to the recipes."""
    seeds: Count = 3
    """Number of trainings of each policy."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes."""
    anyway: bool = False
    """Use banks of another scene than the sensor's."""

    @ends_claims
    def run(self) -> None:
        """Train what is missing, choose, and write policies and learning curves."""
        check_arguments(self)
        require_extra("rl")
        from experiments.ppo.training import POLICY  # loads gymnasium

        named_scene(self.scene)  # raises for an unknown name
        out = self.out if self.out is not None else Path(f"runs/ppo-{in_file_names(self.scene)}")
        claim_folder(out)
        trainings = self._trainings(out)
        tasks = [partial(_run, index, training) for index, training in enumerate(trainings)]
        curves: dict[int, list[Score]] = {}
        for index, curve in run_tasks(tasks, self.jobs, "training policies"):
            curves[index] = curve
            training, last = trainings[index], curve[-1]
            print(
                f"{training.recipe.state} {training.target or ALL} seed {training.seed}: "
                f"return {last.mean_return:.3f}, success {last.success:.3f}, {last.touches:.2f} touches"
            )
        groups: dict[tuple[str, str], list[int]] = {}
        for index, training in enumerate(trainings):
            groups.setdefault((training.recipe.state, training.target or ALL), []).append(index)
        found: dict[str, dict[str, list[list[Score]]]] = {}
        chosen: dict[int, list[Score]] = {}
        for (state, target), members in groups.items():
            best = max(members, key=lambda index: trainings[index].score().mean_return)
            chosen[best] = curves[best]
            with atomic_path(out / "policies" / policy_file(state, target)) as temporary:
                temporary.write_bytes((trainings[best].folder / POLICY).read_bytes())
            found.setdefault(state, {})[target] = [curves[index] for index in members]
        compared = {index: curve for index, curve in chosen.items() if trainings[index].recipe.state not in WITH_GAINS}
        if compared:  # references are those of sensors of independent touches
            self._compare_with_references(trainings, compared, out)
        write_text(out / "curves.json", json.dumps(found, indent=1) + "\n")
        draw_curves(found, out / "curves.svg")
        print(f"wrote {out / 'policies'} and the learning curves, {out / 'curves.svg'}")

    @staticmethod
    def _compare_with_references(trainings: Sequence[Training], chosen: Mapping[int, list[Score]], out: Path) -> None:
        """Print and write the returns of the chosen policies and the reference returns."""
        from experiments.ppo.reference import reference

        rows = []
        for index, curve in chosen.items():
            one = trainings[index]
            assert one.target is not None, "only policies on the joint belief are for all targets"
            against = reference(one.bank, one.test_bank, one.model, one.target, one.recipe)
            last, best = curve[-1], against.score
            rows.append({"state": one.recipe.state, "target": one.target, **last._asdict(), **asdict(against)})
            confirm, reject = against.thresholds
            print(
                f"{one.recipe.state} {one.target}: return {last.mean_return:.3f} is "
                f"{last.mean_return / best.mean_return:.3f} of the {best.mean_return:.3f} of the best thresholds "
                f"({reject}, {confirm}); upper bound {against.optimum:.3f} for the table of outcomes; with free "
                f"touches {against.free:.3f}"
            )
        write_text(out / "references.json", json.dumps(rows, indent=1) + "\n")

    def _recipes(self, is_joint: bool) -> dict[str, PPORecipe]:
        """The changed recipes by name, for a sensor with a joint model or with another."""
        names = self.recipes or (("gains", "goal") if is_joint else ("paper", "posterior"))
        recipes = {name: self.change.of(PPO_RECIPES[name]) for name in names}
        if len({recipe.state for recipe in recipes.values()}) < len(names):
            raise ImpossiblePPO(f"--recipes must be one recipe a state, got {' '.join(self.recipes)!r}")
        return recipes

    def _trainings(self, out: Path) -> list[Training]:
        """All trainings; errors are raised before any is started."""
        from activetouch.envs.touch_bank import TouchBank  # loads gymnasium
        from experiments.ppo.training import Training

        folder = self.bank if self.bank is not None else bank_folder(self.scene)
        sensor = sensor_folder(self.sensor, self.scene)
        model, fitted_to = fitted_model(sensor)
        recipes = self._recipes(model.reads == "embeddings")
        if model.reads == "embeddings":  # its reader embeds the hypotheses
            model = load_quietly(sensor, named_scene(self.scene).scene, anyway=True).model
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
                    raise WrongScene(f"{folder} is a bank of another scene: {error}. {remedy}") from error
        for target in self.targets:
            if target not in bank.shape_labels:
                raise UnknownName("target", target, list(bank.shape_labels))
        each = list(dict.fromkeys(self.targets or bank.shape_labels))
        return [
            Training(
                bank, test_bank, model, target, recipe, seed, out / f"{name}-{in_file_name(target or ALL, '-')}-{seed}"
            )
            for name, recipe in recipes.items()
            for target in ([None] if recipe.state == GOAL else each)
            for seed in range(self.seeds)
        ]


def _run(index: int, training: Training) -> tuple[int, list[Score]]:
    import torch

    torch.set_num_threads(1)  # more threads make networks this small slower
    return index, training.run()


def draw_curves(found: Mapping[str, Mapping[str, Sequence[Sequence[Score]]]], path: Path) -> None:
    """Draw return against steps: a panel per state, a colour per target, mean and range of the seeds.

    Args:
        found: learning curves of all seeds, by state and target.
        path: file to write; the ending decides the format.
    """
    from experiments.reporting.style import PALETTE, figure  # loads matplotlib

    with figure((4.2 * len(found), 3.2), path) as drawn:
        axes = drawn.subplots(1, len(found), sharey=True, squeeze=False)[0]
        for panel, (state, targets) in zip(axes, found.items(), strict=True):
            for index, (target, curves) in enumerate(targets.items()):
                colour, length = PALETTE[index % len(PALETTE)], min(map(len, curves))
                points = np.array([[point[:2] for point in curve[:length]] for curve in curves])  # (seeds, length, 2)
                steps, values = points[..., 0].mean(axis=0) / 1000, points[..., 1]
                panel.plot(steps, values.mean(axis=0), color=colour, label=target)
                panel.fill_between(steps, values.min(axis=0), values.max(axis=0), color=colour, alpha=0.2, lw=0)
            panel.set(title=f"state: {state}", xlabel="thousand steps")
        axes[0].set_ylabel("return of a test")
        axes[0].set_ylim(-0.25, 1.02)  # untrained networks may lie lower
        axes[-1].legend()
