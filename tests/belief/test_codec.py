"""The codec: what it writes it reads, and what is not of the annotated type is refused by name."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from belief.codec import OPTIONAL, Merged, OneOf, Stored, array_field, array_from, from_fields, to_fields
from belief.observation_model.registry import read_observation_model, read_origin

MODELS = Path(__file__).parents[2] / "activetouch" / "models"
Half = Annotated[NDArray[np.float64], Stored("float16")]


class Colour(StrEnum):
    RED = "red"


class Pair(NamedTuple):
    low: float
    high: float = 1.0


@dataclass(frozen=True)
class Base:
    pass


@dataclass(frozen=True)
class One(Base):
    name: ClassVar[str] = "one"
    size: int = 1


@dataclass(frozen=True)
class Two(Base):
    name: ClassVar[str] = "two"


@dataclass(frozen=True, eq=False)
class Everything:
    last_in_file: ClassVar = ("whole",)

    whole: int
    real: float
    text: str
    flag: bool
    word: Literal["yes", "no"]
    colour: Colour
    place: Path
    maybe: int | None
    number_or_pair: float | tuple[float, float]
    labels: tuple[str, ...]
    counts: Mapping[str, int]
    free: Any
    ends: Pair
    merged: Annotated[Pair, Merged("end_")]
    chosen: Annotated[Base, OneOf({"one": One, "two": Two})]
    exact: NDArray[np.float64]
    half: Half
    single: Annotated[NDArray[np.float64], Stored("float32", is_decimal=True)]
    mask: NDArray[np.bool_] | None
    left_out: Annotated[float, OPTIONAL] = 0.0


WHOLE = Everything(
    whole=3,
    real=0.1,
    text="a",
    flag=True,
    word="no",
    colour=Colour.RED,
    place=Path("a/b"),
    maybe=None,
    number_or_pair=(0.5, 1.0),
    labels=("x", "y"),
    counts={"x": 2},
    free=[1, {"b": None}],
    ends=Pair(-1.0),
    merged=Pair(0.0, 2.0),
    chosen=One(5),
    exact=np.array([[0.1, 1e300]]),
    half=np.array([0.5, 2.0]),
    single=np.array([0.1], np.float32).astype(np.float64),
    mask=np.array([[True, False]]),
)


def test_what_is_written_is_read_again_through_json():
    fields = to_fields(WHOLE)
    again = from_fields(Everything, json.loads(json.dumps(fields)))
    assert json.dumps(to_fields(again)) == json.dumps(fields)
    assert list(fields)[-1] == "whole"
    assert "left_out" not in fields
    wanted = {"end_low": 0.0, "chosen": {"name": "one", "size": 5}, "single": [0.1], "mask": [[1, 0]]}
    assert {name: fields[name] for name in wanted} == wanted
    for name, value in vars(WHOLE).items():
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(getattr(again, name), value)
            assert getattr(again, name).dtype == value.dtype
        else:
            assert getattr(again, name) == value


def half_of(number):
    return array_field(np.array([number]), "float16")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("whole", 1.0, "whole must be int, got 1.0"),
        ("whole", True, "whole must be int, got True"),
        ("whole", 10**400, "whole must be int"),
        ("real", "1", "real must be float, got '1'"),
        ("real", float("nan"), "real must be float, got nan"),
        ("real", 10**400, "real must be float"),
        ("text", 1, "text must be str"),
        ("flag", 1, "flag must be bool"),
        ("word", "maybe", "word must be one of yes, no; got 'maybe'"),
        ("colour", "blue", "'blue' is not a valid Colour"),
        ("place", 3, "place must be Path, got 3"),
        ("maybe", "x", "maybe must be int, got 'x'"),
        ("number_or_pair", [0.5], "number_or_pair must be float, got .*; or number_or_pair must be tuple"),
        ("labels", "xy", "labels must be tuple, got 'xy'"),
        ("labels", ["x", 1], r"labels\[1\] must be str, got 1"),
        ("counts", {"x": "2"}, r"counts\.x must be int, got '2'"),
        ("counts", ["x"], "counts must be Mapping"),
        ("ends", [1, 2], "Pair must be a JSON object"),
        ("ends", {"high": 1.0}, "the field 'low' of Pair is missing"),
        ("chosen", {"name": "os.system"}, "unknown chosen 'os.system', known are one, two"),
        ("chosen", [], "unknown chosen"),
        ("chosen", {"name": ["one"]}, "unknown chosen"),
        ("chosen", {"name": "one", "size": "1"}, "size must be int, got '1'"),
        ("exact", [[1.0], [1.0, 2.0]], "exact: "),
        ("exact", ["1.0"], "exact: .* is no array of numbers"),
        ("exact", [None], "exact: .* is no array of numbers"),
        ("half", [0.5], "half: an array needs shape and float16"),
        ("half", {**half_of(0.5), "shape": [2]}, "half: an array of 2 bytes"),
        ("half", half_of(np.nan), "half holds a number that is not finite"),
        ("single", [1e300], "single holds a number that is not finite"),
    ],
)
def test_a_value_of_another_type_is_refused_by_name(name, value, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        from_fields(Everything, {**to_fields(WHOLE), name: value})


def test_unknown_fields_are_refused_unless_a_file_has_more_than_the_class():
    fields = {**to_fields(Pair(0.0)), "later": 1}
    assert from_fields(Pair, fields, is_whole=False) == Pair(0.0)
    with pytest.raises(ValueError, match="Pair has no field 'later'"):
        from_fields(Pair, fields)
    with pytest.raises(ValueError, match="the field 'low' of Pair is missing"):
        from_fields(Pair, {"high": 1.0})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"dtype": "|O"}, "no array of numbers"),
        ({"dtype": "<U4"}, "no array of numbers"),
        ({"shape": [1 << 40]}, "a larger one than is read"),
        ({"shape": [1] * 5}, "a larger one than is read"),
        ({"shape": [-2, -1]}, "is said to be"),
        ({"shape": [3]}, "is said to be"),
        ({"base64": "AA=="}, "is said to be"),
        ({"base64": "not base64"}, "needs dtype, shape and base64"),
        ({"dtype": None}, "needs dtype, shape and base64"),
    ],
)
def test_an_array_that_its_bytes_are_not_is_refused_before_it_takes_memory(changes, message):
    field = array_field(np.arange(2, dtype=np.uint8))
    with pytest.raises(ValueError, match=message):
        array_from({**field, **changes})


@pytest.mark.parametrize(
    "file", sorted(MODELS.glob("*/*_model.json")), ids=lambda file: f"{file.parent.name}-{file.stem}"
)
def test_a_shipped_observation_model_is_written_as_it_was_read(file):
    text = file.read_text(encoding="utf-8")
    assert read_observation_model(text).to_json(read_origin(text)) == text.strip()
