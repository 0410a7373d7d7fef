"""The third question: is that how it moves? Pictures of every joint alone, and what physics found.

Each joint is shown closed, half open and open from two sides, with its line; beside it stands in
words how freely it goes, and where the line is in doubt, up to three others are shown by number.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from mam_pipeline.joints.estimate import ESTIMATE, same_joint
from mam_pipeline.models import album as albums
from mam_pipeline.models import questions
from mam_pipeline.models.answers import Lines, usual_range
from mam_pipeline.models.transports import Labelled, Question
from mam_pipeline.render import orbit_views as views
from mam_pipeline.render import pictures
from mam_pipeline.render.mesh_pictures import posed
from mam_pipeline.render.motion import value_at
from mam_pipeline.render.pictures import Picture
from mam_pipeline.types import (
    NEEDS_REVIEW,
    Articulation,
    FloatArray,
    Joint,
    JointCandidate,
    JointType,
    Mesh,
    joint_motion,
)

MOTIONS = {"prismatic": "slides", "revolute": "turns", "continuous": "turns"}


@dataclass(frozen=True)
class MotionPictures:
    """How joints are shown.

    Attributes:
        size: pixels a side of one picture of a sheet.
        a_sheet: joints on one sheet. few: of more joints than these, half as many are on one.
        blocked: share of the usual way below which what blocks it may be a flaw of the mesh, so
            that the usual range is offered (20 degrees of a door's quarter turn).
        first_look: pixels a side of the views among which the two that are shown are chosen.
        apart: degrees at least between those two.
        most: joints that are shown; of more, the first of each that move alike are shown.
        others: other lines that are shown where the line is in doubt.
        steps: radians of the two pictures after rest where a joint turns without end.
        over: share of the part's length by which its line is drawn longer.
        hidden: share of a part that must be seen, or else it shines through what hides it.
        through: how strongly it does.
    """

    size: int = 320
    a_sheet: int = 4
    few: int = 6
    blocked: float = 0.23
    first_look: int = 96
    apart: float = 50.0
    most: int = 24
    others: int = 3
    steps: tuple[float, float] = (np.pi / 4, np.pi / 2)
    over: float = 0.3
    hidden: float = 0.5
    through: float = 0.45


SHOW = MotionPictures()
BASE, OTHER, MOVING, CARRIED, LINE = (
    (205, 205, 205), (165, 185, 215), (240, 125, 30), (245, 215, 90), (215, 0, 190),
)  # fmt: skip


def motion_question(
    album: albums.Album, articulation: Articulation, lines: Mapping[str, Lines], name: str,
    ranges: Mapping[str, str],
) -> Question:  # fmt: skip
    """Ask whether the joints of an articulation move as they should.

    Args:
        lines: the other lines to show of a part, by its name. name: of the question.
        ranges: why a part has its range where it is not a measured one, by its name.
    """
    base, joints = articulation.links[0].name, moving_joints(articulation)
    told = [
        verdict(articulation, joint, len(lines.get(part, ())), ranges.get(part, ""))
        for joint in joints
        for part in [_part(articulation, joint)]
    ]
    text = questions.MOVED.format(
        base=base,
        lines=questions.OTHER_LINES if any(lines.values()) else "",
        words=questions.LINES,
        ranges=questions.RANGES,
        joints="\n".join(told),
    )
    subject = [articulation.face_link.tobytes().hex(), *(_in_words(j) for j in joints)]
    return Question(
        name,
        questions.SYSTEM,
        text,
        partial(_drawn, album, articulation, lines),
        questions.schema_of(questions.MotionCheck),
        subject=hashlib.sha256("|".join(subject).encode()).hexdigest()[:16],
    )


def moving_joints(articulation: Articulation) -> list[Joint]:
    """The joints that are shown."""
    return [j for j in articulation.joints if j.type != "fixed"]


def other_lines(lines: Lines, joint: Joint, diagonal: float) -> list[JointCandidate]:
    """Lines of any kind of motion, best measured first, that mean other joints than the chosen."""
    near = ESTIMATE.close * diagonal
    chosen = JointCandidate(joint.subtype, joint.axis, joint.origin)
    out: list[JointCandidate] = []
    for line in lines:
        if line.subtype == "fixed" or len(out) == SHOW.others:
            continue
        slides = line.subtype == "slide"
        known = [c for c in (chosen, *out) if (c.subtype == "slide") == slides]
        if not any(same_joint(line, c, near) for c in known):
            out.append(line)
    return out


def in_doubt(joint: Joint) -> bool:
    """Whether the joint's line deserves that others are shown."""
    chosen = joint.basis.rule in ("token", "collision") and joint.basis.share < 0.5
    return chosen or joint.confidence < NEEDS_REVIEW


def verdict(articulation: Articulation, joint: Joint, others: int = 0, why: str = "") -> str:
    """One line of what was made and what physics found of it.

    Args:
        others: how many other lines are shown. why: it has its range, if that was not measured.
    """
    name, parent = _part(articulation, joint), articulation.links[joint.parent].name
    slide = joint.type == "prismatic"
    letter = "xyz"[int(np.argmax(np.abs(joint.axis)))]
    skew = "" if np.abs(joint.axis).max() > 0.99 else "about "
    if joint.type == "continuous":
        how = "without end"
    elif slide:
        points = _points(articulation, articulation.carried_links(joint))
        scale = 100.0 / max(float(np.ptp(points @ joint.axis)), 1e-12)
        how = f"{joint.lower * scale:.0f}..{joint.upper * scale:.0f} % of its length"
    else:
        how = f"{np.degrees(joint.lower):.0f}..{np.degrees(joint.upper):.0f} degrees"
    rule = {
        "usual": "free over that way",
        "collision": "there it runs into something",
        "contact_loss": "beyond that it leaves its guide",
        "endless": "free all round",
        "token": "blocked from the start: it cannot move along this line",
        "given": why or "as you said",
    }.get(joint.basis.rule, "")
    if joint.basis.rule == "collision" and joint.basis.share < 0.95:
        rule += f", after {100 * joint.basis.share:.0f} % of the usual way"
    if joint.basis.rule in ("collision", "token") and joint.basis.share < SHOW.blocked:
        offer = _offer(articulation, joint)
        rule += f"; {offer} (usual: true takes it, if an overlap is a flaw)"
    where = f"along {skew}{letter}" if slide else f"about {skew}{letter}"
    found = [
        f"{name}, on {parent}: {MOTIONS[joint.type]} {where}, {how}",
        rule,
        "only after another part has moved" if joint.basis.after_another else "",
        f"other lines 1 to {others} are shown" if others else "",
    ]
    return "; ".join(part for part in found if part)


def _offer(articulation: Articulation, joint: Joint) -> str:
    """The usual range of such a part, in words."""
    link = articulation.links[joint.child]
    depth = float(np.ptp(_points(articulation, [joint.parent]) @ joint.axis))
    (lower, upper), why = usual_range(link.kind, link.name, joint.subtype, depth)
    return why if not np.isfinite(upper) else f"{why} it goes {_way(joint, upper - lower)}"


def _way(joint: Joint, value: float) -> str:
    """A value of a joint in degrees or centimetres."""
    slide = joint.type == "prismatic"
    return f"{100.0 * value:.3g} cm" if slide else f"{np.degrees(value):.0f} deg"


def motion_sheets(
    articulation: Articulation, joints: Sequence[Joint] | None = None
) -> list[Picture]:
    """Sheets of a few joints, each alone in three states from two sides."""
    chosen = moving_joints(articulation) if joints is None else joints
    blocks = [_block(articulation, joint) for joint in chosen]
    few = len(blocks) <= SHOW.few
    most = SHOW.a_sheet if few else SHOW.a_sheet // 2
    return [
        pictures.sheet(blocks[k : k + most], 2 if few and len(blocks) > 2 else 1)
        for k in range(0, len(blocks), most)
    ]


def _drawn(album: albums.Album, articulation: Articulation, lines: Mapping[str, Lines]) -> Labelled:
    shown = moving_joints(articulation)[: SHOW.most]
    out = [(f"motion_{k}", s) for k, s in enumerate(motion_sheets(articulation, shown))]
    doubtful = [
        _other_line(articulation, joint, line, k + 1)
        for joint in shown
        for k, line in enumerate(lines.get(_part(articulation, joint), ()))
    ]
    for k in range(0, len(doubtful), 12):
        out.append((f"lines_{k // 12}", pictures.sheet(doubtful[k : k + 12], 4)))
    return (*out, ("pieces", albums.numbered(album)))


def _part(articulation: Articulation, joint: Joint) -> str:
    return articulation.links[joint.child].name


def _in_words(joint: Joint) -> str:
    """The joint as roughly as a look tells: what a kept answer belongs to."""
    letter = int(np.argmax(np.abs(joint.axis)))
    ends = "endless"
    if joint.type == "revolute":
        ends = f"{np.degrees(joint.upper - joint.lower) / 30:.0f}"
    return f"{joint.name} {joint.type} {'xyz'[letter]} {ends}"


def _values(joint: Joint) -> list[float]:
    if joint.type == "continuous":
        return [0.0, *SHOW.steps]
    return [value_at(joint, share) for share in (0.0, 0.5, 1.0)]


def _points(articulation: Articulation, links: Sequence[int]) -> FloatArray:
    mesh = articulation.mesh
    faces = np.concatenate([articulation.links[i].faces for i in links])
    return mesh.vertices[np.unique(mesh.faces[faces])]


def _corners(mesh: Mesh) -> FloatArray:
    """(8, 3) of the bounding box."""
    low, high = mesh.bounds
    return np.stack(np.meshgrid(*zip(low, high)), axis=-1).reshape(-1, 3)


def _swept(points: FloatArray, joint: Joint, values: Sequence[float]) -> FloatArray:
    """(n, m, 3) the points at each of n values."""
    moves = [joint_motion(joint.type, joint.axis, joint.origin, v) for v in values]
    return np.stack([points @ m[:3, :3].T + m[:3, 3] for m in moves])


def _best_views(
    articulation: Articulation, joint: Joint, swept: FloatArray
) -> list[tuple[float, float]]:
    """Two directions from which the motion and the part are seen best, far from each other."""
    mesh = articulation.mesh
    moving = np.isin(articulation.face_link, articulation.carried_links(joint))
    moved = swept[-1] - swept[0]
    found = []
    for view in views.look(mesh, size=SHOW.first_look, tight=True):
        flat = moved @ view.camera_T_asset[:2, :3].T
        seen = float((view.ids(moving.astype(np.int64)) == 1).mean())
        found.append((float(np.linalg.norm(flat, axis=1).mean()), seen, view))
    most, widest = max(f[0] for f in found) or 1.0, max(f[1] for f in found) or 1.0
    score = [f[0] / most + 0.7 * f[1] / widest for f in found]
    order = np.argsort(score)[::-1]
    first = found[order[0]][2]
    away = np.cos(np.radians(SHOW.apart))
    second = next(
        found[k][2] for k in order
        if float(found[k][2].camera_T_asset[2, :3] @ first.camera_T_asset[2, :3]) < away
    )  # fmt: skip
    return [(v.azimuth, v.elevation) for v in (first, second)]


def _look(
    mesh: Mesh, directions: Sequence[tuple[float, float]], around: FloatArray,
    only: NDArray[np.bool_] | None = None,
) -> list[views.View]:  # fmt: skip
    return views.look(mesh, directions, SHOW.size, tight=True, around=around, only=only)


def _through(
    picture: Picture, view: views.View, alone: views.View, moving: NDArray[np.bool_]
) -> Picture:
    """The picture with a part that is hardly seen shining through what hides it.

    Args:
        alone: the same view of nothing but the part. moving: (F,) its faces.
    """
    whole = alone.faces >= 0
    seen = view.ids(moving.astype(np.int64)) == 1
    if seen.sum() >= SHOW.hidden * whole.sum():
        return picture
    out, behind = picture.astype(np.float64), whole & ~seen
    color = np.array(MOVING) * (0.55 + 0.45 * alone.shade[..., None])
    out[behind] += SHOW.through * (color - out)[behind]
    return out.astype(np.uint8)


def _colors(articulation: Articulation, joint: Joint) -> Picture:
    colors = np.tile(np.array(OTHER, np.uint8), (len(articulation.links), 1))
    colors[0] = BASE
    colors[articulation.carried_links(joint)] = CARRIED
    colors[joint.child] = MOVING
    return colors


def _block(articulation: Articulation, joint: Joint) -> Picture:
    """Two rows of three pictures of one joint, its name above."""
    values, name = _values(joint), _part(articulation, joint)
    carried = articulation.carried_links(joint)
    swept = _swept(_points(articulation, carried), joint, values)
    around = np.concatenate([_corners(articulation.mesh), *swept])
    directions = _best_views(articulation, joint, swept)
    colors, label = _colors(articulation, joint), articulation.face_link
    moving, columns = np.isin(label, carried), []
    states = ("at rest", "turned", "turned")
    if joint.type != "continuous":
        states = ("closed", "half", "open")
    ends = _line_ends(joint.axis, joint.origin, joint.type == "prismatic", swept[0])
    for value, state in zip(values, states):
        mesh = posed(articulation, {joint.name: value})
        column = []
        looks = _look(mesh, directions, around), _look(mesh, directions, around, moving)
        for k, (view, alone) in enumerate(zip(*looks)):
            picture = _through(pictures.paint(view, label, colors), view, alone, moving)
            where = albums.direction_name(view.azimuth, view.elevation)
            text = f"{name}: {state}, {_way(joint, value)}" if k == 0 else where
            column.append(_annotated(picture, view, ends, text))
        columns.append(np.concatenate(column))
    out = np.concatenate(columns, axis=1)
    out[[0, -1]] = 0
    out[:, [0, -1]] = 0
    return out


def _other_line(
    articulation: Articulation, joint: Joint, line: JointCandidate, number: int
) -> Picture:
    """One picture of the part half open about another line."""
    slide = line.subtype == "slide"
    kind: JointType = "prismatic" if slide else "revolute"
    points = _points(articulation, articulation.carried_links(joint))
    way = 0.5 * float(np.ptp(points @ line.axis)) if slide else float(np.pi / 4)
    other = replace(
        joint, type=kind, subtype=line.subtype, axis=line.axis, origin=line.origin,
        lower=0.0, upper=way, closed=0.0, open=way,
    )  # fmt: skip
    joints = tuple(other if j is joint else j for j in articulation.joints)
    changed = replace(articulation, joints=joints)
    swept = _swept(points, other, (0.0, way))
    direction = _best_views(changed, other, swept)[0]
    mesh = posed(changed, {joint.name: way})
    around = np.concatenate([_corners(articulation.mesh), *swept])
    view = _look(mesh, [direction], around)[0]
    picture = pictures.paint(view, articulation.face_link, _colors(articulation, joint))
    ends = _line_ends(line.axis, line.origin, slide, points)
    text = f"{_part(articulation, joint)}, line {number}: {line.subtype}"
    return _annotated(picture, view, ends, text)


def _line_ends(
    axis: FloatArray, origin: FloatArray, slide: bool, points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Where the drawn line begins and ends; of a slide through the middle of the part."""
    middle = points.mean(axis=0) if slide else origin
    along = (points - middle) @ axis
    more = SHOW.over * max(float(np.ptp(along)), 0.2 * float(np.ptp(points, axis=0).max()))
    return middle + (along.min() - more) * axis, middle + (along.max() + more) * axis


def _annotated(
    picture: Picture, view: views.View, ends: tuple[FloatArray, FloatArray], text: str
) -> Picture:
    """With the joint's line, an arrow at its positive end, and a caption."""
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    a, b = view.pixels(np.stack(ends))
    draw.line([tuple(a), tuple(b)], fill=LINE, width=3)
    way = b - a
    if np.linalg.norm(way) > 8.0:
        way = way / np.linalg.norm(way) * 9.0
        across = np.array([-way[1], way[0]]) * 0.6
        draw.polygon([tuple(b + way), tuple(b + across), tuple(b - across)], fill=LINE)
    else:
        draw.ellipse([*(a - 6), *(a + 6)], outline=LINE, width=3)
    pictures.caption(draw, text, len(picture))
    return np.asarray(image)
