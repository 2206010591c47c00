"""Descriptions of pads in TOML, and what their taxels read."""

import numpy as np
import pytest

from activetouch import PadDescription, Response, Taxels, read_pad
from activetouch.distributions import Constant, Uniform
from activetouch.pad_file import BadPad, pad_from
from activetouch.pressing.contact import Pad
from activetouch.rendering.response import TaxelResponse, respond
from belief.errors import InvalidArgument

GRID = {"rows": 14, "columns": 6, "pitch_mm": 3.4}
TAXELS = Taxels.grid(14, 6, 0.0034)


def test_a_description_is_written_and_read(tmp_path):
    wanted = PadDescription(TAXELS, Response.of({"law": [0.8, 1.2]}), (1.0, 9.0), 0.003, is_relative=True, dead=(3, 80))
    wanted.save(tmp_path / "mine.toml")
    found = read_pad(tmp_path / "mine.toml")
    assert np.allclose(found.taxels.centres, TAXELS.centres, atol=1e-9)
    assert np.isclose(found.taxels.area, TAXELS.area)
    assert found.response.ranges() == wanted.response.ranges()
    assert (found.force, found.offset, found.is_relative, found.dead) == ((1.0, 9.0), 0.003, True, (3, 80))
    assert pad_from({"grid": GRID}).taxels == TAXELS


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"grid": {"rows": 14, "columns": 6}}, "pitch_mm"),
        ({"grid": GRID | {"colums": 3}}, "colums"),
        ({"grid": GRID | {"mask": ["##"]}}, "mask"),
        ({"grid": {"rows": 1, "columns": 2, "pitch_mm": 3.0, "mask": ["#X"]}}, "a mask must have .* # or ."),
        ({"grid": None}, "grid"),
        ({"taxels": {"centres_mm": [[0, 0, 0]]}}, "one of them"),
        ({"response": {"low": [1, 2]}}, "'low'"),
        ({"response": {"law": [2.0, 1.0]}}, "law"),
        ({"response": {"law": [0.01, 1.0]}}, "law"),
        ({"response": {"law": "x"}}, "law"),
        ({"press": {"force": [3.0, 1.0]}}, "force"),
        ({"press": {"depth_mm": -1}}, "max_depth"),
        ({"dead": [99]}, "dead"),
        ({"relative": 1}, "relative"),
        ({"response": {"stiffness": [0.01, 1.0]}}, "stiffness .* N/m³"),
        ({"grid": GRID | {"pitch_mm": 0.0034}}, r"pitch_mm.* \[0.03, 100\] mm, got 0.0034: is it in m\?"),
        ({"grid": GRID | {"pitch_mm": 3400}}, "pitch_mm.* is it in µm"),
        ({"press": {"force": [1500, 3000]}}, "force .* is it in mN"),
        ({"press": {"offset_mm": 0.002}}, "offset_mm.* is it in m"),
        ({"press": {"depth_mm": 3000}}, "depth_mm.* is it in µm"),
        ({"full_scale_kpa": 1e5}, "full_scale_kpa.* is it in Pa"),
        ({"full_scale_kpa": 10**400}, "full_scale must be a finite number"),
        ({"response": {"law": 10**400}}, "law"),
        ({"grid": GRID | {"rows": 1, "columns": 10_000, "pitch_mm": 90.0}}, "about all taxels .* got 450000"),
    ],
)
def test_an_error_names_the_entry(change, said):
    with pytest.raises(BadPad, match=said):
        pad_from({"grid": GRID} | change)


def test_a_list_of_taxels_in_metres_and_a_grid_in_millimetres_are_refused():
    with pytest.raises(BadPad, match=r"between neighbours in centres_mm, .* got 0.004: is it in m\?"):
        pad_from({"taxels": {"centres_mm": [[0, 0, 0], [0, 0.004, 0]], "area_mm2": 9}})
    with pytest.raises(InvalidArgument, match=r"got 4000: is it in µm\? In Python numbers are in m"):
        PadDescription(Taxels.grid(8, 8, 4.0))


def test_a_file_that_is_none(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_pad(tmp_path / "none.toml")
    for content in (b"grid = [", b"\xff\xfe", b"x = 1", b"x = " + b"[" * 9999):
        (tmp_path / "bad.toml").write_bytes(content)
        with pytest.raises(BadPad, match=r"bad\.toml"):
            read_pad(tmp_path / "bad.toml")


def test_readings_follow_the_order_of_the_response():
    pressures, rng = np.zeros(84), np.random.default_rng(0)
    pressures[40] = 0.5
    law = TaxelResponse(TAXELS, law=2.0, gain=1.2).readings(pressures, rng)
    assert np.isclose(law[40], 0.36)
    assert (np.delete(law, 40) == 0).all()
    blurred = TaxelResponse(TAXELS, blur=0.6).readings(pressures, rng)
    assert blurred[40] < 0.5
    assert np.isclose(blurred.sum(), 0.5, rtol=0.05)
    leaking = TaxelResponse(TAXELS, crosstalk=0.5).readings(pressures, rng)
    assert np.isclose(leaking[0], 0.5 * 0.5 / 84)
    cut = TaxelResponse(TAXELS, crosstalk=0.5, threshold=0.01).readings(pressures, rng)
    assert cut[0] == 0.0
    assert cut[40] > 0.5
    dead = TaxelResponse(TAXELS, dead=(40,)).readings(pressures, rng)
    assert not dead.any()
    relative = TaxelResponse(TAXELS, law=0.7, noise=0.02, is_relative=True)
    assert relative.readings(pressures, rng).max() == 1.0
    assert not relative.readings(0 * pressures, rng).any()


def test_touches_are_answered_each_by_its_own_numbers():
    response, rng = Response(noise=Constant(0.0)), np.random.default_rng(0)
    pressures, numbers = rng.uniform(size=(5, 84)), response.drawn(5, rng)
    found = respond(TAXELS, pressures, numbers, rng, is_relative=False)
    for row in range(5):
        one = {name: values[row : row + 1] for name, values in numbers.items()}
        assert np.allclose(found[row], respond(TAXELS, pressures[row : row + 1], one, rng, False)[0])


def test_ranges_are_covered():
    response = Response(law=Uniform(0.5, 1.5))
    spread, drawn = response.spread(200), response.drawn(200, np.random.default_rng(0))
    for name, (low, high) in response.ranges().items():
        for found in (spread[name], drawn[name]):
            assert low <= found.min() <= found.max() <= high
            assert np.ptp(found) > 0.9 * (high - low)
    assert np.isclose(spread["stiffness"][0], np.sqrt(1.25e7 * 1e9))


def test_an_image_of_readings():
    pad = PadDescription(TAXELS, is_relative=True, dead=(0,))
    readings = np.arange(84) * 7.0
    image = pad.image(readings)
    assert image.shape == (14, 14)
    assert image.dtype == np.uint8
    assert image.max() == 255
    for wrong in (readings[:5], -readings, readings * np.nan):
        with pytest.raises(InvalidArgument):
            pad.image(wrong)
    with pytest.raises(InvalidArgument, match="full scale"):
        PadDescription(TAXELS).image(readings)


def test_a_scene_presses_the_pad():
    pad, rng = PadDescription(TAXELS), np.random.default_rng(1)
    for share in (None, np.zeros(7), np.ones(7)):
        scene = pad.scene(share=share)
        image = scene.press(scene.sample_object(0, rng), 0, rng).image
        assert image.shape == scene.image_shape == (14, 14)
        assert image.any()


def test_readings_may_have_the_rows_of_a_grid_and_none_below_rest():
    pad, readings = PadDescription(Taxels.grid(3, 4, 0.004), is_relative=True), np.arange(24.0).reshape(2, 12)
    np.testing.assert_array_equal(pad.image(readings.reshape(2, 3, 4)), pad.image(readings))
    with pytest.raises(InvalidArgument, match="got -3: subtract those at rest"):
        pad.image(np.full(12, -3.0))


@pytest.mark.parametrize("wrong", [(14, 6, np.nan), (14, 6, "3"), ("14", 6, 0.0034), (1.5, 2, 0.0034)])
def test_a_grid_of_no_numbers_is_refused(wrong):
    with pytest.raises(InvalidArgument, match="a grid has at least"):
        Taxels.grid(*wrong)
    with pytest.raises(InvalidArgument, match=r"half_width must be a number in .* m, got 23.8"):
        Pad.described(Taxels.grid(14, 6, 3.4))
