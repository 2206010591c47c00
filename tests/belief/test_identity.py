"""The digest of what defines an object changes with its source, and with nothing else."""

import importlib
import sys

import pytest

from belief.identity import source_digest

SOURCE = "class Base:\n    edge = 1\n"
CHILD = "from own_base import Base\n\nclass Child(Base):\n    touches: int = 2\n\ndef work():\n    return 1\n"


@pytest.fixture
def modules(tmp_path, monkeypatch):
    """A folder for modules of a user's own, and a function that writes and imports one."""
    monkeypatch.syspath_prepend(tmp_path)

    def module(name, source):
        (tmp_path / f"{name}.py").write_text(source)
        sys.modules.pop(name, None)
        importlib.invalidate_caches()
        return importlib.import_module(name)

    yield module
    for name in ("own_base", "own_child"):
        sys.modules.pop(name, None)


def test_an_edited_module_gives_another_digest_and_an_equal_one_the_same(modules):
    modules("own_base", SOURCE)
    first = source_digest(modules("own_child", CHILD).Child())
    assert source_digest(modules("own_child", CHILD).Child) == first
    assert source_digest(modules("own_child", CHILD.replace("= 2", "= 6")).Child()) != first


def test_an_edited_base_class_gives_another_digest(modules):
    modules("own_base", SOURCE)
    first = source_digest(modules("own_child", CHILD).Child)
    modules("own_base", SOURCE.replace("1", "2"))
    assert source_digest(modules("own_child", CHILD).Child) != first


def test_a_function_and_a_class_of_one_module_differ(modules):
    modules("own_base", SOURCE)
    child = modules("own_child", CHILD)
    assert source_digest(child.work) != source_digest(child.Child)


def test_without_a_source_file_the_compiled_code_is_taken():
    def made(text):
        space = {"__name__": "typed_in"}
        exec(f"class Decider:\n    touches = {text}\n    def decide(self):\n        return {text}\n", space)
        return space["Decider"]

    assert source_digest(made("2")) == source_digest(made("2"))
    assert source_digest(made("2")) != source_digest(made("6"))


def test_a_class_typed_in_again_has_the_same_digest_and_an_edited_one_another():
    text = """
import functools
class Typed:
    edge: int = 1
    def method(self, much=2, *, more=3):
        return [one + 4 for one in {5, 6}]
    @property
    def wide(self):
        return 7
    @functools.cached_property
    def kept(self):
        return 8
    @staticmethod
    def alone():
        return 9
"""

    def digest(source):
        space = {"__name__": "typed_in"}
        exec(source, space)
        return source_digest(space["Typed"])

    edited = [digest(text.replace(str(number), "99")) for number in range(1, 10)]
    assert digest(f"# a comment\n{text}") == digest(text)
    assert len({digest(text), *edited}) == 10
