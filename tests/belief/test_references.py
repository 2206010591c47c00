"""Names of a user's own objects: what they lead to, and what is said when they lead nowhere."""

import sys

import pytest

from belief.errors import UnknownName
from belief.references import BadReference, Reference, build

SOURCE = """
finished = 7
class TwoLooks:
    def __init__(self, touches=2, table=None): self.touches, self.table = touches, table
class Inner:
    made = TwoLooks
def needs(first, second): return first, second
"""


def make(text, **offered):
    reference = Reference.parse(text)
    return build(reference.name, reference.load(), reference.settings, offered, reference.is_called)


@pytest.fixture
def module(tmp_path, monkeypatch):
    (tmp_path / "own_looks.py").write_text(SOURCE)
    (tmp_path / "own_broken.py").write_text("import no_such_thing_anywhere")
    (tmp_path / "own_raises.py").write_text("1 / 0")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield
    for name in [name for name in sys.modules if name.startswith("own_")]:
        del sys.modules[name]


@pytest.mark.usefixtures("module")
def test_a_name_leads_to_an_object_of_the_working_folder():
    assert make("own_looks:finished") == 7
    assert make("own_looks:TwoLooks").touches == 2
    made = make("own_looks:Inner.made(touches=4)", table="given", model="not asked for")
    assert (made.touches, made.table) == (4, "given")


@pytest.mark.parametrize(
    "text",
    [
        *("", "a b", "mine:", "1:a", "mine:x(", "mine:x(3)", "mine:x(a=b)", "mine:x(**{})", "x(a=1", "x(a=1)y", ":a"),
        *("x(a=1)(b=2)", "x(a=1, a=2)"),
    ],
)
def test_what_is_no_name_is_refused(text):
    with pytest.raises(BadReference):
        Reference.parse(text)


@pytest.mark.usefixtures("module")
@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("own_missing:x", BadReference, "own_missing.py"),
        ("own_broken:x", BadReference, "no_such_thing_anywhere"),
        ("own_raises:x", BadReference, "ZeroDivisionError"),
        ("own_looks:TwoLook", UnknownName, "TwoLooks"),
        ("own_looks:TwoLooks(touch=1)", BadReference, "touches"),
        ("own_looks:finished(a=1)", BadReference, "settings"),
        ("own_looks:needs(first=1)", BadReference, "second"),
    ],
)
def test_what_leads_nowhere_says_why(text, error, words):
    with pytest.raises(error, match=words):
        make(text)


def test_a_function_that_takes_all_settings_gets_them():
    assert build("f", lambda known, **rest: (known, rest), {"a": 1}, {"known": 2, "other": 3}) == (2, {"a": 1})
