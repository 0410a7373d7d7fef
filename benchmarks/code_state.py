"""Whether a figure was measured on the present code: git compares the files that it depends on."""

from __future__ import annotations

import ast
import subprocess
from collections.abc import Sequence
from enum import Enum
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


class State(Enum):
    """What git says of a figure's code; the value is how a page marks it."""

    PRESENT = ""
    OLDER = "older code"
    UNKNOWN = "unknown commit"
    UNTOLD = "code not compared"  # a shallow clone without the commit, or no clone


@cache
def state_of(commit: str, paths: tuple[str, ...], root: Path = ROOT) -> State:
    """Compare the working tree with the commit of a figure.

    A Python file has changed where its code has; comments and docstrings change no figure.

    Args:
        commit: that the figure was measured at. paths: of git that it depends on.
    """
    if not paths:
        raise ValueError("a figure depends on some path")
    shallow = _git(root, "rev-parse", "--is-shallow-repository")
    if shallow.returncode:
        return State.UNTOLD
    if not is_ancestor(commit, "HEAD", root):
        return State.UNTOLD if shallow.stdout.strip() == b"true" else State.UNKNOWN
    changed = _git(root, "diff", "--name-only", "--no-renames", "-z", commit, "--", *paths)
    if changed.returncode:
        return State.UNTOLD
    names = [name.decode() for name in changed.stdout.split(b"\0") if name]
    same = all(_same_code(root, commit, name) for name in names)
    return State.PRESENT if same else State.OLDER


def is_ancestor(commit: str, later: str, root: Path = ROOT) -> bool:
    """Whether one commit lies in the history of another; False where git does not know one."""
    return not _git(root, "merge-base", "--is-ancestor", commit, later).returncode


def head(root: Path = ROOT) -> str:
    """The commit of the working tree, short; "unknown" outside git."""
    return _git(root, "rev-parse", "--short", "HEAD").stdout.decode().strip() or "unknown"


def changes(paths: Sequence[str], root: Path = ROOT) -> list[str]:
    """Files among some paths that differ from the commit of the working tree."""
    status = _git(root, "status", "--porcelain", "--", *paths).stdout.decode()
    return [line[3:] for line in status.splitlines()]


def _same_code(root: Path, commit: str, name: str) -> bool:
    """Whether a Python file has the same code in a commit and in the working tree."""
    old = _git(root, "show", f"{commit}:{name}")
    new = root / name
    if not name.endswith(".py") or old.returncode or not new.is_file():
        return False
    return _code(old.stdout) == _code(new.read_bytes())


def _code(source: bytes) -> str:
    """A module without its comments and docstrings, as text to compare."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [line for line in body if not _is_text(line)]  # type: ignore[attr-defined]
    return ast.dump(tree)


def _is_text(node: ast.AST) -> bool:
    """A text that stands by itself: a docstring of a module, class, function or attribute."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _git(root: Path, *words: str) -> subprocess.CompletedProcess[bytes]:
    try:
        return subprocess.run(["git", *words], cwd=root, capture_output=True, check=False)
    except FileNotFoundError:  # no git
        return subprocess.CompletedProcess(words, 127, b"", b"")
