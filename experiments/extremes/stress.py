"""``activetouch stress``: pass extreme inputs to what users meet, and report the outcomes.

Extremes of beliefs, calibrations, deciders and the physics are tests: ``tests/extremes``.
"""

from __future__ import annotations

import contextlib
import io
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

from rich.progress import Progress

from belief.claims import claim_folder, ends_claims
from belief.errors import ActiveTouchError, UnknownName
from experiments.command_line.arguments import NotEmpty, check_arguments
from experiments.command_line.console import plain_console
from experiments.extremes.cases import Case, Finding, Verdict, judge
from experiments.parallel import progress_bar

AREAS: Mapping[str, str] = MappingProxyType(
    {
        "touch": "presses, objects, scenes",
        "files": "checkpoints, observation models, shards, manifests, meshes",
        "commands": "names, run folders, missing files",
        "arguments": "numbers out of their range, of every command",
        "foreign": "sensors and collections of other scenes, deciders and renderers of the user's own",
    }
)
"""Areas of cases; the cases of an area are ``experiments.extremes.AREA.CASES``."""


class NotRobust(ActiveTouchError):
    """A case had a wrong answer or an unclear error."""


def cases_of(area: str) -> Sequence[Case]:
    """The cases of an area.

    Raises:
        UnknownName: there is no such area.
    """
    if area not in AREAS:
        raise UnknownName("area", area, list(AREAS))
    return import_module(f"experiments.extremes.{area}").CASES


@dataclass(frozen=True)
class Stress:
    """Test the installation with extreme inputs: touches, files, commands, and parts of the user's own.

    Each case must give the right answer, which is known in advance, or an error of a stated type that names the cause.
    Anything else is a failure: a wrong answer, NaN, a warning, another error, or no error where one is expected.

    For example:

        activetouch stress
        activetouch stress --areas arguments files
    """

    areas: Annotated[tuple[str, ...], NotEmpty()] = tuple(AREAS)
    """Areas to test: touch, files, commands, arguments, foreign."""
    out: Path = Path("runs/stress")
    """Folder for report.html and findings.csv."""

    @ends_claims
    def run(self) -> None:
        """Judge all cases, write the report, and print it.

        Raises:
            BadArgument: no area is named.
            NotRobust: a case failed; the report is written first.
        """
        check_arguments(self)
        claim_folder(self.out)
        cases = {area: cases_of(area) for area in self.areas}
        pairs = [(area, case) for area, some in cases.items() for case in some]
        findings: dict[str, list[Finding]] = {area: [] for area in cases}
        # The bar uses the present stderr; the output of the commands under test is silenced.
        console = plain_console(file=sys.stderr)
        bar = Progress(*progress_bar().columns, console=console, redirect_stdout=False, redirect_stderr=False)
        with bar as progress:
            for area, case in progress.track(pairs, description="stressing"):
                with _silently():
                    findings[area].append(judge(case))
        report(self.out, findings)
        failed = [finding for some in findings.values() for finding in some if finding.verdict is Verdict.FAILED]
        for finding in failed:
            print(f"FAILED {finding.case.entry}, {finding.case.given}: {finding.happened}", file=sys.stderr)
        print(f"wrote {self.out / 'report.html'} and findings.csv")
        if failed:
            raise NotRobust(f"{len(failed)} of {len(pairs)} cases failed; see {self.out / 'report.html'}")


@contextlib.contextmanager
def _silently() -> Iterator[None]:
    """Silence the output of the commands under test."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        yield


def report(folder: Path, findings: Mapping[str, Sequence[Finding]]) -> None:
    """Write ``report.html`` and ``findings.csv``, and print the counts."""
    from experiments.reporting.page import Section, write_page
    from experiments.reporting.tables import Table

    rows = [(area, *_row(finding)) for area, some in findings.items() for finding in some]
    headings = ("area", "function", "given", "expected", "happened", "verdict", "ms")
    counts = {area: Counter(finding.verdict for finding in some) for area, some in findings.items()}
    total = sum(counts.values(), Counter())
    summary = Table(
        "Cases by area",
        ("area", "what", *(verdict.value for verdict in Verdict)),
        [(area, AREAS[area], *(str(count[verdict]) for verdict in Verdict)) for area, count in counts.items()],
    )
    verdict = (
        f"{total.total()} extreme inputs: {total[Verdict.RIGHT]} gave the right answer, "
        f"{total[Verdict.REFUSED]} were refused with a clear error, {total[Verdict.FAILED]} failed."
    )
    rules = (
        "Right answers are known in advance. Errors must be of the stated type, and their message must match the "
        "stated pattern. Warnings are failures."
    )
    sections = [Section("Verdict", [verdict, rules], [summary])]
    for area in findings:
        table = Table(f"Cases: {area}", headings[1:], [row[1:] for row in rows if row[0] == area])
        sections.append(Section(area.capitalize(), [f"{AREAS[area].capitalize()}."], [table]))
    write_page(folder / "report.html", "Stress: what happens at the extremes", sections)
    Table("", headings, rows).write_csv(folder / "findings.csv")
    plain_console().print(summary.rich())
    print(verdict)


def _row(finding: Finding) -> tuple[str, ...]:
    case = finding.case
    milliseconds = f"{1e3 * finding.seconds:.0f}"
    return case.entry, case.given, case.expected.words, finding.happened, finding.verdict.value, milliseconds
