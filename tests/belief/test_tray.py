"""The belief about a tray is the sum over all arrangements of its objects; misses, heights and images are evidence."""

import itertools
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import ndtr

import belief.tray as tray_module
from belief.errors import ImpossibleObservation, InvalidArgument
from belief.tray import Found, PlaceTable, PlaceTouch, TouchNoise, TrayBelief

_NOISE = TouchNoise(height=0.002, scale=0.8, drift=0.0, outliers=0.0, repeat=0.0)


def table(seed: int = 0, num_shapes: int = 3, embeddings: int = 2) -> PlaceTable:
    """Two rows for each shape, which a press meets from nearby cells."""
    rng = np.random.default_rng(seed)
    rows, size = 2 * num_shapes, 3
    hit = rng.choice([0.0, 0.6, 1.0], (rows, size, size))
    hit[:, 1, 1] = 1.0
    return PlaceTable(
        labels=tuple("abcdef"[:num_shapes]),
        shape_of=np.repeat(np.arange(num_shapes), 2),
        prior=np.tile([0.7, 0.3], num_shapes),
        extents=np.full((rows, 2), 0.004),
        inner=np.full(rows, 0.004),
        hit=hit,
        height=rng.uniform(0.01, 0.03, hit.shape),
        spread=np.full(hit.shape, 0.001),
        embeddings=rng.normal(size=(int((hit > 0.0).sum()), embeddings)),
        pitch=0.01,
    )


def believed(given: PlaceTable, num_objects: int = 2, **others: object) -> TrayBelief:
    """A tray of 4 x 3 cells; all worlds are kept, and objects may overlap."""
    options = {"noise": _NOISE, "most_worlds": 10_000, "separate": False, **others}
    return TrayBelief(given, (0.04, 0.03), 0, num_objects, 0.7, **options)


def brute_force(before: TrayBelief, touches: list[PlaceTouch]) -> np.ndarray:
    """Probabilities of answers: the target is absent, or lies in each cell ``(1 + X · Y,)``, over all arrangements."""
    given, noise = before.table, before.noise
    cells = list(itertools.product(range(before.cells[0]), range(before.cells[1])))
    bodies = [(row, x, y) for row in range(len(given.prior)) for x, y in cells]
    shapes, number, num_others = given.shape_of, before.num_objects, len(given.labels) - 1
    place_prior = np.array([before.intensity[body] for body in bodies])
    shape_of = np.array([shapes[row] for row, _, _ in bodies])
    lower, own = np.zeros((len(touches), len(bodies))), np.zeros((len(touches), len(bodies)))
    surviving = place_prior.copy()
    for k, touch in enumerate(touches):
        levels = np.full(len(bodies), -np.inf)
        met = np.zeros(len(bodies))
        for n, (row, x, y) in enumerate(bodies):
            i, j = touch.cell[0] - x + 1, touch.cell[1] - y + 1
            lower[k, n] = 1.0
            if not (0 <= i < 3 and 0 <= j < 3) or given.hit[row, i, j] == 0.0:
                continue
            hit, mean = given.hit[row, i, j], given.height[row, i, j]
            deviation = np.hypot(given.spread[row, i, j], noise.height)
            below = ndtr((touch.height - mean) / deviation) if touch.height else 0.0
            lower[k, n] = tray_module._STRAY + (1.0 - tray_module._STRAY) * (1.0 - hit * (1.0 - below))
            if touch.embedding is not None:
                density = np.exp(-0.5 * ((touch.height - mean) / deviation) ** 2) / (deviation * np.sqrt(2.0 * np.pi))
                levels[n] = noise.scale * float(given.embeddings[given.contacts.number[row, i, j]] @ touch.embedding)
                met[n] = surviving[n] * hit
                own[k, n] = hit * ((1 - tray_module._ODD) * density + tray_module._ODD / tray_module._TALL)
        if touch.embedding is not None:
            level = np.log((met * np.exp(levels)).sum() / met.sum())
            own[k] *= np.exp(levels - level)
        surviving *= lower[k]
    found = np.zeros(1 + len(cells))
    for arrangement in itertools.product(range(len(bodies)), repeat=number):
        kinds = shape_of[list(arrangement)]
        targets = int((kinds == before.target).sum())
        if targets > 1:
            continue
        weight = (before.present / number if targets else 1.0 - before.present) / num_others ** (number - targets)
        for body in arrangement:
            weight *= place_prior[body]
        for k, touch in enumerate(touches):
            below = np.array([lower[k, body] for body in arrangement])
            if touch.embedding is None:
                weight *= below.prod()
            else:
                owned = sum(own[k, body] * np.delete(below, n).prod() for n, body in enumerate(arrangement))
                weight *= owned + tray_module._STRAY / tray_module._TALL * below.prod()
        if targets:
            _, x, y = bodies[arrangement[int((kinds == before.target).argmax())]]
            found[1 + x * before.cells[1] + y] += weight
        else:
            found[0] += weight
    return found / found.sum()


def answers(after: TrayBelief) -> np.ndarray:
    """The same of a belief."""
    found = np.zeros(1 + after.cells[0] * after.cells[1])
    weights = np.exp([world.log_weight for world in after.worlds])
    for weight, world in zip(weights / weights.sum(), after.worlds, strict=True):
        probs = after.answers(world)
        found[0] += weight * probs.absent
        free = after.by_shape[after.target]
        if free.sum() > 0.0:
            found[1:] += weight * probs.unfound * (free / free.sum()).ravel()
        for one, prob in zip(world.found, probs.found, strict=True):
            if prob > 0.0:
                shapes = np.where(np.arange(one.num_shapes) == after.target, 0.0, -np.inf)
                np.add.at(found, 1 + one.x * after.cells[1] + one.y, weight * prob * one.probs(shapes))
    return found


@pytest.mark.parametrize("seed", range(4))
def test_the_belief_is_the_sum_over_all_arrangements(monkeypatch, seed):
    monkeypatch.setattr(tray_module, "_IRRELEVANT", 1e-300)
    monkeypatch.setattr(tray_module, "_DEAD", 1e-300)
    given, rng = table(seed, num_shapes=2 + seed % 2), np.random.default_rng(seed)
    belief = believed(given)
    touches = []
    for _ in range(4):
        cell = int(rng.integers(4)), int(rng.integers(3))
        touch = PlaceTouch(cell)
        if rng.uniform() < 0.7:
            touch = PlaceTouch(cell, float(rng.uniform(0.01, 0.03)), rng.normal(size=2))
        touches.append(touch)
        before, belief = belief, belief.update(touch)
        assert before is not belief
        np.testing.assert_allclose(answers(belief), brute_force(believed(given), touches), rtol=0, atol=1e-9)


def test_without_touches_it_is_the_prior():
    belief = believed(table())
    assert answers(belief)[0] == pytest.approx(0.3)
    assert answers(belief).sum() == pytest.approx(1.0)


def test_a_miss_moves_the_target_elsewhere():
    belief = believed(table(), num_objects=1)
    after = belief.update(PlaceTouch((1, 1)))
    assert after.masses(after.worlds[0])[0] < belief.masses(belief.worlds[0])[0]
    assert answers(after)[1 + 1 * 3 + 1] < 0.01 * answers(belief)[1 + 1 * 3 + 1]


def test_objects_do_not_lie_in_one_place():
    given = replace(table(), inner=np.full(6, 0.011))
    touch = PlaceTouch((1, 1), float(given.height[0, 1, 1]), np.zeros(2))
    apart, anywhere = (believed(given, separate=separate).update(touch) for separate in (True, False))
    where = answers(apart)[1:].reshape(4, 3), answers(anywhere)[1:].reshape(4, 3)
    assert apart.outside(apart.worlds[0]).min() < 0.5
    assert apart.masses(apart.worlds[0]).sum() < anywhere.masses(anywhere.worlds[0]).sum()
    assert where[0].sum() == pytest.approx(1.0 - answers(apart)[0])


def touched(belief: TrayBelief, seed: int = 3, number: int = 4) -> TrayBelief:
    """After contacts in the first cells of the middle row."""
    rng = np.random.default_rng(seed)
    for x in range(number):
        belief = belief.update(PlaceTouch((x, 1), float(rng.uniform(0.01, 0.03)), rng.normal(size=2)))
    return belief


def test_the_likeliest_worlds_are_those_of_all_worlds():
    apart = {"num_objects": 3, "separate": True}
    few, every = (touched(believed(table(), most_worlds=most, **apart)) for most in (3, 10_000))
    later = few.update(PlaceTouch((1, 2), 0.02, np.ones(2)))
    with_all = replace(few, most_worlds=10_000).update(PlaceTouch((1, 2), 0.02, np.ones(2)))
    assert len(every.worlds) > len(few.worlds) == len(later.worlds) == 3 < len(with_all.worlds)
    for one, other in zip(later.worlds, with_all.worlds[:3], strict=True):
        assert one.log_weight == pytest.approx(other.log_weight)
        assert [found.cells for found in one.found] == [found.cells for found in other.found]


def test_discs_are_the_sum_over_the_hypotheses_of_an_object():
    given = replace(table(), inner=np.array([0.004, 0.012, 0.004, 0.021, 0.012, 0.006]))
    belief = TrayBelief(given, (0.09, 0.07), 0, 1, 0.7, _NOISE)
    one = belief.update(PlaceTouch((1, 5), 0.02, np.zeros(2))).worlds[0].found[0]
    margins, cells = (0.0, 0.013), np.indices(belief.cells)
    expected = np.zeros((2, *belief.cells))
    for prob, row, x, y in zip(one.probs(np.zeros(3)), one.row, one.x, one.y, strict=True):
        square = (cells[0] - x) ** 2 + (cells[1] - y) ** 2
        for number, margin in enumerate(margins):
            expected[number] += prob * (square < round((given.inner[row] + margin) / given.pitch) ** 2)
    np.testing.assert_allclose(belief.discs(one, margins), expected, atol=1e-6)


def test_a_touch_near_another_one_of_the_object_says_less():
    given, noise = table(num_shapes=2), replace(_NOISE, repeat=0.8, near=0.01)
    one = believed(given, 1, noise=noise).update(PlaceTouch((1, 1), 0.02, np.zeros(2))).worlds[0].found[0]
    near = 1.0 - 0.8 * np.exp(-0.5)
    np.testing.assert_allclose(one.news([(1, 1), (2, 1), (3, 2)], 0.01), [0.2, near, 1.0 - 0.8 * np.exp(-2.5)])
    twice = replace(one, met=(PlaceTouch((1, 1)), PlaceTouch((1, 1))))
    np.testing.assert_allclose(twice.news([(2, 1)], 0.01), near**2)
    touch = PlaceTouch((1, 1), 0.02, np.array([3.0, -2.0]))
    repeats, independent = (
        believed(given, 1, noise=replace(noise, repeat=repeat)).update(touch).update(touch) for repeat in (1.0, 0.0)
    )
    (first,), (second,) = repeats.worlds[0].found, independent.worlds[0].found
    assert np.ptp(first.sums) < np.ptp(second.sums)  # the second touch adds nothing


def test_an_object_that_is_pushed_may_be_in_the_next_cell():
    given = table(num_shapes=2)
    touch = PlaceTouch((1, 1), float(given.height[0, 1, 1]), np.zeros(2))
    still = believed(given, 1).update(touch).worlds[0].found[0]
    moved = believed(given, 1, noise=replace(_NOISE, push=0.004)).update(touch).worlds[0].found[0]
    assert set(zip(moved.x.tolist(), moved.y.tolist(), strict=True)) > set(
        zip(still.x.tolist(), still.y.tolist(), strict=True)
    )
    inside = (still.x > 0) & (still.x < 3) & (still.y > 0) & (still.y < 2)
    if inside.all():
        np.testing.assert_allclose(np.logaddexp.reduce(moved.log_weight), np.logaddexp.reduce(still.log_weight))


def test_a_contact_of_no_object_is_possible_but_odd():
    belief = believed(table(num_shapes=2), 1)
    far = PlaceTouch((0, 0), 0.5, np.zeros(2))  # higher than any object
    after = belief.update(far)
    assert min(world.log_odd for world in after.worlds) < 0.0
    assert np.isfinite(answers(after)).all()


def test_a_target_that_must_be_there_and_cannot_be_is_an_error():
    given = replace(table(num_shapes=2), hit=np.ones((4, 3, 3)))
    belief = replace(believed(given, 1), present=1.0)
    impossible = replace(belief, intensity=np.where(given.shape_of[:, None, None] == 0, 0.0, belief.intensity))
    with pytest.raises(ImpossibleObservation, match="impossible for every arrangement"):
        impossible.update(PlaceTouch((1, 1)))


class _OnlyLikeIt:
    """Says the same factor of every object, and which it was asked about."""

    def __init__(self, factor: float) -> None:
        self.factor, self.asked = factor, []

    def log_factor(self, belief: TrayBelief, one: Found, shape: int) -> float:
        self.asked.append((belief.target, one.touches, shape))
        return self.factor


def test_an_object_that_may_be_only_like_the_target_is_less_probable_however_much_it_is_like_it():
    """What is only like it has prior odds of 0.1; the other answers share what the object loses."""
    given = table(4)
    at = np.flatnonzero((given.contacts.row == 0) & (given.contacts.i == 1) & (given.contacts.j == 1))[0]
    touch = PlaceTouch((1, 1), float(given.height[0, 1, 1]), 4.0 * given.embeddings[at])
    start = believed(given, num_objects=2, unlisted=0.3)
    after = start.update(touch)
    probs = after.answers(after.worlds[0])
    assert 0.8 < probs.found[0] < 1.0
    assert probs.unfound > 0.0
    for factor in (-np.inf, 0.0, 4.0):
        asked = _OnlyLikeIt(factor)
        doubted = replace(start, lookalikes=asked).update(touch)
        assert asked.asked[0] == (0, 1, 0)
        found = doubted.answers(doubted.worlds[0])
        assert found.found[0] == pytest.approx(probs.found[0] / (1.0 + 0.1 * np.exp(factor)))
        assert found.found.sum() + found.unfound + found.absent == pytest.approx(1.0)
        assert found.absent / found.unfound == pytest.approx(probs.absent / probs.unfound)
        np.testing.assert_array_equal(doubted.weights, after.weights)


def test_what_must_be_the_target_is_not_doubted():
    given = table(4)
    at = np.flatnonzero((given.contacts.row == 0) & (given.contacts.i == 1) & (given.contacts.j == 1))[0]
    touch = PlaceTouch((1, 1), float(given.height[0, 1, 1]), 4.0 * given.embeddings[at])
    certain = replace(believed(given, num_objects=1, unlisted=0.3), present=1.0, lookalikes=_OnlyLikeIt(4.0))
    after = certain.update(touch)
    assert after.answers(after.worlds[0]).found[0] == 1.0
    assert not after.doubts


def test_what_was_said_of_an_object_holds_until_touches_of_it_are_a_quarter_more():
    given = table(4)
    at = np.flatnonzero((given.contacts.row == 0) & (given.contacts.i == 1) & (given.contacts.j == 1))[0]
    touch = PlaceTouch((1, 1), float(given.height[0, 1, 1]), 4.0 * given.embeddings[at])
    asked = _OnlyLikeIt(-2.0)
    after = replace(believed(given, num_objects=2, unlisted=0.3), lookalikes=asked)
    for _ in range(11):
        after = after.update(touch)
    by_touches = [touches for _, touches, _ in asked.asked]
    assert [n for n in by_touches if n >= 4] == [4, 5, 6, 7, 8, 10]
    assert set(after.doubts.values()) == {-2.0}


def test_cells_and_places_agree():
    belief = believed(table())
    for cell in itertools.product(range(4), range(3)):
        assert belief.cell_at(*belief.centre(cell)) == cell
    assert belief.cell_at(0.04, 0.03) == (3, 2)
    assert belief.cell_at(0.0, 0.0) == (0, 0)


def test_sessions_in_threads_share_what_is_kept(monkeypatch):
    monkeypatch.setattr(tray_module, "_MOST_KEPT", 2)
    belief, found = SimpleNamespace(hits=lambda one: one), [object() for _ in range(8)]
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(8) as threads:
            kept = list(threads.map(lambda number: tray_module._kept(belief, found[number % 8], None), range(20_000)))
    finally:
        sys.setswitchinterval(before)
    assert all(one is found[number % 8] for number, one in enumerate(kept))


@pytest.mark.parametrize("wrong", [{"height": 1e300}, {"near": 1e-300}, {"push": 1e300}])
def test_noise_in_another_unit_is_refused(wrong):
    with pytest.raises(ValueError, match=r"must be a number in .* m, got"):
        TouchNoise(**wrong)


@pytest.mark.parametrize(
    ("touch", "said"),
    [
        (PlaceTouch((4, 0)), r"cell\[0\] of a touch must be an integer in \[0, 4\), got 4"),
        (PlaceTouch((0, -1)), r"cell\[1\] of a touch"),
        (PlaceTouch((0, 0, 0)), "cell of a touch must be two indices"),
        (PlaceTouch((0, 0), height=np.nan), "height of a touch"),
        (PlaceTouch((0, 0), height=0.02), "a contact has an embedding"),
        (PlaceTouch((0, 0), embedding=np.zeros(2)), "a miss neither"),
        (PlaceTouch((0, 0), 0.02, np.zeros(3)), "an embedding must be 2 finite numbers"),
        (PlaceTouch((0, 0), 0.02, np.array([0.0, np.inf])), "an embedding must be 2 finite numbers"),
        (PlaceTouch((0, 0), 0.02, np.zeros(2), level=np.nan), "the level of a touch must be finite"),
    ],
)
def test_a_touch_that_does_not_fit_is_refused_and_changes_nothing(touch, said):
    belief = believed(table())
    with pytest.raises(InvalidArgument, match=said):
        belief.update(touch)
    assert belief.num_touches == 0


@pytest.mark.parametrize(
    "changed", [{"target": 3}, {"num_objects": 0}, {"present": 1.5}, {"unlisted": np.nan}, {"size": (0.04, 0.0)}]
)
def test_a_tray_that_cannot_be_is_refused(changed):
    with pytest.raises(InvalidArgument, match=next(iter(changed))):
        replace(believed(table()), intensity=None, **changed)
