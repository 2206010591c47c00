"""Update a belief about one object by hand, with nothing but numpy and scipy installed.

Run: python examples/01_update_a_belief.py   (1 s of processor time)

The sensor is right eight times in ten and otherwise names one of the other shapes at random. It names "cone" three
times and "cylinder" once.
"""

import numpy as np

from belief import Belief

SHAPES = ("sphere", "cube", "cylinder", "cone")
CONFUSION = np.full((4, 4), 0.2 / 3) + (0.8 - 0.2 / 3) * np.eye(4)  # p(said | shape): rows are shapes

belief = Belief.uniform(SHAPES)
print(f"before any touch   {belief}")
for said in ("cone", "cylinder", "cone", "cone"):
    likelihood = CONFUSION[:, SHAPES.index(said)]
    belief = belief.update(likelihood=likelihood)
    print(f"it says {said:<9}  {belief}   entropy {belief.entropy:.3f} nats")
