"""Fingers that close in MuJoCo: what they must agree on with a quasistatic grasp, and how a grasp can end."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from activetouch import SCENES
from activetouch.distributions import Constant
from activetouch.errors import UnstablePress
from activetouch.hand import Hand
from activetouch.poses import Placement
from activetouch.pressing.allegro import ALLEGRO_LAW, ALLEGRO_PAD, AllegroFingers
from activetouch.pressing.closing import Closing
from activetouch.pressing.contact import Quasistatic
from activetouch.scene import Variation
from activetouch.shapes import EXTENDED_SHAPES, Mesh, Sphere
from belief.errors import InvalidArgument

pytestmark = pytest.mark.mujoco

EXACT = Variation(offset=Constant(0.0), force=Constant(2.0))
COARSE = replace(SCENES["coarse"].scene, shapes=EXTENDED_SHAPES, faults=(), variation=EXACT)
HELD = Closing(turns=False)
MENAGERIE = Path(__file__).parents[2] / "fixtures" / "menagerie"


def bracket() -> Mesh:
    """A solid in the shape of an L, which MuJoCo alone would take for its hull."""
    outline = np.array([(0, 0), (36, 0), (36, 12), (12, 12), (12, 36), (0, 36)]) * 1e-3
    corners = np.vstack([np.column_stack([outline, np.full(6, z)]) for z in (-0.012, 0.012)])
    ends = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
    sides = [(i, (i + 1) % 6, (i + 1) % 6 + 6) for i in range(6)] + [(i, (i + 1) % 6 + 6, i + 6) for i in range(6)]
    return Mesh(
        "bracket", corners, [*ends, *[tuple(i + 6 for i in reversed(end)) for end in ends], *sides], centred=True
    )


def closed(press_model, shape, pose="corner", hand="three_finger", seed=0, scene=COARSE):
    """A grasp of an object, and its scene."""
    scene = scene.with_hand(hand, press_model)
    rng = np.random.default_rng(seed)
    placement, depth = scene.place_in_palm(scene.sample_object(shape, rng), pose, rng)
    centre, met = np.array([depth, *placement.offset]), scene.hand.placements(placement, depth)
    return press_model.close(scene.pad, met, scene.hand.rotations, centre, 2.0 * scene.hand.forces), scene


@pytest.mark.parametrize(
    ("shape", "hand"), [("cone", "three_finger"), ("torus", "parallel"), ("cube", "allegro"), ("bracket", "parallel")]
)
def test_it_feels_what_a_quasistatic_grasp_feels_if_the_palm_holds_the_orientation(shape, hand):
    scene = replace(COARSE, shapes={**EXTENDED_SHAPES, "bracket": bracket()})
    (found, held), (expected, _) = (closed(law, shape, hand=hand, scene=scene) for law in (HELD, Quasistatic()))
    assert [c.force > 0.0 for c in found.contacts] == [c.force > 0.0 for c in expected.contacts]
    forces = np.array([contact.force for contact in found.contacts])
    assert np.linalg.norm(found.net_force) < 0.02 * forces.sum()
    assert forces == pytest.approx(2.0 * held.hand.forces, rel=0.11, abs=0.01)
    images = [np.hstack([held.image(contact) for contact in grasp.contacts]) for grasp in (found, expected)]
    assert np.corrcoef(images[0].ravel(), images[1].ravel())[0, 1] > 0.95
    assert found.stops.sum() == pytest.approx(expected.stops.sum(), abs=0.004)  # where, friction and order decide


def test_a_body_that_can_turn_turns_its_faces_to_opposed_pads():
    tilted = np.cos(0.1), 0.0, 0.0, np.sin(0.1)
    hand = Hand.parallel()
    placement = Placement(EXTENDED_SHAPES["cube"], 1.0, np.array(tilted), friction=0.1)
    found = Closing().close(COARSE.pad, hand.placements(placement, 0.0), hand.rotations, np.zeros(3), [2.0, 2.0])
    assert np.abs(found.met[0].orientation @ [1.0, 0.0, 0.0, 0.0]) > np.cos(0.02)  # 11° before, a slippery cube
    assert [contact.depth < 0.001 for contact in found.contacts] == [True, True]  # by faces, not by edges


def test_a_single_pad_turns_a_body_that_the_palm_holds_loosely_to_its_face():
    tilted = Placement(EXTENDED_SHAPES["cube"], 1.0, np.array([np.cos(0.15), 0.0, 0.0, np.sin(0.15)]), friction=0.1)
    palm = Hand.one_finger()

    def pressed(**law):
        found = Closing(**law).close(COARSE.pad, [tilted], palm.rotations, np.zeros(3), [2.0])
        cosine = min(found.met[0].orientation @ tilted.orientation, 1.0)
        return found.contacts[0], 2.0 * np.arccos(cosine)

    fixed, firm, loose = pressed(), pressed(grip=10.0), pressed(grip=0.002)
    assert fixed[1] < 1e-6
    assert pressed(grip=0.002, turns=False)[1] < 1e-6
    assert firm[1] < 0.002
    assert firm[0].force == pytest.approx(2.0, rel=0.11)
    images = [COARSE.image(contact).ravel() for contact, _ in (fixed, firm)]
    assert np.corrcoef(*images)[0, 1] > 0.99
    assert loose[1] == pytest.approx(0.3, abs=0.03)  # it lies flat
    assert (loose[0].pressure > 0.0).sum() > 2 * (firm[0].pressure > 0.0).sum()


def test_a_grip_is_a_torque():
    for wrong in (0.0, -1.0, np.nan, np.inf, "firm"):
        with pytest.raises(InvalidArgument, match=r"grip must be a number in \[1e-06, 1000\] N m"):
            Closing(grip=wrong)


def test_a_force_beyond_that_of_the_servos_is_refused():
    hand, placement = Hand.parallel(), Placement(EXTENDED_SHAPES["cube"], 1.0, np.array([1.0, 0.0, 0.0, 0.0]))
    with pytest.raises(InvalidArgument, match=r"target_force must be a number in \[0, 50\] N, got 200"):
        Closing().close(COARSE.pad, hand.placements(placement, 0.0), hand.rotations, np.zeros(3), [200.0, 200.0])


def test_a_finger_that_misses_a_body_that_slips_out_and_an_empty_hand_are_legal():
    ball = replace(COARSE, shapes={"ball": Sphere(0.010)})
    for aim, touching in [((0.0, 0.1), 0), ((0.026, 0.0), 0)]:  # nothing there; one finger pushes it out of the hand
        grasp, scene = closed(Closing(), "ball", "front", "parallel", scene=replace(ball, aims={"front": aim}))
        assert sum(contact.force > 0.0 for contact in grasp.contacts) == touching
        assert not np.hstack([scene.image(contact) for contact in grasp.contacts]).any()
        assert np.isnan(grasp.stops).all()


def test_a_grasp_that_does_not_settle_is_refused_and_repeated():
    hasty = replace(COARSE, variation=Variation()).with_hand("parallel", Closing(patience=0.01))
    rng = np.random.default_rng(0)
    with pytest.raises(
        UnstablePress, match=r"none of 2 presses.*the forces did not settle at .* more patience, than in Closing"
    ):
        hasty.press(hasty.sample_object("cube", rng), "front", rng, attempts=2)
    with pytest.raises(InvalidArgument, match=r"Quasistatic\(\) or Closing\(\)"):
        replace(SCENES["coarse"].scene, hand="parallel")


def test_a_scene_grasps_by_closing_and_the_same_seed_closes_the_same():
    scene = replace(SCENES["coarse"].scene, shapes=EXTENDED_SHAPES).with_hand("three_finger", Closing())
    images = []
    for _ in range(2):
        rng = np.random.default_rng(4)
        grasp = scene.press(scene.sample_object("capsule", rng), "front", rng)
        images.append(grasp.image)
    assert images[0].shape == (4, 12)
    assert np.array_equal(*images)
    assert all(contact.force > 0.0 for contact in grasp.contacts)


def test_the_allegro_hand_closes_its_four_pads_on_a_ball():
    placement = Placement(Sphere(0.018), 1.0, np.array([1.0, 0.0, 0.0, 0.0]), offset=np.array([0.001, 0.0]))
    fingers = AllegroFingers(ALLEGRO_LAW, MENAGERIE, ALLEGRO_PAD, placement, depth=0.0)
    at = fingers.faces + fingers.open_at * fingers.rotations[:, :, 0]
    assert np.ptp(at, axis=0).max() < 1e-3  # before it closes, all pads look at the middle from the same distance
    grasp = ALLEGRO_LAW.settle(fingers, placement, np.full(4, 2.0))
    forces = np.array([contact.force for contact in grasp.contacts])
    assert forces.min() > 0.5
    assert forces.mean() == pytest.approx(2.0, rel=0.11)
    assert np.linalg.norm(grasp.net_force) < 0.02 * forces.sum()
    assert all(contact.pressure.any() for contact in grasp.contacts)


def test_another_model_than_the_right_hand_is_refused(tmp_path):
    placement = Placement(Sphere(0.018), 1.0, np.array([1.0, 0.0, 0.0, 0.0]))
    with pytest.raises(FileNotFoundError, match="copy of MuJoCo Menagerie"):
        AllegroFingers(ALLEGRO_LAW, tmp_path, ALLEGRO_PAD, placement, depth=0.0)
    file = tmp_path / "wonik_allegro" / "right_hand.xml"
    file.parent.mkdir()
    file.write_text('<mujoco><worldbody><body name="palm"/></worldbody></mujoco>')
    with pytest.raises(InvalidArgument, match="no body ff_tip"):
        AllegroFingers(ALLEGRO_LAW, tmp_path, ALLEGRO_PAD, placement, depth=0.0)
