"""Presses into a pad that deforms: what a soft block does that springs do not, and where both agree."""

import pickle
import subprocess
import sys

import numpy as np
import pytest

from activetouch.errors import UnstablePress
from activetouch.placement import Placement
from activetouch.poses import POSES, random_orientation
from activetouch.pressing.contact import Contact
from activetouch.pressing.deformable import Deformable, _pressure
from activetouch.pressing.press import Quasistatic
from activetouch.pressing.setup import Setup
from activetouch.pressing.soft_rig import shared_soft_rig
from activetouch.shapes import SHAPES

pytestmark = pytest.mark.mujoco
SETUP = Setup()
PAD = SETUP.pad
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
COARSE = Deformable(nodes=13, layers=3)  # an eighth of the default's time


def sphere(**placement):
    return Placement(SHAPES["sphere"], 1.0, UPRIGHT, **placement)


def bonded_layer_force(depth: float, radius: float, press: Deformable) -> float:
    """Force of a sphere on an elastic layer bonded to a rigid base (Dimitriadis et al. 2002, eq. 13)."""
    nu = press.poisson
    a = -(1.2876 - 1.4678 * nu + 1.3442 * nu**2) / (1 - nu)
    b = (0.6387 - 1.0277 * nu + 1.5164 * nu**2) / (1 - nu)
    x = np.sqrt(radius * depth) / (2 * PAD.half_thickness) / np.pi
    thin = 1 - 2 * a * x + 4 * (a * x) ** 2 - 8 * (a**3 + 4 * np.pi**2 / 15 * b) * x**3
    thin += 16 * a * (a**3 + 3 * np.pi**2 / 5 * b) * x**4
    return 4 / 3 * press.young / (1 - nu**2) * np.sqrt(radius) * depth**1.5 * thin


def test_a_sphere_presses_a_round_dent():
    contact = COARSE.press(SETUP, sphere(), 2.0)
    dent = contact.indentation
    assert contact.force == pytest.approx(2.0, rel=0.02)
    assert np.unravel_index(dent.argmax(), dent.shape) == pytest.approx((63.5, 63.5), abs=3)
    for turned in (dent.T, dent[::-1], np.rot90(dent)):
        assert turned == pytest.approx(dent, abs=0.05 * contact.depth)


def test_a_sphere_sinks_as_far_as_contact_mechanics_and_the_elastic_foundation_say():
    press = Deformable()
    soft, springs = press.press(SETUP, sphere(), 2.0), Quasistatic().press(SETUP, sphere(), 2.0)
    # The formula's layer has no sides, so the block is a little softer.
    assert bonded_layer_force(soft.depth, 0.020, press) == pytest.approx(soft.force, rel=0.15)
    assert soft.depth == pytest.approx(springs.depth, rel=0.03)
    assert np.corrcoef(soft.indentation.ravel(), springs.indentation.ravel())[0, 1] > 0.95
    assert np.corrcoef(soft.pressure.ravel(), springs.pressure.ravel())[0, 1] > 0.95


@pytest.mark.parametrize("name", list(SHAPES))
def test_the_integral_of_the_pressure_is_the_force_in_any_orientation(name, rng):
    placement = Placement(SHAPES[name], 1.05, random_orientation(rng), np.array([0.002, -0.001]))
    contact = COARSE.press(SETUP, placement, 3.0)
    assert contact.force == pytest.approx(3.0, rel=0.02)
    assert contact.pressure.sum() * PAD.taxel_area == pytest.approx(contact.force)
    assert contact.pressure.min() >= 0.0
    assert contact.indentation.min() >= 0.0


@pytest.mark.parametrize("nodes", [2, 3, 13])
def test_an_even_pressure_is_felt_as_even_up_to_the_rim(nodes):
    part = np.ones(nodes)
    part[[0, -1]] = 0.5  # of the area of an inner node
    pressure = _pressure(PAD, np.outer(part, part), 2.0)
    np.testing.assert_allclose(pressure, 2.0 / (2 * PAD.half_width) ** 2)


def test_the_pressure_of_nodes_turns_and_moves_with_their_forces(rng):
    forces = rng.random((9, 9))
    pressure = _pressure(PAD, forces, 2.0)
    for turn in (np.rot90, np.flipud, np.transpose):
        np.testing.assert_allclose(_pressure(PAD, turn(forces), 2.0), turn(pressure))
    places = np.linspace(-PAD.half_width, PAD.half_width, 9)
    for row, column in ((2, 2), (2, 6), (4, 5)):  # a node and its neighbours are within the face
        forces = np.zeros((9, 9))
        forces[row, column] = 1.0
        blank = np.zeros((128, 128))
        contact = Contact(PAD, blank, 2.0, blank, _pressure(PAD, forces, 2.0))
        assert contact.centre_of_pressure == pytest.approx([places[column], places[row]], abs=2e-5)


def test_the_pressure_is_where_the_object_is():
    contact = COARSE.press(SETUP, sphere(offset=np.array([0.004, -0.003])), 2.0)
    assert contact.centre_of_pressure == pytest.approx([0.004, -0.003], abs=5e-4)
    row, column = np.unravel_index(contact.indentation.argmax(), contact.indentation.shape)
    assert PAD.taxel_centres[1:].reshape(2, 128, 128)[:, row, column] == pytest.approx([0.004, -0.003], abs=1e-3)


def test_the_face_dips_beside_an_edge_where_springs_stay_flat():
    edge = Placement(SHAPES["cube"], 1.0, POSES["z45"])
    soft, springs = (press.press(SETUP, edge, 2.0) for press in (COARSE, Quasistatic()))
    beside = springs.indentation == 0.0
    assert soft.indentation[beside].max() > 0.2 * soft.depth


def test_a_stiffer_object_skin_leaves_a_shallower_dent():
    soft, hard = (COARSE.press(SETUP, sphere(stiffness=stiffness), 2.0) for stiffness in (1.0, 4.0))
    assert hard.depth < 0.5 * soft.depth


def test_a_press_does_not_remember_the_one_before():
    cylinder = Placement(SHAPES["cylinder"], 0.9, POSES["z45"], friction=0.4)
    other = Placement(SHAPES["cylinder"], 1.1, POSES["y45"], stiffness=2.0)
    first = COARSE.press(SETUP, cylinder, 2.0)
    COARSE.press(SETUP, other, 2.0)
    assert np.array_equal(COARSE.press(SETUP, cylinder, 2.0).indentation, first.indentation)


def test_a_soft_rig_has_the_friction_and_the_size_of_the_placement():
    rig = shared_soft_rig(PAD, COARSE, SHAPES["sphere"])
    for friction, scale in ((0.3, 1.0), (0.8, 0.5)):
        rig.place(0.05, Placement(SHAPES["sphere"], scale, UPRIGHT, friction=friction), 1.0)
        assert (rig.model.flex_friction[:, 0] == friction).all()
        assert rig.model.geom("object").size[0] == pytest.approx(0.020 * scale)


def test_an_object_that_misses_the_pad_gives_no_force_and_a_blank_contact():
    contact = Deformable().press(SETUP, sphere(offset=np.array([0.05, 0.0])), 2.0)
    assert contact.force == contact.depth == contact.pressure.max() == 0.0


def test_without_force_there_is_no_pressure():
    contact = COARSE.press(SETUP, sphere(), 0.0)
    assert contact.force == contact.depth == contact.pressure.max() == 0.0


def test_a_press_that_does_not_settle_is_an_error_that_says_what_to_try():
    with pytest.raises(UnstablePress, match=r"Sphere.* did not settle at 2 N .* Try a smaller timestep"):
        Deformable(nodes=9, layers=2, patience=0.01).press(SETUP, sphere(), 2.0)


@pytest.mark.parametrize("settings", [{"nodes": 1}, {"layers": 1}, {"poisson": 0.5}, {"young": 0.0}, {"pause": 0.0}])
def test_settings_without_a_block_or_a_pause_are_refused(settings):
    with pytest.raises(ValueError, match="got"):
        Deformable(**settings)


def test_an_absurd_size_is_refused():
    with pytest.raises(ValueError, match="scale must be in"):
        COARSE.press(SETUP, Placement(SHAPES["sphere"], 5.0, UPRIGHT), 2.0)


def test_a_deformable_press_survives_pickling():
    copy = pickle.loads(pickle.dumps(COARSE))
    assert copy == COARSE
    assert hash(copy) == hash(COARSE)


def test_importing_the_press_does_not_load_mujoco():
    code = "import sys, activetouch.pressing.deformable; sys.exit('mujoco' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
