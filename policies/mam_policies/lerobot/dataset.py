"""Episodes as a LeRobotDataset (format v3.0) that reloads offline, in units that names say."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mam_pipeline import folders
from mam_pipeline.errors import InputError
from mam_pipeline.folder_data import dataset_folder
from mam_pipeline.optional import require
from mam_policies.collection import Names, Track

FPS = 20
REPO_ID = "local/mam_sim"
IMAGES = "observation.images."
"""What the names of pictures begin with."""


def offline() -> None:
    """Keep LeRobot from asking the Hub (a missing file would become a network error)."""
    os.environ.setdefault("HF_HUB_OFFLINE", "1")


def features(names: Names, images: dict[str, tuple[int, int]]) -> dict[str, dict[str, Any]]:
    """The dataset's features; `images`: camera name to (height, width), stored as video."""

    def vector(labels: tuple[str, ...]) -> dict[str, Any]:
        return {"dtype": "float32", "shape": (len(labels),), "names": list(labels)}

    out = {
        "observation.state": vector(names.state),
        "observation.environment_state": vector(names.environment),
        "action": vector(names.action),
        "next.reward": {"dtype": "float32", "shape": (1,), "names": None},
        "next.success": {"dtype": "bool", "shape": (1,), "names": None},
        "next.done": {"dtype": "bool", "shape": (1,), "names": None},
    }
    for camera, (height, width) in images.items():
        out[IMAGES + camera] = {
            "dtype": "video",
            "shape": (height, width, 3),
            "names": ["height", "width", "channels"],
        }
    return out


def write_dataset(
    tracks: Iterable[tuple[Track, NDArray[np.float32]]], names: Names, robot: str, root: Path
) -> Path:
    """Write episodes (with their rewards (T,)) into `root`, replacing what was there.

    The dataset is built beside its place and moved there when it is whole.

    Raises:
        InputError: there are no episodes.
    """
    offline()
    require("export to LeRobot", "lerobot", "datasets")
    import datasets
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    datasets.disable_progress_bars()  # one bar per episode would drown ours
    stream: Iterator[tuple[Track, NDArray[np.float32]]] = iter(tracks)
    first = next(stream, None)
    if first is None:
        raise InputError("there are no episodes to write")
    sizes = {k: (v.shape[1], v.shape[2]) for k, v in first[0].images.items()}
    with folders.work_folder(root) as work:
        dataset = LeRobotDataset.create(
            repo_id=REPO_ID,
            fps=FPS,
            features=features(names, sizes),
            root=work / "dataset",  # LeRobot makes the folder itself
            robot_type=robot,
            use_videos=bool(sizes),
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # statistics of booleans
            for track, rewards in (first, *stream):
                _add(dataset, track, rewards)
        with same_scheduling():
            dataset.finalize()
        folders.put_in_place(work / "dataset", root)
    return root


def _add(dataset: Any, track: Track, rewards: NDArray[np.float32]) -> None:
    last = len(track.action) - 1
    for t in range(last + 1):
        frame: dict[str, Any] = {
            "observation.state": track.state[t],
            "observation.environment_state": track.environment[t],
            "action": track.action[t],
            "next.reward": np.array([rewards[t]], dtype=np.float32),
            "next.success": np.array([track.success and t == last]),
            "next.done": np.array([t == last]),
            "task": track.task,
        }
        for camera, pictures in track.images.items():
            frame[IMAGES + camera] = pictures[t]
        dataset.add_frame(frame)
    with same_scheduling():
        dataset.save_episode()


@contextmanager
def same_scheduling() -> Iterator[None]:
    """Within it, this thread may become a real-time one; afterwards it is scheduled as before.

    The AV1 encoder makes whoever calls it as root a real-time thread (SCHED_FIFO 99). All that such
    a process starts is one too, and a busy browser among it takes the processors from all others.
    """
    policy, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        yield
    finally:
        os.sched_setscheduler(0, policy, parameter)


def read_tracks(dataset: Any) -> Iterator[tuple[Track, NDArray[np.float32]]]:
    """Episodes (with their rewards (T,)) of an open dataset."""
    task = str(dataset.meta.tasks.index[0])
    for row in dataset.meta.episodes:
        frames = [dataset[i] for i in range(row["dataset_from_index"], row["dataset_to_index"])]
        columns = {
            k: np.stack([_array(k, frame[k]) for frame in frames])
            for k in frames[0]
            if k == "action" or k.startswith("observation.")
        }
        rewards = np.array([float(f["next.reward"]) for f in frames], dtype=np.float32)
        yield track_of(columns, bool(frames[-1]["next.success"]), task), rewards


def track_of(columns: Mapping[str, NDArray[Any]], success: bool, task: str) -> Track:
    """An episode from columns under LeRobot's names, T rows each."""
    return Track(
        columns["observation.state"],
        columns["action"],
        columns["observation.environment_state"],
        {k[len(IMAGES) :]: columns[k] for k in columns if k.startswith(IMAGES)},
        success,
        task,
    )


def _array(name: str, value: Any) -> NDArray[Any]:
    """A dataset's entry as we keep it: pictures (3, h, w) in 0..1 as (h, w, 3) uint8."""
    array = np.asarray(value)
    if not name.startswith(IMAGES):
        return array
    picture = array.astype(np.float32).transpose(1, 2, 0)
    return np.clip(np.round(255 * picture), 0, 255).astype(np.uint8)


def load_dataset(root: Path) -> Any:
    """Open a dataset folder offline.

    Raises:
        InputError: there is none, or it was never finished.
    """
    require("a LeRobot dataset", "lerobot")
    offline()
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    dataset_folder(root)
    return LeRobotDataset(REPO_ID, root=root)
