"""Imports of the command without what it never calls: it starts a second and a half earlier.

lightgbm looks for scikit-learn and pandas to offer their interfaces too, and open3d takes in a web
server to draw with; we predict with the one and cast rays with the other. trimesh takes in graphs,
trees and a CAD kernel that few of its functions use. In a process of the
command line these are left out until somebody asks for them. Python users' imports are not touched.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any

ABSENT = {"lightgbm": ("sklearn", "pandas", "dask", "pyarrow", "cffi", "matplotlib", "graphviz")}
"""What a library does without where it is not installed."""
LATER = {
    "open3d": ("plotly", "plotly.graph_objects", "dash"),
    "trimesh": (
        "networkx",
        "cascadio",
        "rtree",
        "rtree.index",
        "scipy.optimize",
        "scipy.ndimage",
    ),
    "scipy._lib.array_api_compat.numpy": ("numpy.f2py", "numpy.testing"),
    "sapien.asset": ("requests",),
    "sapien.physx": ("requests",),
}
"""What a library takes in at once and uses in few functions."""


def install() -> None:
    """Let the imports of this process be lean; a second call changes nothing."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())


class _Later(ModuleType):
    """Stands for a module, or something of one, and fetches it when it is used."""

    def __init__(self, module: str, name: str = "") -> None:
        super().__init__(module)
        self.__dict__.update(_module=module, _name=name)

    def _real(self) -> Any:
        found = importlib.import_module(self.__dict__["_module"])
        name = self.__dict__["_name"]
        return getattr(found, name) if name else found

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        module = self.__dict__["_module"]
        if sys.modules.get(module) is self:  # "from dash import Dash", while it is stood for
            return sys.modules.get(f"{module}.{name}") or _Later(module, name)
        return getattr(self._real(), name)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return self._real()(*args, **kwargs)


@contextmanager
def _stood_for(name: str) -> Iterator[None]:
    """What the library is to do without is absent or stood for, unless it is there already."""
    put: dict[str, ModuleType | None] = {}
    put |= {other: None for other in ABSENT.get(name, ()) if other not in sys.modules}
    put |= {other: _Later(other) for other in LATER.get(name, ()) if other not in sys.modules}
    modules: dict[str, Any] = sys.modules
    modules.update(put)
    within = [_within(other, stand_in) for other, stand_in in put.items() if "." in other]
    try:
        yield
    finally:
        for package, other in filter(None, within):
            if isinstance(vars(package).get(other), _Later):
                delattr(package, other)
        for other, stand_in in put.items():
            if modules.get(other, put) is stand_in:
                del modules[other]


def _within(other: str, stand_in: ModuleType | None) -> tuple[ModuleType, str] | None:
    """Make what stands for a submodule its package's attribute too; None where that has one."""
    above, _, name = other.rpartition(".")
    package = sys.modules.get(above)
    if stand_in is None or package is None or isinstance(package, _Later) or name in vars(package):
        return None
    setattr(package, name, stand_in)
    return package, name


class _Loader(Loader):
    def __init__(self, real: Loader) -> None:
        self.real = real

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return self.real.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        with _stood_for(module.__name__):
            self.real.exec_module(module)


class _Finder(MetaPathFinder):
    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name not in ABSENT and name not in LATER:
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = _Loader(spec.loader)
        return spec
