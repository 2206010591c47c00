"""Constraints in annotations: what breaks one is refused by name, what keeps it is not changed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction as Ratio
from typing import Annotated, Literal

import numpy as np
import pytest

from belief.constraints import (
    Checked,
    Count,
    CountOrNone,
    Finite,
    Fraction,
    NotEmpty,
    NotNegative,
    Positive,
    Probability,
    Share,
    Within,
    check,
)
from belief.errors import InvalidArgument

_HUGE = 10**400


@dataclass(frozen=True)
class Settings(Checked):
    count: Count = 1
    whole: CountOrNone = 0
    few: Annotated[int, Within(1, 3)] = 2
    positive: Positive = 1.0
    not_negative: NotNegative = 0.0
    finite: Finite = -1e300
    probability: Probability = 0.0
    fraction: Fraction = 0.5
    share: Share = 1.0
    limit: Annotated[float, Within(1.0, math.inf, open_low=True)] = math.inf
    maybe: Count | None = None
    kind: Literal["body", "shape"] = "body"
    several: Annotated[tuple[float, ...], NotEmpty(), Within(0.0, 1.0)] = (0.5,)
    one_or_two: Annotated[float | tuple[float, float], Within(0.0, 1.0)] = 0.5
    free: object = None


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("count", [1, 2**53, np.int64(4), np.uint8(200)]),
        ("whole", [0]),
        ("positive", [1, 5e-324, np.float32(0.1), Ratio(1, 3), 1e308, 10**300]),
        ("probability", [0, 1, 0.0, 1.0, np.float16(0.5)]),
        ("limit", [math.inf, 1.5]),
        ("maybe", [None, 3]),
        ("several", [(0.0, 1.0), [0.5]]),
        ("one_or_two", [0.1, (0.1, 0.9)]),
        ("free", ["anything", math.nan]),
    ],
)
def test_a_value_within_its_range_is_kept_as_it_is(name, values):
    for value in values:
        assert getattr(Settings(**{name: value}), name) is value


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        *[("count", wrong, "an integer, at least 1") for wrong in (0, -1, 1.0, True, None, "1", math.nan, np.array(1))],
        ("count", 2**53 + 1, "an integer, at least 1 and at most 9007199254740992"),
        ("few", 4, "an integer, at least 1 and at most 3, got 4"),
        ("few", _HUGE, "an integer, at least 1 and at most 3"),
        *[("positive", wrong, "a finite number > 0") for wrong in (0.0, math.inf, math.nan, True, None, _HUGE, 1j)],
        ("not_negative", -5e-324, "a finite number ≥ 0, got -5e-324"),
        *[("finite", wrong, "a finite number, got") for wrong in (math.inf, -math.inf, math.nan, _HUGE, "0")],
        ("probability", 1.5, r"a number in \[0, 1\], got 1.5"),
        ("fraction", 1.0, r"a number in \(0, 1\), got 1.0"),
        ("share", 0.0, r"a number in \(0, 1\], got 0.0"),
        ("limit", 1.0, "a number > 1, got 1.0"),
        ("maybe", 0, "an integer, at least 1, got 0"),
        ("kind", "world", "one of body, shape; got 'world'"),
        ("several", (0.5, 2.0), r"a number in \[0, 1\], got 2.0"),
        ("several", 0.5, "a tuple, got 0.5"),
        ("one_or_two", (0.5, math.nan), r"a number in \[0, 1\], got nan"),
    ],
)
def test_a_value_out_of_its_range_is_refused_by_name(name, value, message):
    with pytest.raises(InvalidArgument, match=f"^{name} must be {message}"):
        Settings(**{name: value})


def test_an_empty_tuple_is_refused_where_one_is_needed_and_the_error_is_of_the_wanted_class():
    class Unfit(Exception):
        pass

    settings = Settings()
    object.__setattr__(settings, "several", ())
    with pytest.raises(Unfit, match=r"^several must name at least one, got none$"):
        check(settings, Unfit)
