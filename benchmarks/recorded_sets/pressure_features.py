"""Features of a grasp from the pressure images of several pads."""

from __future__ import annotations

import numpy as np

from belief.validation import Floats
from benchmarks.recorded_sets.dsa import PressureFilm

_FIRMEST = 5  # frames that are averaged


def grasp_features(film: PressureFilm) -> Floats:
    """Pattern of the firmest grasp: the image of each pad, its moments, and the moments of all pads together, ``(F,)``.

    >>> grasp_features(PressureFilm(((2, 2),), np.ones((1, 4)))).shape
    (46,)
    """
    image = _firmest(film)
    moments = np.array([_moments(pad) for pad in film.pads(image)])
    pattern = np.sqrt(image / max(image.sum(), 1.0))
    return np.concatenate([pattern, moments.ravel(), moments.max(axis=0), moments.mean(axis=0)])


def _firmest(film: PressureFilm) -> Floats:
    """Mean of the frames with the largest total pressure."""
    order = np.argsort(film.frames.sum(axis=1), kind="stable")
    return np.asarray(film.frames[order[-_FIRMEST:]].mean(axis=0))


def _moments(pad: Floats) -> Floats:
    """Extent, orientation, area, size, peakedness and flatness of a contact, ``(14,)``; zeros without contact."""
    total = pad.sum()
    if total <= 0.0:
        return np.zeros(14)
    rows, columns = np.mgrid[: pad.shape[0], : pad.shape[1]]
    share, touched = pad / total, pad > 0.0
    down, across = rows - (share * rows).sum(), columns - (share * columns).sum()
    yy, xx, xy = (float((share * product).sum()) for product in (down**2, across**2, down * across))
    low, high = np.linalg.eigvalsh([[yy, xy], [xy, xx]])
    height, width = touched.any(axis=1).sum(), touched.any(axis=0).sum()
    return np.array(
        [
            np.sqrt(max(low, 0.0)),
            np.sqrt(max(high, 0.0)),
            yy,
            xx,
            xy,
            np.sqrt(touched.sum()),
            width,
            height,
            np.log1p(total) / 5.0,
            10.0 * pad.max() / max(total, 1.0),
            touched.sum() / (height * width),
            (share**2).sum() ** -0.5,
            (share * down**4).sum() / (yy + 0.1) ** 2,
            (share * across**4).sum() / (xx + 0.1) ** 2,
        ]
    )
