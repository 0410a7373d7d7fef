"""What the network of parts is trained on."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from mam_training.articulation.batches import Batch


def loss_of(
    batch: Batch, move: Tensor, same: Tensor, motion: Tensor
) -> tuple[Tensor, dict[str, Tensor]]:
    """The sum of the losses, and each by name."""
    there = ~batch.hidden
    weight = batch.weight * there
    logistic = functional.binary_cross_entropy_with_logits
    moves = (logistic(move, batch.moves, reduction="none") * weight).sum(1) / weight.sum(1)
    link = batch.link
    truth = (link[:, :, None] == link[:, None]).float()
    pair = torch.sqrt(weight[:, :, None] * weight[:, None] + 1e-9)
    moving = batch.moves
    either = torch.maximum(moving[:, :, None], moving[:, None])
    pair = pair * (0.05 + 0.95 * either) * there[:, :, None] * there[:, None]
    pair = pair * (1 - torch.eye(pair.shape[1], device=pair.device))
    each = (logistic(same, truth, reduction="none") * pair).sum((1, 2)) / pair.sum((1, 2)).clamp(
        min=1e-6
    )
    known = (batch.subtype >= 0).float() * weight
    total = known.sum().clamp(min=1e-6)
    kind = functional.cross_entropy(
        motion[..., :3].flatten(0, 1), batch.subtype.clamp(min=0).flatten(), reduction="none"
    )
    kind = (kind.view_as(known) * known).sum() / total
    axis = functional.normalize(motion[..., 3:6], dim=-1)
    along = 1 - (axis * batch.axis).sum(-1).abs()
    along = (along * known).sum() / total
    middle = (batch.geometry[..., 0:3] + batch.geometry[..., 3:6]) / 2
    rotary = known * (batch.subtype < 2).float()
    away = middle + motion[..., 6:9] - batch.origin
    away = away - (away * batch.axis).sum(-1, keepdim=True) * batch.axis
    far = functional.smooth_l1_loss(away, torch.zeros_like(away), beta=0.05, reduction="none").sum(
        -1
    )
    line = (far * rotary).sum() / rotary.sum().clamp(min=1e-6)
    parts = {"move": moves.mean(), "same": each.mean(), "kind": kind, "axis": along, "line": line}
    out = parts["move"] + 2 * parts["same"] + 0.3 * kind + 0.5 * along + 2 * line
    return out, {k: v.detach() for k, v in parts.items()}
