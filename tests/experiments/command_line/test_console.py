"""What is printed is printed as it is, on any terminal."""

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from belief.table import Table, csv_text
from experiments import parallel
from experiments.command_line.console import plain_console

ROOT = Path(__file__).parents[3]
HOSTILE = ["runs/[/green]", "[bold]cone[/bold]", ":smile:", "[link=x]y", "\\[x]", "[[", "[#ff0000]nut"]


@pytest.mark.parametrize("text", HOSTILE)
def test_text_is_printed_as_it_is_alone_in_tables_and_before_progress_bars(text, monkeypatch):
    file = io.StringIO()
    console = plain_console(file=file, width=200)
    console.print(f"report: {text}")
    console.rule(text)
    monkeypatch.setattr(parallel, "plain_console", lambda: console)
    assert list(parallel.run_tasks([lambda: 1], 1, text)) == [1]
    assert file.getvalue().count(text) >= 3
    assert str(Table(text, (text,), [(text,), (text,)], text)).count(text) == 5


@pytest.mark.parametrize("width", [120, 80])
def test_a_table_that_is_too_wide_loses_neither_names_nor_digits(width):
    row = ("all taxels dead", *(f"0.{n}31 [0.{n}27, 0.{n}35]" for n in range(1, 7)), "5.424")
    table = Table("", ("condition", *(f"score {n}" for n in range(1, 7)), "NLL"), [row])
    lines = table.text(width).splitlines()
    assert max(map(len, lines)) <= width
    for cell in row:
        assert all(any(part in line for line in lines) for part in cell.split()), cell


def test_no_command_prints_with_a_console_of_its_own():
    allowed = {"console.py"}
    for path in sorted((ROOT / "experiments").glob("*.py")):
        if path.name not in allowed:
            assert "Console(" not in path.read_text().replace("plain_console(", ""), path.name


def run(arguments, where, **environment):
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=where,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        capture_output=True,
        timeout=300,
    )


@pytest.mark.parametrize(
    "arguments",
    [
        ["compare", "--results", "a.csv", "--out", "[/green]/[bold]"],
        ["touch", "--shape", "größe–λ"],
    ],
    ids=lambda arguments: " ".join(arguments[:2]),
)
def test_a_terminal_that_is_not_utf_8_gets_all_in_ascii(tmp_path, arguments):
    (tmp_path / "a.csv").write_text("seed,task,success\n1,λ,1\n2,λ,0\n", encoding="utf-8")
    environments = {"PYTHONIOENCODING": "ascii", "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    found = run(["-m", "experiments.cli", *arguments], tmp_path, **environments)
    words = (found.stdout + found.stderr).decode("ascii")
    assert "Traceback" not in words
    assert "UnicodeEncodeError" not in words
    assert (found.returncode == 0) is (arguments[0] == "compare"), words
    if found.returncode == 0:  # and a name like markup is printed as it is
        assert "[/green]/[bold]" in words
        assert (tmp_path / "[/green]" / "[bold]" / "report.html").exists()


def test_characters_that_cannot_be_printed_are_replaced_by_what_looks_alike(tmp_path):
    script = r"""
from experiments.command_line.console import print_on_any_terminal

print_on_any_terminal()
print("12–14 → λ ≤ 3 … größe µs 触 \udcff")
"""
    assert run(["-c", script], tmp_path, PYTHONIOENCODING="ascii").stdout == b"12-14 -> lambda <= 3 ... grosse us ? ?\n"
    text = run(["-c", script], tmp_path, PYTHONIOENCODING="utf-8").stdout.decode()  # which lacks halves of pairs only
    assert text == "12–14 → λ ≤ 3 … größe µs 触 ?\n"


FORMULAS = [
    "=1+1",
    "+1+1",
    "-2+3+cmd|' /C calc'!A0",
    "@SUM(A1)",
    "\t=1",
    "\r=1",
    "\n=1",
    "a\r=1",
    "＝1",
    "=cmd|'/C calc'!A0",
]


@pytest.mark.parametrize("label", FORMULAS)
def test_no_cell_of_a_table_is_a_formula(tmp_path, label):
    import csv

    table = Table("title", [(label, ""), ("number", ".2f")], [(label, -0.5), ("cone", (-1.0, 2.0))])
    Table("", (label, "number"), [(label, "-0.5")]).write_csv(tmp_path / "table.csv")
    texts = [csv_text([(label, -0.5)]), table.csv(), (tmp_path / "table.csv").read_bytes().decode()]
    for text in texts:
        cells = [cell for row in csv.reader(io.StringIO(text, newline="")) for cell in row]
        assert not any(cell.startswith("=") for cell in cells)
        assert label.startswith("a") or "'" + label.replace("\r", "\n") in cells
        assert label not in cells
        assert {"-0.5", "-1.0"} & {*cells}  # numbers stay numbers


@pytest.mark.parametrize("cell", ["cone", "", "-0.5", "+1e-3", "-inf", -0.5, -1, None, "a=b", "'=1"])
def test_harmless_cells_stay_as_they_are(cell):
    assert csv_text([(cell, "x")]) == f"{'' if cell is None else cell},x\n"


def test_linear_algebra_uses_one_thread_in_this_process_as_in_workers():
    with threadpool_limits(2):
        [pools] = parallel.run_tasks([threadpool_info], 1, "asking")
    assert {pool["num_threads"] for pool in pools if pool["user_api"] == "blas"} == {1}
