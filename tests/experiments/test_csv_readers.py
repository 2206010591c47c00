"""Whatever a CSV file holds, a reader of it gives every row or says which line it cannot read."""

import itertools
import random
from pathlib import Path

import pytest

from activetouch.recorded.formats import read_recorded
from belief import columns
from belief.columns import csv_rows
from belief.errors import ActiveTouchError, InvalidArgument
from experiments.search.results import compare_results


def recorded(folder):
    touches, _ = read_recorded(folder, "csv")
    return len(touches.features), {*touches.object_names}


def results(folder):
    found = compare_results([folder / "a.csv"])
    return len(found.keys), {task for task, _ in found.keys}


READERS = {
    "recorded touches": (recorded, "object,x,y,z\nmug,1,2,3\nmug,2,3,4\ncup,3,4,5\n"),
    "recorded touches, object last": (recorded, "x,y,object\n1,2,mug\n2,3,mug\n3,4,cup\n"),
    "results": (results, "task,seed,success,note\nmug,1,1,hi\nmug,2,0,ho\ncup,1,1,he\n"),
    "results, note first": (results, "note,success,seed,task\nhi,1,1,mug\nho,0,2,mug\nhe,1,1,cup\n"),
}
ODD = ["\0", "\v", "\f", "\x1a", "\x1c", "\x1e", "\x85", "\u2028", "\u2029", "\ufeff"]


def read(reader, folder, text):
    """What a reader finds, or None where it refuses the file."""
    (folder / "a.csv").write_bytes(text.encode())
    try:
        return reader(folder)
    except ActiveTouchError as error:
        assert str(folder) in str(error)  # noqa: PT017
        return None


@pytest.mark.parametrize("name", READERS)
def test_quotation_marks_anywhere_hide_no_row(name, tmp_path):
    reader, text = READERS[name]
    assert read(reader, tmp_path, text) == (3, {"mug", "cup"})
    pairs = list(itertools.combinations(range(len(text) + 1), 2))
    for first, second in [*random.Random(0).sample(pairs, 120), *((i, len(text)) for i in range(len(text)))]:
        spoilt = f'{text[:first]}"{text[first:second]}"{text[second:]}'
        assert (read(reader, tmp_path, spoilt) or [3])[0] == 3
    for first in range(len(text)):
        assert (read(reader, tmp_path, f'{text[:first]}"{text[first:]}') or [3])[0] == 3


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("odd", ODD, ids=map(ascii, ODD))
def test_a_character_that_ends_a_line_or_a_text_elsewhere_is_named(name, odd, tmp_path):
    reader, text = READERS[name]
    for place in ("mug", "cup"):
        for spoilt in (f"{place}{odd}", f"{odd}{place}"):
            (tmp_path / "a.csv").write_bytes(text.replace(place, spoilt).encode())
            with pytest.raises(ActiveTouchError, match=rf"line \d holds the character U\+{ord(odd):04X}"):
                reader(tmp_path)


SPOILT = {
    "a row is cut short": (lambda header, *rows: [header, *rows, "mug"], "line 5 of .* has 1 cells, the header has 4"),
    "a column is there twice": (lambda header, *rows: [f"{line},{line}" for line in (header, *rows)], "' 2 times"),
    "a column is missing": (
        lambda header, *rows: [header.replace("object", "it").replace("task", "it"), *rows],
        "no col",
    ),
    "it is no text": (lambda *lines: [*lines, "\udcff"], "is not text in UTF-8, save it as such"),
    "a line is too long": (lambda *lines: [*lines, "c" * 101], "line 5 of .* has more than 100 characters"),
    "there are too many rows": (lambda header, *rows: [header, *rows[:1] * 6], "holds more than 5 rows"),
    "there are too many lines": (lambda *lines: [*lines, *[""] * 9], "holds more than .* 10 lines"),
}


@pytest.mark.parametrize("name", ["recorded touches", "results"])
@pytest.mark.parametrize("kind", SPOILT)
def test_every_reader_of_columns_refuses_the_same_with_the_file_and_the_place(kind, name, tmp_path, monkeypatch):
    monkeypatch.setattr(columns, "_LONGEST_LINE", 100)
    monkeypatch.setattr(columns, "MOST_ROWS", 5)
    (reader, text), (spoil, said) = READERS[name], SPOILT[kind]
    assert read(reader, tmp_path, text) == (3, {"mug", "cup"})
    (tmp_path / "a.csv").write_bytes("\n".join(spoil(*text.splitlines())).encode(errors="surrogateescape"))
    with pytest.raises(ActiveTouchError, match=said) as refused:
        reader(tmp_path)
    assert str(tmp_path / "a.csv") in str(refused.value)


def test_columns_are_read_in_one_place():
    root = Path(__file__).parents[2]
    calls = ("csv.reader(", "csv.DictReader(", "gzip.open", "genfromtxt(", "loadtxt(", "csv_rows(")
    files = [
        file for name in ("activetouch", "belief", "planners", "experiments") for file in (root / name).rglob("*.py")
    ]
    found = {file.relative_to(root).as_posix() for file in files if any(call in file.read_text() for call in calls)}
    assert found == {"belief/columns.py"}


def test_a_cell_may_hold_lines_that_are_no_rows(tmp_path):
    text = 'task,seed,success,note\nmug,1,1,"slipped, then\nheld"\r\n\nmug,2,0,"he said ""no"""\n'
    assert read(results, tmp_path, text) == (2, {"mug"})
    assert [line for line, _ in csv_rows(text.splitlines(keepends=True))] == [1, 2, 5]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('a,b\n1,"2\n3,4\n', "line 2 is not CSV: unexpected end of data .is a quotation mark not closed"),
        ('a,b\n1,"2\n3,4"\n5,6\n', "line 2: a quotation mark is not closed before the rows below it"),
        ('a,"b\n1,2\n3,4"\n', "line 1: a quotation mark is not closed before"),
        ('a,b\n1,2"\n3,"4"5\n', "line 3 is not CSV: ',' expected after"),
    ],
)
def test_the_line_in_which_a_quotation_mark_is_wrong_is_named(text, said):
    with pytest.raises(InvalidArgument, match=said):
        list(csv_rows(text.splitlines(keepends=True)))
