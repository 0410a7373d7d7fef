"""The check has the last word on a joint: what it stops is changed, and said so.

A way that meets something is cut, and a joint that physics stops all the same is put to sleep where
others move.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np

from mam_pipeline.asset.card import Asset
from mam_pipeline.check import check_asset
from mam_pipeline.check.asleep import put_to_sleep
from mam_pipeline.check.model import CheckModel
from mam_pipeline.check.report import REASONS, CheckReport, JointReport
from mam_pipeline.check.sweep import share_in_guide
from mam_pipeline.dormant import ALL
from mam_pipeline.types import Articulation, Joint

ROUNDS = 3
KEPT, CUT = 0.95, 0.75
"""Share that is kept of the way that was driven, and of that to where a part is deepest in another:
where it enters is not known."""
LEAST = 0.1
"""A way cut to less than this share is not worth it: the joint stays as it was found."""

OF_THE_LINE = {"off_axis", "askew", "exchanged"}
"""Reasons that doubt the line of a joint, which may be driven well: it is not put to sleep."""

Write = Callable[[Articulation], Asset]
Found = tuple[Articulation, list[str]]


def written_and_checked(
    articulation: Articulation,
    write: Write,
    correct: bool = True,
    on_check: Callable[[], None] = lambda: None,
    accepted: Collection[str] = (),
) -> tuple[Asset, Articulation]:
    """Write an asset, check it, and correct the joints that the check stops.

    The search for limits and the check look at the same meshes, the simulator at their convex
    pieces: a drawer that runs freely into the last centimetre of its mesh may be wedged there.

    Args:
        articulation: as the engine left it.
        write: makes the asset folder; it is called again after every change.
        correct: whether joints may be changed (those of a user's own URDF may not).
        on_check: told when the first check begins.
        accepted: names of parts that stay awake, or `ALL`.

    Returns:
        The asset as written last, whose card holds the verdict, and what was changed among its
        notes; and what it was written from.
    """
    began = time.perf_counter()
    asset = write(articulation)
    seconds = {"asset": round(time.perf_counter() - began, 3)}
    on_check()
    began = time.perf_counter()
    report = check_asset(asset.folder)
    notes: list[str] = []
    for _ in range(ROUNDS if correct and not report.passed else 0):
        articulation, more = _shortened(articulation, report, asset)
        if not more:
            break
        notes += more
        asset = write(articulation)
        report = check_asset(asset.folder)
        if report.passed:
            break
    if correct and not report.passed:
        rest, more = _asleep(articulation, report, accepted)
        if more:
            asset = write(rest)
            again = check_asset(asset.folder)
            if again.passed:
                articulation, report, notes = rest, again, notes + more
            else:
                asset = write(articulation)
    notes += [f.message for f in report.findings if f.code == "not_driven"]
    seconds["check"] = round(time.perf_counter() - began, 3)
    card = replace(
        asset.card,
        notes=[*asset.card.notes, *notes],
        checks={"executability": report.for_card()},
        seconds={**asset.card.seconds, **seconds},
    )
    card.save(asset.folder)
    return replace(asset, card=card), articulation


def _asleep(articulation: Articulation, report: CheckReport, accepted: Collection[str]) -> Found:
    """The joints that physics stops are dormant; as it was where none would be left, or a person
    said that one of them moves."""
    why = {
        r.name: f"the check stops it: {'; '.join(REASONS.get(k, k) for k in r.reasons)}"
        for r in report.joints if set(r.reasons) - OF_THE_LINE
    }  # fmt: skip
    parts = {j.name: articulation.links[j.child].name for j in articulation.joints}
    told = {j.name for j in articulation.joints if j.provenance == "user"}
    told |= {n for n, part in parts.items() if {n, part, ALL} & set(accepted)}
    why = {name: reason for name, reason in why.items() if name not in told and name in parts}
    rest = put_to_sleep(articulation, why)
    if not why or not rest.joints:
        return articulation, []
    return rest, [f"{name}: dormant, as {why[name]}" for name in why]


def _shortened(articulation: Articulation, report: CheckReport, asset: Asset) -> Found:
    found = {j.name: j for j in report.joints}
    out = any("detached" in j.reasons for j in report.joints)
    model = CheckModel.read(asset.urdf_path) if out else None
    joints, notes = [], []
    for joint in articulation.joints:
        own, before = found.get(joint.name), joint
        if own is not None and "penetration" in own.reasons:
            joint = _with_ends(joint)
        share = None if own is None else _free_share(joint, own, model)
        if share is None:
            joints.append(before)
            continue
        ends = {end: getattr(joint, end) * share for end in ("lower", "upper", "open", "closed")}
        joints.append(replace(joint, **ends, basis=joint.basis.cut(share)))
        notes.append(f"{joint.name}: way cut to {100 * share:.0f} %, where the check stops it")
    return replace(articulation, joints=tuple(joints)), notes


def _with_ends(joint: Joint) -> Joint:
    """A joint that turns without end as one that makes half a turn each way: something stops it,
    and only a range that has ends can be cut. A user's stays as it is."""
    if joint.type != "continuous" or _users(joint):
        return joint
    basis = replace(joint.basis, rule="collision", share=1.0)
    return replace(
        joint, type="revolute", lower=-np.pi, upper=np.pi, closed=0.0, open=np.pi, basis=basis
    )


def _users(joint: Joint) -> bool:
    """Whether a person said how far it goes."""
    return joint.basis.rule == "given" and joint.provenance == "user"


def _free_share(joint: Joint, report: JointReport, model: CheckModel | None) -> float | None:
    """Share of the way from rest (q = 0) that the check found free; None: nothing to cut.

    Args:
        model: as it was written, where a part leaves its guide.
    """
    if _users(joint):
        return None
    if not np.isfinite(joint.upper - joint.lower) or not joint.lower <= 0.0 <= joint.upper:
        return None
    if "penetration" in report.reasons and report.penetration_at:
        end = joint.upper if report.penetration_at > 0 else joint.lower
        share = CUT * abs(report.penetration_at / end) if end else 0.0
    elif "detached" in report.reasons and model is not None:
        share = share_in_guide(model, joint)
    elif {"frozen", "sags", "no_return"} & set(report.reasons) and report.reached is not None:
        share = KEPT * min(report.reached, 1.0)
    else:
        return None
    return share if LEAST <= share < 1.0 else None
