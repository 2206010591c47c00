"""Play the circle-square tasks of ap_gym with an exact belief and expected information, beside random and raster moves.

Run: OMP_NUM_THREADS=1 python benchmarks/apgym.py        (needs the extra apgym; some minutes)

A glimpse of 5 × 5 pixels moves over an image with a circle or a square (in DoubleCircleSquare two of them). All players
here know how the images are made: their belief is uniform over the images that agree with all glimpses, so they differ
only in where they look. The agents of the published rows learn from the environment instead.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from belief.bayes import expected_information_gain, update
from belief.statistics import cluster_bootstrap, wilson_interval

TASKS = (
    *(f"CircleSquare{size}{gradient}-v0" for size in ("", "-s20", "-s15") for gradient in ("", "-nograd")),
    "CircleSquareInverted-v0",
    "DoubleCircleSquare-v0",
)
PUBLISHED = {"CircleSquare-v0": (("CrossQ", 0.991, 0.895), ("SAC", 0.982, 0.879), ("PPO", 0.787, 0.717))}
"""Accuracy after the last glimpse and mean over all of APPLE (ICLR 2026), whose agents learn, by task."""
GLIMPSE = 5  # pixels along each side of a glimpse
TOLERANCE = 1e-5  # of a grey value: glimpses are given in single precision
MOST_WEIGHED = 300  # images by which a place is judged; more are thinned out
STATED = 0.95
STEP = 0.2  # longest step, where the glimpse moves from -1 to 1 along each side

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Generator:
    """All images that a task can show; each is the brightest of one or two images of a single object.

    Shapes: ``singles (S, H, W)``, ``members (N, 1 or 2)`` (indices of the singles of an image), ``labels (N,)``.
    """

    singles: Floats
    members: Ints
    labels: Ints
    num_classes: int

    @classmethod
    def of(cls, dataset: Any) -> Generator:
        """The generator of a data set of ap_gym, whose images of one object are those of its own code."""
        from ap_gym.envs.image import CircleSquareDataset

        one_object = isinstance(dataset, CircleSquareDataset)
        single = dataset if one_object else CircleSquareDataset(image_shape=dataset[0][0].shape[:2])
        single.load()
        images, shapes = zip(*(single[i] for i in range(len(single))), strict=True)
        singles, kinds = np.array(images)[..., 0], np.array(shapes)
        if one_object:
            return cls(singles, np.arange(len(singles))[:, None], kinds, 2)
        places = np.array([single.get_object_position_and_label(i)[0] for i in range(len(single))])
        first, second = np.triu_indices(len(singles), 1)
        apart = (np.abs(places[first] - places[second]) >= 9).any(axis=1)  # so that two objects do not touch
        members = np.stack([first[apart], second[apart]], axis=1)
        labels = np.where(kinds[members[:, 0]] == kinds[members[:, 1]], kinds[members[:, 0]], 2)
        return cls(singles, members, labels, 3)

    @property
    def reach(self) -> Floats:
        """Largest distance of the glimpse from the middle of the image, ``(2,)`` [pixels]."""
        return (np.array(self.singles.shape[1:]) - GLIMPSE) / 2.0

    def agreeing(self, images: Ints, glimpse: Floats, centre: Floats) -> Ints:
        """Those of the images that show a glimpse, ``(5, 5)``, around a centre, ``(2,)`` [pixels from the corner]."""
        corner = np.minimum(np.floor(centre - GLIMPSE // 2).astype(int), np.array(self.singles.shape[1:]) - GLIMPSE - 1)
        up, right = centre - GLIMPSE // 2 - corner
        weights = np.outer([1.0 - up, up], [1.0 - right, right])
        patches = self.singles[:, corner[0] : corner[0] + GLIMPSE + 1, corner[1] : corner[1] + GLIMPSE + 1]
        for row, column in np.ndindex(GLIMPSE, GLIMPSE):  # one point rules out most
            near = patches[:, row : row + 2, column : column + 2][self.members[images]].max(axis=1)
            shown = np.einsum("nij,ij->n", near, weights)
            images = images[np.abs(shown - glimpse[row, column]) < TOLERANCE]
        return images


@dataclass
class Player:
    """An exact belief about the image, and the rule ``move`` for the next step, ``(2,)`` in the unit circle (x, y)."""

    generator: Generator
    move: Callable[[Player], Floats]
    rng: np.random.Generator
    images: Ints = field(init=False)
    log_probs: Floats = field(init=False)
    place: Floats = field(init=False)
    inverted: bool = field(init=False)
    plan: Iterator[Floats] | None = field(init=False)

    def begin(self) -> None:
        """Forget everything."""
        self.images = np.arange(len(self.generator.labels))
        self.log_probs = np.full(len(self.images), -np.log(len(self.images)))
        self.inverted, self.plan = False, None

    def see(self, observation: dict[str, Any]) -> None:
        """Update the belief by a glimpse."""
        self.inverted |= observation.get("inverted_label", 2) == 1
        self.place = observation["glimpse_pos"].astype(np.float64)
        reach = self.generator.reach
        centre = self.place[::-1] * reach + reach + GLIMPSE // 2
        agrees = np.isin(self.images, self.generator.agreeing(self.images, observation["glimpse"][..., 0], centre))
        log_probs, _ = update(self.log_probs, np.where(agrees, 0.0, -np.inf))
        self.images, self.log_probs = self.images[agrees], log_probs[agrees]

    @property
    def probs(self) -> Floats:
        """Probability of each class, ``(K,)``."""
        labels, num_classes = self.generator.labels[self.images], self.generator.num_classes
        found = np.bincount(labels, np.exp(self.log_probs), num_classes)
        return (found[::-1] if self.inverted else found) / found.sum()


def inform(player: Player) -> Floats:
    """Go where a glimpse tells most about the class per step: exact over the possible images, or a sample of many."""
    generator, images = player.generator, player.images
    if len(images) > MOST_WEIGHED:
        images = player.rng.choice(images, MOST_WEIGHED, replace=False)
    labels = generator.labels[images]
    if len(np.unique(labels)) < 2:
        return np.zeros(2)
    pictures = generator.singles[generator.members[images]].max(axis=1)
    windows = sliding_window_view(np.rint(pictures / TOLERANCE).astype(np.int64), (GLIMPSE, GLIMPSE), axis=(1, 2))
    mixing = np.random.default_rng(0).integers(2**62, size=(GLIMPSE, GLIMPSE))
    codes = np.einsum("nyxij,ij->yxn", windows, mixing)  # equal for equal glimpses
    height, width, number = codes.shape
    outcomes = _ranks(codes.reshape(-1, number))
    shape = (len(outcomes), generator.num_classes, int(outcomes.max()) + 1)
    cells = np.ravel_multi_index((np.arange(shape[0])[:, None], labels, outcomes), shape)
    counts = np.bincount(cells.ravel(), minlength=math.prod(shape)).reshape(shape).astype(np.float64)
    counts = counts[:, np.unique(labels)]
    totals = counts.sum(axis=2, keepdims=True)
    gains = expected_information_gain(totals[0, :, 0] / number, counts / totals)
    ys, xs = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    ways = np.stack([xs.ravel(), ys.ravel()], axis=1) - player.place
    distances = np.linalg.norm(ways, axis=1) / STEP
    score = gains / np.maximum(np.ceil(distances - 1e-9), 1.0) - 1e-9 * distances
    return ways[np.argmax(score)] / STEP


def _ranks(codes: Ints) -> Ints:
    """Number of each value among the different ones of its row, from 0."""
    order = np.argsort(codes, axis=1)
    ordered = np.take_along_axis(codes, order, axis=1)
    ranks = np.concatenate(
        [np.zeros((len(codes), 1), np.int64), (np.diff(ordered, axis=1) != 0).cumsum(axis=1)], axis=1
    )
    found = np.empty_like(ranks)
    np.put_along_axis(found, order, ranks, axis=1)
    return found


def wander(player: Player) -> Floats:
    angle = player.rng.uniform(0.0, 2.0 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def scan(player: Player) -> Floats:
    """Row after row from the nearest corner, with full steps and a glimpse between two rows."""
    if player.plan is None:
        player.plan = _raster(player.place, GLIMPSE / float(player.generator.reach[0]))
    return next(player.plan)


def _raster(place: Floats, row: float) -> Iterator[Floats]:
    here, (x, y) = place, np.where(place < 0.0, -1.0, 1.0)
    for height in itertools.cycle(np.append(np.arange(1.0, -1.0, -row), -1.0)):
        for goal in (np.array([x, y * height]), np.array([-x, y * height])):
            for _ in range(math.ceil(float(np.linalg.norm(goal - here)) / STEP - 1e-9)):
                step = (goal - here) * min(1.0, STEP / float(np.linalg.norm(goal - here)))
                here = here + step
                yield step / STEP
        x = -x


@dataclass(frozen=True)
class Played:
    """Results of each step, ``(episodes, steps)``; ``stated`` is the probability of the likeliest class."""

    right: NDArray[np.bool_]
    true_probs: Floats
    stated: Floats

    def row(self, rng: np.random.Generator) -> str:
        """Accuracy after the last glimpse and over all, probability and log score, steps to a stated probability."""
        number, steps = self.right.shape
        last = self.right[:, -1]
        low, high = wilson_interval(int(last.sum()), number)
        mean = cluster_bootstrap(self.right.ravel(), np.repeat(np.arange(number), steps), rng)
        sure = self.stated >= STATED
        first = np.where(sure.any(axis=1), sure.argmax(axis=1) + 1, steps + 1)
        half, most = np.quantile(first, [0.5, 0.9], method="inverted_cdf")
        words = [f"{count}" if count <= steps else "never" for count in (half, most)]
        logs = np.log(np.maximum(self.true_probs, 1e-12))
        return (
            f"{last.mean():.3f} [{low:.3f}, {high:.3f}]  {mean[0]:.3f} [{mean[1]:.3f}, {mean[2]:.3f}]  "
            f"{self.true_probs[:, -1].mean():.3f}  {self.true_probs.mean():.3f}  {logs[:, -1].mean():+.4f}  "
            f"{logs.mean():+.4f}  {words[0]:>5}  {words[1]:>6}"
        )


def play(task: str, rule: Callable[[Player], Floats], episodes: int, seed: int) -> Played:
    """Play a task of ap_gym; the same seed gives the same images and first glimpses to every player."""
    import ap_gym

    env = ap_gym.make(task)
    player = Player(generator_of(task), rule, np.random.default_rng(seed))
    target, stated, true = [], [], []
    observation, _ = env.reset(seed=seed)
    for episode in range(episodes):
        if episode:
            observation, _ = env.reset()
        player.begin()
        done = False
        while not done:
            player.see(observation)
            logits = np.log(np.maximum(player.probs, 1e-12))
            action = {"action": rule(player).astype(np.float32), "prediction": logits.astype(np.float32)}
            observation, _, terminated, truncated, info = env.step(action)
            done = terminated or truncated
            target.append(int(info["prediction"]["target"]))
            stated.append(player.probs)
    env.close()
    probs, true = np.array(stated), np.array(target)
    likeliest = probs.argmax(axis=1)
    found = (likeliest == true, probs[np.arange(len(true)), true], probs.max(axis=1))
    return Played(*(values.reshape(episodes, -1) for values in found))


@cache
def generator_of(task: str) -> Generator:
    import ap_gym

    env = ap_gym.make(task)
    dataset = env.get_wrapper_attr("config").dataset
    env.close()
    return Generator.of(dataset)


RULES: dict[str, Callable[[Player], Floats]] = {"information": inform, "raster": scan, "random": wander}


def main(tasks: list[str], episodes: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    print(f"{episodes} episodes, seed {seed}; 95 % intervals: Wilson, and a bootstrap over episodes.")
    print("Published: APPLE (ICLR 2026), agents that learn; ours and the players beside it know the generator.")
    head = f"{'task':24}{'player':13}{'final accuracy':22}{'mean over steps':22}"
    print(f"{head}p final  mean   log final  mean   half ≤  90 % ≤   (steps to a stated {STATED})")
    for task in tasks:
        by_rule = {name: play(task, rule, episodes, seed) for name, rule in RULES.items()}
        for name, played in by_rule.items():
            print(f"{task:24}{name:13}{played.row(rng)}")
        for name, final, mean in PUBLISHED.get(task, ()):
            print(f"{task:24}{name:13}{final:.3f}                 {mean:.3f}                 (published)")
        ours = by_rule["information"]
        print(f"  accuracy by step: {' '.join(f'{share:.2f}' for share in ours.right.mean(axis=0))}")
        print(f"  p of true class:  {' '.join(f'{prob:.2f}' for prob in ours.true_probs.mean(axis=0))}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", nargs="+", default=list(TASKS))
    parser.add_argument("--episodes", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    main(asked.tasks, asked.episodes, asked.seed)
