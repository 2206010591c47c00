"""The environment of a search among objects in a tray: each action is a place, and the belief ends the search."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.extras import missing_package
from activetouch.tray.sensor import Keyed, TraySensor
from belief.naming import index_of
from planners.tray import maps_of
from planners.tray_session import TraySession, ended, is_right

try:
    import gymnasium
    from gymnasium import spaces
except ModuleNotFoundError as error:
    raise missing_package(["gymnasium"], "rl") from error


class TraySearchEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """Press places of a tray until the belief says where the target is, or that it is absent.

    ## Action Space
    `Box(0, 1, (2,), float32)`: the place of the next press, from one wall to the other along x and y.

    ## Observation Space
    `Box(0, 1, (5, X, Y), float32)`, maps over the cells of the tray (about 5 mm), as :func:`planners.tray.maps_of`:

    | map | meaning |
    |---|---|
    | 0 | chance that a press meets the target, if it was not found yet |
    | 1 | chance that a press meets another object that was not found yet |
    | 2 | chance that a press meets an object that was found |
    | 3 | probability that the target is the object which was found there, within 15 mm; elsewhere 0 |
    | 4 | distance from the pad, as a share of the diagonal of the tray |

    ## Starting State
    A tray with random objects; the pad is at the corner (0, 0). `reset(options={"target": "cone"})` chooses the target.

    ## Rewards
    Each press costs `touch_cost`, and each metre of way `travel` times as much. At the end: +1 if the answer of the
    belief is right, else -1; 0 for "I do not know".

    ## Episode End
    - Termination: an answer is as probable as the rules of the sensor ask, or its number of touches is used up.

    ## Information
    - `target`: label of the shape sought; `target_prob`, `absent_prob`: by the belief;
    - `is_success`, at the end: whether the answer is right.

    Args:
        sensor: a sensor for trays, or the name of a scene, whose shipped one is used; "coarse" by default.
        target: label of the shape sought; None to draw it at reset, uniformly.
        touch_cost: λ.
        render_mode: None; the report of `activetouch drawer` draws searches.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        sensor: TraySensor | str = "coarse",
        target: str | None = None,
        touch_cost: float = 0.02,
        render_mode: str | None = None,
    ) -> None:
        self.sensor = TraySensor.shipped(sensor) if isinstance(sensor, str) else sensor
        if target is not None:
            index_of("target", self.sensor.shape_labels, target)
        self.target, self.touch_cost, self.render_mode = target, touch_cost, render_mode
        cells = self.sensor.belief(0).cells
        self.action_space = spaces.Box(0.0, 1.0, (2,), np.float32)
        self.observation_space = spaces.Box(0.0, 1.0, (5, *cells), np.float32)
        self._session: TraySession
        self._touched: Keyed

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """A new tray. See :class:`gymnasium.Env`."""
        super().reset(seed=seed)
        key = int(self.np_random.integers(2**32))
        labels = self.sensor.shape_labels
        given = (options or {}).get("target", self.target)
        self._index = int(self.np_random.integers(len(labels))) if given is None else index_of("target", labels, given)
        self._touched = self.sensor.touched(self._index, key)
        self._session = self.sensor.session(self._index, seed=key)
        return self._observed(), self._info()

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Press a place. See :class:`gymnasium.Env`."""
        session, size = self._session, self.sensor.tray.size
        share = np.clip(np.asarray(action, float), 0.0, 1.0)
        wanted = float(share[0]) * size[0], float(share[1]) * size[1]
        place = session.belief.centre(session.belief.cell_at(*wanted))
        way = float(np.hypot(place[0] - session.at[0], place[1] - session.at[1]))
        session.tell_met(self._touched.press(*place), place)
        reward = -self.touch_cost * (1.0 + self.sensor.rules.travel * way)
        info, answered = self._info(), session.stopped()
        if answered is not None:
            answer, where = ended(answered)
            info["is_success"] = is_right(answer, where, self._touched.world.lay, info["target"])
            reward += 0.0 if answer == "unsure" else 1.0 if info["is_success"] else -1.0
        return self._observed(), reward, answered is not None, False, info

    def _info(self) -> dict[str, Any]:
        standing = self._session.standing
        label = self.sensor.shape_labels[self._index]
        return {"target": label, "target_prob": standing.target, "absent_prob": standing.absent}

    def _observed(self) -> NDArray[np.float32]:
        session = self._session
        return maps_of(session.belief, session.standing, session.at)
