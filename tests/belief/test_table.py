"""A table holds the same in a terminal of any width, in a notebook, in LaTeX, and as records."""

import html
import re
import unicodedata

import pytest

from belief.observation_model.selection import ModelChoice
from belief.table import Table, ends, interval

LABELS = ["cone", "杯子と皿", "a\tb\x1b[31m\nc\0", "50% & {more}_$#~^\\", "<b>bold</b>", "x" * 90, "", "two words " * 9]
TABLE = Table(
    "<title> & more",
    ["label", ("share", ".2f"), ("95 %", ".1f"), ("a heading of several words", "d", "count"), ("remark", "")],
    [("all labels",), *((label, 0.5, (0.25, 1.0), 7, label) for label in LABELS), ("none", None, None, None, "–")],
    "A note that is much longer than a narrow terminal is wide.",
)


def places(line):
    """Width of a line on a terminal."""
    return sum(1 + (unicodedata.east_asian_width(one) in "WF") for one in line)


@pytest.mark.parametrize("width", [1, 20, 40, 80, 1000])
def test_a_table_fits_any_terminal_and_loses_nothing(width):
    lines = TABLE.text(width).splitlines()
    assert max(map(places, lines)) <= max(width, 16)  # five columns of one character, or two of a wide one
    assert not any(unicodedata.category(one) == "Cc" for line in lines for one in line)
    printed = sorted("".join(lines).replace(" ", "").replace("─", ""))
    shown = [
        TABLE.title,
        *TABLE.headings,
        "all labels",
        *(part for row in TABLE.cells()[1:] for part in row),
        TABLE.note,
    ]
    assert printed == sorted(one for part in shown for one in part if one != " " and unicodedata.category(one) != "Cc")


def test_records_name_an_interval_after_its_number_and_latex_and_html_escape_every_label():
    heading, first, *_, none = TABLE.records()
    assert heading == dict.fromkeys(first) | {"label": "all labels"}
    assert first == {"label": "cone", "share": 0.5, "share_low": 0.25, "share_high": 1.0, "count": 7, "remark": "cone"}
    assert none["share_low"] is None
    latex = TABLE.latex()
    body = [line for line in latex.splitlines() if line.endswith(r"\\") and not line.startswith(r"\multicolumn")]
    assert [len(re.findall(r"(?<!\\)&", line)) for line in body] == [4] * (len(LABELS) + 2)
    assert r"50\% \& \{more\}\_\$\#\textasciitilde{}\textasciicircum{}\textbackslash{}" in latex
    cells = re.findall(r"<t[hd] [^>]*>(.*?)</t[hd]>", TABLE.html(), re.S)
    assert [html.unescape(cell) for cell in cells] == [
        *TABLE.headings,
        *(cell for row in TABLE.cells() for cell in row),
    ]
    assert "<b>" not in TABLE.html()


def test_a_table_without_rows_has_its_headings_and_one_of_one_column_no_sections():
    assert Table("", ["a", ("b", "d")], []).text(9) == "a  b\n────"
    assert Table("", ["a"], [("x",), ("y",)]).text(9).split() == ["a", "─", "x", "y"]
    assert Table("", ["a", ("b", "d")], []).csv() == "a,b\n"


def test_a_choice_prints_shows_and_gives_its_losses():
    choice = ModelChoice("ratio", None, {"plda": 0.2, "ratio": 0.1})
    assert {row["observation_model"]: row["nll"] for row in choice.rows()} == choice.losses
    assert [row["chosen"] for row in choice.rows()] == ["yes", ""]
    assert all(name in text for name in choice.losses for text in (str(choice), choice._repr_html_()))
    assert choice.to_latex().count(r"\\") == 3


@pytest.mark.parametrize(
    ("low", "high", "spec", "expected"),
    [
        (0.9961731, 1.0, ".2f", ("0.996", "1.000")),
        (0.9999617, 1.0, ".3f", ("0.99996", "1.00000")),
        (0.0, 0.0000384, ".3f", ("0.00000", "0.00004")),
        (0.50012, 0.50031, ".2f", ("0.5001", "0.5003")),
        (-0.001, 0.002, "+.2f", ("-0.001", "+0.002")),
        (0.25, 0.75, ".2f", ("0.25", "0.75")),
        (0.5, 0.5, ".2f", ("0.50", "0.50")),
        (0.5, 0.5 + 1e-15, ".2f", ("0.50", "0.50")),
        (3, 4, "d", ("3", "4")),
    ],
)
def test_the_ends_of_an_interval_are_told_apart_wherever_it_is_printed(low, high, spec, expected):
    assert ends(low, high, spec) == expected
    assert interval(1, low, high, spec=spec).endswith(f" [{expected[0]}, {expected[1]}]")
    table = Table("", ["name", ("95 %", spec)], [("a", (low, high))])
    assert f"{expected[0]} … {expected[1]}" in table.text(80)
    assert f"{expected[0]} … {expected[1]}" in table.html()
