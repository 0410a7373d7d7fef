"""The network of parts.

Every primitive is a token and asks: do I move, which primitives move with me, how, about which
line, and along with which word. Attention over all primitives carries the features of their pairs
as biases; what is known beside geometry (the object's word, words and counts of parts) enters as
further embeddings, left out at random in training, so that one set of weights answers with and
without it.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional


@dataclass(frozen=True)
class Shape:
    """Sizes of the network."""

    unary: int
    pair: int
    objects: int
    parts: int
    width: int = 160
    edge: int = 24
    heads: int = 8
    layers: int = 5
    counts: int = 14
    dropout: float = 0.12


GEOMETRY = 3 + 3 + 3 + 3 + 9  # low, high, size, spin axis, axes
RELATIVE = 16


class Block(nn.Module):
    """Attention with pair biases, an update of the pairs, a feed-forward layer."""

    def __init__(self, s: Shape) -> None:
        super().__init__()
        d, e = s.width, s.edge
        self.heads = s.heads
        self.n1, self.n2, self.ne = nn.LayerNorm(d), nn.LayerNorm(d), nn.LayerNorm(e)
        self.qkv, self.out = nn.Linear(d, 3 * d), nn.Linear(d, d)
        self.bias, self.left, self.right = nn.Linear(e, s.heads), nn.Linear(d, e), nn.Linear(d, e)
        self.gather = nn.Linear(2 * e, d)
        self.pair = nn.Sequential(nn.Linear(2 * e, e), nn.GELU(), nn.Linear(e, e))
        self.feed = nn.Sequential(nn.Linear(d, 2 * d), nn.GELU(), nn.Linear(2 * d, d))
        self.drop = nn.Dropout(s.dropout)

    def forward(self, h: Tensor, z: Tensor, hidden: Tensor) -> tuple[Tensor, Tensor]:
        """Tokens (B, N, d), pairs (B, N, N, e), (B, N) true where there is nothing."""
        b, n, d = h.shape
        x, y = self.n1(h), self.ne(z)
        q, k, v = self.qkv(x).view(b, n, 3, self.heads, -1).permute(2, 0, 3, 1, 4)
        bias = self.bias(y).permute(0, 3, 1, 2)
        bias = bias.masked_fill(hidden[:, None, None, :], -1e4)
        mixed = functional.scaled_dot_product_attention(q, k, v, attn_mask=bias)
        mixed = mixed.transpose(1, 2).reshape(b, n, d)
        there = (~hidden)[:, None, :, None].to(y)
        mean = (y * there).sum(2) / there.sum(2).clamp(min=1)
        most = (y - (1 - there) * 1e4).amax(2).clamp(min=-20)
        h = h + self.drop(self.out(mixed) + self.gather(torch.cat([mean, most], -1)))
        x = self.n1(h)
        both = self.left(x)[:, :, None] * self.right(x)[:, None]
        z = z + self.drop(self.pair(torch.cat([y, both + both.transpose(1, 2)], -1)))
        return h + self.drop(self.feed(self.n2(h))), z


class PartNetwork(nn.Module):
    """See the module."""

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        self.shape = s = shape
        d, e = s.width, s.edge
        self.enter = nn.Sequential(nn.Linear(s.unary + GEOMETRY, d), nn.GELU(), nn.Linear(d, d))
        self.link = nn.Sequential(
            nn.Linear(s.pair + RELATIVE + 1, 2 * e), nn.GELU(), nn.Linear(2 * e, e)
        )
        self.object = nn.Embedding(s.objects, d)
        self.part = nn.Embedding(s.parts, d)
        self.count = nn.Embedding(s.counts, d)
        self.fused = nn.Embedding(2, d)
        self.blocks = nn.ModuleList([Block(s) for _ in range(s.layers)])
        self.last, self.laste = nn.LayerNorm(d), nn.LayerNorm(e)
        self.move = nn.Sequential(nn.Linear(2 * d, d), nn.GELU(), nn.Linear(d, 1))
        self.motion = nn.Sequential(nn.Linear(2 * d, d), nn.GELU(), nn.Linear(d, 3 + 9))
        self.a, self.b = nn.Linear(d, 2 * e), nn.Linear(d, 2 * e)
        self.same = nn.Sequential(nn.Linear(3 * e, 2 * e), nn.GELU(), nn.Linear(2 * e, 1))

    def forward(
        self, unary: Tensor, geometry: Tensor, pair: Tensor, hidden: Tensor, object_word: Tensor,
        part_word: Tensor, count: Tensor, fused: Tensor,
    ) -> tuple[Tensor, Tensor, Tensor]:  # fmt: skip
        """Logits of moving (B, N), of being one body (B, N, N), and motions (B, N, 12).

        A motion: three logits of the types, an axis, a point of the hinge line and one of a spin's,
        relative to the primitive's centre.

        Args:
            unary: (B, N, U) normalised. geometry: (B, N, 21). pair: (B, N, N, G + 1).
        """
        h = self.enter(torch.cat([unary, geometry], -1))
        whole = self.object(object_word) + self.count(count) + self.fused(fused)
        h = h + whole[:, None] + self.part(part_word)
        z = self.link(torch.cat([pair, relative(geometry)], -1))
        for block in self.blocks:
            h, z = block(h, z, hidden)
        h, z = self.last(h), self.laste(z)
        there = (~hidden)[..., None].to(h)
        mean = (h * there).sum(1, keepdim=True) / there.sum(1, keepdim=True).clamp(min=1)
        wide = torch.cat([h, mean.expand_as(h)], -1)
        cross = self.a(h)[:, :, None] * self.b(h)[:, None]
        cross = cross + cross.transpose(1, 2)
        same = self.same(torch.cat([z, cross], -1))[..., 0]
        same = (same + same.transpose(1, 2)) / 2
        return self.move(wide)[..., 0], same, self.motion(wide)


def relative(g: Tensor) -> Tensor:
    """(B, N, N, RELATIVE) how every two boxes lie to each other."""
    low, high, size, spin = g[..., 0:3], g[..., 3:6], g[..., 6:9], g[..., 9:12]
    middle, extent = (low + high) / 2, (high - low).clamp(min=1e-3)
    offset = middle[:, None] - middle[:, :, None]
    a, b = extent[:, :, None], extent[:, None]
    overlap = torch.minimum(high[:, :, None], high[:, None]) - torch.maximum(
        low[:, :, None], low[:, None]
    )
    share = (overlap / torch.minimum(a.expand_as(overlap), b.expand_as(overlap))).clamp(-1, 1)
    ratio = (size[:, :, None].clamp(min=5e-3) / size[:, None].clamp(min=5e-3)).log()
    coaxial = (spin[:, :, None] * spin[:, None]).sum(-1, keepdim=True).abs()
    across = offset - (offset * spin[:, :, None]).sum(-1, keepdim=True) * spin[:, :, None]
    lateral = across.norm(dim=-1, keepdim=True)
    flush = torch.minimum(
        (low[:, :, None] - low[:, None]).abs(), (high[:, :, None] - high[:, None]).abs()
    )
    like = ratio.abs().amax(-1, keepdim=True)
    distance = (-overlap).clamp(min=0).norm(dim=-1, keepdim=True)
    return torch.cat([offset, share, ratio, coaxial, lateral, flush, like, distance], -1)
