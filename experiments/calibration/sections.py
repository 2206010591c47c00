"""Sections of the calibration report: sentences, tables and figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from belief.metrics import CalibrationError
from experiments.calibration.figures import claims, discount, fused_error, fused_nll, reliability
from experiments.calibration.measurements import Measurements
from experiments.calibration.models import INDEPENDENT, Fused
from experiments.calibration.targets import decimals, judge_model, judge_touches, verdict
from experiments.calibration.touches import GroupScores, TouchScores
from experiments.reporting.page import Section
from experiments.reporting.tables import Table


def sections(found: Measurements) -> list[Section]:
    """All sections of the report, the verdict first."""
    return [_verdict(found), _touches(found), _models(found), _fusion(found), _stops(found), _tables(found)]


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
            " ".join(
                [
                    verdict(touches, checks[found.model.name], found.calibration.name, found.model.name),
                    *_without_discount(found),
                ]
            ),
            _what_was_measured(found),
            f"In the tables of targets, {legend}.",
        ],
        grids,
    )


def _without_discount(found: Measurements) -> list[str]:
    """Accuracy and stated confidence at stopping, with repeats taken as independent and with the chosen model."""
    naive = next(scores for scores in found.models if scores.name == INDEPENDENT)
    claims_of = [scores.stops["one pose"].claims for scores in (naive, found.model)]
    if not all(claims_of):
        return []
    kept = [
        f"{decimals(some.overall.share_right)} at a stated confidence of {decimals(some.overall.mean_stated)}"
        for some in claims_of
        if some is not None
    ]
    return [
        f"The accuracy of searches in one pose that take its touches as independent is {kept[0]}; with "
        f"{found.model.name} it is {kept[1]}."
    ]


def _what_was_measured(found: Measurements) -> str:
    known, test = found.num_objects["calibration"], found.num_objects["test"]
    sequences = ", ".join(f"{stopped.num_sequences} of {kind}" for kind, stopped in found.model.stops.items())
    return (
        f"Scene {found.scene}, seed {found.seed}. Models were fitted to {known} objects and measured on {test} others, "
        f"each touched in {found.num_rounds} rounds of all poses. Sequences: {sequences}; all have a uniform prior. "
        f"“{INDEPENDENT}” is the ratio model with touches in one pose taken as independent. The error by chance is the "
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
            *("ECE", "ECE, equal mass", "smooth", "classwise", "classwise, bias taken off"),
        ),
        [_touch_row(found, scores) for scores in found.touches],
    )

    def parts(title: str, parts_of: Callable[[TouchScores], Mapping[str, GroupScores]], error: str) -> Table:
        headings = (title, "accuracy", "NLL, raw", "NLL, calibrated", f"{error}, raw", f"{error}, calibrated")
        before, after = parts_of(raw), parts_of(calibrated)
        rows = [
            (
                label,
                decimals(after[label].accuracy),
                f"{part.nll:.4f}",
                f"{after[label].nll:.4f}",
                _error(part.ece),
                _error(after[label].ece),
            )
            for label, part in before.items()
        ]
        return Table(f"By {title}: {raw.name} and {calibrated.name}", headings, rows, is_long=True)

    sentence = (
        f"Calibrated by {calibrated.name}, which has the least cross-validated NLL, a touch has an NLL of "
        f"{calibrated.report.negative_log_likelihood:.4f} instead of {raw.report.negative_log_likelihood:.4f}, and a "
        f"calibration error of {decimals(calibrated.report.ece_width.value, 4)} instead of "
        f"{decimals(raw.report.ece_width.value, 4)}."
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
        f"{report.brier.score:.4f}",
        decimals(report.accuracy, 4),
        *map(_error, (report.ece_width, report.ece_mass, report.smooth, report.ece_classwise)),
        f"{decimals(estimate, 4)} [{decimals(low, 4)}, {decimals(high, 4)}]",
    )


def _models(found: Measurements) -> Section:
    ranked = sorted(
        (scores for scores in found.models if scores.cross_validated_nll is not None),
        key=lambda scores: scores.cross_validated_nll or 0.0,
    )
    rows = [(_named(found, scores.name), f"{scores.cross_validated_nll:.4f}") for scores in ranked]
    widest = {split: max(abs(w.free - w.discounted) for w in weights) for split, weights in found.weights.items()}
    splits = list(found.weights)
    laws = [
        (
            str(some[0].num_touches),
            f"{some[0].discounted:.3f}",
            *(f"{w.free:.3f} [{w.low:.3f}, {w.high:.3f}]" for w in some),
        )
        for some in zip(*found.weights.values(), strict=True)
    ]
    sentences = [
        f"Cross-validation on whole objects of the calibration split chose {found.model.name}: the loss is the mean "
        "negative log posterior of the true shape after one touch, two, and so on, half of it of touches in the order "
        "they came and half of touches in one pose.",
        f"The ratio model's discount has one number, ρ = {found.correlation:.3f}. Left free, the weight that n touches "
        "in one pose should have differs from n / (1 + (n - 1) ρ) by at most "
        + ", ".join(f"{decimals(value)} on the {split} split" for split, value in widest.items())
        + ".",
    ]
    grids = [
        Table("Sequence NLL out of fold [nats]", ("model", "loss"), rows),
        Table(
            "What n touches in one pose are worth, in touches",
            ("n", "n / (1 + (n - 1) ρ)", *(f"best on the {split} split" for split in splits)),
            laws,
        ),
    ]
    return Section("Which model, and why", sentences, grids, [discount(found.weights, found.correlation)])


def _fusion(found: Measurements) -> Section:
    kinds = list(found.model.fused)

    def by_number(kind: str, title: str, words: Callable[[Fused], str], *, is_long: bool) -> Table:
        numbers = [str(some.num_touches) for some in found.model.fused[kind]]
        rows = [(_named(found, scores.name), *map(words, scores.fused[kind])) for scores in found.models]
        return Table(f"{title}, {kind}", ("model, after touches", *numbers), rows, is_long=is_long)

    last = [(kind, found.model.fused[kind][-1]) for kind in kinds]
    sentence = "; ".join(
        f"{kind}: accuracy {decimals(some.accuracy)}, NLL {some.nll:.3f}, error {decimals(some.ece.value, 4)}"
        for kind, some in last
    )
    return Section(
        "Touches fused",
        [f"{found.model.name} after {last[0][1].num_touches} touches: {sentence}."],
        [
            by_number(kind, title, words, is_long=is_long)
            for title, words, is_long in (
                ("Calibration error (chance)", lambda some: _error(some.ece), False),
                ("NLL [nats]", lambda some: f"{some.nll:.4f}", True),
                ("Accuracy", lambda some: decimals(some.accuracy), True),
                ("Classwise error (chance)", lambda some: _error(some.classwise), True),
            )
            for kind in kinds
        ],
        [fused_error(found.models, found.model.name), fused_nll(found.models, found.model.name)],
    )


def _stops(found: Measurements) -> Section:
    kinds = list(found.model.stops)
    shown = list(dict.fromkeys([INDEPENDENT, "ratio", found.model.name]))
    overall, by_touches = [], []
    for kind in kinds:
        rows, numbered = [], []
        for scores in found.models:
            stopped = scores.stops[kind]
            name = _named(found, scores.name)
            if stopped.claims is None or stopped.right is None:
                rows.append((name, "0", *[""] * 5))
                continue
            every, (_, low, high) = stopped.claims.overall, stopped.right
            mean = sum(s.count * (s.num_touches or 0) for s in stopped.claims.by_num_touches) / every.count
            rows.append(
                (
                    name,
                    f"{every.count} of {stopped.num_sequences}",
                    f"{mean:.2f}",
                    decimals(every.mean_stated, 4),
                    decimals(every.share_right, 4),
                    decimals(every.low, 4),
                    f"[{decimals(low, 4)}, {decimals(high, 4)}]",
                )
            )
            numbered += [
                (
                    name,
                    str(score.num_touches),
                    str(score.count),
                    decimals(score.mean_stated),
                    f"{decimals(score.share_right)} [{decimals(score.low)}, {decimals(score.high)}]",
                )
                for score in stopped.claims.by_num_touches
            ]
        headings = ("model", "stops", "touches", "claim", "right", "Clopper-Pearson ≥", "objects resampled")
        overall.append(Table(f"Stops at {found.confidence:g}, {kind}", headings, rows))
        columns = ("model", "touches", "stops", "claim", "right [Clopper-Pearson]")
        by_touches.append(Table(f"By touches at the stop, {kind}", columns, numbered, is_long=True))
    sentences = [
        f"A search that touches until a shape has {found.confidence:g} of the posterior stops where luck, and a "
        "model's faith in it, are greatest. What it then claims must be true after few touches and after many, not "
        "just on average."
    ]
    return Section(
        "Where a search stops",
        sentences,
        [*overall, *by_touches],
        [claims(found.models, shown, found.confidence)],
    )


def _tables(found: Measurements) -> Section:
    kept = found.kept
    rows = [(str(m), f"{nats:.4f}", f"{nats / kept.touch:.1%}") for m, nats in kept.tables.items()]
    rows.append(("the touch itself", f"{kept.touch:.4f}", ""))
    sentence = (
        f"Planners see a touch as one of M outcomes. Of what it tells about the shape by {found.model.name}, mean over "
        "poses, a table keeps this much; the touch's own is a mean over sampled touches, accurate to about 0.01 nats."
    )
    return Section(
        "What a table of outcomes keeps", [sentence], [Table("Information", ("M", "nats", "of the touch's"), rows)]
    )


def _named(found: Measurements, name: str) -> str:
    return f"{name} (chosen)" if name in (found.model.name, found.calibration.name) else name


def _error(error: CalibrationError) -> str:
    return f"{decimals(error.value, 4)} ({decimals(error.null_quantile, 4)})"
