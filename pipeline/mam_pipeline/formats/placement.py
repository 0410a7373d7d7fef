"""Which way is up and how long a unit is: what is stated, then the shape, then the usual size.

Every decision says why it was made, what else it might have been, and how sure it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mam_pipeline.types import FloatArray, Mesh

UNITS: Mapping[str, float] = {
    "metres": 1.0, "centimetres": 0.01, "millimetres": 0.001, "inches": 0.0254,
}  # fmt: skip

TURNS: Mapping[str, tuple[tuple[int, int, int], ...]] = {
    "x": ((0, 0, -1), (0, 1, 0), (1, 0, 0)), "-x": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
    "y": ((1, 0, 0), (0, 0, -1), (0, 1, 0)), "-y": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "z": ((1, 0, 0), (0, 1, 0), (0, 0, 1)), "-z": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
}  # fmt: skip
"""Rotation that brings an axis of the file to +Z."""


@dataclass(frozen=True)
class PlacementThresholds:
    """What is believed of sizes and axes.

    Attributes:
        believed: largest extent, metres, up to and from which a stated unit is believed.
        usual: largest extent of things that a robot works with, where nobody knows more; metres.
        spread, known_spread: standard deviation of the logarithm of sizes about that, and about
            the size of a kind of object that is known.
        strange: factor from the usual size of its kind beyond which a size is doubted aloud.
        beyond: factor above the largest size of its kind from which no such thing is that large,
            and the stated unit is not believed.
        stands: difference of two axes' standing from which the shape decides.
        plain: log odds of each of UNITS where the file's format says none. cad: the same for STL,
            which comes from CAD.
    """

    believed: tuple[float, float] = (0.002, 50.0)
    usual: float = 0.7
    spread: float = 1.2
    known_spread: float = 0.7
    strange: float = 3.0
    beyond: float = 1.3
    stands: float = 0.25
    plain: tuple[float, ...] = (1.0, 0.0, 0.0, -0.5)
    cad: tuple[float, ...] = (0.0, -1.5, 3.0, -2.0)


PLACEMENT = PlacementThresholds()
READ, SAID = "read from the file", "said by you"


@dataclass(frozen=True)
class Decision:
    """One decision on how an object stands.

    Attributes:
        about: up, unit or front. chosen: in a word. why: who says so; it begins with the kind of
            `asset/origins.py`: read, said, inferred or assumed.
        runner_up: what else it might be; "" where nothing else is likely. confidence: 0..1.
    """

    about: str
    chosen: str
    why: str
    runner_up: str = ""
    confidence: float = 1.0

    def told(self) -> str:
        """One line for the screen and the card."""
        else_ = f", else {self.runner_up}" if self.runner_up else ""
        inferred = self.why.startswith("inferred")
        sure = f", {min(round(100 * self.confidence), 99)} % sure" if inferred else ""
        return f"{self.about}: {self.chosen} ({self.why}{sure}{else_})"


def choose_up(
    mesh: Mesh, stated: str | None, wanted: str, suffix: str
) -> tuple[FloatArray, Decision]:
    """(3, 3) rotation that brings the file's up axis to Z, and the decision.

    Args:
        stated: "y" or "z" where format or file says it. wanted: the user's axis of the file, as in
            `TURNS`, or "auto".
    """
    scores = {a: stands(mesh, i) for a, i in (("y", 1), ("z", 2))}
    shape = max(scores, key=lambda a: scores[a])
    clear = abs(scores["y"] - scores["z"])
    if wanted in TURNS:
        axis, decision = wanted, Decision("up", wanted, SAID)
    elif stated is not None:
        axis = stated
        doubt = shape != stated and clear > 1.0
        other = f"{shape}, on which it stands better; --up {shape}" if doubt else ""
        decision = Decision("up", axis, READ, other, 0.75 if doubt else 0.97)
    elif clear > PLACEMENT.stands:
        axis, other = shape, "yz".replace(shape, "")
        why = f"assumed: it stands {scores['y']:.2f} well on y, {scores['z']:.2f} on z"
        decision = Decision("up", axis, why, f"{other}; --up {other}", min(0.6 + 0.3 * clear, 0.95))
    else:
        axis = "y" if suffix in (".obj", ".fbx") else "z"
        other = "yz".replace(axis, "")
        why = f"assumed: usual for {suffix[1:].upper()} files"
        decision = Decision("up", axis, why, f"{other}; --up {other}", 0.6)
    return np.array(TURNS[axis], dtype=np.float64), decision


def stands(mesh: Mesh, axis: int) -> float:
    """How well the mesh stands when `axis` is up: floor at zero, wide flat support, 0..2.

    A floor at coordinate 0 with the other axes centred is how people place furniture; support is
    the share of the footprint spanned by the lowest 1 % of the height.
    """
    low, high = mesh.bounds
    extent = high - low
    others = [i for i in range(3) if i != axis]
    floor = abs(low[axis]) < 0.01 * extent[axis]
    centred = all(abs(low[i] + high[i]) < 0.1 * extent[i] for i in others)
    points = mesh.vertices[mesh.faces.reshape(-1)]
    feet = points[points[:, axis] < low[axis] + 0.01 * extent[axis]][:, others]
    span = (feet.max(axis=0) - feet.min(axis=0)) / np.maximum(extent[others], 1e-12)
    return float(floor and centred) + float(np.prod(span))


def choose_unit(
    extent: FloatArray, stated: float | None, height: float | None, scale: float | None,
    suffix: str, sizes: tuple[float, float, float] | None = None,
) -> tuple[float, str, Decision]:  # fmt: skip
    """Metres per unit of the file, where it came from, and the decision.

    Args:
        extent: (3,) of the file's mesh, Z up, its own unit. stated: by format or file.
        sizes: lowest, usual and highest largest extent of such an object, metres, where its kind
            is known.
    """
    if scale is not None:
        return _settled(float(scale))
    if height is not None:
        return _settled(float(height) / float(extent[2]))
    size = float(extent.max())
    low, high = PLACEMENT.believed
    usual = None if sizes is None else sizes[1]
    odds = _odds(size, suffix, usual)
    if stated is not None and sizes is not None and size * stated > PLACEMENT.beyond * sizes[2]:
        return _corrected(size, stated, sizes)
    if stated is not None and low <= size * stated <= high:
        best = max(odds, key=lambda n: odds[n]) if odds else ""
        off = abs(np.log(size * stated / usual)) if usual is not None else 0.0
        doubt = off > np.log(PLACEMENT.strange) and bool(best)
        other = f"{best}, {size * UNITS[best]:.2g} m; --scale {UNITS[best]:g}" if doubt else ""
        if doubt and usual is not None and UNITS[best] == stated:
            other = f"such things are usually {usual:.2g} m; --height settles it"
        chosen = f"{stated:g} m, longest side {size * stated:.3g} m"
        return stated, READ, Decision("unit", chosen, READ, other, 0.6 if doubt else 0.97)
    if not odds:
        unit = (usual or PLACEMENT.usual) / size
        largest = usual or PLACEMENT.usual
        why = (
            f"assumed: {size:.4g} units fit no common unit, so the largest side is {largest:.2g} m"
        )
        chosen = f"{unit:.3g} m, longest side {largest:.2g} m"
        return unit, why, Decision("unit", chosen, why, "any; --height settles it", 0.2)
    ranked = sorted(odds, key=lambda n: -odds[n])
    share = np.exp([odds[n] - odds[ranked[0]] for n in ranked])
    name, unit = ranked[0], UNITS[ranked[0]]
    kind = "as such things have" if usual is not None else "the size is plausible"
    why = f"assumed: {name}, for {size:.4g} units would be {size * unit:.2f} m, {kind}"
    other = ""
    if len(ranked) > 1 and share[1] > 0.05 * share.sum():
        second = ranked[1]
        other = f"{second}, {size * UNITS[second]:.2g} m; --scale {UNITS[second]:g}"
    chosen = f"{name}, longest side {size * unit:.3g} m"
    confidence = float(0.9 * share[0] / share.sum())
    return unit, why, Decision("unit", chosen, why, other, confidence)


def _corrected(
    size: float, stated: float, sizes: tuple[float, float, float]
) -> tuple[float, str, Decision]:
    """The unit of a thing that is stated to be larger than any of its kind.

    One of UNITS, taken for metres, where it explains the size; else the usual size. What is stated
    to be too small stays so: it may be a toy or a model.
    """
    fitting = {n: u for n, u in UNITS.items() if sizes[0] <= size * u * stated <= sizes[2]}
    told = f"no such thing is {size * stated:.3g} m long, as the file format says"
    other = f"as stated, {size * stated:.3g} m; --scale {stated:g}"
    if fitting:
        name = min(fitting, key=lambda n: abs(np.log(size * fitting[n] * stated / sizes[1])))
        unit, chosen, sure = fitting[name] * stated, name, 0.8
        why = f"assumed: {name}, for {told}"
    else:
        unit, sure = sizes[1] / size, 0.5
        chosen = f"{unit:.3g} m"
        why = f"assumed: the usual size, for {told}, and no common unit explains it"
    longest = f"{chosen}, longest side {size * unit:.3g} m"
    return unit, why, Decision("unit", longest, why, other, sure)


def _settled(unit: float) -> tuple[float, str, Decision]:
    return unit, SAID, Decision("unit", f"{unit:g} m", SAID)


def _odds(size: float, suffix: str, usual: float | None) -> dict[str, float]:
    """Log odds of the units that give a size that is believed."""
    middle = usual or PLACEMENT.usual
    spread = PLACEMENT.spread if usual is None else PLACEMENT.known_spread
    prior = PLACEMENT.cad if suffix == ".stl" else PLACEMENT.plain
    low, high = PLACEMENT.believed
    return {
        name: before - 0.5 * float(np.log(size * unit / middle) / spread) ** 2
        for (name, unit), before in zip(UNITS.items(), prior) if low <= size * unit <= high
    }  # fmt: skip
