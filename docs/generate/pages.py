"""Pages that are generated from the code: one for each decider, scene, command and part of the API."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterable
from functools import cache
from importlib import import_module
from pathlib import Path

import shelves

from activetouch.envs import IDS, MOST_STEPS
from activetouch.named_scenes import SCENES
from activetouch.sensor_files import MODELS, POLICIES
from experiments.cli import COMMAND_GROUPS, commands
from planners.registry import DECIDERS, NEED_FILES, summary_of, trained_state

ROOT = Path(__file__).parent.parent.parent
API = {
    "belief": ("belief", "belief.synthetic", "belief.policy_state"),
    "observation models": ("belief.observation_model", "belief.observation_model.selection", "belief.touch_batch"),
    "calibration": ("belief.calibration", "belief.metrics", "belief.estimators"),
    "statistics": ("belief.statistics",),
    "planners": ("planners", "planners.session_log.AskAndTell", "planners.stopping", "planners.probing",
                 "planners.abstaining"),
    "solver": ("planners.solve",),
    "activetouch": ("activetouch", "activetouch.sensor", "activetouch.world", "activetouch.scene",
                    "activetouch.named_scenes"),
    "rendering": ("activetouch.rendering",),
    "environments": ("activetouch.envs.object_test", "activetouch.envs.object_search",
                     "activetouch.envs.batched_episodes", "activetouch.envs.touch_bank"),
}  # fmt: skip
"""Modules of the API reference, by page."""
_GIVEN = ("table", "model", "policies")


@cache
def generated() -> dict[str, str]:
    """All pages by path."""
    made = {"deciders/index.md": _deciders()}
    made |= {f"deciders/{name}.md": _decider(name) for name in DECIDERS}
    made["worlds/index.md"] = _worlds()
    made |= {f"worlds/{name}.md": _world(name) for name in SCENES}
    made["reference/commands.md"] = _commands()
    made["reference/environments.md"] = _environments()
    made["reference/layout.md"] = _layout()
    made |= {f"reference/api/{name.replace(' ', '_')}.md": _api(name, modules) for name, modules in API.items()}
    made["decisions/index.md"] = _decisions()
    return made


def table(headings: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """A Markdown table."""
    headings = list(headings)
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join("| " + " | ".join(str(cell).replace("|", r"\|") for cell in line) + " |" for line in lines)


def _deciders() -> str:
    rows = [(f"[`{name}`]({name}.md)", summary_of(name)) for name in DECIDERS]
    rest = "A name with settings in brackets makes another one: `information_gain(confirm=0.97)`."
    return f"# Deciders\n\n{table(('name', 'what it does'), rows)}\n\n{rest} [How they compare](../planners.md).\n"


def _decider(name: str) -> str:
    described = shelves.DECIDERS.get(name, shelves.NOTHING)
    settings = [
        (f"`{one.name}`", f"`{one.default!r}`")
        for one in inspect.signature(DECIDERS[name]).parameters.values()
        if one.name not in _GIVEN and one.default is not inspect.Parameter.empty
    ]
    shown = table(("setting", "default"), settings) if settings else "It has no settings."
    sensor, files, argument = _sensor_of(name), "", ""
    if name in NEED_FILES:
        files = "\nfrom activetouch.sensor_files import MODELS, POLICIES"
        argument = f', MODELS / "{sensor}" / POLICIES'
    scene = "coarse" if sensor == "coarse" else "paper"
    option = "" if sensor == scene else f" --sensor {sensor}"
    other = "information_gain" if name == "random_confirm" else "random_confirm"
    return f"""# {name}

{summary_of(name)}

## Idea

{described.idea}

## Use

```sh
activetouch compare --scene {scene}{option} --deciders {name} {other} --episodes 25
```

```python
from activetouch import TactileSensor{files}
from planners import make_decider

model = TactileSensor.shipped("{sensor}").model
decider = make_decider("{name}", model.outcome_table(), model{argument})
```

{shown}

## What its scores mean

{described.scores}

## What it is bad at

{described.weak}

## Beside the others

![Every decider: return, success, touches and time per decision](../planners/deciders.svg)

`python benchmarks/deciders.py --episodes 400 --trees 40 20 0`;
[table and text](../planners.md#comparison-of-all-deciders).
"""


def _sensor_of(name: str) -> str:
    """The shipped sensor that has the policies of a decider; coarse for one without policies."""
    state = trained_state(name)
    there = any((MODELS / "coarse" / POLICIES).glob(f"{state}[-.]*"))
    return "coarse" if state is None or there else "paper-independent"


def _world(name: str) -> str:
    described, named = shelves.WORLDS.get(name, shelves.NOTHING), SCENES[name]
    scene = named.scene
    fields = {
        "objects of a search": f"{named.num_objects}, {named.composition.value}",
        "shapes": ", ".join(scene.shape_labels),
        "poses": ", ".join(scene.pose_labels),
        "image": " × ".join(map(str, scene.image_shape)),
        "renderer": f"`{scene.renderer!r}`",
        "press": f"`{type(scene.press_model).__name__}`",
        "faults of the sensor": ", ".join(f"`{fault!r}`" for fault in scene.faults) or "none",
        "size": f"`{scene.variation.size!r}`",
        "force [N]": f"`{scene.variation.force!r}`",
    }
    sensors = sorted(path.name for path in (ROOT / "activetouch/models").glob(f"{name}*") if path.is_dir())
    figure = "![Four shapes in six poses, as three sensors show them](../gallery.png)"
    return f"""# {name}

## Idea

{described.idea}

## What it is

{table(("", ""), fields.items())}

Sensors that come with it: {", ".join(f"`{sensor}`" for sensor in sensors)}.
`activetouch explain --scene {name}` lists all that it models.

## Use

```sh
activetouch compare --scene {name} --episodes 25
```

```python
from activetouch import SCENES, TactileSensor

scene = SCENES["{name}"].scene
sensor = TactileSensor.shipped("{name}")
```

## What results here mean

{described.scores}

## What it is bad at

{described.weak}

## Figure

{figure}

`activetouch touch --all --seed 4 --out docs/gallery.png` draws it.
[All scenes](../world.md#scenes), [results](../results.md).
"""


def _worlds() -> str:
    rows = []
    for name, named in SCENES.items():
        image, described = " × ".join(map(str, named.scene.image_shape)), shelves.WORLDS.get(name, shelves.NOTHING)
        objects = f"{named.num_objects}, {named.composition.value}"
        rows.append((f"[`{name}`]({name}.md)", objects, len(named.scene.shape_labels), image, described.idea))
    return f"# Worlds\n\n{table(('scene', 'objects of a search', 'shapes', 'image', 'idea'), rows)}\n"


def _environments() -> str:
    lines, rows = [], []
    for name, (place, settings) in IDS.items():
        if settings:
            rows.append((f"`{name}`", f"The environment above with {settings}."))
            continue
        module, _, kind = place.partition(":")
        text = _plain(inspect.cleandoc(getattr(import_module(module), kind).__doc__ or ""))
        rows.append((f"`{name}`", text.partition("\n")[0]))
        lines += [f"## {name.partition('/')[2]}", "", re.sub(r"^##", "###", text, flags=re.M), ""]
    first = table(("id", "task"), rows)
    words = f"`max_episode_steps` is {MOST_STEPS}; episodes end by their own touch limit. [More](../environments.md)."
    return "\n".join(["# Environments, from the code", "", first, "", words, "", *lines])


def _layout() -> str:
    rows = []
    for package in ("belief", "planners", "activetouch", "experiments"):
        for folder in sorted({file.parent for file in (ROOT / package).rglob("*.py")}):
            text = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))) or ""
            rows.append((f"`{folder.relative_to(ROOT).as_posix()}/`", _plain(text.partition("\n")[0])))
    words = (
        "Each folder holds one thing that a user does or one part of the method. [How they depend](../architecture.md)."
    )
    return f"# Layout, from the code\n\n{words}\n\n{table(('folder', 'contents'), rows)}\n"


def _commands() -> str:
    lines, classes = ["# Commands, from the code", ""], commands()
    for group, entries in COMMAND_GROUPS.items():
        lines += [f"## {group}", ""]
        for name, entry in entries.items():
            text = inspect.cleandoc(classes[name].__doc__ or "")
            text = re.sub(r"For example:\n\n((?:    .*\n?|\n)+)", _fenced, text)
            lines += [f"### {name}", "", f"*{entry.summary}*", "", _plain(text), ""]
    return "\n".join(lines)


def _fenced(found: re.Match[str]) -> str:
    return f"For example:\n\n```sh\n{inspect.cleandoc(found[1])}\n```\n"


def _plain(text: str) -> str:
    return re.sub(r":\w+:`~?([^`]+)`", r"`\1`", text.replace("``", "`"))


def _api(name: str, modules: Iterable[str]) -> str:
    return f"# {name.capitalize()}\n\n" + "\n\n".join(f"## `{module}`\n\n::: {module}" for module in modules) + "\n"


def _decisions() -> str:
    rows = []
    for number, path in sorted(records_of_decisions().items()):
        title = path.read_text(encoding="utf-8").partition("\n")[0].lstrip("# ")
        rows.append((number, f"[{re.sub(r'^[0-9]{4}: *', '', title)}]({path.name})"))
    words = (
        "What was chosen and why. A record may hold several decisions on one subject; each number leads to its record. "
        "`git show 1784ad92:docs/decisions/` has the longer records of the time of each decision."
    )
    return f"# Decisions\n\n{words}\n\n{table(('', ''), rows)}\n"


def records_of_decisions() -> dict[str, Path]:
    """The record of each decision, by number: that of its file, and those of its line "Also decisions"."""
    found = {}
    for path in sorted((ROOT / "docs/decisions").glob("0*.md")):
        also = re.search(r"^Also decisions? (.*)\.$", path.read_text(encoding="utf-8"), re.M)
        for number in (path.name[:4], *(also[1].split(", ") if also else ())):
            if number in found:
                raise ValueError(f"decision {number} is in {found[number].name} and in {path.name}")
            found[number] = path
    return found
