"""Draw the moving picture at the top of README.md, in a light and a dark version, as ``activetouch replay`` draws one.

Run: python docs/generate/lead.py        (writes docs/lead/search.webp and docs/lead/search_dark.webp, about a minute)
"""

from __future__ import annotations

from pathlib import Path

from activetouch import TactileSensor
from experiments.search.film import DARK, LIGHT, write_film

FOLDER = Path(__file__).parent.parent / "lead"


def main() -> None:
    """Write both versions of one search in the scene "coarse"."""
    sensor = TactileSensor.shipped("coarse")
    episode = sensor.search("cone", decider="information_gain", seed=9)
    for name, theme in {"search": LIGHT, "search_dark": DARK}.items():
        write_film(sensor, sensor.problem(), episode, FOLDER / f"{name}.webp", theme)


if __name__ == "__main__":
    main()
