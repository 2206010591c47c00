"""A scene of your own: ``gel`` with larger forces.

Run in this folder:

    activetouch touch --scene own_scene:pressed_harder --shape cone --out cone.png
    activetouch compare --scene "own_scene:pressed_harder(force=2.5)" --sensor gel --episodes 25

The sensor of ``gel`` reads the images and is told of the forces. It reads other shapes, too. Another renderer needs a
sensor of its own (``activetouch.make_sensor(scene, folder)``), another pad a training of ``--recipe contacts``.
"""

from dataclasses import replace

from activetouch import SCENES
from activetouch.distributions import Uniform
from activetouch.named_scenes import NamedScene


def pressed_harder(force: float = 3.0) -> NamedScene:
    """The scene ``gel`` with larger forces and three objects.

    Args:
        force: smallest force [N]; the largest is twice as large.
    """
    gel = SCENES["gel"]
    variation = replace(gel.scene.variation, force=Uniform(force, 2.0 * force))
    return replace(gel, scene=replace(gel.scene, variation=variation), num_objects=3)
