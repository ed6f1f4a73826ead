"""What all machines of a sweep must have in common, so that a run is the same on each."""

import hashlib
import json
from functools import cache

from experiments.output.provenance import code_sha256, versions
from sim import model_sha256

Identity = dict[str, str]


@cache
def identity() -> Identity:
    """Of this process: code, machine file, and the packages that the numbers depend on."""
    own = {"code_sha256": code_sha256(), "model_sha256": model_sha256()}
    return own | {f"version of {name}": version for name, version in versions().items()}


@cache
def digest() -> str:
    """The same in 64 letters."""
    return hashlib.sha256(json.dumps(identity(), sort_keys=True).encode()).hexdigest()
