"""Pictures of searches in trays: objects from above, the finger's way, and where the target may be."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from activetouch.tray.world import Lying, TrayWorld
from belief.tray import TrayBelief
from experiments.report import INK, PALETTE, Picture
from experiments.search.drawer.searches import Searches
from planners.tray_session import TrayEpisode

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SHOWN = 2  # searches of each decider


def searches_from_above(searches: Searches, episodes: Mapping[str, Sequence[TrayEpisode]]) -> list[Picture]:
    """The first searches of each decider, from above."""
    found = []
    for number in range(_SHOWN):
        panels: list[Callable[[Axes], None]] = []
        for decider, listed in episodes.items():
            if number < len(listed):
                panels.append(partial(_draw, searches, decider, listed[number]))
        if panels:
            caption = f"Search {number + 1}: {_words(next(iter(episodes.values()))[number])}."
            found.append(Picture(f"search_{number + 1}", caption, panels, size=(4.6, 3.9)))
    return found


def _words(episode: TrayEpisode) -> str:
    return f"for {episode.target}, which is {'there' if episode.is_there else 'not there'}"


def world_of(searches: Searches, episode: TrayEpisode) -> TrayWorld:
    """The tray of a search, as it was at the start."""
    return searches.made().world(episode.target, episode.seed)


def target_map(belief: TrayBelief) -> Any:
    """Probability of each cell that the target's middle is there, ``(X, Y)``, over all worlds."""
    found = np.zeros(belief.cells)
    for weight, world in zip(belief.weights, belief.worlds, strict=True):
        answers = belief.answers(world)
        free = belief.by_shape[belief.target]
        if world.found:
            free = free * belief.outside(world)[belief.target]
        if free.sum() > 0.0:
            found += weight * answers.unfound * free / free.sum()
        for one, prob in zip(world.found, answers.found, strict=True):
            if prob > 1e-6:
                shapes = np.where(np.arange(one.num_shapes) == belief.target, 0.0, -np.inf)
                np.add.at(found, (one.x, one.y), weight * prob * one.probs(shapes))
    return found


def believed(searches: Searches, episode: TrayEpisode, number: int) -> TrayBelief:
    """The belief after a number of touches of a search, from its record and its tray."""
    sensor = searches.made()
    touched, session = sensor.touched(episode.target, episode.seed), sensor.session(episode.target)
    for step in episode.steps[:number]:
        session.tell_met(touched.press(*step.place), step.place)
    return session.belief


def _draw(searches: Searches, decider: str, episode: TrayEpisode, axes: Axes) -> None:
    """One search: objects, way, belief before the last touch."""
    sensor, world = searches.made(), world_of(searches, episode)
    number = max(len(episode.steps) - 1, 0)
    belief = believed(searches, episode, number)
    width, depth = (1000.0 * edge for edge in sensor.tray.size)
    shown = target_map(belief)
    axes.imshow(
        np.sqrt(shown / max(shown.max(), 1e-300)).T,
        origin="lower",
        extent=(0.0, width, 0.0, depth),
        cmap="Blues",
        alpha=0.8,
        interpolation="bilinear",
        zorder=0,
    )
    for one in world.objects:
        outline = 1000.0 * outline_of(world, one)
        is_target = world.labels[one.shape] == episode.target
        axes.fill(
            *outline.T, facecolor="none", edgecolor=PALETTE[1 if is_target else 2], linewidth=2.0 if is_target else 1.0
        )
        axes.annotate(
            world.labels[one.shape].replace("_", " ")[:18],
            (1000.0 * one.place[0], 1000.0 * one.place[1]),
            ha="center",
            va="center",
            fontsize=7,
            color=INK,
        )
    way = 1000.0 * np.array([(0.0, 0.0), *(step.place for step in episode.steps)])
    axes.plot(*way.T, color=INK, linewidth=0.7, alpha=0.6)
    hits = np.array([step.height is not None for step in episode.steps], bool)
    axes.plot(*way[1:][~hits].T, linestyle="", marker="o", markersize=4, markerfacecolor="none", color=INK, alpha=0.7)
    axes.plot(*way[1:][hits].T, linestyle="", marker="o", markersize=4, color=PALETTE[0])
    if episode.place is not None:
        axes.plot(*(1000.0 * np.array(episode.place)), marker="x", markersize=11, markeredgewidth=2.5, color=PALETTE[1])
    axes.set(xlim=(0.0, width), ylim=(0.0, depth), aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    said = {"here": "it is here", "absent": "it is absent", "unsure": "unsure"}[episode.answer]
    axes.set_title(
        f"{decider}: {said} ({episode.stated:.2f}), {'right' if episode.success else 'wrong'}\n"
        f"{episode.num_touches} touches, {episode.travel:.2f} m",
        fontsize=9,
    )


def outline_of(world: TrayWorld, one: Lying) -> Any:
    """The outline of an object from above, ``(n, 2)`` [m]: the corners of its hull, in order."""
    import scipy  # whose parts load at first use

    solid = world.solids[one.shape]
    points = (one.scale * one.rotation[:2] @ solid.surface.vertices).T + one.place[:2]
    return points[scipy.spatial.ConvexHull(points).vertices]
