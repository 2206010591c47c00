"""``activetouch live``: a search that a robot carries out, over lines of JSON: one request a line, one answer a line.

Every line is answered, whatever it holds, and a line that is answered with an error has changed nothing
(docs/drive_a_robot.md).
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from io import BufferedIOBase
from pathlib import Path
from typing import IO, Annotated, Any, BinaryIO, Literal, NoReturn

import numpy as np
import tyro

from activetouch import RecordedSensor, TactileSensor
from activetouch.extras import require_extra
from activetouch.named_scenes import SCENES
from activetouch.pad_file import PadDescription, read_pad
from activetouch.sensor_files import RECORDED_FILE, scene_of
from belief.composition import Counts
from belief.constraints import Fraction, NotNegative, Probability
from belief.errors import InvalidArgument, UnknownName
from belief.journal import array_from
from belief.opinion import read_opinion
from belief.problem import Probe, Touch
from belief.references import ForeignCode
from belief.search_progress import Outcome
from belief.validation import Floats, as_real
from experiments.command_line.arguments import BadArgument, Count, Seed, check_arguments
from experiments.scene_choice import SceneChoice
from experiments.search.play import CompositionName, Setting
from experiments.sensor_choice import doubts, open_sensor, sensor_folder
from planners.episode import ACTION_NAMES, MOVED
from planners.session_log import OtherModel, problem_fields
from planners.tray import Press
from planners.tray_session import TraySession, action_fields

SCHEMA = "activetouch live 1"
"""Version of the protocol; the number grows when a client of an older one could be misled."""
MOST_BYTES = 1 << 23
"""Longest line that is read."""
_LONGEST = 600  # message, and other texts
_OF_SEARCHES = "objects", "composition", "among", "touch_cost", "never_unsure"
_OF_NAMING = "threshold", "max_touches"
_DETAILS = ("pose", "force", "area", "place", "height", "step")


class BadLine(InvalidArgument):
    """A line that is not a request."""


class Conversation:
    """Answers the requests of one session of a sensor."""

    tells: Set[str] = {"image", "readings", "logits", "features", "missed", "pose", "force", "area", "step", "done"}
    """Fields of a tell."""

    def __init__(self, session: Any, sensor: Any, pad: PadDescription | None = None) -> None:
        self.session, self.sensor, self.pad = session, sensor, pad
        self.felt: Any = None  # the image that the last line told
        self._requests: Mapping[str, tuple[Callable[[dict[str, Any]], dict[str, Any]], set[str]]] = {
            "hello": (self._hello, set()),
            "ask": (self._ask, set()),
            "tell": (self._tell, {*self.tells}),
            "undo": (self._undo, {"step"}),
            "reveal": (self._reveal, {"arrangement"}),
            "state": (self._state, set()),
        }

    def answer(self, line: bytes | None) -> bytes:
        """The answer to a line, None for one that was too long; both end with a line break."""
        given: dict[str, Any] = {}
        self.felt = None
        try:
            given = _parsed(line)
            with ForeignCode():  # of a decider
                found = {"ok": True, **self._answer(given)}
        except Exception as error:  # whatever it was, the next line is answered
            found = refusal(error)
        found["step"] = self.session.step
        if "id" in given:
            found["id"] = given["id"]
        return as_line(found)

    def _answer(self, given: dict[str, Any]) -> dict[str, Any]:
        do = given.get("do")
        if not isinstance(do, str) or do not in self._requests:
            raise BadLine(f'"do" must be one of {", ".join(self._requests)}; got {do!r:.40}')
        handle, known = self._requests[do]
        if unknown := sorted(set(given) - known - {"do", "id"}):
            raise BadLine(
                f"a request {do!r} has no field {unknown[0]!r:.40}; it has {', '.join(sorted(known)) or 'none'}"
            )
        return handle(given)

    def _hello(self, given: dict[str, Any]) -> dict[str, Any]:
        session, sensor = self.session, self.sensor
        if isinstance(sensor, RecordedSensor):
            shape, dtype = [sensor.recorded_reader.num_features], "float64"
        else:
            shape, dtype = list(sensor.scene.image_shape), "uint8"
        return {
            "schema": SCHEMA,
            "shapes": list(session.problem.shape_labels),
            "poses": list(session.problem.pose_labels),
            "target": session.problem.shape_labels[session.target],
            "num_objects": session.problem.num_objects,
            "composition": problem_fields(session.problem)["composition"],
            "touch_limit": session.problem.touch_limit,
            "image": {"shape": shape, "dtype": dtype},
            **({} if self.pad is None else {"readings": len(self.pad.taxels)}),
        }

    def _ask(self, given: dict[str, Any]) -> dict[str, Any]:
        action, session = self.session.ask(), self.session
        if action is None:
            return {"action": None, "outcome": str(session.outcome), "object": session.object_index}
        found: dict[str, Any] = {"object": session.object_index}
        if not isinstance(action, Probe):
            why = {} if (reason := session.reason) is None else {"why": reason}
            return {**found, "action": ACTION_NAMES[type(action)], **why}
        found |= {"action": "touch", "pose": session.problem.pose_labels[action.pose]}
        if not isinstance(self.sensor, RecordedSensor):
            scene = self.sensor.scene
            found["quaternion"] = np.asarray(scene.rotations[found["pose"]]).tolist()
            found["aim"] = scene.aim_offsets[action.pose].tolist()
        return found

    _kinds = (
        '"image", "readings" (of the taxels of a --pad), "logits" with or without "features", "missed" and "done": true'
    )

    def _tell(self, given: dict[str, Any]) -> dict[str, Any]:
        if given.get("step") is None:
            raise BadLine("a tell needs the step that it answers, as ask gave it, so that none counts twice")
        told = {name: given[name] for name in _DETAILS if given.get(name) is not None}
        kinds = [
            name for name in ("image", "readings", "logits", "missed", "done") if given.get(name) not in (None, False)
        ]
        if "features" in given and "logits" not in kinds:
            kinds.append("features")
        if len(kinds) != 1 or ("missed" in kinds and given["missed"] is not True):
            raise BadLine(f"tell one of {self._kinds}")
        if kinds[0] == "done":
            if given["done"] is not True or len(told) > 1:
                raise BadLine('an action that was carried out is told by "done": true and "step" alone')
            if isinstance(self.session.ask(), Probe | Press):
                raise BadLine("asked was a touch; tell what was felt")
        elif kinds[0] == "missed":
            told["missed"] = True
        elif kinds[0] == "image":
            told["image"] = _numbers(given["image"], "image")
        elif kinds[0] == "readings":
            if self.pad is None:
                raise BadLine('"readings" are of the taxels of a pad: start with --pad FILE.toml, or tell an "image"')
            told["image"] = self.pad.image(_numbers(given["readings"], "readings"))
        elif kinds[0] == "features" and isinstance(self.sensor, RecordedSensor):  # a row of recordings is its image
            told["image"] = _numbers(given["features"], "features")
        else:
            told["touch"] = self._touch(given, told.get("pose"))
        kind = self.session.tell(**told)
        self.felt = told.get("image")
        return {"told": kind}

    def _touch(self, given: dict[str, Any], pose: Any) -> Touch:
        action = self.session.ask()
        arrays = {name: _numbers(given[name], name) for name in ("logits", "features") if given.get(name) is not None}
        if pose is None and not isinstance(action, Probe):
            raise BadLine('no touch was asked for, so say in which "pose" it was made')
        return Touch(action.pose if isinstance(action, Probe) else 0, **arrays)

    def _undo(self, given: dict[str, Any]) -> dict[str, Any]:
        if (step := given.get("step")) not in (None, self.session.step):
            raise BadLine(
                f"the session is at step {self.session.step}, the request at {step!r:.40}; nothing was undone"
            )
        return {"undone": self.session.undo()}

    def _reveal(self, given: dict[str, Any]) -> dict[str, Any]:
        shapes = given.get("arrangement")
        if not isinstance(shapes, list):
            raise BadLine('a reveal needs "arrangement": a list with one entry for every object')
        self.session.reveal(shapes)
        return self._state(given)

    def _state(self, given: dict[str, Any]) -> dict[str, Any]:
        session, labels = self.session, self.session.problem.shape_labels
        marginals = session.scene.marginals()
        over = session.outcome is not None
        health = session.scene.sensor_health
        return {
            **({} if health is None else {"sensor_health": str(health)}),
            "object": session.object_index,
            **({MOVED: session.prob_moved} if session.prob_moved else {}),
            "outcome": str(session.outcome) if over else None,
            "success": session.episode.success if over else None,
            "num_touches": sum(step.touch is not None for step in session.steps),
            "beliefs": [dict(zip(labels, row, strict=True)) for row in marginals.tolist()],
            **({"unlisted": session.scene.unlisted().tolist()} if session.problem.unlisted else {}),
            "log_marginals": session.scene.log_marginals().clip(-1e300).tolist(),
            "log_conflict": min(max(float(session.scene.log_conflict), -1e300), 1e300),
        }


class NamingConversation(Conversation):
    """Answers the requests of one session that names an object."""

    def _hello(self, given: dict[str, Any]) -> dict[str, Any]:
        found = super()._hello(given)
        return {name: value for name, value in found.items() if name not in ("target", "composition")}

    def _ask(self, given: dict[str, Any]) -> dict[str, Any]:
        found = super()._ask(given)
        if found["action"] == "confirm" or found.get("outcome") == str(Outcome.CONFIRMED):
            found |= {"name": self.session.answer, "stated": min(self.session.stated, 1.0)}
            return found | ({"outcome": "named"} if found["action"] is None else {"action": "name"})
        return found

    def _state(self, given: dict[str, Any]) -> dict[str, Any]:
        found = super()._state(given)
        return found | ({"outcome": "named"} if found["outcome"] == str(Outcome.CONFIRMED) else {})


class TrayConversation(Conversation):
    """Answers the requests of one session in a tray."""

    session: TraySession
    tells = frozenset({"image", "height", "missed", "place", "step", "done"})
    _kinds = '"image" with its "height", "missed": true and "done": true'

    def _hello(self, given: dict[str, Any]) -> dict[str, Any]:
        belief, image = self.session.belief, {"shape": list(self.sensor.scene.image_shape), "dtype": "uint8"}
        return {
            "schema": SCHEMA,
            "shapes": list(belief.table.labels),
            "target": belief.table.labels[belief.target],
            "num_objects": belief.num_objects,
            "size": list(belief.size),
            "touch_limit": self.session.rules.most_touches,
            "image": image,
        }

    def _ask(self, given: dict[str, Any]) -> dict[str, Any]:
        action = self.session.ask()
        if action is None:
            return {"action": None, "outcome": str(self.session.outcome)}
        found = action_fields(action)
        if isinstance(action, Press):
            del found["cell"]
            found["place"] = list(self.session.place())
        return found

    def _state(self, given: dict[str, Any]) -> dict[str, Any]:
        session, standing = self.session, self.session.standing
        over = session.outcome is not None
        return {
            "outcome": str(session.outcome) if over else None,
            "success": session.episode.success if over else None,
            "num_touches": len(session.steps),
            "places": [{"place": list(place), "prob": min(prob, 1.0)} for place, prob in standing.places],
            "unfound": standing.unfound,
            "absent": standing.absent,
        }


def refusal(error: Exception) -> dict[str, Any]:
    """The answer that reports an error."""
    return {"ok": False, "error": type(error).__name__, "message": str(error)[:_LONGEST]}


def as_line(found: Mapping[str, Any]) -> bytes:
    """An answer as a line of JSON."""
    return (json.dumps(found, allow_nan=False) + "\n").encode("ascii")


def requests(stream: IO[bytes] | BufferedIOBase, most: int = MOST_BYTES) -> Iterator[bytes | None]:
    """The lines of a stream; None for one of more than ``most`` bytes, of which no more is kept in memory."""
    while line := stream.readline(most + 1):
        if len(line) <= most:
            yield line
            continue
        while line and not line.endswith(b"\n"):
            line = stream.readline(1 << 16)
        yield None


def converse(
    conversation: Conversation, lines: BinaryIO, answers: BinaryIO, show: Callable[..., None] | None = None
) -> None:
    """Answer all lines of a stream, each before the next is read; ``show`` gets session, answer and image."""
    for line in requests(lines):
        answers.write(answer := conversation.answer(line))
        answers.flush()
        if show is not None:
            show(conversation.session, answer, conversation.felt)


def _parsed(line: bytes | None) -> dict[str, Any]:
    if line is None:
        raise BadLine(f"a line has more than {MOST_BYTES} bytes; send larger images as base64, or fewer pixels")
    try:
        given = json.loads(line.decode("utf-8"), parse_constant=_no_number, parse_float=_finite)
    except (ValueError, RecursionError) as error:
        raise BadLine(f"it is not JSON: {error or 'nested too deeply'}") from None
    if not isinstance(given, dict):
        raise BadLine(f"a request is a JSON object with the field 'do', got {type(given).__name__}")
    texts = [*given, *given.values(), *(given["arrangement"] if isinstance(given.get("arrangement"), list) else [])]
    if any(isinstance(text, str) and len(text) > _LONGEST for text in texts):
        raise BadLine(f"a text has more than {_LONGEST} characters")
    if not isinstance(given.get("id"), str | int | float | None) or len(str(given.get("id"))) > 200:
        given.pop("id")
        raise BadLine("an id must be a short text or a number")
    return given


def _finite(text: str) -> float:
    return float(text) if math.isfinite(float(text)) else _no_number(text[:40])


def _no_number(name: str) -> NoReturn:
    raise BadLine(f"{name} is no finite number")


def _numbers(given: Any, name: str) -> Any:
    """An array of numbers from lists, or from dtype, shape and base64."""
    if isinstance(given, dict):
        return array_from(given)
    try:
        return as_real(np.asarray(given), name)
    except (ValueError, OverflowError) as error:
        raise InvalidArgument(f"{name} must be numbers: {error}") from error


@dataclass(frozen=True)
class Live:
    """Run a search that a robot carries out: questions and answers as lines of JSON on standard input and output.

    Without a target, it says which object is at the pad.

    All that is told is on disk before the next question. The same command with the same --log goes on after a crash.
    docs/drive_a_robot.md describes the lines.

    For example:

        activetouch live --sensor coarse --target cone --objects 4 --log today.jsonl
        activetouch live --sensor my_sensor --target mug
        activetouch live --only --meshes mug.obj cup.stl bowl.ply
        activetouch live --scene "drawer(size=(0.3, 0.2))" --sensor coarse --target cone --objects 3
    """

    target: str | None = None
    """Shape to search for; without it, one object is named."""
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
    decider: str | None = None
    """Decider, as of compare; by default information_gain, or shape_information_gain where an object is named."""
    threshold: Fraction = 0.95
    """Probability at which an object is named, without --target."""
    max_touches: Count = 16
    """Touches after which an object is named, without --target."""
    observation_model: Literal["nested"] | None = None
    """nested: orientations are weighed coarse to fine, for hundreds of meshes; the default where they are so many."""
    touch_cost: NotNegative = 0.02
    """Cost λ of one touch, in units of a success."""
    unlisted: Probability | None = None
    """Prior probability that an object has none of the shapes. By default 0 with --target, and 0.05 without; 0.15 where
    one of many meshes is named."""
    prior: str | None = None
    """Probabilities of shapes before the first touch, as a camera sees them: mug=.7,bowl=.3 for all objects, or a CSV
    file with columns object, shape and prob. They may be wrong, so they count less than touches."""
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
    as_described: bool = False
    """Take the sensor, and the proportions of built-in solids, to be as described. By default a sensor that has both
    readers doubts them: where touches are odd, it asks what is the matter."""
    unknown_state: bool = False
    """Infer from the touches what is the matter with the sensor: forces, stiffness, noise, broken taxels, a shifted
    image. Needs a reader of any object."""
    doubted_state: bool = False
    """The same, but only where touches are odd for the sensor as described. Needs both readers."""
    other_proportions: bool = False
    """Built-in solids may have other proportions than those of the scene, from half to double, with a probability of
    0.04. Needs both readers."""

    view: Annotated[Path | None, tyro.conf.arg(metavar="FILE|window")] = None
    """Show each touch in the viewer of Rerun: in its window, or in a file that "rerun FILE" opens."""

    def run(self) -> None:
        """Answer requests until the input ends; an error at the start is one line of JSON, too."""
        show = None
        try:
            if self.view is not None:
                require_extra("view")
            conversation = self._begun()
            if self.view is not None:
                from experiments.search.viewer import viewer

                show = viewer(conversation.sensor, self.view)
        except Exception as error:
            sys.stdout.buffer.write(as_line(refusal(error)))
            sys.stdout.buffer.flush()
            raise
        try:
            converse(conversation, sys.stdin.buffer, sys.stdout.buffer, show)
        finally:
            conversation.session.close()

    def _begun(self) -> Conversation:
        """The conversation of a session, which may go on."""
        check_arguments(self)
        usual = f"runs/live/{time.strftime('%Y-%m-%d-%H%M%S')}-{os.getpid()}.jsonl"
        log = Path(usual) if self.log is None else self.log
        begin = self._in_a_tray if self.choice.is_tray else self._naming if self.target is None else self._of_objects
        found = begin(log)
        step = found.session.step
        print(f"log: {log}" + f", goes on at step {step}" * bool(step), file=sys.stderr)
        return found

    def _in_a_tray(self, log: Path) -> Conversation:
        """The conversation of a search among objects in a tray, at places that nobody knows."""
        from experiments.search.drawer.searches import Searches  # whose modules no other scene needs

        usual = Live(self.target)
        plain = replace(self, choice=usual.choice, sensor=None, objects=None, decider=usual.decider, seed=0, log=None)
        if plain != usual:
            raise BadArgument(
                "the scene drawer takes --target, --sensor, --meshes, --objects, --decider, --seed and --log"
            )
        sensor = Searches.of(Setting(self.choice, self.sensor, self.objects)).made()
        decider = self.decider or "information_per_cost"
        if self.target is None:
            raise BadArgument(
                f"say what is searched for in the tray with --target, one of {', '.join(sensor.shape_labels)}"
            )
        return TrayConversation(sensor.session(self.target, decider, self.seed, log=log), sensor)

    def _naming(self, log: Path) -> Conversation:
        """The conversation of a session that names an object."""
        self._require_usual(_OF_SEARCHES, "without --target, one object is named: say a --target, or leave out {given}")
        sensor = self._open()
        opinion = None if self.prior is None else read_opinion(self.prior, sensor.shape_labels, 1)
        rules = {name: getattr(self, name) for name in (*_OF_NAMING, "unlisted", "least_force", "least_area")}
        rules = {name: value for name, value in rules.items() if value is not None}
        decider = self.decider or "shape_information_gain"
        session = sensor.naming(decider, self.seed, log=log, opinion=opinion, **rules)
        return NamingConversation(session, sensor, self._pad)

    def _require_usual(self, names: Sequence[str], words: str) -> None:
        """Check that some options have their default."""
        if given := [f"--{name.replace('_', '-')}" for name in names if getattr(self, name) != getattr(Live, name)]:
            raise BadArgument(words.format(given=", ".join(given)))

    @property
    def _pad(self) -> PadDescription | None:
        return None if self.choice.pad is None else read_pad(self.choice.pad)

    def _of_objects(self, log: Path) -> Conversation:
        """The conversation of a search among objects that come one after the other."""
        assert self.target is not None, "another conversation"
        self._require_usual(_OF_NAMING, "with --target, the decider decides when to stop: leave out {given}")
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
        try:
            session = sensor.session(
                self.target,
                self.decider or "information_gain",
                self.seed,
                num_objects=self.objects,
                composition=composition,
                touch_cost=self.touch_cost,
                unlisted=self.unlisted or 0.0,
                opinion=self._opinion(sensor, composition),
                log=log,
                abstain=not self.never_unsure,
                least_force=self.least_force,
                least_area=self.least_area,
            )
        except OtherModel as error:
            raise OtherModel(f"{error} (was it begun with --unknown-state, another hand, or other meshes?)") from None
        return Conversation(session, sensor, self._pad)

    def _opinion(self, sensor: TactileSensor | RecordedSensor, composition: str | Counts | None) -> Floats | None:
        """Probabilities of the shapes of each object, if there are any."""
        if self.prior is None:
            return None
        number = sensor.problem(self.objects, composition).num_objects
        return read_opinion(self.prior, sensor.shape_labels, number)

    def _open(self) -> TactileSensor | RecordedSensor:
        choice, given = self.choice, self.sensor
        if given is not None and (sensor_folder(given, "") / RECORDED_FILE).exists():
            return TactileSensor.load(sensor_folder(given, ""))
        of_scene = "" if given is None or given.exists() else scene_of(str(given))
        if of_scene in SCENES and choice.scene == SceneChoice.scene:
            choice = replace(choice, scene=of_scene)
        nested = True if self.observation_model == "nested" else None
        options = doubts(self.as_described, self.unknown_state, self.doubted_state, self.other_proportions)
        return open_sensor(given, choice, self.anyway, nested=nested, **options)
