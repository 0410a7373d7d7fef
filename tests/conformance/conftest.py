"""Assets that are made once, and the table that the conformance tests write when asked to."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable, Iterator
from ctypes.util import find_library
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import pytest

from mam_pipeline.asset.card import Asset
from tests.conformance.assets import ASSETS
from tests.conformance.bullet import SIDE

if find_library("EGL"):  # MuJoCo asks at import; without it, it draws on a screen only
    os.environ.setdefault("MUJOCO_GL", "egl")
COMMAND = "pytest tests/conformance --conformance-out docs/results"
PACKAGES = ("sapien", "mujoco", "pybullet", "yourdfpy", "usd-core")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--conformance-out", type=Path, help="folder for conformance.json and .md")


@pytest.fixture(scope="session")
def asset_named(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Asset]:
    """Make an asset of the table, or return the one that was made."""
    made: dict[str, Asset] = {}

    def get(name: str) -> Asset:
        if name not in made:
            made[name] = ASSETS[name](tmp_path_factory.mktemp("conformance"))
        return made[name]

    return get


@pytest.fixture(scope="session")
def motion() -> dict[str, dict[str, float]]:
    """How a drawer moved, by simulator; it becomes a table of the same page."""
    return {}


@pytest.fixture(scope="session")
def breakaway() -> list[dict[str, Any]]:
    """Which force starts a part, and where its limits stop it, by asset and simulator."""
    return []


@pytest.fixture(scope="session")
def pictures() -> list[dict[str, Any]]:
    """How alike pictures of other simulators are to ours, by asset and simulator."""
    return []


@pytest.fixture(scope="session")
def rows(
    request: pytest.FixtureRequest,
    motion: dict[str, dict[str, float]],
    breakaway: list[dict[str, Any]],
    pictures: list[dict[str, Any]],
) -> Iterator[list[dict[str, Any]]]:
    """Rows of the table, which is written at the end if `--conformance-out` names a folder."""
    out: list[dict[str, Any]] = []
    yield out
    folder = request.config.getoption("--conformance-out", None)
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        told = {r["simulator"]: r.pop("version") for r in out if "version" in r}
        versions = _versions() | {name.partition(" (")[0]: v for name, v in told.items()}
        data = {"command": COMMAND, "versions": versions, "rows": out, "motion": motion,
                "breakaway": breakaway, "pictures": pictures}  # fmt: skip
        (folder / "conformance.json").write_text(json.dumps(data, indent=1) + "\n")
        (folder / "conformance.md").write_text(_page(data), encoding="utf-8")


def _versions() -> dict[str, str]:
    found = {}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = _beside(name) or "not installed"
    return found


def _beside(name: str) -> str:
    """Version of a package in the interpreter that PyBullet has where this one has none."""
    if not SIDE.exists():
        return ""
    command = f"from importlib.metadata import version; print(version({name!r}))"
    done = subprocess.run([SIDE, "-c", command], capture_output=True, text=True)
    return done.stdout.strip()


def _page(data: dict[str, Any]) -> str:
    columns = {
        "asset": "asset", "simulator": "opened by", "links": "links", "joints": "joints",
        "visuals": "visuals", "textured": "textured", "faces": "triangles", "mass": "mass",
        "limits": "limits", "kinematics": "kinematics", "visual_box": "visual box, mm",
        "collision_box": "collision box, mm",
    }  # fmt: skip
    lines = [
        "# What other simulators make of the assets",
        "",
        f"Written by `{data['command']}`; do not edit.",
        "",
        "Counts are found / written. Mass and limits are the largest relative and absolute error.",
        "Kinematics is the largest error of a link frame over five configurations; a USD file has",
        "the rest pose only. Boxes are axis-aligned, per link, against those of the files.",
        "A dash: the simulator cannot say.",
        "",
        "Versions: " + ", ".join(f"{k} {v}" for k, v in data["versions"].items()) + ".",
        "",
        "| " + " | ".join(columns.values()) + " |",
        "|" + "---|" * len(columns),
    ]
    for row in data["rows"]:
        lines.append("| " + " | ".join(_cell(row.get(k)) for k in columns) + " |")
    lines += [
        "",
        "PyBullet colours materials without a texture only if it is told to:",
        "`loadURDF(file, flags=p.URDF_USE_MATERIAL_COLORS_FROM_MTL)`.",
        "urdf-usd-converter needs an environment of its own: its usd-exchange and usd-core both",
        "hold the package `pxr`.",
        "",
        "Drake opens the URDF, and the SDF by Gazebo's parser, libsdformat, which is part of it.",
        "Drake and Newton ran in an interpreter that SIMULATOR_PYTHON names (`pip install drake",
        "newton newton-usd-schemas usd-core scipy`); without one, their tests are skipped.",
        "",
        "By hand: Gazebo's parser (sdformat 12.3) took the five URDFs without an error, with all",
        "links, joints, visuals, limits, damping and friction. Genesis 1.4.5 opened the URDF of",
        "`part on part` on a CPU with 4 of 4 links, 12 of 12 visuals and the mass of what moves;",
        "no motion was measured there. Genesis has no test, and Gazebo itself and Isaac Sim were",
        "not run.",
        "",
        "## The same motion",
        "",
        "The drawer of the generated asset is driven for 2 s to 60 % of its range by the same PD",
        "gains (200/s² and 30/s, times its mass). Way is the largest difference from MuJoCo's",
        "motion, end the distance from the target, both as shares of the range. Then it is left",
        "alone, closed, for 5 s under gravity; drift is the most that any joint moved (m or rad).",
        "",
        "| simulator | way | end | drift |",
        "|---|---|---|---|",
    ]
    for name, found in data["motion"].items():
        shares = " | ".join(f"{100 * found[k]:.2f} %" for k in ("way", "end"))
        lines.append(f"| {name} | {shares} | {_cell(found['drift'])} |")
    lines += [
        "",
        "## The same breakaway, the same limits",
        "",
        "The least force (N) or torque (N m) that opens the heaviest part from closed, by halving,",
        "beside that of the card: its friction, and what gravity adds or takes. Then the part is",
        "pushed from the middle to both ends; lower and upper say how far from its limit it stops,",
        "as shares of the range. MuJoCo reads the friction itself; below it, its soft constraint",
        "lets a part creep (an oven flap at nine tenths of its friction by 0.03 rad/s). SAPIEN and",
        "PyBullet read a URDF's `friction` and do not act on it as Coulomb's: it is given to them",
        "as environments give it, by a drive or motor towards standstill of limited force. Drake's",
        "plant has no friction of joints. Newton reads the USD's into its model, and none of its",
        "solvers was run; nor was Genesis.",
        "",
        "| asset | joint | program | card | found | difference | lower | upper |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in data.get("breakaway", ()):
        forces = " | ".join(f"{row[k]:.3g} {row['unit']}" for k in ("wanted", "found"))
        parts = [row["found"] / row["wanted"] - 1.0, row["lower"], row["upper"]]
        cells = " | ".join(f"{100 * part:.1f} %" for part in parts)
        lines.append(
            f"| {row['asset']} | `{row['joint']}` | {row['simulator']} | {forces} | {cells} |"
        )
    lines += [
        "",
        "## The same picture",
        "",
        "MuJoCo's renderer and PyBullet's TinyRenderer beside ours, from the same place, by the",
        "same light. Outline is the overlap of the outlines; alike is the structural",
        "similarity (SSIM) of brightness within them, after mean and spread were made equal.",
        "",
        "| asset | drawn by | outline | alike |",
        "|---|---|---|---|",
    ]
    for row in data["pictures"]:
        shares = f"{row['outline']:.3f} | {row['ssim']:.2f}"
        lines.append(f"| {row['asset']} | {row['simulator']} | {shares} |")
    lines += [
        "",
        "![Four assets as four programs draw them](same_pictures.png)",
        "",
        "By `benchmarks/same_pictures.py`: each program's own renderer, the heaviest part open by",
        "six tenths. SAPIEN reflects grey surroundings in what is metal, as this fridge's sheet.",
    ]
    return "\n".join(lines) + "\n"


def _cell(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.1e}" if value else "0"
    return str(value)
