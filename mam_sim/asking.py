"""Questions that a person beside the robot must answer before it moves."""

from __future__ import annotations

import sys

from mam_pipeline.errors import ConfigError


def ask(question: str, yes: bool) -> None:
    """Wait for Enter; Ctrl-C ends the command. `yes`: do not ask.

    Raises:
        ConfigError: there is nobody to ask (standard input is no terminal).
    """
    if yes:
        return
    if not sys.stdin.isatty():
        raise ConfigError(f"{question} Nobody can answer here; add --yes")
    print(f"{question} Press Enter, or Ctrl-C to stop.", file=sys.stderr)
    sys.stdin.readline()
