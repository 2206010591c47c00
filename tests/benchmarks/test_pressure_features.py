"""Features of grasps against closed forms of contacts whose moments are known."""

import numpy as np
import pytest

from benchmarks.recorded_sets.dsa import PressureFilm
from benchmarks.recorded_sets.pressure_features import grasp_features


def of_pad(pad):
    """The moments of one pad that is pressed alone."""
    film = PressureFilm((pad.shape,), pad.reshape(1, -1))
    return grasp_features(film)[pad.size : pad.size + 14]


@pytest.mark.parametrize(("height", "width"), [(1, 1), (3, 5), (6, 2)])
@pytest.mark.parametrize("place", [(0, 0), (2, 1)])
@pytest.mark.parametrize("pressure", [0.01, 30.0])
def test_a_rectangle_that_is_pressed_evenly_has_its_moments(height, width, place, pressure):
    pad = np.zeros((9, 7))
    pad[place[0] : place[0] + height, place[1] : place[1] + width] = pressure
    total = pressure * height * width
    (yy, xx), (y4, x4) = (
        [(n**2 - 1) / 12 for n in (height, width)],
        [(n**2 - 1) * (3 * n**2 - 7) / 240 for n in (height, width)],  # central moments of 1 … n
    )
    expected = [
        *np.sqrt(sorted((yy, xx))), yy, xx, 0.0, np.sqrt(height * width), width, height, np.log1p(total) / 5,
        10 * pressure / max(total, 1.0), 1.0, np.sqrt(height * width), y4 / (yy + 0.1) ** 2, x4 / (xx + 0.1) ** 2,
    ]  # fmt: skip
    np.testing.assert_allclose(of_pad(pad), expected, atol=1e-7)


def test_a_grasp_is_its_five_firmest_frames(rng):
    shapes = ((2, 3), (4, 2))
    frames = rng.random((9, 14)) + np.array([1, 9, 2, 8, 7, 0, 6, 5, 3])[:, None]
    film, firmest = PressureFilm(shapes, frames), frames[[1, 3, 4, 6, 7]].mean(axis=0)
    features = grasp_features(film)
    np.testing.assert_allclose(features[:14], np.sqrt(firmest / firmest.sum()))
    moments = np.stack([of_pad(pad) for pad in (firmest[:6].reshape(2, 3), firmest[6:].reshape(4, 2))])
    np.testing.assert_allclose(features[14:], [*moments.ravel(), *moments.max(axis=0), *moments.mean(axis=0)])
