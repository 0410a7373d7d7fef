"""`mam-sim export`: a policy or demonstrations to LeRobot, an asset to MJCF or USD."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro

from mam_pipeline.errors import ConfigError, InputError
from mam_sim.console import Screen


def export(
    source: Annotated[Path, tyro.conf.Positional],
    /,
    out: Path,
    to: Literal["lerobot", "mjcf", "usd"] = "lerobot",
    mapping: Path | None = None,
    asset: str | None = None,
    quiet: bool = False,
    json: bool = False,
) -> int:
    """Hand a result on to other software.

    Args:
        source: a run of mam-sim train or the folder of mam-sim collect (to lerobot), or an asset
            folder (to mjcf, usd).
        out: the folder to write; an earlier export there is replaced.
        to: lerobot, mjcf or usd.
        mapping: joint mapping between simulation and the real arm (YAML). For arms that LeRobot
            drives it must be filled in by measuring; without it a template is written.
        asset: of a run on several, the one to export for.
        quiet: print nothing but errors.
        json: print the result as JSON.
    """
    screen = Screen(quiet or json)
    if not source.exists():
        raise InputError(f"there is nothing at {source}")
    if to == "lerobot":
        from mam_policies.lerobot.export import export_dataset, export_run

        if (source / "run.json").is_file():
            found = export_run(source, out, mapping, asset)
        elif (source / "collect.json").is_file():
            found = export_dataset(source, out, mapping)
        else:
            raise InputError(f"{source} is neither a run nor a collection; --to lerobot needs one")
        if json:
            screen.json({"folder": out, "kind": found.kind, "notes": found.notes})
        screen.say(f"{found.kind}: {found.folder}")
        screen.say(f"mapping: {found.mapping}")
        for note in found.notes:
            screen.say(f"note: {note}")
        if found.kind == "policy":
            screen.say(f"next: the command lines in {found.folder / 'README.md'}")
        return 0
    if mapping is not None:
        raise ConfigError("--mapping belongs to --to lerobot")
    file = _asset(source, out, to)
    if json:
        screen.json({"folder": out, "kind": to, "file": file})
    screen.say(f"{to}: {file}")
    return 0


def _asset(source: Path, out: Path, to: str) -> Path:
    from mam_pipeline.asset.card import Asset

    found = Asset.load(source)
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file; --out names a folder")
    if to == "mjcf":
        from mam_pipeline.asset.mjcf import export_mjcf

        return export_mjcf(found, out / "object.xml")
    from mam_pipeline.asset.usd import export_usd

    return export_usd(found, out / "object.usda")
