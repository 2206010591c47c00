"""A search in the world of ``keyed`` among the four cubes only, all of them on the table: every object has twins.

activetouch compare --scene benchmarks.twins:TWINS --sensor keyed --targets cube cube_cut cube_cut_twice ...
"""

from dataclasses import replace

from activetouch import SCENES
from belief import Counts

CUBES = ("cube", "cube_cut", "cube_cut_twice", "cube_chamfered")
TWINS = replace(SCENES["keyed"], composition=Counts(dict.fromkeys(CUBES, 1)))
