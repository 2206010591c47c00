"""Run the scripts of the gallery, and write their figures and the page that shows them.

Run: python docs/generate/gallery.py [NAME ...]        (all by default, some minutes; the page is written in any case)
"""

from __future__ import annotations

import ast
import contextlib
import io
import runpy
import sys
import tempfile
import time
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
SCRIPTS, FIGURES, PAGE = ROOT / "examples" / "gallery", ROOT / "docs" / "gallery", ROOT / "docs" / "gallery.md"
ORDER = (
    "update_a_belief",
    "which_pose_next",
    "when_to_stop",
    "is_it_calibrated",
    "repeats_count_less",
    "one_press",
    "a_full_search",
    "orientation_is_recognised",
    "a_shape_of_your_own",
    "a_decider_of_your_own",
    "subtract_a_control",
    "train_ppo",
    "digits_through_crops",
    "a_real_sensor",
)
"""The scripts, in the order of the page; a script that is missing here comes last."""
_COLOURS = 200


def scripts() -> list[Path]:
    """All scripts of the gallery."""
    places = {name: place for place, name in enumerate(ORDER)}
    return sorted(SCRIPTS.glob("*.py"), key=lambda path: (places.get(path.stem, len(ORDER)), path.stem))


def description(script: Path) -> tuple[str, str]:
    """First line and first paragraph of a script's docstring."""
    text = ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or ""
    first, _, rest = text.partition("\n\n")
    return first, " ".join(rest.partition("\n\n")[0].split())


def run(script: Path, figure: Path, *words: str) -> None:
    """Run a script in this process; it writes the figure."""
    import matplotlib.style

    matplotlib.use("agg")
    from matplotlib import pyplot

    given, sys.argv = sys.argv, [str(script), str(figure), *words]
    try:
        with matplotlib.style.context("default"):
            runpy.run_path(str(script), run_name="__main__")
    finally:
        sys.argv = given
        pyplot.close("all")


def page() -> str:
    """The page of the gallery, in Markdown."""
    lines = [
        "# Gallery",
        "",
        "Short scripts in `examples/gallery/`, each with one figure. Each takes less than a minute on an idle machine.",
        "`python examples/gallery/NAME.py` writes `NAME.png` into the working folder; seeds are in the scripts.",
        "",
    ]
    for script in scripts():
        first, _ = description(script)
        name = script.stem
        lines += [f"## [{title(script)}](../examples/gallery/{name}.py)", ""]
        lines += [f"![{title(script)}](gallery/{name}.png)", "", first, ""]
    return "\n".join(lines)


def title(script: Path) -> str:
    """The heading of a script, from its name."""
    return script.stem.replace("_", " ").capitalize().replace("ppo", "PPO").replace("pomdp", "POMDP")


def main(names: list[str]) -> None:
    """Write the figures and the page."""
    from PIL import Image

    from activetouch import TactileSensor

    TactileSensor.shipped = cache(TactileSensor.shipped)  # type: ignore[method-assign]
    FIGURES.mkdir(exist_ok=True)
    for script in scripts():
        if not names or script.stem in names:
            started = time.perf_counter()
            with tempfile.TemporaryDirectory() as folder:
                drawn = Path(folder, "figure.png")
                run(script, drawn)
                buffer = io.BytesIO()
                Image.open(drawn).convert("RGB").quantize(_COLOURS).save(buffer, format="PNG", optimize=True)
            (FIGURES / f"{script.stem}.png").write_bytes(buffer.getvalue())
            print(
                f"{script.stem}: {time.perf_counter() - started:.1f} s, {len(buffer.getvalue()) // 1000} kB", flush=True
            )
    PAGE.write_text(page(), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as empty, contextlib.chdir(empty):
        main(sys.argv[1:])
