"""Names of a user's own objects: what they lead to, and what is said when they lead nowhere."""

import asyncio
import sys
from importlib.metadata import EntryPoint
from types import SimpleNamespace

import pytest

from belief.errors import CodeFailed, UnknownName
from belief.references import BadReference, ForeignCode, Reference, build

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
    (tmp_path / "own_exits.py").write_text("raise SystemExit(0)")
    (tmp_path / "own_syntax.py").write_text("1 /")
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
        ("own_broken:x", CodeFailed, "no_such_thing_anywhere"),
        ("own_raises:x", CodeFailed, r"own_raises.py, line 1: 1 / 0\nZeroDivisionError"),
        ("own_syntax:x", BadReference, "SyntaxError"),
        ("own_exits:x", CodeFailed, "own_exits.py, line 1: raise SystemExit"),
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


class Ends(BaseException):
    """What only a bare except catches."""


ENDS = (SystemExit(0), GeneratorExit(), StopIteration(), asyncio.CancelledError(), Ends("so"), ValueError("no"))


@pytest.mark.parametrize("raised", ENDS, ids=lambda raised: type(raised).__name__)
def test_every_exception_of_code_of_a_user_is_one_error_with_its_line(raised):
    def made():
        raise raised

    with pytest.raises(
        CodeFailed, match=rf"test_references.py, line \d+: raise raised\n{type(raised).__name__}"
    ) as failed:
        build("mine:made", made, {}, {})
    assert failed.value.__notes__ == ["mine:made cannot be made"]


def test_an_interrupt_and_a_fault_of_this_project_pass(monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], "__name__", "belief.test")  # this file is ours here
    for code, error in (("raise KeyboardInterrupt", KeyboardInterrupt), ("1 / 0", ZeroDivisionError)):
        with pytest.raises(error), ForeignCode("here"):
            exec(compile(code, "planners/x.py", "exec"), {"__name__": "planners.x"})


@pytest.mark.parametrize(("group", "error"), [("activetouch.deciders", CodeFailed), ("pytest11", ZeroDivisionError)])
def test_installed_code_is_that_of_a_user_if_it_is_offered_to_this_project(group, error, monkeypatch):
    offered = SimpleNamespace(entry_points=[EntryPoint("d", "plug.inner:Decider", group)])
    monkeypatch.setattr("belief.references.distributions", lambda: [offered])
    code = compile("1 / 0", "/site-packages/plug/inner.py", "exec")
    monkeypatch.setattr(sys.modules[__name__], "__name__", "belief.test")  # this file is ours here
    with pytest.raises(error), ForeignCode():
        exec(code, {"__name__": "plug.inner"})
