"""Which of an MJCF's or a USD file's traits one simulator would refuse or ignore.

The rules come with another package, by the format's name: plugins/mam_sim_formats.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from mam_pipeline import thresholds as limits
from mam_pipeline.check.profiles import PROFILES, Profile
from mam_pipeline.check.report import Finding
from mam_pipeline.errors import InputError, unknown_name
from mam_pipeline.formats.apart import apart
from mam_pipeline.formats.door import Outside
from mam_pipeline.formats.suffixes import USD
from mam_pipeline.formats.xml_file import Doctype, parse_xml
from mam_pipeline.optional import not_installed
from mam_pipeline.registry import Registry

READERS = {
    "MJCF": ("mujoco", "isaac", "newton", "physx-gpu"),
    "USD": ("isaac", "newton", "physx-gpu"),
}
"""Simulators that read a format by themselves; the others read URDF."""


def format_of(path: Path) -> str | None:
    """ "MJCF" or "USD" for a file of such a format, else None."""
    if path.suffix.lower() in USD:
        return "USD"
    if path.suffix.lower() != ".xml":
        return None
    try:
        return "MJCF" if parse_xml(path, limits.MAX_XML_BYTES).tag == "mujoco" else None
    except InputError:  # the lint of URDF says why
        return None


def file_findings(path: Path, name: str) -> list[Finding]:
    """Findings about an MJCF or a USD file for one simulator.

    Args:
        path: a file of which `format_of` knows the format.
        name: of the profile.

    Raises:
        ConfigError: no profile of that name. MissingExtra: what reads the format is
            not installed.
    """
    if name not in PROFILES:
        raise unknown_name("profile", name, PROFILES)
    kind = format_of(path) or ""
    out = []
    if name not in READERS[kind]:
        text = f"this simulator takes no {kind}, or loses meshes and joints of it; give it URDF"
        out.append(Finding("file_format", path.name, text))
    table, key = Registry("simulator_rules", {}), kind.lower()
    if key not in table.targets():
        raise not_installed(f"{path.name}: checking {kind}")
    rules = table.load(key)
    try:
        work = partial(_found, rules, path, name)
        return out + apart(work, path, kind, "simplify it, or give a URDF")
    except Outside as error:
        return [*out, Finding("mesh_outside", path.name, str(error))]
    except Doctype as error:
        return [*out, Finding("xml_entities", path.name, str(error))]
    except InputError as error:
        return [*out, Finding("file_unreadable", path.name, str(error))]


def _found(
    rules: Callable[[Path, str, Profile], Iterator[Finding]], path: Path, name: str
) -> list[Finding]:
    return list(rules(path, name, PROFILES[name]))
