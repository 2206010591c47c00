"""Hooks of the site: pages that are generated, and links of pages that leave the folder of the site.

Links to files that are no pages lead to the repository.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path, PurePosixPath
from posixpath import normpath, relpath
from typing import Any

ROOT = Path(__file__).parent.parent.parent
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]

import gallery  # noqa: E402
import notebooks  # noqa: E402
import pages  # noqa: E402
from mkdocs.exceptions import PluginError  # noqa: E402
from mkdocs.plugins import event_priority  # noqa: E402
from mkdocs.structure.files import File  # noqa: E402
from notebooks import LINK, NOTEBOOKS, REPOSITORY  # noqa: E402

OF_ROOT = {"README.md": "index.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
"""Files outside of the folder that are pages."""
MOVED = {
    "likelihood": "your_classifier/#from-softmax-to-likelihood",
    "scenes": "world/#scenes",
    "roadmap": "limits/#what-comes-next",
    "what_was_tried": "decisions/",
}
"""Where pages of earlier versions went; their addresses lead there."""
NAV: dict[str, list[str]] = {
    "Start": [
        "index.md",
        "start.md",
        "install.md",
        "your_own_objects.md",
        "your_own_pad.md",
        "your_classifier.md",
        "any_decision.md",
        "find.md",
        "drawer.md",
        "toy.md",
    ],
    "Learn": [
        "philosophy.md",
        "world.md",
        "perception.md",
        "calibration.md",
        "certificate.md",
        "planners.md",
        "where_to_touch.md",
        "grasps.md",
        "architecture.md",
    ],
    "How-to": [
        "adaptive_test.md",
        "diagnosis.md",
        "digits.md",
        "extending.md",
        "environments.md",
        "ppo.md",
        "drive_a_robot.md",
        "real_touch.md",
        "train_a_sensor.md",
        "scale.md",
        "paper_figures.md",
        "contributing.md",
    ],
    "Reference": ["commands.md", "session_log.md", "columns.md", "glossary.md"],
    "Results": [
        "results.md",
        "benchmark.md",
        "reproduction.md",
        "tradeoff.md",
        "robustness.md",
        "benchmarks.md",
        "limits.md",
    ],
}
"""Pages under each tab; generated pages are added to them."""
BOOSTS = {
    **dict.fromkeys(("decisions/", "changelog.md"), 0.1),
    **dict.fromkeys(("reference/", "gallery", "reproduction.md", "deciders/", "worlds/"), 0.3),
}
"""Factors of pages in searches, by the beginning of their names: what explains comes before what lists and records."""
WORDS = {
    "install.md": ["Windows", "macOS", "Linux", "install", "pip"],
    "start.md": ["Jupyter", "notebook", "Colab", "first"],
    "scale.md": ["cluster", "Slurm", "Dask", "machines"],
    "world.md": ["GelSight", "simulation", "renderer"],
    "train_a_sensor.md": ["train", "training", "GPU"],
    "calibration.md": ["calibrate", "calibration", "confidence"],
    "results.md": ["accuracy", "success"],
    "your_own_objects.md": ["mesh", "meshes", "STL", "OBJ", "objects"],
    "your_own_pad.md": ["pad", "taxels", "layout"],
    "drive_a_robot.md": ["robot", "ROS", "live"],
    "real_touch.md": ["real", "recorded", "recordings", "dataset"],
    "ppo.md": ["PPO", "reinforcement", "policy", "RL"],
    "environments.md": ["Gymnasium", "environment"],
    "your_classifier.md": ["classifier", "logits", "softmax"],
    "any_decision.md": ["decision", "cost", "costs"],
    "find.md": ["find", "identify"],
    "planners.md": ["decider", "planner", "POMDP"],
}
"""Words that people type, and the page that answers: searches know them as its tags."""
QUERIES = {
    "Windows": "install/",
    "macOS": "install/",
    "cluster": "scale/",
    "Jupyter": "start/",
    "GelSight": "world/",
    "how many touches": "results/",
    "train": "train_a_sensor/",
    "calibrate": "calibration/",
    "my own meshes": "your_own_objects/",
    "my pad has 4 x 4 taxels": "your_own_pad/",
    "drive a robot": "drive_a_robot/",
    "recorded touches": "real_touch/",
    "GPU": "train_a_sensor/",
    "notebook": "start/",
    "find a mug among many meshes": "find/",
    "logits of my classifier": "your_classifier/",
}
"""What people type into the search, and the page that must come first."""
WIDEST = 66
"""Characters of code in a line of a page."""
FOLDERS = ("deciders", "worlds", "reference/api")
_SECTION = re.compile(
    r'(<nav class="md-nav" data-md-level="\d+") aria-labelledby="\w+"([^>]*>\s*<label class="md-nav__title"[^>]*>'
    r'\s*<span class="md-nav__icon md-icon"></span>\s*)([^<"]*[^<"\s])'
)
_EMPTY_HEAD = re.compile(r"<th( [^>]*)?></th>")
_PICTURE = re.compile(r'<picture>.*?srcset="([^"]+)".*?src="([^"]+)".*?alt="([^"]+)".*?</picture>', re.S)


def on_config(config: Any) -> Any:
    """Set the contents, a tab for each entry."""
    made = pages.generated()
    deciders, worlds, api = ([name for name in made if name.startswith(f"{folder}/")] for folder in FOLDERS)
    records = [f"decisions/{path.name}" for path in sorted((ROOT / "docs/decisions").glob("0*.md"))]
    gallery_pages = ["gallery.md", *(f"gallery/{script.stem}.md" for script in gallery.scripts())]
    config["nav"] = [
        {"Start": NAV["Start"]},
        {"Learn": [*NAV["Learn"], {"Gallery": gallery_pages}]},
        {"How-to": NAV["How-to"]},
        {
            "Reference": [
                *NAV["Reference"],
                "reference/commands.md",
                "reference/environments.md",
                "reference/layout.md",
                {"Deciders": deciders},
                {"Scenes": worlds},
                {"API": api},
            ]
        },
        {"Results": NAV["Results"]},
        {
            "Decisions": [
                "decisions/index.md",
                "changelog.md",
                {"Records": [{"All records": records}]},
            ]
        },
    ]
    return config


def on_files(files: Any, config: Any) -> Any:
    """Add the generated pages."""
    made = {page: (ROOT / name).read_text(encoding="utf-8") for name, page in OF_ROOT.items()}
    made |= pages.generated()
    for script in gallery.scripts():
        first, paragraph = gallery.description(script)
        title, code = gallery.title(script), script.read_text(encoding="utf-8")
        figure = f"![{first}]({script.stem}.png)" if (gallery.FIGURES / f"{script.stem}.png").exists() else ""
        made[f"gallery/{script.stem}.md"] = f"# {title}\n\n{paragraph}\n\n{figure}\n\n```python\n{code}```\n"
    made |= {f"{name}.ipynb": notebooks.notebook(ROOT / f"docs/{name}.md") for name in NOTEBOOKS}
    made |= {
        f"{old}/index.html": f'<!doctype html><meta http-equiv="refresh" content="0; url=../{new}">'
        for old, new in MOVED.items()
    }
    for name, text in made.items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Rewrite links that leave the folder, and say how searches find the page."""
    place = page.file.src_uri
    page.meta["search"] = {"boost": next((boost for name, boost in BOOSTS.items() if place.startswith(name)), 1.0)}
    page.meta["tags"] = WORDS.get(place, [])
    origin = next((name for name, made in OF_ROOT.items() if made == place), f"docs/{place}")

    def link(found: re.Match[str]) -> str:
        mark, words, target, section = found.groups()
        if not target or "://" in target or target.startswith("mailto:"):
            return found[0]
        path = normpath(str(PurePosixPath(origin).parent / target))
        inside = _page_of(path, files)
        if inside is None:
            return f"{mark}[{words}]({REPOSITORY}/{path}{section or ''})"
        return f"{mark}[{words}]({relpath(inside, str(PurePosixPath(place).parent))}{section or ''})"

    name = place.removesuffix(".md")
    if name in NOTEBOOKS:
        links = (
            f"[Open in Colab]({notebooks.COLAB}/{name}.ipynb) · [This page as a notebook]({name}.ipynb){{ download }}"
        )
        markdown = re.sub(r"\A(# .*\n)", rf"\1\n{links}\n", markdown)
    markdown = _PICTURE.sub(r"![\3](\2#only-light)\n![\3](\1#only-dark)", markdown)
    parts = re.split(r"(^```.*?^```)", markdown, flags=re.S | re.M)  # code stays as it is
    return "".join(narrow(part) if number % 2 else LINK.sub(link, part) for number, part in enumerate(parts))


def on_post_page(output: str, page: Any, config: Any) -> str:
    """Say to screen readers what the theme leaves without words: contents of a section, empty heads of columns."""
    return _SECTION.sub(r'\1 aria-label="\3"\2\3', _EMPTY_HEAD.sub(r"<td\1></td>", output))


def on_post_template(output: str, template_name: str, config: Any) -> str:
    """The same for pages that no file is behind, such as 404.html."""
    return on_post_page(output, None, config) if template_name.endswith(".html") else output


def narrow(block: str) -> str:
    """A block of shell commands with comments above lines that are too long for the page with them."""
    if not block.startswith(("```sh", "```bash")):
        return block
    lines = []
    for line in block.splitlines():
        found = re.fullmatch(r"(\S.*?\S) +(# .*)", line)
        lines += [found[2], found[1]] if found and len(line) > WIDEST else [line]
    return "\n".join(lines)


def _page_of(target: str, files: Any) -> str | None:
    """The file of the site that a path from the root of the repository stands for."""
    if target in OF_ROOT:
        return OF_ROOT[target]
    if target.startswith("examples/gallery/"):
        target = f"docs/gallery/{PurePosixPath(target).stem}.md"
    inside = target.removeprefix("docs/")
    if inside == target:
        return None
    for name in (inside, f"{inside}/index.md"):
        if files.get_file_from_path(name) is not None:
            return name
    return None


@event_priority(-100)  # after the search has written its index
def on_post_build(config: Any) -> None:
    """Check that what people type finds its page first, by the search of the site itself, where there is Node.js."""
    if missed := misses(Path(config["site_dir"])):
        raise PluginError(f"searches that find another page first: {', '.join(missed)}")


def misses(site: Path) -> list[str]:
    """Queries for which the search of a site finds another page first; none without Node.js."""
    if (node := shutil.which("node")) is None:
        return []
    command = [node, Path(__file__).with_name("search.js"), site, *QUERIES]
    found = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    first = {query: (places or ["nothing"])[0].partition("#")[0] for query, places in found.items()}
    return [f"{query!r} finds {first[query]}" for query, wanted in QUERIES.items() if first[query] != wanted]
