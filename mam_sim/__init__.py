"""From a photo or a static 3D mesh to an articulated asset and a robot environment.

    from mam_sim import make_asset, make_env, check

    asset = make_asset("cabinet.glb", out="cabinet", height=0.9)
    print(check(asset.folder).passed)
    env = make_env(asset, robot="panda")
    observation, info = env.reset(seed=0)

These functions are what the command line calls; nothing heavy is imported before one is used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mam_sim.api import check, make_asset, make_env

__version__ = "0.1.0"
__all__ = ["check", "make_asset", "make_env"]


def __getattr__(name: str) -> Any:
    if name in __all__:
        from mam_sim import api

        return getattr(api, name)
    raise AttributeError(f"module 'mam_sim' has no attribute {name!r}")
