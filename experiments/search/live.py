"""``activetouch live``: a search that a robot carries out, over lines of JSON."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from activetouch import RecordedSensor, TactileSensor
from activetouch.named_scenes import SCENES
from activetouch.sensor_files import INDEPENDENT_SUFFIX, RECORDED_FILE
from belief.composition import Counts
from belief.constraints import NotNegative
from belief.errors import UnknownName
from experiments.command_line.arguments import BadArgument, Count, Seed, check_arguments
from experiments.scene_choice import SceneChoice
from experiments.search.live_protocol import Conversation, as_line, converse, refusal
from experiments.search.setting import CompositionName
from experiments.sensor_choice import open_sensor, sensor_folder
from planners import Session
from planners.session_log import OtherModel


@dataclass(frozen=True)
class Live:
    """Run a search that a robot carries out: questions and answers as lines of JSON on standard input and output.

    All that is told is on disk before the next question. The same command with the same --log goes on after a crash.
    docs/drive_a_robot.md describes the lines.

    For example:

        activetouch live --sensor coarse --target cone --objects 4 --log today.jsonl
        activetouch live --sensor my_sensor --target mug
    """

    target: str
    """Shape to search for."""
    sensor: Path | None = None
    """Folder of a sensor, or name of a shipped one; that of the scene by default."""
    choice: tyro.conf.OmitArgPrefixes[SceneChoice] = field(default_factory=SceneChoice)
    """The scene; for a shipped sensor its own by default."""
    objects: Count | None = None
    """Objects on the table; that of the scene by default."""
    composition: CompositionName | None = None
    """distinct: all objects have different shapes. independent: each object can have any shape. at_most_one: one object
    has the target's shape, or none. That of the scene by default, or distinct; independent where the exact sum over
    different ones is too large."""
    among: tuple[str, ...] = ()
    """Labels of the sensor that objects can have; all by default."""
    decider: str = "information_gain"
    """Decider, as of compare."""
    observation_model: Literal["nested"] | None = None
    """nested: orientations are weighed coarse to fine, for hundreds of meshes; the default where they are so many."""
    touch_cost: NotNegative = 0.02
    """Cost λ of one touch, in units of a success."""
    seed: Seed = 0
    """Seed of the decider."""
    never_unsure: bool = False
    """Forbid the answer "I do not know": a strange sensor then gives confident answers."""
    least_force: NotNegative | None = None
    """A contact whose stated force is not larger is no contact [N]."""
    least_area: NotNegative | None = None
    """A contact whose area is not larger is no contact [m²]."""
    log: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """File for all that is told; a search that it holds goes on with the options that began it.
    By default a new one in runs/live."""
    anyway: bool = False
    """Accept a sensor that was made for another scene."""
    unknown_state: bool = False
    """Infer from the touches what is the matter with the sensor: forces, stiffness, noise, broken taxels, a shifted
    image. Needs a reader of any object."""

    def run(self) -> None:
        """Answer requests until the input ends; an error at the start is one line of JSON, too."""
        try:
            session, sensor = self._begun()
        except Exception as error:
            sys.stdout.buffer.write(as_line(refusal(error)))
            sys.stdout.buffer.flush()
            raise
        try:
            converse(Conversation(session, sensor), sys.stdin.buffer, sys.stdout.buffer)
        finally:
            session.close()

    def _begun(self) -> tuple[Session, TactileSensor | RecordedSensor]:
        """The session, which may go on, and its sensor."""
        check_arguments(self)
        sensor = self._open()
        composition: str | Counts | None = self.composition
        if among := list(dict.fromkeys(self.among)):
            if self.target not in among:
                raise UnknownName("target among --among", self.target, among)
            if isinstance(sensor, RecordedSensor):
                sensor = sensor.among(among)
            elif composition in ("independent", "at_most_one"):
                raise BadArgument(
                    "--among, for a sensor of a scene, is of different objects; use --composition distinct"
                )
            else:
                composition = Counts(dict.fromkeys(among, 1))
        log = self.log if self.log is not None else Path(f"runs/live/{time.strftime('%Y-%m-%d-%H%M%S')}.jsonl")
        try:
            session = sensor.session(
                self.target,
                self.decider,
                self.seed,
                num_objects=self.objects,
                composition=composition,
                touch_cost=self.touch_cost,
                log=log,
                abstain=not self.never_unsure,
                least_force=self.least_force,
                least_area=self.least_area,
            )
        except OtherModel as error:
            raise OtherModel(f"{error} (was it begun with --unknown-state, another hand, or other meshes?)") from None
        print(f"log: {log}" + f", goes on at step {session.step}" * bool(session.step), file=sys.stderr)
        return session, sensor

    def _open(self) -> TactileSensor | RecordedSensor:
        choice, given = self.choice, self.sensor
        if given is not None and (sensor_folder(given, "") / RECORDED_FILE).exists():
            return TactileSensor.load(sensor_folder(given, ""))
        of_scene = "" if given is None or given.exists() else str(given).removesuffix(INDEPENDENT_SUFFIX)
        if of_scene in SCENES and choice.scene == SceneChoice.scene:
            choice = replace(choice, scene=of_scene)
        nested = True if self.observation_model == "nested" else None
        return open_sensor(given, choice, self.anyway, unknown_state=self.unknown_state, nested=nested)
