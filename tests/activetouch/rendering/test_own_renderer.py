"""A renderer or a shape that breaks the rules is refused at once, and told what the rule is."""

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from activetouch import Quasistatic, Scene
from activetouch.distributions import Constant
from activetouch.errors import WrongRenderer
from activetouch.pressing.contact import Pad
from activetouch.rendering import Gain, PressureRenderer
from activetouch.scene import Variation
from belief.errors import ActiveTouchError, InvalidArgument


@dataclass(frozen=True)
class Own:
    """Spoils the images of a good renderer."""

    isotropic: ClassVar[bool] = True
    how: str

    def __call__(self, contact):
        image = PressureRenderer()(contact)
        return {
            "as bytes": lambda: np.rint(255 * image).astype(np.uint8),
            "times 255": lambda: 255 * image,
            "negative": lambda: image - 0.5,
            "NaN": lambda: np.where(image > 0.0, np.nan, image),
            "infinite": lambda: np.where(image > 0.0, np.inf, image),
            "a list": lambda: image.tolist(),
            "nothing": lambda: None,
            "a row": lambda: image[0],
            "not square": lambda: image[1:],
            "four colours": lambda: np.stack([image] * 4, axis=2),
            "empty": lambda: image[:0, :0],
        }[self.how]()


def pressed(renderer):
    scene = Scene(pad=Pad(num_taxels=16), press_model=Quasistatic(), renderer=renderer)
    rng = np.random.default_rng(0)
    return scene.press(scene.sample_object(0, rng), 0, rng)


@pytest.mark.parametrize(
    ("how", "told"),
    [
        ("as bytes", "an array of uint8; divide by 255"),
        ("times 255", "divide by 255"),
        ("negative", "from -0.5 to"),
        ("NaN", "from nan to nan"),
        ("infinite", "to inf"),
        ("a list", "a list"),
        ("nothing", "a NoneType"),
        ("a row", r"shape \(16,\)"),
        ("not square", r"shape \(15, 16\)"),
        ("four colours", r"shape \(16, 16, 4\)"),
        ("empty", r"shape \(0, 0\)"),
    ],
)
def test_what_is_no_image_is_refused_with_the_rule(how, told):
    with pytest.raises(WrongRenderer, match=rf"(?s){told}.*floating-point images in \[0, 1\]") as caught:
        pressed(Own(how))
    assert ("divide by 255" in str(caught.value)) == ("255" in told)  # where that would help, and only there


def test_an_image_beyond_full_scale_saturates():
    stiff = Variation(stiffness=Constant(2.0), force=Constant(60.0))
    scene = Scene(pad=Pad(num_taxels=16), press_model=Quasistatic(), variation=stiff, faults=())
    rng = np.random.default_rng(0)
    contact, image, *_ = scene.press(scene.sample_object(1, rng), 0, rng)
    assert scene.renderer(contact).max() > 1.0
    assert image.max() == 255


@pytest.mark.parametrize("renderer", ["pressure", None, 3, PressureRenderer, lambda contact: contact.pressure])
def test_what_is_no_renderer_is_refused_when_the_scene_is_made(renderer):
    with pytest.raises(WrongRenderer):
        Scene(renderer=renderer)


@pytest.mark.parametrize("shape", [3, None, np.zeros((3, 3)), "cube.step", "nowhere.stl", Path("nowhere.stl")])
def test_what_is_no_shape_is_refused_when_the_scene_is_made(shape):
    with pytest.raises((ActiveTouchError, FileNotFoundError), match=r"mesh file|nowhere|\.stl"):
        Scene(shapes={"a": shape})


class Undirected:
    def __call__(self, image, rng):
        return image


@pytest.mark.parametrize(
    "faults", [Gain(0.1), (Gain,), (0.1,), (Undirected(),), (SimpleNamespace(isotropic=True),), None]
)
def test_what_are_no_faults_is_refused_when_the_scene_is_made(faults):
    with pytest.raises(InvalidArgument, match="fault"):
        Scene(faults=faults)


@pytest.mark.parametrize(
    "wrong",
    [
        *[{"half_width": np.nan}, {"half_width": 15.0}, {"half_thickness": 7.0}, {"stiffness": 0.0}],
        *[{"stiffness": 14.5}, {"max_depth": np.inf}, {"max_depth": 3.0}, {"contact_time": 40.0}],
    ],
)
def test_lengths_and_stiffness_of_a_pad_are_those_of_some_pad(wrong):
    with pytest.raises(ValueError, match=r"must be a number in \[.*\] (m|s|N/m³), got"):
        Pad(**wrong)


@pytest.mark.parametrize("number", [0, 16.5, 16.0])
def test_a_pad_has_a_whole_number_of_taxels(number):
    with pytest.raises(ValueError, match="num_taxels must be an integer"):
        Pad(num_taxels=number)
