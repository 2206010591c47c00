"""Pads by the places of their taxels: the square is one, outlines end the layer, curved tips meet a body later."""

from dataclasses import replace

import numpy as np
import pytest

from activetouch import SCENES, PadDescription, Quasistatic, Response, Taxels
from activetouch.poses import Placement
from activetouch.pressing.contact import Pad, elastic_contact, surface_gap
from activetouch.rendering import PressureRenderer, check_renderer
from activetouch.rendering.response import TaxelRenderer
from activetouch.solids.primitives import Sphere
from belief.errors import InvalidArgument

BALL = Placement(Sphere(0.010), 1.0, np.array([1.0, 0.0, 0.0, 0.0]))
UP = [1.0, 0.0, 0.0]


def hexagonal(number=7, pitch=0.003):
    rows, columns = np.indices((number, number)).reshape(2, -1)
    places = pitch * np.stack([columns + 0.5 * (rows % 2), rows * np.sqrt(0.75)], axis=1)
    return Taxels(np.insert(places - places.mean(axis=0), 0, 0.0, axis=1), np.tile(UP, (number**2, 1)), pitch**2)


def tip(radius=0.012):
    angles, z = np.meshgrid(np.deg2rad(np.linspace(-50, 50, 9)), np.linspace(-0.006, 0.006, 5))
    normals = np.stack([np.cos(angles), np.sin(angles), 0 * z], axis=-1).reshape(-1, 3)
    return Taxels(radius * (normals - UP) + np.outer(z.ravel(), [0, 0, 1.0]), normals, 4e-6)


LAYOUTS = {
    "SDH-2": Taxels.grid(14, 6, 0.0034),
    "outline": Taxels.grid(14, 6, 0.0034, ["..##..", *[".####."], *["######"] * 12]),
    "wide": Taxels.grid(4, 4, 0.0047),
    "hexagonal": hexagonal(),
    "tip": tip(),
    "fine": Taxels.grid(64, 64, 0.0005),
    "one": Taxels.grid(1, 1, 0.01),
}


def test_the_square_pad_is_one():
    scene = replace(SCENES["coarse"].scene, press_model=Quasistatic(), renderer=PressureRenderer(), faults=())
    square = scene.pad
    layout = Taxels.grid(square.num_taxels, square.num_taxels, 2 * square.half_width / square.num_taxels)
    pad = Pad.described(layout, square.stiffness, square.max_depth)
    assert (square.taxel_centres == layout.centres.T).all()
    described = replace(scene, pad=pad, renderer=TaxelRenderer(square.stiffness * square.max_depth))
    for shape in range(4):
        first, second = (one.press(one.sample_object(shape, rng), 0, rng).ideal for one, rng in pairs(scene, described))
        assert (first == second).all()
        assert first.max() > 0


def pairs(*scenes):
    return [(scene, np.random.default_rng(7)) for scene in scenes]


@pytest.mark.parametrize("name", LAYOUTS)
def test_every_taxel_is_shown(name):
    taxels = LAYOUTS[name]
    values = np.arange(1.0, len(taxels) + 1)
    image = taxels.shown(values)
    assert set(image.ravel()) - {0.0} == set(values)
    assert np.allclose(taxels.mean(image), values)
    assert np.allclose(taxels.mean(np.ones((Pad.described(taxels).num_taxels,) * 2)), 1.0)
    assert check_renderer(TaxelRenderer(), Pad.described(taxels)) == (taxels.raster, taxels.raster)


@pytest.mark.parametrize("name", ["SDH-2", "hexagonal", "fine"])
def test_the_layer_carries_the_force(name):
    pad = Pad.described(LAYOUTS[name])
    contact = elastic_contact(pad, surface_gap(pad, BALL), 2.0)
    assert np.isclose(contact.pressure.sum() * pad.taxel_area, 2.0, rtol=1e-6)
    felt = LAYOUTS[name].mean(contact.pressure).sum() * pad.taxel_area * pad.num_taxels**2 / len(LAYOUTS[name])
    assert felt > 0.0


def test_the_layer_ends_with_the_outline():
    mask = np.ones((14, 6), bool)
    mask[5:9] = False  # a gap in the middle, wider than what the ball would press
    pad = Pad.described(Taxels.grid(14, 6, 0.0034, mask))
    gap = surface_gap(pad, BALL)
    assert not np.isfinite(gap[17:25]).any()
    far = replace(BALL, offset=np.array([0.0168, 0.0]))  # beside the six columns, and in the square
    assert not np.isfinite(surface_gap(pad, far)).any()


def test_a_curved_tip_touches_less_of_a_flat_face():
    from activetouch.solids.primitives import Box

    plate = replace(BALL, shape=Box((0.01, 0.02, 0.02)))
    flat, curved = (Pad.described(one) for one in (Taxels.grid(5, 9, 0.0026), LAYOUTS["tip"]))
    touched = [(elastic_contact(pad, surface_gap(pad, plate), 0.2).pressure > 0).mean() for pad in (flat, curved)]
    assert touched[1] < 0.5 * touched[0]
    gap = surface_gap(curved, plate)
    row = gap[len(gap) // 2]
    inside = np.isfinite(row)
    y = (np.arange(len(row)) + 0.5 - len(row) / 2) * 2 * curved.half_width / len(row)
    wanted = 0.012 - np.sqrt(0.012**2 - y[inside] ** 2)
    assert np.abs(row[inside] - wanted).max() < 4e-4  # faces of taxels of 2 mm


def test_what_is_no_layout():
    for wrong in ({"rows": 0}, {"pitch": -1.0}, {"mask": ["###"]}, {"mask": ["...", "..."]}, {"mask": 3}):
        with pytest.raises(InvalidArgument):
            Taxels.grid(**{"rows": 2, "columns": 3, "pitch": 0.003} | wrong)
    for centres, normals in (([UP, UP], [UP, UP]), ([UP], [[0.0, 1.0, 0.0]]), ([[np.nan] * 3], [UP]), ([UP], UP)):
        with pytest.raises(InvalidArgument):
            Taxels(np.array(centres), np.array(normals), 1e-6)


def test_layouts_are_equal_by_content():
    one, other = Taxels.grid(3, 4, 0.002), Taxels.grid(3, 4, 0.002)
    assert one == other
    assert hash(one) == hash(other)
    assert one != Taxels.grid(4, 3, 0.002)
    assert Pad.described(one) == Pad.described(other)


def test_a_described_pad_is_not_simulated_in_motion():
    scene = PadDescription(LAYOUTS["wide"], Response()).scene()
    with pytest.raises(InvalidArgument, match="Quasistatic"):
        replace(scene, press_model=SCENES["gel"].scene.press_model)
