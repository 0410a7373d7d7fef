"""How much disk the installed packages take, by the extra of mam-sim that brings them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import metadata

from packaging.requirements import InvalidRequirement, Requirement
from packaging.utils import canonicalize_name

HOME = "mam-sim"
EXTRAS = ("sim", "studio", "rl", "lerobot", "arms", "usd", "mujoco", "formats", "batch", "ray",
          "vlm", "train", "docs", "dev")  # fmt: skip
"""A package that several extras need counts to the first of them."""
CUDA = ("nvidia-", "cuda-", "triton")
"""What the names of CUDA libraries begin with; PyTorch's CPU wheels bring none of them."""
Requires = Mapping[str, Iterable[str]]


def size_by_part() -> dict[str, int]:
    """Bytes of the installed packages: core, each extra, CUDA libraries, and others."""
    sizes: dict[str, int] = {}
    requires: dict[str, Iterable[str]] = {}
    for found in metadata.distributions():
        name = canonicalize_name(found.metadata["Name"])
        sizes[name] = sum(file.size or 0 for file in found.files or ())
        requires[name] = found.requires or ()
    return parts(sizes, requires)


def parts(sizes: Mapping[str, int], requires: Requires) -> dict[str, int]:
    """Bytes by part.

    Args:
        sizes: bytes by package. requires: requirements by package, as their metadata says them.
    """
    out: dict[str, int] = {}
    taken = {name for name in sizes if name.startswith(CUDA)}
    out["CUDA libraries"] = sum(sizes[name] for name in taken)
    for part in ("", *EXTRAS):
        mine = closure(part, requires) - taken
        out[part or "core"] = sum(sizes.get(name, 0) for name in mine)
        taken |= mine
    out["others"] = sum(size for name, size in sizes.items() if name not in taken)
    return {part: size for part, size in out.items() if size}


def closure(extra: str, requires: Requires) -> set[str]:
    """The packages that mam-sim needs with an extra ("": none), itself too."""
    done: set[tuple[str, str]] = set()
    todo = [(HOME, extra)]
    while todo:
        name, wanted = todo.pop()
        if (name, wanted) in done:
            continue
        done.add((name, wanted))
        for text in requires.get(name, ()):
            try:
                need = Requirement(text)
            except InvalidRequirement:  # of an old package
                continue
            if need.marker is None or need.marker.evaluate({"extra": wanted}):
                todo += [(canonicalize_name(need.name), more) for more in ("", *need.extras)]
    return {name for name, _ in done}
