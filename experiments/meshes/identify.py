"""``activetouch identify``: which of the bodies in a folder of meshes is it? Nothing is trained for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from activetouch import TactileSensor, TouchWorld
from activetouch.pose_belief import PoseBelief
from activetouch.poses import WorldObject
from activetouch.scene import Scene
from activetouch.sensor.searching import STRANGERS
from belief.constraints import CountOrNone, Probability, Within, require_rule
from belief.errors import InvalidArgument
from belief.files import ends_claims
from belief.naming import NONE_OF_THESE, UNLISTED, Name, shape_name
from belief.opinion import read_opinion
from belief.problem import Touch
from belief.table import Table
from belief.validation import Floats
from experiments.command_line.arguments import Count
from experiments.meshes.near_twins import near_twins
from experiments.meshes.result import Bodies, MeshOptions, MeshResult, body_index, result_of, solids_of
from experiments.meshes.setting import model_of, plan_of, scene_of, sensor_of
from experiments.parallel import Shared, run_tasks
from experiments.report import Picture, Report, Section
from experiments.robustness.conditions import applicable_conditions
from planners import Decider
from planners.registry import make_decider
from planners.search import Identification
from planners.search import identify as name_first

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_GAINS = "information_gain", "shape_information_gain", "pose_information_gain"
_BY_EVIDENCE = *_GAINS, "value_of_information", "fixed_poses", "random_poses"
_PICTURED = 6  # objects
_ANGLES = Within(0.1, 180.0)  # [deg]
_ANGLES_OF = "off", "within"  # columns of Lying


class Lying(NamedTuple):
    """How an object was believed to lie after each touch, or after the last one, and the true object."""

    after: tuple[PoseBelief, ...]
    body: WorldObject

    @property
    def off(self) -> float:
        """How far it lies from its most probable orientation [deg]."""
        return self.after[-1].error(self.body.orientation)

    @property
    def within(self) -> float:
        """Within what angle it lies with probability 0.9 [deg]."""
        return self.after[-1].credible().radius


@dataclass(frozen=True, eq=False)
class Identified(MeshResult):
    """Simulated objects, and how they were named; prints as their table."""

    namings: Sequence[Identification]
    pressed: Sequence[str] = field(default=(), kw_only=True)
    lying: Sequence[Lying | None] = field(default=(), kw_only=True)
    _kind = "objects"
    _columns = ("result", ""), ("object", "d"), ("body", ""), ("named", ""), ("stated", ".3f"), ("touches", "d")
    _note = "{right} of {number} named rightly, {low} to {high}; stated {stated:.2f} in the mean."

    def rows(self) -> list[dict[str, Any]]:
        """One row for each object: its body, the named one, the stated probability, and touches."""
        return [
            {
                "result": result_of(one.is_right, one.is_certain, one.named == UNLISTED),
                "object": number,
                "body": self._name(one.truth) if not self.pressed else self.pressed[number - 1],
                "named": self._name(one.named),
                "right": one.is_right,
                "stated": one.stated,
                "certain": one.is_certain,
                "touches": len(one.poses),
                **(self._lies(number - 1) if self.lying else {}),
                "directions": " ".join(self.sensor.pose_labels[pose] for pose in one.poses),
            }
            for number, one in enumerate(self.namings, 1)
        ]

    def _lies(self, number: int) -> dict[str, float | None]:
        one = self.lying[number]
        return {name: None if one is None else getattr(one, name) for name in _ANGLES_OF}

    def _name(self, index: int) -> str:
        return shape_name(self.sensor.shape_labels, index)

    def table(self) -> Table:
        """The rows, and how many are right; where answers are certain, how many of these."""
        found, rows = super().table(), [row for _, row in self._ordered()]
        if known := [one for one in self.lying if one is not None]:
            off, within = (np.array([getattr(one, name) for one in known]) for name in _ANGLES_OF)
            held = np.mean([one.after[-1].credible().contains(one.body.orientation) for one in known])
            middle, most = np.percentile(off, [50, 90])
            own = [tuple(row[name] for name in _ANGLES_OF) for row in rows]
            found = replace(
                found,
                columns=(*found.columns, ("off [°]", ".1f"), ("within [°]", ".1f")),
                rows=[(*row, *more) for row, more in zip(found.rows, own, strict=True)],
                note=f"{found.note} The most probable orientation is {middle:.1f}° off in the median and {most:.1f}° "
                f"in the worst tenth, less what symmetry hides; sets of probability 0.9, {np.median(within):.1f}° wide "
                f"in the median, hold {held:.2f} of {len(known)}.",
            )
        none = [row for row in rows if row["named"] == NONE_OF_THESE and row["certain"]]
        named = [row for row in rows if row["named"] != NONE_OF_THESE and row["certain"]]
        if len(named) == len(rows):
            return found
        said = (
            f" {len(named)} reached the threshold, {sum(row['right'] for row in named)} of them rightly; "
            f"{len(none)} are certainly {NONE_OF_THESE}, {sum(row['right'] for row in none)} of them rightly; "
            f"{len(rows) - len(named) - len(none)} stayed open."
        )
        if none:
            said += (
                " A body that differs from its file, such as a scan, is none of these: say by how much (tolerance). So "
                "may any body be for a sensor that is not as described."
            )
        return replace(found, note=found.note + said)

    @property
    def _title(self) -> str:
        return f"objects among {len(self.sensor.shape_labels)} bodies"

    @property
    def _question(self) -> str:
        return "Which body is it?"

    def report(self) -> Report:
        """The table, the bodies that were still possible, and how objects lie."""
        found = super().report()
        lying = list(enumerate(self.lying[:_PICTURED], 1))
        pictures = [_lying_picture(self.sensor, number, lies) for number, lies in lying if lies is not None]
        said = "Pictures are averaged over what is still probable; the line is the outline of the true body."
        own = [Section("How they lie", [said], [], pictures)] if pictures else []
        return replace(found, sections=[*found.sections, *own])

    @property
    def _answered(self) -> str:
        return "objects are named rightly"

    @property
    def _by_chance(self) -> float:
        return 1.0 / len(self.sensor.shape_labels)

    def _films(self) -> list[dict[str, Any]]:
        return [self._film(number, row) for number, row in self._ordered()[:_PICTURED]]

    def _film(self, number: int, row: dict[str, Any]) -> dict[str, Any]:
        """The touches of an object, in the form of ``film.html``."""
        from experiments.search.page import Drawn, brightest  # loads matplotlib

        one, lies = self.namings[number], self.lying[number] if self.lying else None
        true, body = self._name(one.truth), None if lies is None else lies.body
        scale, evidence, panels = brightest([touch.image for touch in one.touches]), model_of(self.sensor).start(), []
        drawn = Drawn(self.sensor, scale)
        for count, touch in enumerate(one.touches, 1):
            evidence = evidence.update(touch)
            probs = evidence.belief.probs if one.log_probs is None else np.exp(one.log_probs[count - 1], dtype=float)
            bodies = drawn.bodies_of(evidence, probs, touch.pose, true, body)
            side, labels = self.sensor.pose_labels[touch.pose], self.sensor.shape_labels
            bars = [(label, float(probs[labels.index(label)]), label == true, uri) for label, uri in bodies.items()]
            panels.append(
                {
                    "heading": "",
                    "action": f"touch {side}",
                    "words": f"Touch {count}, side {side}",
                    "seen": [*drawn.felt(touch.image), *drawn.predicted(evidence, probs, touch.pose)],
                    "objects": (),
                    "now": 0,
                    "bars": [*bars, (NONE_OF_THESE, max(0.0, 1.0 - float(probs.sum())), true == NONE_OF_THESE, None)],
                    "scores": {},
                }
            )
        named = f"named {row['named']} with probability {row['stated']:.2f}"
        return {
            "title": f"Object {row['object']}, {row['result']}: {named}; it is {row['body']}",
            "success": row["result"] == "right",
            "panels": panels,
            "scale": scale,
            "longest_label": max(map(len, self.sensor.shape_labels)),
            "start": len(panels) - 1,
            "together": False,
        }


def _lying_picture(sensor: TactileSensor, number: int, lies: Lying) -> Picture:
    """How an object is believed to lie after each touch, and the outline of the true body."""
    from activetouch.view import Bodies, coloured

    bodies = Bodies.of(sensor)
    assert bodies is not None, "the belief is about one body"
    outline = bodies.outline(lies.after[0].shape, lies.body)

    def draw(axes: Axes, touch: int, belief: PoseBelief) -> None:
        axes.imshow(coloured(bodies.lying(belief), 1.0), origin="lower")
        axes.contour(outline, levels=[0.5], colors="tab:red", linewidths=1.0)
        off, found = belief.error(lies.body.orientation), belief.credible()
        ways = "" if len(found.orientations) == 1 else f" of {len(found.orientations)} ways"
        axes.set_title(f"touch {touch}\n{off:.0f}° off, within {found.radius:.0f}°{ways}", fontsize=7)
        axes.set_axis_off()

    parts = [partial(draw, touch=touch, belief=belief) for touch, belief in enumerate(lies.after, 1)]
    return Picture(f"lies{number}", f"Object {number}: {lies.after[-1]}.", parts, size=(1.8, 1.7))


def identify(
    bodies: Bodies,
    *,
    body: str | None = None,
    num_objects: int = 20,
    threshold: float = 0.95,
    max_touches: int = 16,
    decider: str | Decider | None = None,
    unlisted: float = STRANGERS,
    prior: str | None = None,
    press: Bodies | None = None,
    world: str | None = None,
    lies: bool = False,
    within: float | None = None,
    seed: int = 0,
    scale: float | None = None,
    jobs: int | None = None,
    **setting: Any,
) -> Identified:
    """Press simulated objects of some bodies, and name each by touch.

    Args:
        bodies: a folder of mesh files, mesh files, or solids by label.
        body: label of the objects' body; random bodies by default.
        num_objects: number of objects.
        threshold: probability at which to stop touching an object.
        max_touches: of an object.
        decider: its name, as of :func:`activetouch.compare`, or a decider; by default shape_information_gain, or
            pose_information_gain with ``within``. One that stops by the probability of the
            target chooses the poses alone; any other one is asked about the most probable body, and stops, too.
        unlisted: prior probability that an object is none of the bodies, which is one more answer.
        prior: as of :func:`activetouch.compare`.
        press: bodies of which the objects are, instead, such as scans: as ``bodies``. One without a body of its label
            is none of these.
        world: a condition of :func:`activetouch.robustness` that the sensor is in, which the belief does not know.
        lies: whether to say how each object that is rightly named lies, too, which takes a second or two.
        within: angle [deg] within which it must be known how a named object lies, with probability 0.9, before its
            touches end; it says how each lies, too.
        seed: of objects and touches.
        scale: metres per unit of mesh files without a scale of their own.
        jobs: number of processes; as many as processors by default.
        setting: as of :func:`activetouch.find`.

    Raises:
        UnknownName: there is no such body or condition.
        InvalidArgument: no mesh can be read, the sensor has no reader of any object, or the condition does not apply.
    """
    if within is not None:
        require_rule("within", within, _ANGLES)
        lies = True
    decider = decider or ("shape_information_gain" if within is None else "pose_information_gain")
    solids, left_out = solids_of(bodies, scale)
    objects = solids if press is None else solids_of(press, scale)[0]
    chosen = None if body is None else body_index(objects, body)
    own = setting.pop("sensor", "gel")
    sensor = replace(sensor_of(solids, own, plan_of(**setting), jobs), with_logits=_reads_logits(decider))
    pressed = _Pressed(sensor, _in_world(sensor.scene if press is None else scene_of(objects, own), world))
    truths = np.random.default_rng([seed, 5]).permutation(np.arange(num_objects) % len(objects)).tolist()
    truths = truths if chosen is None else [chosen] * num_objects
    player = make_decider(decider, sensor.model.outcome_table(), sensor.model) if isinstance(decider, str) else decider
    shared = Shared((pressed, player))
    opinion = None if prior is None else read_opinion(prior, sensor.shape_labels, 1)
    tasks = [
        partial(_name_one, shared, truth, (seed, number), max_touches, threshold, unlisted, opinion, lies, within)
        for number, truth in enumerate(truths)
    ]
    done = list(run_tasks(tasks, jobs, "objects"))
    namings, lying = [one for one, _ in done], [each for _, each in done] if lies else []
    if press is None:
        return Identified(sensor, near_twins(model_of(sensor)), namings, left_out=left_out, lying=lying)
    names, places = [list(objects)[truth] for truth in truths], {label: row for row, label in enumerate(solids)}
    namings = [replace(one, truth=places.get(name, UNLISTED)) for one, name in zip(namings, names, strict=True)]
    return Identified(sensor, near_twins(model_of(sensor)), namings, left_out=left_out, pressed=names, lying=lying)


def _in_world(scene: Scene, condition: str | None) -> Scene:
    """A scene under a condition."""
    if condition is None:
        return scene
    scenes, left_out = applicable_conditions(scene, [condition])
    if condition in left_out:
        raise InvalidArgument(f"the condition {condition!r} does not apply: {left_out[condition]}")
    return scenes[condition]


def _reads_logits(decider: str | Decider) -> bool:
    """Whether a decider may look at single touches: all but those that go by posterior and evidence."""
    return not (isinstance(decider, str) and decider.partition("(")[0] in _BY_EVIDENCE)


@dataclass(frozen=True, eq=False)
class _Pressed:
    """Presses objects of a scene that may differ from that of the sensor, which reads the images."""

    sensor: TactileSensor
    scene: Scene

    def read(self, images: NDArray[np.uint8], poses: Sequence[Name]) -> list[Touch]:
        return self.sensor.read(images, poses)


def _name_one(
    shared: Shared[tuple[_Pressed, Decider]],
    truth: int,
    seed: tuple[int, ...],
    max_touches: int,
    threshold: float,
    unlisted: float,
    opinion: Floats | None,
    lies: bool,
    within: float | None,
) -> tuple[Identification, Lying | None]:
    pressed, player = shared.value
    sensor, world = pressed.sensor, TouchWorld.sample(pressed, [truth], np.random.default_rng([*seed, 0]))
    beliefs: dict[tuple[str, int], PoseBelief] = {}  # by the label and the number of touches of this object

    def lies_as(label: str, touches: Sequence[Touch]) -> PoseBelief:
        if (key := (label, len(touches))) not in beliefs:
            images = np.stack([touch.image for touch in touches if touch.image is not None])
            beliefs[key] = sensor.pose(label, images, [touch.pose for touch in touches])
        return beliefs[key]

    def is_narrow(named: int, touches: Sequence[Touch]) -> bool:
        return lies_as(sensor.shape_labels[named], touches).credible().radius <= (within or 0.0)

    until = None if within is None else is_narrow
    rules = seed, threshold, max_touches, unlisted, opinion, until
    found = name_first(world, player, sensor.model, sensor.pose_labels, *rules)
    truth_label = pressed.scene.shape_labels[truth]
    if not (lies and found.named >= 0 and sensor.shape_labels[found.named] == truth_label):
        return found, None
    first = 1 if seed[-1] < _PICTURED else len(found.touches)
    after = tuple(lies_as(truth_label, found.touches[:number]) for number in range(first, len(found.touches) + 1))
    return found, Lying(after, world.current)


@dataclass(frozen=True, kw_only=True)
class Identify(MeshOptions):
    """Name the bodies of a folder of meshes by touch, in simulation: nothing is trained.

    The first run makes views of each body, which are kept; the next starts at once.

    For example:

        activetouch identify scans
        activetouch identify scans --body mug --objects 5 --out runs/mug
        activetouch identify scans --scale 0.001 --decider value_of_information
        activetouch identify drawings --press scans --unlisted 0.3
        activetouch identify scans --world "noise × 3"
        activetouch identify scans --lies
        activetouch identify scans --within 5
    """

    body: str | None = None
    """Label of the body that is pressed; random ones by default."""
    objects: Count = 20
    """Number of objects to name."""
    press: Path | None = None
    """Folder of the meshes of which the objects are, instead, such as scans; one that has no file of its name in the
    first folder is none of these."""
    world: str | None = None
    """Condition of robustness that the sensor is in, which the belief does not know, such as "noise × 3"."""
    max_touches: Count = 16
    """Touches of an object."""
    lies: bool = False
    """Say how each object that is rightly named lies, too."""
    unlisted: Probability = STRANGERS
    """Prior probability that an object is none of the bodies; 0 for a closed world, which is faster."""
    within: Annotated[float, _ANGLES] | None = None
    """Angle [deg] within which it must be known how an object lies before its touches end; says how each lies."""
    check: CountOrNone = 8
    """Presses of a probable body, in simulation, in each touched pose, before it is named; 0 for no check."""
    tolerance: Annotated[float | None, Within(0.0, 0.1, unit=" m")] = None
    """By how much the surface of an object may differ from its file [m]; a hundredth of the radius by default."""
    decider: str | None = None
    """Decider, as of compare; one that stops by the target's probability chooses the sides alone. By default
    shape_information_gain, or pose_information_gain with --within."""
    out: Path = Path("runs/identify")
    """Folder for the report."""

    def _expected(self, number: int) -> tuple[float, float]:
        each = min(self.max_touches, 1.0 + np.log(number))  # 1.3 of 4 bodies, 2.5 of 12, 4 of 100, 8 of 999
        return self.objects * each, min(self.objects, _PICTURED) * each

    @ends_claims
    def run(self) -> None:
        """Read, make views, name, report."""
        solids, left_out = self.read(None if self.press else self.body)
        found = identify(
            solids,
            body=self.body,
            num_objects=self.objects,
            max_touches=self.max_touches,
            press=self.press,
            world=self.world,
            check=self.check,
            tolerance=self.tolerance,
            lies=self.lies,
            within=self.within,
            decider=self.decider,
            **self.common,
        )
        self.report(replace(found, left_out=left_out))
