"""Every command line of README and docs is one that the command accepts as it stands."""

import re
import shlex
from pathlib import Path

import pytest

from experiments.cli import REGISTRY, _parsed

ROOT = Path(__file__).parent.parent
PAGES = ["README.md", "CONTRIBUTING.md", *sorted(path.relative_to(ROOT).as_posix() for path in ROOT.glob("docs/*.md"))]


def shell_lines(text):
    """Lines of shell blocks, continued ones joined."""
    blocks = re.findall(r"```sh\n(.*?)```", text, flags=re.S)
    return [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]


def command_lines(text):
    """Command lines of shell blocks, and those in single backticks that leave nothing open and are of this commit."""
    lines = shell_lines(text)
    prose = re.sub(r"```.*?```", "", text, flags=re.S)
    lines += [
        " ".join(code.split())
        for code, commit in re.findall(r"`([^`]+)`( at `[0-9a-f]{8}`)?", prose)
        if not commit and "…" not in code and "..." not in code
    ]
    lines = [f"activetouch {line}" if line.partition(" --")[0] in REGISTRY else line for line in lines]
    return [line for line in lines if re.match(r"(activetouch|make|python (-m )?benchmarks)\b", line)]


COMMANDS = sorted({(page, line) for page in PAGES for line in command_lines((ROOT / page).read_text())})


def test_the_pages_hold_commands_of_every_group():
    used = {line.split()[1] for _, line in COMMANDS if line.startswith("activetouch ") and len(line.split()) > 1}
    assert len(used & set(REGISTRY)) >= 14


@pytest.mark.parametrize("line", sorted({line for _, line in COMMANDS if line.startswith("activetouch ")}))
def test_a_command_of_the_pages_is_accepted(line, capsys):
    line = line.replace(" FORMAT", " csv").replace(" COMMAND", " compare")
    name, *options = shlex.split(line, comments=True)[1:]
    if not options or "--config" in options:  # which reads the file of a run
        assert name in REGISTRY or name in ("--help", "--version")
        return
    try:
        _parsed([name, *options])
    except SystemExit as end:
        said = capsys.readouterr().err
        if end.code and not said.lstrip().startswith("Missing"):  # a page may name an option alone
            pytest.fail(said)


MAKE = (ROOT / "Makefile").read_text()


@pytest.mark.parametrize("line", sorted({line for _, line in COMMANDS if line.startswith(("make", "python"))}))
def test_a_target_or_an_option_that_the_pages_name_exists(line):
    words = shlex.split(line, comments=True)
    if words[0] == "make":
        for word in words[1:]:
            name, given, _ = word.partition("=")
            assert re.search(
                rf"^{re.escape(name)} *\??=|\$\({re.escape(name)}\)" if given else rf"^{name}:", MAKE, re.M
            )
        return
    target = words[2] if words[1] == "-m" else words[1]
    file = ROOT / (target.replace(".", "/") + ".py" if words[1] == "-m" else target)
    source = file.read_text()
    for option in re.findall(r"--[a-z-]+", line):
        assert option in source or option[2:].replace("-", "_") in source, option


def test_the_scripts_of_all_records_are_among_the_code_that_must_be_committed_before_a_record():
    named = re.search(r"^CODE = \((.*)\)$", (ROOT / "docs/generate/run_record.py").read_text(), re.M)[1]
    records = [path.read_text() for path in (ROOT / "records").rglob("*.txt")]
    scripts = {found[1] for text in records if (found := re.match(r"command: python (?:-m )?(\w+)", text))}
    assert {"benchmarks", "examples"} <= scripts <= set(re.findall(r'"(\w+)"', named))


def test_every_decision_has_a_record_or_a_line_on_the_page_of_what_was_tried():
    records = {path.name[:4] for path in (ROOT / "docs/decisions").glob("0*.md")}
    lines = re.findall(r"^\| (\d{4}) \|", (ROOT / "docs/what_was_tried.md").read_text(), re.M)
    assert records.isdisjoint(lines)
    never_used = {"0051", "0052", "0055", "0056", *(f"{n:04d}" for n in (86, *range(88, 94)))} - records - set(lines)
    assert records.union(lines) == {f"{number:04d}" for number in range(1, int(max(records)) + 1)} - never_used
    code = [
        path for name in ("activetouch", "belief", "planners", "experiments") for path in (ROOT / name).rglob("*.py")
    ]
    named = {number for path in code for number in re.findall(r"decisions? (\d{4})", path.read_text())}
    assert named <= records.union(lines)
