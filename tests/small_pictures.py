"""Reports of tests have small pictures without layout and axes, as most tests look at the text of a page alone."""

from typing import Any


def small_pictures() -> list[tuple[Any, str, Any]]:
    """What to put where, in place of what makes the pictures of users: a module or class, a name in it, a value."""
    from activetouch.view import Bodies
    from experiments import report
    from experiments.search import page

    save, of = report._saved, Bodies.of

    def saved(drawn: Any, suffix: str, dpi: int = 130) -> bytes:
        drawn.set_layout_engine("none")
        for axes in drawn.axes:
            axes.set_axis_off()
        return save(drawn, suffix, dpi // 4)

    def few(sensor: Any, pixels: int = 24, draws: int = 8) -> Bodies | None:
        return of(sensor, min(pixels, 24), min(draws, 8))

    return [
        (Bodies, "of", staticmethod(few)),
        (report, "_saved", saved),
        (page, "_SCENE", {"size": (40, 32), "oversampling": 1}),
        (page, "_BODIES", {"pixels": 24, "draws": 4}),
    ]
