"""Generated objects made as loosely as many real files are modelled, for the reasoner's training.

Primitives of real files are told from generated ones by a classifier with an AUC of 0.97: their
pieces run into each other, fill less of their box, are thicker, or are missing. Joints follow their
links when these are stretched and moved, but are no longer exact: a leaf that grew thicker may have
its line inside. Limits are those of before.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mam_pipeline.geometry.sampling import unit
from mam_pipeline.types import FloatArray, Joint
from mam_world.object import WorldObject
from mam_world.static import Soup

OFTEN = 0.6  # of the objects have any one of these faults; pieces are lost half as often
STRETCH = 0.35  # log of the stretch along an axis, at most
STRENGTHS = (0.3, 0.6, 1.0)  # of all faults of one object
THICKER, GROWN, SUNK = 0.04, 0.02, 0.025  # of the diagonal: at most, at most, spread
FARTHEST = 0.08  # of the diagonal, that a link is moved along one axis
SMALLEST = 1e-5  # metres: thinner pieces are measured as if they had this thickness


def loosened(made: WorldObject, rng: np.random.Generator) -> WorldObject:
    """Stretched, with thicker panels, pieces grown into each other, sunk links and lost pieces.

    The joints are stretched and moved with their links.

    Every fault comes to some objects only, in a strength that they share. Every link keeps a piece.
    """
    soup = made.soup
    strength = float(rng.choice(STRENGTHS))
    stretch: FloatArray = np.ones(3)
    if rng.random() < OFTEN:
        stretch = np.exp(rng.uniform(-STRETCH, STRETCH, 3) * strength)
    points = soup.vertices * stretch
    unit = strength * float(np.linalg.norm(np.ptp(points, axis=0)))
    owner = np.zeros(len(points), dtype=int)
    owner[soup.faces] = soup.face_piece[:, None]
    low, high = _boxes(points, owner, len(soup.piece_link))
    middle, extent = (low + high) / 2, np.maximum(high - low, SMALLEST)
    scale, shift = np.ones_like(extent), np.zeros_like(extent)
    if rng.random() < OFTEN:
        _thicken(soup, extent, unit, scale, shift, rng)
    if rng.random() < OFTEN:
        hit = rng.random(len(extent)) < 0.4
        more = rng.uniform(0, GROWN, extent.shape) * unit * hit[:, None]
        scale *= 1 + np.minimum(more / extent, 0.3)
    sunk = np.zeros((len(made.articulation.links), 3))
    if rng.random() < OFTEN:
        for link in range(1, soup.piece_link.max() + 1):
            if rng.random() < OFTEN:
                step = np.clip(rng.normal() * SUNK * unit, *np.array([-1, 1]) * FARTHEST * unit)
                axis = rng.integers(3)
                shift[soup.piece_link == link, axis] += step
                sunk[link, axis] += step
    points = middle[owner] + (points - middle[owner]) * scale[owner] + shift[owner]
    floor = points[:, 2].min()
    points[:, 2] -= floor
    soup = replace(soup, vertices=points)
    if rng.random() < OFTEN / 2:
        soup = _with_lost_pieces(soup, rng)
    sunk[:, 2] -= floor
    joints = tuple(_moved(j, stretch, sunk[j.child]) for j in made.articulation.joints)
    return replace(made, soup=soup, articulation=replace(made.articulation, joints=joints))


def _moved(joint: Joint, stretch: FloatArray, shift: FloatArray) -> Joint:
    """A joint of a stretched and shifted link."""
    along = joint.axis * stretch
    ratio = float(np.linalg.norm(along)) if joint.type == "prismatic" else 1.0
    way = {k: getattr(joint, k) * ratio for k in ("lower", "upper", "closed", "open")}
    return replace(joint, axis=unit(along), origin=joint.origin * stretch + shift, **way)


def _boxes(points: FloatArray, owner: np.ndarray, count: int) -> tuple[FloatArray, FloatArray]:
    """(P, 3) corners of every piece's box; zero for pieces without vertices."""
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, owner, points)
    np.maximum.at(high, owner, points)
    empty = np.isinf(low[:, 0])
    low[empty] = high[empty] = 0.0
    return low, high


def _thicken(
    soup: Soup, extent: FloatArray, unit: float, scale: FloatArray, shift: FloatArray,
    rng: np.random.Generator,
) -> None:  # fmt: skip
    """Pieces thicker along their thinnest side, to both sides or one; those of a link alike."""
    links = soup.piece_link.max() + 1
    whole = rng.random(links) < 0.5
    amount = rng.uniform(0, THICKER, links) * unit
    for piece, link in enumerate(soup.piece_link):
        if whole[link] or rng.random() < 0.15:
            thin, middle = np.argsort(extent[piece])[:2]
            more = min(amount[link], 0.75 * extent[piece, middle])
            scale[piece, thin] *= 1 + more / extent[piece, thin]
            shift[piece, thin] += rng.choice([0.0, 0.0, 0.5, -0.5]) * more


def _with_lost_pieces(soup: Soup, rng: np.random.Generator) -> Soup:
    """Without one piece in ten; a link that would lose all of them keeps one."""
    keep = rng.random(len(soup.piece_link)) > 0.1
    for link in np.unique(soup.piece_link):
        own = np.unique(soup.face_piece[soup.face_link == link])
        if len(own) and not keep[own].any():
            keep[own[0]] = True
    return soup.keep(keep[soup.face_piece])
