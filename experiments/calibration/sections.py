"""Sections of the calibration report: sentences, tables and figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from belief.metrics import CalibrationError
from experiments.calibration.figures import claims, discount, fused_error, fused_nll, orientation_ranks, reliability
from experiments.calibration.measurements import Measurements
from experiments.calibration.models import UNDISCOUNTED, Fused
from experiments.calibration.orientation import LEAST_P, QUANTITIES
from experiments.calibration.targets import judge_model, judge_touches, verdict
from experiments.calibration.touches import GroupScores, TouchScores
from experiments.reporting.page import Section
from experiments.reporting.tables import Table, interval


def sections(found: Measurements) -> list[Section]:
    """All sections of the report, the verdict first."""
    return [_verdict(found), _touches(found), _models(found), _fusion(found), _stops(found), *_orientation(found)]


def _verdict(found: Measurements) -> Section:
    checks = {scores.name: judge_model(scores, found.confidence) for scores in found.models}
    touches = judge_touches(found.calibration)
    kinds = list(found.model.fused)
    targets = checks[found.model.name][kinds[0]]
    legend = "; ".join(f"{check.name.split()[0]}: {check.target}" for check in targets)
    grids = [
        Table(
            f"Targets, {kind}",
            ("model", *(check.name for check in targets)),
            [(_named(found, name), *(check.outcome for check in by_kind[kind])) for name, by_kind in checks.items()],
        )
        for kind in kinds
    ]
    return Section(
        "Verdict",
        [
            verdict(touches, checks[found.model.name], found.calibration.name, found.model.name)
            + _without_discount(found),
            _what_was_measured(found),
            f"In the tables of targets, {legend}.",
        ],
        grids,
    )


def _without_discount(found: Measurements) -> str:
    """Accuracy and stated confidence at stopping, with repeats assumed independent and with the chosen model."""
    naive = next(scores for scores in found.models if scores.name == UNDISCOUNTED)
    both = [scores.stops["one pose"].claims for scores in (naive, found.model)]
    words = [f"{c.overall.share_right:.3f} at a stated confidence of {c.overall.mean_stated:.3f}" for c in both if c]
    if len(words) < 2:
        return ""
    return (
        f" The accuracy of searches in one pose that assume independent touches is {words[0]}; with "
        f"{found.model.name} it is {words[1]}."
    )


def _what_was_measured(found: Measurements) -> str:
    known, test = found.num_objects["calibration"], found.num_objects["test"]
    sequences = ", ".join(f"{stopped.num_sequences} of {kind}" for kind, stopped in found.model.stops.items())
    return (
        f"Scene {found.scene}, seed {found.seed}. Models were fitted to {known} objects and measured on {test} others, "
        f"each touched in {found.num_rounds} rounds of all poses. Sequences: {sequences}; all have a uniform prior. "
        f"“{UNDISCOUNTED}” is the ratio model with touches in one pose assumed independent. The error by chance is the "
        "95 % quantile of the error of a perfectly calibrated model with the same predictions and independent labels. "
        "Errors of touches of one object are correlated, so the true quantile is larger; only intervals that resample "
        "objects account for this."
    )


def _touches(found: Measurements) -> Section:
    raw, calibrated = found.raw, found.calibration
    grid = Table(
        f"Single touches of the test split, {raw.report.num_rows} (in brackets: chance, or the 95 % interval)",
        (
            *("calibration", "NLL, cross-validated", "NLL", "Brier", "accuracy"),
            *("ECE", "ECE, equal mass", "smooth", "classwise", "classwise, bias-corrected"),
        ),
        [_touch_row(found, scores) for scores in found.touches],
    )

    def parts(title: str, parts_of: Callable[[TouchScores], Mapping[str, GroupScores]], error: str) -> Table:
        headings = (title, "accuracy", "NLL, raw", "NLL, calibrated", f"{error}, raw", f"{error}, calibrated")
        before, after = parts_of(raw), parts_of(calibrated)
        rows = [
            (
                label,
                f"{after[label].accuracy:.3f}",
                f"{part.nll:.4f}",
                f"{after[label].nll:.4f}",
                _error(part.ece),
                _error(after[label].ece),
            )
            for label, part in before.items()
        ]
        return Table(f"By {title}: {raw.name} and {calibrated.name}", headings, rows, is_long=True)

    sentence = (
        f"Calibrated by {calibrated.name}, which has the lowest cross-validated NLL, a touch has an NLL of "
        f"{calibrated.report.negative_log_likelihood:.4f} instead of {raw.report.negative_log_likelihood:.4f}, and a "
        f"calibration error of {calibrated.report.ece_width.value:.4f} instead of {raw.report.ece_width.value:.4f}."
    )
    curves = {scores.name: scores.report.curve for scores in (raw, calibrated)}
    more = [
        parts("pose", lambda scores: scores.poses, "ECE"),
        parts("shape", lambda scores: scores.shapes, "error of its probability"),
    ]
    return Section("A single touch", [sentence], [grid, *more], [reliability(curves)])


def _touch_row(found: Measurements, scores: TouchScores) -> tuple[str, ...]:
    report, (estimate, low, high) = scores.report, scores.classwise
    return (
        _named(found, scores.name),
        "" if scores.cross_validated_nll is None else f"{scores.cross_validated_nll:.4f}",
        f"{report.negative_log_likelihood:.4f}",
        f"{report.brier:.4f}",
        f"{report.accuracy:.4f}",
        *map(_error, (report.ece_width, report.ece_mass, report.smooth, report.ece_classwise)),
        f"{estimate:.4f} [{low:.4f}, {high:.4f}]",
    )


def _models(found: Measurements) -> Section:
    ranked = sorted(
        (scores for scores in found.models if scores.cross_validated_nll is not None),
        key=lambda scores: scores.cross_validated_nll or 0.0,
    )
    rows = [(_named(found, scores.name), f"{scores.cross_validated_nll:.4f}") for scores in ranked]
    widest = {split: max(abs(w.free - w.discounted) for w in weights) for split, weights in found.weights.items()}
    least = "at least" if any(w.low is None for weights in found.weights.values() for w in weights) else "at most"
    splits = list(found.weights)
    laws = [
        (
            str(some[0].num_touches),
            f"{some[0].discounted:.3f}",
            *(weight.words for weight in some),
        )
        for some in zip(*found.weights.values(), strict=True)
    ]
    sentences = [
        f"Cross-validation on whole objects of the calibration split chose {found.model.name}: the loss is the mean "
        "negative log posterior of the true shape after one touch, two, and so on; half of the sequences have touches "
        "in the order in which they were recorded, half stay in one pose.",
        f"The ratio model's discount has one number, ρ = {found.correlation:.3f}. The weight of n touches in one pose, "
        f"fitted freely, differs from n / (1 + (n - 1) ρ) by {least} "
        + ", ".join(f"{value:.3f} on the {split} split" for split, value in widest.items())
        + ".",
    ]
    grids = [
        Table("Sequence NLL out of fold [nats]", ("model", "loss"), rows),
        Table(
            "Weight of n touches in one pose, in touches",
            ("n", "n / (1 + (n - 1) ρ)", *(f"best on the {split} split" for split in splits)),
            laws,
        ),
    ]
    return Section("Choice of the observation model", sentences, grids, [discount(found.weights, found.correlation)])


def _fusion(found: Measurements) -> Section:
    kinds = list(found.model.fused)

    def by_number(kind: str, title: str, words: Callable[[Fused], str], *, is_long: bool) -> Table:
        numbers = [str(some.num_touches) for some in found.model.fused[kind]]
        rows = [(_named(found, scores.name), *map(words, scores.fused[kind])) for scores in found.models]
        return Table(f"{title}, {kind}", ("model, after touches", *numbers), rows, is_long=is_long)

    last = [(kind, found.model.fused[kind][-1]) for kind in kinds]
    sentence = "; ".join(
        f"{kind} after {some.num_touches} touch{'es' * (some.num_touches > 1)}: accuracy {some.accuracy:.3f}, "
        f"NLL {some.nll:.3f}, error {some.ece.value:.4f}"
        for kind, some in last
    )
    return Section(
        "Touches fused",
        [f"{found.model.name}: {sentence}."],
        [
            by_number(kind, title, words, is_long=is_long)
            for title, words, is_long in (
                ("Calibration error (chance)", lambda some: _error(some.ece), False),
                ("NLL [nats]", lambda some: f"{some.nll:.4f}", True),
                ("Accuracy", lambda some: f"{some.accuracy:.3f}", True),
                ("Classwise error (chance)", lambda some: _error(some.classwise), True),
            )
            for kind in kinds
        ],
        [fused_error(found.models, found.model.name), fused_nll(found.models, found.model.name)],
    )


def _stops(found: Measurements) -> Section:
    shown = list(dict.fromkeys([UNDISCOUNTED, "ratio", found.model.name]))
    headings = ("model", "stops", "touches", "confidence", "accuracy", "Clopper-Pearson ≥", "objects resampled")
    columns = ("model", "touches", "stops", "confidence", "accuracy [Clopper-Pearson]")
    overall, by_touches = [], []
    for kind in found.model.stops:
        rows, numbered = [], []
        for scores in found.models:
            stopped, name = scores.stops[kind], _named(found, scores.name)
            if stopped.claims is None or stopped.right is None:
                rows.append((name, "0", *[""] * 5))
                continue
            every, (_, low, high), parts = stopped.claims.overall, stopped.right, stopped.claims.by_num_touches
            mean = sum(part.count * (part.num_touches or 0) for part in parts) / every.count
            stops = (f"{every.count} of {stopped.num_sequences}", f"{mean:.2f}")
            rates = (f"{every.mean_stated:.4f}", f"{every.share_right:.4f}", f"{every.low:.4f}")
            rows.append((name, *stops, *rates, f"[{low:.4f}, {high:.4f}]"))
            for part in parts:
                rate = interval(part.share_right, part.low, part.high)
                numbered.append((name, str(part.num_touches), str(part.count), f"{part.mean_stated:.3f}", rate))
        overall.append(Table(f"Stops at {found.confidence:g}, {kind}", headings, rows))
        by_touches.append(Table(f"By touches at stopping, {kind}", columns, numbered, is_long=True))
    sentence = (
        f"A search that touches until a shape has a posterior of {found.confidence:g} stops where favourable noise and "
        "the model's confidence in it are greatest. The stated confidence must be right after few touches and after "
        "many, not only on average."
    )
    picture = claims(found.models, shown, found.confidence)
    return Section("Stopping", [sentence], [*overall, *by_touches], [picture])


def _orientation(found: Measurements) -> list[Section]:
    """The posterior of orientation and size; nothing without a joint model."""
    if not found.orientation:
        return []
    rows = [
        (
            *(test.shape, str(test.num_touches), str(test.num_objects)),
            f"{test.p_value:.2g} {'✓' if test.passes else '✗'}",
            test.worst,
            f"{test.ranks[test.worst].mean:.3f}",
            f"{test.ranks[test.worst].spread:.2f}",
            f"{max(ranks.spread for ranks in test.ranks.values()):.2f}",
        )
        for test in found.orientation
    ]
    every = [
        (test.shape, str(test.num_touches), *(f"{ranks.p_value:.2g}" for ranks in test.ranks.values()))
        for test in found.orientation
    ]
    passed = sum(test.passes for test in found.orientation)
    worst = min(found.orientation, key=lambda test: test.p_value)
    temperature = (
        "the one temperature of the model was fitted to the calibration split"
        if found.orientation_hypotheses is None
        else f"there are {found.orientation_hypotheses} hypotheses of each shape, at temperature 1"
    )
    sentences = [
        f"The joint posterior of orientation and size is calibrated in {passed} of {len(found.orientation)} tests "
        f"(p > {LEAST_P:g}, corrected for {len(QUANTITIES)} quantities).",
        "If a posterior is calibrated, the rank of the true value of any quantity among draws from the posterior of "
        "the true shape is uniform (simulation-based calibration). This holds for symmetric shapes too: orientations "
        "that look alike are equally probable before and after touches. Every object of both splits has one sequence "
        f"of touches in different poses; {temperature}. A "
        "posterior that is too narrow has a spread above 1, and a mean rank above 0.5 of the angle to the likeliest.",
    ]
    headings = (
        *("shape", "touches", "objects", "p, corrected"),
        *("quantity with the smallest p", "its mean rank", "its spread", "largest spread"),
    )
    tables = [
        Table("Uniformity of the ranks of the true orientation and size", headings, rows),
        Table("p-value by quantity", ("shape", "touches", *QUANTITIES), every, is_long=True),
    ]
    return [
        Section("Orientation and size", sentences, tables, [orientation_ranks(found.orientation, worst.shape)]),
    ]


def _named(found: Measurements, name: str) -> str:
    return f"{name} (chosen)" if name in (found.model.name, found.calibration.name) else name


def _error(error: CalibrationError) -> str:
    return f"{error.value:.4f} ({error.null_quantile:.4f})"
