"""Active classification: which action to take next to learn the class of a case, when to stop, and how sure that is.

The search of touch in general words: a class is a shape, an action a pose, an outcome a touch, a context what an
object's hypotheses are. A case is a search with one object.

>>> tests = np.array([[[0.9, 0.1], [0.2, 0.8]], [[0.6, 0.4], [0.5, 0.5]]])        # p(outcome | action, class)
>>> task = ActiveClassification.from_probs(tests, classes=("ill", "well"), actions=("blood", "eyes"), stop=0.8)
>>> case = task.start()
>>> case.ask()
'blood'
>>> case.tell(0)
>>> case.ask(), case.answer, round(case.stated, 2)
(None, 'ill', 0.82)
"""

from __future__ import annotations

import warnings
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from numbers import Number, Real
from typing import Annotated, Any

import numpy as np
import scipy  # whose parts load at first use
from numpy.typing import ArrayLike, NDArray

from belief.bayes import Belief
from belief.composition import Composition
from belief.constraints import MOST_COUNT, Count, Positive, Within, check, require_rule
from belief.errors import ImpossibleObservation, InvalidArgument
from belief.frozen import FrozenArrays
from belief.naming import Name, checked_names, few, index_of, one_line, shown
from belief.observation_model.context_fit import OutcomeCode, as_rows, as_table, fit_contexts, in_order
from belief.observation_model.context_model import MISSING, ContextModel
from belief.problem import Probe, SearchProblem, Touch, Unsure
from belief.seeding import checked_key
from belief.statistics import wilson_interval
from belief.statistics.stop_thresholds import CandidateStops, CertifiedThresholds, certified_thresholds
from belief.table import Table, Tabular, Value
from belief.validation import MOST_REPEATED, Floats, as_real, at, checked_indices, normalise_probs, require_count
from planners.decider import Decider, Decision, InformationState, ProbeSelector
from planners.probing import FixedOrder, RandomOrder, ShapeInformationGain
from planners.session import Session

_REMEMBERED = 100_000  # decisions, and steps of cases
_BY_CHANCE = 1e-6  # probability of so many cases as in the fit, below which they are of the fit
_HEIGHTS, _SLOPES = np.linspace(0.2, 4.5, 44), (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)  # a and b of planned stops
_COST = Within(1e-150, 1e150)  # sums and ratios of these are floats
_STOP = Within(0.0, 1.0, open_low=True)
_ANY, _SHOWN = float(np.nextafter(0.0, 1.0)), 10  # a stop that every probability reaches; classes of a case that prints
RULES = ("adaptive", "random", "fixed")
"""How actions are chosen: by what they tell for their cost, in random order, or in the order of their numbers."""


@dataclass(frozen=True, eq=False)
class ActiveClassification(FrozenArrays):
    """A task: cases have one of some classes, and actions have outcomes that tell about it.

    :meth:`from_probs` makes it from arrays, :meth:`from_cases` from a table of past cases; the constructor takes a
    fitted model.

    Attributes:
        model: p(outcome | action, class, context).
        actions: names of the P actions; "0", "1", … by default.
        prior: probabilities of the K classes; equal by default.
        costs: of the actions, ``(P,)`` or by name, above zero; all 1 by default.
        stop: probability of a class at which it is named; several are for 0, 1, 2, … actions, the last one for more.
            Infinite for never.
        max_actions: number of actions of a case at which the likeliest class is named; by default all, once each.
        budget: cost that the actions of a case do not exceed.
        error_cost: cost of a wrong answer: a case also stops where no action reduces the expected cost of an error by
            more than its own cost. None: cases stop by the other rules alone.
        depth: actions to look ahead, 1 or 2. With 2 it finds actions that tell only what to do next.
        code: how values of cases become outcomes; None where they are outcomes.
        certificate: what is promised of the stops, and from how many cases; None without :meth:`certified`.
        fitted: checksums of the cases that the model was fitted to, ``(n,)``, which certify nothing; None if not known.

    Raises:
        ValueError: arguments that do not fit each other, or are out of their range.
    """

    model: ContextModel
    actions: Sequence[str] = ()
    prior: Floats | None = None
    costs: Floats | None = None
    stop: float | tuple[float, ...] = 0.95
    max_actions: Count | None = None
    budget: Positive | None = None
    error_cost: Annotated[float, _COST] | None = None
    depth: Annotated[int, Within(1, 2)] = 2
    code: OutcomeCode | None = field(default=None, repr=False)
    certificate: CertifiedThresholds | None = field(default=None, repr=False)
    fitted: NDArray[np.int64] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        check(self)
        number, labels = self.model.num_poses, self.model.shape_labels
        names = checked_names("actions", self.actions or tuple(map(str, range(number))))
        prior = normalise_probs(np.full(len(labels), 1.0 / len(labels)) if self.prior is None else self.prior, "prior")
        given: Any = self.costs
        if isinstance(given, Mapping):
            if set(given) != set(names):
                raise InvalidArgument(
                    f"costs by name are of the actions {few(names)}, got {few(list(map(str, given)))}"
                )
            given = [given[name] for name in names]
        costs = np.ones(number) if given is None else np.asarray(as_real(given, "costs"), np.float64)
        if len(names) != number or costs.shape != (number,):
            raise InvalidArgument(f"{number} actions need as many names and costs, got {len(names)} and {costs.shape}")
        if wrong := [f"{n!r} costs {c:g}" for n, c in zip(names, costs, strict=True) if _COST.broken(float(c))]:
            raise InvalidArgument(
                f"actions have costs > 0: {few(wrong)}; give what is free a small cost, such as 1e-3, and keep all "
                f"within [{_COST.low:g}, {_COST.high:g}]"
            )
        if prior.shape != (len(labels),):
            raise InvalidArgument(f"{len(labels)} classes need as many probabilities, got {prior.shape}")
        stops = tuple(np.atleast_1d(self.stop).tolist())
        if not stops or any(_STOP.broken(one) and one != np.inf for one in stops):
            hint = f" ({stops[0] / 100:g}?)" if stops and not Within(1.0, 100.0).broken(stops[0]) else ""
            raise InvalidArgument(f"stop must be in (0, 1], or infinite for never, got {shown(self.stop)}{hint}")
        if self.certificate is not None and stops != _promised(self.certificate):
            raise InvalidArgument(
                "the certificate is of other stops: leave it out (certificate=None), and certify the task anew"
            )
        for name, value in (("actions", names), ("prior", prior), ("costs", costs), ("stop", stops)):
            object.__setattr__(self, name, value)
        self.freeze()

    def __repr__(self) -> str:
        stops = [{np.inf: "never", _ANY: "any"}.get(one, f"{one:g}") for one in np.atleast_1d(self.stop).tolist()]
        parts = [f"classes: {few(self.classes)}", f"actions: {few(tuple(self.actions))}", f"stop: {few(stops)}"]
        if self.certificate is not None:
            parts.append(f"certificate: {self.certificate.note or self.certificate.promise}")
        return f"{type(self).__name__}({'; '.join(parts)})"

    @classmethod
    def from_probs(
        cls,
        probs: ArrayLike,
        classes: Sequence[str] | None = None,
        actions: Sequence[str] = (),
        weights: ArrayLike | None = None,
        is_repeatable: bool = False,
        **settings: Any,
    ) -> ActiveClassification:
        """The task of known probabilities.

        Args:
            probs: p(outcome | action, class), ``(P, K, M)``, or with H contexts of each class ``(P, K, H, M)``. Actions
                may have different numbers of outcomes: a list of P arrays.
            classes: names of the K classes; "0", "1", … by default.
            actions: names of the P actions.
            weights: p(context | class), ``(K, H)``; equal by default.
            is_repeatable: whether another try of an action is independent, given class and context.
            settings: as of the class.
        """
        table = np.asarray(as_real(_of_equal_length(probs), "probs"), np.float64)
        if table.ndim not in (3, 4):
            raise InvalidArgument(f"probs must be (P, K, M), or with contexts (P, K, H, M), got {table.shape}")
        labels = checked_names("classes", tuple(map(str, range(table.shape[1]))) if classes is None else classes)
        shares = None if weights is None else np.asarray(weights, np.float64)
        return cls(ContextModel(labels, table, shares, is_repeatable=is_repeatable), actions, **settings)

    @classmethod
    def from_cases(
        cls,
        cases: ArrayLike,
        labels: Sequence[Name] | NDArray[Any],
        actions: Sequence[str] = (),
        *,
        groups: Sequence[Sequence[Name] | str] | None = None,
        num_contexts: int | Sequence[int] = (1, 2, 3, 4, 5, 6),
        num_bins: int | None = None,
        seed: int = 0,
        **settings: Any,
    ) -> ActiveClassification:
        """The task of a table of past cases with known classes; its model is fitted to them.

        Args:
            cases: values of columns, ``(n, C)``, finite numbers, also as text, or words; NaN, None or "" where missing.
                A data frame, an array, or a list of rows or of dictionaries, such as that of a ``csv.DictReader``.
            labels: class of each case, ``(n,)``, any values that can be sorted.
            actions: names of the P actions; by default those of the columns of a data frame or of dictionaries.
            groups: columns that one action shows, for each action, by name or index; by default each is an action.
            num_contexts: as of :func:`~belief.observation_model.context_fit.fit_contexts`.
            num_bins: most outcomes of a column; by default 4 to 16, by the number of cases.
            seed: of the fit.
            settings: as of the class; ``prior`` is by default the share of each class among the cases.
        """
        _require_same_rows(cases, labels)
        cases = as_rows(cases)
        given = _flat(labels)
        for place, label in enumerate(labels if isinstance(labels, list | tuple) else given.tolist()):
            if label is None or label != label or label == "":
                raise InvalidArgument(f"a label is missing{at((place,))}: leave the case out")
        try:
            values, number = np.unique(given, return_inverse=True)
        except TypeError as error:
            raise InvalidArgument(f"labels must be of one kind, so that they can be sorted: {error}") from error
        names = tuple(str(value) for value in values.tolist())
        if len(names) < 2:
            raise InvalidArgument(f"cases must be of two or more classes, got {few(names) or 'none'}")
        code = OutcomeCode.of(cases, groups, num_bins)
        outcomes = code.outcomes(cases)
        if len(number) != len(outcomes):
            raise InvalidArgument(f"{len(outcomes)} cases need as many labels, got {len(number)}")
        if not len(actions) and groups is None:
            actions = tuple(map(str, getattr(cases, "columns", ())))
        model = fit_contexts(outcomes, number, names, num_contexts, code.sizes(), seed)
        shares = (np.bincount(number, minlength=len(names)) + 1.0) / (len(number) + len(names))
        task = cls(model, actions, code=code, fitted=_checksums(outcomes, number), **{"prior": shares, **settings})
        for what, alike in (("classes", names), *((f"words of {own}", words) for own, words in code.words_of())):
            known = dict[str, str]()
            for name in alike:
                if (other := known.setdefault(" ".join(name.casefold().split()), name)) != name:
                    warnings.warn(f"the {what} {other!r} and {name!r} differ in spaces or case only", stacklevel=2)
        if empty := [task.actions[i] for i in np.flatnonzero((outcomes == MISSING).all(axis=0)).tolist()]:
            warnings.warn(f"no case has a value of {few(empty)}: leave out what is never seen", stacklevel=2)
        return task

    def planned(self, error_cost: float, num_cases: int = 1000, seed: int = 0) -> ActiveClassification:
        """The task with the stops of the least expected cost, of actions and of errors, in cases drawn from its model.

        The threshold falls with the number of actions: early it pays to be sure, late only cases are left that more
        actions hardly decide. It is Φ(a n^-b) after n - 1 actions, with the best of some a and b.

        A certificate is of its stops, so that the new task has none.

        Args:
            error_cost: cost of a wrong answer, in the unit of the costs.
            num_cases: drawn from the model.
            seed: of the cases.
        """
        require_rule("error_cost", error_cost, _COST)
        require_count("num_cases", num_cases, most=MOST_REPEATED)
        assert self.prior is not None, "set at construction"
        assert self.costs is not None, "set at construction"
        rng, every = np.random.default_rng(checked_key(seed)), range(self.model.num_poses)
        truth = rng.choice(len(self.classes), num_cases, p=self.prior)
        cases = [[_outcome(touch) for touch in self.model.sample(int(k), every, rng)] for k in truth]
        whole = replace(self, stop=np.inf, error_cost=None, code=None, certificate=None)
        played = whole.evaluate(np.array(cases), truth, ("adaptive",)).answers["adaptive"]
        lengths = np.array([len(one.actions) for one in played])
        steps, rows = np.arange(lengths.max() + 1), np.arange(num_cases)
        stated, spent = np.ones((2, num_cases, len(steps)))
        for row, one in enumerate(played):
            stated[row, : lengths[row] + 1] = one.probs.max(axis=1)
            spent[row, : lengths[row] + 1] = np.cumsum([0.0, *self.costs[list(one.actions)]])
        costs = {}
        for stops in (scipy.special.ndtr(height * (steps + 1.0) ** -slope) for height in _HEIGHTS for slope in _SLOPES):
            over = (stated >= stops) | (steps >= lengths[:, None])
            at = over.argmax(axis=1)
            costs[tuple(stops.tolist())] = float((spent + error_cost * (1.0 - stated))[rows, at].mean())
        return replace(self, stop=min(costs, key=lambda stops: costs[stops]), certificate=None)

    @property
    def limit(self) -> int:
        """Largest number of actions of a case."""
        return self.model.num_poses if self.max_actions is None else self.max_actions

    @property
    def classes(self) -> tuple[str, ...]:
        """Names of the K classes."""
        return self.model.shape_labels

    def start(self, seed: int | Sequence[int] = 0, rule: str = "adaptive") -> Case:
        """A new case, about which nothing is known yet.

        Args:
            seed: of the random order.
            rule: how actions are chosen, one of :data:`RULES`.
        """
        return Case(self, self._session(self._decider(rule), seed))

    def evaluate(
        self, cases: ArrayLike, labels: Sequence[Name] | NDArray[Any], rules: Sequence[str] = ("adaptive", "random")
    ) -> Evaluation:
        """Classify cases of known class, each by every rule; what is missing cannot be asked, nor anything twice.

        Args:
            cases: as of :meth:`from_cases`, or outcomes ``(n, P)`` where the task has no table.
            labels: class of each case, ``(n,)``, by name or index.
            rules: how actions are chosen, of :data:`RULES`.

        Raises:
            ValueError: arrays that do not fit each other, or an unknown class.
        """
        _require_same_rows(cases, labels)
        outcomes, truth = self._outcomes(cases), self._truth(labels)
        if len(outcomes) != len(truth):
            raise InvalidArgument(f"{len(outcomes)} cases need as many labels, got {len(truth)}")
        found = {}
        for rule in rules:
            decider = self._decider(rule, is_once=True)
            alike = _AlikeCases() if rule != "random" else None
            answers = []
            for number, (row, label) in enumerate(zip(outcomes.tolist(), truth.tolist(), strict=True)):
                try:
                    answers.append(self._played(row, int(label), decider, number, alike))
                except ImpossibleObservation as error:
                    raise ImpossibleObservation(
                        f"the case{at((number,))} has outcomes {shown(row)}, which no class can have: {error}"
                    ) from error
            found[rule] = tuple(answers)
        return Evaluation(self, found)

    def certified(
        self,
        cases: ArrayLike,
        labels: Sequence[Name] | NDArray[Any],
        risk: float = 0.05,
        confidence: float = 0.9,
    ) -> ActiveClassification:
        """The task with stops at which at most a fraction of answers is wrong, after every number of actions.

        The promise holds with probability ``confidence`` over the cases, for cases drawn as these
        (:mod:`belief.statistics.stop_thresholds`); it does not need that stated probabilities are right. Cases must be
        others than those that the model was fitted to. Where a limit ends a case before, its answer has no promise.

        Returns:
            The task with these stops; its ``certificate`` prints as a table.

        Raises:
            InvalidArgument: the model was fitted to some of the cases; or as :meth:`evaluate`.
        """
        self._require_fresh(cases, labels)
        whole = replace(self, stop=np.inf, certificate=None)
        played = whole.evaluate(cases, labels, ("adaptive",)).answers["adaptive"]
        order = np.random.default_rng(0).permutation(len(played)).tolist()  # which says nothing about the cases
        rows = [(number, step, probs) for number, i in enumerate(order) for step, probs in enumerate(played[i].probs)]
        truth = np.array([played[i].truth for i in order])
        searches, steps = (np.array([row[part] for row in rows]) for part in (0, 1))
        table = np.array([row[2] for row in rows])
        wrong = table.argmax(axis=1) != truth[searches]
        candidates = CandidateStops(searches, steps, np.minimum(table.max(axis=1), 1.0), wrong, len(played))
        thresholds = certified_thresholds(candidates, risk, confidence, words=("actions", "cases"))
        return replace(self, stop=_promised(thresholds), certificate=thresholds)

    def _require_fresh(self, cases: ArrayLike, labels: Sequence[Name] | NDArray[Any]) -> None:
        """Check that no more cases equal some of the fit than may by chance, or all of them in their order.

        A fresh case equals one of the fit with about the probability that a case of the fit equals another one (Good
        and Turing).
        """
        if self.fitted is None:
            return
        rows = _checksums(self._outcomes(cases), self._truth(labels))
        kinds, counts = np.unique(self.fitted, return_counts=True)
        chance = 1.0 - np.count_nonzero(counts == 1) / (len(self.fitted) + 1)
        number = np.count_nonzero(np.isin(rows, kinds))
        if np.array_equal(rows, self.fitted) or scipy.special.bdtrc(number - 1, len(rows), chance) < _BY_CHANCE:
            raise InvalidArgument(
                f"{number} of {len(rows)} cases equal those that the model was fitted to, where stops are right too "
                "often for a promise: fit to one part, as from_cases(cases[::2], labels[::2]), and certify with the "
                "other, cases[1::2] and labels[1::2]"
            )

    def _session(self, decider: Decider, seed: int | Sequence[int]) -> Session:
        number = self.model.num_poses
        limit = min(self.limit + number, MOST_COUNT)  # each action may turn out to be missing
        problem = SearchProblem(
            self.classes, tuple(self.actions), 1, Composition.INDEPENDENT, touch_limit=limit, unsure_reward=0.0
        )
        assert self.prior is not None, "set at construction"
        prior = Belief.from_probs(self.classes, self.prior)
        return Session(problem, decider, 0, self.model, seed, abstain=False, prior=prior)

    def _decider(self, rule: str, is_once: bool = False) -> Decider:
        if rule not in RULES:
            raise InvalidArgument(f"a rule is one of {', '.join(RULES)}, got {rule!r}")
        if rule != "adaptive":
            order = RandomOrder() if rule == "random" else FixedOrder()
            return _Rule(self, order, order, is_once)
        table = self.model.outcome_table()
        last, selector = (ShapeInformationGain(table, depth=depth, costs=self.costs) for depth in (1, self.depth))
        return _Rule(self, selector, last, is_once, {})

    def _played(
        self, row: Sequence[int], truth: int, decider: Decider, number: int, alike: _AlikeCases | None
    ) -> Answer:
        """The answer to a case; that of an earlier one if it is the same in all that is asked."""
        if alike is not None and (found := alike.answer(row)) is not None:
            return replace(found, truth=truth)
        case = Case(self, self._session(decider, number))
        probs, asked = [case.belief.probs], list[int]()
        while (action := case.asked) is not None:
            case.tell_outcome(row[action], action)
            asked.append(action)
            if row[action] != MISSING:
                probs.append(case.belief.probs)
        named, stated = int(case.belief.log_probs.argmax()), case.stated
        answer = Answer(truth, named, stated, case.is_certain, case.taken, case.cost, np.array(probs))
        if alike is not None:
            alike.add(row, asked, answer)
        return answer

    def _outcomes(self, cases: ArrayLike) -> NDArray[np.int64]:
        if self.code is not None:
            return self.model.outcomes_of(self.code.outcomes(cases))
        named = in_order(cases, self.actions) if isinstance(cases, list | tuple) else cases
        return self.model.outcomes_of(np.nan_to_num(as_table(named), nan=MISSING))

    def _truth(self, labels: Sequence[Name] | NDArray[Any]) -> NDArray[np.int64]:
        found = _flat(labels)
        if found.dtype.kind in "iu" and not set(map(str, np.unique(found).tolist())) <= set(self.classes):
            return checked_indices("labels", found, len(self.classes))
        return np.array([index_of("class", self.classes, str(label)) for label in found.tolist()], np.int64)


class Case(Tabular):
    """A case whose actions somebody else carries out: ask which one, tell its outcome. Prints as a table of classes."""

    def __init__(self, task: ActiveClassification, session: Session) -> None:
        self._task, self.session = task, session

    def __copy__(self) -> Case:
        return Case(self._task, copy(self.session))  # a copy goes on by itself

    def __repr__(self) -> str:
        return one_line(type(self), f"{self.answer!r}, probability {self.stated:.2f}, cost {self.cost:g}")

    def table(self) -> Table:
        """The likeliest classes, and the cost of the actions so far."""
        probs = self.belief.probs
        rows = [(self.belief.labels[k], float(probs[k])) for k in np.argsort(-probs, kind="stable")[:_SHOWN].tolist()]
        return Table("", ["class", ("probability", ".2f")], rows, f"Actions: {len(self.taken)}, cost: {self.cost:g}.")

    @property
    def asked(self) -> int | None:
        """Index of the action to take next; None when the case is decided."""
        action = self.session.ask()
        return action.pose if isinstance(action, Probe) else None

    def ask(self) -> str | None:
        """Name of the action to take next; None when the case is decided."""
        action = self.asked
        return None if action is None else self._task.actions[action]

    def tell(self, outcome: Any, action: Name | None = None) -> None:
        """Say what came of an action.

        Args:
            outcome: index of the outcome; for a task from a table the value or word of the column, or the values of all
                columns of the action. None or NaN if the action cannot be carried out: another one is then asked for.
            action: name or index, if it is another one than was asked for.

        Raises:
            ValueError: no such outcome or action, or the case is decided.
        """
        pose = self.asked if action is None else index_of("action", tuple(self._task.actions), action)
        if pose is None:
            raise InvalidArgument(f"the case is decided: {self.answer}")
        if pose in self.taken and not self._task.model.is_repeatable:
            name = self._task.actions[pose]
            raise InvalidArgument(f"{name!r} was told already; undo() takes back what was told last")
        if outcome is None or (isinstance(outcome, Real) and outcome != outcome):
            self.tell_outcome(MISSING, pose)
        elif self._task.code is None:
            self.tell_outcome(self._checked(outcome, pose), pose)
        else:
            self.tell_outcome(self._task.code.told(pose, outcome), pose)

    def _checked(self, outcome: Any, pose: int) -> int:
        """An index that is an outcome of the action."""
        possible: list[Any] = np.flatnonzero((self._task.model.probs[pose] > 0.0).any(axis=(0, 1))).tolist()
        if not isinstance(outcome, Number) or outcome not in possible:
            raise InvalidArgument(
                f"{self._task.actions[pose]!r} has the outcomes {few(tuple(map(str, possible)))}, got {outcome!r:.40}"
            )
        return int(possible[possible.index(outcome)])

    def undo(self) -> str:
        """Take back what was told last, and name that action.

        Raises:
            InvalidArgument: nothing was told.
        """
        history = self.session.scene.touches(0)
        self.session.undo()
        return self._task.actions[history[-1].pose]

    def tell_outcome(self, outcome: int, action: int | None = None) -> None:
        """As :meth:`tell`, by the index of the outcome, -1 where it is missing, and of the action."""
        pose = self.asked if action is None else action
        assert pose is not None, "the case goes on"
        self.session.tell(Touch(pose, features=np.array([float(outcome)])))

    @property
    def belief(self) -> Belief:
        """Posterior of the classes."""
        return self.session.belief

    @property
    def answer(self) -> str:
        """The likeliest class."""
        return self.belief.labels[int(self.belief.log_probs.argmax())]

    @property
    def stated(self) -> float:
        """Probability of the likeliest class."""
        return float(self.belief.probs.max())

    @property
    def is_certain(self) -> bool:
        """Whether the answer has the probability at which a case stops."""
        return self.stated >= _limit(self._task.stop, len(self.taken))

    @property
    def taken(self) -> tuple[int, ...]:
        """Actions whose outcomes are known, in their order."""
        return _taken(self.session.scene.touches(0))

    @property
    def cost(self) -> float:
        """Cost of these actions."""
        assert self._task.costs is not None, "set at construction"
        return float(self._task.costs[list(self.taken)].sum())


@dataclass(frozen=True, eq=False)
class Answer(FrozenArrays):
    """One case that was classified: true and named class, stated probability, and the actions.

    ``is_certain`` says whether it stopped at its threshold; ``probs (n + 1, K)`` are the probabilities of the classes
    after 0 to n actions.
    """

    truth: int
    named: int
    stated: float
    is_certain: bool
    actions: tuple[int, ...]
    cost: float
    probs: Floats

    @property
    def is_right(self) -> bool:
        """Whether the named class is the true one."""
        return self.named == self.truth


class _AlikeCases:
    """Answers to cases by what was asked and its outcomes, for rules that ask the same after the same outcomes."""

    def __init__(self) -> None:
        self._steps: dict[tuple[int, ...], int | Answer] = {}  # outcomes so far: the next action, or the answer

    def answer(self, row: Sequence[int]) -> Answer | None:
        """The answer to a case with these outcomes of all actions; None if none like it was added."""
        told: tuple[int, ...] = ()
        while isinstance(step := self._steps.get(told), int):
            told = (*told, row[step])
        return step

    def add(self, row: Sequence[int], asked: Sequence[int], answer: Answer) -> None:
        """Keep the answer to a case, after these actions."""
        if len(self._steps) >= _REMEMBERED:
            self._steps.clear()
        told: tuple[int, ...] = ()
        for action in asked:
            self._steps[told] = action
            told = (*told, row[action])
        self._steps[told] = answer


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation(Tabular):
    """How cases were classified by some rules; prints as a table.

    Attributes:
        task: the task.
        answers: of each rule, in the order of the cases.
    """

    task: ActiveClassification
    answers: Mapping[str, tuple[Answer, ...]]

    def __repr__(self) -> str:
        return one_line(type(self), *(f"{rule}: {len(found)} cases" for rule, found in self.answers.items()))

    def table(self) -> Table:
        """For each rule: right answers, what was stated, actions and their cost, "with errors" that of errors too."""
        rows, error_cost = [], self.task.error_cost
        for rule, answers in self.answers.items():
            right, number = sum(one.is_right for one in answers), len(answers)
            certain, cost = [one for one in answers if one.is_certain], float(np.mean([one.cost for one in answers]))
            rows.append(
                (
                    rule,
                    right / number,
                    wilson_interval(right, number),
                    float(np.mean([one.stated for one in answers])),
                    float(np.mean([len(one.actions) for one in answers])),
                    cost,
                    *(() if error_cost is None else (cost + error_cost * (1.0 - right / number),)),
                    len(certain) / number,
                    float(np.mean([one.is_right for one in certain])) if certain else None,
                )
            )
        spec = ".3f"
        columns = [
            *("rule", ("right", spec), ("95 %", spec), ("stated", spec), ("actions", ".2f"), ("cost", ".2f")),
            *([] if error_cost is None else [("with errors", ".2f")]),
            *(("certain", spec), ("right of these", spec)),
        ]
        return Table("", columns, rows, f"{number} cases.{self._worst()}" if rows else "")

    def by_class(self) -> Table:
        """For each rule and class: cases of it and how many are right; cases named so and how many of these are."""
        rows: list[tuple[Value, ...]] = []
        for rule, answers in self.answers.items():
            cases, right = _by_truth(answers)
            said = Counter(one.named for one in answers)
            for k, label in enumerate(self.task.classes):
                cells: list[Value] = []
                for number in (cases[k], said[k]):
                    share = (right[k] / number, wilson_interval(right[k], number)) if number else (None, None)
                    cells += [number, *share]
                rows.append((rule, label, *cells))
        spec = ".3f"
        own, named = [("right", spec), ("95 %", spec)], [("right of these", spec), ("95 % of these", spec)]
        return Table("", ["rule", "class", ("cases", "d"), *own, ("named so", "d"), *named], rows)

    def _worst(self) -> str:
        """A sentence about the class of which the first rule names the smallest share rightly, if that is below 0.5."""
        rule, answers = next(iter(self.answers.items()))
        cases, right = _by_truth(answers)
        worst = min(cases, key=lambda k: right[k] / cases[k], default=0)
        if 2 * right[worst] >= cases[worst]:
            return ""
        label = self.task.classes[worst]
        return f" Of {label!r}, {rule} names {right[worst]} of {cases[worst]} rightly: see by_class()."

    def after(self, num_actions: int, rule: str = "adaptive") -> tuple[float, float]:
        """Share of right answers, and mean stated probability, had each case been answered after so many actions."""
        rows = [one.probs[min(num_actions, len(one.probs) - 1)] for one in self.answers[rule]]
        right = [int(row.argmax()) == one.truth for row, one in zip(rows, self.answers[rule], strict=True)]
        return float(np.mean(right)), float(np.mean([row.max() for row in rows]))


@dataclass(frozen=True, eq=False)
class _Rule:
    """Chooses among the actions that are open and affordable, and stops as the task says."""

    task: ActiveClassification
    selector: ProbeSelector
    last: ProbeSelector  # for the last action of a case
    is_once: bool  # whether an action can be taken once only: a case that is read has one outcome of each
    known: dict[Any, Decision] | None = field(default=None, repr=False)  # of selectors without a random part

    def decide(self, info: InformationState, rng: np.random.Generator) -> Decision:
        """See :class:`planners.decider.Decider`."""
        task, taken = self.task, _taken(info.history)
        assert task.costs is not None, "set at construction"
        stated, limit = float(info.probs.max()), task.limit
        may_take = (info.uses == 0) | (task.model.is_repeatable and not self.is_once)
        if task.budget is not None:
            may_take &= task.costs + task.costs[list(taken)].sum() <= task.budget * (1.0 + 1e-12)
        is_over = stated >= _limit(task.stop, len(taken)) or len(taken) >= limit or not may_take.any()
        if is_over or not self._is_worth_it(info, stated, may_take):
            return Decision(Unsure())
        wanted = self._wanted(info, self.last if len(taken) + 1 == limit else self.selector, rng)
        if may_take[wanted.action.pose if isinstance(wanted.action, Probe) else 0]:
            return wanted
        gains = [wanted.scores.get(f"gain_{name}", 0.0) for name in task.actions]
        return Decision(Probe(int(np.where(may_take, gains, -np.inf).argmax())), wanted.scores)

    def _is_worth_it(self, info: InformationState, stated: float, may_take: NDArray[np.bool_]) -> bool:
        """Whether an action reduces the expected cost of an error by more than its own cost."""
        task, evidence = self.task, info.evidence
        if task.error_cost is None or evidence is None or task.costs is None:
            return True
        mixture = evidence.outcome_mixture(task.model.default_outcomes, 1)
        assert mixture is not None, "a model with contexts has one"
        right = mixture.one_touch(np.diag(info.probs)).max(axis=1).sum(axis=1)  # probability after each action
        return bool((task.error_cost * (right - stated) > task.costs)[may_take].any())

    def _wanted(self, info: InformationState, selector: ProbeSelector, rng: np.random.Generator) -> Decision:
        if self.known is None:
            return selector.choose(info, rng)
        key = tuple(sorted((touch.pose, _outcome(touch)) for touch in info.history))
        if key not in self.known:
            if len(self.known) >= _REMEMBERED:
                self.known.clear()
            self.known[key] = selector.choose(info, rng)
        return self.known[key]


def _checksums(outcomes: NDArray[np.int64], classes: NDArray[np.integer]) -> NDArray[np.int64]:
    """A checksum of each case, ``(n,)``, from its outcomes ``(n, P)`` and class ``(n,)``."""
    pairs = zip(outcomes, classes.tolist(), strict=False)  # unequal numbers are refused elsewhere
    return np.array([zlib.crc32(np.append(row, label).tobytes()) for row, label in pairs], np.int64)


def _by_truth(answers: Sequence[Answer]) -> tuple[Counter[int], Counter[int]]:
    """Cases of each class, and how many of them are named rightly."""
    return Counter(one.truth for one in answers), Counter(one.truth for one in answers if one.is_right)


def _require_same_rows(cases: Any, labels: Any) -> None:
    """Check that data frames have their rows in the same order."""
    ours: Any = getattr(cases, "index", None)
    theirs: Any = getattr(labels, "index", None)
    if hasattr(ours, "equals") and hasattr(theirs, "equals") and not ours.equals(theirs):
        raise InvalidArgument(
            "the rows of cases and labels have different indexes: bring them into one order, or give labels.to_numpy()"
        )


def _flat(labels: Any) -> NDArray[Any]:
    """Labels as an array ``(n,)``."""
    found = np.asarray(labels)
    if found.ndim != 1:
        raise InvalidArgument(f"labels must be (n,), one for each case, got {found.shape}")
    return found


def _promised(certificate: CertifiedThresholds) -> tuple[float, ...]:
    """The stops that a certificate is of."""
    return tuple(one if one > 0.0 else _ANY for one in certificate.thresholds)


def _limit(stops: Any, number: int) -> float:
    return float(stops[min(number, len(stops) - 1)])


def _of_equal_length(probs: Any) -> Any:
    """One array of the tables of all actions: those with fewer outcomes than others get some that never come."""
    if not isinstance(probs, list | tuple) or not len(probs):
        return probs
    try:
        each = [np.asarray(one) for one in probs]
    except ValueError as error:
        raise InvalidArgument("probs of an action need as many outcomes for each class, (K, outcomes)") from error
    if len({one.shape for one in each}) == 1 or min(one.ndim for one in each) < 2:
        return probs
    if len({one.shape[:-1] for one in each}) > 1:
        shapes = ", ".join(str(one.shape) for one in each[:4])
        raise InvalidArgument(f"probs of all actions need as many classes, (K, outcomes) each, got {shapes}")
    most = max(one.shape[-1] for one in each)
    return [np.pad(one, [(0, 0)] * (one.ndim - 1) + [(0, most - one.shape[-1])]) for one in each]


def _outcome(touch: Touch) -> int:
    assert touch.features is not None, "an outcome is a feature"
    return int(touch.features[0])


def _taken(history: Sequence[Touch]) -> tuple[int, ...]:
    return tuple(touch.pose for touch in history if _outcome(touch) != MISSING)
