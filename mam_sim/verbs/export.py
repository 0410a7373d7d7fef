"""`mam-sim export`: a policy or demonstrations to LeRobot, an asset to MJCF, USD or SDF."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from mam_pipeline.claims import EXPORT, claim_folder, mark_export
from mam_pipeline.errors import ConfigError, InputError
from mam_sim.console import Screen
from mam_sim.options import Verb


@dataclass(frozen=True, kw_only=True)
class Export(Verb):
    """Hand a result on to other software."""

    source: Positional[Path]
    """A run of mam-sim train or the folder of mam-sim collect (to lerobot), or an asset folder (to
    mjcf; usd; usdz: everything in one file; sdf: a model folder of Gazebo)."""
    out: Path
    """The folder to write; an earlier export there is replaced."""
    to: Literal["lerobot", "mjcf", "usd", "usdz", "sdf"] | None = None
    """The format; default: lerobot for a run or a collection. For an asset it must be said."""
    mapping: Path | None = None
    """Joint mapping between simulation and the real arm (YAML). For arms that LeRobot drives it
    must be filled in by measuring; without it a template is written."""
    asset: str | None = None
    """Of a run on several assets, the one to export for."""
    json: bool = False
    """Print the result as JSON."""

    def run(self) -> int:
        """Write the export; print where it is and what to do next."""
        if not self.source.exists():
            raise InputError(f"there is nothing at {self.source}")
        screen = Screen(self.quiet or self.json)
        to = self.to or self._only_format()
        if to == "lerobot":
            return self._lerobot(screen)
        if self.mapping is not None:
            raise ConfigError("--mapping belongs to --to lerobot")
        file = _asset(self.source, self.out, to)
        notes = _losses(self.source, to)
        if self.json:
            screen.json({"folder": self.out, "kind": to, "file": file, "notes": notes})
        screen.say(f"{to}: {file}")
        for note in notes:
            screen.say(f"note: {note}")
        seen = self.source if to == "sdf" else file  # check reads no SDF: it is made of the URDF
        profile = {"mjcf": "mujoco", "sdf": "gazebo"}.get(to, "isaac")
        screen.next("check", str(seen), "--profile", profile)
        return 0

    def _only_format(self) -> str:
        """The format of a run or a collection; of an asset, it must be said."""
        if any((self.source / name).is_file() for name in ("run.json", "collect.json")):
            return "lerobot"
        from mam_pipeline.asset.card import Asset

        Asset.card_of(self.source)
        raise ConfigError(f"{self.source} is an asset; add --to mjcf, usd, usdz or sdf")

    def _lerobot(self, screen: Screen) -> int:
        from mam_policies.lerobot.dataset import REPO_ID
        from mam_policies.lerobot.export import export_dataset, export_run

        if (self.source / "run.json").is_file():
            found = export_run(self.source, self.out, self.mapping, self.asset)
        elif (self.source / "collect.json").is_file():
            found = export_dataset(self.source, self.out, self.mapping)
        else:
            raise InputError(
                f"{self.source} is neither a run nor a collection; --to lerobot needs one"
            )
        if self.json:
            screen.json(asdict(found))
        screen.say(f"{found.kind}: {found.folder}")
        screen.say(f"mapping: {found.mapping}")
        for note in found.notes:
            screen.say(f"note: {note}")
        if found.dataset is not None:
            screen.say(f"root:    {found.dataset}")
            screen.say(f'next:    LeRobotDataset("{REPO_ID}", root="{found.dataset}")')
        if found.kind == "policy":
            screen.say(f"next: the command lines in {found.folder / 'README.md'}")
        return 0


def _losses(source: Path, to: str) -> list[str]:
    """What the format has no words for, each in a sentence."""
    from mam_pipeline.asset.card import Asset

    joints = Asset.card_of(source).card.joints
    caught = [j.name for j in joints if j.catch is not None and j.catch.force > 0]
    carried = [j.name for j in joints if j.balance is not None]
    named, out = to.upper().removesuffix("Z"), []
    if caught:
        out.append(f"{named} cannot say what keeps {', '.join(caught)} closed; the MJCF has it")
    if carried:
        out.append(
            f"in {named} friction holds {', '.join(carried)}; the MJCF has springs that carry them"
        )
    return [] if to == "mjcf" else out


def _asset(source: Path, out: Path, to: str) -> Path:
    from mam_pipeline.asset.card import Asset
    from mam_pipeline.asset.exporters import export_asset

    found = Asset.load(source)
    inside = out.resolve() == found.folder  # an asset may hold its own exports
    if not inside:
        claim_folder(out, EXPORT)
    file = export_asset(found, to, out / f"object.{'xml' if to == 'mjcf' else to}")
    if not inside:
        mark_export(out, to, source)
    return file
