"""Touch a cube of unknown orientation and size until its shape is known: places chosen, and in random order.

Run: python examples/05_where_to_touch.py [picture.png]   (9 s of processor time)
"""

import sys

import numpy as np
from matplotlib.figure import Figure

from activetouch import TactileSensor, TouchWorld
from activetouch.poses import to_matrix, turned
from belief import SceneBelief, SearchProblem
from planners import InformationState, make_decider

SHAPE, SEED, SURE = "cube_cut", 1, 0.98
sensor = TactileSensor.shipped("keyed")
labels, places, model = sensor.scene.shape_labels, sensor.scene.pose_labels, sensor.model
problem = SearchProblem(labels, places, num_objects=1, composition="independent")
names = {
    "chosen by what was felt": "shape_information_gain(hypotheses=256, outcomes=512)",
    "in random order": "random_poses",
}
corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
drawn = Figure((9.0, 6.2), layout="constrained")

for row, (title, name) in enumerate(names.items()):
    decider = make_decider(name, model.outcome_table(), model)
    world = TouchWorld.sample(sensor, [SHAPE], np.random.default_rng(SEED))
    rng, scene, sides, certainty = np.random.default_rng(SEED), SceneBelief(problem, model), [], [1 / len(labels)]
    print(f"\nplaces {title}:")
    while certainty[-1] < SURE and len(sides) < len(places):
        info = InformationState.of(problem, labels.index(SHAPE), scene, 0)
        place = decider.probing.choose(info, rng).action.pose
        scene.update(0, [world.touch(place, rng)])
        probs = scene.belief(0).probs
        certainty.append(float(probs[labels.index(SHAPE)]))
        shown = turned(sensor.scene.rotations[places[place]], world.current.orientation[None])[0]
        sides.append(-to_matrix(shown)[0])  # the side of the object that met the pad, in the object's frame
        first, second = (f"{labels[k]} {probs[k]:.3f}" for k in np.argsort(-probs)[:2])
        print(f"{len(sides):3d}  {places[place]:<7} {first}, {second}")

    globe = drawn.add_subplot(2, 2, 2 * row + 1, projection="mollweide")
    for points, marker, colour in ((corners, "s", "0.75"), (corners[-1:], "s", "tab:red")):
        globe.plot(
            np.arctan2(points[:, 1], points[:, 0]), np.arctan2(points[:, 2], np.sqrt(2)), marker, c=colour, ms=13
        )
    for number, (x, y, z) in enumerate(sides, 1):
        globe.text(np.arctan2(y, x), np.arcsin(z), str(number), ha="center", va="center", weight="bold")
    globe.set(xticks=[], yticks=[], title=f"{len(sides)} places {title}")
    curve = drawn.add_subplot(2, 2, 2 * row + 2, xlabel="touches", ylabel=f"probability of {SHAPE}", ylim=(0, 1.05))
    curve.plot(certainty, "o-")
    curve.set_xlim(0, len(places))

if sys.argv[-1].endswith(".png"):
    drawn.savefig(sys.argv[-1], dpi=110)
