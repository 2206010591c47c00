"""Check submissions: what follows from seeds and actions is computed again, and the rest must be plausible."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from belief.errors import ActiveTouchError, UnknownName
from belief.problem import Probe, SearchProblem
from belief.search_progress import Outcome, success_of
from belief.seeding import arrangement_rng, sample_arrangement
from belief.statistics import paired_bootstrap, wilson_interval
from belief.table import Table, Value
from belief.validation import Floats
from experiments.command_line.arguments import BadArgument
from experiments.parallel import Shared, Task, run_tasks
from experiments.search.benchmark.cards import Card
from experiments.search.benchmark.hidden import HiddenSeeds
from experiments.search.benchmark.submission import DEVELOPMENT, Played, PlayedBatch, Submission, processor
from experiments.search.play import Searches, Seconds, play_episodes
from experiments.search.summary import Outcomes, differences
from planners import Decider, Decision, InformationState
from planners.decider import num_touches
from planners.episode import ACTIONS
from planners.fingerprint import code_versions, versions

if TYPE_CHECKING:
    from experiments.search.benchmark.trays import TrayTask

_ROUNDED = 1e-6  # of stated probabilities, on the same kind of processor
_ELSEWHERE, _ODD_SHARE = 0.02, 0.01  # difference on another one, and the share of searches that may differ by more
_FASTER = 100.0  # how much faster touches can have been than here, where other programs may run
_QUICKEST = 1e-7  # decision [s]
_BY_CHANCE = 1e-9  # probability of so many right answers from what is stated
_MOST_FAULTS = 5  # of a file that are listed
_DRAWN = 500_000  # rows of a table that are drawn at a time
_IDLE = 600.0  # that a run may take beside its searches [s]


@dataclass(frozen=True)
class Entry:
    """A file after its check: ``faults`` say why it is refused; ``notes`` do not."""

    path: Path
    submission: Submission | None = None
    card: Card | None = None
    outcomes: Outcomes | None = None
    faults: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    replayed: int = 0

    @property
    def name(self) -> str:
        """The agent and its file."""
        return self.path.name if self.submission is None else self.submission.header.agent


@dataclass(frozen=True)
class Recorded:
    """Follows the recorded actions of each episode, by its seed."""

    actions: Mapping[tuple[int, ...], Sequence[int | str]]

    def begin(self, world: Any, key: tuple[int, ...]) -> Decider:
        """The decider of an episode."""
        return _Following(self.actions[key])

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """It needs to know the episode."""
        raise BadArgument("a record is followed episode by episode")


@dataclass(frozen=True)
class _Following:
    actions: Sequence[int | str]

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        action = self.actions[num_touches(info) + info.object_index]
        return Decision(ACTIONS[action] if isinstance(action, str) else Probe(action))


def check(
    paths: Sequence[Path], share: float = 1.0, hidden: HiddenSeeds | None = None, jobs: int | None = None
) -> list[Entry]:
    """Check files, each by itself, then for copies of each other.

    Args:
        paths: the files.
        share: of the batches of each file that are played again, in [0, 1]; which ones is chance.
        hidden: the seeds of files whose header names them.
        jobs: number of processes; all cores by default.
    """
    entries = [_read(path, hidden) for path in paths]
    entries = [entry if entry.faults else _with_replay(entry, share, hidden, jobs) for entry in entries]
    seen: dict[Any, str] = {}
    for number, entry in enumerate(entries):
        if entry.submission is None:
            continue
        found = entry.submission
        acted = (found.header.task, found.header.seeds, tuple(found.searches))
        timed = (acted, tuple(batch.seconds for batch in found.batches))
        if timed in seen:
            entries[number] = replace(entry, faults=(*entry.faults, f"it is a copy of {seen[timed]}, with its times"))
        elif acted in seen:
            entries[number] = replace(entry, notes=(*entry.notes, f"all its searches are those of {seen[acted]}"))
        seen |= {timed: str(entry.path), acted: str(entry.path)}
    return entries


def _read(path: Path, hidden: HiddenSeeds | None) -> Entry:
    """A file with all faults that show without a touch."""
    try:
        found = Submission.load(path)
        card = Card.named(found.header.task)
    except (BadArgument, UnknownName) as error:
        return Entry(path, faults=(str(error),))
    entry = Entry(path, found, card)
    if found.header.task_sha256 != card.digest:
        return replace(entry, faults=(f"it is of another task {card.name} than that of this version",))
    if found.header.seeds != DEVELOPMENT and (hidden is None or hidden.digest != found.header.seeds):
        return replace(entry, faults=("its seeds are hidden: give the file of these seeds by --seeds",))
    expected = [(target, numbers.start, len(numbers)) for target, numbers in card.batches()]
    if [(batch.target, batch.first, len(batch.searches)) for batch in found.batches] != expected:
        return replace(entry, faults=("its searches are not those of the task, each once, in their order",))
    faults, outcomes = _followed(found, card, _seed_of(card, found, hidden))
    faults += [*_times(found), *_twice(found.searches)]
    confirmed = [search for search in found.searches if search.outcome == Outcome.CONFIRMED and search.probs]
    if said := _knows_more([search for search in confirmed if not search.num_touches]):
        faults.append(f"without a touch, it is {said}: it knows the objects")
    notes = [f"it is {said}: it reads touches better than the sensor, or knows the objects"] * bool(
        said := _knows_more(confirmed)
    )
    return replace(entry, outcomes=outcomes, faults=tuple(faults), notes=tuple(notes))


def _knows_more(confirmed: Sequence[Played]) -> str:
    """What is said of confirmations that are right more often than stated, by Hoeffding's bound; empty if none is."""
    right, stated = sum(search.success for search in confirmed), sum(search.probs[-1] for search in confirmed)
    margin = math.sqrt(len(confirmed) * math.log(1.0 / _BY_CHANCE) / 2.0)
    return f"right in {right} of {len(confirmed)}, stated {stated:.1f}" if right > stated + margin else ""


def _seed_of(card: Card, found: Submission, hidden: HiddenSeeds | None) -> int:
    if found.header.seeds == DEVELOPMENT:
        return card.seed
    assert hidden is not None, "checked when it was read"
    return hidden.seed(card)


def _followed(found: Submission, card: Card, seed: int) -> tuple[list[str], Outcomes]:
    """Faults of the searches by the rules alone, and what they reached: objects follow from the seeds."""
    faults, rows = [], []
    for batch in found.batches:
        for number, search in enumerate(batch.searches, batch.first):
            place = f"target {batch.target}, search {number}"
            judged = _judged(card, seed, batch.target, number, search)
            if isinstance(judged, str):
                faults.append(f"{place}: {judged}")
                continue
            outcome, *reached = judged
            success = reached[0]
            if (search.outcome, search.success) != (outcome.value, success):
                stated = f"{search.outcome}, {'right' if search.success else 'wrong'}"
                faults.append(f"{place}: its actions end it {outcome}, {'right' if success else 'wrong'}, not {stated}")
            rows.append(reached)
    columns = [*zip(*rows, strict=True)] or [(), (), ()]
    return faults, Outcomes(np.array(columns[0], bool), *(np.array(column, float) for column in columns[1:]))


def _judged(card: Card, seed: int, target: str, number: int, search: Played) -> tuple[Outcome, bool, int, float] | str:
    """How a search ends by its actions, whether it is right, its touches and return; or what is wrong with it."""
    if len(search.probs) != len(search.actions) or not all(0.0 <= prob <= 1.0 for prob in search.probs):
        return "there must be a probability in [0, 1] for every action"
    if not search.actions:
        return "it has no end"
    if card.tray is not None:
        return card.tray.judged((seed, number), target, search)
    shape, problem = card.problem.shape_labels.index(target), card.problem.seeking(target)
    arrangement = sample_arrangement(problem, arrangement_rng((seed, shape, number)))
    walked = _walked(problem, search)
    if isinstance(walked, str):
        return walked
    outcome, current, touches = walked
    success = bool(success_of(outcome, shape, arrangement, current))
    confirmed = arrangement[current] if outcome is Outcome.CONFIRMED else None
    present = shape in arrangement or outcome is Outcome.TRUNCATED
    return outcome, success, touches, problem.reward(confirmed, shape, touches, present, outcome is Outcome.UNSURE)


def _walked(problem: SearchProblem, search: Played) -> tuple[Outcome, int, int] | str:
    """Outcome, object and touches that the actions of a search lead to, or what is wrong with them."""
    current = touches = 0
    for number, action in enumerate(search.actions):
        ended: Outcome | None = None
        if isinstance(action, int):
            if not 0 <= action < problem.num_poses:
                return f"there is no pose {action}"
            ended = Outcome.TRUNCATED if touches == problem.touch_limit else None
            touches += ended is None
        elif action not in ACTIONS or (action == "unsure" and problem.unsure_reward is None):
            return f"there is no action {action[:40]!r}"
        elif action == "reject" and current + 1 < problem.num_objects:
            current += 1
        else:
            ends = {"confirm": Outcome.CONFIRMED, "reject": Outcome.EXHAUSTED, "unsure": Outcome.UNSURE}
            ended = ends[action]
        if ended is not None:
            return (ended, current, touches) if number + 1 == len(search.actions) else "it goes on after its end"
    return "it has no end"


def _times(found: Submission) -> Iterator[str]:
    """Faults of the stated times."""
    for batch in found.batches:
        spent, touches = batch.seconds, sum(search.num_touches for search in batch.searches)
        actions = sum(len(search.actions) for search in batch.searches)
        parts = (spent.physics, spent.network, spent.decision)
        place = f"target {batch.target}, searches from {batch.first}"
        if spent.num_touches != touches or spent.pressed_again < 0:
            yield f"{place}: times of {spent.num_touches} touches are stated, there are {touches}"
        if min(parts) < 0.0 or spent.decision < _QUICKEST * actions or (touches and min(parts) <= 0.0):
            yield f"{place}: nothing happens in no time: {', '.join(f'{part:.3g} s' for part in parts)}"
    whole, stated = found.header.elapsed, found.seconds
    spent_s = stated.physics + stated.network + stated.decision
    if found.header.jobs < 1 or spent_s > 1.02 * found.header.jobs * whole + 0.1:
        yield f"{spent_s:.1f} s in {found.header.jobs} processes do not fit into the {whole:.1f} s that it took"
    elif spent_s < 0.5 * (whole - _IDLE):
        yield f"{spent_s:.1f} s of searches do not explain the {whole:.1f} s that it took"


def _twice(searches: Sequence[Played]) -> Iterator[str]:
    """Searches with the same touches: forces and offsets make two touches their own."""
    felt = Counter(search.touches for search in searches if search.num_touches > 1)
    if twice := sum(number for number in felt.values() if number > 1):
        yield f"{twice} searches have the touches of another one of the same file"


def _with_replay(entry: Entry, share: float, hidden: HiddenSeeds | None, jobs: int | None) -> Entry:
    """The entry after a share of its batches was played again."""
    found, card = entry.submission, entry.card
    assert found is not None, "it was read"
    assert card is not None, "it was read"
    if not share:
        return entry
    drawn = np.random.default_rng().random(len(found.batches))
    chosen = [batch for batch, at in zip(found.batches, drawn, strict=True) if at <= max(share, drawn.min())]
    header, faults, notes = found.header, list(entry.faults), list(entry.notes)
    # A task that a version of this package changes has another name.
    others = {name: number for name, number in versions().items() if name != "activetouch"}
    is_same = header.processor == processor() and header.versions.items() >= others.items()
    is_own = is_same and header.versions.get("code") == code_versions()["code"] and header.agent in card.deciders
    try:
        tasks = _replays(card, chosen, header.agent if is_own else None, _seed_of(card, found, hidden), jobs)
    except ActiveTouchError as error:
        if not is_own:
            raise
        return replace(entry, faults=(*faults, f"{header.agent} does not play this task: {error}"))
    odd, here, there = 0, Seconds(), Seconds()
    for stated, again in run_tasks(tasks, jobs, "replaying"):
        here, there = here + again.seconds, there + stated.seconds
        for number, (one, two) in enumerate(zip(stated.searches, again.searches, strict=True), stated.first):
            same_way = (one.actions, one.outcome, one.success) == (two.actions, two.outcome, two.success)
            apart = max(map(abs, np.subtract(one.probs, two.probs))) if same_way else math.inf
            if is_same and (one.touches != two.touches or apart > _ROUNDED):
                faults.append(f"target {stated.target}, search {number}: played again, it has other touches or beliefs")
            odd += not is_same and apart > _ELSEWHERE
    number = sum(len(batch.searches) for batch in chosen)
    if odd > _ODD_SHARE * number:
        faults.append(f"{odd} of {number} searches played again have other beliefs")
    if not is_same:
        notes.append("played on another kind of processor, or with other versions")
    if here.physics + here.network > _FASTER * (there.physics + there.network):
        faults.append(
            f"its touches took {there.physics + there.network:.2f} s, here {here.physics + here.network:.2f} s"
        )
    return replace(entry, faults=tuple(faults), notes=tuple(notes), replayed=number)


def _replays(
    card: Card, chosen: Sequence[PlayedBatch], own: str | None, seed: int, jobs: int | None
) -> list[Task[tuple[PlayedBatch, PlayedBatch]]]:
    """Tasks that play batches again: by one of the package's own deciders, or following the record."""
    if card.tray is not None:
        card.require_sensor()
        card.tray.made.belief(0)  # which prepares what all processes share
        return [partial(_replayed_in_tray, card.tray, seed, own, batch) for batch in chosen]
    name = own or "random_confirm"
    run = card.run({name: name}, jobs, seed)
    shared = Shared((run.searches, run.deciders[name] if own else None))
    return [partial(_replayed, shared, batch) for batch in chosen]


def _replayed_in_tray(
    tray: TrayTask, seed: int, own: str | None, batch: PlayedBatch
) -> tuple[PlayedBatch, PlayedBatch]:
    numbers = range(batch.first, batch.first + len(batch.searches))
    return batch, tray.batch(seed, batch.target, numbers, own or "random", () if own else batch.searches)


def _replayed(shared: Shared[tuple[Searches, Decider | None]], batch: PlayedBatch) -> tuple[PlayedBatch, PlayedBatch]:
    """A batch as it is stated, and as it is played again: by the package's own decider, or following the record."""
    searches, own = shared.value
    target = searches.problem.shape_labels.index(batch.target)
    keys = [(searches.seed, target, number) for number in range(batch.first, batch.first + len(batch.searches))]
    decider = own or Recorded({key: one.actions for key, one in zip(keys, batch.searches, strict=True)})
    episodes, seconds = play_episodes(searches, decider, target, [number for *_, number in keys])
    return batch, replace(batch, seconds=seconds, searches=tuple(map(Played.of, episodes)))


def groups(values: Mapping[str, Floats], rng: np.random.Generator, level: float = 0.05) -> dict[str, str]:
    """Letters of agents by name: two that share a letter cannot be told apart by their paired values, ``(n,)`` each.

    All differences together are wrong with at most the probability ``level`` (Bonferroni). Names are in the order of
    their means, and letters in that of the names; the sets are the largest without a difference (Piepho 2004).

    >>> rng = np.random.default_rng(0)
    >>> one, noise = rng.normal(size=400), rng.normal(scale=0.1, size=400)
    >>> groups({"good": one + 1.0, "alike": one + 1.0 + noise, "worse": one}, rng)
    {'good': 'a', 'alike': 'a', 'worse': 'b'}
    """
    names = sorted(values, key=lambda name: -float(np.mean(values[name])))
    if len(names) < 2:
        return dict.fromkeys(names, "a")
    pairs = [*combinations(range(len(names)), 2)]
    sets = [frozenset(names)]
    tail = level / len(pairs) / 2
    table = np.stack([values[name] for name in names], axis=1)
    means = _resampled_means(table, rng, max(2000, round(50 / tail)))
    for first, second in pairs:
        one, other = names[first], names[second]
        if np.ptp(table[:, first] - table[:, second]):
            low, high = np.quantile(means[:, first] - means[:, second], [tail, 1.0 - tail])
        else:  # the means of equal differences may differ by rounding
            low = high = table[0, first] - table[0, second]
        if not low <= 0.0 <= high:
            split = chain.from_iterable(
                (part - {one}, part - {other}) if {one, other} <= part else (part,) for part in sets
            )
            unique = list(dict.fromkeys(split))
            sets = [part for part in unique if not any(part < larger for larger in unique)]
    sets.sort(key=lambda part: sorted(map(names.index, part)))
    letters = "abcdefghijklmnopqrstuvwxyz"
    return {name: "".join(letters[number % 26] for number, part in enumerate(sets) if name in part) for name in names}


def _resampled_means(table: Floats, rng: np.random.Generator, number: int) -> Floats:
    """Means of the columns of a table ``(n, k)`` over resamples of its rows, ``(number, k)``."""
    size, means = len(table), np.empty((number, table.shape[1]))
    rows = max(1, _DRAWN // size)
    for first in range(0, number, rows):
        some = means[first : first + rows]
        drawn = rng.integers(size, size=(len(some), size)) + size * np.arange(len(some))[:, None]
        counts = np.bincount(drawn.ravel(), minlength=len(some) * size).reshape(len(some), size)
        some[:] = counts @ table / size
    return means


def tables(entries: Sequence[Entry], seed: int = 0) -> list[Table]:
    """Results and paired differences of the files without faults, task by task, and the files with faults."""
    found: list[Table] = []
    by_task: dict[tuple[str, str], list[Entry]] = defaultdict(list)
    for entry in entries:
        if not entry.faults and entry.submission is not None:
            by_task[entry.submission.header.task, entry.submission.header.seeds].append(entry)
    for (task, seeds), some in by_task.items():
        found += _of_task(task, seeds, some, np.random.default_rng(seed))
    rows: list[tuple[str, str]] = [
        (str(entry.path), fault) for entry in entries for fault in entry.faults[:_MOST_FAULTS]
    ]
    if rows:
        found.append(Table("Refused", ["file", ("why", "")], rows, name="refused"))
    return found


def named_apart(entries: Sequence[Entry]) -> dict[str, Entry]:
    """Entries by agent, with the file where two are called alike."""
    alike = Counter(entry.name for entry in entries)
    return {entry.name if alike[entry.name] == 1 else f"{entry.name} ({entry.path.name})": entry for entry in entries}


def _of_task(task: str, seeds: str, entries: Sequence[Entry], rng: np.random.Generator) -> Iterator[Table]:
    """Results of the agents of a task, and their differences from the one with the highest mean return."""
    own = {name: entry for name, entry in named_apart(entries).items() if entry.outcomes is not None}
    outcomes = {name: entry.outcomes for name, entry in own.items() if entry.outcomes is not None}
    letters = groups({name: one.reward for name, one in outcomes.items()}, rng)
    card, rows = Card.named(task), list[Sequence[Value]]()
    bound, who = (
        card.bound,
        "no agent with any sensor returns more than" if card.oracle is None else "an oracle returns",
    )
    for name, letter in letters.items():
        one, found = outcomes[name], own[name].submission
        assert found is not None, "it was read"
        mean, *ends = paired_bootstrap(one.reward, np.zeros(len(one.reward)), rng)
        right, number = int(one.success.sum()), len(one.success)
        ms = 1e3 * found.seconds.decision / sum(len(search.actions) for search in found.searches)
        rates = (right / number, wilson_interval(right, number), float(one.touches.mean()))
        rows.append((name, letter, *rates, mean, (ends[0], ends[1]), bound - mean, ms))
    yield Table(
        f"{task}, {number} searches, {'development seeds' if seeds == DEVELOPMENT else f'hidden seeds {seeds[:12]}'}",
        [
            *("agent", ("", "", "group"), ("success", ".3f"), ("95 %", ".2f"), ("touches", ".2f")),
            *(("return", ".3f"), ("95 % ", ".2f"), ("to bound", ".3f"), ("ms", ".1f")),
        ],
        rows,
        "Agents that share a letter cannot be told apart by their returns on the same searches. "
        f"To bound: {who} {bound:.3f} on average. ms: for a decision, as each file states it.",
        f"{task}_results",
    )
    best, *others = letters
    if others:
        beside = differences(dict.fromkeys(others, best), outcomes, {"all": slice(None)}, rng)
        yield Table(
            f"Difference from {best} on the same searches",
            [
                *("agent", ("success", "+.3f"), ("95 %", "+.2f"), ("won", "d"), ("lost", "d"), ("p", ".2g")),
                *(("touches", "+.2f"), ("95 % ", "+.2f"), ("return", "+.3f"), ("95 %  ", "+.2f")),
            ],
            [(name, *_without_needed(found.cells)) for (name, _), found in beside.items()],
            "Means with 95 % bootstrap intervals over pairs. Won: only this one succeeds; lost: only the other. "
            "p: McNemar's test (mid-p), corrected by Holm.",
            f"{task}_differences",
        )


def _without_needed(cells: Sequence[Value]) -> Sequence[Value]:
    """Cells of a difference without the number of searches that it would need."""
    return [*cells[:5], *cells[6:]]


def remarks(entries: Sequence[Entry]) -> list[str]:
    """A line on each file: how many of its searches were played again, and what else is to be said."""
    read = [(entry, len(entry.submission.searches)) for entry in entries if entry.submission is not None]
    return [
        "; ".join([f"{entry.path}: {entry.replayed} of {number} searches played again", *entry.notes])
        for entry, number in read
        if not entry.faults
    ]
