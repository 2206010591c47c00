"""Numbers of README and docs are those of committed records; a section with numbers says where they are from."""

import json
import re
import subprocess
import zlib
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from activetouch.sensor_files import MODELS, OBSERVATION_FILE, READER_FILE
from planners.fingerprint import files_digest

ROOT = Path(__file__).parent.parent
RECORDS = json.loads((ROOT / "records" / "results" / "searches.json").read_text())
_SPEC = spec_from_file_location("tables_of_docs", ROOT / "docs" / "generate" / "tables.py")
tables = module_from_spec(_SPEC)
_SPEC.loader.exec_module(tables)
SCENES = [name for name in RECORDS if name not in ("keyed", "paper-independent")]
TABLES = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "records" / "tables").glob("*.md"))
PAGES = ["README.md", *sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").glob("*.md")), *TABLES]
_NUMBER = re.compile(r"(?<![\w./§\[-])\d+\.\d+(?![\w.]*\.(?:md|py))|\d+ %|\d[\d ]* (?:ms|µs|MB|touches)\b")
_COMMANDS = (
    "calibrate|calibration-report|collect|compare|explain|recorded|reproduce|robustness|tradeoff|train|train-ppo"
)
_SOURCE = re.compile(
    rf"`[^`]*(?:activetouch [a-z-]+|benchmarks[/.]\w+|make [a-z-]+|examples/\w+)[^`]*`|`(?:{_COMMANDS})\b[^`]*`|```sh"
    r"|\]\([^)]*\.(?:md|csv|json)[^)]*\)"
)
NOT_MEASURED = {  # definitions, settings and sums that the reader does by hand
    ("docs/columns.md", "Searches"),
    ("docs/columns.md", "Differences and returns"),
    ("docs/toy.md", "By hand"),
    ("docs/toy.md", "Stop and plan"),
    ("docs/calibration.md", "What a calibrated touch is"),
}


def sections(page):
    """Title of a section, its text, and its text after that of the page's top and of the enclosing sections."""
    levels, found, fenced = [(0, "", [])], [], False
    for line in (ROOT / page).read_text().splitlines():
        fenced ^= line.startswith("```")
        heading = None if fenced else re.match(r"(#+) (.*)", line)
        if heading:
            depth = len(heading[1])
            levels = [level for level in levels if level[0] < depth] + [(depth, heading[2], [])]
            found.append(levels)
        levels[-1][2].append(line)
    texts = [[(title, "\n".join(lines)) for _, title, lines in levels] for levels in found]
    return [(path[-1][0], path[-1][1], "\n".join(text for _, text in path)) for path in texts]


@pytest.mark.parametrize("page", PAGES)
def test_a_section_with_numbers_names_a_command_a_record_or_a_page_that_does(page):
    without = [
        title
        for title, text, above in sections(page)
        if _NUMBER.search(re.sub(r"```python.*?```|95 %", "", text, flags=re.S))
        and not _SOURCE.search(above)
        and (page, title) not in NOT_MEASURED
    ]
    assert not without, f"say which command prints these numbers, or that they are of a trial: {without}"


def stated(record, digits):
    """Success and touches of a decider as the pages write them."""
    success = "{:.3f} [{:.3f}, {:.3f}]".format(*record["success"])
    return success, f"{record['touches']:.{digits}f}"


def row(page, beginning):
    [line] = [line for line in (ROOT / page).read_text().splitlines() if line.startswith(beginning)]
    return line.replace("**", "")


DIGITS = {"gel": 2}


@pytest.mark.parametrize("sensor", RECORDS)
def test_a_record_is_of_the_sensor_that_ships(sensor):
    files = [MODELS / sensor / name for name in (READER_FILE, OBSERVATION_FILE)]
    assert RECORDS[sensor]["sensor_sha256"] == files_digest(files)


@pytest.mark.parametrize("scene", SCENES)
def test_the_readme_states_what_the_record_says(scene):
    line, deciders = row("README.md", f"| `{scene}`"), RECORDS[scene]["deciders"]
    success, touches = stated(deciders["information_gain"], DIGITS.get(scene, 1))
    assert f"{success}, {touches}" in line
    assert f"| {max(deciders[name]['return'] for name in ('point_based', 'information_gain')):.3f}," in line


@pytest.mark.parametrize("scene", SCENES)
def test_the_page_of_results_states_what_the_record_says(scene):
    line, deciders = row("docs/results.md", f"| `{scene}`: "), RECORDS[scene]["deciders"]
    cells = [cell.strip() for cell in line.split("|")[2:5]]
    for name, cell in zip(("point_based", "information_gain"), cells, strict=False):
        assert cell.removesuffix(" touches") == ", ".join(stated(deciders[name], DIGITS.get(scene, 1)))
    assert cells[2] == f"{max(deciders[name]['return'] for name in ('point_based', 'information_gain')):.3f}"


def test_independent_touches_are_stated_as_their_record_says():
    planned, greedy = (RECORDS["paper-independent"]["deciders"][name] for name in ("point_based", "information_gain"))
    best = f"{max(planned['return'], greedy['return']):.3f}"
    success, touches = stated(greedy, 1)
    words = " ".join((ROOT / "README.md").read_text().split())
    assert f"in {success} of the same searches, with {touches} touches and a return of {best}" in words
    cells = [cell.strip() for cell in row("docs/results.md", "| `paper-independent`: ").split("|")[2:5]]
    assert cells == [*(", ".join(stated(one, 1)) for one in (planned, greedy)), best]


def has_its_tables(page):
    """Whether the tables of a page are those of the records."""
    text = (ROOT / page).read_text()
    return tables.PAGES[page](text) == text


TASKS = "docs/benchmark.md"  # which a test of the benchmark looks at, as both read its files


@pytest.mark.parametrize("page", [page for page in tables.PAGES if page not in (TASKS, *tables.OF_ALL_SUBMISSIONS)])
def test_the_tables_of_a_page_are_those_of_the_records(page):
    assert has_its_tables(page), "run python docs/generate/tables.py"


def test_the_sensor_of_independent_touches_is_stated_as_its_evaluation_says():
    record = json.loads((ROOT / "activetouch" / "models" / "paper-independent" / "evaluation.json").read_text())
    losses = [f"{loss:.3f}" for loss in record["cross_validated_nll"].values()]
    cells = row("docs/calibration.md", "| `paper-independent` | 0.").split("|")
    assert [cell.strip() for cell in cells[2:8]] == losses
    accuracy = "{:.3f} [{:.3f}, {:.3f}]".format(record["accuracy"], *record["accuracy_interval"])
    assert f"{accuracy} of single touches right" in (ROOT / "docs" / "perception.md").read_text()


def test_chosen_places_are_stated_as_their_record_says():
    chosen, random, fixed, given = RECORDS["keyed"]["deciders"].values()
    page, readme = ((ROOT / name).read_text().replace("**", "") for name in ("docs/where_to_touch.md", "README.md"))
    for one in (chosen, random, fixed, given):
        assert "| {} | {} |".format(*stated(one, 2)) in page
    saved = [f"{1.0 - chosen['touches'] / other['touches']:.0%}".replace("%", " %") for other in (random, fixed, given)]
    assert all(f"| {share} (" in page for share in saved)
    assert f"{saved[0]} fewer touches than random places and {saved[1]} fewer" in readme
    assert f"at {stated(chosen, 2)[0]} success" in readme


def test_the_readme_names_real_objects_as_the_record_says():
    record = json.loads((ROOT / "records" / "real_touch" / "cy101-objects.json").read_text())
    touches = {decider: cells[0] for split, decider, *cells in record["tables"]["identification"] if "order" in split}
    words = " ".join((ROOT / "README.md").read_text().split())
    assert f"after {touches['information gain']} touches, random order after {touches['random order']}" in words


KEPT = sorted((ROOT / "records").rglob("*.txt"))
_LINKED = re.compile(r"\]\(\.\./(?:records/)?([\w/.-]+\.txt)\)")
_DECIMAL = re.compile(r"(?<![\w.,§])(\d+\.\d+)(?!\.?\d)( %)?")
_PRINTED = re.compile(r"(?<![\w.])(?:\d{1,3}(?:,\d{3})+(?!\d)|\d+)(?:\.\d+)?(?:e[-+]?\d+)?")


def parts_with_records(page):
    """Paragraphs and rows of tables, each with the records that it links; of a row, also the paragraph before it."""
    before = []
    for block in re.split(r"\n\s*\n", re.sub(r"```.*?```", "", (ROOT / page).read_text(), flags=re.S)):
        is_table = block.startswith("|")
        for part in block.splitlines() if is_table else [block]:
            found = [*(before if is_table else []), *_LINKED.findall(part)]
            if found:
                yield part, found
        before = _LINKED.findall(block)


def missing_numbers(part, records):
    """Decimal numbers of a part of a page that no record holds, rounded; a percentage may be printed as a fraction."""
    printed = [float(number.replace(",", "")) for text in records for number in _PRINTED.findall(text)]
    missing = []
    for number, percent in _DECIMAL.findall(re.sub(r"`[^`]*`", "", part)):
        places = len(number.partition(".")[2])
        scales = (1, 100) if percent else (1,)
        if all(abs(scale * one - float(number)) > 0.5001 * 10**-places for one in printed for scale in scales):
            missing.append(number)
    return missing


def test_numbers_that_no_record_holds_are_found():
    assert missing_numbers("| −0.79, 12.5 %, 95 % | `--cost 0.33` |", ["0.7851 of 1,000; 0.1251"]) == []
    assert missing_numbers("0.008 of 314", ["some,314,0.0084"]) == []  # in a table of values separated by commas
    assert missing_numbers("success 0.788, 1.5 s", ["0.787 0.0151"]) == ["0.788", "1.5"]


@pytest.mark.parametrize("page", PAGES[1:])
def test_tables_and_paragraphs_that_link_a_record_state_its_numbers(page):
    for part, records in parts_with_records(page):
        texts = [(ROOT / "records" / name).read_text() for name in records]
        assert missing_numbers(part, texts) == [], f"not in {', '.join(records)}: {part[:80]}"


@pytest.mark.parametrize("path", KEPT, ids=lambda path: path.stem)
def test_a_record_says_what_made_it(path):
    lines = path.read_text().splitlines()
    assert [line.partition(": ")[0] for line in lines[:4]] == ["command", "commit", "versions", "processor time"]
    assert lines[0].partition(": ")[2].split()[0] in ("activetouch", "python")


def test_the_size_of_the_wheel_is_that_of_its_files_compressed():
    listed = ["git", "ls-files", "activetouch", "belief", "planners", "experiments"]
    tracked = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True)
    packed = sum(len(zlib.compress((ROOT / name).read_bytes(), 1)) for name in tracked.stdout.splitlines())
    stated = re.search(r"The wheel has (\d+\.\d) MB", (ROOT / "docs/install.md").read_text())
    assert packed / 1e6 == pytest.approx(float(stated[1]), rel=0.02)
