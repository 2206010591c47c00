"""The front door: help on one screen, the version, the nearest command, and one import per command."""

import errno
import re
import shlex
import subprocess
import sys
from dataclasses import fields, is_dataclass
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import get_type_hints
from unittest.mock import Mock

import pytest
import tyro

import activetouch
from experiments import cli, report

ROOT = Path(__file__).parents[2]


@pytest.fixture
def run(monkeypatch, capsys):
    """Run a command in this process: what it prints, and with what it ends."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["activetouch", *arguments])
        code = None
        try:
            cli.main()
        except SystemExit as end:
            code = end.code
        return capsys.readouterr().out, code

    return run


def test_the_help_fits_a_screen_and_has_a_line_for_every_command(run):
    lines = run("--help")[0].splitlines()
    assert len(lines) <= 40
    assert max(map(len, lines)) <= 80
    shown = [line.split()[0] for line in lines if line.startswith("  ")]
    assert shown == list(cli.REGISTRY)
    assert len(shown) == sum(map(len, cli.COMMAND_GROUPS.values()))  # each in one group
    assert run()[0].splitlines() == lines


@pytest.mark.parametrize("name", cli.REGISTRY)
def test_every_command_can_be_imported_has_examples_and_a_summary(name):
    kind = cli.REGISTRY[name].load()
    assert callable(kind.run)
    assert f"activetouch {name}" in kind.__doc__, "its help has an example"
    summary = cli.REGISTRY[name].summary
    assert summary
    assert not summary.endswith(".")


@pytest.mark.parametrize("name", cli.REGISTRY)
def test_the_help_of_a_command_fits_and_has_every_option_and_no_empty_default(name, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit) as end:
        cli._parsed([name, "--help"])
    text = capsys.readouterr().out
    assert not end.value.code
    options = text.partition("For example:")[2].partition("\n\n")[2].partition("\n\n")[2]
    assert max(map(len, options.splitlines())) <= 80
    for part in ("(default: )", "(default: None)", "(default: False)", "{None"):
        assert part not in options
    kind = cli.REGISTRY[name].load()
    shown = set(re.findall(r"^  (--[\w.-]+)", options, re.M))
    hints = get_type_hints(kind, include_extras=True)
    own = {field.name for field in fields(kind) if not is_dataclass(get_type_hints(kind)[field.name])}
    unseen = {tyro.conf.Suppress, tyro.conf.Positional}
    seen = {field for field in own if unseen.isdisjoint(getattr(hints[field], "__metadata__", ()))}
    renamed = {  # by tyro.conf.arg(name=…)
        field: part.name
        for field in seen
        for part in getattr(hints[field], "__metadata__", ())
        if getattr(part, "name", None)
    }
    assert {f"--{renamed.get(field, field).replace('_', '-')}" for field in seen} <= shown


@pytest.mark.parametrize("option", ["--hand", "--fidelity", "--presentation"])
def test_a_name_that_is_none_of_the_choices_is_answered_with_the_choices_alone(option, capsys):
    with pytest.raises(SystemExit):
        cli._parsed(["live", "--target", "cone", option, "five_finger"])
    told = capsys.readouterr()
    assert "Expected one of" in told.out + told.err
    assert "None" not in told.out + told.err


def test_an_option_of_another_command_is_answered_with_a_hint(capsys):
    with pytest.raises(SystemExit) as end:
        cli._parsed(
            ["find", "scans", "--target", "mug", "--scene", "coarse", "--episodes=3", "--fidelity", "x", "--zz"]
        )
    assert end.value.code == 2
    assert capsys.readouterr().err.splitlines()[-3:] == [
        "find takes --sensor in place of --scene",
        "find takes --searches in place of --episodes",
        "--fidelity is an option of compare, live, touch, explain, collect, certify, not of find",
    ]


def test_open_shows_the_page_that_was_written_or_says_where_it_is(monkeypatch, tmp_path, capsys):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda page: opened.append(page) or len(opened) < 2)
    monkeypatch.setattr(report, "written", [])
    cli._open_page()
    assert "wrote no page" in capsys.readouterr().err
    files = []
    for name in ("one", "two"):
        files.append(report.Report("title", []).save(tmp_path / name))
        cli._open_page()
    assert opened == [file.as_uri() for file in files]
    assert opened[1] in capsys.readouterr().err


def test_the_version_is_that_of_the_distribution():
    words = [sys.executable, "-m", "activetouch", "--version"]
    found = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    assert found.stdout.strip() == f"activetouch {version('activetouch')}"
    assert activetouch.__version__ == version("activetouch")
    with pytest.raises(AttributeError, match="nonsense"):
        _ = activetouch.nonsense


def test_an_unknown_command_suggests_the_nearest(run):
    assert run("compar")[1].startswith("activetouch: unknown command 'compar'. Did you mean 'compare'?")


def test_only_the_chosen_command_is_imported():
    code = "import sys; sys.argv = ['activetouch', 'replay', '--folder', 'none']; from experiments import cli\n"
    code += "try: cli.main()\nexcept SystemExit: print(*sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    loaded = set(found.stdout.split())
    others = {f"experiments.{entry.module}" for entry in cli.REGISTRY.values()} & loaded
    assert others == {"experiments.search.replay"}


@pytest.mark.parametrize("arguments", ["compare --help"])
def test_a_reader_that_ends_early_ends_the_command_quietly(arguments):
    command = f"{shlex.quote(sys.executable)} -m experiments.cli {arguments} | true; exit ${{PIPESTATUS[0]}}"
    found = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True)
    assert not found.stderr
    assert found.returncode in (0, 141)  # it may be done before the reader ends


@pytest.mark.skipif(sys.platform == "win32", reason="closes streams as shells of POSIX do")
@pytest.mark.parametrize(
    ("arguments", "closed"), [("--version", ">&-"), ("--version", "2>&-"), ("touch", "<&- >&- 2>&-")]
)
def test_a_command_whose_streams_are_closed_does_its_work(arguments, closed, tmp_path):
    own = f" --scene coarse --csv {shlex.quote(str(tmp_path))}/touch.csv" * (arguments == "touch")
    command = f"{shlex.quote(sys.executable)} -m experiments.cli {arguments}{own} {closed}"
    found = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True)
    assert (found.returncode, found.stderr) == (0, "")
    assert [path.name for path in tmp_path.iterdir()] == ["touch.csv"] * bool(own)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="writes to a device that is always full")
@pytest.mark.parametrize("arguments", ["--version", "replay --help"])
def test_an_output_that_is_full_is_one_sentence(arguments):
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "experiments.cli", *arguments.split()]
        found = subprocess.run(command, cwd=ROOT, stdout=full, stderr=subprocess.PIPE, text=True)
    assert found.returncode == 1
    assert re.fullmatch(r"activetouch: .*No space left on device\. .*\n", found.stderr)


@pytest.mark.parametrize("number", ["EIO", "ESTALE", "ENOSPC", "EROFS", "ETIMEDOUT", "ENXIO", "EACCES", "EMFILE"])
def test_an_error_of_the_system_is_one_sentence(number, monkeypatch):
    error = OSError(getattr(errno, number), "what the system says", "a file")
    monkeypatch.setattr(cli, "_parsed", lambda arguments: SimpleNamespace(run=Mock(side_effect=error)))
    monkeypatch.setattr("os.dup2", lambda *numbers: None)
    monkeypatch.setattr(sys, "argv", ["activetouch", "compare"])
    with pytest.raises(SystemExit, match=r"^activetouch: \[Errno \d+\] what the system says: 'a file'\. Finished"):
        cli.main()


def test_the_shell_is_given_a_completion_of_all_commands(run):
    text, _ = run("--tyro-print-completion", "bash")
    assert all(name in text for name in cli.REGISTRY)
