"""Results and progress in a notebook."""

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from activetouch.pad_fit import PadFit
from activetouch.pose_belief import PoseBelief
from belief import Belief, Confirm, Probe, SceneBelief, SearchProblem, Touch
from belief.synthetic import random_model
from belief.table import Table
from experiments import parallel
from experiments.calibration.measurements import Measurements
from experiments.meshes.identify import Identified
from experiments.paper.reproduce import Reproduction
from experiments.ppo.train_ppo import TrainedPolicies
from experiments.press.explain import Explanation
from experiments.recorded.report import RecordedReport
from experiments.report import Report, Reported, Section
from experiments.robustness.robustness import RobustnessReport
from experiments.search.comparison import Comparison
from experiments.search.results import ResultsComparison
from experiments.tradeoff.report import TradeoffReport
from planners import Decision, Episode, Outcome, Step

RESULTS = [Comparison, Explanation, Identified, Measurements, PadFit, PoseBelief, RecordedReport, Reproduction]
RESULTS += [ResultsComparison, RobustnessReport, TradeoffReport, TrainedPolicies, Episode]


@pytest.mark.parametrize("kind", RESULTS)
def test_every_result_shows_itself_in_a_notebook(kind):
    assert callable(kind._repr_html_)


def test_a_report_shows_its_sentences_and_tables():
    class Found(Reported):
        def report(self):
            table = Table("", ["who"], [("<b>",)])
            return Report("A & B", [Section("", ["It is `x < y`."], [table]), Section("More", [])])

    assert Found()._repr_html_().startswith("<h3>A &amp; B</h3><p>It is <code>x &lt; y</code>.</p><table>")
    assert "&lt;b&gt;" in Found()._repr_html_()


def test_a_search_shows_a_line_for_each_object():
    belief = Belief.from_probs(("<a>", "b"), (0.25, 0.75))
    steps = Step(0, belief, Decision(Probe(0)), Touch(0, np.zeros(2))), Step(0, belief, Decision(Confirm()), None)
    shown = Episode((1,), 0, (0, 1), steps, Outcome.CONFIRMED)._repr_html_()
    assert shown.startswith(
        "<p><b>search for the &lt;a&gt;: confirmed, right, 1 touches</b></p><p>object 1, a &lt;a&gt;"
    )


def test_a_belief_shows_its_most_probable_shapes_and_a_scene_those_of_each_object():
    labels = ("<a>", *(f"shape {number}" for number in range(14)))
    probs = np.array([2.0, *np.linspace(1.0, 0.5, 14)]) / 12.5
    shown = Belief.from_probs(labels, probs)._repr_html_()
    assert shown.index("&lt;a&gt;") < shown.index("shape 0") < shown.index("and 3 less probable shapes")
    assert ">0.160<" in shown
    assert "shape 12" not in shown
    model = random_model(np.random.default_rng(0), num_shapes=3)
    scene = SceneBelief(SearchProblem(model.shape_labels, ("p0", "p1", "p2"), 2), model)
    scene.update(1, model.sample(0, poses=[0, 1], rng=np.random.default_rng(1)))
    likeliest = scene.belief(1)
    best = int(likeliest.probs.argmax())
    assert f"{likeliest.labels[best]} {likeliest.probs[best]:.3f}, " in scene._repr_html_()


def test_progress_is_shown_below_the_cell_without_widgets(monkeypatch):
    shown = []
    display = ModuleType("IPython.display")
    display.HTML = str
    display.display = lambda text, display_id: shown.append(text) or SimpleNamespace(update=shown.append)
    monkeypatch.setitem(sys.modules, "IPython", ModuleType("IPython"))
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    monkeypatch.setattr(parallel, "SECONDS_PER_PICTURE", 0.0)
    progress = parallel.progress_bar()
    progress.console.is_jupyter = True
    with progress:
        bar = progress.add_task("searching <cones>", total=3)
        progress.advance(bar)
        progress.update(bar, completed=3)
    assert [text.count("<progress") for text in shown] == [1, 1, 1]
    assert "searching &lt;cones&gt; <progress value='1' max='3'></progress> 1/3" in shown[0]
    assert "3/3" in shown[-1]
