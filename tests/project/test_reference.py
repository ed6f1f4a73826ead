"""Tests that the reference has every public name of every package."""

import importlib
import re
from pathlib import Path
from types import ModuleType

import pytest

import fjh

API = Path(__file__).parents[2] / "docs" / "api"
REFERENCE = "".join(page.read_text() for page in API.glob("*.md"))
PUBLIC = (
    *("prioritized", "sim", "sim.mjcf", "sim.plant", "sim.scene", "sim.tasks"),
    *("ftc", "ftc.control", "ftc.fdi"),
)
"""Modules with lists of public names; `make check` rejects imports of others."""
NOT_DOCUMENTED = {"Array", "log_warnings"}
"""Public names outside the reference: the type of all arrays, and a helper of `sim`."""


@pytest.mark.parametrize("module", PUBLIC)
def test_the_reference_has_every_public_name(module):
    public = vars(importlib.import_module(module)).items()
    names = {
        name
        for name, value in public
        if not name.startswith("_") and not isinstance(value, ModuleType)
    }
    missing = {name for name in names if not re.search(rf":: {name}$", REFERENCE, re.MULTILINE)}
    assert missing <= NOT_DOCUMENTED


def test_the_reference_has_every_name_of_fjh():
    assert set(re.findall(r"`fjh\.(\w+)`", (API / "fjh.md").read_text())) == set(fjh.__all__)
