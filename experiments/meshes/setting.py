"""Many bodies in front of a sensor that reads any object: embedded, fitted, ready to be touched."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import scipy  # whose parts load at first use
from scipy.special import logsumexp

from activetouch.distributions import Uniform
from activetouch.errors import MeshWarning
from activetouch.mesh_source import MeshSource, read_files
from activetouch.named_scenes import SCENES
from activetouch.perception.cached_arrays import announced, cached, require_name
from activetouch.perception.contacts.close_look import CloseContacts, CloseLook
from activetouch.perception.contacts.hypotheses import ContactHypotheses
from activetouch.perception.contacts.views import BodySet, ViewPlan, are_embedded, embedded_views
from activetouch.perception.imaging import Floats32
from activetouch.perception.reader import TactileReader
from activetouch.rotation_cells import centres, nested
from activetouch.scene import Scene, WorldObject
from activetouch.scene_description import SURROUNDINGS, scene_fields
from activetouch.sensor_files import ANY_OBJECT_FILE, MODELS
from activetouch.solids.mesh import Mesh
from activetouch.solids.solid import Shape
from belief.coarse_to_fine import CoarseToFine, Effort
from belief.errors import InvalidArgument
from belief.files import from_field, require_regular_file, sealed_json, to_field, unsealed_json, write_text
from belief.validation import Floats
from experiments.parallel import run_tasks
from planners.body_information import body_information, sampled_leaves

SIZES = (0.97, 1.03)
"""Smallest and largest size of an object, relative to its mesh."""
_PRESSED, _TOUCHES = 48, 12  # objects to which a set is fitted, and touches of each
_REFERENCES = 128
_HYPOTHESES = 256  # for a decision
_AVERAGED = 64  # bodies that the constants of references are averaged over
_CHECKPOINTS = (1, 2, 4, 8, 12)
_RELEVANT, _LEFT = 1e-5, 1e-4  # posterior of a cell that counts for the fit, and of bodies without one
_MANY = 200  # bodies above which the coarsest cells are used for all
# Seconds of one core, roughly, by time.process_time, of 4 to 100 icospheres of 320 to 82 000 triangles with waves:
_READING, _TRIANGLE = 0.15, 1.7e-5  # of a megabyte of a file; of the views of a body, for each of its triangles
_VIEW = 0.0004  # of a body of few triangles
_TOUCH, _SEARCHED = 0.0045, 0.04  # of a touch of the fit, and of a search, beside those for each body
_REPORT = 0.22  # of a touch in the report
_SHOWN, _PROBABLE = 5, 0.01  # bodies that are still possible: at most, and their least probability

Possible: TypeAlias = tuple[tuple[int, float, Floats], ...]
"""Probable bodies: index, probability, and how each lies most probably, a unit quaternion ``wxyz``."""
Fit: TypeAlias = tuple[float, float, Floats32]
"""Scale and drift of a set of bodies, and references: embeddings of touches in half precision, ``(M, D)``."""


@dataclass(frozen=True, eq=False)
class MeshSetting:
    """K bodies, the sensor that touches them, and what a belief about them needs.

    ``references (M, D)`` are embeddings of touches that stand for all; their log likelihoods are too large by
    ``constants (M,)``. ``look`` says how closely bodies that are still possible are looked at.
    """

    scene: Scene
    reader: TactileReader
    bodies: BodySet
    references: Floats32
    constants: Floats32
    look: CloseLook = field(default_factory=CloseLook)

    @classmethod
    def of(
        cls,
        solids: Mapping[str, Shape],
        *,
        sensor: str | Path = "gel",
        plan: ViewPlan | None = None,
        levels: Sequence[int] | None = None,
        effort: Effort | None = None,
        look: CloseLook | None = None,
        pressed: int = _PRESSED,
        jobs: int | None = None,
    ) -> MeshSetting:
        """Embed bodies that are not in the cache yet, and fit temperature and drift to simulated touches.

        Args:
            sensor: a shipped sensor with a reader of any object, or a folder of one.
            levels: of cells, coarse first; chosen by the number of bodies by default.
            look: how closely the bodies that are still possible are looked at.
            pressed: number of simulated objects that temperature and drift are fitted to.
            jobs: number of processes; as many as processors by default.
        """
        if not solids:
            raise InvalidArgument("there are no bodies: give at least one mesh")
        scene, reader, plan = scene_of(solids, sensor), reader_of(sensor), plan or ViewPlan()
        embed_all(reader.hypotheses, scene, solids, plan, jobs)
        chosen = tuple(levels) if levels is not None else (0, 1, 2) if len(solids) > _MANY else (1, 2)
        bodies = BodySet.of(reader.hypotheses, scene, solids, plan, levels=chosen, effort=effort or Effort())
        none = np.zeros((1, bodies.table.shape[2]), np.float32), np.zeros(1, np.float32)
        return _fitted(cls(scene, reader, bodies, *none, look or CloseLook()), pressed)

    def touch(self, obj: WorldObject, pose: int, rng: np.random.Generator) -> Floats32:
        """The embedding of a simulated touch, ``(D,)``."""
        return self.reader.run(self.scene.press(obj, pose, rng).image[None])[0][0]

    def update(self, belief: CoarseToFine, pose: int, embedding: Floats32) -> CoarseToFine:
        """The belief after a touch."""
        return belief.update(self.bodies.felt(pose, embedding))

    def touched(self, belief: CoarseToFine, obj: WorldObject, pose: int, rng: np.random.Generator) -> CoarseToFine:
        """The belief after a simulated touch and a closer look."""
        return self.looked(self.update(belief, pose, self.touch(obj, pose, rng)))

    def next_pose(self, belief: CoarseToFine, used: Sequence[int], target: int | None = None) -> int:
        """The pose that is expected to tell most of those that were not used."""
        gains = self.information(belief, target)
        gains[list(used)] = -np.inf
        return int(gains.argmax())

    def looked(self, belief: CoarseToFine) -> CoarseToFine:
        """The belief after a closer look at the bodies that are still possible, where that may decide anything."""
        return self._close.checked(belief)

    @cached_property
    def _close(self) -> CloseContacts:
        hypotheses = self.reader.hypotheses
        assert isinstance(hypotheses, ContactHypotheses), "reader_of gives no other"
        return CloseContacts.of(hypotheses, self.scene, self.bodies, self.look)

    def information(self, belief: CoarseToFine, target: int | None = None) -> Floats:
        """Expected information of a touch in each pose about the body, or whether it is the target, ``(P,)`` [nats]."""
        leaves, weights = sampled_leaves(belief, _HYPOTHESES)
        ratios = self.bodies.log_ratios(leaves.level, leaves.body, leaves.cell, self.references)
        ratios -= self.constants
        ratios *= np.float32(self.bodies.scale / (1.0 + self.bodies.drift * len(belief.touches)))
        return body_information(ratios, weights, leaves.body if target is None else (leaves.body == target).astype(int))

    def possible(self, belief: CoarseToFine) -> Possible:
        """The most probable bodies, at most five."""
        probs, leaves = belief.probs, belief.leaves(_PROBABLE / 100)
        found = []
        for body in np.argsort(-probs)[:_SHOWN].tolist():
            mine = np.flatnonzero(leaves.body == body)
            if probs[body] < _PROBABLE or not len(mine):
                break
            best = mine[leaves.log_weight[mine].argmax()]
            rests = centres(self.bodies.levels[leaves.level[best]])
            found.append((body, float(probs[body]), rests[leaves.cell[best]]))
        return tuple(found)


def sources_of(folder: Path | Sequence[Path | str]) -> Sequence[Path | str]:
    """A folder ``path[@scale]``, which must be there, or files one by one, as :func:`activetouch.read_meshes` takes."""
    if not isinstance(folder, Path | str):
        return folder
    if not (root := MeshSource.parse(folder).path).is_dir():
        raise FileNotFoundError(f"there is no folder {root}; relative paths start from {Path.cwd()}")
    return [folder]


def read_folder(folder: Path | Sequence[Path | str], scale: float | None = None) -> tuple[dict[str, Mesh], list[str]]:
    """The meshes of :func:`sources_of`, and a line on each file that is left out."""
    return read_files(*sources_of(folder), scale=scale, is_lenient=True)


def scene_of(solids: Mapping[str, Shape], sensor: str | Path = "gel") -> Scene:
    """The scene of a sensor with other bodies, pressed from 26 directions, whose sizes vary by 3 %."""
    own = SCENES[str(sensor)].scene if str(sensor) in SCENES else SCENES["gel"].scene
    varied = replace(own.variation, size=Uniform(*SIZES))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MeshWarning)  # the caller is told of twins in another way
        return replace(own, shapes=dict(solids), poses="directions26", variation=varied)


def reader_of(sensor: str | Path) -> Any:
    """The reader of any object of a sensor; InvalidArgument if it has none."""
    folder = MODELS / str(sensor) if (MODELS / str(sensor)).is_dir() else Path(sensor)
    for name in (ANY_OBJECT_FILE, "reader.safetensors"):
        if (folder / name).is_file():
            reader = TactileReader.load(folder / name)
            if isinstance(reader.hypotheses, ContactHypotheses):
                return reader
    known = ", ".join(sorted(path.parent.name for path in MODELS.glob(f"*/{ANY_OBJECT_FILE}")))
    raise InvalidArgument(
        f"the sensor {sensor} has no reader of any object; of those that ship, these have one: {known}"
    )


def reading_words(sources: Mapping[str, MeshSource]) -> str:
    """How long it takes to read mesh files, before they are read."""
    size = sum(source.path.stat().st_size for source in sources.values() if source.path.exists()) / 1e6
    return f"reading {len(sources)} files of {size:.1f} MB: about {_in_words(size * _READING)}"


def cost_words(solids: Mapping[str, Shape], sensor: str | Path, touches: float, pictured: float, jobs: int) -> str:
    """Words on the cost of bodies that are not in the cache, and of the touches, of which the report shows some."""
    reader, scene, plan, number = reader_of(sensor), scene_of(solids, sensor), ViewPlan(), len(solids)
    missing = [one for one in solids.values() if not are_embedded(reader.hypotheses, scene, one, plan)]
    triangles = float(np.mean([_triangles(one) for one in solids.values()]))
    views = sum(map(view_seconds, missing)) / jobs
    fit = _PRESSED * _TOUCHES * (_TOUCH + 2.5e-4 * min(number, _MANY) + 2.5e-7 * triangles)
    play = touches * (_SEARCHED + 2.2e-3 * min(number, _MANY) + 5e-6 * triangles) / jobs
    report, size = 1.0 + _REPORT * pictured, number * len(plan.orientations) * reader.card.embedding / 1e6
    return (
        f"{number} bodies: about {_in_words(views + fit + play + report)}, of which {_in_words(views)} for "
        f"{len(plan.orientations)} views of each of {len(missing)} new bodies and {_in_words(fit)} for the fit of the "
        f"set, once, {_in_words(play)} for about {touches:.0f} touches and {_in_words(report)} for the report; "
        f"{2 * size:.0f} MB on disk, {4 * size:.0f} MB in memory"
    )


def view_seconds(solid: Shape) -> float:
    """Time of one core for the views of a body."""
    return len(ViewPlan().orientations) * _VIEW + _TRIANGLE * _triangles(solid)


def _triangles(solid: Shape) -> int:
    return len(solid.faces) if isinstance(solid, Mesh) else 0


def _in_words(seconds: float) -> str:
    return f"{seconds / 60:.0f} min" if seconds > 100 else f"{seconds:.0f} s"


def embed_all(
    reader: ContactHypotheses, scene: Scene, solids: Mapping[str, Shape], plan: ViewPlan, jobs: int | None = None
) -> None:
    """Make the embeddings that are not in the cache, with a progress bar."""
    plain = replace(scene, shapes=SCENES["gel"].scene.shapes)  # a task needs the state of the sensor, not all bodies
    missing = [solid for solid in solids.values() if not are_embedded(reader, scene, solid, plan)]
    if missing:
        tasks = [partial(_embed, reader, plain, solid, plan) for solid in missing]
        costs = list(map(view_seconds, missing))
        list(run_tasks(tasks, 1 if len(tasks) == 1 else jobs, f"views of {len(tasks)} bodies", costs))


def _embed(reader: ContactHypotheses, scene: Scene, solid: Shape, plan: ViewPlan) -> None:
    embedded_views(reader, scene, solid, plan)  # which stay in the cache


def _fitted(setting: MeshSetting, pressed: int) -> MeshSetting:
    """The setting with temperature, drift and references from simulated touches, or from the cache."""
    bodies = setting.bodies
    fields = {name: value for name, value in scene_fields(setting.scene).items() if name not in SURROUNDINGS}
    plan = [bodies.plan.directions, bodies.plan.rolls, bodies.plan.width, pressed, *bodies.levels]
    key = {"reader": setting.reader.digest, "scene": fields, "plan": plan, "version": version("activetouch")}
    key["effort"] = asdict(bodies.effort)
    with announced(f"fitting the bodies to {pressed} simulated objects, which is kept in the cache"):
        scale, drift, references = cached(key, ".json", partial(_fit, setting, pressed), _read_fit, _write_fit)
    fitted = replace(bodies, scale=scale, drift=drift)
    return replace(setting, bodies=fitted, references=references, constants=_constants(fitted, references))


def _read_fit(path: Path) -> Fit:
    fields = unsealed_json(require_regular_file(path).read_text(encoding="utf-8"))
    require_name(path, fields.get("name"))
    scale, drift, references = fields["scale"], fields["drift"], from_field(fields["references"], "float16")
    if not (0.0 < scale < np.inf and 0.0 <= drift < np.inf and references.size and np.isfinite(references).all()):
        raise ValueError(f"{path} has numbers that no fit gives")
    return scale, drift, references.astype(np.float32)


def _write_fit(path: Path, fit: Fit) -> None:
    scale, drift, references = fit
    fields = {"scale": scale, "drift": drift, "references": to_field(references.astype(float), "float16")}
    write_text(path, sealed_json({**fields, "name": path.stem}, indent=None))


def _constants(bodies: BodySet, references: Floats32) -> Floats32:
    """Log mean likelihood ratio of each reference over bodies and views, ``(M,)``: a constant of each image."""
    some = np.linspace(0, len(bodies.table) - 1, min(len(bodies.table), _AVERAGED)).astype(int)
    parts = [
        logsumexp(np.float32(bodies.scale) * (bodies.table[body].astype(np.float32) @ references.T), axis=0)
        for body in some.tolist()
    ]
    number = len(some) * bodies.table.shape[1]
    return np.asarray((logsumexp(parts, axis=0) - np.log(number)) / bodies.scale, np.float32)


def _fit(setting: MeshSetting, pressed: int) -> Fit:
    """Temperature and drift with the lowest NLL of the body after 1 to 12 touches in random directions."""
    rng, bodies, logs = np.random.default_rng(0xF17), setting.bodies, nested(setting.bodies.levels).log_shares
    number = len(bodies.labels)
    truths = rng.permutation(np.arange(max(number, pressed)) % number)[:pressed]
    felt, cases = [], []
    for truth in truths.tolist():
        obj, belief = setting.scene.sample_object(truth, rng), bodies.start()
        poses = rng.permutation(len(bodies.poses))[:_TOUCHES].tolist()
        images = np.stack([setting.scene.press(obj, pose, rng).image for pose in poses])
        felt.append(setting.reader.run(images)[0])
        for count, (pose, embedding) in enumerate(zip(poses, felt[-1], strict=True), 1):
            belief = setting.update(belief, pose, embedding)
            if count in _CHECKPOINTS:
                leaves = belief.leaves(_RELEVANT)
                prior = np.zeros(len(leaves.body))
                for level, shares in enumerate(logs):
                    prior += np.where(leaves.level == level, shares[np.minimum(leaves.cell, len(shares) - 1)], 0.0)
                sums = (leaves.log_weight - prior) * (1.0 + bodies.drift * (count - 1)) / bodies.scale
                cases.append((np.full(len(prior), count), leaves.body == truth, prior, sums))
    lengths = np.array([len(case[0]) for case in cases])
    starts = np.cumsum(lengths) - lengths
    touches, is_true, log_prior, likelihood = (np.concatenate(part) for part in zip(*cases, strict=True))
    simplex = np.array([[0.0, 0.05], [0.3, 0.05], [0.0, 0.15]])
    bounds, options = [(-1.5, 1.5), (0.0, 0.5)], {"xatol": 0.01, "fatol": 1e-4, "initial_simplex": simplex}
    settings: Any = {"method": "Nelder-Mead", "bounds": bounds, "options": options}

    def loss(parameters: Floats) -> float:
        """Mean negative log posterior of the true body; a little is left for the bodies without a cell."""
        log_temperature, drift = parameters.tolist()
        posterior = log_prior + likelihood / (np.exp(log_temperature) * (1.0 + drift * (touches - 1)))
        weights = np.exp(posterior - np.maximum.reduceat(posterior, starts).repeat(lengths))
        right = np.add.reduceat(weights * is_true, starts) / np.add.reduceat(weights, starts)
        return -float(np.log((1.0 - _LEFT) * right + _LEFT).mean())

    best = scipy.optimize.minimize(loss, simplex[0], **settings).x
    every = np.concatenate(felt)
    some = every[rng.permutation(len(every))[:_REFERENCES]]
    return float(np.exp(-best[0])), float(best[1]), some.astype(np.float16).astype(np.float32)
