"""The robots of these tests, each made once."""

from functools import cache

from fjh.rig import Rig
from sim import MODELS

NAMES = ("hexapod", "arm")


@cache
def rig(name: str = "hexapod") -> Rig:
    """The hexapod, or the arm where its translation matters."""
    if name == "hexapod":
        return Rig.hexapod()
    return Rig.of_mjcf(MODELS / f"{name}.xml", major=[3, 4, 5])
