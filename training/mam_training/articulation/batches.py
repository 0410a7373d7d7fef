"""Padded batches of a corpus: turned and mirrored, with what is known left out at random."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from mam_training.articulation.corpus import MOST_COUNTED, STEP, Corpus


@dataclass(frozen=True)
class Draw:
    """How an object is changed each time it is seen, and how often what is known is told.

    Attributes:
        object_word, part_words, count: chances that these are told. named: share of the parts whose
            words are told. lies: share of the objects whose words go to the wrong parts, or are
            another object's.
        blind: chance that the columns of the kinematic prior are left out. left_out: of any column.
        noise: of normalised features. area: power of the area that weighs a primitive.
        missing: chance that some primitives are missing; a tenth of them then is.
    """

    object_word: float = 0.4
    part_words: float = 0.3
    count: float = 0.15
    named: float = 0.85
    lies: float = 0.3
    blind: float = 0.1
    left_out: float = 0.12
    noise: float = 0.05
    area: float = 0.5
    missing: float = 0.3


DRAW = Draw()
NOTHING = Draw(0.0, 0.0, 0.0, lies=0.0, blind=0.0, left_out=0.0, noise=0.0, missing=0.0)
WORD = Draw(1.0, 0.0, 0.0, lies=0.0, blind=0.0, left_out=0.0, noise=0.0, missing=0.0)
COUNT = Draw(1.0, 0.0, 1.0, lies=0.0, blind=0.0, left_out=0.0, noise=0.0, missing=0.0)
NAMED = Draw(0.0, 1.0, 0.0, 1.0, lies=0.0, blind=0.0, left_out=0.0, noise=0.0, missing=0.0)


@dataclass
class Batch:
    """Padded objects and their truth; see `PartNetwork.forward` and `Corpus`."""

    unary: Tensor
    geometry: Tensor
    pair: Tensor
    hidden: Tensor
    object_word: Tensor
    part_word: Tensor
    count: Tensor
    fused: Tensor
    link: Tensor
    moves: Tensor
    weight: Tensor
    subtype: Tensor
    axis: Tensor
    origin: Tensor

    @property
    def inputs(self) -> tuple[Tensor, ...]:
        """What the network sees."""
        return (self.unary, self.geometry, self.pair, self.hidden, self.object_word,
                self.part_word, self.count, self.fused)  # fmt: skip


def batch_of(
    corpus: Corpus, rows: Sequence[int] | NDArray[np.integer], rng: np.random.Generator, draw: Draw,
    prior: Sequence[Sequence[int]], turn: bool = True,
) -> Batch:  # fmt: skip
    """One padded batch.

    Args:
        rows: objects. prior: columns of primitives and of pairs that come from the kinematic prior.
        turn: by quarter turns about the upright, and mirrored.
    """
    device = corpus.unary.device
    generator = torch.Generator(device).manual_seed(int(rng.integers(2**62)))

    def chance(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator, device=device)

    picked = torch.as_tensor(np.asarray(rows), device=device)
    b = len(rows)
    first, number = corpus.first[picked], corpus.first[picked + 1] - corpus.first[picked]
    edge, pairs = corpus.edge[picked], corpus.edge[picked + 1] - corpus.edge[picked]
    n = int(number.max())
    place = torch.arange(n, device=device)
    there = place[None] < number[:, None]
    at = torch.where(there, first[:, None] + place, 0)
    if draw.missing:
        some = chance(b, 1) < draw.missing
        kept = ~(some & (chance(b, n) < 0.1)) & there
        there = torch.where(kept.any(1, keepdim=True), kept, there)
    full, drop = there[..., None].float(), draw.left_out > 0
    u, g = corpus.unary.shape[1], corpus.pair.shape[1]
    unary = corpus.unary[at].float() * STEP
    owner = torch.repeat_interleave(torch.arange(b, device=device), pairs)
    inside = torch.arange(len(owner), device=device) - (pairs.cumsum(0) - pairs)[owner]
    row = edge[owner] + inside
    y = corpus.pair[row].float() * STEP
    if draw.noise:
        unary = unary + draw.noise * torch.randn(unary.shape, generator=generator, device=device)
        y = y + draw.noise * torch.randn(y.shape, generator=generator, device=device)
    blind = chance(b) < draw.blind
    keep_u, keep_g = torch.ones(b, u, device=device), torch.ones(b, g, device=device)
    if drop:
        keep_u, keep_g = (
            (chance(b, u) >= draw.left_out).float(),
            (chance(b, g) >= draw.left_out).float(),
        )
    for keep, columns in ((keep_u, prior[0]), (keep_g, prior[1])):
        if len(columns):
            keep[:, list(columns)] *= (~blind)[:, None].float()
    unary = unary * keep_u[:, None] * full
    y = torch.cat([y * keep_g[owner], torch.ones(len(y), 1, device=device)], 1)
    i, j = corpus.ends[row].long().unbind(1)
    pair = torch.zeros(b, n, n, g + 1, device=device)
    pair[owner, i, j], pair[owner, j, i] = y, y
    pair = pair * (there[:, :, None] & there[:, None])[..., None]
    m = symmetries(b, rng, turn).to(device)
    geometry = turned(corpus.geometry[at].float(), m) * full
    link = torch.where(there, corpus.link[at].long(), -1)
    subtype = torch.where(there, corpus.subtype[at].long(), -1)
    area = corpus.area[at] * there
    share = area / area.amax(1, keepdim=True).clamp(min=1e-9)
    weight = corpus.weight[at].float() * (share**draw.area + 0.1) * there
    weight = weight * there.sum(1, keepdim=True) / weight.sum(1, keepdim=True).clamp(min=1e-9)
    word, part = told(corpus, picked, at, there, link, draw, chance)
    count = torch.where(
        chance(b) < draw.count, 1 + corpus.movable[picked].clamp(max=MOST_COUNTED), 0
    )
    return Batch(
        unary, geometry, pair, ~there, word, part, count, corpus.fused[picked], link,
        (subtype >= 0).float(), weight, subtype, (corpus.axis[at].float() @ m.mT) * full,
        (corpus.origin[at].float() @ m.mT) * full,
    )  # fmt: skip


def told(corpus: Corpus, picked: Tensor, at: Tensor, there: Tensor, link: Tensor, draw: Draw,
         chance) -> tuple[Tensor, Tensor]:  # type: ignore[no-untyped-def]  # fmt: skip
    """(B,) words of the objects and (B, N) of their parts, as far as they are told."""
    b, device = len(picked), link.device
    lied = chance(b) < draw.lies
    word = torch.where(chance(b) < draw.object_word, corpus.word[picked], 0)
    strange = torch.where(lied & (chance(b) < 0.3), word.roll(1), word)
    links = int(corpus.links[picked].max())
    kinds = torch.zeros(b, links, dtype=torch.long, device=device)
    kinds.scatter_(1, link.clamp(min=0), torch.where(there, corpus.kind[at].long(), 0))
    kinds = torch.where(chance(b, links) < draw.named, kinds, 0)
    exists = torch.arange(links, device=device)[None] < corpus.links[picked][:, None]
    order = torch.where(exists, chance(b, links), 2.0).argsort(1)
    kinds = torch.where(lied[:, None], kinds.gather(1, order), kinds)
    kinds = kinds * (chance(b, 1) < draw.part_words)
    return strange, kinds.gather(1, link.clamp(min=0)) * there


def symmetries(b: int, rng: np.random.Generator, turn: bool) -> Tensor:
    """(B, 3, 3) quarter turns about the upright, half of them mirrored."""
    out = np.tile(np.eye(3, dtype=np.float32), (b, 1, 1))
    if turn:
        c, s = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])[rng.integers(4, size=b)].T
        out[:, 0, 0], out[:, 0, 1], out[:, 1, 0], out[:, 1, 1] = c, -s, s, c
        out[:, :, 0] *= np.where(rng.random(b) < 0.5, -1, 1)[:, None]
    return torch.from_numpy(out)


def turned(g: Tensor, m: Tensor) -> Tensor:
    """Geometry (B, N, 21) after (B, 3, 3)."""
    low, high = g[..., 0:3] @ m.mT, g[..., 3:6] @ m.mT
    axes = g[..., 12:].unflatten(-1, (3, 3)) @ m.mT[:, None]
    return torch.cat([
        torch.minimum(low, high), torch.maximum(low, high), g[..., 6:9], g[..., 9:12] @ m.mT,
        axes.flatten(-2),
    ], -1)  # fmt: skip


def batches(
    sizes: NDArray, order: NDArray, rng: np.random.Generator, pairs: int, most: int
) -> Iterator[NDArray]:
    """Rows of objects of about equal size, at most `pairs` squared primitives together.

    Args:
        sizes: (N,) primitives of all. order: rows to be seen, in a random order.
        most: objects of a batch.
    """
    block = 40 * most
    out: list[NDArray] = []
    for start in range(0, len(order), block):
        some = order[start : start + block]
        some = some[np.argsort(sizes[some], kind="stable")]
        now = 0
        for end in range(1, len(some) + 1):
            if (
                end == len(some)
                or (end + 1 - now) * int(sizes[some[end]]) ** 2 > pairs
                or end - now >= most
            ):
                out.append(some[now:end])
                now = end
    for k in rng.permutation(len(out)):
        yield out[k]
