"""The manifest and the gallery of a batch."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Sequence
from dataclasses import fields

from jinja2 import Environment, PackageLoader, StrictUndefined

from mam_pipeline.optional import has
from mam_sim.batch.record import MADE, ORDER, Record, Target, as_row


def write_pages(records: Sequence[Record], target: Target, report: bool) -> None:
    """Write manifest.csv, manifest.parquet (where pyarrow is installed) and index.html."""
    ordered = sorted((r.readable for r in records), key=lambda r: r.name)
    target.write("manifest.csv", _csv(ordered).encode())
    if has("pyarrow"):
        target.write("manifest.parquet", _parquet(ordered))
    target.write("index.html", gallery(ordered, report).encode())


def counts(records: Sequence[Record]) -> dict[str, int]:
    """Objects by status, assets first."""
    found = Counter(r.status for r in records)
    return {status: found[status] for status in ORDER if found[status]}


def gallery(records: Sequence[Record], report: bool) -> str:
    """One page with a picture of every object; the pictures lie beside it."""
    environment = Environment(
        loader=PackageLoader("mam_sim"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    shown = sorted(records, key=lambda r: (ORDER.index(r.status), r.name))
    return environment.get_template("gallery.html.j2").render(
        records=shown, counts=counts(records), made=MADE, report=report
    )


def _csv(records: Sequence[Record]) -> str:
    out = io.StringIO()
    names = [f.name for f in fields(Record) if f.name != "log"]
    writer = csv.DictWriter(out, names)
    writer.writeheader()
    for record in records:
        row = as_row(record)
        writer.writerow({k: " ".join(map(str, v)) if isinstance(v, tuple) else v
                         for k, v in row.items()})  # fmt: skip
    return out.getvalue()


def _parquet(records: Sequence[Record]) -> bytes:
    import pyarrow as pa
    import pyarrow.parquet as pq

    kinds = {"tuple[str, ...]": pa.list_(pa.string()), "tuple[Share, ...]": pa.list_(pa.float64())}
    kinds |= {"NotNegative": pa.float64(), "Count": pa.int64()}
    columns = [
        (f.name, kinds.get(str(f.type), pa.string())) for f in fields(Record) if f.name != "log"
    ]
    buffer = io.BytesIO()
    pq.write_table(pa.Table.from_pylist([as_row(r) for r in records], pa.schema(columns)), buffer)
    return buffer.getvalue()
