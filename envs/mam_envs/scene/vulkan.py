"""Running with and without a Vulkan driver: SAPIEN needs one for every picture, none for physics.

Without a driver SAPIEN fails as soon as a render material is made, which already happens while a
robot's URDF is parsed. `prepare` then strips the visuals before they are built.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import sapien
import torch
from sapien.wrapper.urdf_loader import URDFLoader

from mam_pipeline.errors import BackendError

VISUAL_FREE = ("state", "state_dict", "none")
FIX = (
    "install a Vulkan driver (on a machine without a GPU: Mesa >= 24.3, on Debian 12 from "
    "bookworm-backports; scripts/setup does it), or use obs_mode='state' without render_mode"
)


@cache
def vulkan_ok() -> bool:
    """Whether SAPIEN finds a Vulkan device that it can render with."""
    try:
        sapien.render.RenderMaterial()
    except RuntimeError:
        return False
    return True


def render_backend(asked: str, obs_mode: str | None, render_mode: str | None) -> str:
    """Resolve "auto": none when nothing is to be seen, else the GPU or the CPU.

    Raises:
        BackendError: pictures are asked for and there is no driver.
    """
    pictures = render_mode is not None or (obs_mode or "state") not in VISUAL_FREE
    if asked == "auto":
        asked = "none"
        if pictures:
            asked = "gpu" if torch.cuda.is_available() else "cpu"
    if asked != "none" and not vulkan_ok():
        what = f"render_mode={render_mode!r}" if render_mode else f"obs_mode={obs_mode!r}"
        raise BackendError(f"{what} needs rendering, and no Vulkan device was found; {FIX}")
    return asked


def prepare() -> None:
    """Make URDF files with materials loadable where there is no driver; else do nothing."""
    if vulkan_ok() or getattr(URDFLoader, "_mam_visual_free", False):
        return
    original = URDFLoader._build_link

    def without_visuals(self: URDFLoader, link: Any, builder: Any) -> Any:
        link.visuals = []
        return original(self, link, builder)

    URDFLoader._build_link = without_visuals
    URDFLoader._mam_visual_free = True
