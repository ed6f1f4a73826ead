"""Test systems constructed from objects with the attributes of a linearized model."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from prioritized import ConstrainedSystem
from prioritized._mechanism.names import Names


def linearized(**others: Any) -> Any:
    """Return an object as from `sim`, with names of another class and without springs."""
    given = {"J_T": np.eye(2, 3), "J_C": np.ones((1, 3)), "active": np.array([0, 1])}
    return SimpleNamespace(**given | others)


def test_a_model_provides_names_accuracy_and_optionally_springs():
    soft = linearized(stiffness=np.ones(3))
    assert ConstrainedSystem.of(soft).stiffness is None
    np.testing.assert_array_equal(ConstrainedSystem.of(soft, springs=True).stiffness, np.eye(3))
    with pytest.raises(ValueError, match="springs must be False for a mechanism without stiff"):
        ConstrainedSystem.of(linearized(), springs=True)
    rough = linearized(geometry_accuracy=1e-7)
    assert ConstrainedSystem.of(rough).geometry_accuracy == 1e-7
    assert ConstrainedSystem.of(rough, geometry_accuracy=1e-4).rank_tolerance == 10 * 1e-4
    lists: Any = Names(["a", "b", "c"], [["m"], ["n"]])  # type: ignore
    made = ConstrainedSystem.of(linearized(names=lists))
    assert made.names == Names(("a", "b", "c"), (("m",), ("n",)))
    for name in ("J_T", "J_C", "active"):
        np.testing.assert_array_equal(getattr(made, name), getattr(linearized(), name))
