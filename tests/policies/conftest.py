"""Session fixtures: a drawer and a door made of boxes; a run on the drawer, and its export."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from tests.envs.box_assets import write_asset, write_button, write_stack, write_tray

torch.set_num_threads(1)


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
def two_drawers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Asset folder of two such drawers above each other."""
    return write_stack(tmp_path_factory.mktemp("assets") / "stack")


@pytest.fixture(scope="session")
def run_folder(drawer: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A policy cloned from few demonstrations that sees positions only."""
    from mam_policies.algorithms.bc import BcConfig, BehaviourCloning
    from mam_policies.run import EnvChoice

    out = tmp_path_factory.mktemp("runs") / "drawer"
    choice = EnvChoice((str(drawer),), max_steps=120)
    BehaviourCloning().train(choice, BcConfig(episodes=30, epochs=100, deployable=True), out)
    return out


@pytest.fixture(scope="session")
def exported(run_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """That run as a LeRobot policy folder."""
    from mam_policies.lerobot.export import export_run

    out = tmp_path_factory.mktemp("exports") / "drawer"
    export_run(run_folder, out)
    return out


@pytest.fixture(scope="session")
def tray(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Asset folder of a chest with a drawer that has walls all round."""
    return write_tray(tmp_path_factory.mktemp("assets") / "tray")
