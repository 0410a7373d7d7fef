"""An asset looks in other simulators' own renderers as it does in ours, from the same place.

Light differs in strength, so colours are compared where the object is, by structural similarity
(SSIM, Wang et al. 2004) of their brightness, and its outline by overlap.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from skimage.metrics import structural_similarity

from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.read import read_asset
from mam_pipeline.render.mesh_pictures import render_mesh
from tests.conformance.bullet import empty_world
from tests.conformance.test_conformance import FAST, SLOW

SIZE, AZIMUTH, ELEVATION, FIELD = 256, -35.0, 25.0, 30.0
"""Pixels, and degrees as `render_mesh` has them."""
BLOCK = 4
"""Pixels along a side that are compared as one."""
OUTLINE = 0.97
"""Least overlap of the outlines."""
ALIKE = 0.85
"""Least structural similarity."""


@dataclass(frozen=True)
class View:
    """A picture (H, W, 3), 0..1, white around the object; `mask` (H, W) is where that is."""

    picture: NDArray[np.float64]
    mask: NDArray[np.bool_]


def _view(picture: Any, mask: Any) -> View:
    seen = np.asarray(mask, dtype=bool)
    colors = np.asarray(picture, dtype=np.float64)[..., :3] / 255.0
    return View(np.where(seen[..., None], colors, 1.0), seen)


@pytest.fixture(scope="session")
def ours() -> dict[str, tuple[View, NDArray[np.float64], float]]:
    return {}


def _ours(asset: Asset) -> tuple[View, NDArray[np.float64], float]:
    """Our picture, the point that is looked at, and the eye's distance from it."""
    mesh = read_asset(asset).mesh
    far = 0.54 * mesh.diagonal / np.sin(np.radians(FIELD) / 2)
    picture = render_mesh(mesh, (SIZE, SIZE), AZIMUTH, ELEVATION, distance=far, supersample=1)
    black = np.zeros((len(mesh.faces), 3), np.uint8)
    shade = render_mesh(mesh, (SIZE, SIZE), AZIMUTH, ELEVATION, black, far, supersample=1)
    return _view(picture, (shade < 128).all(axis=2)), mesh.bounds.mean(axis=0), float(far)


def _away() -> NDArray[np.float64]:
    """From the object to the eye."""
    a, e = np.radians(AZIMUTH), np.radians(ELEVATION)
    return np.array([-np.cos(a) * np.cos(e), -np.sin(a) * np.cos(e), np.sin(e)])


def _key() -> NDArray[np.float64]:
    """From the object to the light, as `render_mesh` has it: from the eye, and above it."""
    key = _away() + np.array([0.2, 0.5, 1.1])
    return np.asarray(key / np.linalg.norm(key))


def _mujoco(asset: Asset, target: NDArray[np.float64], far: float) -> View:
    mujoco = pytest.importorskip("mujoco")
    from mam_sim_formats.mjcf_export import export_mjcf

    file = export_mjcf(asset, asset.folder.parent / "seen_mjcf" / asset.folder.name / "object.xml")
    model = mujoco.MjModel.from_xml_path(str(file))
    model.vis.global_.fovy = FIELD
    model.light_active[1:], model.light_castshadow[:] = 0, 0
    model.light_type[0], model.light_dir[0] = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, -_key()
    model.light_ambient[0], model.light_diffuse[0], model.light_specular[0] = 0.0, 0.45, 0.0
    model.vis.headlight.ambient[:], model.vis.headlight.diffuse[:] = 0.35, 0.2
    model.vis.headlight.specular[:] = 0.0
    data, camera = mujoco.MjData(model), mujoco.MjvCamera()
    mujoco.mj_forward(model, data)
    camera.lookat[:], camera.distance = target, far
    camera.azimuth, camera.elevation = AZIMUTH, -ELEVATION
    try:
        renderer = mujoco.Renderer(model, SIZE, SIZE)
    except Exception as error:  # no graphics driver, not even one in software
        pytest.skip(f"MuJoCo cannot draw here: {error}")
    options = mujoco.MjvOption()
    renderer.update_scene(data, camera, options)
    picture = renderer.render().copy()
    renderer.enable_segmentation_rendering()
    renderer.update_scene(data, camera, options)
    mask = renderer.render()[..., 0] >= 0
    renderer.close()
    return _view(picture, mask)


def _pybullet(asset: Asset, target: NDArray[np.float64], far: float) -> View:
    library = empty_world()
    flags = library.URDF_USE_MATERIAL_COLORS_FROM_MTL
    library.loadURDF(str(asset.urdf_path), useFixedBase=True, flags=flags)
    eye = (target + far * _away()).tolist()
    light = 0.45 * _key() + 0.25 * _away()  # it has one light: the sum of our two
    strength = float(np.linalg.norm(light))
    _, _, picture, _, body = library.getCameraImage(
        SIZE, SIZE, library.computeViewMatrix(eye, target.tolist(), [0, 0, 1]),
        library.computeProjectionMatrixFOV(FIELD, 1.0, 0.01 * far, 10 * far),
        renderer=library.ER_TINY_RENDERER, shadow=0,
        lightDirection=(light / strength).tolist(), lightAmbientCoeff=0.35,
        lightDiffuseCoeff=strength, lightSpecularCoeff=0.0,
    )  # fmt: skip
    shape = SIZE, SIZE
    return _view(np.reshape(picture, (*shape, 4)), np.reshape(body, shape) >= 0)


RENDERERS: dict[str, Callable[[Asset, NDArray[np.float64], float], View]] = {
    "MuJoCo": _mujoco, "PyBullet": _pybullet,
}  # fmt: skip


@pytest.mark.parametrize("simulator", list(RENDERERS))
@pytest.mark.parametrize("name", [*(pytest.param(n, marks=pytest.mark.slow) for n in SLOW), *FAST])
def test_an_asset_looks_alike(
    name: str,
    simulator: str,
    asset_named: Callable[[str], Asset],
    ours: dict[str, tuple[View, NDArray[np.float64], float]],
    pictures: list[dict[str, Any]],
) -> None:
    asset = asset_named(name)
    own, target, far = ours.get(name) or ours.setdefault(name, _ours(asset))
    other = RENDERERS[simulator](asset, target, far)
    both = own.mask & other.mask
    outline = float(both.sum() / (own.mask | other.mask).sum())
    alike = _similarity(own, other, both)
    pictures.append({"asset": name, "simulator": simulator, "outline": outline, "ssim": alike})
    assert outline > OUTLINE and alike > ALIKE


def _similarity(own: View, other: View, both: NDArray[np.bool_]) -> float:
    """Mean SSIM of brightness over the pixels of both, each scaled to the same mean and spread.

    Blocks of pixels are compared: renderers sample textures and edges half a pixel apart.
    """
    seen = _blocks(both.astype(float)) == 1.0
    grey = []
    for view in (own, other):
        value = _blocks(view.picture.mean(axis=2))
        spread = max(float(value[seen].std()), 1e-3)
        grey.append(np.where(seen, (value - value[seen].mean()) / spread, 0.0))
    full = structural_similarity(grey[0], grey[1], data_range=6.0, full=True)[1]
    return float(full[seen].mean())


def _blocks(image: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(image.reshape(SIZE // BLOCK, BLOCK, SIZE // BLOCK, BLOCK).mean(axis=(1, 3)))
