"""Run a research model outside: a command with an input and an output folder, or an HTTP service.

The contract is the same for both. In: a folder with `request.json` and files. Out: a folder with
files. Over HTTP the input folder travels as a zip in the body of POST <url>/<task> and a zip comes
back. A runner that cannot answer exits non-zero (or answers with a status >= 400); what it said is
part of our error. Nothing that comes back is executed or unpickled.
"""

from __future__ import annotations

import io
import json
import math
import shlex
import shutil
import subprocess
import time
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mam_pipeline.backends import Availability
from mam_pipeline.errors import BackendError
from mam_pipeline.guarded import Limits, guarded
from mam_pipeline.models import settings
from mam_pipeline.secrets import bare_url, masked

MAX_ANSWER = 2 << 30
_TAIL = 1500


@dataclass(frozen=True)
class Runner:
    """Where a model answers: a URL, or a command to which arguments are appended."""

    url: str | None = None
    command: tuple[str, ...] = ()


def runner(variable: str) -> Runner | None:
    """The runner that was set; None where none was."""
    value = settings.text(variable)
    if not value:
        return None
    if value.startswith(("http://", "https://")):
        return Runner(url=value.rstrip("/"))
    return Runner(command=tuple(shlex.split(value)))


def availability(variable: str, licence: str, page: str) -> Availability:
    """Whether a runner is named and, for a command, can be found."""
    found = runner(variable)
    if found is None:
        return Availability(False, f"set {variable} to its command or URL ({page})", "", licence)
    if found.command and shutil.which(found.command[0]) is None:
        why = f"{variable} names {found.command[0]!r}, which is not an executable here"
        return Availability(False, why, "", licence)
    return Availability(True, "", bare_url(found.url or found.command[0]), licence)


def call(variable: str, task: str, request: Mapping[str, Any], inbox: Path, outbox: Path) -> None:
    """Send `inbox` (with request.json added) to the runner; its answer lies in `outbox`.

    Raises:
        BackendError: no runner, a crash, a time-out, an HTTP error, an answer that is no zip.
    """
    found = runner(variable)
    if found is None:
        raise BackendError(f"{variable} is not set; see: mam-sim doctor")
    (inbox / "request.json").write_text(json.dumps({"task": task, **request}, indent=1))
    outbox.mkdir(parents=True, exist_ok=True)
    limit = settings.number("MAM_SIM_TIMEOUT", 900)
    if found.url is not None:
        _over_http(found.url, task, inbox, outbox, limit)
    else:
        _as_process(
            [*found.command, "--task", task, "--input", str(inbox), "--output", str(outbox)], limit
        )


def _as_process(command: list[str], limit: float) -> None:
    name = Path(command[0]).name
    if shutil.which(command[0]) is None:
        raise BackendError(f"{name} cannot be started: it is not an executable here")
    began = time.monotonic()
    with subprocess.Popen(
        guarded(command, Limits(limit, math.inf)),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
    ) as process:
        try:
            _, said = process.communicate()
        except BaseException:  # told to stop: the watcher ends all that the runner started
            process.terminate()
            raise
    if process.returncode == 124 and time.monotonic() - began >= limit:
        raise BackendError(f"{name} gave no answer within {limit:g} s (MAM_SIM_TIMEOUT)")
    if process.returncode:
        why = masked(said.strip())[-_TAIL:] or "it said nothing"
        if process.returncode in (-9, 137):
            why = f"it was killed, most likely for memory; {why}"
        raise BackendError(f"{name} failed with status {process.returncode}: {why}")


def _over_http(url: str, task: str, inbox: Path, outbox: Path, limit: float) -> None:
    import requests

    body = io.BytesIO()
    with zipfile.ZipFile(body, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(p for p in inbox.rglob("*") if p.is_file()):
            archive.write(file, file.relative_to(inbox).as_posix())
    headers = {"Content-Type": "application/zip"}
    try:
        answer = requests.post(
            f"{url}/{task}", data=body.getvalue(), headers=headers, timeout=(10, limit)
        )
    except requests.Timeout as error:
        raise BackendError(f"{url} gave no answer within {limit:g} s (MAM_SIM_TIMEOUT)") from error
    except requests.RequestException as error:
        raise BackendError(f"{url} cannot be reached: {error}") from error
    if answer.status_code >= 400:
        said = masked(answer.text.strip())[-_TAIL:]
        raise BackendError(f"{url} answered {answer.status_code}: {said or 'nothing more'}")
    unpack(answer.content, outbox, url)


def unpack(data: bytes, folder: Path, whence: str) -> None:
    """Unpack a zip that a stranger sent: plain files inside `folder`, bounded in size.

    Raises:
        BackendError: not a zip, a path that leaves the folder, or more than 2 GiB.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            if sum(info.file_size for info in archive.infolist()) > MAX_ANSWER:
                raise BackendError(f"{whence} sent more than {MAX_ANSWER >> 30} GiB")
            root = folder.resolve()
            for info in archive.infolist():
                target = (root / info.filename).resolve()
                if not target.is_relative_to(root):
                    raise BackendError(f"{whence} sent a path outside its folder: {info.filename}")
            archive.extractall(root)
    except (zipfile.BadZipFile, zipfile.LargeZipFile, OSError, RuntimeError) as error:
        raise BackendError(f"{whence} sent half an answer, or no zip: {error}") from error


def need(outbox: Path, name: str, whence: str) -> Path:
    """A file that the runner had to write.

    Raises:
        BackendError: it is not there.
    """
    path = outbox / name
    if not path.is_file():
        raise BackendError(f"{whence} ended without an error but wrote no {name}")
    return path
