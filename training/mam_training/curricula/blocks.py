"""Generated objects built of blocks, as authors of simulators' scenes build theirs.

A front is one box, a wheel one cylinder or ball, a bow handle the block around it. Links, joints
and what belongs to what stay as they are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mam_pipeline.geometry.fuse import enclosed_volume
from mam_pipeline.types import FloatArray
from mam_world import shapes
from mam_world.object import WorldObject
from mam_world.shapes import Shape

SHARES = (0.5, 0.9, 1.0)  # of an object's pieces that become blocks
WHOLE = 0.3  # of the objects have links that are one block each
LITTLE = 0.3  # of the object's diagonal: larger links are not made one block
ROUND = 0.12  # how far two extents of a round piece may differ
HOLLOW = 0.6  # share of its box: a piece of the base that fills less stays, or all would be inside
MOVES_HOLLOW = 0.5  # how often such a piece of a moving link becomes a block all the same


def of_blocks(made: WorldObject, rng: np.random.Generator) -> WorldObject:
    """With its pieces replaced by the boxes, cylinders and balls around them."""
    soup = made.soup
    share, whole = float(rng.choice(SHARES)), bool(rng.random() < WHOLE)
    diagonal = float(np.linalg.norm(np.ptp(soup.vertices, axis=0)))
    blocks: set[int] = set()  # links that are one block each
    for link in range(1, len(soup.link_poses)) if whole else ():
        own = np.unique(soup.faces[soup.face_link == link])
        span = np.ptp(_local(soup.vertices[own], soup.link_poses[link]), axis=0) if len(own) else 0
        if np.linalg.norm(span) < LITTLE * diagonal and rng.random() < share:
            blocks.add(link)
    vertices, uv, faces, owner = [], [], [], []
    is_box, total, done = np.array(soup.piece_is_box), 0, set()
    for piece in np.unique(soup.face_piece):
        link = int(soup.piece_link[piece])
        if link in done:
            continue
        pose, single = soup.link_poses[link], link in blocks
        own = soup.faces[(soup.face_link == link) if single else (soup.face_piece == piece)]
        used, index = np.unique(own, return_inverse=True)
        shape = Shape(soup.vertices[used], index.reshape(-1, 3), soup.uv[used])
        if single or (not is_box[piece] and rng.random() < share):
            local = _local(shape.vertices, pose)
            inside = abs(enclosed_volume(local - local.mean(axis=0), shape.faces))
            fills = inside / max(float(np.ptp(local, axis=0).prod()), 1e-18)
            if single or fills > HOLLOW or (link and rng.random() < MOVES_HOLLOW):
                block, is_box[piece] = _block(local, single, rng)
                moved = block.vertices @ pose[:3, :3].T + pose[:3, 3]
                shape = Shape(moved, block.faces, block.uv)
        if single:
            done.add(link)
        vertices.append(shape.vertices)
        uv.append(shape.uv)
        faces.append(shape.faces + total)
        owner.append(np.full(len(shape.faces), piece))
        total += len(shape.vertices)
    soup = replace(
        soup, vertices=np.concatenate(vertices), uv=np.concatenate(uv),
        faces=np.concatenate(faces), face_piece=np.concatenate(owner), piece_is_box=is_box,
    )  # fmt: skip
    return replace(made, soup=soup)


def _local(points: FloatArray, pose: FloatArray) -> FloatArray:
    """Points (n, 3) of the source's pose where they are when the link is closed."""
    return (points - pose[:3, 3]) @ pose[:3, :3]


def _block(points: FloatArray, plain: bool, rng: np.random.Generator) -> tuple[Shape, bool]:
    """The block around points (n, 3), and whether it is a box; a box if `plain`."""
    low, high = points.min(axis=0), points.max(axis=0)
    high = np.maximum(high, low + 1e-4)
    middle, size = (low + high) / 2, high - low
    unlike = [abs(np.log(size[(k + 1) % 3] / size[(k + 2) % 3])) for k in range(3)]
    axis = int(np.argmin(unlike))
    radius, half = float(np.delete(size, axis).max()) / 2, float(size[axis]) / 2
    reach = np.linalg.norm(np.delete(points - middle, axis, axis=1), axis=1).max()
    is_round = len(points) > 8 and unlike[axis] < ROUND and reach < (1 + ROUND) * radius
    if plain or not is_round or rng.random() < 0.15:
        return shapes.box(low, high), True
    segments = int(rng.choice((8, 12, 16, 24, 32)))
    if max(unlike) < ROUND and rng.random() < 0.5:
        turn = np.linspace(-np.pi / 2, np.pi / 2, segments // 2 + 1)
        outline = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    else:
        outline = np.array([[0, -half], [radius, -half], [radius, half], [0, half]])
    out = shapes.revolve(outline, segments)
    frame = shapes.frame(middle, np.eye(3)[axis], np.eye(3)[axis - 1])
    return Shape(out.vertices @ frame[:3, :3].T + frame[:3, 3], out.faces, out.uv), False
