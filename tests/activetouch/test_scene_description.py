"""A scene as fields: equal scenes are told by equal ones, and every difference has its name and its weight."""

import importlib
import json
import sys
from dataclasses import dataclass, replace

import numpy as np
import pytest

from activetouch import POSES, SCENES, SHAPES, Scene
from activetouch.distributions import Uniform
from activetouch.errors import WrongScene
from activetouch.orientations import Upright
from activetouch.pressing.contact import Pad
from activetouch.pressing.dynamic import GuardedMove
from activetouch.rendering import GelSightRenderer, Noise, PressureRenderer
from activetouch.scene import Variation
from activetouch.scene_description import require_scene, scene_differences, scene_fields
from activetouch.shapes import Mesh
from activetouch.solids.primitives import Box
from belief.files import sealed_json, unsealed_json

GEL = Scene()
CORNERS = np.array([[0, 0, 0], [0.02, 0, 0], [0, 0.02, 0], [0, 0, 0.02]], float)
TETRAHEDRON = Mesh("mug", CORNERS, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))

REFUSED = {
    "a pad of fewer taxels": (replace(GEL, pad=Pad(num_taxels=32)), "pad.num_taxels is 32, not 128"),
    "another renderer": (replace(GEL, renderer=GelSightRenderer()), "renderer is GelSightRenderer, not Pressure"),
    "coarser images": (replace(GEL, renderer=PressureRenderer(8)), "renderer.binning is 8, not 1"),
    "another size of a shape": (replace(GEL, shapes={**SHAPES, "cube": Box((0.01,) * 3)}), "shapes.cube.half_extents"),
    "a mesh for a shape": (replace(GEL, shapes={**SHAPES, "cone": TETRAHEDRON}), "shapes.cone is Mesh, not Cone"),
    "a pose of another name": (replace(GEL, poses={**dict(list(POSES.items())[:5]), "k": POSES["corner"]}), "poses is"),
}
SHIFTED = {
    "another fidelity": (replace(GEL, press_model=GuardedMove()), "press_model is GuardedMove, not Dynamic"),
    "more noise": (replace(GEL, faults=(GEL.faults[0], Noise(0.5))), "faults.1.std is 0.5, not 0.02"),
    "upright objects": (replace(GEL, presentation=Upright()), "presentation is Upright, not Tumbled"),
    "other sizes": (replace(GEL, variation=Variation(size=Uniform(0.9, 1.2))), "variation.size.high is 1.2, not 1.1"),
}
SAME = {
    "the same": Scene(),
}


@pytest.mark.parametrize("name", list(SCENES))
def test_fields_of_a_scene_survive_a_file(name):
    told = scene_fields(SCENES[name].scene)
    assert json.loads(json.dumps(told, allow_nan=False)) == told
    assert unsealed_json(sealed_json(told)) == told
    assert scene_differences(told, scene_fields(SCENES[name].scene)) == ()


@pytest.mark.parametrize("what", REFUSED)
def test_a_scene_with_other_images_is_refused_unless_anyway(what):
    other, told = REFUSED[what]
    with pytest.raises(WrongScene) as error:
        require_scene("the sensor", scene_fields(GEL), scene_fields(other))
    assert told in str(error.value)
    assert any(
        told in text for text in require_scene("the sensor", scene_fields(GEL), scene_fields(other), anyway=True)
    )


@pytest.mark.parametrize("what", SHIFTED)
def test_a_known_shift_is_told_and_not_refused(what):
    other, told = SHIFTED[what]
    assert told in require_scene("the sensor", scene_fields(GEL), scene_fields(other))[0]


@pytest.mark.parametrize("what", SAME)
def test_what_changes_no_touch_is_no_difference(what):
    assert require_scene("the sensor", scene_fields(GEL), scene_fields(SAME[what])) == ()


def test_rounding_of_another_processor_makes_no_difference():
    shaken = {name: pose * (1 + 1e-15) for name, pose in POSES.items()}
    assert scene_fields(replace(GEL, poses=shaken)) == scene_fields(GEL)
    named = replace(TETRAHEDRON, name="cup", vertices=TETRAHEDRON.vertices + 1e-14)
    assert scene_fields(replace(GEL, shapes={"a": named})) == scene_fields(replace(GEL, shapes={"a": TETRAHEDRON}))


@pytest.fixture
def own_module(tmp_path, monkeypatch):
    """Writes a module of the user's own and imports it anew."""
    monkeypatch.syspath_prepend(tmp_path)

    def module(source):
        (tmp_path / "own_renderer.py").write_text(source)
        sys.modules.pop("own_renderer", None)
        importlib.invalidate_caches()
        return importlib.import_module("own_renderer")

    yield module
    sys.modules.pop("own_renderer", None)


@pytest.mark.parametrize("kind", ["a dataclass", "a class", "a function"])
def test_an_edited_renderer_of_the_users_own_makes_another_scene(own_module, kind):
    head = "from dataclasses import dataclass\n@dataclass(frozen=True)\n"
    body = "    def __call__(self, contact):\n        return 0.5 * contact.pressure\n"
    sources = {
        "a dataclass": f"{head}class Own:\n    gain: float = 1.0\n{body}",
        "a class": f"class Own:\n    def __init__(self):\n        self.gain = 1.0\n{body}",
        "a function": "def own(contact):\n    return 0.5 * contact.pressure\n\ndef Own():\n    return own\n",
    }

    def described(source):
        renderer = own_module(source).Own()
        return {**scene_fields(GEL), "renderer": scene_fields(_Holder(renderer))["renderer"]}

    first = described(sources[kind])
    assert described(sources[kind]) == first
    with pytest.raises(WrongScene, match="renderer"):
        require_scene("the sensor", first, described(sources[kind].replace("0.5", "0.7")))


@dataclass(frozen=True)
class _Holder:
    renderer: object


@pytest.mark.parametrize("size", [4, 5000])
@pytest.mark.parametrize("kind", [float, bool, str, object])
def test_one_number_in_an_array_of_any_kind_is_a_difference(kind, size):
    class Own:
        def __init__(self, table):
            self.table = table

    one = np.zeros(size).astype(kind)
    other = one.copy()
    other[size // 2] = kind(1) if kind is not object else 1.0
    first, again, second = (scene_fields(_Holder(Own(table))) for table in (one, one.copy(), other))
    assert first == again
    (found,) = scene_differences(first, second)
    assert found.path.startswith("renderer.table")
    json.dumps(first, allow_nan=False)
