"""Processor time of one touch, of what follows from it, and of one decision; compared with those of an earlier commit.

    python -m benchmarks.one_decision                                         (six scenes, a minute)
    python -m benchmarks.one_decision --scenes keyed --before REVISION        (also in that revision's tree, in pairs)

One thread, live touches, the sensors' own number of hypotheses. A touch is pressed, rendered and read. Decisions before
the first touch of an object are left out, because they are the same for all objects, and so are those to stop. With
--before, the same rounds are played in turn by both trees, so that a change of the machine's speed affects both.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import numpy as np

from activetouch import SCENES, TactileSensor, TouchWorld
from belief import Probe, SceneBelief
from experiments.scene_choice import SceneChoice
from experiments.search.setting import Setting
from planners import InformationState, make_decider

OBJECTS, TOUCHES = 8, 8  # of a round; touches of one object
NAMES = ("decision", "touch", "evidence", "belief")
Times = dict[str, list[float]]


def rounds(scene: str, decider_name: str) -> Iterator[Times]:
    """Milliseconds of touches, updates of the evidence and of the scene's belief, and decisions; without end."""
    setting, sensor = Setting(SceneChoice(scene)), TactileSensor.shipped(scene)
    problem, model = setting.problem, sensor.model
    decider = make_decider(decider_name, model.outcome_table(), model)
    for first in count(0, OBJECTS):
        times: Times = {name: [] for name in NAMES}
        for number in range(first, first + OBJECTS):
            rng, target = np.random.default_rng(number), number % problem.num_shapes
            world = TouchWorld.sample(sensor, (target,) * problem.num_objects, rng)
            belief, evidence = SceneBelief(problem, model), model.start()
            for touch in range(TOUCHES):
                info = InformationState.of(problem, target, belief, 0)
                ends = [time.process_time()]
                action = decider.decide(info, rng).action
                ends.append(time.process_time())
                felt = world.touch(action.pose if isinstance(action, Probe) else touch % problem.num_poses, rng)
                ends.append(time.process_time())
                evidence = evidence.update(felt)
                _ = evidence.log_likelihood
                ends.append(time.process_time())
                belief.update(0, [felt])
                ends.append(time.process_time())
                for name, seconds in zip(NAMES, np.diff(ends).tolist(), strict=True):
                    if name != "decision" or (touch and isinstance(action, Probe)):
                        times[name].append(1e3 * seconds)
        yield times


def table(scenes: list[str], decider: str, number: int) -> None:
    """Print the times of some scenes."""
    heads = "".join(f"{name:>14s}" for name in NAMES)
    print(f"scene   shapes{heads}  decision / touch   [ms: median, a tenth below]")
    for scene in scenes:
        source = rounds(scene, decider)
        found = [next(source) for _ in range(number + 1)][1:]
        pooled = {name: [ms for times in found for ms in times[name]] for name in NAMES}
        cells = "".join(
            "{:8.2f}{:6.2f}".format(*np.quantile(ms, [0.5, 0.1])) if ms else "       –     –" for ms in pooled.values()
        )
        ratio = f"{np.median(pooled['decision']) / np.median(pooled['touch']):.2f}" if pooled["decision"] else "–"
        print(f"{scene:7s} {len(TactileSensor.shipped(scene).model.shape_labels):6d}{cells}{ratio:>18s}", flush=True)


def compare(scenes: list[str], decider: str, number: int, revision: str) -> None:
    """Print the times of one decision in this tree and in that of a revision, and their ratio over rounds."""
    here = Path(__file__).resolve().parents[1]
    print(f"scene    before [ms]  now [ms]  now / before, 95 %     decision / touch: before, now   ({number} rounds)")
    with tempfile.TemporaryDirectory() as before:
        archive = subprocess.run(["git", "archive", revision], cwd=here, stdout=subprocess.PIPE, check=True).stdout
        subprocess.run(["tar", "-x", "-C", before], input=archive, check=True)
        for scene in scenes:
            command = [sys.executable, "-P", __file__, "--scenes", scene, "--decider", decider, "--serve"]
            players = [
                subprocess.Popen(
                    command,
                    env={**os.environ, "PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1"},
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    text=True,
                )
                for tree in (Path(before), here)
            ]
            means = np.array([[_mean(player) for player in players] for _ in range(number + 1)][1:])  # (rounds, 2, 2)
            for player in players:
                player.communicate()
            total = means.mean(axis=0)
            draws = means[np.random.default_rng(0).integers(number, size=(2000, number))].mean(axis=1)[..., 0]
            low, high = np.quantile(draws[:, 1] / draws[:, 0], [0.025, 0.975])
            shares = total[:, 0] / total[:, 1]
            print(
                f"{scene:8s} {total[0, 0]:11.2f} {total[1, 0]:9.2f}  {total[1, 0] / total[0, 0]:.3f} "
                f"[{low:.3f}, {high:.3f}] {shares[0]:24.2f}, {shares[1]:.2f}",
                flush=True,
            )


def _mean(player: subprocess.Popen[str]) -> list[float]:
    """Mean milliseconds of a decision and of a touch in one more round."""
    assert player.stdin is not None
    assert player.stdout is not None
    player.stdin.write("\n")
    player.stdin.flush()
    times = json.loads(player.stdout.readline())
    return [float(np.mean(times[name])) for name in ("decision", "touch")]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=list(SCENES))
    parser.add_argument("--decider", default="information_gain")
    parser.add_argument("--rounds", type=int, default=3, help="of eight objects, eight touches each")
    parser.add_argument("--before", metavar="REVISION", help="compare with this revision's tree")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.serve:
        source = rounds(chosen.scenes[0], chosen.decider)
        for _ in sys.stdin:
            print(json.dumps(next(source)), flush=True)
    elif chosen.before:
        compare(chosen.scenes, chosen.decider, chosen.rounds, chosen.before)
    else:
        table(chosen.scenes, chosen.decider, chosen.rounds)


if __name__ == "__main__":
    main()
