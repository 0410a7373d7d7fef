"""URDFs of arms that come as packages of the index."""

from __future__ import annotations

import hashlib
import importlib.metadata
from pathlib import Path

from mam_pipeline.errors import ConfigError
from mam_pipeline.folders import write_text


def packaged(package: str, urdf: str) -> Path:
    """A URDF of a package that is laid out as example-robot-data, with full paths of its meshes.

    SAPIEN does not know where `package://` leads, so a copy is kept in ~/.cache/mam-sim/robots.

    Args:
        package: its name on the index.
        urdf: path below the package's folder robots/.

    Raises:
        ConfigError: the package is not installed, or has no such file.
    """
    install = f"pip install 'mam-sim[arms]' (or {package})"
    try:
        found = importlib.metadata.distribution(package)
    except importlib.metadata.PackageNotFoundError:
        raise ConfigError(f"this robot's model is in {package}, not installed; {install}") from None
    share = Path(str(found.locate_file(f"cmeel.prefix/share/{package}")))
    source = share / "robots" / urdf
    if not source.is_file():
        raise ConfigError(f"{package} {found.version} has no robots/{urdf}; {install}")
    text = source.read_text(encoding="utf-8").replace(f"package://{package}", share.as_posix())
    key = hashlib.sha256(text.encode()).hexdigest()[:16]
    copy = Path("~/.cache/mam-sim/robots").expanduser() / key / source.name
    if not copy.is_file():
        copy.parent.mkdir(parents=True, exist_ok=True)
        write_text(copy, text)
    return copy
