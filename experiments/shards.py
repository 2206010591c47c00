"""What a comparison is made of, one shard a task, as any worker on any machine runs it: the same bits everywhere."""

from __future__ import annotations

import hashlib
import json
import socket
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from activetouch.world import CLASSIFIER_FILE, OBSERVATION_FILE, POLICIES
from belief.errors import ActiveTouchError
from experiments.ceiling import best_expected_return, solved_by_full_information
from experiments.episodes import Setting, episode_seed, play
from experiments.results import BOUND, CEILING, Seconds, ShardKey, episode_lines, versions

_PLAYING = threading.Lock()  # a cluster's worker may run several tasks as threads; physics and clocks are one a process


class WorkerMismatch(ActiveTouchError, RuntimeError):
    """A worker would play other episodes than were asked for."""


@lru_cache(maxsize=2)
def identity(setting: Setting, seed: int) -> Mapping[str, Any]:
    """What decides an episode; the sensor and trained policies by content, wherever they lie."""
    folder = setting.sensor_folder
    policies = sorted(path for path in (folder / POLICIES).glob("**/*") if path.is_file())
    return {
        "seed": seed,
        "problem": repr(setting.problem),
        "scene": repr(setting.scene),
        "sensor_sha256": _digest([folder / CLASSIFIER_FILE, folder / OBSERVATION_FILE]),
        "policies_sha256": _digest(policies) if policies else None,
    }


def _digest(files: Sequence[Path]) -> str:
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()


@dataclass(frozen=True)
class ShardTask:
    """Plays one shard; nothing but arguments and results passes between machines.

    Attributes:
        key: which.
        setting: of the run.
        seed: of the run.
        wanted: the run's identity and versions as this task's maker sees them, as JSON.
    """

    key: ShardKey
    setting: Setting
    seed: int
    wanted: str

    @classmethod
    def of(cls, key: ShardKey, setting: Setting, seed: int) -> ShardTask:
        """The task for a shard of a run."""
        return cls(key, setting, seed, _self_portrait(setting, seed))

    def __call__(self) -> tuple[ShardKey, list[str], Seconds]:
        """The shard's lines, and the time they took.

        Raises:
            WorkerMismatch: this machine has other versions, or another sensor, than the one that asks.
        """
        with _PLAYING:
            self._require_same()
            target = list(self.setting.problem.shape_labels).index(self.key.target)
            if self.key.decider == BOUND:
                return self.key, [json.dumps({"bound": best_expected_return(self.setting, target)}) + "\n"], Seconds()
            if self.key.decider == CEILING:
                return self.key, self._ceiling_lines(target), Seconds()
            try:
                episodes, seconds = play(self.setting, self.key.decider, target, self.seed, self.key.episodes)
            except ActiveTouchError as error:
                error.add_note(
                    f"in one of the episodes {self.key.episodes} of {self.key.decider}, target {self.key.target}, "
                    f"seed {self.seed}"
                )
                raise
            return self.key, episode_lines(self.key.decider, episodes), seconds

    def _ceiling_lines(self, target: int) -> list[str]:
        solved = solved_by_full_information(self.setting, target, self.seed, self.key.episodes)
        return [
            json.dumps({"seed": episode_seed(self.seed, target, number), "solved": bool(right)}) + "\n"
            for number, right in zip(self.key.episodes, solved, strict=True)
        ]

    def _require_same(self) -> None:
        here = _self_portrait(self.setting, self.seed)
        if here != self.wanted:
            mine, asked = json.loads(here), json.loads(self.wanted)
            other = [f"{name} ({mine[name]} for {asked[name]})" for name in asked if mine[name] != asked[name]]
            raise WorkerMismatch(
                f"{socket.gethostname()} would play other episodes, for it has another {'; '.join(other)}. Give every "
                "worker the same environment: pip install -c constraints.txt ..."
            )


def _self_portrait(setting: Setting, seed: int) -> str:
    return json.dumps({**identity(setting, seed), **versions()})
