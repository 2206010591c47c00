"""What a comparison is made of, one shard a task, as any worker on any machine runs it: the same bits everywhere."""

from __future__ import annotations

import json
import os
import socket
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from activetouch.scene_description import scene_fields
from activetouch.world import CLASSIFIER_FILE, OBSERVATION_FILE
from belief.errors import ActiveTouchError
from belief.references import look_in
from experiments.search.bound import best_expected_return
from experiments.search.fingerprint import files_digest, fingerprint, modules_of
from experiments.search.oracle import solved_by_full_information
from experiments.search.run_folder import (
    BOUND,
    ORACLE,
    Seconds,
    Shard,
    ShardKey,
    code_digests,
    episode_lines,
    versions,
)
from experiments.search.setting import Setting, Stamps, build_decider, episode_seed, known_model, play, stamps

_PLAYING = threading.Lock()  # a cluster's worker may run several tasks as threads; physics and clocks are one a process


class WorkerMismatch(ActiveTouchError, RuntimeError):
    """A worker would play other episodes than were asked for."""


def identity(setting: Setting, seed: int) -> Mapping[str, Any]:
    """What all episodes of a run follow from, whoever plays them; the sensor by content, wherever it lies."""
    return _identity(setting, seed, stamps(setting))


@lru_cache(maxsize=2)
def _identity(setting: Setting, seed: int, when: Stamps) -> Mapping[str, Any]:
    folder = setting.sensor_folder
    return {
        "seed": seed,
        "problem": repr(setting.problem),
        "scene": scene_fields(setting.scene),
        "scene_code_sha256": fingerprint(setting.scene),
        "sensor_sha256": files_digest([folder / CLASSIFIER_FILE, folder / OBSERVATION_FILE]),
        "observation_model_code_sha256": fingerprint(known_model(setting)[0]),
    }


def made_by(setting: Setting, decider: str, target: str) -> str:
    """Digest of what plays the shards of a decider for a target, beyond what all episodes follow from (decision 0033).

    Args:
        setting: of the run.
        decider: its name; or that of the oracle, or the bound.
        target: label of the shape sought.

    Raises:
        UnknownName: there is no such decider.
        MissingPolicy: it follows trained policies, and there are none for this target.
    """
    if decider in (ORACLE, BOUND):
        return fingerprint(solved_by_full_information if decider == ORACLE else best_expected_return)
    model, table = known_model(setting)
    chosen = build_decider(setting, decider)
    return fingerprint(chosen, target, {"the sensor's outcome table": table, "the sensor's observation model": model})


@dataclass(frozen=True)
class ShardTask:
    """Plays one shard; nothing but arguments and results passes between machines.

    Attributes:
        key: which.
        size: how many episodes of it.
        setting: of the run.
        seed: of the run.
        wanted: the run's identity and versions, and who is to play, as this task's maker sees them, as JSON.
        folder: working folder of this task's maker, in which modules of the user's own are found.
    """

    key: ShardKey
    size: int
    setting: Setting
    seed: int
    wanted: str
    folder: str = field(default_factory=os.getcwd)

    @classmethod
    def of(cls, key: ShardKey, setting: Setting, seed: int, size: int | None = None) -> ShardTask:
        """The task for a shard of a run; a full one, unless told otherwise."""
        return cls(
            key, key.most if size is None else size, setting, seed, portrait(setting, seed, key.decider, key.target)
        )

    def __call__(self) -> tuple[ShardKey, Shard]:
        """The shard.

        Raises:
            WorkerMismatch: this machine has other versions, another sensor, or other code, than the one that asks.
        """
        with _PLAYING:
            look_in(self.folder)
            player = _require_same(self.setting, self.seed, self.key.decider, self.key.target, self.wanted)
            target = list(self.setting.problem.shape_labels).index(self.key.target)
            if self.key.decider == BOUND:
                lines = [json.dumps({"bound": best_expected_return(self.setting, target)}) + "\n"]
                return self.key, Shard(lines, Seconds(), player)
            numbers = self.key.episodes(self.size)
            if self.key.decider == ORACLE:
                return self.key, Shard(self._oracle_lines(target, numbers), Seconds(), player)
            try:
                episodes, seconds = play(self.setting, self.key.decider, target, self.seed, numbers)
            except ActiveTouchError as error:
                error.add_note(
                    f"in one of the episodes {numbers} of {self.key.decider}, target {self.key.target}, "
                    f"seed {self.seed}"
                )
                raise
            return self.key, Shard(episode_lines(self.key.decider, episodes), seconds, player)

    def _oracle_lines(self, target: int, numbers: range) -> list[str]:
        solved = solved_by_full_information(self.setting, target, self.seed, numbers)
        return [
            json.dumps({"seed": episode_seed(self.seed, target, number), "solved": bool(right)}) + "\n"
            for number, right in zip(numbers, solved, strict=True)
        ]


def portrait(setting: Setting, seed: int, decider: str, target: str) -> str:
    """Everything that searches of a decider for a target follow from, as this process has it, as JSON."""
    code = {f"code of {name}": digest for name, digest in code_digests().items()}
    player = {"decider": made_by(setting, decider, target)}
    return json.dumps({**identity(setting, seed), **versions(), **code, **player})


def _require_same(setting: Setting, seed: int, decider: str, target: str, wanted: str) -> str:
    """Digest of who plays here, once it is sure that it is who was wanted."""
    return _checked(setting, seed, decider, target, wanted, stamps(setting))


@lru_cache(maxsize=256)
def _checked(setting: Setting, seed: int, decider: str, target: str, wanted: str, when: Stamps) -> str:
    mine, asked = json.loads(portrait(setting, seed, decider, target)), json.loads(wanted)
    player = setting.player(decider)
    if not isinstance(player, str) and "__main__" in modules_of(player):
        mine["decider"] = asked["decider"]  # it was sent here with its classes; the main module here is another
    if mine != asked:
        other = [f"{name} ({mine[name]} for {asked[name]})" for name in asked if mine[name] != asked[name]]
        raise WorkerMismatch(
            f"{socket.gethostname()} would play other episodes, for it has another {'; '.join(other)}. Give every "
            "worker the same environment: pip install -c constraints.txt ...; and start workers again that loaded "
            "code before it was edited"
        )
    return str(mine["decider"])
