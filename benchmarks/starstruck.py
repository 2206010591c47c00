"""Count stars by touch: Starstruck-Depth of tactile_mnist, with a learned reader and a belief.

Run: PYOPENGL_PLATFORM=egl OMP_NUM_THREADS=1 python -m benchmarks.starstruck

It needs torch and, by `pip install tactile-mnist`, the task; half an hour of processor time.

One to three stars, and up to five boxes and cylinders, lie on a plate of 12 cm; a touch shows 14 × 14 mm of it, and the
sensor moves at most 15 mm between two of 32 touches. All players here share one map of what was touched, one reader and
one belief; they differ only in where they touch. The reader is a small convolutional network, learned from scenes of
the training split, that gives for every square of 4 mm the likelihood ratio of "a star's centre is here". The belief
sums over the places of one, two or three stars that do not overlap. Everything is kept in a folder and resumed.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from belief.bayes import update
from belief.calibration import TemperatureScaling
from belief.statistics import paired_bootstrap
from benchmarks.apgym import STATED, Played

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

SIZE, SQUARE = 96, 4  # pixels of 1 mm along a side of the map, which is centred on the plate, and of a square
WINDOW = 14.16  # side of what one touch shows [mm]; the renderer makes it square, although the sensor is 19 mm wide
REACH = np.array([38.5, 40.5])  # farthest place of the sensor from the middle [mm]
CENTRES = np.array([39.25, 40.25])  # farthest centre of an object from the middle [mm]
APART = 18.0  # two stars are at least 20 mm apart, their squares at least this [mm]
STEP, TOUCHES = 15.0, 32  # longest step [mm], touches of an episode
MOST = 3  # stars
DEPTH, BEAM, LATER = 9, 40, 0.93  # touches ahead, ways that are kept, what a touch is worth one touch later
DISC, PIXEL, LATTICE = 8.0, 2, 17  # around a centre [mm], pixels of a coarser one, places along a side of the lattice
LEAST = 1e-6  # least likelihood ratio of a number of stars
CALIBRATION = 200_000  # first scene of the training split that calibrates; the reader learns from the first ones
HIGH = 4.6  # the sensor stands at 2.1 mm on the plate, at 7.1 mm on an object [mm]
AXIS = np.arange(SIZE) - SIZE / 2 + 0.5


def stars_and_map(mesh: Any, stars: int) -> tuple[Floats, Bools]:
    """Centres of the stars, ``(stars, 2)`` [mm], and where an object stands, ``(96, 96)`` (y, x), of a scene's mesh."""
    from tactile_mnist.starstruck_dataset import make_star_mesh

    corners = 1e3 * np.asarray(mesh.vertices)
    triangles = corners[mesh.faces]
    triangles = triangles[(triangles[:, :, 2] > 4.9).all(axis=1)][:, :, :2]
    solid = np.zeros((SIZE, SIZE), np.bool_)
    for a, b, c in triangles:
        low = np.searchsorted(AXIS, np.minimum(np.minimum(a, b), c))
        high = np.searchsorted(AXIS, np.maximum(np.maximum(a, b), c))
        x, y = AXIS[low[0] : high[0]][None, :], AXIS[low[1] : high[1]][:, None]
        sides = [(q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) >= 0 for p, q in ((a, b), (b, c), (c, a))]
        solid[low[1] : high[1], low[0] : high[0]] |= (sides[0] == sides[1]) & (sides[1] == sides[2])
    return corners[: stars * len(make_star_mesh().vertices)].reshape(stars, -1, 3).mean(axis=1)[:, :2], solid


def scenes(folder: Path, number: int, block: int = 500) -> tuple[Bools, Floats]:
    """Maps ``(N, 96, 96)`` and star centres ``(N, 3, 2)`` [mm], NaN where there are fewer, of the training split."""
    parts = []
    for start in range(0, number, block):
        file = folder / f"scenes_{start}.npz"
        if not file.exists():
            from tactile_mnist import StarstruckMeshDataset

            dataset = StarstruckMeshDataset("train")
            solids, places = np.zeros((block, SIZE, SIZE), np.bool_), np.full((block, MOST, 2), np.nan)
            for i in range(block):
                point = dataset[start + i]
                places[i, : point.star_count], solids[i] = stars_and_map(point.mesh, point.star_count)
            _replace(file, partial(np.savez_compressed, solids=np.packbits(solids), places=places))
            print(f"scenes {start} to {start + block}", file=sys.stderr, flush=True)
        with np.load(file) as kept:
            parts.append((np.unpackbits(kept["solids"]).reshape(-1, SIZE, SIZE).astype(np.bool_), kept["places"]))
    solids, places = (np.concatenate(values)[:number] for values in zip(*parts, strict=True))
    return solids, places


def _replace(file: Path, write: Callable[[Any], object]) -> None:
    part = file.with_suffix(".part")
    with part.open("wb") as stream:
        write(stream)
    part.replace(file)


def window(place: Floats) -> tuple[slice, slice]:
    """The pixels of the map that a touch shows (rows, columns)."""
    low, high = (np.searchsorted(AXIS, place + sign * WINDOW / 2) for sign in (-1, 1))
    return slice(low[1], high[1]), slice(low[0], high[0])


def random_touches(rng: np.random.Generator) -> Bools:
    """What some touches show, ``(96, 96)``: at random places, or along a random walk of long steps."""
    seen, place = np.zeros((SIZE, SIZE), np.bool_), rng.uniform(-REACH, REACH)
    walks, angle = rng.random() < 0.7, rng.uniform(0, 2 * np.pi)
    for _ in range(rng.integers(1, TOUCHES + 1)):
        seen[window(place)] = True
        angle += rng.normal(0.0, 0.7)
        step = STEP * np.array([np.cos(angle), np.sin(angle)])
        place = np.clip(place + step, -REACH, REACH) if walks else rng.uniform(-REACH, REACH)
        angle = rng.uniform(0, 2 * np.pi) if (np.abs(place) >= REACH).any() else angle
    return seen


@cache
def squares() -> tuple[Floats, Floats]:
    """Centres of the squares where a star's centre can be, ``(S, 2)`` [mm], and their share of the area, ``(S,)``."""
    low = np.arange(-SIZE / 2, SIZE / 2, SQUARE)
    shares = [np.clip(np.minimum(low + SQUARE, c) - np.maximum(low, -c), 0, None) / (2 * c) for c in CENTRES]
    area = np.outer(shares[1], shares[0]).ravel()
    places = np.stack(np.meshgrid(low + SQUARE / 2, low + SQUARE / 2), axis=-1).reshape(-1, 2)
    return places[area > 0], area


def network(channels: int = 32) -> Any:
    """Log likelihood ratios ``(B, 1, 24, 24)`` of maps ``(B, 2, 96, 96)``: touched, and touched with an object."""
    import torch
    from torch import nn

    class Wider(nn.Module):
        def __init__(self, dilation: int) -> None:
            super().__init__()
            self.near = nn.Conv2d(channels, channels, 3, padding=dilation, dilation=dilation)
            self.mix = nn.Conv2d(channels, channels, 1)

        def forward(self, x: Any) -> Any:
            return x + self.mix(torch.relu(self.near(torch.relu(x))))

    class WithPlaces(nn.Module):
        """Also sees where it is: objects lie off the edge, and none is where another one is."""

        def forward(self, maps: Any) -> Any:
            axis = torch.linspace(-1.0, 1.0, SIZE)
            places = torch.stack([axis.expand(SIZE, SIZE), axis[:, None].expand(SIZE, SIZE)])
            return torch.cat([maps, places.expand(len(maps), -1, -1, -1)], dim=1)

    stem = nn.Conv2d(4, channels, 3 * SQUARE, SQUARE, SQUARE)
    return nn.Sequential(WithPlaces(), stem, *map(Wider, (1, 2, 4, 1, 2, 4)), nn.ReLU(), nn.Conv2d(channels, 1, 1))


def reader(folder: Path, number: int, steps: int, seed: int = 0, batch: int = 16) -> Any:
    """The network, learned as classifier of "a star's centre is in this square", with the prior odds as offset."""
    import torch

    torch.manual_seed(seed)
    torch.set_num_threads(1)
    net, file = network(), folder / f"reader_{number}_{steps}.pt"
    optimiser = torch.optim.AdamW(net.parameters(), 3e-3, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 3e-3, total_steps=steps, pct_start=0.1)
    done, parts = 0, (net, optimiser, schedule)
    if file.exists():
        done, *states = torch.load(file, weights_only=True)
        for part, state in zip(parts, states, strict=True):
            part.load_state_dict(state)
    if done >= steps:
        return net.eval()
    solids, places = scenes(folder, number)
    area = squares()[1]
    possible, prior = torch.tensor(area > 0), torch.tensor(np.log(2 * np.maximum(area, 1e-9)), dtype=torch.float32)
    loss_sum = 0.0
    while done < steps:
        rng = np.random.default_rng((seed, done))
        maps, labels = np.zeros((batch, 2, SIZE, SIZE), np.float32), np.zeros((batch, len(area)), np.float32)
        for i, scene in enumerate(rng.integers(number, size=batch)):
            flip = rng.choice([-1, 1], size=2)
            maps[i, 0] = random_touches(rng)
            maps[i, 1] = maps[i, 0] * solids[scene][:: flip[1], :: flip[0]]
            columns, rows = np.floor((places[scene][~np.isnan(places[scene, :, 0])] * flip + SIZE / 2) / SQUARE).T
            labels[i, (rows * (SIZE // SQUARE) + columns).astype(int)] = 1.0
        scores = net(torch.from_numpy(maps)).flatten(1) + prior
        loss = torch.nn.functional.binary_cross_entropy_with_logits(
            scores[:, possible], torch.from_numpy(labels)[:, possible], reduction="sum"
        )
        optimiser.zero_grad()
        (loss / batch).backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(net.parameters(), 5.0)
        optimiser.step()
        schedule.step()
        done, loss_sum = done + 1, loss_sum + loss.item() / batch
        if done % 50 == 0:
            print(f"reader: step {done}, loss of a map {loss_sum / 50:.4f}", file=sys.stderr, flush=True)
            loss_sum = 0.0
            _replace(file, partial(torch.save, (done, *(part.state_dict() for part in parts))))
    return net.eval()


@cache
def apart() -> Floats:
    """1 where two squares can hold the centres of two stars, else 0, ``(S, S)``."""
    places = squares()[0]
    return (np.linalg.norm(places[:, None] - places, axis=2) >= APART).astype(np.float32)


def arrangements(weights: Floats) -> tuple[Floats, list[Floats]]:
    """Sums over all places of one, two and three stars of the product of their weights.

    Args:
        weights: of a star in each square, ``(S,)``.

    Returns:
        The sums, ``(3,)``, and for two and three stars the sum for each ordered pair of squares, ``(S, S)`` each.
    """
    likely = np.flatnonzero(weights > 1e-5 * weights.sum() / len(weights))  # the others add less than rounding
    near, some = apart()[np.ix_(likely, likely)], weights[likely]
    pairs = near * np.outer(some, some)
    full = [np.zeros((len(weights), len(weights))) for _ in range(2)]
    for whole, part in zip(full, (pairs, pairs * ((near * some.astype(np.float32)) @ near)), strict=True):
        whole[np.ix_(likely, likely)] = part
    return np.array([weights.sum(), full[0].sum() / 2, full[1].sum() / 6]), full


@cache
def _untouched() -> Floats:
    area = squares()[1]
    return arrangements(area[area > 0])[0]


def doubted(probs: Floats, doubt: float) -> Floats:
    """Probabilities of the numbers of stars, if the reading of a map may say nothing about them."""
    return (1.0 - doubt) * probs + doubt / MOST


@dataclass
class Player:
    """A map of what was touched, the belief that the reader takes from it, and a rule for the next touch.

    Attributes:
        net: the reader.
        rule: from the player to the next place, ``(2,)`` [mm], which may be farther than one step.
        rng: generator of the rule.
        doubt: probability that what was read says nothing about the number of stars.
        temperature: of what is then stated.
    """

    net: Any
    rule: Callable[[Player], Floats]
    rng: np.random.Generator
    doubt: float = 0.0
    temperature: float = 1.0
    touches: int = 0
    plan: Iterator[Floats] | None = None
    map: Floats = field(default_factory=lambda: np.zeros((2, SIZE, SIZE), np.float32))
    place: Floats = field(init=False)
    weights: Floats = field(init=False)
    pairs: list[Floats] = field(init=False)
    probs: Floats = field(init=False)

    def see(self, place: Floats, solid: Bools) -> None:
        """Add what a touch at a place, ``(2,)`` [mm], shows: where there is an object, in the pixels of its window."""
        import torch

        rows, columns = window(place)
        self.map[0, rows, columns], self.map[1, rows, columns] = 1.0, solid
        self.place, self.touches = place, self.touches + 1
        with torch.inference_mode():
            ratios = self.net(torch.from_numpy(self.map)[None])[0, 0].double().numpy().ravel()
        area = squares()[1]
        self.weights = area[area > 0] * np.exp(ratios[area > 0])
        sums, self.pairs = arrangements(self.weights)
        logits = np.log(sums / _untouched() + LEAST)  # of p(map | number), up to a factor
        read = np.exp(update(np.full(MOST, -np.log(MOST)), logits)[0])
        stated = doubted(read, self.doubt) ** (1.0 / self.temperature)
        self.probs = stated / stated.sum()

    @property
    def star_probs(self) -> Floats:
        """Probability of a star in each square, ``(S,)``."""
        masses = (self.weights, *(pairs.sum(axis=1) for pairs in self.pairs))
        shares = [each / max(float(each.sum()), 1e-300) for each in masses]
        return np.asarray(self.probs * np.arange(1, MOST + 1) @ np.array(shares)).clip(0.0, 1.0)

    def step(self) -> Floats:
        """The next step, ``(2,)`` [mm], at most 15 mm long."""
        way = self.rule(self) - self.place
        return way * min(1.0, STEP / max(float(np.linalg.norm(way)), 1e-9))


@cache
def lattice() -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
    """Places to touch, ``(L, 2)`` [mm]; the pixels that each shows, ``(L, P)``; those a step away, ``(L, N)``.

    Pixels are those of the coarser map, numbered along its rows. Rows that are shorter end with a number too many.
    """
    sides = [np.linspace(-reach, reach, LATTICE) for reach in REACH]
    places = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
    axis = AXIS.reshape(-1, PIXEL).mean(axis=1)
    inside = [np.abs(axis - places[:, [k]]) <= WINDOW / 2 for k in (0, 1)]
    shows = inside[1][:, :, None] & inside[0][:, None, :]
    way = np.linalg.norm(places[:, None] - places, axis=2)
    return places, _rows(shows.reshape(len(places), -1)), _rows((way <= STEP + 1e-6) & (way > 0.0))


def _rows(table: Bools) -> NDArray[np.int64]:
    """The columns in which each row is true."""
    found = np.full((len(table), table.sum(axis=1).max()), table.shape[1])
    for row, columns in zip(found, map(np.flatnonzero, table), strict=True):
        row[: len(columns)] = columns
    return found


@cache
def discs() -> Floats:
    """Share of each pixel in the disc around each square's centre, ``((SIZE / PIXEL)², S)``."""
    axis = AXIS.reshape(-1, PIXEL).mean(axis=1)
    pixels = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 1, 2)
    inside = np.linalg.norm(pixels - squares()[0], axis=2) <= DISC
    return np.asarray(inside / inside.sum(axis=0))


def look_ahead(player: Player) -> Floats:
    """The first place of the way that will show most of what is open, found by a beam search.

    How open a square is, is the variance of "a star's centre is here", which lies in the disc around it: each pixel
    that was not shown is worth its share. What is shown later is worth less.
    """
    places, shows, near = lattice()
    probs, coarser = player.star_probs, (SIZE // PIXEL, PIXEL)
    hidden = 1.0 - player.map[0].reshape(*coarser, *coarser).mean(axis=(1, 3)).ravel()
    value = np.append(discs() @ (probs * (1.0 - probs)) * hidden, 0.0)
    way = np.linalg.norm(places - player.place, axis=1)
    here = np.flatnonzero((way <= STEP + 1e-6) & (way > 0.0))
    first, shown = here, np.zeros((len(here), len(value)), np.bool_)
    total, worth = np.zeros(len(here)), 1.0
    ends, before = here, np.arange(len(here))
    for left in range(min(DEPTH, TOUCHES - player.touches), 0, -1):
        total = total + worth * np.where(shown[before[:, None], shows[ends]], 0.0, value[shows[ends]]).sum(axis=1)
        best = np.argsort(-total, kind="stable")[: 4 * BEAM]
        _, kept = np.unique(np.stack([ends[best], total[best].round(9)]), axis=1, return_index=True)
        best = best[np.sort(kept)[:BEAM]]  # of ways that show the same in another order, one is kept
        shown, ends, total, first, worth = shown[before[best]], ends[best], total[best], first[best], worth * LATER
        shown[np.arange(len(best))[:, None], shows[ends]] = True
        if left > 1:
            before, column = np.nonzero(near[ends] < len(places))
            total, first, ends = total[before], first[before], near[ends[before], column]
    return places[first[np.argmax(total)]]


def wander(player: Player) -> Floats:
    """A step of full length in a random direction."""
    angle = player.rng.uniform(0.0, 2.0 * np.pi)
    return np.clip(player.place + STEP * np.array([np.cos(angle), np.sin(angle)]), -REACH, REACH)


def scan(player: Player) -> Floats:
    """Column after column from the nearest corner, up and down; four columns are as many as the touches suffice for."""
    player.plan = player.plan or _columns(player.place)
    return next(player.plan)


def _columns(here: Floats) -> Iterator[Floats]:
    x, y = np.where(here < 0.0, -REACH, REACH)
    while True:
        for at in np.linspace(x, -x, 4):
            for goal in (np.array([at, y]), np.array([at, -y])):
                number = math.ceil(float(np.linalg.norm(goal - here)) / STEP - 1e-9)
                yield from (here + (goal - here) * (i + 1) / number for i in range(number))
                here = goal
            y = -y
        x = -x


RULES: dict[str, Callable[[Player], Floats]] = {"look ahead": look_ahead, "raster": scan, "random": wander}


def felt(observation: dict[str, Any]) -> tuple[Floats, Bools]:
    """Place of a touch, ``(2,)`` [mm], and where its image shows an object, in the pixels of its window."""
    place = observation["sensor_pos"][:2].astype(np.float64) * REACH
    rows, columns = window(place)
    image = observation["sensor_img"][..., 0]
    across, down = ((AXIS[columns] - place[0]) / WINDOW, (place[1] - AXIS[rows]) / WINDOW)
    pixels = [((at + 0.5) * n).astype(int).clip(0, n - 1) for at, n in zip((down, across), image.shape, strict=True)]
    return place, (image[np.ix_(*pixels)] < 0.5) & (10.0 * (observation["sensor_pos"][2] + 1.0) > HIGH)


def play(env: Any, player: Player, seed: int, options: dict[str, int]) -> dict[str, Any]:
    """One episode of the environment: its seed, the class, and the probabilities stated after each touch."""
    observation, _ = env.reset(seed=seed, options=options)
    stated, done = [], False
    while not done:
        player.see(*felt(observation))
        stated.append(player.probs.round(9).tolist())
        way = np.append(player.step() / STEP, 0.0).astype(np.float32)
        prediction = np.log(np.maximum(player.probs, 1e-12)).astype(np.float32)
        action = {"action": {"sensor_target_pos_rel": way}, "prediction": prediction}
        observation, _, terminated, truncated, info = env.step(action)
        done = terminated or truncated
    return {"seed": seed, "class": int(info["prediction"]["target"]), "probs": stated}


def plays(file: Path, split: str, net: Any, rules: Iterable[str], seeds: range, *trust: float) -> dict[str, Any]:
    """Episodes by rule: classes ``(E,)`` and probabilities ``(E, 32, 3)``, of the same scenes and first places for all.

    ``trust`` are the doubt and the temperature of the players.
    """
    kept: dict[str, list[Any]] = {name: [] for name in rules}
    for line in file.read_text(encoding="utf-8").splitlines() if file.exists() else ():
        one = json.loads(line)
        kept[one["rule"]].append(one)
    env = None
    for number, seed in enumerate(seeds):
        for name, lines in kept.items():
            if number < len(lines):
                continue
            if env is None:
                import ap_gym
                import tactile_mnist  # noqa: F401, registers the task

                env = ap_gym.make(f"Starstruck-Depth-{split}-v0")
            player = Player(net, RULES[name], np.random.default_rng(seed), *trust)
            options = {"datapoint_idx": seed} if split == "train" else {}
            lines.append({"rule": name, **play(env, player, seed, options)})
            with file.open("a", encoding="utf-8", newline="\n") as stream:
                print(json.dumps(lines[-1]), file=stream, flush=True)
    return {
        name: tuple(np.array([line[key] for line in lines[: len(seeds)]]) for key in ("class", "probs"))
        for name, lines in kept.items()
    }


def main(folder: Path, number: int, steps: int, calibrations: int, episodes: int, seed: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    net, doubt, scale, name = reader(folder, number, steps), 0.0, 1.0, f"{number}_{steps}"
    if calibrations:
        file, seeds = folder / f"calibration_{name}.jsonl", range(CALIBRATION, CALIBRATION + calibrations)
        true, probs = plays(file, "train", net, ["look ahead"], seeds)["look ahead"]
        true, probs = np.repeat(true, TOUCHES), probs.reshape(-1, MOST)
        tried = np.geomspace(1e-4, 0.5, 60)
        fits = [np.log(doubted(probs[np.arange(len(true)), true], doubt)).mean() for doubt in tried]
        doubt = float(tried[np.argmax(fits)])
        scale = TemperatureScaling().fit(np.log(doubted(probs, doubt)), true).temperature
    file = folder / f"test_{name}_{calibrations}_{seed}.jsonl"
    results = plays(file, "test", net, RULES, range(seed, seed + episodes), doubt, scale)
    print(f"Starstruck-Depth-test-v0: {episodes} episodes of {TOUCHES} touches, seeds {seed} to {seed + episodes - 1}.")
    trust = f"doubt {doubt:.3f}, temperature {scale:.3f} of {calibrations} episodes"
    print(f"Reader: {number} training scenes, {steps} steps; {trust}.")
    print("95 % intervals: Wilson, and a bootstrap over episodes; natural logarithms.")
    head = f"{'player':13}{'final accuracy':22}{'mean over touches':22}"
    print(f"{head}p final  mean   log final  mean   half ≤  90 % ≤   (touches to a stated {STATED})")
    rng, shown = np.random.default_rng(seed), {}
    for name, (true, probs) in results.items():
        own = probs[np.arange(episodes), :, true]
        shown[name] = Played(probs.argmax(axis=2) == true[:, None], own, probs.max(axis=2))
        print(f"{name:13}{shown[name].row(rng)}")
    share = np.bincount(true, minlength=MOST).max() / episodes
    print(f"{'majority':13}{share:.3f} in each touch; a third for each class has log score {-math.log(MOST):.4f}")
    ours = shown["look ahead"].right.astype(np.float64)
    for name in ("raster", "random"):
        other = shown[name].right.astype(np.float64)
        for what, first, second in (
            ("final", ours[:, -1], other[:, -1]),
            ("mean", ours.mean(axis=1), other.mean(axis=1)),
        ):
            mean, low, high = paired_bootstrap(first, second, rng)
            print(f"look ahead over {name}, {what} accuracy, paired: {mean:+.3f} [{low:+.3f}, {high:+.3f}]")
    for name, one in shown.items():
        print(f"{name}, accuracy by touch: {' '.join(f'{x:.2f}' for x in one.right.mean(axis=0))}")
        print(f"{name}, p of true class:   {' '.join(f'{x:.2f}' for x in one.true_probs.mean(axis=0))}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=Path("build/starstruck"))
    parser.add_argument("--scenes", type=int, default=7500, help="scenes that the reader learns from")
    parser.add_argument("--steps", type=int, default=5000, help="training steps of the reader, 16 maps each")
    parser.add_argument("--calibrations", type=int, default=40, help="episodes for the temperature")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1000)
    asked = parser.parse_args()
    main(asked.folder, asked.scenes, asked.steps, asked.calibrations, asked.episodes, asked.seed)
