"""What a press in a tray would meet of a body, however it rests there: heights, and embedded contacts.

A body that rests on a face is seen from above in one height map. A press beside its middle meets the same map, shifted,
so that the contacts at all places of a tray follow from one map for each shape, face and turn.
"""

from __future__ import annotations

from math import ceil

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from activetouch.perception.cached_arrays import cached_array, counted
from activetouch.perception.contacts.hypotheses import ContactHypotheses
from activetouch.perception.imaging import Floats32
from activetouch.scene import Scene
from activetouch.scene_description import described
from activetouch.solids.solid import Floats, Shape
from activetouch.tray.resting import NUM_TURNS, Rests, about_vertical, heights_above_floor, rests
from belief.tray import PlaceTable

PITCH = 0.005
"""Distance of the places that are told apart, rounded to whole pixels of predicted contacts [m]."""
WIDTH = 0.2
"""Width of the orientations that a predicted contact stands for, an input of the network of contacts [rad]."""
NUM_CHANNELS = 7
"""Numbers of a contact before its embedding: share of the cell that meets the body, height [m] and its standard
deviation in the cell, and of its row the prior, the extents along x and y and the inner radius [m]."""
_AT_ONCE = 256  # contacts
_TURN = 2.0 * np.pi / NUM_TURNS
_ASIDE = np.array([-1 / 3, 1 / 3])  # of the turns of one row, beside the middle, whose heights count


def pitch_in_pixels(reader: ContactHypotheses) -> int:
    """Distance of the places that are told apart, in pixels of a predicted contact."""
    return max(1, round(PITCH / _pixel(reader)))


def pitch(reader: ContactHypotheses) -> float:
    """Distance of the places that are told apart [m]."""
    return pitch_in_pixels(reader) * _pixel(reader)


def place_table(reader: ContactHypotheses, scene: Scene) -> PlaceTable:
    """The contacts of all shapes of a scene at all offsets, embedded; those in the cache take no time."""
    parts = [_of_shape(reader, scene, solid) for solid in counted(list(scene.solids.values()), "shapes")]
    reach = max(part.shape[1] for part in parts) // 2
    margins = [reach - part.shape[1] // 2 for part in parts]
    every = np.concatenate(
        [
            np.pad(part[..., :NUM_CHANNELS], [(0, 0), (more, more), (more, more), (0, 0)]).astype(np.float32)
            for part, more in zip(parts, margins, strict=True)
        ]
    )
    hit, height, spread, *others = np.ascontiguousarray(np.moveaxis(every, 3, 0))
    share, along, across, inside = (part[:, reach, reach].astype(float) for part in others)
    return PlaceTable(
        labels=scene.shape_labels,
        shape_of=np.repeat(np.arange(len(parts)), [len(part) for part in parts]),
        prior=share,
        extents=np.stack([along, across], axis=1),
        inner=inside,
        hit=hit,
        height=height,
        spread=spread,
        embeddings=np.concatenate([part[part[..., 0] > 0.0][:, NUM_CHANNELS:] for part in parts], dtype=np.float32),
        pitch=pitch(reader),
        half_width=reader.imaging.pad.half_width,
    )


def _pixel(reader: ContactHypotheses) -> float:
    return 2.0 * reader.imaging.pad.half_width / reader.imaging.contact_pixels


def _of_shape(reader: ContactHypotheses, scene: Scene, solid: Shape) -> Floats32:
    """The contacts of one shape ``(R, G, G, channels)``, with as many offsets as it has."""
    code = reader.code(scene)
    key = {
        "reader": reader.digest,
        "state": (np.round(code, 7) + 0.0).tolist(),
        "tray": [PITCH, WIDTH, NUM_TURNS, 3],
        "body": described(solid),
    }
    return cached_array(key, lambda: _made(reader, code, solid, rests(solid)).astype(np.float16))


def _made(reader: ContactHypotheses, code: Floats32, solid: Shape, resting: Rests) -> Floats32:
    """See :func:`_of_shape`."""
    pixel, step, inner = _pixel(reader), pitch_in_pixels(reader), reader.imaging.contact_pixels
    window = reader.imaging.wide_window.num_pixels
    reach = ceil((solid.bounding_radius / pixel + inner / 2) / step)
    size, margin = 2 * reach + 1, (window - inner) // 2
    edge = window + 2 * (reach + 1) * step
    corners = (np.arange(size) - reach) * step + (edge - window) // 2  # of the windows
    near = np.arange(step) - (step - 1) // 2
    order = np.argsort(np.add.outer(near**2, near**2).ravel(), kind="stable")
    shifts = np.stack(np.meshgrid(near, near, indexing="ij"), axis=-1).reshape(-1, 2)
    rows = []
    for face, turn in [(face, turn) for face, number in enumerate(resting.turns) for turn in range(number)]:
        seen = _seen(solid, resting, face, np.array([turn]), pixel, edge)[0]
        turned = about_vertical(np.array([turn * _TURN])) @ resting.rotations[face]
        every = np.concatenate([seen[None], _seen(solid, resting, face, turn + _ASIDE, pixel, edge)])
        first = margin + inner // 2
        under = maximum_filter(every, (0, inner, inner), mode="constant", cval=-np.inf)[:, first:, first:]
        at = corners[:, None] + near
        values = under[:, at[:, None, :, None], at[None, :, None, :]]
        values = np.moveaxis(values, 0, -1).reshape(size, size, -1, len(every))
        met = np.isfinite(values)
        count = np.maximum(met.sum(axis=(2, 3)), 1)
        mean = np.where(met, values, 0.0).sum(axis=(2, 3)) / count
        spread = np.sqrt(np.where(met, (values - mean[:, :, None, None]) ** 2, 0.0).sum(axis=(2, 3)) / count)
        table = np.zeros((size, size, NUM_CHANNELS), np.float32)
        share = resting.probs[face] / resting.turns[face]
        silhouette = turned[0, :2] @ solid.surface.vertices
        extent, inside = np.abs(silhouette).max(axis=1), _inner_radius(silhouette)
        for place, value in enumerate((met.mean(axis=(2, 3)), mean, spread, share, *extent, inside)):
            table[..., place] = value
        met = met[..., 0]  # where the turn is exact
        places = np.argwhere(met.any(axis=2))
        nearest = order[met[tuple(places.T)][:, order].argmax(axis=1)]  # to the middle of the cell, of those that meet
        starts = corners[places] + shifts[nearest]
        views, parts = np.lib.stride_tricks.sliding_window_view(seen, (window, window)), []
        for some in np.array_split(starts, -(-len(starts) // _AT_ONCE)):
            parts.append(reader.embed(np.ascontiguousarray(views[some[:, 0], some[:, 1]]), WIDTH, code)[0])
        embedded = np.zeros((size, size, parts[0].shape[1]), np.float32)
        embedded[tuple(places.T)] = np.concatenate(parts)
        rows.append(np.concatenate([table, embedded], axis=2))
    return np.stack(rows)


def _seen(
    solid: Shape, resting: Rests, face: int, turns: Floats | NDArray[np.int64], pixel: float, num_pixels: int
) -> Floats32:
    """Heights above the floor [m] of a body on a face, from above, in n turns, ``(n, num_pixels, num_pixels)``."""
    rotations = about_vertical(np.asarray(turns, float) * _TURN) @ resting.rotations[face]
    lifts = np.full(len(turns), resting.lifts[face])
    return heights_above_floor(solid, rotations, lifts, np.zeros((len(turns), 2)), pixel, num_pixels, np.float32)


def _inner_radius(corners: Floats) -> float:
    """Radius of the largest disc about the origin inside the hull of points in the plane, ``(2, v)`` [m]."""
    angles = np.arange(72) * 2.0 * np.pi / 72
    return max(0.0, float((np.stack([np.cos(angles), np.sin(angles)], axis=1) @ corners).max(axis=1).min()))
