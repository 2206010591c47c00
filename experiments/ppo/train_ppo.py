"""``activetouch train-ppo``: PPO policies from recorded touches, one per target or one for all."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

from activetouch.extras import require_extra
from activetouch.perception.reader import TactileReader
from activetouch.sensor import TactileSensor
from activetouch.sensor_files import POLICIES, READER_FILE, fitted_model
from belief.errors import UnknownName
from belief.files import claim_folder, ends_claims, write_text
from belief.observation_model.model import ArrayModel
from belief.policy_state import GOAL
from belief.table import Table, Tabular
from experiments.command_line.arguments import BadArgument, Count, Jobs, check_arguments
from experiments.parallel import default_jobs, run_tasks
from experiments.ppo.recipe import PPO_RECIPES, PPORecipe
from experiments.scene_choice import in_file_names, named_scene, repeats_folder
from experiments.sensor_choice import open_collection, require_collection, sensor_folder
from planners.ppo import Policy, policy_file

if TYPE_CHECKING:
    from activetouch.envs.touch_bank import TouchBank
    from experiments.ppo.training import Score, Training

RecipeName: TypeAlias = Literal[tuple(PPO_RECIPES)]  # type: ignore[valid-type]


@dataclass(frozen=True)
class TrainPPO:
    """Train PPO policies on recorded touches, one per target and seed, and keep the best seed of each target.

    Policies learn from the objects of a collection's calibration split, on which the sensor's reader was not trained.
    They are tested on its test split. The deciders ppo, ppo_posterior and the like read SENSOR/policies:
    copy OUT/policies there. After an interruption, the same command continues.

    The recipes gains and goal, for ppo_gains and ppo_goal, need a sensor whose belief is about one rigid body. Goal is
    one policy for all targets.

    For example:

        activetouch collect --scene coarse --plan.train 0 --plan.repeats 6 --out data/coarse-repeats
        activetouch train-ppo --scene coarse
        activetouch train-ppo --scene paper --sensor paper-independent --tensorboard runs/tensorboard
        activetouch train-ppo --scene coarse --targets cone --recipes gains --seeds 1 --out runs/ppo-cone
    """

    scene: str = "gel"
    """Name of the scene, which gives the defaults of the next three."""
    data: Path | None = None
    """Folder of the collection; data/SCENE-repeats by default."""
    sensor: Path | None = None
    """Folder of the sensor, or name of a shipped one; the scene's by default."""
    out: Path | None = None
    """Folder for the touches as they are read, trainings and policies; runs/ppo-SCENE by default."""
    targets: tuple[str, ...] = ()
    """Shapes to train for, except of the recipe goal; all by default."""
    recipes: tuple[RecipeName, ...] = ()
    """Recipes of training; by default gains and goal for a sensor of one rigid body, paper and posterior for any
    other."""
    steps: Count | None = None
    """Total number of steps of all environments; that of the recipe by default."""
    seeds: Count = 3
    """Number of trainings of each policy."""
    jobs: Jobs = field(default_factory=default_jobs)
    """Number of processes."""
    tensorboard: Path | None = None
    """Folder of logs for TensorBoard, such as runs/tensorboard; none by default."""
    anyway: bool = False
    """Use a collection of another scene than the sensor's."""

    @ends_claims
    def run(self) -> None:
        """Read the touches, train what is missing, choose, and write the policies."""
        check_arguments(self)
        require_extra("rl")
        if self.tensorboard is not None:
            require_extra("tensorboard")
        from experiments.ppo.training import TEST, TRAINING, kept_bank  # loads gymnasium

        named = named_scene(self.scene)
        out = self.out if self.out is not None else Path(f"runs/ppo-{in_file_names(self.scene)}")
        claim_folder(out)
        data = self.data if self.data is not None else repeats_folder(self.scene)
        sensor = sensor_folder(self.sensor, self.scene)
        manifest = open_collection(data, self.scene, repeats=True)
        reader = TactileReader.load(sensor / READER_FILE)
        filed = self.scene if self.out is None else None
        require_collection(data, manifest, reader.card, filed, anyway=self.anyway)
        model = fitted_model(sensor).model
        if model.reads == "embeddings":  # its reader embeds the hypotheses
            model = TactileSensor.load(sensor, named.scene, anyway=True).model
        names = self.recipes or (("gains", "goal") if model.reads == "embeddings" else ("paper", "posterior"))
        recipes = [PPO_RECIPES[name] for name in names]
        if self.steps is not None:
            recipes = [replace(recipe, steps=self.steps) for recipe in recipes]
        require_targets(self.targets, manifest.shape_labels)
        bank, test_bank = (kept_bank(reader, data, split, out / "bank" / split) for split in (TRAINING, TEST))
        each = self.targets, self.seeds, self.jobs, self.tensorboard
        found = train_policies(bank, test_bank, model, out, recipes, *each)
        found.save(out)
        print(f"{found}\nwrote {out / POLICIES}")


@dataclass(frozen=True)
class TrainedPolicies(Tabular):
    """The best policy of each state and target, its seed, and the scores of every seed on test objects.

    The target of a policy for all targets is :data:`~experiments.ppo.training.ALL`.
    """

    policies: Mapping[tuple[str, str], Policy]
    scores: Mapping[tuple[str, str], Sequence[Score]]
    chosen: Mapping[tuple[str, str], int]

    def table(self) -> Table:
        """Scores of the policies that were chosen."""
        scores = [self.scores[key][seed] for key, seed in self.chosen.items()]
        numbers = [(found.mean_return, found.success, found.touches) for found in scores]
        rows = [(*key, *some, seed) for (key, seed), some in zip(self.chosen.items(), numbers, strict=True)]
        columns = ["state", ("target", ""), ("return", ".3f"), ("success", ".3f"), ("touches", ".2f"), ("seed", "d")]
        return Table("Policies on test objects", columns, rows)

    def __str__(self) -> str:
        lines = []
        for (state, target), seed in self.chosen.items():
            found = self.scores[state, target][seed]
            score = f"return {found.mean_return:.3f}, success {found.success:.3f}, {found.touches:.2f} touches"
            lines.append(f"{state}, {target}: {score} on test objects (seed {seed})")
        return "\n".join(lines)

    def save(self, folder: Path) -> None:
        """Write the policies, and ``scores.json`` with those of every seed."""
        for key, policy in self.policies.items():
            policy.save(folder / POLICIES / policy_file(*key))
        by_state: dict[str, dict[str, list[dict[str, float]]]] = {}
        for (state, target), scores in self.scores.items():
            by_state.setdefault(state, {})[target] = [score._asdict() for score in scores]
        write_text(folder / "scores.json", json.dumps(by_state, indent=1) + "\n")


def train_policies(
    bank: TouchBank,
    test_bank: TouchBank,
    model: ArrayModel,
    out: Path,
    recipes: Iterable[PPORecipe],
    targets: Iterable[str] = (),
    seeds: int = 3,
    jobs: int = 1,
    tensorboard: Path | None = None,
) -> TrainedPolicies:
    """Train a policy for every recipe, target and seed, and choose the best seed on the objects of training.

    Args:
        bank: touches to learn from.
        test_bank: touches of other objects, for the scores.
        model: observation model that updates the belief.
        out: folder of the trainings; finished ones are read from it.
        recipes: settings, each for another state.
        targets: labels of the shapes to train for; all by default.
        seeds: number of trainings of each policy.
        jobs: number of processes.
        tensorboard: folder of logs for TensorBoard; None for none.

    Raises:
        BadArgument: Two recipes have the same state.
        UnknownName: There is no such target.
    """
    from experiments.ppo.training import ALL, Training

    recipes = list(recipes)
    by_state = {recipe.state: recipe for recipe in recipes}
    if len(by_state) < len(recipes):
        raise BadArgument("--recipes must be one recipe a state")
    each = list(dict.fromkeys(targets)) or list(bank.shape_labels)
    require_targets(each, bank.shape_labels)
    trainings = [
        Training(bank, test_bank, model, target, recipe, seed, out / "trainings", tensorboard)
        for state, recipe in by_state.items()
        for target in ([None] if state == GOAL else each)
        for seed in range(seeds)
    ]
    tasks = [partial(_run, index, training) for index, training in enumerate(trainings)]
    finished = dict(run_tasks(tasks, jobs, "training policies"))
    groups: dict[tuple[str, str], list[int]] = {}
    for index, training in enumerate(trainings):
        groups.setdefault((training.recipe.state, training.target or ALL), []).append(index)
    best = {key: max(some, key=lambda n: trainings[n].mean_return(finished[n][0])) for key, some in groups.items()}
    return TrainedPolicies(
        {key: finished[index][0] for key, index in best.items()},
        {key: [finished[index][1] for index in group] for key, group in groups.items()},
        {key: trainings[index].seed for key, index in best.items()},
    )


def require_targets(targets: Iterable[str], shape_labels: Sequence[str]) -> None:
    """Raise UnknownName for a target that is no shape."""
    for target in targets:
        if target not in shape_labels:
            raise UnknownName("target", target, list(shape_labels))


def _run(index: int, training: Training) -> tuple[int, tuple[Policy, Score]]:
    import torch

    torch.set_num_threads(1)  # more threads make networks this small slower
    return index, training.run()
