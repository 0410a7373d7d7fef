"""`python -m mam_training.labels ask | show | agree | dataset | pack | unpack`: labels by eye."""

from __future__ import annotations

import sys
from pathlib import Path

import tyro
from tyro.conf import Positional

from mam_pipeline.errors import MamSimError
from mam_pipeline.models.motion_check import motion_sheets
from mam_pipeline.render import pictures
from mam_training.labels.ask import ask_all, items_of, read_item
from mam_training.labels.ask import pack as pack_answers
from mam_training.labels.ask import unpack as unpack_answers
from mam_training.labels.dataset import (
    agreement_table,
    labels_in,
    seen_by_weights,
    write_dataset,
)
from mam_training.labels.label import Label

LABELS = Path("labels")


def ask(
    corpus: Positional[Path],
    ids: Positional[tuple[str, ...]],
    /,
    work: Path,
    by: str,
    labels: Path = LABELS,
    seconds: float = 0.0,
) -> int:
    """Put the next question about each object, or write its label where all are answered.

    Args:
        corpus: folder with MANIFEST.csv and files/. ids: objects of it.
        work: folder for questions and answers. by: who or what answers.
        labels: folder of the labels.
        seconds: that one object may take before it is left out and said; 0: no limit.
    """
    return ask_all(items_of(corpus, ids), work, by, labels, seconds)


def show(label: Positional[Path], corpus: Path, out: Path) -> int:
    """Draw what a label says: every joint closed, half open and open.

    Args:
        label: its file. corpus: folder with MANIFEST.csv and files/. out: PNG to write.
    """
    found = Label.load(label)
    read = read_item(items_of(corpus, [found.id])[0].file)
    sheets = motion_sheets(found.articulation(read.mesh, read.source_to_asset))
    if not sheets:
        print(f"{found.id}: nothing moves" if found.nothing_moves else f"{found.out_of_scope}")
        return 0
    out.write_bytes(pictures.png(pictures.sheet(sheets, 1)))
    print(out)
    return 0


def agree(one: Positional[Path], other: Positional[Path], corpus: Path) -> int:
    """Compare two labels of an object, or all that two folders have in common.

    Args:
        one: a label's file, or a folder of labels; taken for the truth. other: the second one.
        corpus: folder with MANIFEST.csv and files/.
    """
    if one.is_file():
        pairs = [(one, other)]
    else:
        second = {file.name: file for file in labels_in(other)}
        pairs = [(file, second[file.name]) for file in labels_in(one) if file.name in second]
    print(agreement_table([(Label.load(a), Label.load(b)) for a, b in pairs], corpus))
    return 0


def dataset(
    out: Positional[Path], corpus: Path, labels: Path = LABELS, unseen: bool = False,
    seen: bool = False,
) -> int:  # fmt: skip
    """Write all labelled objects in the form that `mam-sim bench` reads.

    Args:
        out: folder to write. corpus: folder with MANIFEST.csv and files/.
        labels: folder of the labels.
        unseen: only objects that none of the package's weights was trained on.
        seen: only the others, on which weights are trained again.
    """
    files, known = labels_in(labels), seen_by_weights() if unseen or seen else frozenset()
    if unseen:
        files = [file for file in files if file.stem not in known]
    if seen:
        files = [file for file in files if file.stem in known]
    count = write_dataset(files, corpus, out)
    print(f"{count} objects in {out}; score an engine on them: mam-sim bench {out}")
    return 0


def pack(work: Positional[Path], archive: Positional[Path], by: str) -> int:
    """Keep the answers of a folder of questions as one archive, without the pictures.

    Args:
        work: folder of questions and answers. archive: ZIP file to write. by: who answered.
    """
    print(f"{pack_answers(work, archive, by)} objects in {archive}")
    return 0


def unpack(archive: Positional[Path], ids: Positional[tuple[str, ...]], /, work: Path) -> int:
    """Put kept answers back into a folder of questions, to go on with them by `ask`.

    Args:
        archive: ZIP file that `pack` made. ids: objects of it; none: all.
        work: folder for questions and answers.
    """
    print(f"{unpack_answers(archive, work, ids)} objects in {work}")
    return 0


def main() -> int:
    """Run one of the commands; exit codes are those of mam-sim."""
    try:
        return int(
            tyro.extras.subcommand_cli_from_dict(
                {
                    "ask": ask,
                    "show": show,
                    "agree": agree,
                    "dataset": dataset,
                    "pack": pack,
                    "unpack": unpack,
                }
            )
        )
    except MamSimError as error:
        print(error, file=sys.stderr)
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
