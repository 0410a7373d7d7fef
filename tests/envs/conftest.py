"""Session fixtures: a drawer, a door and a button made of boxes."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.envs.box_assets import write_asset, write_button, write_tray


@pytest.fixture(scope="session")
def drawer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Asset folder of a drawer that slides 0.25 m towards -x."""
    return write_asset(tmp_path_factory.mktemp("assets") / "drawer", "drawer")


@pytest.fixture(scope="session")
def door(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Asset folder of a door that swings 90 degrees about a vertical hinge."""
    return write_asset(tmp_path_factory.mktemp("assets") / "door", "door")


@pytest.fixture(scope="session")
def button(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Asset folder of a box with a button that goes 6 mm in towards +x."""
    return write_button(tmp_path_factory.mktemp("assets") / "button")


@pytest.fixture(scope="session")
def tray(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Asset folder of a chest with a drawer that has walls all round."""
    return write_tray(tmp_path_factory.mktemp("assets") / "tray")
