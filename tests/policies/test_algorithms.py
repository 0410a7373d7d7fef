"""The registry of algorithms: names, settings, and an algorithm of somebody else's."""

from __future__ import annotations

import ast
import inspect
from dataclasses import FrozenInstanceError, fields

import numpy as np
import pytest

from mam_pipeline.errors import ConfigError
from mam_policies.algorithms import ALGORITHMS, Algorithm, algorithm


@pytest.mark.parametrize("name", ALGORITHMS.builtin)
def test_every_algorithm_is_complete(name: str) -> None:
    """Its name is the registry's, each of its settings has a default and a sentence."""
    found = algorithm(name)
    assert isinstance(found, Algorithm) and found.name == name
    assert (type(found).__doc__ or "").startswith(f"{name}: ")
    config = found.Config()
    with pytest.raises(FrozenInstanceError):
        config.seed = 1
    described = set().union(*(_described(cls) for cls in found.Config.__mro__[:-1]))
    assert {f.name for f in fields(config)} == described


def _described(cls: type) -> set[str]:
    """Fields of a class that are followed by a string, as tyro reads them."""
    tree = ast.parse(inspect.getsource(cls)).body[0]
    assert isinstance(tree, ast.ClassDef)
    return {
        field.target.id
        for field, text in zip(tree.body, tree.body[1:])
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr)
    }


def test_a_wrong_name_or_setting_is_named() -> None:
    with pytest.raises(ConfigError, match="did you mean 'ppo'"):
        algorithm("pppo")
    with pytest.raises(ConfigError, match="episodes must be at least 1, not 0"):
        algorithm("bc").Config(episodes=0)
    assert algorithm("ppo").Config(episodes=0).episodes == 0  # from scratch


@pytest.mark.parametrize("seed", [0, 4294, 4295, 2**31 - 1])
def test_every_seed_that_a_run_takes_gives_seeds_that_numpy_takes(seed: int) -> None:
    from mam_policies.demonstrations import seed_of

    found = {seed_of(seed, number) for number in range(1000)}
    assert len(found) == 1000
    assert all(np.random.RandomState(value) for value in (min(found), max(found)))
