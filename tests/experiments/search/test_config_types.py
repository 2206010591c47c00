"""A run.json that was changed and sealed anew is a clear error or works, whatever types it holds."""

import pytest

from belief.errors import ActiveTouchError
from belief.files import sealed_json
from experiments.scene_choice import SceneChoice
from experiments.search.compare import Compare
from experiments.search.play import Setting
from experiments.search.replay import Replay
from experiments.search.run import Run, RunFolder

pytestmark = [pytest.mark.torch, pytest.mark.mujoco]
WRONG = [None, {}, [[]], "x", 1.5, 10**400, True]


def paths(fields, before=()):
    """The path of every value in nested dictionaries."""
    for name, value in fields.items():
        yield (*before, name)
        if isinstance(value, dict):
            yield from paths(value, (*before, name))


def changed(fields, path, value):
    name, *rest = path
    return {**fields, name: changed(fields[name], rest, value) if rest else value}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = RunFolder(tmp_path_factory.mktemp("run"))
    setting = Setting(SceneChoice("coarse")).to_dict()
    searches = {"deciders": ["threshold"], "reference": None, "targets": ["cone"], "episodes": 1, "seed": 0}
    folder.start({}, {**searches, "setting": setting})
    return folder.read_run()


class WouldPlay(Exception):
    """The arguments were accepted."""


def stop(*_, **__):
    raise WouldPlay


READERS = {
    "compare": lambda path: Compare.from_config(path / "run.json").run(),
    "replay": lambda path: Replay(path, out=path / "search.png").run(),
}


@pytest.mark.parametrize("reader", list(READERS))
def test_a_field_of_a_wrong_type_is_a_clear_error_or_works(reader, run, tmp_path, monkeypatch):
    monkeypatch.setattr(Run, "play", stop)
    refused = 0
    for number, path in enumerate(paths(run["arguments"])):
        for wrong in (WRONG[(number + step) % len(WRONG)] for step in range(2)):
            if path[-1] == "unknown_state" and wrong is True:
                continue  # is right, and would embed the hypotheses of all worlds
            (tmp_path / "run.json").write_text(
                sealed_json({**run, "arguments": changed(run["arguments"], path, wrong)})
            )
            try:
                READERS[reader](tmp_path)
            except (ActiveTouchError, FileNotFoundError, WouldPlay) as error:
                refused += not isinstance(error, WouldPlay)
            except BaseException as error:
                error.add_note(f"{path} {wrong!r:.50}")
                raise
    assert refused
