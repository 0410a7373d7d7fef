"""`mam-sim articulate`: a photo, mesh or URDF to an asset folder."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from tyro.conf import OmitArgPrefixes, Positional

from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.origins import motion_origin, range_origin, size_origin
from mam_pipeline.claims import PICTURE, is_ours, png_mark
from mam_pipeline.errors import BackendError, HintNeeded, MamSimError
from mam_pipeline.formats.mesh_files import files_kept
from mam_pipeline.formats.placement import Decision
from mam_pipeline.lengths import UnusualSize
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.models.ledger import Ledger, one_ledger
from mam_pipeline.models.settings import given
from mam_pipeline.optional import has
from mam_pipeline.run import make_asset
from mam_sim.asking import answered_yes, ask_upload, with_model
from mam_sim.console import Screen
from mam_sim.options import Verb, carried

DRAFT = "This asset is a draft: look at it in the report, and confirm or correct what was read."
LIKELIEST = 3  # dormant joints that are named where none moves


@dataclass(frozen=True, kw_only=True)
class Articulate(Verb):
    """Make an articulated, simulation-ready asset folder from a photo, a mesh or a URDF.

    Exit status 1 when the asset, which is kept, fails its check, or when none of its joints moves.
    """

    source: Positional[Path]
    """The photo (jpg, png ...), mesh (glb, obj, stl, dae, usd, step ...) or URDF."""
    out: Path
    """The asset folder to write."""
    pipeline: Annotated[MakeConfig, OmitArgPrefixes] = field(default_factory=MakeConfig)
    json: bool = False
    """Print the asset card as JSON."""

    def run(self) -> int:
        """Write the asset and its report; print what was found."""
        screen = Screen(self.quiet or self.json)
        names = ["read", "segment", "prior", "reason", "joints", "asset", "check", "report"]
        with given(self.pipeline.models.settings()):
            ask_upload(self.source, self.pipeline.reconstructor)
            config = with_model(self.source, self.pipeline)
        with screen.stages(names) as bar, files_kept():
            with given(self.pipeline.models.settings()), cost_told(screen) as ledger:
                asset = made_with_model(self.source, self.out, self.pipeline, config, bar)
            bar("report")
            from mam_sim.report import write_report

            write_report(asset)
        if self.json:
            screen.json(asdict(asset.card))
        describe(screen, asset)
        tell_cost(screen, ledger)
        screen.say(f"report: {asset.folder / 'report.html'}")
        if tell_draft(asset, self.pipeline.photo.accept_low_confidence):
            return HintNeeded.exit_code
        if tell_still(asset, self.source, self.out, carried(self, sections=("pipeline",))):
            return 1
        passed = asset.card.checks["executability"]["passed"]
        words = ["view", str(self.out)]
        if passed and has("sapien"):
            chosen = carried(self, sections=("pipeline",))
            words = ["make-env", str(self.source), "--out", str(self.out), *chosen]
        screen.next(*words)
        return 0 if passed else 1


def make(source: Path, out: Path, config: MakeConfig, on_stage: Callable[[str], None]) -> Asset:
    """`make_asset`, with the pictures of a refused photo written beside `out`.

    On a terminal, an unusual size is asked about. A draft is returned as what it is.
    """
    try:
        return make_asset(source, out, config, on_stage)
    except HintNeeded as error:
        if error.draft is None:
            raise
        return Asset.load(error.draft)
    except UnusualSize as error:
        if not answered_yes(str(error)):
            raise
        return make(source, out, replace(config, yes=True), on_stage)
    except MamSimError as error:
        pictures: Mapping[str, Any] = getattr(error, "pictures", {})
        if not pictures:
            raise
        from PIL import Image

        written = []
        out.parent.mkdir(parents=True, exist_ok=True)
        for label, picture in pictures.items():
            path = out.parent / f"{out.name}-{label}.png"
            if path.exists() and not is_ours(path, PICTURE):
                continue
            shown = Image.fromarray(np.asarray(picture))
            shown.save(path, format="PNG", pnginfo=png_mark())
            written.append(str(path))
        raise type(error)(f"{error}\n  see {', '.join(written)}") from error


def made_with_model(
    source: Path, out: Path, config: MakeConfig, chosen: MakeConfig, on_stage: Callable[[str], None]
) -> Asset:
    """The asset as `chosen`; as `config` where a model that `auto` took does not answer."""
    try:
        return make(source, out, chosen, on_stage)
    except BackendError as error:
        if chosen == config:
            raise
        print(f"the language model is left out: {error}", file=sys.stderr)
        return make(source, out, config, on_stage)


def tell_draft(asset: Asset, accepted: bool) -> bool:
    """Say of a draft what is doubted and how to settle it; whether that ends the command."""
    if not asset.card.unconfirmed:
        return False
    print(f"{DRAFT}\n{asset.card.unconfirmed}", file=sys.stderr)
    return not accepted


@contextmanager
def cost_told(screen: Screen) -> Iterator[Ledger]:
    """One ledger for the block; what was asked until then is said where the block fails, too."""
    with one_ledger() as ledger:
        try:
            yield ledger
        except BaseException:
            tell_cost(screen, ledger)
            raise


def tell_cost(screen: Screen, ledger: Ledger) -> None:
    """Say what asking a model cost, where one was asked."""
    if ledger.summary():
        screen.say(f"asked:  {ledger.summary()}")


def tell_still(asset: Asset, source: Path, out: Path, chosen: Sequence[str]) -> bool:
    """Say, where no joint of the asset moves, what is likeliest to and how to wake it.

    Args:
        chosen: flags with which the asset was made.

    Returns:
        Whether no joint moves.
    """
    card = asset.card
    if card.movable:
        return False
    told = (
        f"error: nothing that moves was found in {source.name}; the asset is written as it stands"
    )
    command = ["mam-sim", "articulate", str(source), "--out", str(out), *chosen]
    if card.dormant:
        likely = [
            f"{joint.child} ({joint.subtype}, {joint.confidence:.2f})"
            for joint in card.likeliest[:LIKELIEST]
        ]
        more = "" if len(card.dormant) <= LIKELIEST else f" and {len(card.dormant)} in all"
        command += ["--accept", card.likeliest[0].child]
        told = f"error: no joint of {source.name} is likely enough to move; the likeliest dormant "
        told += f"ones are {', '.join(likely)}{more}; wake one with: {shlex.join(command)}"
    else:
        told += f"; name a part in a hints file: {shlex.join([*command, '--hints', 'FILE'])}"
    print(told, file=sys.stderr)
    return True


def describe(screen: Screen, asset: Asset) -> None:
    """Print what was found: one line per joint, dormant ones last."""
    card, source = asset.card, asset.card.made_from
    for note in card.notes:
        screen.say(note)
    for row in card.placement:
        screen.say(Decision(**row).told())
    count = len(card.movable)
    asleep = f", {len(card.dormant)} dormant" if card.dormant else ""
    screen.say(f"{card.name}: {count} joint{'s' if count != 1 else ''}{asleep}")
    for joint in (*card.joints, *card.likeliest):
        unit = "m" if joint.type == "prismatic" else "deg"
        factor = 1.0 if unit == "m" else 180 / np.pi
        if joint.lower is None or joint.upper is None:
            span = "without limits"
        else:
            span = f"{joint.lower * factor:.3g} to {joint.upper * factor:.3g} {unit}"
        origins = f"{motion_origin(joint, source)}; range {range_origin(joint, source)}"
        screen.say(
            f"  {joint.name:<24} {joint.type:<10} {joint.subtype:<6} {span:<22} "
            f"{origins}   {joint.review}".rstrip()
        )
    if card.size is not None:
        origin = size_origin(card.metres_per_unit_source)
        fix = "; fix it with --height" if origin.kind == "assumed" else ""
        screen.say(f"size:   {card.size[2]:.2f} m high; scale {origin}{fix}")
    screen.say(f"asset:  {asset.folder}")
    verdict = card.checks["executability"]
    if verdict["passed"]:
        screen.say("check:  passes" if verdict["driven"] else "check:  passes, without a simulator")
    else:
        reasons = ", ".join(verdict["reasons"])
        screen.say(f"check:  FAILS ({reasons}); see: mam-sim check {asset.folder}")
