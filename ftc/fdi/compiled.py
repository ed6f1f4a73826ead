"""The compiled code of diagnosis."""

from functools import cache
from typing import Any, NamedTuple


class Compiled(NamedTuple):
    """Modules of kernels."""

    detection: Any
    evidence: Any
    friction: Any
    segments: Any


@cache
def compiled() -> Compiled:
    """The compiled code, loaded when first needed: the compiler takes some 0.3 s."""
    from ftc.fdi import _friction
    from ftc.fdi.design import _to_segments
    from ftc.fdi.detection import _kernels
    from ftc.fdi.isolation import _evidence

    return Compiled(_kernels, _evidence, _friction, _to_segments)
