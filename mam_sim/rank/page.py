"""The result of the measure as plain data, as a table and as a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from rich.table import Table

from mam_sim.rank.measure import VERSION, Measure, Row, Share, Total, Verdict


def as_json(
    verdicts: Sequence[Verdict], rows: Sequence[Row], totals: Sequence[Total], measure: Measure
) -> dict[str, Any]:
    """Everything as plain data, with the version of the measure."""
    return {
        "measure": {"version": VERSION, **asdict(measure)},
        "totals": [asdict(t) for t in totals],
        "assets": [asdict(v) for v in verdicts],
        "rows": [asdict(r) for r in rows],
    }


def rows_table(verdicts: Sequence[Verdict], rows: Sequence[Row]) -> Table:
    """One line per asset, joint and robot."""
    policy = any(r.policy is not None for r in rows)
    table = Table(box=None, pad_edge=False)
    heads = ["asset", "joint", "robot", "lint", "check", "expert", *(["policy"] if policy else [])]
    for head in [*heads, "why"]:
        table.add_column(head, no_wrap=head != "why")
    for v in verdicts:
        mine = [r for r in rows if r.asset == v.name]
        said = [_mark(v.lint), _mark(v.check)]
        if not mine:
            blank = ["", "", *said, "-", *(["-"] if policy else [])]
            table.add_row(v.name, *blank, v.why or "nothing moves")
        for r in mine:
            table.add_row(v.name, r.joint, r.robot, *said, *_cells(r, policy), why(v, r))
    return table


def totals_table(totals: Sequence[Total]) -> Table:
    """One line per robot."""
    table = Table(title="totals", title_justify="left")
    heads = ["robot", "assets", "loaded", "lint", "check", "joints", "tried", "success", "on tried"]
    true = any(t.of_true is not None for t in totals)
    for head in [*heads, "policy", *(["of true joints"] if true else [])]:
        table.add_column(head, justify="left" if head == "robot" else "right")
    for t in totals:
        counts = [t.assets, t.loaded, t.lint, t.check, t.joints, t.tried]
        shares = [t.success.line(), t.on_tried.line(), t.policy.line() if t.policy else "-"]
        shares += [t.of_true.line()] if t.of_true is not None else []
        table.add_row(t.robot, *map(str, counts), *shares)
    return table


def page(
    verdicts: Sequence[Verdict], rows: Sequence[Row], totals: Sequence[Total], measure: Measure,
    videos: dict[tuple[str, str, str], str],
) -> str:  # fmt: skip
    """HTML; `videos`: address by asset, joint and robot."""
    environment = Environment(
        loader=PackageLoader("mam_sim"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    policy = any(r.policy is not None for r in rows)
    lines = []
    for v in verdicts:
        mine = [r for r in rows if r.asset == v.name]
        for r in mine:
            cells = [v.name, r.joint, r.robot, _mark(v.lint), _mark(v.check), *_cells(r, policy)]
            film = videos.get((r.asset, r.joint, r.robot), "")
            lines.append({"cells": cells, "why": why(v, r), "video": film})
        if not mine:
            cells = [v.name, "", "", _mark(v.lint), _mark(v.check), "-", *(["-"] * policy)]
            lines.append({"cells": cells, "why": v.why or "nothing moves", "video": ""})
    return environment.get_template("rank.html.j2").render(
        version=VERSION, measure=measure, totals=totals, lines=lines, policy=policy,
        videos=bool(videos), true=any(t.of_true for t in totals),
    )  # fmt: skip


def why(verdict: Verdict, row: Row) -> str:
    """Why a joint was not tried, or why episodes failed; else what the check says.

    Of a draft that nobody has confirmed that comes first.
    """
    said = ", ".join(verdict.reasons)
    if row.cause:
        said = f"{row.cause}: {row.why}"
    elif row.reasons:
        said = "; ".join(f"{n} x {text}" for text, n in row.reasons.items())
    return "; ".join(filter(None, (verdict.draft, said)))


def _cells(row: Row, policy: bool) -> list[str]:
    expert = Share.of(row.successes, row.episodes).line() if row.tried else "not tried"
    if not policy:
        return [expert]
    return [expert, "-" if row.policy is None else Share.of(row.policy, row.episodes).line()]


def _mark(held: bool | None) -> str:
    return {True: "ok", False: "no", None: "-"}[held]
