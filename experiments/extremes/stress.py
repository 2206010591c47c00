"""``activetouch stress``: extremes of what a user meets, what happened, and how it was judged.

Extremes of the mathematics (beliefs, calibrations, deciders) are tests: ``tests/extremes``.
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

from rich.progress import Progress

from belief.errors import ActiveTouchError, UnknownName
from belief.files import require_writable
from experiments.command_line.console import plain_console
from experiments.extremes.cases import Case, Finding, Verdict, judge
from experiments.parallel import progress_bar

AREAS: Mapping[str, str] = MappingProxyType(
    {
        "touch": "presses, pads, objects, images, scenes",
        "files": "checkpoints, observation models, shards, manifests, meshes",
        "commands": "names, run folders, what is not there",
        "arguments": "numbers out of their range, of every command",
        "foreign": "sensors and collections of other scenes, deciders of a user's own",
    }
)
"""Where cases are: ``experiments/extremes/AREA.py`` has those of an area, in ``CASES``."""


class NotRobust(ActiveTouchError):
    """Some case was answered wrongly, or refused without saying why."""


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
    """Hand extremes to what a user meets: touches, files, commands, and parts that come from elsewhere.

    Each case must give the right answer, which is known beforehand, or an error of a stated type that says what was
    wrong. Anything else is a failure: a wrong answer, NaN, a warning, another error, or none where there should be one.

    For example:

        activetouch stress
        activetouch stress --areas arguments files
    """

    areas: tuple[str, ...] = tuple(AREAS)
    """Which of touch, files, commands, arguments, foreign."""
    out: Path = Path("runs/stress")
    """Folder for report.html and findings.csv."""

    def run(self) -> None:
        """Judge all cases, write, and print.

        Raises:
            NotRobust: a case failed; the report is written nevertheless.
        """
        require_writable(self.out)
        cases = {area: cases_of(area) for area in self.areas}
        pairs = [(area, case) for area, some in cases.items() for case in some]
        findings: dict[str, list[Finding]] = {area: [] for area in cases}
        # The bar keeps to the stderr of now, while that of the commands under test is silenced.
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
            raise NotRobust(f"{len(failed)} of {len(pairs)} cases failed; {self.out / 'report.html'} has them all")


@contextlib.contextmanager
def _silently() -> Iterator[None]:
    """Without the progress bars and words of the commands that are put to the test."""
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
        f"{total.total()} extremes were handed to the public functions: {total[Verdict.RIGHT]} were answered rightly, "
        f"{total[Verdict.REFUSED]} refused with an error that says why, {total[Verdict.FAILED]} failed."
    )
    rules = (
        "A right answer is one that was known beforehand: by hand, from a law, or by brute force. An error must be of "
        "the stated type, and its message must match the stated pattern. Warnings count as failures."
    )
    sections = [Section("Verdict", [verdict, rules], [summary])]
    for area in findings:
        table = [row[1:] for row in rows if row[0] == area]
        sections.append(Section(area.capitalize(), [f"{AREAS[area].capitalize()}."], [Table("", headings[1:], table)]))
    write_page(folder / "report.html", "Stress: what happens at the extremes", sections)
    Table("", headings, rows).write_csv(folder / "findings.csv")
    plain_console().print(summary.rich())
    print(verdict)


def _row(finding: Finding) -> tuple[str, ...]:
    case = finding.case
    milliseconds = f"{1e3 * finding.seconds:.0f}"
    return case.entry, case.given, case.expected.words, finding.happened, finding.verdict.value, milliseconds
