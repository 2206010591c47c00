"""``activetouch pad-fit``: the response of a described pad, from presses of one ball by hand."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from activetouch.pad_file import read_pad
from activetouch.pad_fit import PadFit, fit_pad, read_presses
from belief.constraints import Ending, Positive
from belief.files import ends_claims, require_writable_file
from experiments.command_line.arguments import Picture, check_arguments
from experiments.report import PALETTE, figure


@dataclass(frozen=True)
class PadFitCommand:
    """Fit the response of your own pad to at most sixty presses of one ball.

    Press a ball of known size at different places of the pad and with different forces, on a scale. The file is CSV: a
    line of names, then for each press the force [N] (or depth_mm) and the readings of all taxels. It prints 90 %
    intervals, and writes a description whose ranges have shrunk, for activetouch train --pad.

    For example:

        activetouch pad-fit mine.toml presses.csv --radius-mm 10 --out fitted.toml
    """

    pad: tyro.conf.Positional[Path]
    """TOML description of the pad."""
    presses: tyro.conf.Positional[Path]
    """CSV or NPZ file of the presses."""
    radius_mm: Positive
    """Radius of the ball [mm]."""
    out: Annotated[Path, Ending((".toml",))] = Path("fitted.toml")
    """File for the description with the ranges that are left."""
    picture: Picture = Path("runs/pad-fit.png")
    """File for the picture; the ending decides the format."""

    @ends_claims
    def run(self) -> None:
        """Fit, print, draw, write."""
        check_arguments(self)
        for path in (self.out, self.picture):
            require_writable_file(path)
        found = fit_pad(read_pad(self.pad), read_presses(self.presses, self.radius_mm / 1e3))
        print("\n".join(found.sentences()))
        draw_fit(found, self.picture)
        found.description.save(self.out)
        print(f"wrote {self.picture} and {self.out}")


def draw_fit(found: PadFit, path: Path) -> None:
    """Draw the intervals within the ranges of the description, read against expected readings, and all taxels."""
    before = found.before
    ranges, taxels = before.response.ranges(), before.taxels
    with figure((10, 3.4), path) as drawn:
        intervals, readings, layout = drawn.subplots(1, 3)
        for row, (name, one) in enumerate(found.numbers.items()):
            low, high = ranges[name]
            shares = [(end - low) / (high - low) for end in (one.low, one.value, one.high)]
            if name in ("stiffness", "gain"):
                shares = [float(np.log(end / low) / np.log(high / low)) for end in (one.low, one.value, one.high)]
            intervals.plot([0, 1], [row, row], color="0.85", linewidth=6, solid_capstyle="butt")
            intervals.plot([shares[0], shares[2]], [row, row], color=PALETTE[0], linewidth=6, solid_capstyle="butt")
            intervals.plot(shares[1], row, "k|", markersize=9)
            intervals.text(1.03, row, str(one), va="center", fontsize=7)
        intervals.set_yticks(range(len(found.numbers)), list(found.numbers))
        intervals.set(xlabel="part of the described range", xlim=(-0.02, 1.9), xticks=[0, 0.5, 1])
        intervals.invert_yaxis()
        readings.plot(found.expected.ravel(), found.read.ravel(), ".", markersize=2, color=PALETTE[0], alpha=0.5)
        highest = float(max(found.expected.max(), found.read.max()))
        readings.plot([0, highest], [0, highest], color="0.4", linewidth=0.8)
        readings.set(xlabel="expected reading", ylabel="reading")
        places = 1e3 * taxels.centres[:, 1:].T
        drawn.colorbar(layout.scatter(*places, c=found.read.mean(axis=0), s=22, marker="s", cmap="magma"), label="mean")
        layout.plot(*(1e3 * found.places.T), "+", color="0.6", markersize=4)
        for marker, some in (("x", list(found.dead)), ("o", list(found.odd))):
            layout.plot(*places[:, some], marker, color=PALETTE[1], fillstyle="none", markersize=9)
        layout.set(title="taxels (x: dead, o: odd), + the ball", xlabel="y [mm]", ylabel="z [mm]", aspect="equal")
