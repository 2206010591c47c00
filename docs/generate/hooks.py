"""Hooks of the site: pages that are generated, and links of pages that leave the folder of the site.

Links to files that are no pages lead to the repository.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path, PurePosixPath
from posixpath import normpath, relpath
from typing import Any

ROOT = Path(__file__).parent.parent.parent
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]

import gallery  # noqa: E402
import pages  # noqa: E402
from mkdocs.structure.files import File  # noqa: E402

OF_ROOT = {"README.md": "index.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
"""Files outside of the folder that are pages."""
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
        "toy.md",
    ],
    "Learn": [
        "philosophy.md",
        "world.md",
        "perception.md",
        "likelihood.md",
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
        "formats.md",
        "scale.md",
        "paper_figures.md",
        "contributing.md",
    ],
    "Reference": ["commands.md", "session_log.md", "columns.md", "scenes.md", "glossary.md"],
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
NOTEBOOKS = ("toy", "your_classifier", "any_decision", "adaptive_test", "diagnosis", "digits")
"""Pages that can be downloaded as notebooks; their code is tested as it stands on the page."""
FOLDERS = ("deciders", "worlds", "reference/api")
REPOSITORY = "https://github.com/activetouch/activetouch/blob/main"
_LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s#]*)(#[^)\s]*)?\)")
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
                {"Deciders": deciders},
                {"Scenes": worlds},
                {"API": api},
            ]
        },
        {"Results": NAV["Results"]},
        {
            "Decisions": [
                "decisions/index.md",
                "what_was_tried.md",
                "roadmap.md",
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
    made |= {f"{name}.ipynb": notebook(ROOT / f"docs/{name}.md") for name in NOTEBOOKS}
    for name, text in made.items():
        files.append(File.generated(config, name, content=text))
    return files


def notebook(page: Path) -> str:
    """The page as a Jupyter notebook: its Python blocks are cells of code, what is between them is text."""
    cells = []
    for number, part in enumerate(
        re.split(r"^```python\n(.*?)^```\n", page.read_text(encoding="utf-8"), flags=re.S | re.M)
    ):
        cell: dict[str, Any] = {"id": f"cell-{number}", "metadata": {}, "source": part.strip()}
        if number % 2:
            cells.append(cell | {"cell_type": "code", "execution_count": None, "outputs": []})
        elif part.strip():
            linked = _LINK.sub(lambda link: link[0].replace(f"]({link[3]}", f"]({_online(link[3])}"), part.strip())
            cells.append(cell | {"cell_type": "markdown", "source": linked})
    kernel = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
    return json.dumps({"cells": cells, "metadata": kernel, "nbformat": 4, "nbformat_minor": 5}, indent=1)


def _online(target: str) -> str:
    """Where a link of a page in docs/ leads from anywhere."""
    return target if not target or "://" in target else f"{REPOSITORY}/{normpath(f'docs/{target}')}"


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Rewrite links that leave the folder, and put records of decisions last in searches."""
    place = page.file.src_uri
    if place.startswith("decisions/"):
        page.meta["search"] = {"boost": 0.3}
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
        markdown = re.sub(r"\A(# .*\n)", rf"\1\n[This page as a notebook]({name}.ipynb){{ download }}\n", markdown)
    markdown = _PICTURE.sub(r"![\3](\2#only-light)\n![\3](\1#only-dark)", markdown)
    parts = re.split(r"(^```.*?^```)", markdown, flags=re.S | re.M)  # code stays as it is
    return "".join(part if number % 2 else _LINK.sub(link, part) for number, part in enumerate(parts))


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
