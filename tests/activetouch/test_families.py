"""A shape of a scene may be a family, whose proportions are drawn for every object."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import tyro

from activetouch import SCENES, SHAPES, Quasistatic
from activetouch.distributions import Constant, Uniform, member_shares
from activetouch.poses import WorldObject
from activetouch.pressing.contact import Pad
from activetouch.scene_description import require_scene, scene_fields
from activetouch.shapes import Box, Cone, Cylinder, Family, Torus
from belief.errors import InvalidArgument, UnknownName
from experiments.command_line.arguments import Trust
from experiments.scene_choice import SceneChoice, choice_name

ROD = Cylinder(radius=0.016, half_length=0.020)
RODS = Family(ROD, half_length=Uniform(0.010, 0.040))
GEL = replace(SCENES["gel"].scene, press_model=Quasistatic(), pad=Pad(num_taxels=32))
SCENE = replace(GEL, shapes={**GEL.shapes, "cylinder": RODS})


def drawn(scene, shape, num, seed=0):
    rng = np.random.default_rng(seed)
    return [scene.sample_object(shape, rng) for _ in range(num)]


def fields_of(thing):
    return thing.shape_index, thing.scale, thing.friction, thing.stiffness, *thing.orientation


def test_members_are_drawn_in_the_range_and_fill_it(rng):
    lengths = np.array([RODS.sample(rng).half_length for _ in range(2000)])
    assert 0.010 <= lengths.min() < 0.0101
    assert 0.0399 < lengths.max() <= 0.040
    assert lengths.mean() == pytest.approx(0.025, abs=0.001)
    assert {RODS.sample(rng).radius for _ in range(5)} == {0.016}


def test_an_object_of_a_plain_shape_is_drawn_as_in_a_scene_without_families():
    def stream(scene):
        rng = np.random.default_rng(3)
        thing = scene.sample_object("cone", rng)
        return fields_of(thing), rng.random(), thing.member

    assert stream(SCENE) == stream(GEL)
    assert stream(GEL)[2] is None


def test_an_object_of_a_family_has_size_and_orientation_of_one_without_and_keeps_its_member():
    one, [plain] = drawn(SCENE, "cylinder", 1)[0], drawn(GEL, "cylinder", 1)
    assert fields_of(one) == fields_of(plain)
    rng = np.random.default_rng(1)
    solids = {SCENE.place(one, pose, rng).shape for pose in SCENE.pose_labels}
    assert solids == {one.member}
    assert len({thing.member for thing in drawn(SCENE, "cylinder", 20)}) == 20


@pytest.mark.parametrize(
    "press", [Quasistatic(), pytest.param(SCENES["gel"].scene.press_model, marks=pytest.mark.mujoco)]
)
def test_a_press_of_a_member_is_that_of_its_solid(press):
    scene = replace(SCENE, press_model=press)
    for thing in drawn(scene, "cylinder", 3):
        alone = replace(scene, shapes={**GEL.shapes, "cylinder": thing.member})
        same = WorldObject(thing.shape_index, thing.scale, thing.orientation)
        images = [s.press(t, "y90", np.random.default_rng(5)).image for s, t in ((scene, thing), (alone, same))]
        np.testing.assert_array_equal(*images)


@pytest.mark.parametrize("num", [1, 5, 64, 1000, 1024])
def test_hypotheses_share_at_most_64_members(num):
    shares = member_shares(num)
    solids, numbers = SCENE.bodies("cylinder", shares)
    assert len(solids) == min(num, 64)
    assert numbers.shape == (num,)
    counts = np.bincount(numbers, minlength=len(solids))
    assert counts.max() - counts.min() <= 1
    assert counts.min() >= 1
    some, of_some = SCENE.bodies("cylinder", shares[1::3])  # a part, as of the hypotheses that one pose has
    assert [some[k] for k in of_some] == [solids[k] for k in numbers[1::3]]
    plain, zeros = SCENE.bodies("cone", shares)
    assert plain == (SHAPES["cone"],)
    assert (len(zeros), zeros.any()) == (num, False)


@dataclass(frozen=True)
class _ShortOrLong:
    """A distribution of a user's own: 10 mm with probability 0.75, else 30 mm."""

    support = (0.010, 0.030)

    def sample(self, rng):
        return self.support[int(rng.random() > 0.75)]


@pytest.mark.parametrize(
    ("chance", "shares"),
    [(Constant(0.020), {0.020: 1.0}), (_ShortOrLong(), {0.010: 0.75, 0.030: 0.25})],
)
def test_a_discrete_family_has_few_bodies_each_as_frequent_as_it_is_probable(chance, shares):
    solids, numbers = Family(ROD, half_length=chance).bodies(member_shares(2048))
    found = {solid.half_length: (numbers == k).mean() for k, solid in enumerate(solids)}
    assert {length: found[length] for length in shares} == pytest.approx(shares, abs=0.03)
    assert len(solids) == len(shares)


@dataclass(frozen=True)
class _Own:
    """A solid of a user's own that accepts any number."""

    width: float

    @property
    def bounding_radius(self):
        return self.width


@dataclass
class _WithoutHash:
    width: float
    bounding_radius: float = 0.02


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Family(ROD, half_length=0.02), r"half_length must be a distribution such as .* got 0\.02"),
        (lambda: Family(ROD), r"needs a parameter, such as radius=Uniform"),
        (lambda: Family(Cone(0.018, 0.036), height=Uniform(0.01, 1e400)), "must be a finite number"),
        (lambda: Family(Torus(0.016, 0.007), tube_radius=Uniform(0.005, 0.02)), r"no solids, at tube_radius=0\.02:"),
        (lambda: Family(_Own(0.02), width=Uniform(-0.01, 0.02)), r"its bounding radius is -0\.01 m"),
        (lambda: Family(_WithoutHash(0.02), width=Uniform(0.01, 0.02)), "unhashable type"),
        (lambda: Family(Box((0.01, 0.01, 0.01)), half_extents=Uniform(0.01, 0.02)), "no field of Box.* is a number"),
        (lambda: RODS.members(0), "num must be an integer, at least 1, got 0"),
        (lambda: SCENE.bodies("cone", np.array([0.5, 1.0])), "shares must be in .0, 1., from"),
    ],
)
def test_what_is_no_family_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_fields_of_a_scene_tell_its_families_and_those_of_others_are_as_ever():
    plain, told = scene_fields(GEL), scene_fields(SCENE)
    assert json.loads(json.dumps(told)) == told == scene_fields(replace(SCENE))
    uniform = {"class": "Uniform", "low": 0.010, "high": 0.040}
    assert told == {**plain, "families": {"entries": [["cylinder.half_length", uniform]]}}


def test_a_sensor_for_the_nominal_solid_is_told_the_shift_and_one_for_another_solid_is_refused():
    plain, told = scene_fields(GEL), scene_fields(SCENE)
    assert require_scene("it", plain, told) == ("families is [cylinder.half_length], not None",)
    wider = replace(SCENE, shapes={**GEL.shapes, "cylinder": Family(ROD, half_length=Uniform(0.010, 0.050))})
    assert require_scene("it", told, scene_fields(wider)) == ("families.cylinder.half_length.high is 0.05, not 0.04",)
    thin = Family(Cylinder(0.010, 0.020), half_length=Uniform(0.010, 0.040))
    with pytest.raises(ValueError, match=r"shapes\.cylinder\.radius is 0\.01, not 0\.016"):
        require_scene("it", plain, scene_fields(replace(GEL, shapes={**GEL.shapes, "cylinder": thin})))


CHOICE = SceneChoice(family=("cylinder:half_length=0.5..2,radius=0.9..1.1", "cone:height=0.8..1.5"))


def test_the_command_line_gives_factors_on_nominal_numbers():
    scene = CHOICE.named.scene
    assert list(scene.families) == ["cylinder", "cone"]
    radius, half_length = Uniform(0.9 * 0.016, 1.1 * 0.016), Uniform(0.010, 0.040)
    assert scene.families["cylinder"] == Family(ROD, radius=radius, half_length=half_length)
    assert scene.solids == SCENES["gel"].scene.solids


def test_a_choice_with_families_survives_words_and_files():
    words = [word for text in CHOICE.family for word in ("--family", text)]
    assert tyro.cli(SceneChoice, args=words) == CHOICE
    assert SceneChoice.from_dict(json.loads(json.dumps(CHOICE.to_dict())), Trust(Path("run.json"))) == CHOICE
    assert choice_name(CHOICE) == "gel-cylinder-half_length-0.5..2-radius-0.9..1.1-cone-height-0.8..1.5"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("cylinder", "--family must be SHAPE:PARAMETER=LOW..HIGH"),
        ("cylinder:half_length=0.5..2,half_length=1..2", "told once"),
        ("cylinder:half_length=0..2", r"no solids, at half_length=0\.0"),
    ],
)
def test_a_family_that_cannot_be_read_is_refused(text, words):
    with pytest.raises(InvalidArgument, match=words):
        _ = SceneChoice(family=(text,)).named


def test_a_family_of_unknown_names_a_shape_told_twice_and_parked_objects_are_refused():
    with pytest.raises(UnknownName, match="Did you mean 'cylinder'"):
        _ = SceneChoice(family=("cilinder:half_length=0.5..2",)).named
    with pytest.raises(UnknownName, match="Did you mean 'half_length'"):
        _ = SceneChoice(family=("cylinder:half_lenght=0.5..2",)).named
    with pytest.raises(InvalidArgument, match="told once"):
        _ = SceneChoice(family=("cone:height=0.5..2", "cone:radius=0.5..2")).named
