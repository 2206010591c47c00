"""Figures of single presses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from numpy.typing import NDArray

from activetouch.pressing.contact import Contact, Phase, Trace
from activetouch.rendering import RENDERERS
from experiments.report import PALETTE, figure

_PHASE_COLOURS = {
    Phase.APPROACH: "#dfe7ef",
    Phase.CONTACT: "#f6c99a",
    Phase.PAUSE: "#bfe3cd",
    Phase.WITHDRAW: "#e6dcef",
}


def draw_touch(title: str, view: NDArray[np.uint8], contact: Contact, path: Path) -> None:
    """Draw one press: the scene, force over time, height map, and every renderer's image."""
    with figure((10, 6.4), path) as drawn:
        top, bottom = np.asarray(drawn.subfigures(2, 1, height_ratios=(1.15, 1)))
        scene, trace = top.subplots(1, 2)
        height_map, *rendered = bottom.subplots(1, 1 + len(RENDERERS))
        drawn.suptitle(title)
        scene.imshow(view)
        scene.set_axis_off()
        _draw_trace(trace, contact.trace)
        edge = 1e3 * contact.pad.half_width
        extent = (-edge, edge, -edge, edge)
        gap = np.ma.masked_greater(1e3 * contact.gap, 1e3 * contact.pad.max_depth)
        picture = height_map.imshow(gap, cmap="viridis_r", origin="lower", extent=extent)
        bottom.colorbar(picture, ax=height_map, location="bottom", label="behind the first contact [mm]")
        height_map.set(title="height map", xlabel="y [mm]", ylabel="z [mm]")
        for axes, (name, renderer) in zip(rendered, RENDERERS.items(), strict=True):
            _show(axes, renderer(contact))
            axes.set_title(name)


def draw_taxels(title: str, view: NDArray[np.uint8], contact: Contact, image: NDArray[np.uint8], path: Path) -> None:
    """Draw one press of a described pad: the scene, the height map, the pressure of the layer, and the readings."""
    with figure((10, 3.1), path) as drawn:
        scene, height_map, pressure, readings = drawn.subplots(1, 4)
        drawn.suptitle(title)
        scene.imshow(view)
        scene.set_axis_off()
        edge = 1e3 * contact.pad.half_width
        extent = (-edge, edge, -edge, edge)
        is_pad = np.isfinite(contact.pad.face) if contact.pad.face is not None else np.ones_like(contact.gap, bool)
        taxels = contact.pad.layout
        shown = image > 0 if taxels is None else taxels.shown(np.ones(len(taxels.normals)), len(image)) > 0
        parts = (
            (height_map, "behind the first contact [mm]", "viridis_r", 1e3 * contact.gap, is_pad),
            (pressure, "pressure [kPa]", "magma", contact.pressure / 1e3, is_pad),
            (readings, "readings", "magma", image / 255.0, shown),
        )
        for axes, name, colours, values, there in parts:
            hidden = ~there | ~np.isfinite(values)
            if axes is height_map:
                hidden |= values > 1e3 * contact.pad.max_depth
            picture = axes.imshow(np.ma.masked_array(values, hidden), cmap=colours, origin="lower", extent=extent)
            axes.set_facecolor("0.9")
            axes.set(xlabel="y [mm]")
            drawn.colorbar(picture, ax=axes, location="bottom", label=name)
        height_map.set_ylabel("z [mm]")


def draw_grasp(title: str, view: NDArray[np.uint8], images: Sequence[NDArray[np.float64]], path: Path) -> None:
    """Draw one grasp: the hand, and the image of each finger."""
    with figure((7.2, 4.2), path, dpi=110) as drawn:
        scene, grid = np.asarray(drawn.subfigures(1, 2, width_ratios=(2.2, 1)))
        drawn.suptitle(title)
        axes = scene.subplots()
        axes.imshow(view)
        axes.set_axis_off()
        cells = np.ravel(grid.subplots(-(-len(images) // 2), 2, squeeze=False))
        for axes in cells[len(images) :]:
            axes.set_axis_off()
        for number, (axes, image) in enumerate(zip(cells, images, strict=False), 1):
            _show(axes, image)
            axes.set_title(f"finger {number}")


def _draw_trace(axes: Axes, trace: Trace | None) -> None:
    if trace is None:
        axes.set_axis_off()
        axes.text(0.5, 0.5, "the press does not simulate time", ha="center", va="center", transform=axes.transAxes)
        return
    phases = np.array([list(_PHASE_COLOURS).index(phase) for phase in trace.phase])
    starts = np.flatnonzero(np.diff(phases, prepend=-1)).tolist()
    for start, end in zip(starts, [*starts[1:], len(phases) - 1], strict=True):
        phase = trace.phase[start]
        axes.axvspan(trace.time[start], trace.time[end], color=_PHASE_COLOURS[phase], linewidth=0)
    for component, colour, name in zip(trace.force.T, PALETTE[:3], "xyz", strict=True):
        axes.plot(trace.time, component, color=colour, linewidth=1.2, label=f"along {name}")
    phases_seen = dict.fromkeys(trace.phase)
    patches = [Patch(facecolor=_PHASE_COLOURS[phase], edgecolor="0.6", label=phase) for phase in phases_seen]
    axes.legend(handles=[*axes.lines, *patches], frameon=False, ncols=2, loc="upper left")
    axes.set(xlabel="time [s]", ylabel="force of the pad [N]")
    axes.margins(x=0)


def draw_gallery(images: Mapping[tuple[str, str, str], NDArray[np.float64]], poses: Sequence[str], path: Path) -> None:
    """Draw a table of images by (shape, renderer, pose): a row per shape and renderer, a column per pose."""
    rows = list(dict.fromkeys((shape, renderer) for shape, renderer, _ in images))
    with figure((1.25 * len(poses) + 1.4, 1.2 * len(rows)), path, dpi=110) as drawn:
        grid = drawn.subplots(len(rows), len(poses), squeeze=False)
        for (shape, renderer), line in zip(rows, grid, strict=True):
            for pose, axes in zip(poses, line, strict=True):
                _show(axes, images[shape, renderer, pose])
            line[0].set_ylabel(f"{shape}\n{renderer}", rotation=0, ha="right", va="center")
        for pose, axes in zip(poses, grid[0], strict=True):
            axes.set_title(pose)


def _show(axes: Axes, image: NDArray[np.float64]) -> None:
    axes.imshow(image, cmap="magma", vmin=0, vmax=max(float(image.max()), 0.3), origin="lower")
    axes.set(xticks=[], yticks=[])
