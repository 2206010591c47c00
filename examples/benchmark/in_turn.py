"""An agent for `activetouch benchmark`: one function, which imports nothing of this package.

activetouch benchmark --task coarse-v1 --agent "policy:in_turn:act(state='posterior')" --out in_turn.jsonl.gz
"""

import numpy as np

SHAPES, POSES = 4, 6


def act(observation: np.ndarray) -> int:
    """Confirm or reject when sure; else press in the pose used least. Poses are 0 to 5, then CONFIRM and REJECT."""
    log_odds = 4.0 * np.arctanh(np.clip(observation[SHAPES], -0.999999, 0.999999))
    uses = observation[SHAPES + 1 : SHAPES + 1 + POSES]
    if abs(log_odds) > 3.0 or uses.min() > 0.0:
        return POSES if log_odds > 0.0 else POSES + 1
    return int(uses.argmin())
