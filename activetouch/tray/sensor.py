"""A sensor for objects in a tray: where they may lie, what presses meet there, and the searches that use it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from activetouch.errors import WrongScene
from activetouch.named_scenes import SCENES
from activetouch.perception.cached_arrays import announced, cached_array
from activetouch.perception.contacts.hypotheses import ContactHypotheses
from activetouch.perception.contacts.random_views import log_normalisers, random_views
from activetouch.perception.imaging import Floats32
from activetouch.perception.reader import TactileReader
from activetouch.pressing.contact import Quasistatic
from activetouch.scene import Scene
from activetouch.scene_description import described
from activetouch.sensor.session_reader import checked_image
from activetouch.sensor_files import ANY_OBJECT_FILE, MODELS
from activetouch.solids.solid import Shape
from activetouch.tray.contacts import pitch, place_table
from activetouch.tray.lookalikes import TrayLookalikes
from activetouch.tray.world import Poke, Tray, TrayWorld
from belief.errors import UnknownName
from belief.naming import Name, index_of
from belief.references import build, find
from belief.seeding import checked_key
from belief.tray import Grid, PlaceTable, TouchNoise, TrayBelief
from planners.fingerprint import fingerprint
from planners.process_agent import InTray, ProcessAgent
from planners.registry import PROCESS
from planners.tray import (
    InformationPerCost,
    PlaceOutcomes,
    Press,
    RandomPlaces,
    RasterThenIdentify,
    TrayDecider,
    TrayRules,
)
from planners.tray_session import LEAST, TrayEpisode, TraySession

if TYPE_CHECKING:
    from planners.certified import Certificate

DECIDERS: Mapping[str, Callable[..., TrayDecider]] = {
    "information_per_cost": InformationPerCost,
    "raster": RasterThenIdentify,
    "random": RandomPlaces,
}
"""Deciders of searches in a tray, by name."""
_REFERENCES = 72  # touches that stand for all
_READ_SINCE = "0.2.0"  # version whose presses and readings those of today are; tasks and certificates name it
_ASIDE = 0.025  # largest distance of these from the middle of an object [m]


@dataclass(frozen=True, eq=False)
class TraySensor:
    """A pad that comes down on a tray, the reader of its images, and what it may meet there.

    Attributes:
        scene: shapes, pad, forces, renderer and faults.
        reader: of any object.
        tray: where the objects lie.
        rules: of searches.
        noise: of touches.
        strangers: shapes that objects of a simulated tray have with the probability ``tray.unlisted``.

    >>> from activetouch import SHAPES
    >>> sensor = TraySensor.shipped("coarse", shapes={name: SHAPES[name] for name in ("sphere", "cube", "cylinder")},
    ...                             tray=Tray(size=(0.12, 0.1), num_objects=1))
    >>> sensor.shape_labels
    ('sphere', 'cube', 'cylinder')
    """

    scene: Scene
    reader: TactileReader
    tray: Tray = field(default_factory=Tray)
    rules: TrayRules = field(default_factory=TrayRules)
    noise: TouchNoise = field(default_factory=TouchNoise)
    strangers: tuple[Shape, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.reader.hypotheses, ContactHypotheses):
            raise WrongScene("objects in a tray are read by a reader of any object, as of gel, coarse and hard")

    @classmethod
    def shipped(
        cls,
        name: str = "gel",
        shapes: Mapping[str, Any] | Sequence[Path | str] | Path | None = None,
        tray: Tray | None = None,
        rules: TrayRules | None = None,
        strangers: Any = (),
    ) -> TraySensor:
        """The pad of a named scene with its reader of any object.

        Args:
            name: of the scene: gel, coarse or hard.
            shapes: that objects may have, as :func:`activetouch.mesh_source.read_objects` takes them; by default the
                twelve of the scene ``many``.
            tray: the tray.
            rules: of searches.
            strangers: other shapes, for simulated trays; as ``shapes``.

        Raises:
            UnknownName: there is no such sensor with a reader of any object.
        """
        path = MODELS / name / ANY_OBJECT_FILE
        if name not in SCENES or not path.exists():
            known = [folder.name for folder in sorted(MODELS.iterdir()) if (folder / ANY_OBJECT_FILE).exists()]
            raise UnknownName("sensor with a reader of any object", name, known)
        return cls.of(TactileReader.load(path), SCENES[name].scene, shapes, tray, rules, strangers)

    @classmethod
    def of(
        cls,
        reader: TactileReader,
        scene: Scene,
        shapes: Mapping[str, Any] | Sequence[Path | str] | Path | None = None,
        tray: Tray | None = None,
        rules: TrayRules | None = None,
        strangers: Any = (),
    ) -> TraySensor:
        """A reader of any object with the pad of a scene; see :meth:`shipped`."""
        from activetouch.mesh_source import read_objects

        shapes = SCENES["many"].scene.shapes if shapes is None else read_objects(shapes)
        others = tuple(read_objects(strangers).values()) if strangers else ()
        scene = replace(scene, shapes=shapes, press_model=Quasistatic())
        return cls(scene, reader.bound_to(scene), tray or Tray(), rules or TrayRules(), strangers=others)

    @property
    def shape_labels(self) -> tuple[str, ...]:
        """The labels of the shapes that it tells apart."""
        return self.scene.shape_labels

    @property
    def _contacts(self) -> ContactHypotheses:
        """What embeds contacts."""
        assert isinstance(self.reader.hypotheses, ContactHypotheses), "asked in __post_init__"
        return self.reader.hypotheses

    @property
    def grid(self) -> Grid:
        """The cells of the tray."""
        return Grid(self.tray.size, pitch(self._contacts))

    @cached_property
    def table(self) -> PlaceTable:
        """What presses would meet; made at first use, and kept in the cache."""
        with announced("preparing the tray: up to two minutes the first time, then kept in the cache"):
            return place_table(self._contacts, self.scene)

    @property
    def _read_with(self) -> dict[str, Any]:
        """What determines the contacts of the table, as JSON types."""
        reader = self._contacts
        bodies = {label: described(solid) for label, solid in self.scene.solids.items()}
        return {"reader": reader.digest, "code": reader.code(self.scene).round(6).tolist(), "bodies": bodies}

    @cached_property
    def outcomes(self) -> PlaceOutcomes:
        """Touches that stand for all; made at first use, and kept in the cache."""
        key = {**self._read_with, "outcomes": _REFERENCES}
        return PlaceOutcomes(self.table, cached_array(key, self._references), self.noise.scale)

    def _references(self) -> Floats32:
        images: list[NDArray[np.uint8]] = []
        rng = np.random.default_rng(0x7A4)
        alone = replace(self.tray, num_objects=1, present=1.0, push=0.0)
        while len(images) < _REFERENCES:
            world = TrayWorld.drawn(self.scene, alone, len(images) % len(self.shape_labels), rng)
            for _ in range(100):
                x, y = (world.objects[0].place[:2] + rng.uniform(-_ASIDE, _ASIDE, 2)).tolist()
                met = world.press(x, y, rng)
                if met.image is not None:
                    images.append(met.image)
                    break
        return self.reader.run(np.stack(images))[0]

    def read(self, image: ArrayLike) -> tuple[Floats32, float | None]:
        """The embedding of one image ``(D,)``, and its level, where objects of none of the shapes are weighed.

        Raises:
            InvalidArgument: it is no image of the pad.
        """
        embedding = self.reader.run(checked_image(image, self.scene.image_shape)[None])[0][0]
        if not self.tray.unlisted:
            return embedding, None
        return embedding, float(log_normalisers(self._bodies, embedding[None], self.noise.scale)[0])

    @cached_property
    def _bodies(self) -> Floats32:
        """Embeddings of random bodies, which stand for just some body."""
        return random_views(self._contacts, self._contacts.code(self.scene))[0]

    def belief(self, target: Name) -> TrayBelief:
        """The belief before the first touch."""
        index = index_of("target", self.shape_labels, target)
        tray = self.tray
        noise = replace(self.noise, push=tray.push)
        prior = tray.num_objects, tray.present
        belief = TrayBelief(self.table, tray.size, index, *prior, noise, unlisted=tray.unlisted)
        return replace(belief, lookalikes=self._lookalikes)

    @property
    def _lookalikes(self) -> TrayLookalikes | None:
        """What tells objects from those that are only like them, where objects of none of the shapes are weighed.

        Objects that touches move do not lie as one way says, and not every pad has images that can be predicted.
        """
        imaging, tray = self._contacts.imaging, self.tray
        if not tray.unlisted or tray.push or imaging.described is not None:
            return None
        return TrayLookalikes(self.scene, imaging, tray.sizes)

    def decider(self, decider: str | TrayDecider | ProcessAgent = "information_per_cost") -> TrayDecider:
        """One of :data:`DECIDERS` or ``module:attribute``, with or without settings; ``process:COMMAND``; or an object.

        Raises:
            UnknownName: there is no decider of this name.
            BadReference: a setting is unknown, or there is no such object.
        """
        if isinstance(decider, ProcessAgent) or (isinstance(decider, str) and decider.startswith(PROCESS)):
            return InTray(ProcessAgent(decider.removeprefix(PROCESS)) if isinstance(decider, str) else decider)
        if not isinstance(decider, str):
            return decider
        found, reference = find("decider of a tray", decider, DECIDERS, "activetouch.tray_deciders")
        offered = {"rules": self.rules, "outcomes": self.outcomes}
        made: TrayDecider = build(reference.name, found, reference.settings, offered, reference.is_called)
        return made

    def world(self, target: Name, seed: int | Sequence[int] = 0) -> TrayWorld:
        """The tray of the search with this target and seed, as it is before the first touch."""
        index = index_of("target", self.shape_labels, target)
        rng = np.random.default_rng([*checked_key(seed), index])
        return TrayWorld.drawn(self.scene, self.tray, index, rng, self.strangers)

    def touched(self, target: Name, seed: int | Sequence[int] = 0) -> Keyed:
        """:meth:`world`, whose presses have the chance of the search with this target and seed."""
        index = index_of("target", self.shape_labels, target)
        return Keyed(self.world(index, seed), (*checked_key(seed), index, 2))

    @cached_property
    def identity(self) -> str:
        """Digest of everything that determines readings and beliefs, the same in all versions that read alike."""
        read_with = self._read_with | {"reader": f"{self._contacts.content} {_READ_SINCE}"}
        return hashlib.sha256(json.dumps(read_with, sort_keys=True).encode()).hexdigest()

    def certified_world(self, targets: Sequence[str], decider: str) -> dict[str, Any]:
        """What a certificate of searches for these targets by this decider holds for, as JSON types."""
        known = {"rules": self.rules, "outcomes": self.outcomes}
        world = {
            "tray": asdict(self.tray) | {"strangers": [described(one) for one in self.strangers]},
            "rules": [self.rules.travel, self.rules.most_touches, self.rules.least_gain],
            "targets": [label for label in self.shape_labels if label in targets],
            "decider": decider,
            "settings or code of the decider": fingerprint(self.decider(decider), None, known),
            "sensor (SHA-256)": self.identity,
        }
        return dict(json.loads(json.dumps(world)))

    def certified(
        self,
        certificate: str | Path | Certificate,
        decider: str = "information_per_cost",
        targets: Sequence[str] = (),
    ) -> TraySensor:
        """This sensor with the stops of a certificate of a decider, for searches for some of its targets.

        Raises:
            NotCertified: the certificate was made for something else.
        """
        from planners.certified import Certificate, NotCertified

        found = Certificate.opened(certificate)
        found.require(self.certified_world(found.made_for["targets"], decider))
        if other := set(targets) - set(found.made_for["targets"]):
            raise NotCertified(f"the certificate is for other targets than {min(other)}")
        sure, absent = (max(limit, LEAST) for limit in found.thresholds)
        return replace(self, rules=replace(self.rules, sure=sure, sure_absent=absent))

    def session(
        self,
        target: Name,
        decider: str | TrayDecider = "information_per_cost",
        seed: int | Sequence[int] = 0,
        *,
        log: str | Path | None = None,
    ) -> TraySession:
        """A search in a tray whose presses somebody else makes, such as a robot.

        It asks for what :meth:`search` with the same seed would do, given the same touches. With a ``log``, all that is
        told is on disk before the next question; if the file exists, its search goes on.
        """
        belief = self.belief(target)
        key = (*checked_key(seed), belief.target, 1)
        return TraySession(belief, self.decider(decider), self.rules, key, self).begun(log)

    def search(
        self, target: Name, decider: str | TrayDecider = "information_per_cost", seed: int | Sequence[int] = 0
    ) -> TrayEpisode:
        """One search in a random tray.

        The same seed gives the same tray to every decider, and the same press the same measurement.
        """
        key = checked_key(seed)
        index = index_of("target", self.shape_labels, target)
        touched = self.touched(index, key)
        world, lay = touched.world, touched.world.lay
        session = self.session(index, decider, key)
        while (action := session.ask()) is not None:
            if isinstance(action, Press):
                session.tell_met(touched.press(*session.place()))
            else:
                session.tell()
        session.objects = world.lay  # where touches have moved them
        return replace(session.episode, seed=key, objects=lay)


@dataclass(eq=False)
class Keyed:
    """A world whose chance at a press follows from its place and from how often that was pressed."""

    world: TrayWorld
    key: tuple[int, ...]
    pressed: dict[tuple[int, int], int] = field(default_factory=dict)

    def press(self, x: float, y: float) -> Poke:
        """Come down on a place [m]."""
        place = round(x * 1e5), round(y * 1e5)
        times = self.pressed.get(place, 0)
        self.pressed[place] = times + 1
        return self.world.press(x, y, np.random.default_rng([*self.key, *place, times]))
