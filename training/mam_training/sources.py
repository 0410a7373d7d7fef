"""Where training objects come from: the procedural world, and folders of URDFs of other sources."""

from __future__ import annotations

from pathlib import Path

GENERATED = "generated"
"""The procedural world, in `trained_on` of a manifest; other sources go by their folder's name."""
OTHERS = (
    Path("../shared/bench/dev"),
    Path("build/sweet_home"),  # benchmarks/sweet_home_dataset.py
    Path("build/scene_synthesizer"),  # benchmarks/scene_synthesizer_dataset.py
)
