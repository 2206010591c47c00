"""The observation model of many bodies for a reader of any object: embedded in views, fitted, nothing is trained.

Temperature and drift are fitted to simulated touches of some of the bodies, which takes seconds, and are kept in the
cache for the set. So are the distributions by which strangers are known: of the same touches, with the body of each
object in the set, and left out of it. The pressed objects differ from their files by a tolerance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import NDArray
from scipy.special import logsumexp

from activetouch.errors import WrongScene
from activetouch.orientations import Inexact, Tumbled
from activetouch.perception.cached_arrays import announced, cached, counted, is_cached, require_name
from activetouch.perception.contacts.close_look import CloseContacts, CloseLook
from activetouch.perception.contacts.hypotheses import CONTACTS_IN_ALL, FEWEST, ContactHypotheses
from activetouch.perception.contacts.inexact import USUAL, inexact
from activetouch.perception.contacts.random_views import random_views
from activetouch.perception.contacts.views import BodySet, ViewPlan
from activetouch.perception.imaging import Floats32
from activetouch.perception.reader import TactileReader
from activetouch.perception.strangers import PROBABLE, Strangers, TwoDensities
from activetouch.rotation_cells import nested
from activetouch.scene import Scene
from activetouch.scene_description import SURROUNDINGS, scene_fields
from activetouch.solids.family import Family
from belief.coarse_to_fine import Effort
from belief.codec import array_field, array_from
from belief.constraints import Checked, CountOrNone, Within
from belief.errors import InvalidArgument
from belief.files import require_regular_file, sealed_json, unsealed_json, write_text
from belief.observation_model.nested_bodies import NestedBodyModel
from belief.problem import Touch
from belief.validation import Floats

PRESSED, TOUCHES = 48, 12
"""Objects to which a set of bodies is fitted, and touches of each."""
_REFERENCES = 128
_AVERAGED = 64  # bodies that the constants of references are averaged over
_CHECKPOINTS = (1, 2, 4, 8, 12)
_RELEVANT, _LEFT = 1e-5, 1e-4  # posterior of a cell that counts for the fit, and of bodies without one
_MANY = 200  # bodies above which the coarsest cells are used for all
_SIZES = 0.95, 1.05
_FLAT = 4 * CONTACTS_IN_ALL  # predicted contacts of all hypotheses, above which cells take the place of a table

_DENSITIES = "sums", "checks"
_CHECKED, _APART = 12, 3  # objects whose probable body is checked, twice, and touches from one check to the other


class Fit(NamedTuple):
    """What a set of bodies is fitted to.

    ``references (M, D)`` are embeddings of touches, in half precision; ``sums`` and ``checks`` are of
    :class:`activetouch.perception.strangers.Strangers`.
    """

    scale: float
    drift: float
    references: Floats32
    sums: TwoDensities | None = None
    checks: TwoDensities | None = None


@dataclass(frozen=True)
class NestedPlan(Checked):
    """How closely many bodies are examined: the accuracy against the time.

    Attributes:
        views: in which each body is embedded.
        levels: of cells, coarse first; None chooses by the number of bodies.
        effort: limits on the refinement of a belief.
        look: how closely the bodies that are still possible are looked at.
        pressed: number of simulated objects that temperature and drift are fitted to.
        check: times that a probable body is pressed in simulation in each touched pose before it is named, to see
            whether it feels like the object; 0 for no check. Only a belief that weighs strangers does it.
        tolerance: by how much the surface of an object may differ from its file [m], one standard deviation; None for
            1 % of the radius of each body, 0 for exact files.
    """

    views: ViewPlan = field(default_factory=ViewPlan)
    levels: tuple[int, ...] | None = None
    effort: Effort = field(default_factory=Effort)
    look: CloseLook = field(default_factory=CloseLook)
    pressed: int = PRESSED
    check: CountOrNone = 8
    tolerance: Annotated[float | None, Within(0.0, 0.1, unit=" m")] = None

    def levels_of(self, number: int) -> tuple[int, ...]:
        """The levels of cells for a number of bodies."""
        return self.levels or ((0, 1, 2) if number > _MANY else (1, 2))


def are_many(scene: Scene) -> bool:
    """Whether a table of all hypotheses of a scene would take too long, so that its belief is about nested cells."""
    return len(scene.shapes) * len(scene.poses) * FEWEST > _FLAT and not _not_nested(scene)


def require_nested(scene: Scene) -> None:
    """Raise WrongScene where bodies cannot be examined in nested cells of orientations."""
    if reason := _not_nested(scene):
        raise WrongScene(f"a belief about nested cells is for bodies that lie anyhow, pressed by a pad: {reason}")


def _not_nested(scene: Scene) -> str:
    if scene.hand is not None:
        return "the scene has a hand"
    if not isinstance(scene.presentation, Tumbled | Inexact):
        return f"the objects are presented by {scene.presentation!r}"
    if scene.aim_offsets.any():
        return "some poses have an aim beside the approach axis"
    if not (_SIZES[0] <= min(scene.variation.size.support) and max(scene.variation.size.support) <= _SIZES[1]):
        return f"the sizes of the objects vary by more than 5 %, as {scene.variation.size!r}"
    families = [label for label, shape in scene.shapes.items() if isinstance(shape, Family)]
    return f"the proportions of {families[0]} vary" if families else ""


def nested_model(reader: TactileReader, scene: Scene, plan: NestedPlan | None = None) -> NestedBodyModel:
    """The observation model of the bodies of a scene; bodies that are not in the cache are embedded first."""
    require_nested(scene)
    hypotheses, plan = reader.hypotheses, NestedPlan() if plan is None else plan
    if not isinstance(hypotheses, ContactHypotheses):
        raise InvalidArgument("only a reader of any object examines many bodies in nested cells of orientations")
    levels = plan.levels_of(len(scene.shapes))
    bodies = CloseContacts.of_scene(hypotheses, scene, plan.views, levels, plan.look)
    blank = np.zeros((1, bodies.table.shape[2]), np.float32), np.zeros(1, np.float32)
    strangers = Strangers(scene, reader, bodies, random_views(hypotheses, bodies.code)[0], plan.check)
    start = NestedBodyModel(scene.shape_labels, nested(levels), bodies, 1.0, 0.06, *blank, plan.effort)
    model = replace(start, strangers=strangers)
    with announced(f"measuring once, on {plan.pressed} simulated objects, how much touches of these bodies tell"):
        make = partial(_fit, reader, scene, model, strangers, plan)
        fit = cached(_key(reader, scene, plan), ".json", make, _read_fit, _write_fit)
    return replace(
        model,
        scale=fit.scale,
        drift=fit.drift,
        references=fit.references,
        constants=_constants(fit.scale, fit.references, bodies),
        strangers=replace(strangers, sums=fit.sums, checks=fit.checks),
    )


def is_fitted(reader: TactileReader, scene: Scene, plan: NestedPlan) -> bool:
    """Whether :func:`nested_model` finds its fit in the cache."""
    return is_cached(_key(reader, scene, plan), ".json")


def _key(reader: TactileReader, scene: Scene, plan: NestedPlan) -> dict[str, Any]:
    """What a fit follows from."""
    fields = {name: value for name, value in scene_fields(scene).items() if name not in SURROUNDINGS}
    return {
        "reader": reader.digest,
        "scene": fields,
        "plan": [asdict(plan.views), plan.pressed, *plan.levels_of(len(scene.shapes))],
        "strangers": ["images", asdict(plan.look), plan.check, USUAL if plan.tolerance is None else [plan.tolerance]],
        "effort": asdict(plan.effort),
        "version": version("activetouch"),
    }


def _read_fit(path: Path) -> Fit:
    fields = unsealed_json(require_regular_file(path).read_text(encoding="utf-8"))
    require_name(path, fields.get("name"))
    scale, drift, references = fields["scale"], fields["drift"], array_from(fields["references"], "float16")
    if not (0.0 < scale < np.inf and 0.0 <= drift < np.inf and references.size and np.isfinite(references).all()):
        raise ValueError(f"{path} has numbers that no fit gives")
    kinds = (fields[name] for name in _DENSITIES)
    densities = (None if kind is None else TwoDensities(*(np.array(part, float) for part in kind)) for kind in kinds)
    return Fit(scale, drift, references.astype(np.float32), *densities)


def _write_fit(path: Path, fit: Fit) -> None:
    fields = {
        "scale": fit.scale,
        "drift": fit.drift,
        "references": array_field(fit.references.astype(float), "float16"),
    }
    for name in _DENSITIES:
        both = getattr(fit, name)
        fields[name] = None if both is None else both.fields()
    write_text(path, sealed_json({**fields, "name": path.stem}, indent=None))


def _constants(scale: float, references: Floats32, bodies: BodySet) -> Floats32:
    """Log mean likelihood ratio of each reference over bodies and views, ``(M,)``: a constant of each image."""
    number = len(bodies.labels)
    some = np.linspace(0, number - 1, min(number, _AVERAGED)).astype(int)
    parts = [logsumexp(np.float32(scale) * (bodies.views_of(body) @ references.T), axis=0) for body in some.tolist()]
    number = len(some) * len(bodies.table)
    return np.asarray((logsumexp(parts, axis=0) - np.log(number)) / scale, np.float32)


def _fit(reader: TactileReader, scene: Scene, model: NestedBodyModel, strangers: Strangers, plan: NestedPlan) -> Fit:
    """Temperature and drift with the lowest NLL of the body after 1 to 12 touches in random directions."""
    rng, logs, number = np.random.default_rng(0xF17), model.cells.log_shares, len(model.shape_labels)
    truths = rng.permutation(np.arange(max(number, plan.pressed)) % number)[: plan.pressed].tolist()
    seen, felt, cases, orders = [], [], [], []
    for truth in counted(truths, "objects"):
        obj, belief = scene.sample_object(truth, rng), model.start().belief
        own = inexact(strangers.bodies.solids[truth], plan.tolerance, rng)
        poses = rng.permutation(model.num_poses)[:TOUCHES].tolist()
        images = np.stack([scene.press(replace(obj, member=own), pose, rng).image for pose in poses])
        seen.append(images)
        felt.append(reader.run(images)[0])
        orders.append(poses)
        for count, (pose, embedding) in enumerate(zip(poses, felt[-1], strict=True), 1):
            belief = belief.update(model.bodies.felt(pose, embedding))
            if count in _CHECKPOINTS:
                leaves = belief.leaves(_RELEVANT)
                prior = np.zeros(len(leaves.body))
                for level, shares in enumerate(logs):
                    prior += np.where(leaves.level == level, shares[np.minimum(leaves.cell, len(shares) - 1)], 0.0)
                sums = (leaves.log_weight - prior) * (1.0 + model.drift * (count - 1)) / model.scale
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
    fitted = replace(model, scale=float(np.exp(-best[0])), drift=float(best[1]))
    references = some.astype(np.float16).astype(np.float32)
    return Fit(fitted.scale, fitted.drift, references, *_densities(fitted, strangers, truths, orders, seen, felt))


def _densities(
    model: NestedBodyModel,
    strangers: Strangers,
    truths: Sequence[int],
    orders: Sequence[Sequence[int]],
    seen: Sequence[NDArray[np.uint8]],
    felt: Sequence[Floats32],
) -> tuple[TwoDensities | None, TwoDensities | None]:
    """Of sums and checks of :class:`Strangers`: pressed objects in the set, and with their own body left out of it."""
    if len(model.shape_labels) < 2:
        return None, None
    unseen = replace(strangers.bodies, look=replace(strangers.bodies.look, bodies=0))
    quick = replace(model, bodies=unseen)  # the sums are those of views
    sums = np.zeros((2, len(truths), TOUCHES))
    checks: tuple[list[tuple[int, float]], list[tuple[int, float]]] = ([], [])
    for row, (truth, poses) in enumerate(counted(list(zip(truths, orders, strict=True)), "objects, as strangers")):
        evidence, next_check = quick.start(), [0, 0]
        for count, (pose, image, embedding) in enumerate(zip(poses, seen[row], felt[row], strict=True), 1):
            evidence = evidence.update(Touch(pose, features=embedding.astype(float), image=image))
            logs = evidence.belief.log_evidence
            for kind, listed in enumerate((logs, np.delete(logs, truth))):
                sums[kind, row, count - 1] = strangers.fit_of(evidence, listed)
                probs = np.exp(listed - logsumexp(listed))
                body = int(probs.argmax()) + (kind == 1 and int(probs.argmax()) >= truth)
                is_due = strangers.check and row < _CHECKED and next_check[kind] <= count
                if is_due and probs.max() >= PROBABLE and (body == truth) == (kind == 0):
                    checks[kind].append((count, strangers.surprise_of(evidence, body)))
                    next_check[kind] = count + _APART if next_check[kind] == 0 else TOUCHES + 1
    along = TwoDensities.along(np.array(checks[0]), np.array(checks[1]), TOUCHES) if all(checks) else None
    return TwoDensities.of(sums[0], sums[1]), along
