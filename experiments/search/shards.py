"""Tasks of a comparison: each plays one shard and gives the same bits on any worker and any machine."""

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
from belief.errors import ActiveTouchError
from belief.references import look_in
from experiments.search.bound import best_expected_return, best_return_with_revealed_bodies
from experiments.search.fingerprint import code_digests, files_digest, fingerprint, modules_of, versions
from experiments.search.oracle import solved_by_full_information
from experiments.search.run_folder import (
    BOUND,
    ORACLE,
    Seconds,
    Shard,
    ShardKey,
    episode_lines,
)
from experiments.search.setting import Setting, Stamps, build_decider, episode_seed, known_model, play_episodes, stamps
from experiments.search.touch_memo import TouchMemo

_PLAYING = threading.Lock()  # Dask workers may run tasks in threads, but physics and clocks exist once per process


class WorkerMismatch(ActiveTouchError, RuntimeError):
    """A worker would play other episodes than requested."""


def identity(setting: Setting, seed: int) -> Mapping[str, Any]:
    """What determines all episodes of a run apart from the decider; files of the sensor by content."""
    return _identity(setting, seed, stamps(setting))


@lru_cache(maxsize=2)
def _identity(setting: Setting, seed: int, when: Stamps) -> Mapping[str, Any]:
    return {
        "seed": seed,
        "problem": repr(setting.problem),
        "scene": scene_fields(setting.scene),
        "scene_code_sha256": fingerprint(setting.scene),
        "sensor_sha256": files_digest(setting.sensor_files),
        "observation_model_code_sha256": fingerprint(known_model(setting)[0]),
    }


def made_by(setting: Setting, decider: str, target: str) -> str:
    """Digest of the settings and code of a decider (decision 0033).

    Args:
        setting: setting of the run.
        decider: name of the decider, or :data:`ORACLE` or :data:`BOUND`.
        target: label of the target shape.

    Raises:
        UnknownName: There is no such decider.
        MissingPolicy: The decider needs a trained policy for this target, and there is none.
    """
    if decider in (ORACLE, BOUND):
        return fingerprint(solved_by_full_information if decider == ORACLE else best_expected_return)
    model, table = known_model(setting)
    chosen = build_decider(setting, decider)
    return fingerprint(chosen, target, {"the sensor's outcome table": table, "the sensor's observation model": model})


@dataclass(frozen=True)
class ShardTask:
    """A task that plays one shard.

    Attributes:
        key: key of the shard.
        size: number of episodes.
        setting: setting of the run.
        seed: seed of the run.
        wanted: :func:`portrait` in the process that made this task.
        folder: working folder of that process, from which modules of the user are imported.
    """

    key: ShardKey
    size: int
    setting: Setting
    seed: int
    wanted: str
    folder: str = field(default_factory=os.getcwd)

    def __call__(self, memo: TouchMemo | None = None) -> tuple[ShardKey, Shard]:
        """Play the shard.

        Args:
            memo: images of the touches that other shards of the setting and seed made.

        Raises:
            WorkerMismatch: This machine has other versions, another sensor or other code than the requesting one.
        """
        with _PLAYING:
            look_in(self.folder)
            player = _require_same(self.setting, self.seed, self.key.decider, self.key.target, self.wanted)
            target = list(self.setting.problem.shape_labels).index(self.key.target)
            if self.key.decider == BOUND:
                revealed = best_return_with_revealed_bodies(self.setting, target)
                bounds = {"bound": best_expected_return(self.setting, target), "revealed_body": revealed}
                lines = [json.dumps(bounds) + "\n"]
                return self.key, Shard(lines, Seconds(), player)
            numbers = self.key.episodes(self.size)
            if self.key.decider == ORACLE:
                return self.key, Shard(self._oracle_lines(target, numbers, memo), Seconds(), player)
            try:
                episodes, seconds = play_episodes(self.setting, self.key.decider, target, self.seed, numbers, memo)
            except ActiveTouchError as error:
                error.add_note(
                    f"in one of the episodes {numbers} of {self.key.decider}, target {self.key.target}, "
                    f"seed {self.seed}"
                )
                raise
            return self.key, Shard(episode_lines(self.key.decider, episodes), seconds, player)

    def _oracle_lines(self, target: int, numbers: range, memo: TouchMemo | None) -> list[str]:
        solved = solved_by_full_information(self.setting, target, self.seed, numbers, memo)
        return [
            json.dumps({"seed": episode_seed(self.seed, target, number), "solved": bool(right)}) + "\n"
            for number, right in zip(numbers, solved, strict=True)
        ]


@dataclass(frozen=True)
class GroupTask:
    """A task that plays shards one after the other, which share the images of their touches.

    Attributes:
        shards: of one setting and seed, and of the same episodes where possible.
    """

    shards: tuple[ShardTask, ...]

    def __call__(self) -> list[tuple[ShardKey, Shard]]:
        """Play the shards; see :class:`ShardTask`."""
        memo = TouchMemo()
        return [shard(memo) for shard in self.shards]


def portrait(setting: Setting, seed: int, decider: str, target: str) -> str:
    """Everything that determines the searches of a decider for a target, as seen by this process, as JSON."""
    code = {f"code of {name}": digest for name, digest in code_digests().items()}
    player = {"decider": made_by(setting, decider, target)}
    return json.dumps({**identity(setting, seed), **versions(), **code, **player})


def _require_same(setting: Setting, seed: int, decider: str, target: str, wanted: str) -> str:
    """Raise WorkerMismatch unless this process would play the wanted episodes; return the digest of the decider."""
    return _checked(setting, seed, decider, target, wanted, stamps(setting))


@lru_cache(maxsize=256)
def _checked(setting: Setting, seed: int, decider: str, target: str, wanted: str, when: Stamps) -> str:
    mine, asked = json.loads(portrait(setting, seed, decider, target)), json.loads(wanted)
    player = setting.player(decider)
    if not isinstance(player, str) and "__main__" in modules_of(player):
        mine["decider"] = asked["decider"]  # its class was pickled; the main module of this process is another one
    if mine != asked:
        other = [f"{name} ({mine[name]} for {asked[name]})" for name in asked if mine[name] != asked[name]]
        raise WorkerMismatch(
            f"{socket.gethostname()} would play other episodes, because it has another {'; '.join(other)}. Give every "
            "worker the same environment (pip install -c constraints.txt ...), and restart workers after editing code"
        )
    return str(mine["decider"])
