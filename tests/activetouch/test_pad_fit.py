"""The response of a pad from presses of a ball, simulated by the press of the scenes."""

from dataclasses import replace

import numpy as np
import pytest

from activetouch import PadDescription, Response, Taxels
from activetouch.pad_fit import BadPresses, BallPresses, fit_pad, read_presses
from belief.errors import InvalidArgument
from benchmarks.pad_fits import RADIUS, RANGES, simulated

TAXELS = Taxels.grid(6, 6, 0.004)
KNOWN = {"blur": 0.2, "crosstalk": 0.0, "threshold": [0.0, 0.2], "noise": [0.0, 0.02]}
PAD = PadDescription(TAXELS, Response.of(RANGES | KNOWN | {"gain": 1.0}), (1.0, 8.0), full_scale=4e4)


def presses(pad, seed=0, number=16, dead=()):
    share = np.full(7, 0.4)
    return share, simulated(pad, share, np.random.default_rng(seed), number, dead)


@pytest.mark.parametrize("is_relative", [pytest.param(False, marks=pytest.mark.nightly), True])
def test_the_truth_lies_in_narrow_intervals(is_relative):
    pad = replace(PAD, is_relative=is_relative)
    share, given = presses(pad, number=30, dead=(14,))
    found = fit_pad(pad, given)
    truth = pad.response.at(share[None])
    for name, least in (("stiffness", 1.0), ("law", 0.0)):
        one = found.numbers[name]
        assert one.low <= truth[name][0] <= one.high, name
        assert (one.high / one.low < 1.3) if least else (one.high - one.low < 0.3), name
    assert found.dead == (14,)
    assert found.description.dead == (14,)
    assert found.description.response.ranges()["law"][0] >= 0.7
    assert any("stiffness" in line for line in found.sentences())


def test_an_odd_taxel_is_found():
    _, given = presses(PAD, number=16)
    readings = np.array(given.readings)
    readings[:, 20] *= 0.5
    found = fit_pad(PAD, BallPresses(RADIUS, readings, given.forces))
    assert list(found.odd) == [20]
    assert found.odd[20] < 0.8
    assert found.dead == ()


@pytest.mark.nightly  # fits of forces have tests that run always
def test_depths_alone_do_not_tell_the_stiffness():
    _, given = presses(PAD, number=8)
    found = fit_pad(PAD, BallPresses(RADIUS, given.readings, None, np.full(8, 5e-4)))
    assert any("without forces" in line for line in found.unclear)


def test_presses_are_read_from_files(tmp_path):
    _, given = presses(PAD, number=5)
    rows = ["force," + ",".join(f"t{i}" for i in range(36))]
    for force, row in zip(given.forces.tolist(), given.readings.tolist(), strict=True):
        rows.append(",".join(map(repr, [force, *row])))
    (tmp_path / "presses.csv").write_text("\n".join(rows) + "\n")
    np.savez(tmp_path / "presses.npz", readings=given.readings, forces=given.forces)
    for name in ("presses.csv", "presses.npz"):
        found = read_presses(tmp_path / name, RADIUS)
        assert np.allclose(found.readings, given.readings)
        assert np.allclose(found.forces, given.forces)
        assert found.depths is None
    (tmp_path / "presses.csv").write_text("\n".join([*rows, "1,2"]))
    with pytest.raises(BadPresses, match=r"presses\.csv"):
        read_presses(tmp_path / "presses.csv", RADIUS)
    with pytest.raises(FileNotFoundError):
        read_presses(tmp_path / "none.csv", RADIUS)


def test_presses_that_are_none():
    _, given = presses(PAD, number=5)
    for wrong in (
        {"forces": None},
        {"forces": -given.forces},
        {"readings": 0 * given.readings},
        {"readings": given.readings[:2]},
        {"radius": 0.0},
        {"forces": np.full(5, np.nan)},
    ):
        with pytest.raises(InvalidArgument):
            replace(given, **wrong)
    depths = np.full(5, 1e-3)
    for wrong, words in (
        ({"radius": 0.9}, "radius_mm .* is it in µm"),
        ({"forces": 1e3 * given.forces}, "force .* is it in mN"),
        ({"forces": None, "depths": 1e-3 * depths}, "depth_mm .* is it in m"),
    ):
        with pytest.raises(InvalidArgument, match=words):
            replace(given, **wrong)
    with pytest.raises(InvalidArgument, match="taxels"):
        fit_pad(replace(PAD, taxels=Taxels.grid(3, 3, 0.004)), given)
    with pytest.raises(InvalidArgument, match="full scale"):
        fit_pad(PAD, replace(given, readings=100 * given.readings))
