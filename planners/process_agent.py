"""Agents in another process, in any language: ``process:COMMAND`` plays by lines of JSON on its standard input.

The words are those of ``activetouch live`` with the parts exchanged: here the other program is asked. It first gets
``{"do": "hello", …}``, which it answers by ``{"ok": true}``, and then, for every decision, ``{"do": "ask", …}`` with
all that is known. It answers by ``{"action": "touch", "pose": "y45"}``, ``"confirm"``, ``"reject"`` or ``"unsure"``, or
by the number of an action of the environments. ``docs/benchmark.md`` lists the fields. Many episodes take turns: an
agent with a memory keeps it by ``episode``.
"""

from __future__ import annotations

import itertools
import json
import math
import os
import shlex
import shutil
import subprocess
import weakref
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from threading import Timer
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from belief.errors import BrokenContract
from belief.policy_state import TOUCH_LIMIT
from belief.problem import Probe, Reject, Unsure
from planners.decider import Decider, Decision, InformationState, num_touches
from planners.episode import ACTIONS
from planners.other_agents import STATES, decision, observation

if TYPE_CHECKING:
    from belief.tray import TrayBelief
    from planners.tray import TrayDecision

SCHEMA = "activetouch agent 1"
"""Version of the lines; the number grows when an agent for an older one could be misled."""
COMMAND_FILE = "command.txt"
"""File of an agent's folder: the command that starts it there."""
_PATIENCE = 60.0  # for one answer [s]; the first may take longer
_LONGEST = 1 << 16  # answer that is read [bytes]
_CPU, _MEMORY, _FILE, _FILES = 3600, 16 << 30, 64 << 20, 256  # seconds, bytes, bytes of one file, open files


@dataclass(frozen=True)
class ProcessAgent:
    """Asks another program for every action.

    Attributes:
        command: what starts it, as in a shell, without a shell's own words such as pipes.
        folder: where it is started; the current one if empty.
        is_limited: whether it gets no network (where ``unshare`` exists), a bare environment, and limits of time,
            memory and files. This is no jail: it can read what the user can.
    """

    command: str
    folder: str = ""
    is_limited: bool = False

    @classmethod
    def of_folder(cls, folder: Path) -> ProcessAgent:
        """The agent of a folder whose file :data:`COMMAND_FILE` holds its command; it is limited."""
        file = folder / COMMAND_FILE
        try:
            command = file.read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError) as error:
            raise BrokenContract(f"an agent's folder holds {COMMAND_FILE}, one line that starts it: {error}") from error
        return cls(command, str(folder.resolve()), True)

    def files(self, target: str) -> tuple[Path, ...]:
        """The files that the command names."""
        paths = (Path(self.folder, word) for word in shlex.split(self.command))
        return tuple(path for path in paths if path.is_file())

    def prepare(self, info: InformationState) -> None:
        """Start the program and greet it; raises BrokenContract if it does not answer."""
        _running(self).greeting(info)

    def begin(self, world: Any, key: tuple[int, ...]) -> Decider:
        """The agent in an episode, which it knows by a number that tells nothing of the seed."""
        return _InEpisode(self, world, next(_running(self).numbers))

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`; without images, which only a world has."""
        return self.decided(info, None, None)

    def decided(self, info: InformationState, image: NDArray[np.uint8] | None, episode: int | None) -> Decision:
        """The decision after an image of the current object, in an episode."""
        running, labels, poses = _running(self), info.problem.shape_labels, info.problem.pose_labels
        wish = running.greeting(info)
        last = info.history[-1] if info.history else None
        request = {
            "do": "ask",
            "episode": episode,
            "target": labels[info.target],
            "object": info.object_index,
            "touches": [poses[touch.pose] for touch in info.history],
            "num_touches": num_touches(info),
            "belief": dict(zip(labels, info.belief.probs.tolist(), strict=True)),
            "logits": None if last is None or last.logits is None else last.logits.tolist(),
            "image": None if last is None or image is None else image.tolist(),
        }
        if wish.state:
            seen = observation(info, wish.state, wish.sees_target, wish.touch_limit)
            request["observation"] = seen.tolist()
        return self._decision(running.answer(request, _PATIENCE), info, wish)

    def _decision(self, given: Mapping[str, Any], info: InformationState, wish: _Wish) -> Decision:
        action, problem = given.get("action"), info.problem
        scores = {"target_prob": info.target_prob}
        if action == "touch" and given.get("pose") in problem.pose_labels:
            return Decision(Probe(problem.pose_labels.index(given["pose"])), scores)
        if isinstance(action, str) and action in ACTIONS:
            return Decision(ACTIONS[action], scores)
        if isinstance(action, int) and not isinstance(action, bool) and 0 <= action <= problem.num_poses + 1:
            return decision(info, action, wish.touch_limit)
        raise BrokenContract(
            f'{self.command:.80} answered {given!r:.200}; an answer is {{"action": "touch", "pose": P}} with P one of '
            f'{", ".join(problem.pose_labels):.200}, or {{"action": A}} with A one of {", ".join(ACTIONS)}, or an '
            f"action of the environments, 0 to {problem.num_poses + 1}"
        )


@dataclass(frozen=True)
class InTray:
    """An agent that is asked where to press in a tray (:class:`planners.tray.TrayDecider`)."""

    agent: ProcessAgent

    def choose(self, belief: TrayBelief, at: tuple[float, float], rng: np.random.Generator) -> TrayDecision:
        """See :class:`planners.tray.TrayDecider`."""
        from planners.tray import ConfirmAt, Press, TrayDecision, cover, standing_of  # which no other agent needs

        running, size, labels = _running(self.agent), belief.size, list(belief.table.labels)
        running.greet({"shapes": labels, "num_objects": belief.num_objects, "size": list(size)})
        standing = standing_of(belief)
        request = {
            "do": "ask",
            "target": labels[belief.target],
            "at": list(at),
            "touches": [list(belief.centre(cell)) for cell in belief.pressed],
            "places": [{"place": list(place), "prob": prob} for place, prob in standing.places],
            "unfound": standing.unfound,
            "absent": standing.absent,
            "chances": cover(belief, belief.worlds[0])[0].round(4).tolist(),
        }
        given = running.answer(request, _PATIENCE)
        action, place = given.get("action"), given.get("place")
        if action in ("reject", "unsure"):
            return TrayDecision(Reject() if action == "reject" else Unsure())
        if action in ("touch", "confirm") and isinstance(place, list) and len(place) == 2:
            x, y = (one if isinstance(one, int | float) else math.nan for one in place)
            if 0.0 <= x <= size[0] and 0.0 <= y <= size[1]:
                return TrayDecision(Press(belief.cell_at(x, y)) if action == "touch" else ConfirmAt((x, y)))
        raise BrokenContract(
            f'{self.agent.command:.80} answered {given!r:.200}; an answer is {{"action": "touch", "place": [x, y]}} or '
            f'"confirm", with a place in the tray of {size[0]} x {size[1]} m, or {{"action": "reject"}} or "unsure"'
        )


@dataclass(frozen=True)
class _InEpisode:
    """An agent in an episode; the world shows what was felt last."""

    agent: ProcessAgent
    world: Any
    number: int

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        return self.agent.decided(info, getattr(self.world, "last_image", None), self.number)


@dataclass(frozen=True)
class _Wish:
    """What an agent asked for in its answer to the greeting: the observation of an environment, or none."""

    state: str = ""
    sees_target: bool = False
    touch_limit: int = TOUCH_LIMIT


class _Running:
    """The program of an agent while it runs."""

    def __init__(self, agent: ProcessAgent) -> None:
        self.agent, self.numbers = agent, itertools.count()
        self._wish: _Wish | None = None
        self._greeted: dict[str, Any] | None = None
        words = shlex.split(agent.command)
        if not words:
            raise BrokenContract("the command of an agent is empty")
        limited: dict[str, Any] = {}
        if agent.is_limited:
            words = [*_without_network(), *words]
            kept = {name: os.environ[name] for name in ("PATH", "LANG", "SYSTEMROOT") if name in os.environ}
            limited = {"env": {**kept, "HOME": agent.folder, "OMP_NUM_THREADS": "1"}, "preexec_fn": _limits()}
        try:
            self._process = subprocess.Popen(
                words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=agent.folder or None, **limited
            )
        except (OSError, subprocess.SubprocessError) as error:
            raise BrokenContract(f"the agent {agent.command:.200} cannot be started: {error}") from error
        weakref.finalize(self, _end, self._process)

    def greeting(self, info: InformationState) -> _Wish:
        """What the agent asked for when it was greeted, which happens once."""
        if self._wish is None:
            problem = info.problem
            hello = {
                "shapes": list(problem.shape_labels),
                "poses": list(problem.pose_labels),
                "num_objects": problem.num_objects,
                "touch_limit": problem.touch_limit,
                "touch_cost": problem.touch_cost,
            }
            given = self.greet(hello)
            wish = _Wish(*(given.get(name, default) for name, default in vars(_Wish()).items()))
            if wish.state not in ("", *STATES) or not isinstance(wish.sees_target, bool):
                raise BrokenContract(f'"state" of an answer to hello is one of {", ".join(STATES)}; got {given!r:.200}')
            if type(wish.touch_limit) is not int or wish.touch_limit < 1:
                raise BrokenContract(f'"touch_limit" of an answer to hello is a number ≥ 1; got {given!r:.200}')
            self._wish = wish
        return self._wish

    def greet(self, hello: Mapping[str, Any]) -> dict[str, Any]:
        """The answer to a greeting, which is asked for once."""
        if self._greeted is None:
            self._greeted = self.answer({"do": "hello", "schema": SCHEMA, **hello}, 3 * _PATIENCE)
        return self._greeted

    def answer(self, request: Mapping[str, Any], patience: float) -> dict[str, Any]:
        """The answer to a line; the program is killed if it takes too long."""
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None, "it is a pipe"
        assert stdout is not None, "it is a pipe"
        timer, line = Timer(patience, self._process.kill), b""
        timer.daemon = True
        timer.start()
        try:
            stdin.write((json.dumps(request) + "\n").encode("ascii"))
            stdin.flush()
            line = stdout.readline(_LONGEST + 1)
        except OSError:
            pass  # it has ended, as the next lines say
        finally:
            timer.cancel()
        name = f"the agent {self.agent.command:.200}"
        if not line.endswith(b"\n") and len(line) <= _LONGEST:
            self._process.kill()
            raise BrokenContract(f"{name} ended, or gave no answer within {patience:g} s: {self._process.wait()}")
        try:
            given = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise BrokenContract(f"{name} answered no line of JSON, but {line[:200]!r}: {error}") from error
        if not isinstance(given, dict) or given.get("ok") is False:
            raise BrokenContract(f"{name} answered {line[:200]!r}")
        return given


def _running(agent: ProcessAgent) -> _Running:
    """The program of an agent, started once in each process and working folder."""
    return _started(agent, os.getcwd())


@lru_cache(maxsize=8)
def _started(agent: ProcessAgent, folder: str) -> _Running:
    return _Running(agent)


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    for stream in (process.stdin, process.stdout):
        with suppress(OSError):  # of what it did not read
            if stream is not None:
                stream.close()
    process.wait()


@lru_cache(maxsize=1)
def _without_network() -> tuple[str, ...]:
    """Words before a command that take the network from it; none where this is not possible."""
    words = ("unshare", "--user", "--map-current-user", "--net", "--pid", "--fork", "--kill-child")
    if shutil.which(words[0]) is None or subprocess.run([*words, "true"], capture_output=True, check=False).returncode:
        return ()
    return words


def is_without_network() -> bool:
    """Whether limited agents get no network on this machine."""
    return bool(_without_network())


def _limits() -> Callable[[], None] | None:
    """What limits a new process before it starts; None where the system has no such limits."""
    try:
        import resource
    except ImportError:
        return None
    asked = {"CPU": _CPU, "AS": _MEMORY, "FSIZE": _FILE, "NOFILE": _FILES, "CORE": 0}

    def limit() -> None:
        for name, most in asked.items():
            kind = getattr(resource, f"RLIMIT_{name}")
            hard = resource.getrlimit(kind)[1]
            most = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(kind, (most, most))

    return limit
