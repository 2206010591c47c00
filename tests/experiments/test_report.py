"""A report is one page, and each of its tables and figures is beside it as a file."""

from pathlib import Path

import pytest

from belief.table import Table
from experiments.calibration.measurements import Measurements
from experiments.meshes.identify import Identified
from experiments.paper.reproduce import Reproduction
from experiments.recorded.report import RecordedReport
from experiments.report import Picture, Report, Reported, Section
from experiments.robustness.robustness import RobustnessReport
from experiments.search.results import ResultsComparison
from experiments.tradeoff.report import TradeoffReport

ROOT = Path(__file__).parents[2]
TABLE = Table("ages", ["who", ("age", "d")], [("Ada <3", 36)], name="ages")
PICTURE = Picture("line", "A line.", [lambda axes: axes.plot([0.0, 1.0])])


def test_every_part_of_a_report_is_on_the_page_and_in_its_files(tmp_path):
    sections = [
        Section("Result", ["Ada & `x < y` won.", "The rest."], [TABLE, Table("none", ["who"], [], name="none")]),
        Section("Drawn", (), (), [PICTURE, Picture("small", "A portrait.", PICTURE.panels, is_file=False)]),
        Section("", ["It continues."], folded={"more": ["`a\n  b`"]}),
    ]
    made = Report("A <title>", sections, ("tables", "figures"), "all.md", {"n.json": "{}\n"})
    page = made.save(tmp_path)
    files = {file.relative_to(tmp_path).as_posix() for file in tmp_path.rglob("*") if file.is_file()}
    tables = {f"tables/{name}.{kind}" for name in ("ages", "none") for kind in ("csv", "tex")}
    assert files == {"report.html", "all.md", "n.json", "figures/line.svg", "figures/line.png"} | tables
    html, text = page.read_text(), (tmp_path / "all.md").read_text()
    assert '<p class="verdict">Ada &amp; <code>x &lt; y</code> won.</p>\n<p>The rest.</p>' in html
    assert "<title>activetouch: A &lt;title&gt;</title>" in html
    assert "<summary>more</summary>\n<p><code>a\n  b</code></p>" in html
    assert html.count("<h2") == 2
    assert html.count("<svg") == 2
    assert "none" not in html.split("</style>")[1]  # a table without rows is a file only
    assert "| Ada <3 | 36 |" in text
    assert "## Result\n\nAda & `x < y` won." in text
    assert (tmp_path / "tables" / "ages.csv").read_text() == TABLE.csv()
    assert (tmp_path / "tables" / "ages.tex").read_text() == f"{TABLE.latex()}\n"


def test_films_bring_their_buttons_and_other_pages_have_none():
    told = {"heading": "object 1", "action": "touch", "words": "Object 1, touch 1", "scores": {}}
    panel = told | {"seen": [], "objects": ["", "rejected"], "now": 0, "bars": [("cone", 1.0, True, None)]}
    film = {"title": "a search", "success": True, "panels": [panel], "scale": None, "longest_label": 4}
    film |= {"start": 0, "together": True}
    with_film = Report("t", [Section("One search", films=[film])]).html()
    without = Report("t", [Section("One search")]).html()
    assert "Step through a search" in with_film
    assert ".story" in with_film
    assert "story" not in without


def test_only_reports_write_pages_and_tables():
    own = {"report.py", "search/export.py"}
    for file in (ROOT / "experiments").rglob("*.py"):
        for call in ("get_template(", ".latex())", ".write_csv(", "write_page"):
            is_own = file.relative_to(ROOT / "experiments").as_posix() in own
            assert is_own or call not in file.read_text(), f"{file} writes what a Report writes: {call}"


@pytest.mark.parametrize(
    "kind",
    [Identified, Measurements, RecordedReport, Reproduction, ResultsComparison, RobustnessReport, TradeoffReport],
)
def test_results_of_commands_are_saved_as_reports(kind):
    assert kind.save is Reported.save
