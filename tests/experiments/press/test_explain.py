from rich.console import Console

from belief.observation_model import OutcomeTable
from experiments.press.explain import limits_table


def test_explain_shows_the_hardest_pairs_first_and_names_those_beyond_telling():
    rows = [[0.9, 0.05, 0.05], [0.1, 0.8, 0.1], [0.1, 0.8, 0.1], [0.2, 0.2, 0.6]]
    console = Console(width=100, record=True)
    console.print(limits_table(OutcomeTable([rows]), ("sphere", "cube", "box", "cone")).rich())
    text = console.export_text()
    body = [line.split() for line in text.splitlines() if "sphere" in line or "cube" in line]
    assert body[0][:5] == ["cube", "box", "inf", "inf", "0.00"]
    assert "distinguishes: cube and box" in " ".join(text.split())
