"""What the looks at the motion change: recorded answers scored with and without them.

    python benchmarks/motion_looks.py DATASET [--answers ARCHIVE ...]

After the joints are solved, a language model sees each part closed, half open and open, and may
correct it (`--vlm-rounds`). Here the same archives as of language_model.py are replayed twice, once
with those answers taken away. Printed are the means of both, and each object that changed.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import tyro
from language_model import ANSWERS, Archive, judged, line
from mam_sim_bench.runner import Record
from tyro.conf import Positional

from mam_world.ground_truth import list_objects, read_object


def main(dataset: Positional[str], answers: tuple[Path, ...] = ANSWERS) -> None:
    """Replay with and without the looks.

    Args:
        dataset: folder of ground-truth URDFs. answers: archives.
    """
    found: dict[str, tuple[list[Record], list[Record]]] = {}
    with tempfile.TemporaryDirectory() as scratch:
        known = [Archive.of(file, Path(scratch) / str(k)) for k, file in enumerate(answers)]
        for name, category, urdf in list_objects(dataset):
            for archive in known:
                folder = archive.folder / name
                looks = list(folder.glob("?_motion"))
                if not looks:
                    continue
                truth = read_object(urdf, name, category)
                with_looks = judged(folder, truth, "embedded", "file", True)[0]
                for look in looks:
                    shutil.rmtree(look)
                without = judged(folder, truth, "embedded", "file", True)[0]
                both = found.setdefault(archive.by, ([], []))
                both[0].append(without)
                both[1].append(with_looks)
                changed = line(name, [without]) != line(name, [with_looks])
                print(f"{name}, {archive.by}: {'changed' if changed else 'as before'}", flush=True)
                if changed:
                    print(line("without", [without]), line("with", [with_looks]), sep="\n")
    for by, (without_all, with_all) in found.items():
        print(line(f"**{by}**, without looks", without_all))
        print(line(f"**{by}**, with them", with_all))


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
