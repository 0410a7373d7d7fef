"""Optional dependencies: which extra brings a package, and one error where it is missing.

The adapter that needs an optional package calls `require` before it imports it. Nothing else in the
project tests for packages by itself.
"""

from __future__ import annotations

from importlib.util import find_spec

from mam_pipeline.errors import BackendError

EXTRAS: dict[str, str] = {
    "gymnasium": "sim",
    "h5py": "sim",
    "imageio": "sim",
    "mani_skill": "sim",
    "safetensors": "sim",
    "sapien": "sim",
    "torch": "sim",
    "stable_baselines3": "rl",
    "tensorboard": "rl",
    "datasets": "lerobot",
    "lerobot": "lerobot",
    "openai": "vlm",
    "mujoco": "mujoco",
    "pxr": "usd",
    "pyarrow": "batch",
    "ray": "ray",
    "meshopt": "formats",
    "opengl_basisu": "formats",
    "viser": "studio",
}
"""Importable name -> the extra that installs it."""


class MissingExtra(BackendError):
    """A package that an extra installs is not there."""


def not_installed(what: str, package: str = "mam_sim_formats", way: str = "") -> MissingExtra:
    """The error where a plug-in package of this repository is missing.

    Args:
        what: comes with it, as the subject of a sentence. way: another way out, or "".
    """
    return MissingExtra(
        f"{what} comes with a package that is not installed; in a clone of mam-sim: "
        f"pip install ./plugins/{package}{way}"
    )


def has(*modules: str) -> bool:
    """Whether all these packages are installed; imports none of them."""
    return all(find_spec(module) is not None for module in modules)


def install_command(module: str) -> str:
    """What to type to get an optional package."""
    return f"pip install 'mam-sim[{EXTRAS[module]}]'"


def require(what: str, *modules: str) -> None:
    """Raise MissingExtra unless all these packages are installed; imports none of them.

    Args:
        what: what needs them, as the subject of a sentence: "USD export".
        modules: importable names, each a key of `EXTRAS`.
    """
    for module in modules:
        if not has(module):
            raise MissingExtra(f"{what} needs the package {module}: {install_command(module)}")
